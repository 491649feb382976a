"""Does an answer count: the goodness-of-fit tests of a solution.

One likelihood is asked at four scales: the residuals of a record, of every cycle, of windows of all lengths, and the
random effects (normal force of a cycle, strength of a stick) that a wrong answer would make take up what it gets wrong.
Where the residuals are autocorrelated, the autoregression estimated from them (`residual_autocorrelation`) widens what
counts as noise. Beside the likelihood an answer has to obey the inequalities of its own mode sequence, and leave no
stick-slip in what it takes for sliding. Every test is needed; each alone lets some wrong answer through.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from data_io.arrays import thinned
from identify.base.linear import Factors, optimality_matrix
from identify.base.quantiles import normal, student
from identify.base.result import Status
from identify.base.wording import START_VALUES, three_figures
from identify.estimation.residual_autocorrelation import innovations, repeats, slides
from identify.logs.log_data import LogData
from identify.logs.regime import Known, hidden_rhythm
from identify.logs.unknowns import Unknowns
from identify.model.model import SPEED
from identify.shooting.blocks import SlideBlock
from identify.shooting.passes import SETTLED, Solved
from identify.shooting.shooting_trajectory import ShootingTrajectory, turned_back

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

OVERALL = 5.0  # standard deviations of chi^2 over all samples, and over those of slips
PER_CYCLE = 6.0  # standard deviations of chi^2 of one cycle, and of what one random effect is off
NOISE_ERROR = 0.015  # relative error of an estimated noise level
QUIETEST = 0.7  # of the variance measured in the sticks: less is no error of measuring noise
NOISELESS = 1e-5  # of the force, by which the curve misses a log without noise: no sensor is as good
OUTLIER, NEIGHBOURS, OUTLIER_RATIO = 30.0, 2, 20.0
"""z of a cycle above which a slip is more likely missing, or the force disturbed, than the law wrong, where all but the
cycles next to it are so many times better."""
CHANCE = 1e-7  # of any other test to refuse a right answer
LONGEST = 512  # samples of a window of the scan
QUARTILES = 2.0 * normal(0.75)
ENOUGH = 1 << 12  # sums of windows that determine their spread to 3 %
LINE_SHARE = 0.05  # share of the power of what is left: a line that is so clear by chance is no matter of its height
MARGIN = 0.5  # standard deviations of the force noise: closer to being pulled back, the answer may hide that it is


@dataclass(frozen=True)
class Gate:
    """What the goodness-of-fit tests found.

    Attributes
    ----------
    chi2_per_sample: sum of squares in noise variances per sample.
    z, log, cycle: (c,) standardised misfit of every cycle, its log and number (from 1).
    solver, event_shift: return status of the solver; how far event times moved in the last pass [samples].
    status, message: CONVERGED where all tests hold; what failed, where, and what to do.
    levels: (logs,) variance of autocorrelated noise over that measured in the sticks, 1 for white noise.
    """

    chi2_per_sample: float
    z: Array
    log: Indices
    cycle: Indices
    solver: str
    event_shift: float
    status: Status
    message: str
    levels: Array = field(default_factory=lambda: np.ones(1))

    @property
    def level(self) -> float:
        """The variance of the noise over that measured in the sticks, of the log where it is largest."""
        return float(np.max(self.levels))

    @property
    def worst(self) -> int:
        """Index of the worst cycle; -1 without one."""
        return int(np.argmax(np.abs(self.z))) if self.z.size else -1


def pass_gate(solved: Solved, names: Sequence[str], noise_estimated: Sequence[bool]) -> Gate:
    """Test a solution.

    Args:
        names: of the logs, for the message; noise_estimated: per log, whether its noise is from the data.
    """
    squares, counts, log, cycle = _per_cycle(solved)
    chi2, levels = float(squares.sum()) / max(float(counts.sum()), 1.0), np.ones(len(names))
    estimated = np.array(noise_estimated, dtype=bool)
    cycles = [(names[i], n + 1) for i, n in zip(log.tolist(), cycle.tolist(), strict=True)]
    level, z, whole = _standardised(squares.sum(axis=0), counts.sum(axis=0), log, estimated)
    sliding = _standardised(squares[1], counts[1], log, estimated)[2]
    status, message = _chi_square(solved, [whole, sliding], z, cycles)
    sound = solved.solution.success and solved.event_shift < SETTLED
    if status in (Status.MODEL_MISFIT, Status.WRONG_EVENT_COUNT) and sound:
        # Squares and samples, of what slips and what does not, of each cycle.
        white, halves, correlated = list[Array](), np.zeros((2, 2 * log.size)), False
        for number, (data, trajectory) in enumerate(zip(solved.problem.logs, solved.trajectories, strict=True)):
            residual = np.where(data.weight > 0, data.force - solved.fitted[number], np.nan)
            new = innovations(data, trajectory, residual) if estimated[number] and trajectory.cycles > 1 else None
            correlated |= new is not None
            white.append(residual / data.noise if new is None else new)
            known = np.isfinite(white[-1])
            part = np.searchsorted(trajectory.until[np.flatnonzero(np.diff(trajectory.part))], data.time[known])
            cell = log.size * slides(data, trajectory)[known] + np.flatnonzero(log == number)[part]
            halves[0] += np.bincount(cell, white[-1][known] ** 2, 2 * log.size)
            halves[1] += np.bincount(cell, minlength=2 * log.size)
        _, each, whole = _standardised(halves[0], halves[1], np.tile(log, 2), estimated)
        # An answer for white noise misses a little of all slips together where the noise is autocorrelated.
        sliding = whole if correlated else sliding
        fits = _chi_square(solved, [whole, sliding], each, 2 * cycles)[0] is Status.CONVERGED
        if fits and not repeats(solved, white):
            status, levels = Status.CONVERGED, np.where(estimated, np.maximum(level, 1.0), 1.0)
            squares, counts = halves.reshape(2, 2, -1).sum(axis=1)
            z = _standardised(squares, counts, log, estimated)[1]
            measured = f"{chi2:.3f} of the variance measured in the sticks"
            message = f"all {z.size} cycles fit within autocorrelated noise (misfit {measured})"
    if status is Status.CONVERGED:
        quiet = np.min(level[estimated], initial=1.0) < 1.0 - 4.0 * NOISE_ERROR
        variance = "the variance measured in the sticks" if quiet else "its variance"
        message = message or f"all {z.size} cycles fit within the noise (misfit {chi2:.3f} of {variance})"
        unknowns = solved.problem.layout.unknowns
        refused = (test(solved, names) for test in (_windows, _swings, _load_pulls, odd_stick))
        if broken := inconsistency(solved.problem.logs, solved.trajectories, unknowns, solved.theta, names):
            status, message = Status.WRONG_EVENT_COUNT, broken
        elif sentence := next(filter(None, refused), ""):
            status, message = Status.MODEL_MISFIT, sentence
        elif scatter := stick_scatter(solved):
            message += f"; strength (mu_s - mu_k0) differs from stick to stick by {three_figures(100.0 * scatter)} %"
    ended = solved.solution.return_status, solved.event_shift
    # What was refused is no noise, whose level would widen the scores that look for its cause.
    levels = levels if status is Status.CONVERGED else np.ones(len(names))
    return Gate(chi2, z, log + 1, cycle + 1, *ended, status, message, levels)


def _standardised(
    squares: Array, counts: Array, log: Indices, estimated: NDArray[np.bool_]
) -> tuple[Array, Array, tuple[float, float]]:
    """Variance that each log leaves, standardised misfit of cycles, chi^2 over what is expected with its tolerance."""
    # chi^2 scales with the inverse square of the noise: an estimated noise widens what is credible.
    slack = 2.0 * NOISE_ERROR * estimated
    by_log = np.bincount(log, weights=counts, minlength=estimated.size)
    level = np.bincount(log, weights=squares, minlength=estimated.size) / np.maximum(by_log, 1.0)
    spread = np.sqrt(2.0 * np.maximum(counts, 1.0) + (slack[log] * counts) ** 2)
    # Slips that hardly show are taken for noise while it is measured: a curve that follows them leaves less.
    expected = np.where(estimated, np.clip(level, QUIETEST, 1.0), 1.0)[log]
    samples = max(float(counts.sum()), 1.0)
    allowed = OVERALL * np.sqrt(2.0 / samples) + float(slack @ by_log) / samples
    chi2 = float(squares.sum()) / max(float(expected @ counts), 1.0)
    return level, (squares - expected * counts) / (expected * spread), (chi2, allowed)


def _per_cycle(solved: Solved) -> tuple[Array, Array, Indices, Indices]:
    """Sum of squared weighted residuals and number of samples (2, c), of what slips of every cycle second, its
    log and number (from 0). What follows the last slip of a log counts to its last cycle."""
    last = np.array([trajectory.parts - 1 for trajectory in solved.trajectories])
    offsets = np.concatenate([[0], np.cumsum(last + 1)])
    squares, counts = np.zeros((2, 2, offsets[-1]))
    costs = solved.problem.block_costs(solved.solution.z)
    for family, moments, cost in zip(solved.problem.layout.families, solved.problem.moments, costs, strict=True):
        index = offsets[family.log] + np.minimum(family.cycle, last[family.log])
        half = int(isinstance(family.block.kind, SlideBlock))
        squares[half] += np.bincount(index, weights=cost, minlength=offsets[-1])
        counts[half] += np.bincount(index, weights=moments.count, minlength=offsets[-1])
    log = np.repeat(np.arange(last.size), last + 1)
    return squares, counts, log, np.arange(log.size) - offsets[log]


def _chi_square(
    solved: Solved, chi2s: Sequence[tuple[float, float]], z: Array, cycles: Sequence[tuple[str, int]]
) -> tuple[Status, str]:
    """Status and sentence by the sums of squares of the record, of its slips (each chi^2 over what is expected,
    and its tolerance: long rests hide slips), and of every cycle, and by the end of the solver."""
    (chi2, allowed), (sliding, allowed_sliding) = chi2s
    solution, ended = solved.solution, solved.solution.return_status
    if not np.isfinite(chi2):
        return Status.SOLVER_FAILED, (
            f"the solver left the region where the model can be computed ({ended}); "
            "check mass, stiffness and drive speed"
        )
    sound, off = solution.success and solved.event_shift < SETTLED, np.abs(z)
    worst, quieter = int(np.argmax(off)) if z.size else 0, chi2 < 1.0 and not np.any(z > PER_CYCLE)
    if quieter and sound:
        highest = [max(float(np.nanmax(np.abs(log.force))), 1e-300) / log.noise for log in solved.problem.logs]
        if (missed := np.sqrt(chi2) / min(highest)) < NOISELESS:
            return Status.CONVERGED, (
                f"the logs have no noise: the curve misses them by {missed:.1g} of their force, as a simulation does; "
                "the intervals are those of the noise that was assumed"
            )
    slid = abs(sliding - 1.0) <= allowed_sliding
    if abs(chi2 - 1.0) <= allowed and slid and float(np.max(off, initial=0.0)) <= PER_CYCLE:
        failed = (
            f"the curve fits, but the solver ended with {ended} after {solved.iterations} iterations and its event "
            f"times move by {solved.event_shift:.2g} samples per pass; {START_VALUES}, or fix a parameter that these "
            "logs cannot determine"
        )
        return (Status.CONVERGED, "") if sound else (Status.SOLVER_FAILED, failed)
    name, number = cycles[worst]
    # What is wrong with one cycle spoils those next to it.
    apart = [log != name or abs(cycle - number) > NEIGHBOURS for log, cycle in cycles]
    others = float(np.max(off[apart], initial=0.0))
    if z[worst] > OUTLIER and OUTLIER_RATIO * others < max(z[worst], OUTLIER_RATIO * PER_CYCLE):
        return Status.WRONG_EVENT_COUNT, (
            f"{name}, cycle {number} misfits by {z[worst]:.0f} standard deviations where the others do by up to "
            f"{others:.0f}; perhaps a slip was missed, or the force disturbed: look at it in the report and exclude "
            "that stretch"
        )
    if quieter and solution.success:
        return Status.MODEL_MISFIT, (
            f"the curve follows these data more closely than their noise allows: misfit {chi2:.3g} times the noise "
            "variance; if the noise is stated, state less; if not, slips of few samples counted as noise while it "
            'was measured: sample faster, or give the noise of the force sensor under [rig], noise = "… N"'
        )
    where = "" if slid else f" ({sliding:.3g} in its slips)"
    stopped = "" if solution.success else f"; the solver stopped with {ended}, and may do better: {START_VALUES}"
    return Status.MODEL_MISFIT, (
        f"the model does not describe these data: misfit {chi2:.3g} times the noise variance{where}, "
        f"{np.count_nonzero(off > PER_CYCLE)} of {z.size} cycles beyond {PER_CYCLE:g} standard deviations, worst "
        f"{name}, cycle {number} ({z[worst]:.0f}); see the cycle scatter in the report{stopped}"
    )


# Scan: sums of neighbouring residuals over windows of all lengths. A wrong answer can keep the sum of squares of a long
# cycle within its noise and still miss a slip altogether. Noise cancels in sums, a misfit does not.


@dataclass(frozen=True)
class ResidualWindow:
    """The window whose residuals stand out most: log, mean time [s], length [s], mean residual [N], by how many
    standard deviations, and over the number of them that noise reaches by chance."""

    log: int
    time: float
    length: float
    residual: float
    deviations: float
    ratio: float


def residual_scan(logs: Sequence[LogData], fitted: Sequence[Array]) -> ResidualWindow | None:
    """The window of all logs whose residuals stand out most; None where nothing is fitted.

    The spread of the sums themselves counts as noise where it is larger than that of white noise.

    Args:
        fitted: (n,) force at the samples of each log [N], NaN where none is fitted.
    """
    out = []
    for number, (log, curve) in enumerate(zip(logs, fitted, strict=True)):
        good = (log.weight > 0) & np.isfinite(curve)
        time, residual = log.time[good], (log.force - curve)[good]
        sums = np.concatenate([[0.0], np.cumsum(residual * np.sqrt(log.weight[good]))])
        widths = [2**i for i in range(1, int(np.log2(LONGEST)) + 1) if 8 * 2**i <= residual.size]
        limit = -normal(0.5 * CHANCE / max(residual.size * len(widths), 1))
        for width in widths:
            scaled = (sums[width:] - sums[:-width]) / np.sqrt(width)
            low, high = np.quantile(thinned(scaled, ENOUGH), [0.25, 0.75])
            first = int(np.argmax(np.abs(scaled)))
            deviations = abs(float(scaled[first])) / max(1.0, float(high - low) / QUARTILES)
            stamps, mean = time[first : first + width], float(np.mean(residual[first : first + width]))
            at = float(np.mean(stamps)), float(np.ptp(stamps))
            out.append(ResidualWindow(number, *at, mean, deviations, deviations / limit))
    return max(out, key=lambda window: window.ratio, default=None)


def _windows(solved: Solved, names: Sequence[str]) -> str:
    """A sentence where a window of residuals stands out farther than noise does; "" where none does."""
    worst = residual_scan(solved.problem.logs, solved.fitted)
    if worst is None or worst.ratio <= 1.0:
        return ""
    return (
        f"the misfit is noise on the whole, but around {worst.time:.4g} s of {names[worst.log]} the curve misses by "
        f"{abs(worst.residual):.2g} N for {worst.length:.2g} s ({worst.deviations:.0f} standard deviations): another "
        f"answer may fit there too, or the model lacks something; look there in the report, and {START_VALUES}"
    )


def _swings(solved: Solved, names: Sequence[str]) -> str:
    """A sentence where what is left of the last slide of a log swings as stick-slip does, in slips that counted as
    noise while that was measured; "" where none does."""
    unknowns = solved.problem.layout.unknowns
    pairs = zip(solved.problem.logs, solved.trajectories, solved.fitted, names, strict=True)
    for log, trajectory, curve, name in pairs if not unknowns.model.vibrates else ():
        p = unknowns.values(trajectory.theta(solved.theta), log.base)
        values = dict(zip(unknowns.names, p.tolist(), strict=True))
        if trajectory.rests_at_end or not values.get("mass", 0.0) > 0.0:
            continue
        rested = (s.until for s in trajectory.stretches if s.kind == "rest" or s.ended_by == "arrest")
        rows = slice(*np.searchsorted(log.time, [max(rested, default=log.begin), log.end]))
        rig = Known(values["stiffness"], log.speed_at(log.end), np.pi * (values["mass"] / values["stiffness"]) ** 0.5)
        left = np.where(log.weight[rows] > 0.0, log.force[rows] - curve[rows], np.nan)
        swing = hidden_rhythm(log.time[rows], left, None, rig, LINE_SHARE)  # what the load does the answer follows
        if swing is not None:
            return f"the misfit is noise on the whole, but where this answer slides, {name} {swing}, or leave it out"
    return ""


# Random effects: the normal force of a cycle with the error of its measurement, the strength of a stick with the
# scatter of all. The misfit of the samples does not see what a wrong answer makes these take up.


def _load_pulls(solved: Solved, names: Sequence[str]) -> str:
    """A sentence where cycles fit only as their normal force was moved farther than its measurement allows, or ""."""
    remedy = "" if "occlusion" in solved.problem.layout.unknowns.model.effects else ", or add occlusion to effects"
    for data, trajectory, name in zip(solved.problem.logs, solved.trajectories, names, strict=True):
        off = load_deviations(data, trajectory)
        if off.size and max(_excess(off), float(np.max(np.abs(off)))) > PER_CYCLE:
            worst = int(np.argmax(np.abs(off)))
            cycle = np.append(np.arange(trajectory.deviation.size), trajectory.slip_parts)[worst]
            return (
                f"{name}: the cycles fit only if their normal force is off by up to {abs(off[worst]):.0f} standard "
                f"errors of its measured course (cycle {cycle + 1}), or friction drifts or differs from cycle to "
                f"cycle; check the sensor of the normal force, leave those cycles out{remedy}"
            )
    return ""


def odd_stick(solved: Solved, names: Sequence[str]) -> str:
    """A sentence where strengths of sticks, one or several, are off as no scatter of the others explains (Rosner 1983:
    each time the farthest is taken out, until half are left); "" where none is, or sticks have none of their own."""
    layout, sd = solved.problem.layout, max(log.strength_sd for log in solved.problem.logs)
    if layout.varied.size < 4:
        return ""
    off, covariance = stick_deviations(solved)
    # A stick that tells little of its strength keeps to the shared one.
    shown = off / np.sqrt(np.maximum(sd**2 - np.diag(covariance), (1e-3 * sd) ** 2))
    odd, scale = outliers(shown, CHANCE)
    if not odd.size:
        return ""
    worst = odd[np.argmax(np.abs(shown[odd]))]
    log = next(i for i, place in enumerate(layout.places) if layout.varied[worst] in place.strength)
    cycle = int(np.flatnonzero(layout.places[log].strength == layout.varied[worst])[0])
    share, times = float(off[worst]) / layout.unknowns.strength(solved.theta), abs(float(shown[worst])) / scale
    others = "" if odd.size == 1 else f" ({odd.size} of {off.size} sticks are so)"
    return (
        f"{names[log]}, cycle {cycle + 1} fits only with a static friction {times:.0f} times as far off as the other "
        f"sticks scatter, its strength (mu_s - mu_k0) off by {100.0 * share:+.2g} %{others}: perhaps a slip was missed "
        "or invented, or the force was cut off or disturbed; look at it in the report and exclude that stretch"
    )


def outliers(values: Array, chance: float) -> tuple[Indices, float]:
    """Which of some values (n,) are no normal numbers of one mean and spread, and the standard deviation of the others:
    the farthest is taken out until half are left, and the last that is too far says how many are (Rosner, Technometrics
    25, 1983); chance: that one of so many normal numbers is called so."""
    taken, left, far, scale = list[int](), np.arange(values.size), 0, float(np.std(values, ddof=1))
    for count in range(1, values.size // 2 + 1):
        taken.append(int(left[np.argmax(np.abs(values[left] - np.mean(values[left])))]))
        left = left[left != taken[-1]]
        mean, spread = float(np.mean(values[left])), float(np.std(values[left], ddof=1))
        limit = float(student(1.0 - 0.5 * chance / (left.size + 1), left.size - 1))
        if abs(float(values[taken[-1]]) - mean) > limit * spread * (1.0 + 1.0 / left.size) ** 0.5:
            far, scale = count, spread
    return np.array(taken[:far], dtype=np.int64), scale


def stick_deviations(solved: Solved) -> tuple[Array, Array]:
    """By how much mu_s of every stick (s,) is off the shared one, and the covariance (s, s) of that, given the data."""
    problem, layout = solved.problem, solved.problem.layout
    point = problem.evaluate(solved.solution.z, derivatives=True)
    about, columns = layout.prior_about[layout.varied], np.arange(layout.varied.size)
    right = np.zeros((layout.size + layout.rows, columns.size))
    right[layout.varied, columns] = layout.scale[layout.varied]
    right[about, columns] -= layout.scale[about]
    answer = Factors(optimality_matrix(point.hessian, point.jacobian)).solve(right)[: layout.size]
    covariance = layout.beside(layout.scale[:, None] * answer)[layout.varied]
    return layout.beside(solved.solution.x)[layout.varied], covariance


def load_deviations(data: LogData, trajectory: ShootingTrajectory) -> Array:
    """By how many of its standard errors the normal force is off in every part, then at the end of every slip; empty
    where it is exact."""
    if not data.normal_force_sd > 0.0 or not trajectory.deviation.size:
        return np.empty(0)
    return np.append(trajectory.deviation, trajectory.slip_deviation) / data.normal_force_sd


def loads_stand_in(solved: Solved) -> bool:
    """Whether normal forces of a log are off by more than their errors, as where they stand in for another scatter."""
    deviations = map(load_deviations, solved.problem.logs, solved.trajectories)
    return any(off.size and _excess(off) > 0.0 for off in deviations)


def _excess(off: Array) -> float:
    """Standard deviations by which the squares of so many standard normal numbers exceed their mean."""
    return (float(off @ off) - off.size) / float(np.sqrt(2.0 * off.size))


def stick_scatter(solved: Solved) -> float | None:
    """Standard deviation of mu_s - mu_k0 from stick to stick, over its mean; None where it is the same in all."""
    unknowns, sd = solved.problem.layout.unknowns, max(log.strength_sd for log in solved.problem.logs)
    strength = unknowns.strength(solved.theta) if sd > 0.0 else 0.0
    return sd / strength if strength > 0.0 else None


# Inequalities of the mode sequence. The rows of the shooting problem hold what is equal: continuity, guards. What must
# be greater or smaller is checked here: a mass that arrests stays at rest, and slips go forward.


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
        net, limit, part = _at_arrests(log, trajectory, unknowns, unknowns.values(trajectory.theta(theta), log.base))
        margin = MARGIN * log.noise
        for excess, what, allowed in ((-net - limit, "back", -margin), (net - limit, "on", margin)):
            worst = int(np.argmax(excess)) if excess.size else 0
            if excess.size and excess[worst] > allowed:
                return (
                    f"{name}, cycle {part[worst] + 1}: at this answer the mass is pulled {what} as soon as it stops, "
                    f"or all but ({excess[worst]:+.2g} N beyond the static limit, noise {log.noise:.2g} N), a "
                    "motion that the fit excludes; leave this log out, or measure with more damping or less "
                    "normal force"
                )
        backwards = (n for n, back in zip(trajectory.part, turned_back(trajectory), strict=True) if back.any())
        if (cycle := next(backwards, None)) is not None:
            return (
                f"{name}, cycle {cycle + 1}: at this answer the slip reverses before it ends, which the fit excludes; "
                "exclude that stretch"
            )
        beyond, at = _in_lulls(log, trajectory, unknowns, unknowns.values(trajectory.theta(theta), log.base))
        if beyond > margin:
            return (
                f"{name}: at this answer the mass slips already at {at:.4g} s, where the normal force is lowest "
                f"({beyond:.2g} N beyond the static limit, noise {log.noise:.2g} N), where the fit has it at rest: a "
                "small slip was missed; look at it in the report, or exclude that stretch"
            )
    return None


def _in_lulls(log: LogData, trajectory: ShootingTrajectory, unknowns: Unknowns, p: Array) -> tuple[float, float]:
    """By how much the drive is at most beyond the static limit within a rest before its onset, where the normal force
    is lowest for a while [N], and when [s]."""
    model, until = unknowns.model, trajectory.until
    place, rows = unknowns.names.index("mu_s"), list[tuple[Array, float, float, float, float]]()
    for i in trajectory.ending("onset").tolist() if log.programme is None else ():
        since, start = (until[i - 1], trajectory.at_end(np.array([i - 1]))[0]) if i else (log.begin, trajectory.start)
        times, loads = log.normal_force.between(float(since), float(until[i]))
        part = trajectory.part[i]
        off = float(trajectory.deviation[part]) if trajectory.deviation.size else 0.0
        mu_s = float(trajectory.strength[part]) if trajectory.strength.size else float(p[place])
        for low in (1 + np.flatnonzero((loads[1:-1] < loads[:-2]) & (loads[1:-1] <= loads[2:]))).tolist():
            rows.append((start, float(times[low]), float(times[low] - since), float(loads[low]) + off, mu_s))
    if not rows:
        return -np.inf, log.begin
    starts, at, rests, loads, strengths = (np.array(column) for column in zip(*rows, strict=True))
    starts[:, SPEED] = 0.0
    each = np.repeat(p[:, None], rests.size, axis=1)
    each[place] = strengths
    u = np.stack([np.full(rests.size, log.drive_speed), loads, np.ones(rests.size), at])
    after = model.rest(starts.T, each, u, rests[None])
    excess = np.array(model.driving_force(after, each, u) - model.grip(after, each, u)).ravel()
    worst = int(np.argmax(excess))
    return float(excess[worst]), float(at[worst])


def _at_arrests(
    log: LogData, trajectory: ShootingTrajectory, unknowns: Unknowns, p: Array
) -> tuple[Array, Array, Indices]:
    """Net driving force and static limit at every arrest (c,) [N]; the part of the record that each ends."""
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
    return np.array(model.driving_force(*arguments)).ravel(), np.array(model.grip(*arguments)).ravel(), part
