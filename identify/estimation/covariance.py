"""How well the parameters are known: information, covariance, intervals, verdicts, what errors of the rig add.

The information matrix of all search variables (rig included) is the Schur complement of the KKT matrix at the
solution: everything else (states, event times, multipliers) is eliminated. From it follow the covariance of what was
free, and how it shifts with what was taken as exact.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from identify.base.linear import solve_equilibrated
from identify.base.quantiles import NORMAL
from identify.logs.unknowns import Unknowns
from identify.model.model import RIG_PARAMETERS
from identify.shooting.layout import kept_parameters
from identify.shooting.passes import Solved
from identify.shooting.shooting import Problem

Array = NDArray[np.float64]

IDENTIFIED, WEAK = 0.20, 3.0  # interval ends within 20 % of the value; within a factor 3
FARTHEST = 20.0  # a logarithm that is farther off than that is open


@dataclass(frozen=True)
class Information:
    """Information matrix (n_p, n_p) of theta, priors included, and of the data alone; `joint` (n_p + o, n_p + o) that
    of theta and of the o parameters that single logs or groups have for themselves."""

    unknowns: Unknowns
    total: Array
    data: Array
    joint: Array

    @property
    def free(self) -> NDArray[np.int64]:
        """Indices of the free parameters."""
        return np.flatnonzero(self.unknowns.free)

    @property
    def known(self) -> bool:
        """Whether the model has derivatives there."""
        return bool(np.all(np.isfinite(self.total)))

    def covariance(self) -> Array:
        """Covariance (f, f) of the free theta; directions the data do not determine have infinite variance."""
        return inverse(self.total[np.ix_(self.free, self.free)])

    def joint_covariance(self) -> Array:
        """Covariance (f + o, f + o) of the free theta and of what single logs or groups have for themselves."""
        n_p = len(self.unknowns.names)
        kept = np.concatenate([self.free, np.arange(n_p, self.joint.shape[0])])
        return inverse(self.joint[np.ix_(kept, kept)])

    def shift(self, column: int) -> Array:
        """How far the free theta (f,) move per unit of a theta that was held."""
        return self._response(self.total[self.free, column])

    def drive_speed_shift(self, values: Array) -> Array:
        """The same per relative error of all drive speeds together; values (n_p,) [SI] of all parameters there."""
        return self._response(-(self.data @ _by_drive_speed(self.unknowns, values))[self.free])

    def _response(self, change: Array) -> Array:
        """The answer of the free theta to a change of their gradient, to first order."""
        block = self.total[np.ix_(self.free, self.free)]
        return np.asarray(-np.linalg.lstsq(block, change, rcond=1e-13)[0])


def information_at(solved: Solved, unknowns: Unknowns) -> Information:
    """The information of the data on all parameters, those held fixed too, at an answer."""
    return information(*solved.problem.with_all_parameters(replace(unknowns, start=solved.theta), solved.solution.z))


def information(problem: Problem, z: Array) -> Information:
    """The information matrix at a solution of a problem in which every parameter is an unknown.

    Args:
        z: scaled unknowns (n,).

    Raises:
        ValueError: a problem that leaves parameters out.
    """
    layout = problem.layout
    n_p = len(layout.unknowns.names)
    if layout.free.size != n_p:
        raise ValueError("the information matrix wants a problem with every parameter among its unknowns")
    point = problem.evaluate(z, derivatives=True)
    hessian = (point.hessian + sp.triu(point.hessian, 1).T).tocsc()
    jacobian = point.jacobian.tocsc()
    kept = kept_parameters(layout)
    rest = np.setdiff1d(np.arange(layout.size), kept)
    kkt = sp.bmat([[hessian[rest][:, rest], jacobian[:, rest].T], [jacobian[:, rest], None]], format="csc")
    right = sp.vstack([hessian[rest][:, kept], jacobian[:, kept]]).toarray()
    schur = hessian[kept][:, kept].toarray() - right.T @ solve_equilibrated(kkt, right)
    scale = layout.scale[kept]
    joint = 0.5 * (schur + schur.T) / np.outer(scale, scale)
    total = joint[:n_p, :n_p]
    if kept.size > n_p:  # what logs have for themselves follows
        across, own = joint[:n_p, n_p:], joint[n_p:, n_p:]
        total = total - across @ np.linalg.lstsq(own, across.T, rcond=1e-13)[0]
    return Information(layout.unknowns, total, total - layout.unknowns.prior_precision, joint)


def inverse(matrix: Array) -> Array:
    """Inverse (n, n) of a positive semidefinite matrix; what it does not hold gets a huge variance, not a small one."""
    diagonal = np.diag(matrix)
    # A parameter without any information: a variance large enough to say so and small enough to compute with.
    scale = 1.0 / np.sqrt(np.maximum(diagonal, max(1e-24 * float(np.max(diagonal)), 1e-24)))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    floor = 1e-13 * max(float(values[-1]), 1.0)  # the largest is 1 and more, but of a matrix that holds nothing
    scaled = vectors @ np.diag(1.0 / np.maximum(values, floor)) @ vectors.T
    return np.asarray(scaled * np.outer(scale, scale))


@dataclass(frozen=True)
class Estimate:
    """One parameter of a finished fit, SI; numbers are None where there is none to give."""

    name: str
    unit: str
    value: float | None
    standard_error: float | None
    lower: float | None
    upper: float | None
    verdict: str
    reason: str


Interval = tuple[float | None, float | None]  # of theta from a profile; None: open


def estimates(
    unknowns: Unknowns,
    theta: Array,
    base: Array,
    covariance: Array,
    *,
    at_bound: Mapping[str, str],
    hints: Mapping[str, str],
    profiles: Mapping[str, Interval],
) -> list[Estimate]:
    """Values, standard errors, 95 % intervals and verdicts of every parameter.

    Args:
        theta: (n_p,); base (n_p,) of the rig the values are given for; covariance (f, f) of the free ones.
        at_bound: sentence per parameter that sits at a bound.
        hints: per parameter, what test would determine it, used where it is not identified.
        profiles: intervals of theta by name, where profiles were run; else from the covariance, from which all
            standard errors are: times their correlations they have to be one.
    """
    values = unknowns.values(theta, base)
    sds = dict(zip(np.flatnonzero(unknowns.free).tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True))
    size_of, out = sizes(unknowns, values), list[Estimate]()
    for i, declared in enumerate(unknowns.model.parameters):
        value, name = float(values[i]), declared.name
        nothing = Estimate(name, declared.unit, value, None, None, None, "fixed", "not estimated")
        if (sd := sds.get(i)) is None:
            out.append(nothing)
            continue
        if name in at_bound:
            out.append(replace(nothing, verdict="at bound", reason=at_bound[name]))
            continue
        curvature = float(theta[i] - NORMAL * sd), float(theta[i] + NORMAL * sd)
        ends, reached = list(profiles.get(name, curvature)), list[str]()
        for side, (word, bound) in enumerate((("lower", unknowns.lower[i]), ("upper", unknowns.upper[i]))):
            end = ends[side]
            if unknowns.user_bounds[side, i] and (end is None or (end <= bound if side == 0 else end >= bound)):
                ends[side] = float(bound)
                reached.append(word)
        walled = f"its interval ends at the {' and '.join(reached)} bound of the scene" if reached else ""
        low, high = (parameter_value(unknowns, i, end, base[i]) for end in ends)
        verdict = verdict_of(value, low, high, float(size_of[i]), declared.scale == "log")
        if verdict == "not identifiable" or low is None or high is None:
            # An end that says no more than the admissible box is open.
            low = None if low is None or not declared.lower < low < math.inf else low
            high = None if high is None or not -math.inf < high < declared.upper else high
            reason = hints.get(name, "not identifiable from these data")
            out.append(replace(nothing, lower=low, upper=high, verdict="not identifiable", reason=reason))
            continue
        error = sd * (value if declared.scale == "log" else 1.0)
        known = [] if verdict == "identified" else [hints.get(name, "more cycles are needed")]
        share = min(100.0, 100 * sd**2 / float(unknowns.prior_deviation[i]) ** 2)  # 0 without a prior
        if share >= 1.0:
            known.append(f"its prior (or tolerance) carries {share:.0f} % of the information")
        reason = "; ".join(filter(None, (*known, walled)))
        out.append(Estimate(name, declared.unit, value, float(error), low, high, verdict, reason))
    return out


def sizes(unknowns: Unknowns, values: Array) -> Array:
    """What the error of each parameter is judged by (n_p,): its value, and the step of friction for its weakening."""
    mu_s, mu_k0 = (float(values[unknowns.names.index(name)]) for name in ("mu_s", "mu_k0"))
    weakening = np.array([name == "delta_mu_k" for name in unknowns.names])
    return np.where(weakening, abs(mu_s - mu_k0), np.abs(values))


def parameter_value(unknowns: Unknowns, i: int, theta: float | None, base: float) -> float | None:
    """The parameter value at a theta; None for an open end."""
    if theta is None:
        return None
    if not unknowns.logarithmic[i]:
        return float(base + theta)
    return float(base * math.exp(theta)) if theta < 700 else None


def verdict_of(value: float, low: float | None, high: float | None, size: float, logarithmic: bool) -> str:
    """ "identified", "weak" or "not identifiable" by the ends of a 95 % interval (None: open) and the size that the
    error of the value is judged by."""
    if low is None or high is None:
        return "not identifiable"
    widest = max(value - low, high - value)
    if widest <= IDENTIFIED * size:
        return "identified"
    within = high <= WEAK * value and low >= value / WEAK if logarithmic else widest <= (1 - 1 / WEAK) * size
    return "weak" if within else "not identifiable"


# What the usual errors of a rig and its sensors add to intervals that take both as exact.
#
# Every such error is a direction in the space of all parameters, the rig's among them, so that the information at the
# answer already holds what the data say of it: an error of a mass, a stiffness or a damping is that parameter's own
# direction; one of all drive speeds is a change of the unit of length; one of the friction force's gain a change of the
# unit of force with the normal force kept; one of the normal force's gain divides the coefficients; one of the friction
# force's zero shifts both coefficients alike. Each error is estimated along with the parameters, its tolerance as its
# prior: what the data contradict is not believed.

COEFFICIENTS = ("mu_s", "mu_k0", "delta_mu_k", "slope", "direct_strength")  # the friction force is linear in them
LEVELS = ("mu_s", "mu_k0")  # a zero of the friction force is a level of both
LENGTHS = {"m": 1.0, "m/s": 1.0, "s/m": -1.0, "N/m": -1.0}  # powers of a length; an area only makes a pressure
FORCES = ("friction", "normal")
TOLERANCE_WORDS = {name: f"the {name.replace('_', ' ')}" for name in ("mass", "stiffness", "damping", "drive_speed")}
TOLERANCE_WORDS |= {f"{force}_force": f"the gain of the {force} force" for force in FORCES}
TOLERANCE_WORDS |= {f"{force}_zero": f"the zero of the {force} force" for force in FORCES}
TOLERANCE_WORDS |= {"specimen": "the friction of each specimen"}


def added_by_tolerances(known: Information, values: Array, tolerances: Mapping[str, float], memory: float) -> Array:
    """Covariance (f, f) of the free theta that errors of rig and sensors add to that of the fit.

    Args:
        known: at the answer; values (n_p,) of all parameters there [SI].
        tolerances: relative, one standard deviation each, of mass, stiffness, damping (where the fit holds them),
            drive_speed, friction_force and normal_force (the gains of their sensors), and the zeros of both sensors as
            shares of the normal force (friction_zero, normal_zero); what is absent is exact.
        memory: by how much the autocorrelation of the noise widens a variance.
    """
    free, unknowns, parameters = known.free, known.unknowns, known.unknowns.model.parameters
    size = np.where(unknowns.logarithmic, 1.0, values)  # of a relative change
    rig, coefficient = (np.isin(unknowns.names, names) for names in (RIG_PARAMETERS, COEFFICIENTS))
    there, of_force = ~rig | (values > 0.0), np.array(["N" in parameter.unit for parameter in parameters])
    moved_by = {unknowns.names[i]: np.eye(values.size)[i] for i in np.flatnonzero(rig & there & ~unknowns.free)}
    moved_by["drive_speed"] = there * _by_drive_speed(unknowns, values)
    moved_by["friction_force"] = size * there * (coefficient | rig | of_force)
    moved_by["normal_force"] = moved_by["normal_zero"] = -size * coefficient  # of a steady load, a zero is a gain
    moved_by["friction_zero"] = np.isin(unknowns.names, LEVELS).astype(float)
    known_of = {name: direction for name, direction in moved_by.items() if tolerances.get(name)}
    moves = np.column_stack([np.eye(values.size)[:, free], *known_of.values()])
    matrix = moves.T @ (known.data / memory) @ moves
    count = free.size
    matrix[:count, :count] += (known.total - known.data)[np.ix_(free, free)]  # a tap ties mass and stiffness
    matrix[np.arange(count, len(matrix)), np.arange(count, len(matrix))] += [1.0 / tolerances[n] ** 2 for n in known_of]
    return np.asarray(inverse(matrix)[:count, :count] - inverse(matrix[:count, :count]))


def standard_deviations(covariance: Array) -> Array:
    """Roots (f,) of the variances of what errors add; rounding leaves none below 0."""
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _by_drive_speed(unknowns: Unknowns, values: Array) -> Array:
    """How theta (n_p,) moves at values (n_p,) with a relative error of all drive speeds: a change of unit of length."""
    rig = np.array([name in RIG_PARAMETERS for name in unknowns.names])
    lengths = np.array([LENGTHS.get(parameter.unit, 0.0) for parameter in unknowns.model.parameters])
    return np.asarray(np.where(unknowns.logarithmic, 1.0, values) * np.where(rig, -1.0, lengths))
