"""Several records: whether they share their parameters and their mass, and what the others predict of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from identify.base.quantiles import NORMAL
from identify.estimation.strategies import in_time
from identify.uneven import wording
from identify.uneven.drawn import Begin, drawn_distributions
from identify.uneven.estimator import Maximum, maximise
from identify.uneven.events import Sticks
from identify.uneven.slip_functions import THETA

APART = 0.01  # probability of the difference, below which records do not share them
# Of the logarithm of the mass: by how much one slider's differs from record to record beyond what each record knows
# of it, as no law of weakening is quite true (docs/validation.md, Measured records).
LAW_ERROR = 0.25
MASS = np.eye(len(THETA))[THETA.index("mass")]


@dataclass(frozen=True)
class Mass:
    """The mass of a slider [kg] with its 95 % interval; and where records were compared, every record's (value, lower,
    upper), and chi-squared of their difference with its degrees of freedom and its probability."""

    value: float
    lower: float
    upper: float
    each: tuple[tuple[float, float, float], ...] = ()
    scatter: tuple[tuple[float, int, float], ...] = ()

    @property
    def shared(self) -> bool:
        """Whether records show one mass."""
        return all(probability >= APART for _, _, probability in self.scatter)

    def to_dict(self) -> dict[str, object]:
        """As in `mass_homogeneity` of result.json."""
        each = [{"value": value, "interval": [low, high]} for value, low, high in self.each]
        chi2, freedom, probability = self.scatter[0]
        return {"masses": each, "chi2": chi2, "degrees_of_freedom": freedom, "probability": probability}


def mass_of(maximum: Maximum, stiffness_error: float) -> Mass:
    """What one record, or several that share all parameters, tell of the mass; it goes with the stiffness, whose
    relative standard error is given."""
    low, high = maximum.interval(MASS, float(np.hypot(LAW_ERROR, stiffness_error)))
    return Mass(*np.exp([MASS @ maximum.theta, low, high]).tolist())


def pooled_mass(records: Sequence[Sticks], maxima: Sequence[Maximum]) -> Mass:
    """One mass of records that were maximised each by itself, weighted by their errors: those of the law are each
    record's own, that of the stiffness is common to all."""
    common = records[0].rig.error
    own = [mass_of(maximum, 0.0) for maximum in maxima]
    middle = np.log([np.sqrt(mass.lower * mass.upper) for mass in own])
    sd = np.array([np.log(mass.upper / mass.lower) / (2.0 * m.quantile) for mass, m in zip(own, maxima, strict=True)])
    weight = sd**-2.0 / np.sum(sd**-2.0)
    mean = float(weight @ middle)
    chi2 = float(np.sum(((middle - mean) / sd) ** 2))
    off = NORMAL * float(np.hypot(np.sum(sd**-2.0) ** -0.5, common))
    each = tuple((mass.value, mass.lower, mass.upper) for mass in (mass_of(m, common) for m in maxima))
    value, low, high = np.exp([mean, mean - off, mean + off]).tolist()
    return Mass(value, low, high, each, ((chi2, len(own) - 1, float(chdtrc(len(own) - 1, chi2))),))


@dataclass(frozen=True)
class Transfer:
    """What the other records predict of one that is left out: number of it (from 0), its drive speed [m/s], stiffness
    over the load [1/m]; per quantity (drop over the load, period [s]) predicted median and its interval, and measured
    median."""

    number: int
    drive_speed: float
    stiffness: float
    predicted: dict[str, tuple[float, float, float]]
    measured: dict[str, float]

    @property
    def holds(self) -> bool:
        """Whether every measured median lies within the interval of the predicted one."""
        return all(low <= self.measured[name] <= high for name, (_, low, high) in self.predicted.items())

    def to_dict(self) -> dict[str, object]:
        """As in `transfer` of result.json; logs are counted from 1."""
        quantities = {
            name: {"predicted": value, "interval": [low, high], "measured": self.measured[name]}
            for name, (value, low, high) in self.predicted.items()
        }
        return {"log": self.number + 1, "drive_speed_m_per_s": self.drive_speed, **quantities, "holds": self.holds}


def alone(records: Sequence[Sticks], maximum: Maximum, stated: Mapping[str, tuple[float, float]]) -> list[Maximum]:
    """The maximum of every record by itself, from that of all."""
    return [maximise([sticks], stated, maximum.theta) for sticks in records]


def agreement(joint: Maximum, each: Sequence[Maximum]) -> float:
    """Probability that records differ by as much, if they share their parameters: by the ratio of likelihoods, which
    asks how well one set of parameters describes all of them, however crookedly each tells its own.

    Args:
        joint: maximum of all records together; each: of every one by itself.
    """
    ratio = 2.0 * (sum(maximum.log_likelihood for maximum in each) - joint.log_likelihood)
    return float(chdtrc(joint.theta.size * (len(each) - 1), max(ratio, 0.0)))


def left_out(
    numbers: Sequence[int],
    records: Sequence[Sticks],
    maxima: Sequence[Maximum],
    stated: Mapping[str, tuple[float, float]],
    seed: int,
) -> list[Transfer]:
    """Leave-one-out over records of different drive speed or stiffness; empty where all have the same.

    Args:
        maxima: of every record by itself.
    """
    points = [(round(s.rig.rate / s.rig.stiffness, 9), round(s.rig.stiffness, 3)) for s in records]
    if len(set(points)) < 2:
        return []
    out = []
    for i, sticks in enumerate(records):
        if not in_time(wording.LEFT_OUT):
            break
        others = [j for j, point in enumerate(points) if point != points[i]]
        known = maxima[others[0]]
        if len(others) > 1:
            known = maximise([records[j] for j in others], stated, known.theta)
        if not known.converged:
            continue
        middle, smallest = 0.5 * (sticks.line + sticks.arrest), float(np.min(sticks.drop))
        begin = Begin(middle, sticks.arrest, smallest, sticks.usual_rest)
        _, drop, period = drawn_distributions(sticks.rig, begin, known.theta, known.covariance, seed)
        predicted = {d.name: (d.values[1], *d.median_of(sticks.count, seed)) for d in (drop, period)}
        whole = np.diff(sticks.anchor)[sticks.follows[1:]]
        measured = {"drop": float(np.median(sticks.drop)), "period": float(np.median(whole))}
        out.append(
            Transfer(
                numbers[i],
                sticks.rig.drive_speed,
                sticks.rig.stiffness,
                {name: tuple(float(v) for v in values) for name, values in predicted.items()},  # type: ignore[misc]
                measured,
            )
        )
    return out
