"""Do the logs agree? What each log says of the shared parameters, held against what all the others say.

At a common answer the pulls of all logs cancel. How far one log may pull follows from its share of the information:
with C the covariance of the answer and S that of what the noise of one log does to it, the pull has the covariance
S - S C^-1 S (the score test; for linear models its squared distance is that between the answer of this log alone and
that of the others). A log that pulls farther has an answer of its own, however well the common one fits: the misfit of
thousands of samples does not see what a few parameters do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.base.quantiles import chi_square_exceeded
from identify.estimation.attempt import Attempt
from identify.estimation.covariance import Information, sizes
from identify.estimation.influence import Influence, influence, sample_moves
from identify.estimation.residual_autocorrelation import Colour, NoiseAutocorrelation, colour, coloured_covariance
from identify.estimation.stick_strength import integrated_moves
from identify.logs.unknowns import Unknowns
from identify.logs.vibration import rhythmic
from identify.prediction.wording import said
from identify.shooting.layout import KNOWN, Layout
from identify.shooting.passes import Solved, solve_in_passes
from identify.shooting.shooting import Problem

Array = NDArray[np.float64]

UNTOLD = 1e-3  # share of the information on a direction: with less, or all but less, nothing can be compared along it
CHANCE = 1e-9  # by which noise alone calls a log contradicting
MATTERS = 0.10  # of its size by which a parameter must move for it: less is a short error bar, and no other answer


@dataclass(frozen=True)
class LogScore:
    """One log against the others: log, its index; squared distance, in units of its covariance, and its degrees of
    freedom; by how much the parameters (f,) move where the log is left out."""

    log: int
    squared: float
    freedom: int
    shift: Array

    @property
    def contradicts(self) -> bool:
        """Whether noise cannot be why it pulls so far."""
        return self.freedom > 0 and self.squared > chi_square_exceeded(CHANCE, self.freedom)


def scores_of(moves: Array, covariances: Array) -> list[LogScore]:
    """How far each source of data pulls the common answer away from that of the others.

    Args:
        moves: (n, f) by how much the noise of each source moved the answer; covariances (n, f, f) of these moves,
            together that of the answer.
    """
    size, half, whitened = _whitened(moves, covariances)
    out = []
    for number, (move, own) in enumerate(zip(whitened, covariances / np.outer(size, size), strict=True)):
        share, directions = np.linalg.eigh(np.linalg.solve(half, np.linalg.solve(half, own).T))
        told = (share > UNTOLD) & (share < 1.0 - UNTOLD)
        along = (directions.T @ move)[told]
        squared = float(np.sum(along**2 / (share[told] * (1.0 - share[told]))))
        shift = size * (half @ (directions[:, told] @ (along / (1.0 - share[told]))))
        out.append(LogScore(number, squared, int(np.count_nonzero(told)), -shift))
    return out


def log_scores(problem: Problem, z: Array, known: Influence, memory: float) -> list[LogScore]:
    """As `scores_of`, of the logs of a solution z (n,) scaled; memory: by how much that of the noise widens a variance.

    Last, behind those of the logs, comes the pull of what the user knows beside them: priors of shared parameters.

    Raises:
        LinAlgError: a covariance that is none.
    """
    moves, covariances = _of_sources(problem, z, known)
    found = scores_of(moves, covariances)
    if problem.layout.varied.size and any(pull.contradicts for pull in found):
        found = scores_of(_integrated(problem, z, known, moves, covariances), covariances)
    return [replace(pull, squared=pull.squared / memory) for pull in found]


def _integrated(problem: Problem, z: Array, known: Influence, moves: Array, covariances: Array) -> Array:
    """The moves (n, f) of the answer with the strengths of single sticks integrated out: at the answer itself a log
    that hardly tells how the contact ages pulls towards the faster ageing, with which its strengths would differ less.
    """
    own = np.zeros_like(moves)
    own[:-1] = integrated_moves(problem, z, known, _owners(problem.layout, len(problem.logs)))
    share = np.linalg.solve(covariances.sum(axis=0), own.sum(axis=0))
    return moves + own - np.einsum("nfg,g->nf", covariances, share)


def imbalance(problem: Problem, z: Array, known: Influence) -> tuple[float, Array]:
    """Where all pulls together move the answer z (n,) scaled: the squared distance, in units of its covariance, and the
    move (f,). Nothing, unless something holds it that is no information, an event that can go no farther say. Errors as
    `log_scores`."""
    moves, covariances = _of_sources(problem, z, known)
    _, _, whitened = _whitened(moves, covariances)
    return float(np.sum(whitened.sum(axis=0) ** 2)), moves.sum(axis=0)


def _whitened(moves: Array, covariances: Array) -> tuple[Array, Array, Array]:
    """Standard errors (f,), the Cholesky factor (f, f) of the correlation, and the moves (n, f) in units of both."""
    covariance = covariances.sum(axis=0)
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    half = np.linalg.cholesky(covariance / np.outer(size, size))
    return size, np.asarray(half), np.asarray(np.linalg.solve(half, (moves / size).T).T)


def _of_sources(problem: Problem, z: Array, known: Influence) -> tuple[Array, Array]:
    """Moves (l + 1, f) of the answer by the noise of each log and, last, by what the user knows beside them; and their
    covariances (l + 1, f, f)."""
    layout, logs = problem.layout, len(problem.logs)
    f = known.kept.size
    moves, covariances = np.zeros((logs + 1, f)), np.zeros((logs + 1, f, f))
    np.add.at(moves, known.log, known.moves)
    np.add.at(covariances, known.log, known.white)
    owner = _owners(layout, logs)
    off, columns = layout.off_prior(z * layout.scale), layout.beside(known.columns)
    for unknown in np.flatnonzero(np.isfinite(layout.prior_sd)).tolist():
        column, sd = columns[unknown], layout.prior_sd[unknown]
        moves[owner[unknown]] -= column * off[unknown] / sd
        covariances[owner[unknown]] += np.outer(column, column) / sd**2
    return moves, covariances


def _owners(layout: Layout, logs: int) -> NDArray[np.int64]:
    """Of which log each unknown (n,) is; -1 (KNOWN) where several share it."""
    owner = np.full((logs, layout.size), False)
    for family in layout.families:
        for log in range(logs):
            slots = family.slots[family.log == log]
            owner[log, slots[slots >= 0]] = True
    return np.where(owner.sum(axis=0) == 1, np.argmax(owner, axis=0), KNOWN)


def contradiction(
    found: Sequence[LogScore],
    unknowns: Unknowns,
    theta: Array,
    base: Array,
    names: Sequence[str],
    without_it: Callable[[int], Array | None] = lambda _log: None,
) -> str:
    """A sentence where a log has an answer of its own that differs from the common one; "" where none does, or where
    what the user knows beside the logs contradicts them: then it is not they that do not agree.

    Args:
        found: pulls of the logs, and last that of what is known beside them.
        theta: (n_p,) of the answer; base (n_p,) of the rig the values are given for; names of the logs.
        without_it: the answer (n_p,) of all logs but one, fitted: a log is blamed only where that differs as well; None
            where it is not known, and the pull alone decides.
    """
    *of_logs, beside = found
    if beside.contradicts:
        return ""
    free = np.flatnonzero(unknowns.free)
    asked = ~rhythmic(unknowns)[free]
    values = unknowns.values(theta, base)
    size = np.maximum(sizes(unknowns, values), 1e-300)
    for pull in sorted((pull for pull in of_logs if pull.contradicts), key=lambda pull: -pull.squared):
        fitted = without_it(pull.log)
        without = theta.copy()
        without[free] += pull.shift[: free.size]
        others = unknowns.values(without if fitted is None else fitted, base)
        moved = np.where(asked, np.abs((others - values) / size)[free], 0.0)
        worst = int(free[np.argmax(moved)])
        if np.max(moved) > MATTERS:
            unit = unknowns.model.parameters[worst].unit
            instead = f"{said(others[worst], unit)} instead of {said(values[worst], unit)}"
            known = "would be about" if fitted is None else "is"
            return (
                f"{names[pull.log]} contradicts the other logs (squared distance {pull.squared:.0f} with "
                f"{pull.freedom} degrees of freedom): without it {unknowns.names[worst]} {known} {instead}; "
                "check its normal force, its drive speed and what else differs in it, look at its slips in the report, "
                "or fit it apart"
            )
    return ""


# ----------------------------------------------------------------------------------------------------------------------
# The covariance at an answer with all that is allowed for: memory and level of the noise, error of the drive speed.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Allowed:
    """Covariances of the free parameters (f,) at an answer.

    white (f, f) without the memory of the noise, joint (f + o, f + o) with it and with the parameters of single logs or
    groups; variance_inflation (f,): by how much the memory and the level of the noise alone widen each variance; noise
    of all logs; reached: how the residuals reached the parameters, where the noise has a memory.
    """

    white: Array
    joint: Array
    variance_inflation: Array
    noise: NoiseAutocorrelation
    reached: Influence | None

    @property
    def covariance(self) -> Array:
        """(f, f)."""
        return self.joint[: len(self.white), : len(self.white)]

    @property
    def colours(self) -> list[Colour]:
        """Of the noise of each log."""
        return list(self.noise.colours)

    @property
    def memory(self) -> Array:
        """By how much what is allowed for widens the variance of each parameter (f,)."""
        return np.asarray(np.diag(self.covariance) / np.diag(self.white))


def allowed(attempt: Attempt, known: Information, speed_tolerance: float) -> Allowed:
    """What is allowed for at an answer; the memory of the noise where the answer is accepted.

    Args:
        speed_tolerance: relative error of all drive speeds together.
    """
    white, by_speed, noise = known.covariance(), known.drive_speed_shift(), noise_of(attempt)
    joint = known.joint_covariance()
    joint[: len(white), : len(white)] = white + speed_tolerance**2 * np.outer(by_speed, by_speed)
    if attempt.gate.status is not Status.CONVERGED or noise.white:
        return Allowed(white, joint, np.ones(len(white)), noise, None)
    reached = influence_at(attempt.solved)
    excess = _excess(attempt, reached, noise)
    variance_inflation = 1.0 + np.diag(excess)[: len(white)] / np.diag(white)
    return Allowed(white, joint + excess, variance_inflation, noise, reached)


def noise_of(attempt: Attempt) -> NoiseAutocorrelation:
    """The noise of all logs of an attempt, coloured like its residuals."""
    logs, fitted = [log.data for log in attempt.fitted_logs], attempt.solved.fitted
    colours = (
        colour(np.where(log.weight > 0, log.force - curve, np.nan)) for log, curve in zip(logs, fitted, strict=True)
    )
    levels = np.broadcast_to(attempt.gate.levels, len(logs)).tolist()
    return NoiseAutocorrelation(tuple(log.weight for log in logs), tuple(colours), tuple(levels))


def largest_inflation(attempt: Attempt, colours: Sequence[Colour]) -> float:
    """By how much the memory and the level of the noise widen the variance of what changes slowly, at most."""
    return max(1.0, attempt.gate.level) * max([1.0, *(colour.memory for colour in colours)])


def influence_at(solved: Solved) -> Influence:
    """How the residuals of every part of the logs reach the parameters at an answer."""
    cycles = [trajectory.parts for trajectory in solved.trajectories]
    return influence(solved.problem, solved.solution.z, cycles, absorbed=False)


def _excess(attempt: Attempt, known: Influence, noise: NoiseAutocorrelation) -> Array:
    """What the memory of the noise adds to the covariance of white noise."""
    problem = attempt.solved.problem
    moves = sample_moves(problem, attempt.solved.solution.z, known.columns)
    variances = [
        level / max(float(np.max(weight)), 1e-300) for weight, level in zip(noise.weights, noise.levels, strict=True)
    ]
    return coloured_covariance(moves, variances, noise.colours) - known.white.sum(axis=0)


# ----------------------------------------------------------------------------------------------------------------------
# An answer is refused where one of its logs contradicts the others.
# ----------------------------------------------------------------------------------------------------------------------


def agreeing(attempt: Attempt, unknowns: Unknowns, base: Array, seen: Allowed) -> Attempt:
    """The answer, refused where one of its logs contradicts the others.

    Args:
        base: (n_p,) of the rig the values are given for; seen: what is allowed for at the answer.
    """
    solved, names = attempt.solved, [log.name for log in attempt.fitted_logs]
    slow = largest_inflation(attempt, seen.colours)
    try:
        found = log_scores(solved.problem, solved.solution.z, seen.reached or influence_at(solved), slow)
    except np.linalg.LinAlgError:  # directions that no log tells: their verdicts say so
        return attempt
    message = contradiction(
        found, unknowns, solved.theta, base, names, lambda log: _without_log(attempt, unknowns, log)
    )
    if not message:
        return attempt
    return replace(attempt, gate=replace(attempt.gate, status=Status.MODEL_MISFIT, message=message))


def _without_log(attempt: Attempt, unknowns: Unknowns, log: int) -> Array | None:
    """The answer (n_p,) of all logs but one, from the common one; None where the solver does not settle, or logs have
    parameters of their own, which the first of them lends its place in theta."""
    if np.any(unknowns.own):
        return None
    rest = [i for i in range(len(attempt.log_numbers)) if i != log]
    at_answer = replace(unknowns, start=attempt.solved.theta).with_weak_priors()
    data, motion = [attempt.fitted_logs[i].data for i in rest], [attempt.solved.trajectories[i] for i in rest]
    solved = solve_in_passes(data, motion, at_answer)
    return solved.theta if solved.solution.success else None
