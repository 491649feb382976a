"""What noise does to the answer: sample by sample to first order, from which follow a covariance that allows for
autocorrelation and whether the logs agree; and by fits repeated on drawn logs.

With U the columns of the inverse of the optimality matrix that belong to the parameters, a residual r with weight w and
slope x of its curve moves them by U^T x w r. At a common answer the pulls of all logs cancel. With C the covariance of
the answer and S that of what the noise of one log does to it, the pull of that log has the covariance S - S C^-1 S (the
score test; for linear models its squared distance is that between the answer of this log alone and that of the others).
A log that pulls farther has an answer of its own, however well the common one fits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.linear import Factors, optimality_matrix
from identify.base.progress import Progress, to_nobody
from identify.base.quantiles import LEVEL, chi_square_exceeded
from identify.estimation.attempt import Attempt
from identify.estimation.covariance import Information, sizes
from identify.estimation.profile import MOVED, converged
from identify.estimation.residual_autocorrelation import WHITE, ArModel, autocorrelated_covariance
from identify.logs.unknowns import Unknowns
from identify.logs.vibration import rhythmic
from identify.prediction.wording import shown
from identify.shooting.layout import kept_parameters
from identify.shooting.passes import Solved, solve_in_passes
from identify.shooting.shooting import Problem, samples_of

Array = NDArray[np.float64]

UNINFORMATIVE = 1e-3  # share of the information on a direction: with less, or all but less, nothing can be compared


@dataclass(frozen=True)
class Influence:
    """How the data reach the k parameters at a solution, in physical units: shared ones first, then those of single
    logs.

    by_sample: per log (n, k) what 1 N more at each sample moves them by, 0 outside the windows; moves (l + 1, k) what
    the residuals of each log did, and last what the user knows beside the logs; covariances (l + 1, k, k) of these
    moves for white noise.
    """

    by_sample: list[Array]
    moves: Array
    covariances: Array


def influence(solved: Solved) -> Influence:
    """The influence of the data on the parameters at a solution.

    Raises:
        RuntimeError: its optimality conditions are singular.
    """
    problem, z = solved.problem, solved.solution.z
    layout, point = problem.layout, problem.evaluate(z, derivatives=True)
    kept = kept_parameters(layout)
    right = np.zeros((layout.size + layout.rows, kept.size))
    right[kept, np.arange(kept.size)] = layout.scale[kept]
    columns = Factors(optimality_matrix(point.hessian, point.jacobian)).solve(right)[: layout.size]
    columns = layout.scale[:, None] * columns
    by_sample, count = sample_moves(problem, z, columns), len(problem.logs)
    moves, covariances = np.zeros((count + 1, kept.size)), np.zeros((count + 1, kept.size, kept.size))
    for number, (log, curve, move) in enumerate(zip(problem.logs, solved.fitted, by_sample, strict=True)):
        used = (log.weight > 0.0) & np.isfinite(curve)
        moves[number] = move[used].T @ (log.force - curve)[used]
        covariances[number] = (move[used].T / log.weight[used]) @ move[used]
    of_log = np.zeros((count, layout.size), bool)
    for family in layout.families:
        for number in range(count):
            slots = family.slots[family.log == number]
            of_log[number, slots[slots >= 0]] = True
    owner = np.where(of_log.sum(axis=0) == 1, np.argmax(of_log, axis=0), -1)  # -1: several logs share it
    off, beside = layout.off_prior(z * layout.scale), layout.beside(columns)
    for unknown in np.flatnonzero(np.isfinite(layout.prior_sd)).tolist():
        column, sd = beside[unknown], layout.prior_sd[unknown]
        moves[owner[unknown]] -= column * off[unknown] / sd
        covariances[owner[unknown]] += np.outer(column, column) / sd**2
    return Influence(by_sample, moves, covariances)


def sample_moves(problem: Problem, z: Array, columns: Array) -> list[Array]:
    """Per log, by how much a force higher by 1 N at each sample moves the parameters (n, k); 0 outside the windows.

    Args:
        columns: (n, k) of the inverse of the optimality matrix, in physical units.
    """
    x = z * problem.layout.scale
    out = [np.zeros((log.time.size, columns.shape[1])) for log in problem.logs]
    for family in problem.layout.families:
        _, _, _, d_curve = family.block.evaluate(family.slot_values(x), family.constants, derivatives=True)
        along = np.where((family.slots >= 0)[..., None], columns[family.slots], 0.0)
        count, cells, order, n_slots = d_curve.shape
        slope = np.matmul(d_curve.reshape(count, cells * order, n_slots), along).reshape(count * cells, order, -1)
        for held in samples_of(family, problem.logs):
            weight = problem.logs[held.log].weight[held.samples]
            out[held.log][held.samples] = weight[:, None] * held.of_curve(slope)
    return out


@dataclass(frozen=True)
class Allowed:
    """Covariances of the free parameters (f,) at an answer: white (f, f) for white noise, joint (f + o, f + o) with all
    that is allowed for and with the parameters of single logs or groups."""

    white: Array
    joint: Array

    @property
    def covariance(self) -> Array:
        """(f, f)."""
        return self.joint[: len(self.white), : len(self.white)]

    @property
    def inflation(self) -> Array:
        """By how much what is allowed for widens the variance of each parameter (f,)."""
        return np.asarray(np.diag(self.covariance) / np.diag(self.white))


def allowed(attempt: Attempt, known: Information, speed_error: float, values: Array) -> Allowed:
    """What is allowed for at an answer; the autocorrelation of the noise where the answer is accepted.

    Args:
        speed_error: relative, of all drive speeds together; values (n_p,) of all parameters there [SI].
    """
    white, by_speed, noise = known.covariance(), known.drive_speed_shift(values), attempt.noise
    joint, f = known.joint_covariance(), len(white)
    joint[:f, :f] = white + speed_error**2 * np.outer(by_speed, by_speed)
    if attempt.fits and not all(model.white for model in noise):
        reached = influence(attempt.solved)
        variances = np.array([1.0 / max(float(np.max(log.data.weight)), 1e-300) for log in attempt.fitted_logs])
        joint += autocorrelated_covariance(reached.by_sample, variances * attempt.gate.levels, noise)
        joint -= autocorrelated_covariance(reached.by_sample, variances, [WHITE] * len(noise))
    return Allowed(white, joint)


@dataclass(frozen=True)
class LogScore:
    """One log against the others: log, its index; squared distance, in units of its covariance, and its degrees of
    freedom; by how much the parameters (k,) move where the log is left out."""

    log: int
    squared: float
    freedom: int
    shift: Array

    @property
    def contradicts(self) -> bool:
        """Whether noise cannot be why it pulls so far."""
        return self.freedom > 0 and self.squared > chi_square_exceeded(1e-9, self.freedom)


def scores_of(moves: Array, covariances: Array) -> list[LogScore]:
    """How far each source of data pulls the common answer away from that of the others.

    Args:
        moves: (n, k) by how much the noise of each source moved the answer; covariances (n, k, k) of these moves,
            together that of the answer.

    Raises:
        LinAlgError: a covariance that is none.
    """
    size = np.sqrt(np.maximum(np.diag(covariances.sum(axis=0)), 1e-300))
    half, out = np.linalg.cholesky(covariances.sum(axis=0) / np.outer(size, size)), []
    whitened = np.linalg.solve(half, (moves / size).T).T
    for number, (move, own) in enumerate(zip(whitened, covariances / np.outer(size, size), strict=True)):
        share, directions = np.linalg.eigh(np.linalg.solve(half, np.linalg.solve(half, own).T))
        compared = (share > UNINFORMATIVE) & (share < 1.0 - UNINFORMATIVE)
        along, rest = (directions.T @ move)[compared], 1.0 - share[compared]
        shift = size * (half @ (directions[:, compared] @ (along / rest)))
        squared = float(np.sum(along**2 / (share[compared] * rest)))
        out.append(LogScore(number, squared, int(np.count_nonzero(compared)), -shift))
    return out


def contradiction(attempt: Attempt, unknowns: Unknowns, base: Array) -> str:
    """A sentence where a log has an answer of its own that differs from the common one, by its score and where the fit
    without it is another one too; "" where none does, or where what the user knows beside the logs contradicts them:
    then it is not they that do not agree.

    Args:
        base: (n_p,) of the rig the values are given for.
    """
    try:
        known = influence(attempt.solved)
        scores = scores_of(known.moves, known.covariances)
    except (np.linalg.LinAlgError, RuntimeError):  # directions that no log determines: their verdicts say so
        return ""
    *of_logs, beside = [replace(score, squared=score.squared / attempt.inflation) for score in scores]
    free, theta = np.flatnonzero(unknowns.free), attempt.solved.theta
    values, compared = unknowns.values(theta, base), ~rhythmic(unknowns)[free]
    size = np.maximum(sizes(unknowns, values), 1e-300)
    at_answer = replace(unknowns, start=theta).with_weak_priors()
    against = [score for score in of_logs if score.contradicts and not beside.contradicts]
    for score in sorted(against, key=lambda each: -each.squared):
        rest = [i for i in range(len(attempt.log_numbers)) if i != score.log]
        data, motion = [attempt.fitted_logs[i].data for i in rest], [attempt.solved.trajectories[i] for i in rest]
        # What logs have for themselves lends its place in theta to the first of them.
        again = None if np.any(unknowns.own) else solve_in_passes(data, motion, at_answer)
        without = theta.copy()
        without[free] += score.shift[: free.size]
        others = unknowns.values(again.theta if again is not None and again.solution.success else without, base)
        moved = np.where(compared, np.abs((others - values) / size)[free], 0.0)
        worst = int(free[np.argmax(moved)])
        # What moves by less has a short error bar, and is no other answer.
        if np.max(moved) > 0.10:
            unit = unknowns.model.parameters[worst].unit
            return (
                f"{attempt.names[score.log]} contradicts the other logs (squared distance {score.squared:.0f} with "
                f"{score.freedom} degrees of freedom): without it {unknowns.names[worst]} is "
                f"{shown(others[worst], unit)} instead of {shown(values[worst], unit)}; check its load, its drive "
                "speed and what else differs in it, look at its slips in the report, or fit it apart"
            )
    return ""


# Parametric bootstrap: the fit repeated on logs drawn from its answer.
#
# A replicate is the fitted curve with new noise of the variance and autocorrelation of the residuals, and priors about
# means that are drawn as wide as they are; it is solved again from the answer (Efron and Tibshirani, An Introduction to
# the Bootstrap, 1993, section 6.5). Intervals are percentiles of the replicates.

FEWEST = 40  # replicates from which on an interval is given


@dataclass(frozen=True)
class Bootstrap:
    """Replicates (r, f) of the free theta, which of those that were asked for settled, and intervals (f, 2): NaN with
    too few."""

    replicates: Array
    settled: NDArray[np.bool_]
    interval: Array


def bootstrap(
    attempt: Attempt,
    unknowns: Unknowns,
    sizes: Array,
    count: int,
    *,
    seed: int = 0,
    progress: Progress = to_nobody,
) -> Bootstrap:
    """Replicates of an answer, and intervals from them.

    Args:
        sizes: (f,) standard errors of the free theta; count: of replicates.
    """
    solved, random = attempt.solved, np.random.default_rng(seed)
    layout, free = solved.problem.layout, unknowns.free
    noise = attempt.noise
    levels = np.broadcast_to(attempt.gate.levels, len(noise)).tolist()
    weak = replace(unknowns, start=solved.theta).with_weak_priors()
    thetas, settled = list[Array](), np.zeros(count, bool)
    for number in range(count):
        progress("bootstrap", None)
        logs = []
        for log, curve, model, level in zip(solved.problem.logs, solved.fitted, noise, levels, strict=True):
            drawn = np.sqrt(level) * log.noise * drawn_noise(model, log.time.size, random)
            logs.append(replace(log, force=np.where(np.isfinite(curve), curve + drawn, log.force)))
        off = np.where(np.isfinite(layout.prior_sd), layout.prior_sd, 0.0) * random.standard_normal(layout.size)
        problem = Problem(logs, replace(layout, prior_mean=layout.prior_mean + off), pattern=solved.problem.pattern)
        again = converged(solved, problem, sizes, MOVED)
        if again is None:  # its events left their samples
            again = solve_in_passes(logs, solved.trajectories, weak)
        settled[number] = again.solution.success
        if settled[number]:
            thetas.append(again.theta[free])
    replicates, interval = np.array(thetas).reshape(-1, sizes.size), np.full((sizes.size, 2), np.nan)
    if len(replicates) >= FEWEST:
        tails = [0.5 - LEVEL / 2, 0.5 + LEVEL / 2]
        interval = np.quantile(replicates, tails, axis=0, method="weibull").T
    return Bootstrap(replicates, settled, interval)


def drawn_noise(model: ArModel, count: int, random: np.random.Generator) -> Array:
    """Noise (n,) of variance 1 with this autoregression."""
    if model.white:
        return random.standard_normal(count)
    from scipy.signal import lfilter  # which takes a third of a second to load

    settling = 1000  # samples after which an autoregression has forgotten where it began
    new = np.sqrt(model.innovation) * random.standard_normal(count + settling)
    return np.asarray(lfilter([1.0], np.concatenate([[1.0], -model.regression]), new)[settling:])
