"""One start, placed on the logs and solved, and an answer solved again; the gate says what came of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from identify.base.budget import stage, time_is_up
from identify.base.result import Status
from identify.estimation.goodness_of_fit import Gate, pass_gate
from identify.estimation.residual_autocorrelation import ArModel, noise_model
from identify.logs.prepare import Prepared, beginning, cut_in_last_stick
from identify.logs.unknowns import Unknowns
from identify.shooting.layout import COARSE_GRID
from identify.shooting.passes import Solved, solve_in_passes
from identify.shooting.placing import follow, glide, place
from identify.shooting.shooting_trajectory import ShootingTrajectory, turned_back

PlacedLog = tuple[int, Prepared, ShootingTrajectory]  # number of a log, the log as it is cut, the motion placed on it

OBEYS = 1e-7  # largest row of a motion that obeys the model: its misfit counts, though the solver stalled
BETTER = 2.0  # squares in noise variances by which another motion must fit better to be taken
HORIZONS = (0.125, 0.25, 0.5, 1.0)  # shares of a programme before it slides steadily, each solved from the one before


@dataclass(frozen=True)
class Attempt:
    """A solved start: the numbers of the logs that took part (from 0), and these logs as far as they were followed; the
    solution and its gate."""

    log_numbers: tuple[int, ...]
    fitted_logs: tuple[Prepared, ...]
    solved: Solved
    gate: Gate

    @property
    def fits(self) -> bool:
        """Whether it passed the goodness-of-fit tests."""
        return self.gate.status is Status.CONVERGED

    @property
    def names(self) -> list[str]:
        """Of its logs."""
        return [log.name for log in self.fitted_logs]

    @property
    def excess(self) -> float:
        """Sum of squares in noise variances less the number of samples; infinite where the motion is none of the
        model."""
        solution = self.solved.solution
        obeys = solution.success or solution.constraint_violation < OBEYS
        return 2.0 * solution.cost - self.solved.problem.samples if obeys else np.inf

    @cached_property
    def noise(self) -> list[ArModel]:
        """The model of the residuals of each log."""
        pairs = zip(self.solved.problem.logs, self.solved.fitted, strict=True)
        return [noise_model(np.where(log.weight > 0, log.force - curve, np.nan)) for log, curve in pairs]

    @property
    def inflation(self) -> float:
        """By how much autocorrelation and level of the noise widen the variance of what changes slowly, at most."""
        return max(1.0, self.gate.level) * max([1.0, *(model.inflation for model in self.noise)])

    def with_solved(self, solved: Solved) -> Attempt:
        """The same logs with another solution, and the tests of that."""
        gate = pass_gate(solved, self.names, [log.noise_estimated for log in self.fitted_logs])
        return replace(self, solved=solved, gate=gate)


def usable(prepared: Sequence[Prepared]) -> list[int]:
    """Numbers of the logs that are not left out."""
    return [i for i, log in enumerate(prepared) if log.left_out is None]


# Solving: from a start, from the motion simulated at the answer, and by way of the beginnings of a programme.


def solve_from(
    prepared: list[Prepared], chosen: list[int], unknowns: Unknowns, cost_cutoff: float = np.inf
) -> Attempt | None:
    """Place the start on the chosen logs and solve, programmes that are not met by way of their beginnings; None where
    no log can be placed.

    Args:
        cost_cutoff: a pass that ends with a larger cost is the last one.
    """
    with stage("place"):
        placed = place_on(prepared, chosen, unknowns)
    if not placed:
        return None
    attempt = _simulated_and_solved(prepared, placed, unknowns, cost_cutoff)
    programmes = any(log.fit_mode.name == "continuous" for log in attempt.fitted_logs)
    if attempt.fits or attempt.solved.solution.cost > cost_cutoff or not programmes:
        return attempt
    extended = _by_horizons(prepared, attempt.log_numbers, unknowns)
    return extended if extended is not None and _is_better(extended, attempt) else attempt


def solve_placed(placed: list[PlacedLog], unknowns: Unknowns, cost_cutoff: float = np.inf) -> Attempt:
    """Solve from a start that is placed on some logs, one at least."""
    numbers, logs, trajectories = (list(column) for column in zip(*placed, strict=True))
    # What every log has for itself, the first log has in the shared theta.
    unknowns = replace(unknowns, start=trajectories[0].theta(unknowns.start))
    trajectories[0] = replace(trajectories[0], own=np.empty(0))
    with stage("solve"):
        data, weak = [log.data for log in logs], unknowns.with_weak_priors()
        solved = solve_in_passes(data, trajectories, weak, cost_cutoff=cost_cutoff)
        gate = pass_gate(solved, [log.name for log in logs], [log.noise_estimated for log in logs])
    return Attempt(tuple(numbers), tuple(logs), solved, gate)


def solve_again(attempt: Attempt, unknowns: Unknowns, *, steps: int = 0) -> Attempt:
    """Solve the logs of an attempt again from another theta (unknowns.start) and the motion found before, with at least
    so many steps per interval."""
    data, weak = [log.data for log in attempt.fitted_logs], unknowns.with_weak_priors()
    return attempt.with_solved(solve_in_passes(data, attempt.solved.trajectories, weak, steps=steps))


def _simulated_and_solved(
    prepared: list[Prepared], placed: list[PlacedLog], unknowns: Unknowns, cost_cutoff: float = np.inf
) -> Attempt:
    """Solve from a start, and from the motion simulated at the answer where its sequence of phases is another one; the
    one that fits better is kept."""
    attempt = solve_placed(placed, unknowns, cost_cutoff)
    for _ in range(2):
        solved = attempt.solved
        if solved.solution.cost > cost_cutoff or not np.all(np.isfinite(solved.theta)) or time_is_up():
            break
        at_answer = replace(unknowns, start=solved.theta)
        simulated = _simulated(prepared, attempt, at_answer)
        other = None if simulated is None else solve_placed(simulated, at_answer, cost_cutoff)
        if other is None or not _is_better(other, attempt):
            break
        attempt = other
    return attempt


def _is_better(other: Attempt, attempt: Attempt) -> bool:
    """Whether another motion is the one to take: of two the one that fits, else the one that fits clearly better."""
    return other.fits if other.fits != attempt.fits else other.excess < attempt.excess - BETTER


def _by_horizons(prepared: list[Prepared], numbers: Sequence[int], unknowns: Unknowns) -> Attempt | None:
    """Solve with short beginnings of the programmes, then with longer ones, each from the answer before; None where a
    beginning is not met. Parameters that are off make another sequence of sticks and slips in the long run, which no
    solve leaves again; over a few of them it is that of the data."""
    attempt: Attempt | None = None
    for share in HORIZONS:
        logs = [beginning(log, share) if log.fit_mode.name == "continuous" else log for log in prepared]
        placed = place_on(logs, list(numbers), unknowns)
        if len(placed) < len(numbers) or time_is_up():
            return None
        attempt = _simulated_and_solved(logs, placed, unknowns)
        if not abs(attempt.gate.chi2_per_sample - 1.0) < 0.2:  # it is not met
            return None
        unknowns = replace(unknowns, start=attempt.solved.theta)
    return attempt


def _simulated(prepared: list[Prepared], attempt: Attempt, unknowns: Unknowns) -> list[PlacedLog] | None:
    """The motion simulated at the answer (unknowns.start): of logs that are followed, and of those with cycles where
    these do not fit; None where every sequence of phases is that of the answer."""
    out, changed = list[PlacedLog](), False
    motions = zip(attempt.log_numbers, attempt.fitted_logs, attempt.solved.trajectories, strict=True)
    for number, log, trajectory in motions:
        out.append((number, log, trajectory))
        if log.fit_mode.name == "sliding" or (log.fit_mode.name == "cycles" and attempt.fits):
            continue
        whole = replace(prepared[number], fit_mode=log.fit_mode)
        at_answer = replace(unknowns, start=trajectory.theta(unknowns.start))
        # A motion that turns back is none of the model.
        backwards = any(bool(np.any(back)) for back in turned_back(trajectory))
        for form in (whole, whole.as_continuous):  # slip by slip as they were seen, and as the model has them
            placed = place_on([form], [0], at_answer)
            modes = [[mode[:2] for mode in motion.modes] for motion in (trajectory, *(one[2] for one in placed))]
            if placed and (backwards or modes[0] != modes[1]):
                moved, changed = placed[0][2], True
                # Loads and strengths of the answer, where it has the same parts (a rest alone has none).
                counts = [(motion.deviation.size, motion.slip_parts.size) for motion in (moved, trajectory)]
                same = ("deviation", "slip_deviation", "strength") if counts[0] == counts[1] else ()
                kept = {name: getattr(trajectory, name) for name in ("own", *same)}
                out[-1] = number, placed[0][1], replace(moved, **kept)
                break
    return out if changed else None


# Placing a start on the data.


def place_on(prepared: list[Prepared], chosen: list[int], unknowns: Unknowns) -> list[PlacedLog]:
    """Number, cut log and trajectory of every chosen log that the start can be placed on."""
    out: list[PlacedLog] = []
    cycling = [i for i in chosen if prepared[i].fit_mode.name == "cycles"]
    data = [prepared[i].data for i in cycling]
    p = [unknowns.values(log.theta(unknowns.start), log.base) for log in data]
    motions = place(unknowns.model, data, p, [prepared[i].slip_times for i in cycling], COARSE_GRID)
    placed = dict(zip(cycling, motions, strict=True))
    for number in sorted(chosen):
        log, trajectory = prepared[number], placed.get(number)
        if number in placed and trajectory is None:
            continue
        if trajectory is not None:
            ends = np.append(trajectory.onset[1:], log.data.end)
            if trajectory.onset[0] > log.data.begin and np.all(ends > trajectory.arrest):
                # Cut in the stick behind its last placed slip: what comes then is on no data yet.
                sticks = trajectory.onset - np.concatenate([[log.data.begin], trajectory.arrest[:-1]])
                typical = float(np.median(sticks[1:])) if sticks.size > 1 else float(sticks[0])
                cut = cut_in_last_stick(log, float(trajectory.arrest[-1]), typical)
                out.append((number, cut, trajectory))
                continue
            log = log.as_continuous  # rests are shorter than slips are placed exactly
        # Of a programme, or of sliding: cut to what the start follows of it.
        at = unknowns.values(log.data.theta(unknowns.start), log.data.base)
        if log.fit_mode.name == "sliding":
            found = glide(unknowns.model, log.data, at)
        else:
            found = follow(unknowns.model, log.data, at, begins_sliding=log.fit_mode.begins_sliding)
        if found is not None:
            cut = replace(log, data=replace(log.data, end=min(found[1], log.data.end)))
            out.append((number, cut, found[0]))
    return out
