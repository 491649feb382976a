"""Starts from the data alone: many small fits of one settled cycle; from levels where no log repeats its cycles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

from identify.logs.log_data import LogData
from identify.logs.prepare import Prepared, at_drive, moving_pieces
from identify.logs.unknowns import Unknowns
from identify.model.model import assemble
from identify.shooting import batch
from identify.shooting.batch import Waves
from identify.simulation.drive import Drive
from identify.simulation.phases import sticks
from identify.simulation.sliding import growth_rates

Array = NDArray[np.float64]

HALVINGS, LONGER = 8, 5.0  # of delta_mu_k until steady sliding fades at half the pace of the rig alone; times t_cr
MEAN, SLIDES = 0.15, 0.2  # of half a period: means of a force; of the highest speed: the mass slides
LENGTHS = (10e-6, 40e-6)  # D [m]
LESS, UNEXPLAINED = 0.2, 0.5  # times the usual delta_mu_k; share of the variance of peaks that rests may leave
TIMES = (0.2, 1.0, 5.0)  # t_cr [s]; longer ones, each times the last, up to the longest rest of the drive


@dataclass(frozen=True)
class _Levels:
    """What logs show without a cycle: speeds (n,) [m/s] and levels (n,) of the coefficient of friction there, its top;
    rests [s] and peaks after them (2, m); the longest hold of the drive [s]; whether a drive goes on a course."""

    speeds: Array
    levels: Array
    top: float
    peaks: Array
    longest: float
    on_course: bool


def _levels_of(logs: Sequence[Prepared], names: Sequence[str]) -> _Levels:
    points, tops, middles = list[tuple[float, float]](), list[float](), list[float]()
    peaks, sliding, longest = [np.empty((2, 0))], list[Array](), 0.0
    for data in (at_drive(part) for log in logs for part in log.one_way):
        drive = data.programme or Drive((0.0,), (data.drive_speed,))
        counted = (data.weight > 0) & (data.time >= data.begin) & (data.time <= data.end)
        counted &= drive.motion(data.time)[1] > 0.0
        coefficient = data.force / data.normal_force.at(data.time)
        middle, top = np.nanquantile(coefficient[counted], (0.5, 0.999)).tolist()
        middles, tops = [*middles, middle], [*tops, top]
        spans = zip(np.diff(drive.starts).tolist(), drive.speeds, strict=False)
        longest = max([longest, *(span for span, speed_then in spans if speed_then == 0.0)])
        if data.on_course:
            sliding.append(_while_sliding(data, names))
            continue
        peaks.append(_after_holds(data, drive, coefficient))
        for start, stop, speed in moving_pieces(drive, data.begin, data.end):
            # The level at the end of a stretch of constant speed.
            mine = (data.time >= stop - 0.4 * (stop - start)) & (data.time <= stop) & (data.weight > 0)
            if np.count_nonzero(mine) >= 3:
                points.append((speed, float(np.median(coefficient[mine]))))
    if sliding:  # the level of all speeds at which it slides
        speed, level = np.median(np.concatenate(sliding, axis=1), axis=1).tolist()
        points.append((speed, level))
    peaks += [_of_sticks(log) for log in logs if log.data.on_course]
    speeds, levels = np.transpose(points or [(logs[0].data.drive_speed, middles[0])])
    return _Levels(speeds, levels, max(tops), np.concatenate(peaks, axis=1), longest, bool(sliding))


def level_starts(logs: Sequence[Prepared], unknowns: Unknowns) -> Array:
    """Theta (S, n_p) of starts from the levels of logs; where one slides steadily, so does the model."""
    seen, names, base = _levels_of(logs, unknowns.names), unknowns.names, logs[0].data.base
    value = dict(zip(names, unknowns.values(unknowns.start, base).tolist(), strict=True))
    slow, fast = int(np.argmin(seen.speeds)), int(np.argmax(seen.speeds))
    steps = [1.0]  # times delta_mu_k
    if seen.speeds[fast] > 1.5 * seen.speeds[slow] and "delta_mu_k" in names:
        fall = 1.2 * float(seen.levels[fast] - seen.levels[slow])
        value |= {"a": 2.0 / float(seen.speeds[fast]), "delta_mu_k": min(fall, -0.005)}
    elif seen.on_course:
        steps.append(LESS)
    value["delta_mu_k"] = value.get("delta_mu_k", 0.0) * _calm_share(logs, unknowns, value)
    times, ageing = list(TIMES), _ageing(seen.peaks)
    while times[-1] < seen.longest / LONGER:
        times.append(LONGER * times[-1])
    if ageing is not None:  # sticks of strokes are of few lengths, and determine it less surely than holds
        times = [ageing[0], *(times if seen.on_course else ())]
    rows, share = [], 1.0 - float(np.exp(-value.get("a", 0.0) * seen.speeds[slow]))
    peaked = any(log.fit_mode.name == "continuous" for log in logs)
    for length, time, step in product(LENGTHS, times, steps) if peaked else [(LENGTHS[0], TIMES[0], 1.0)]:
        mu_k0 = max(float(seen.levels[slow]) - step * value["delta_mu_k"] * share, 0.01)
        mu_s = max(seen.top if ageing is None else ageing[1], mu_k0 + 0.02) if peaked else mu_k0 + 0.15
        weaker = {"delta_mu_k": step * value["delta_mu_k"]}
        one = value | weaker | {"mu_s": mu_s, "mu_k0": mu_k0, "D": length, "t_cr": time}
        rows.append([one[name] for name in names])
    return np.unique(_inside(unknowns, unknowns.theta(np.array(rows), base)), axis=0)


def _calm_share(logs: Sequence[Prepared], unknowns: Unknowns, value: Mapping[str, float]) -> float:
    """The share of delta_mu_k with which the model slides steadily where logs do; 1 where none does."""
    names = unknowns.names
    steady = [part.data for log in logs for part in (log, *log.pieces) if part.fit_mode.name == "sliding"]
    if not steady or "delta_mu_k" not in names or unknowns.model.clocked:
        return 1.0
    shares = np.append(0.5 ** np.arange(HALVINGS), 0.0)
    settings = [[*(value[name] for name in names), one.mean_normal_force, one.drive_speed] for one in steady]
    tried = np.tile(settings, (shares.size, 1, 1))
    tried[:, :, names.index("delta_mu_k")] *= shares[:, None]
    growth = growth_rates(unknowns.model, tried.reshape(-1, tried.shape[-1])).reshape(shares.size, -1)
    return float(shares[int(np.argmax(np.all(growth < 0.5 * growth[-1], axis=1)))])


def _after_holds(data: LogData, drive: Drive, coefficient: Array) -> Array:
    """How long the contact rested from each stop of the drive on [s], and the highest coefficient of friction after it,
    (2, n)."""
    out = []
    for start, stop, _ in moving_pieces(drive, data.begin, data.end):
        stopped = max((begin for begin in drive.starts if begin < start), default=np.nan)
        rows = np.flatnonzero((data.time >= start) & (data.time <= stop) & (data.weight > 0))
        if drive.at(stopped) == 0.0 and rows.size:
            peak = rows[int(np.argmax(coefficient[rows]))]
            out.append((float(data.time[peak]) - stopped, float(coefficient[peak])))
    return np.reshape(out, (-1, 2)).T


def _of_sticks(log: Prepared) -> Array:
    """How long each stick of a log lasted that follows a slip [s], and its last coefficient of friction, (2, n)."""
    cycles = log.segmentation.cycles
    heights = np.abs(cycles.onset_force) / log.data.normal_force.at(cycles.onset)
    return np.stack([cycles.onset[1:] - cycles.arrest[:-1], heights[1:]])


def _ageing(peaks: Array) -> tuple[float, float] | None:
    """Time [s] and end of the exponential by which peaks (2, n) rise with their rests; None where rests do not explain
    them."""
    rests, heights = peaks[:, peaks[0] > 0.0]
    if np.unique(rests).size < 4:
        return None
    times, fits = np.geomspace(np.min(rests) / LONGER, np.max(rests), 64), list[tuple[float, float, float]]()
    for time in times.tolist():
        columns = np.stack([np.ones(rests.size), -np.expm1(-rests / time)], axis=1)
        (first, rise), left = np.linalg.lstsq(columns, heights)[:2]
        if rise > 0.0 and left.size and left[0] < UNEXPLAINED * rests.size * np.var(heights):
            fits.append((float(left[0]), time, float(first + rise)))
    _, time, end = min(fits, default=(0.0, np.inf, np.nan))
    return (time, end) if time < times[-1] else None


def _while_sliding(data: LogData, names: Sequence[str]) -> Array:
    """Speeds of a mass that slides [m/s], and its coefficients of friction (2, n): along a course of the drive they
    follow from what the spring has not taken of it, and from what then accelerates the mass."""
    rig, rows = dict(zip(names, data.base.tolist(), strict=True)), np.flatnonzero(data.weight > 0)
    rows = rows[(data.time[rows] >= data.begin) & (data.time[rows] <= data.end)]
    width = max(int(MEAN * np.pi * np.sqrt(rig["mass"] / rig["stiffness"]) / data.interval), 1)
    means = rows[: rows.size // width * width].reshape(-1, width)
    time, force = (each[means].mean(axis=1) for each in (data.time, data.force))
    speed = np.gradient(data.moved(time) - force / rig["stiffness"], time)
    friction = (force - rig["mass"] * np.gradient(speed, time)) / data.normal_force.at(time)
    slides = scipy.ndimage.binary_erosion(speed > SLIDES * np.max(speed), iterations=2)
    slides |= speed == np.max(speed)  # beside a rest its speed is not smooth; one at least
    return np.stack([speed, friction])[:, slides]


def _inside(unknowns: Unknowns, theta: Array) -> Array:
    """Theta within its bounds, and fixed where it is not free."""
    finite = np.where(np.isfinite(theta), theta, unknowns.start)
    return np.where(unknowns.free, np.clip(finite, unknowns.lower, unknowns.upper), unknowns.start)


# Drift-free features of a log: what one settled cycle of it looks like. The period, and the mean waveform folded around
# the fall, every cycle shifted onto the mean by its own samples: drifting levels and loads leave them alone.

BINS = 40  # per half natural period
BEFORE, AFTER = 2.5, 2.0  # half periods around the middle of the fall
SHARE = 0.42  # of the period: the window never reaches the next fall
TIMING = 0.3  # of the time between samples: how well they tell a time


@dataclass(frozen=True)
class Features:
    """One settled cycle of one log. times (b,) [s] from the middle of the fall, waveform (b,) [N] at the mean
    normal force, sd (b,); period [s] and its sd (period_sd infinite where a log shows one fall only); arrest:
    valley force [N]; drop [N]; time of its middle cycle [s]."""

    drive_speed: float
    normal_force: float
    times: Array
    waveform: Array
    sd: Array
    period: float
    period_sd: float
    arrest: float
    drop: float
    time: float


def extract(log: LogData, slip_times: Array, half_period: float) -> Features | None:
    """The features of a log, or None without a fall that can be folded.

    Args:
        slip_times: mid-fall times of its cycles (c,) [s].
        half_period: half the natural period [s].
    """
    if slip_times.size == 0:
        return None
    settled, periods = slip_times[1:] if slip_times.size >= 3 else slip_times, np.diff(slip_times)
    period = float(np.median(periods)) if periods.size else np.inf
    width = half_period / BINS
    lower, upper = -min(BEFORE * half_period, SHARE * period), min(AFTER * half_period, SHARE * period)
    edges = np.arange(np.floor(lower / width), np.ceil(upper / width) + 1) * width
    centres, bins = 0.5 * (edges[:-1] + edges[1:]), edges.size - 1
    local, force, weight, cycle = _fold(log, settled, edges)
    if local.size < 4:
        return None

    def per_cycle(values: Array) -> Array:
        return np.asarray(np.bincount(cycle, weights=values, minlength=settled.size), float)

    shift = np.zeros(settled.size)
    for sweep in range(4):
        index = np.floor((local - shift[cycle] - edges[0]) / width).astype(int)
        inside = (index >= 0) & (index < bins)
        count = np.bincount(index[inside], weights=weight[inside], minlength=bins)
        used = count > 0
        if np.count_nonzero(used) < 4:
            return None
        summed = np.bincount(index[inside], weights=(weight * force)[inside], minlength=bins)
        mean, times = summed[used] / count[used], centres[used]
        if sweep == 3:
            break
        # The level of every cycle onto the mean, then a Gauss-Newton step of its shift; their averages stay.
        value = np.interp(local - shift[cycle], times, mean)
        slope = np.interp(local - shift[cycle], times, np.gradient(mean, times))
        level = per_cycle(weight * (force - value)) / np.maximum(per_cycle(weight), 1e-300)
        force = force - (level - np.mean(level))[cycle]
        move = per_cycle(weight * slope * (value - force)) / np.maximum(per_cycle(weight * slope**2), 1e-300)
        move = np.clip(move, -5 * width, 5 * width)
        shift = shift + move - np.mean(move)
    drop, interval = float(np.ptp(mean)), log.interval
    # Where a fall holds few samples they do not tell when it was, and the mean of many is smeared.
    smeared = TIMING * interval * min(interval / half_period, 1.0) ** 2 * np.gradient(mean, edges[:-1][used])
    period_sd = 0.003 * period + TIMING * interval / np.sqrt(max(periods.size, 1)) if periods.size else np.inf
    if periods.size > 2:
        period_sd = max(period_sd, 1.25 * float(np.std(periods[1:])) / np.sqrt(periods.size - 1))
    return Features(
        log.drive_speed,
        float(np.mean(log.normal_force.at(settled))),
        times,
        mean,
        np.hypot(np.hypot(count[used] ** -0.5, 0.01 * drop), smeared),
        period,
        float(period_sd),
        float(np.min(mean)),
        drop,
        float(np.mean(settled)),
    )


def _fold(log: LogData, slip_times: Array, edges: Array) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Samples around each fall: local time, force at the mean normal force, weight, cycle."""
    first = np.searchsorted(log.time, slip_times + edges[0])
    lengths = np.maximum(np.searchsorted(log.time, slip_times + edges[-1]) - first, 0)
    ends = np.cumsum(lengths)
    number = np.arange(0, int(ends[-1]), max(int(ends[-1]) // (1 << 14), 1))
    cycle = np.searchsorted(ends, number, side="right")
    index = number + (first - (ends - lengths))[cycle]
    cycle, index = cycle[log.weight[index] > 0], index[log.weight[index] > 0]
    load = log.normal_force.at(slip_times)
    force = log.force[index] * (np.mean(load) / load)[cycle]
    return log.time[index] - slip_times[cycle], force, log.weight[index], cycle


# The start of a fit from the data alone: many small least-squares fits of one settled cycle per log.
#
# Unknowns of each: the search variables, and per log the arrest force and a time shift. One cycle is simulated from the
# arrest force; that it ends at the same force is one more residual, so no limit cycle is iterated. Levenberg-Marquardt
# runs for all starts at once; all their perturbations are rows of one batch.

PER_HALF_PERIOD = 24  # steps of a slip in the start fit
GOOD = 1.0  # cost per residual of a start that is right
KEPT = 3  # candidates that are followed to the end; as soon as so many leave nothing to explain, the others no further
BAD_RESIDUAL = 30.0  # what a cycle that never comes to rest counts as, in standard deviations


@dataclass(frozen=True)
class Start:
    """One candidate: theta (n_p,), and its cost per residual (0.5 when right, above 20 when wrong)."""

    theta: Array
    cost: float


class _FeatureFit:
    """The residuals of all features as functions of the unknowns, for many candidates at once."""

    def __init__(self, unknowns: Unknowns, features: list[Features], bases: list[Array]) -> None:
        # The features are those of the force at the drive, wherever it was measured.
        self.unknowns, self.features, self.model = unknowns, features, assemble(unknowns.model.effects)
        self.free = np.flatnonzero(unknowns.free)
        self.base = np.stack(bases)  # (L, n_p)
        self.n_theta, self.n_logs = self.free.size, len(features)
        prior = np.isfinite(unknowns.prior_sd[self.free])
        self.mean = np.where(prior, unknowns.prior_mean[self.free], 0.0)
        self.prior_sd = np.where(prior, unknowns.prior_deviation[self.free], np.inf)
        self.drops = np.array([f.drop for f in features])
        width = max(f.times.size for f in features)
        self.times, self.wave, self.weight = np.zeros((3, self.n_logs, width))
        for i, f in enumerate(features):
            self.times[i, : f.times.size], self.wave[i, : f.times.size] = f.times, f.waveform
            self.weight[i, : f.times.size] = 1.0 / f.sd
        self.period = np.array([f.period if np.isfinite(f.period_sd) else 0.0 for f in features])
        self.period_weight = np.array([1.0 / f.period_sd for f in features])
        self.u = np.stack([[f.drive_speed, f.normal_force, 1.0, f.time] for f in features])
        self.count = int(np.count_nonzero(self.weight)) + 2 * self.n_logs  # residuals that count

    def residuals(self, theta: Array, arrest: Array, shift: Array) -> tuple[Array, Array]:
        """theta (S, n_p), arrest (S, L) [N], shift (S, L) [s] -> residuals (S, L, width + 2), and the slope
        of the waveform part with respect to the shift, same shape."""
        model, s = self.model, theta.shape[0]
        p = self.unknowns.values(theta[:, None, :], self.base[None]).reshape(s * self.n_logs, -1)
        u, weight = np.tile(self.u, (s, 1)), np.tile(self.weight, (s, 1))
        stick, at_onset, _ = sticks(model, batch.at_force(model, arrest.ravel(), p, u), p, u, forward=True)
        slips = batch.slip(model, at_onset, p, u, PER_HALF_PERIOD)  # the time of day hardly moves in a cycle
        ok = slips.rested & np.isfinite(stick)
        waves, middle = Waves.of_slips(model, slips, p, u, ok)
        # The middle of the simulated fall is the origin; its position is found on the simulated steps.
        value, slope = waves.with_rates(np.tile(self.times, (s, 1)) + shift.reshape(-1, 1) + middle[:, None])
        period = (stick + waves.duration - np.tile(self.period, s)) * np.tile(self.period_weight, s)
        # Arrest forces must agree to a hundredth of the drop.
        closure = (waves.end - arrest.ravel()) / (0.01 * np.tile(self.drops, s))
        out = np.column_stack([(value - np.tile(self.wave, (s, 1))) * weight, period, closure])
        by_shift = np.pad(slope * weight, ((0, 0), (0, 2)))
        out[~ok, :-2] = np.where(weight[~ok] > 0, BAD_RESIDUAL, 0.0)
        out[~ok, -2:], by_shift[~ok] = BAD_RESIDUAL, 0.0
        shape = (s, self.n_logs, -1)
        return np.clip(np.nan_to_num(out, nan=BAD_RESIDUAL), -1e4, 1e4).reshape(shape), by_shift.reshape(shape)

    def linearised(
        self, soft: tuple[Array, Array], theta: Array, arrest: Array, shift: Array
    ) -> tuple[Array, Array, Array]:
        """Half cost (S,), gradient (S, n) and Gauss-Newton curvature (S, n, n), by rows with one thing changed each;
        soft: mean and sd of weak priors (S, f)."""
        s, n_t, n_l = theta.shape[0], self.n_theta, self.n_logs
        steps, force_step = 1e-4 * self.unknowns.spread[self.free], 1e-4 * self.drops
        thetas = np.repeat(theta[None], n_t + 2, axis=0)
        thetas[np.arange(n_t) + 1, :, self.free] += steps[:, None]
        arrests = np.repeat(arrest[None], n_t + 2, axis=0)
        arrests[-1] += force_step
        rows = thetas.reshape(-1, theta.shape[1]), arrests.reshape(-1, n_l), np.tile(shift, (n_t + 2, 1))
        r, by_shift = (q.reshape(n_t + 2, s, n_l, -1) for q in self.residuals(*rows))
        cost, n = 0.5 * np.sum(r[0] ** 2, axis=(1, 2)), n_t + 2 * n_l
        gradient, curvature = np.zeros((s, n)), np.zeros((s, n, n))
        by_theta = (r[1:-1] - r[0]) / steps[:, None, None, None]
        for log in range(n_l):
            columns = np.concatenate([np.arange(n_t), [n_t + log, n_t + n_l + log]])
            by_arrest = (r[-1][:, log] - r[0][:, log]) / force_step[log]
            slopes = [by_theta[:, :, log].transpose(1, 0, 2), by_arrest[:, None], by_shift[0][:, log][:, None]]
            jacobian = np.concatenate(slopes, axis=1)
            curvature[np.ix_(np.arange(s), columns, columns)] += np.matmul(jacobian, jacobian.transpose(0, 2, 1))
            gradient[:, columns] += np.matmul(jacobian, r[0][:, log, :, None])[..., 0]
        for mean, sd in (soft, (self.mean, self.prior_sd)):
            off = (theta[:, self.free] - mean) / sd
            cost = cost + 0.5 * np.sum(off**2, axis=1)
            gradient[:, :n_t] += off / sd
            curvature[:, np.arange(n_t), np.arange(n_t)] += 1.0 / sd**2
        return cost, gradient, curvature


def candidates(unknowns: Unknowns, features: list[Features], bases: list[Array]) -> Array:
    """Starts (S, n_p) from the levels of the data: strength, drop, period; a grid over what levels do not tell."""
    load, drop, arrest = (np.array([getattr(f, name) for f in features]) for name in ("normal_force", "drop", "arrest"))
    top, largest = float(np.max((arrest + drop) / load)), int(np.argmax(drop))
    period = np.array([f.period if np.isfinite(f.period) else 1.0 for f in features])
    share = drop / load / np.max(drop / load)
    tellable = (share > 0.05) & (share < 0.97)
    times = float(np.min(period)) / np.array([3.0, 0.2])  # levels at one speed do not determine it
    if np.any(tellable):
        times = np.exp(np.mean(np.log(-period[tellable] / np.log1p(-share[tellable])), keepdims=True))
    names, base = unknowns.names, bases[largest]
    value = dict(zip(names, unknowns.values(unknowns.start, base).tolist(), strict=True))
    relative, length = drop[largest] / load[largest], drop[largest] / value["stiffness"]
    peak_speed = 0.5 * drop[largest] / np.sqrt(value["stiffness"] * value.get("mass", 0.2))
    rows = []
    for a_v, share_d, weakening, t_cr in product((1.7, 6.0), (0.08, 0.18), (0.1, 0.27), times.tolist()):
        mu_k0 = max(top - 0.5 * relative * (1 - 0.7 * weakening), 0.2 * top)
        mu_s = mu_k0 + (top - mu_k0) / -np.expm1(-np.max(period) / t_cr)
        one = value | {"mu_s": mu_s, "mu_k0": mu_k0, "delta_mu_k": -weakening * relative, "a": a_v / peak_speed}
        one |= {"D": share_d * length, "t_cr": t_cr}
        rows.append([one[name] for name in names])
    return _inside(unknowns, unknowns.theta(np.array(rows), base))


def random_starts(unknowns: Unknowns, around: Array, count: int, seed: int) -> Array:
    """Starts (count, n_p) scattered by a factor of about three around a candidate (n_p,)."""
    rng = np.random.default_rng(seed)
    spread = np.where(unknowns.logarithmic, 1.0, 0.1) * rng.standard_normal((count, around.size))
    rig = np.isin(unknowns.names, ("mass", "stiffness", "damping"))
    return _inside(unknowns, around + np.where(rig, 0.1, 1.0) * spread)


def fit_features(
    unknowns: Unknowns, features: list[Features], bases: list[Array], starts: Array, *, keep: int = KEPT
) -> list[Start]:
    """Fit the features from every start at once; the results in order of cost.

    Args:
        bases: per feature, the base values of its log (n_p,).
        starts: (S, n_p) theta; keep: of these that are followed to the end.
    """
    fold, theta = _FeatureFit(unknowns, features, bases), _inside(unknowns, starts)
    n_t, n_l, free, spread = fold.n_theta, fold.n_logs, fold.free, unknowns.spread[fold.free]
    # Weak priors of the start fit: the start itself, within a factor of some five.
    rig = np.isin(np.array(unknowns.names)[free], ("mass", "stiffness", "damping"))
    soft_mean, soft_sd = starts[:, free], np.where(rig, 0.3, 3.0 * spread)
    arrest = np.tile([f.arrest for f in features], (theta.shape[0], 1)).astype(float)
    moving = [theta, arrest, np.zeros((theta.shape[0], n_l))]
    point, damping = [*fold.linearised((soft_mean, soft_sd), *moving)], np.full(theta.shape[0], 1e-2)
    for iteration in range(14):
        cost, gradient, curvature = point
        scale = np.einsum("sii->si", curvature)
        damped = curvature + (damping[:, None] * scale + 1e-12)[:, :, None] * np.eye(scale.shape[1])
        move = -np.linalg.solve(damped, gradient[..., None])[..., 0]
        move /= np.maximum(np.max(np.abs(move[:, :n_t]) / (3 * spread), axis=1, initial=1.0), 1.0)[:, None]
        theta = moving[0].copy()
        theta[:, free] += move[:, :n_t]
        moved = [_inside(unknowns, theta), moving[1] + move[:, n_t : n_t + n_l], moving[2] + move[:, n_t + n_l :]]
        new = fold.linearised((soft_mean, soft_sd), *moved)
        better = new[0] < cost
        gain = np.where(better, cost - new[0], 0.0)
        moving, point = (
            [np.where(better.reshape(-1, *(1 for _ in a.shape[1:])), a, b) for a, b in zip(after, before, strict=True)]
            for after, before in ((moved, moving), (new, point))
        )
        damping = np.clip(np.where(better, damping * 0.2, damping * 5.0), 1e-8, 1e4)
        # Nothing is left to explain; where an effect lacks, candidates differ in what they make up for it with.
        right = int(np.count_nonzero(2 * point[0] < 0.4 * fold.count)) >= keep
        if (iteration >= 4 or right) and better.size > keep:
            kept = np.argsort(point[0])[: keep if right else max(keep, better.size // 3)]
            moving, point = [a[kept] for a in moving], [a[kept] for a in point]
            damping, soft_mean, gain = damping[kept], soft_mean[kept], gain[kept]
        if (iteration > 5 or right) and np.all(gain < 1e-3 * point[0]):
            break
    return [Start(moving[0][i], float(2 * point[0][i] / fold.count)) for i in np.argsort(point[0])]
