"""Does an answer count: the goodness-of-fit tests of a solution, and the gate over all of them.

First, where the residuals of neighbouring samples lean to one side; then swings that a sliding answer leaves; then the
inequalities of its mode sequence; last the gate.

A wrong answer can keep the sum of squares of a long cycle within its noise and still miss a slip altogether, by a few
standard deviations of many neighbouring samples. Sums over windows of all lengths show that: noise cancels in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from data_io.arrays import thinned
from identify.base.outcome import Status
from identify.base.quantiles import normal
from identify.base.wording import START_VALUES
from identify.estimation.residual_autocorrelation import CLOSE, MORE, autocorrelation_test
from identify.estimation.strained import odd_stick, scatter_words, strained_load
from identify.logs.log_data import LogData
from identify.logs.spectrum import Swing, hidden_rhythm
from identify.logs.unknowns import Unknowns
from identify.logs.zigzag import running_means
from identify.model.model import SPEED
from identify.shooting.onsets import turned_back
from identify.shooting.passes import SETTLED, Solved
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

LONGEST = 512  # samples of a window
CHANCE = 1e-7  # that noise leans so far somewhere in a log
QUARTILE = normal(0.75)
ENOUGH = 1 << 12  # sums that tell their spread: to 3 %
OVERLAP = 8  # windows of one length that share a sample; about the one that leans most all are asked


@dataclass(frozen=True)
class Lean:
    """The window of a log that leans most: its mean time [s] and length [s], the mean residual [N], by how many
    standard deviations, and the number of them that noise reaches by chance."""

    log: int
    time: float
    length: float
    residual: float
    deviations: float
    limit: float

    @property
    def share(self) -> float:
        """Deviations over the limit."""
        return self.deviations / self.limit


def most_leaning(logs: Sequence[LogData], fitted: Sequence[Array]) -> Lean | None:
    """The window of all logs that stands out most; None where nothing is fitted.

    The spread of the sums themselves counts as noise where it is larger than white noise allows: noise with a memory
    does not lean.

    Args:
        fitted: (n,) force at the samples of each log [N], NaN where none is fitted.
    """
    found = [lean for i, (log, curve) in enumerate(zip(logs, fitted, strict=True)) for lean in _of_log(i, log, curve)]
    return max(found, key=lambda lean: lean.share, default=None)


def _of_log(number: int, log: LogData, fitted: Array) -> list[Lean]:
    """The most leaning window of each length."""
    good = (log.weight > 0) & np.isfinite(fitted)
    first, stop = int(np.argmax(good)), good.size - int(np.argmax(good[::-1]))
    told = slice(first, stop) if good[first:stop].all() else good  # a slice copies nothing
    time, residual = log.time[told], log.force[told] - fitted[told]
    weight = log.weight[told]
    even = residual.size and weight.min() == weight.max()  # as a rule: a million roots take their time
    scaled = residual * np.sqrt(weight[0] if even else weight)
    lengths = [2**i for i in range(1, int(np.log2(LONGEST)) + 1) if 8 * 2**i <= residual.size]
    out, sums, step = [], scaled, 1
    for width in lengths:
        half = width // 2 // step
        sums = sums[:-half] + sums[half:]
        if width > OVERLAP * step:
            sums, step = sums[::2], 2 * step
        few = thinned(sums, ENOUGH)
        quarter = few.size // 4
        ordered = np.partition(few, (quarter, few.size - 1 - quarter))
        span = float(ordered[few.size - 1 - quarter] - ordered[quarter])  # np.quantile takes four times as long
        spread = max(1.0, 0.5 * span / np.sqrt(width) / QUARTILE)
        ends = (int(np.argmin(sums)), int(np.argmax(sums)))
        about = step * max(ends, key=lambda end: abs(float(sums[end])))
        begin = max(about - step + 1, 0)
        around = np.abs(running_means(scaled[begin : about + step - 1 + width], width)) * np.sqrt(width)
        first = begin + int(np.argmax(around))
        limit = -normal(0.5 * CHANCE / (residual.size * len(lengths)))
        window = slice(first, first + width)
        length = float(time[first + width - 1] - time[first])
        mean = float(np.mean(residual[window]))
        out.append(Lean(number, float(np.mean(time[window])), length, mean, float(np.max(around)) / spread, limit))
    return out


# ----------------------------------------------------------------------------------------------------------------------
# Whether what an answer leaves of a log, in which it slides to the end, still swings as stick-slip does.
#
# Slips of a few samples, or smaller than the noise of one, count as noise while the noise is measured: an answer that
# slides there fits, and takes the mean force of stick-slip for that of sliding.
# ----------------------------------------------------------------------------------------------------------------------

HELD = 0.05  # share of the power of what is left: a line that is so clear by chance is no matter of its height


def swing_left(
    logs: Sequence[LogData],
    trajectories: Sequence[ShootingTrajectory],
    unknowns: Unknowns,
    theta: Array,
    fitted: Sequence[Array],
) -> tuple[int, Swing] | None:
    """The first log whose last slide leaves a swing, with that; None where there is none.

    Args:
        theta: (n_p,) the solution; fitted: (n,) force at the samples of each log [N], NaN where none is fitted.
    """
    if unknowns.model.vibrates:
        return None
    for number, (log, trajectory, curve) in enumerate(zip(logs, trajectories, fitted, strict=True)):
        if trajectory.rests_at_end:
            continue
        values = dict(zip(unknowns.names, unknowns.values(trajectory.theta(theta), log.base).tolist(), strict=True))
        if not values.get("mass", 0.0) > 0.0:
            continue
        rested = (s.until for s in trajectory.stretches if s.kind == "rest" or s.ended_by == "arrest")
        since = max(rested, default=log.begin)
        rows = slice(*np.searchsorted(log.time, [since, log.end]))
        left = np.where(log.weight[rows] > 0.0, log.force[rows] - curve[rows], np.nan)
        found = hidden_rhythm(
            log.time[rows],
            left,
            None,  # what the load does the answer follows
            stiffness=values["stiffness"],
            drive_speed=log.speed_at(log.end),
            half_period=float(np.pi * np.sqrt(values["mass"] / values["stiffness"])),
            least=HELD,
        )
        if found is not None:
            return number, found
    return None


# ----------------------------------------------------------------------------------------------------------------------
# Does the motion of a solution obey the inequalities that its mode sequence takes for granted?
#
# The rows of the shooting problem hold what is equal: continuity, guards. What must be greater or smaller is checked
# here: a mass that arrests stays at rest (nothing pulls it on or back), and slips go forward.
# ----------------------------------------------------------------------------------------------------------------------

MARGIN = 0.5  # standard deviations of the force noise: closer to being pulled back, the answer may hide that it is


def inconsistency(
    logs: Sequence[LogData],
    trajectories: Sequence[ShootingTrajectory],
    unknowns: Unknowns,
    theta: Array,
    names: Sequence[str],
) -> str | None:
    """The first cycle whose motion breaks an inequality, in words with what to do; None where there is none.

    Args:
        theta: (n_p,) the solution; names: of the logs.
    """
    for log, trajectory, name in zip(logs, trajectories, names, strict=True):
        p = unknowns.values(trajectory.theta(theta), log.base)
        pulled, back, part = _at_arrests(log, trajectory, unknowns, p)
        noise = log.noise
        for excess, what, allowed in ((back, "back", -MARGIN * noise), (pulled, "on", MARGIN * noise)):
            worst = int(np.argmax(excess)) if excess.size else 0
            if excess.size and excess[worst] > allowed:
                return (
                    f"{name}, cycle {part[worst] + 1}: at this answer the mass is pulled {what} as soon as it stops, "
                    f"or all but ({excess[worst]:+.2g} N against what the contact holds, noise {noise:.2g} N), a "
                    "motion that the fit does not follow; leave this log out, or measure with more damping or less "
                    "normal force"
                )
        cycle = _goes_back(trajectory)
        if cycle is not None:
            return (
                f"{name}, cycle {cycle + 1}: at this answer the slip runs backwards on its way, which the fit does not "
                "follow; exclude that stretch"
            )
    return None


def _at_arrests(
    log: LogData, trajectory: ShootingTrajectory, unknowns: Unknowns, p: Array
) -> tuple[Array, Array, NDArray[np.int64]]:
    """By how much the pull exceeds what the contact holds at every arrest (c,) [N], forward and back; the number of the
    part of the record that each ends."""
    model, arrests = unknowns.model, trajectory.ending("arrest")
    part = np.array(trajectory.part, dtype=np.int64)[arrests]
    if arrests.size == 0:
        return np.empty(0), np.empty(0), part
    ends, times = trajectory.at_end(arrests), trajectory.until[arrests]
    ends[:, SPEED] = 0.0
    load = np.asarray(log.normal_force.at(times)) + trajectory.sliding_deviation[part]
    drive = np.array([log.speed_at(t) for t in times.tolist()])
    u = np.column_stack([drive, load, np.ones(times.size), times])
    arguments = [ends.T, np.repeat(p[:, None], times.size, axis=1), u.T]
    pull = np.array(model.driving_force(*arguments)).ravel()
    grip = np.array(model.grip(*arguments)).ravel()
    return pull - grip, -pull - grip, part


def _goes_back(trajectory: ShootingTrajectory) -> int | None:
    """The first part with a slip on whose way the mass moves backwards."""
    return next((part for part, back in zip(trajectory.part, turned_back(trajectory), strict=True) if back.any()), None)


# ----------------------------------------------------------------------------------------------------------------------
# The gate: an answer counts only if the solver succeeded, the misfit is noise, in every cycle, and events rest.
#
# Every test is needed; each alone lets some wrong answer through.
# ----------------------------------------------------------------------------------------------------------------------

OVERALL = 5.0  # standard deviations of chi^2 over all samples
PER_CYCLE = 6.0  # standard deviations of chi^2 of one cycle
NOISE_ERROR = 0.015  # relative error of an estimated noise level
QUIETEST = 0.7  # of the variance measured in the sticks: less is no error of measuring noise
NOISELESS = 1e-5  # of the force, by which the curve misses a log without noise: no sensor is as good
JUMP = 30.0  # z of a cycle above which an event is more likely missing than the law wrong,
ALONE = 20.0  # if the others are this many times better,
SPOILED = 2  # but those next to it on each side: a slip that is missed bends them too
SAME_SLIPS = 0.25  # of a drop: a curve off by less has as many slips as the data; one drawn straight leaves half
OTHERWISE = "perhaps friction follows another law than the effects say or differs from cycle to cycle"


@dataclass(frozen=True)
class Gate:
    """What the gate found. chi2 per sample; z (c,) per cycle with log and cycle numbers (from 1); the status,
    and a sentence that says what failed, where, and what to do; possible_causes: what a misfit may come of, to go
    behind that sentence once the search came to its end without another cause; levels (logs,) of noise with a memory:
    its variance over that measured in the sticks, 1 for white noise."""

    chi2_per_sample: float
    z: Array
    log: NDArray[np.int64]
    cycle: NDArray[np.int64]
    solver: str
    event_shift: float
    status: Status
    message: str
    possible_causes: str = ""
    levels: Array = field(default_factory=lambda: np.ones(1))

    @property
    def level(self) -> float:
        """The variance of the noise over that measured in the sticks, of the log where it is largest."""
        return float(np.max(self.levels))

    @property
    def worst(self) -> int:
        """Index of the worst cycle."""
        return int(np.argmax(np.abs(self.z))) if self.z.size else -1


def pass_gate(solved: Solved, names: Sequence[str], noise_estimated: Sequence[bool]) -> Gate:
    """Judge a solution.

    Args:
        names: of the logs, for the sentence; noise_estimated: per log, whether its noise is from the data.
    """
    costs = solved.problem.block_costs(solved.solution.z)
    squares, counts, log, cycle = _per_cycle(solved, costs)
    total, samples = float(squares.sum()), float(counts.sum())
    chi2 = total / max(samples, 1.0)
    # chi^2 scales with the inverse square of the noise: an estimated noise widens what is credible.
    slack = 2 * NOISE_ERROR * np.array([1.0 if e else 0.0 for e in noise_estimated])
    by_log = np.array([float(counts[log == i].sum()) for i in range(len(names))])
    allowed = OVERALL * np.sqrt(2 / max(samples, 1.0)) + float(slack @ by_log) / max(samples, 1.0)
    spread = np.sqrt(2 * np.maximum(counts, 1.0) + (slack[log] * counts) ** 2)
    quiet = _below_measured(squares, log, by_log, noise_estimated)
    expected = quiet[log] * counts
    z = (squares - expected) / (quiet[log] * spread)
    status, message = _judge(solved, total / max(float(expected.sum()), 1.0), allowed, z, log, cycle, names)
    possible_causes = ""
    if status is Status.WRONG_EVENT_COUNT:
        possible_causes = _of_one_cycle(solved, z, log, cycle)
    elif status is Status.MODEL_MISFIT and solved.solution.success and (chi2 > 1.0 or np.any(z > PER_CYCLE)):
        noise = ", or the noise level is wrong" if _one_level(squares, counts, spread) else ""
        possible_causes = f"{OTHERWISE}, or a rig value is wrong, or the drive moves otherwise than stated{noise}"
    if status is Status.CONVERGED:
        variance = "its variance" if np.min(quiet) > 1.0 - 4.0 * NOISE_ERROR else "the variance measured in the sticks"
        message = message or f"the misfit is noise ({chi2:.3f} of {variance}) in all {z.size} cycles"
    levels = np.ones(len(names))
    slow = status in (Status.MODEL_MISFIT, Status.WRONG_EVENT_COUNT) and chi2 < 1.0 + MORE
    fitted = solved.fitted if slow or status is Status.CONVERGED else []
    if slow:
        known = autocorrelation_test(
            solved.problem.logs, solved.trajectories, fitted, noise_estimated, squares, counts, log
        )
        if known is not None:
            level = known.levels[log]
            again = (squares - level * counts) / (known.spread_inflation[log] * level * spread)
            likely = _judge(solved, 1.0, allowed, again, log, cycle, names)[0]
            if likely is Status.CONVERGED:
                levels, z, status, possible_causes = known.levels, again, likely, ""
                message = (
                    f"the misfit is noise with a memory ({chi2:.3f} of the variance measured in the sticks) in all "
                    f"{z.size} cycles{', which have nothing in common' if np.max(levels) > 1.0 + CLOSE else ''}"
                )
    if status is Status.CONVERGED:
        problem = solved.problem
        broken = inconsistency(problem.logs, solved.trajectories, problem.layout.unknowns, solved.theta, names)
        leaning = None if broken is not None else _leaning(solved, fitted, names) or _swinging(solved, fitted, names)
        if broken is not None:
            status, message = Status.WRONG_EVENT_COUNT, broken
        elif leaning is not None:
            status, message = Status.MODEL_MISFIT, leaning
    if status is Status.CONVERGED:
        strained = strained_load(solved, names) or odd_stick(solved, names)
        status, message = (Status.MODEL_MISFIT, strained) if strained else (status, message + scatter_words(solved))
    found = solved.solution.return_status, solved.event_shift
    return Gate(chi2, z, log + 1, cycle + 1, *found, status, message, possible_causes, levels)


def _one_level(squares: Array, counts: Array, spread: Array) -> bool:
    """Whether the misfit is the same in all cycles, but for chance: a noise of another level would leave it so."""
    level = float(np.median(squares / np.maximum(counts, 1.0)))
    return bool(np.all(np.abs(squares - level * counts) <= PER_CYCLE * level * spread))


def _alone(z: Array, log: NDArray[np.int64], cycle: NDArray[np.int64]) -> bool:
    """Whether no cycle misfits nearly as much as the worst one, but those beside it: what is wrong with one spoils
    these."""
    worst = int(np.argmax(np.abs(z)))
    apart = (log != log[worst]) | (np.abs(cycle - cycle[worst]) > SPOILED)
    return bool(ALONE * np.max(np.abs(z[apart]), initial=0.0) < max(z[worst], ALONE * PER_CYCLE))


def _of_one_cycle(solved: Solved, z: Array, log: NDArray[np.int64], cycle: NDArray[np.int64]) -> str:
    """What the misfit of one cycle may come of that stands out of all others."""
    worst = int(np.argmax(np.abs(z)))
    off, time = _farthest_off(solved, int(log[worst]), int(cycle[worst]))
    where = f"the curve is off by up to {100.0 * off:.0f} % of a drop there, at {time:.5g} s: perhaps"
    if off < SAME_SLIPS:
        return f"{where} one stick was stronger or weaker than the others, or the force was disturbed"
    return f"{where} a slip was missed or invented, or the force was cut off or disturbed"


def _farthest_off(solved: Solved, log: int, cycle: int) -> tuple[float, float]:
    """By how much the curve misses a cycle (from 0) of a log at most, in the mean over half a slip, over how far the
    force falls in a cycle of that log, at least the noise; and when [s]."""
    data, curve, trajectory = solved.problem.logs[log], solved.fitted[log], solved.trajectories[log]
    ends = [part[-1].until for part in trajectory.by_part()]
    samples = np.flatnonzero((data.weight > 0) & np.isfinite(curve))
    parts = np.split(samples, np.searchsorted(data.time[samples], ends[:-1]))
    mine = parts[cycle]
    left = data.force[mine] - curve[mine]
    width = max(round(0.5 * float(np.median(trajectory.slips)) / data.interval), 1) if trajectory.slips.size else 1
    width = min(width, left.size)
    off = np.abs(running_means(left, width))
    first = int(np.argmax(off))
    farthest = first + int(np.argmax(np.abs(left[first : first + width])))
    fall = float(np.median([np.ptp(curve[rows]) for rows in parts if rows.size]))
    return float(off[first]) / max(fall, data.noise), float(data.time[mine[farthest]])  # one that slides falls by none


def _below_measured(squares: Array, log: NDArray[np.int64], by_log: Array, noise_estimated: Sequence[bool]) -> Array:
    """The variance of the noise of each log over that measured in its sticks (logs,), where it is smaller.

    Slips that hardly show are taken for noise while it is measured: a curve that follows them leaves less. Of a noise
    that was stated nothing smaller is taken.
    """
    total = np.bincount(log, weights=squares, minlength=by_log.size)
    return np.where(noise_estimated, np.clip(total / np.maximum(by_log, 1.0), QUIETEST, 1.0), 1.0)


def _leaning(solved: Solved, fitted: Sequence[Array], names: Sequence[str]) -> str | None:
    """A sentence where neighbouring residuals lean to one side farther than noise does; None where they do not."""
    lean = most_leaning(solved.problem.logs, fitted)
    if lean is None or lean.share <= 1.0:
        return None
    return (
        f"the misfit is noise on the whole, but around {lean.time:.4g} s of {names[lean.log]} the curve misses by "
        f"{abs(lean.residual):.2g} N for {lean.length:.2g} s ({lean.deviations:.0f} standard deviations): another "
        f"answer may fit there too, or the model lacks something; look there in the report, and {START_VALUES}"
    )


def _swinging(solved: Solved, fitted: Sequence[Array], names: Sequence[str]) -> str | None:
    """A sentence where what is left of a slide swings as stick-slip does; None where it does not."""
    problem = solved.problem
    found = swing_left(problem.logs, solved.trajectories, problem.layout.unknowns, solved.theta, fitted)
    if found is None:
        return None
    return (
        f"the misfit is noise on the whole, but where this answer slides, {names[found[0]]} {found[1]}, or leave it out"
    )


def _per_cycle(solved: Solved, costs: list[Array]) -> tuple[Array, Array, NDArray[np.int64], NDArray[np.int64]]:
    """Sum of squared weighted residuals and number of samples of every cycle or slide, its log and number (from 0).
    What follows the last slip of a log counts to its last cycle."""
    last = np.array([trajectory.parts - 1 for trajectory in solved.trajectories])
    offsets = np.concatenate([[0], np.cumsum(last + 1)])
    squares, counts = np.zeros(offsets[-1]), np.zeros(offsets[-1])
    for family, moments, cost in zip(solved.problem.layout.families, solved.problem.moments, costs, strict=True):
        index = offsets[family.log] + np.minimum(family.cycle, last[family.log])
        squares += np.bincount(index, weights=cost, minlength=squares.size)
        counts += np.bincount(index, weights=moments.count, minlength=squares.size)
    log = np.repeat(np.arange(last.size), last + 1)
    return squares, counts, log, np.arange(squares.size) - offsets[log]


def _missed(solved: Solved, chi2: float) -> float:
    """By which share of its force the curve misses a log, at most; chi2: over all of them, per sample."""
    scales = [(data.noise, float(np.nanmax(np.abs(data.force)))) for data in solved.problem.logs]
    return max(np.sqrt(chi2) * noise / max(force, 1e-300) for noise, force in scales)


def _judge(
    solved: Solved,
    chi2: float,
    allowed: float,
    z: Array,
    log: NDArray[np.int64],
    cycle: NDArray[np.int64],
    names: Sequence[str],
) -> tuple[Status, str]:
    solution = solved.solution
    worst = int(np.argmax(np.abs(z))) if z.size else 0
    where = f"{names[log[worst]]}, cycle {cycle[worst] + 1}"
    if not np.isfinite(chi2):
        return Status.SOLVER_FAILED, (
            f"the solver left the region where the model can be computed ({solution.return_status}); "
            "check mass, stiffness and drive speed"
        )
    if solution.success and chi2 < 1.0 and not np.any(z > PER_CYCLE) and solved.event_shift < SETTLED:
        share = _missed(solved, chi2)
        if share < NOISELESS:
            return Status.CONVERGED, (
                f"the logs hold no noise: the curve misses them by {share:.1g} of their force in all {z.size} "
                "cycles, as a simulation does; the intervals are those of the noise that was assumed"
            )
    bad = abs(chi2 - 1.0) > allowed
    if not solution.success and not bad and np.max(np.abs(z)) <= PER_CYCLE:
        return Status.SOLVER_FAILED, (
            f"the solver stopped with {solution.return_status} after {solved.iterations} iterations although the curve "
            f"fits; {START_VALUES}, or fix a parameter that these logs cannot tell"
        )
    if bad or np.max(np.abs(z), initial=0.0) > PER_CYCLE:
        if z[worst] > JUMP and _alone(z, log, cycle):
            typical = float(np.median(np.delete(np.abs(z), worst))) if z.size > 1 else 0.0
            beside = "while the others fit" if typical < PER_CYCLE else f"where the others do by {typical:.0f}"
            return Status.WRONG_EVENT_COUNT, (
                f"{where} misfits by {z[worst]:.0f} standard deviations {beside}; look at it in the report and exclude "
                "that stretch"
            )
        failing = int(np.count_nonzero(np.abs(z) > PER_CYCLE))
        if chi2 < 1.0 and not np.any(z > PER_CYCLE) and solution.success:
            return Status.MODEL_MISFIT, (
                f"the curve follows these data more closely than their noise allows: misfit {chi2:.3g} times the noise "
                "variance; if the noise is stated, state less; if not, slips of few samples counted as noise while it "
                'was measured: sample faster, or give the noise of the force sensor under [rig], noise = "… N"'
            )
        return Status.MODEL_MISFIT, (
            f"the model does not describe these data: misfit {chi2:.3g} times the noise variance, "
            f"{failing} of {z.size} cycles beyond {PER_CYCLE:g} standard deviations, worst {where} ({z[worst]:.0f}); "
            "see the cycle scatter in the report"
            + (
                ""
                if solution.success
                else f"; the solver itself stopped with {solution.return_status}, and may do better from "
                f"elsewhere: {START_VALUES}"
            )
        )
    if not solved.event_shift < SETTLED:
        return Status.SOLVER_FAILED, (
            f"the event times still move by {solved.event_shift:.2g} samples per pass; {START_VALUES}"
        )
    return Status.CONVERGED, ""
