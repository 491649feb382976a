"""How likely stick-slip is at an operating point, from draws and from straight lines, as numbers and in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.quantiles import LEVEL, beta, normal_below
from identify.base.result import Interval
from identify.model.model import Model
from identify.prediction.cycle import CycleMap
from identify.prediction.intervals import (
    LEAST_DRAWS,
    POINT,
    AnswerInterval,
    Drawn,
    OperatingPoint,
    Spread,
    Uncertain,
    maps,
)
from identify.prediction.orbit import Orbit, long_enough, settle
from identify.prediction.path import moved_orbit
from identify.prediction.quantities import QUANTITIES, end_slopes, orbit_slopes, quantities, sliding_slopes
from identify.prediction.solutions import SolutionSet, solution_set
from identify.prediction.windows import StickSlipLimit
from identify.prediction.wording import said
from identify.simulation.sliding import growth_rates

# ----------------------------------------------------------------------------------------------------------------------
# How sure the answers at an operating point are: probability of stick-slip, and intervals from draws beside the linear
# ones.
#
# Every draw of the parameters is asked what it does: whether a periodic orbit is found (from the orbit of the estimate,
# else from a rested contact, the strongest kick a start can give) and whether steady sliding dies out or grows.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

DRAWS = 400
ALIKE = 0.1  # of a half width, by which ends of a linear and a sampled interval may differ to be called alike
CHANCE = 3.5  # what chance adds to that, times the root of the draws: 2.6 standard errors of a 2.5 % quantile


@dataclass(frozen=True)
class Probability:
    """Probability of an outcome as the interface gives it: share of the draws with its interval, and by straight lines
    (None where open)."""

    value: float
    unit: str
    interval: tuple[float, float]
    linear: float | None


@dataclass(frozen=True)
class StickSlipProbability:
    """How sure the answers are: possible, that stick-slip exists at the drive speed; certain, that it starts by
    itself too (steady sliding is unstable); sampled (low, high) by name of `sensitivity.QUANTITIES`, among draws that
    stick and slip; draws that were asked, and refused as no pair can have them; open: why nothing could be drawn."""

    possible: Probability | None
    certain: Probability | None
    sampled: Mapping[str, tuple[float, float]]
    draws: int
    refused: int
    open: tuple[str, ...] = ()


@dataclass(frozen=True)
class DrawAnswers:
    """What n draws do: quantities (n, 8), NaN without stick-slip; sticks (n,); growth rate of sliding (n,) [1/s]."""

    quantities: Array
    sticks: NDArray[np.bool_]
    growth: Array


def stick_slip_probability(
    map_: CycleMap,
    answer: SolutionSet,
    names: Sequence[str],
    covariance: ArrayLike,
    count: int = DRAWS,
    seed: int = 0,
) -> StickSlipProbability:
    """How sure the answer at its drive speed is.

    Args:
        names: what the covariance (f, f) [SI] is of: parameters, "drive_speed", "normal_force".
        count: draws; each takes some milliseconds.
    """
    point = {"drive_speed": answer.steady.drive_speed, "normal_force": map_.normal_force}
    values = dict(zip(map_.model.parameter_names, map_.p.tolist(), strict=True)) | point
    known = Uncertain(map_.model, values, names, covariance)
    if known.unknown:
        return StickSlipProbability(None, None, {}, 0, 0, known.unknown)
    drawn = known.draw(count, seed)
    asked = answers_of_draws(map_.model, drawn, answer.orbit)
    linear = linear_probabilities(map_, answer, names, np.asarray(covariance, float))
    unstable = asked.growth > 0
    ends = {}
    if np.sum(asked.sticks) >= LEAST_DRAWS:
        rows = np.nanquantile(asked.quantities[asked.sticks], [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
        ends = {name: (float(rows[0, i]), float(rows[1, i])) for i, name in enumerate(QUANTITIES)}
    probabilities = [
        _probability_of(q, hits) for q, hits in zip(linear, (asked.sticks, asked.sticks & unstable), strict=True)
    ]
    return StickSlipProbability(probabilities[0], probabilities[1], ends, len(drawn.settings), drawn.refused)


def answers_of_draws(model: Model, drawn: Drawn, near: Orbit | None) -> DrawAnswers:
    """What every draw does; `near` is the orbit of the estimate, from which those of the draws are sought."""
    count = len(drawn.settings)
    growth = growth_rates(model, drawn.settings) if count else np.zeros(0)
    rows, sticks = np.full((count, len(QUANTITIES)), np.nan), np.zeros(count, dtype=bool)
    for i, (map_, speed) in enumerate(maps(model, drawn)):
        patience = long_enough(float(growth[i]) * map_.half_period)
        orbit = None if near is None else moved_orbit(near, map_, speed, patience)
        for y in () if orbit is not None else (None,) if near is None else (None, near.y):
            settled = settle(map_, speed, y, patience=patience)
            orbit, sticks[i] = settled.orbit, settled.sticks
            if settled.sticks:
                break
        if orbit is not None:
            sticks[i], rows[i] = True, quantities(map_, orbit.cycle, speed)
    return DrawAnswers(rows, sticks, growth)


def linear_probabilities(
    map_: CycleMap, answer: SolutionSet, names: Sequence[str], covariance: Array
) -> tuple[float | None, float | None]:
    """(possible, certain) from straight lines: of the logarithm of the speed at which stick-slip ends over the drive
    speed, and of the growth rate of sliding; None where open."""
    speed = answer.steady.drive_speed
    spread = Spread(map_.model, map_.p, names, covariance, dict(zip(POINT, (speed, map_.normal_force), strict=True)))
    possible = _possible(map_, answer, names, spread)
    growth = answer.steady.growth
    deviation = spread.deviation(growth, sliding_slopes(map_, speed, names)[0])
    if possible is None or deviation is None:
        return possible, None
    unstable = normal_below(float(np.sign(growth)) / deviation) if deviation > 0 else float(growth > 0)
    return possible, min(possible, unstable)


def _possible(map_: CycleMap, answer: SolutionSet, names: Sequence[str], spread: Spread) -> float | None:
    """By the limits of the range with stick-slip that is nearest to the drive speed."""
    speed, parts = answer.steady.drive_speed, answer.windows.sticking
    if not parts:
        return 0.0
    part = min(parts, key=lambda each: each.distance(speed))
    low = 0.0 if part.low is None else _above(map_, part.low, speed, names, spread)
    high = 1.0 if part.high is None else _above(map_, part.high, speed, names, spread)
    return None if low is None or high is None else max(0.0, high - low)


def _above(map_: CycleMap, limit: StickSlipLimit, speed: float, names: Sequence[str], spread: Spread) -> float | None:
    """Probability that a limit lies above the drive speed [m/s]; None where it is open."""
    ratio, slopes = limit.speed / speed, end_slopes(map_, limit, names) / speed
    if "drive_speed" in names:
        slopes[list(names).index("drive_speed")] = -ratio / speed
    deviation = spread.deviation(ratio, slopes)
    if deviation is None:
        return None
    return normal_below(float(np.log(ratio)) / deviation) if deviation > 0 else float(ratio > 1)


def _probability_of(linear: float | None, hits: NDArray[np.bool_]) -> Probability:
    n, k = hits.size, int(np.sum(hits))
    tail = (1 - LEVEL) / 2
    low = beta(tail, k, n - k + 1) if k else 0.0
    high = beta(1 - tail, k + 1, n - k) if k < n else 1.0
    return Probability(k / n if n else float("nan"), "", (low, high), linear)


def alike(linear: AnswerInterval, sampled: tuple[float, float], draws: int) -> bool | None:
    """Whether a linear interval and one from draws say the same; None where the linear one is open."""
    if linear.low is None or linear.high is None:
        return None
    apart = (ALIKE + CHANCE / np.sqrt(draws)) * 0.5 * (linear.high - linear.low)
    return bool(abs(sampled[0] - linear.low) <= apart and abs(sampled[1] - linear.high) <= apart)


@dataclass(frozen=True)
class ComparedInterval:
    """A quantity of the jumps with its interval from draws; linear: by straight lines, None where these say something
    else; alike: whether both say the same, None where that cannot be said."""

    value: float | None
    unit: str
    linear: Interval | None
    interval: tuple[float, float]
    alike: bool | None
    validity: str = "interval from draws"


@dataclass(frozen=True)
class PredictionCertainty:
    """How sure the prediction at an operating point is, as the interface gives it; None where there is nothing to
    say; open: what the data do not tell, so that nothing could be drawn."""

    possible: Probability | None
    certain: Probability | None
    quantities: Mapping[str, ComparedInterval]
    draws: int
    refused: int
    open: tuple[str, ...]
    text: str


# ----------------------------------------------------------------------------------------------------------------------
# How sure an answer is, as a document and in words: probability of stick-slip, lines and draws compared.
# ----------------------------------------------------------------------------------------------------------------------


def prediction_certainty(
    model: Model,
    point: OperatingPoint,
    names: Sequence[str],
    draws: int = DRAWS,
) -> PredictionCertainty:
    """Probability of stick-slip at an operating point and intervals of its jumps, by lines and by draws.

    Args:
        names: what the covariance of the point is of: parameters, "drive_speed", "normal_force".
        draws: how many; each takes some milliseconds.

    Raises:
        SimulationError: a motion that cannot be integrated.
    """
    drive_speed, normal_force, covariance = abs(point.drive_speed), point.normal_force, point.covariance
    where = f"{said(drive_speed, 'm/s')} and {said(normal_force, 'N')}"
    if covariance is None or not names:
        why = "nothing that it depends on has an error: give tolerances, priors, or the result of a fit that tells it"
        return PredictionCertainty(None, None, {}, 0, 0, (), f"How sure this is at {where} cannot be said: {why}.")
    map_ = CycleMap(model, normal_force, np.array([float(point.values[name]) for name in model.parameter_names]))
    answer = solution_set(map_, drive_speed)
    found = stick_slip_probability(map_, answer, names, covariance, draws)
    lines: dict[str, AnswerInterval | None] = {}
    now: dict[str, float] = {}
    if answer.orbit is not None:
        at = dict(zip(POINT, (answer.orbit.drive_speed, normal_force), strict=True))
        spread = Spread(model, map_.p, names, np.asarray(covariance, float), at)
        row = quantities(map_, answer.orbit.cycle, answer.orbit.drive_speed)
        slopes = orbit_slopes(map_, answer.orbit, names)
        now = dict(zip(QUANTITIES, row.tolist(), strict=True))
        lines = {name: spread.positive(now[name], s) for name, s in zip(QUANTITIES, slopes, strict=True)}
    rows = {}
    for name, ends in found.sampled.items():
        line = lines.get(name)
        same = None if line is None else alike(line, ends, found.draws)
        shown = None if line is None or same is False else (line.low, line.high)
        rows[name] = ComparedInterval(now.get(name), QUANTITIES[name], shown, ends, same)
    text = _text(where, found, rows)
    return PredictionCertainty(found.possible, found.certain, rows, found.draws, found.refused, found.open, text)


def _text(where: str, found: StickSlipProbability, rows: Mapping[str, ComparedInterval]) -> str:
    if found.possible is None or found.certain is None:
        return f"Probability of stick-slip at {where}: open, as these data do not tell {', '.join(found.open)}."
    sentences = [
        f"Probability of stick-slip at {where}: {_probability(found.possible, found.draws)}.",
        f"That it starts by itself from steady sliding: {_probability(found.certain, found.draws)}.",
    ]
    compared = [row.alike for row in rows.values() if row.alike is not None]
    if compared and all(compared):
        sentences.append("Intervals from draws and from straight lines agree.")
    for name, row in rows.items():
        if row.alike is False:
            low, high = (said(end, row.unit) for end in row.interval)
            sentences.append(f"95 % of the draws of the {name.replace('_', ' ')} lie from {low} to {high}.")
    if found.refused:
        sentences.append(f"{found.refused} draws were left out: no pair has such friction.")
    return " ".join(sentences)


def _probability(probability: Probability, draws: int) -> str:
    low, high = (100 * end for end in probability.interval)
    share = 100 * probability.value
    middle = f"above {low:.3g} %" if share == 100 else f"below {high:.2g} %" if share == 0 else f"{share:.3g} %"
    line = "open"
    if probability.linear is not None:
        percent = 100 * probability.linear
        line = "below 0.1 %" if percent < 0.1 else "above 99.9 %" if percent > 99.9 else f"{percent:.3g} %"
    ends = "" if share in (0, 100) else f", 95 %: {low:.3g} to {high:.3g} %"
    return f"{middle} ({draws} draws{ends}; by straight lines {line})"
