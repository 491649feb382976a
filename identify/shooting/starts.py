"""Starts from the data alone: many small fits of one settled cycle; from levels where no log repeats its cycles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from identify.logs.fit_mode import moving_pieces
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting import batch
from identify.shooting.features import Features, Waves
from identify.simulation.drive import Drive

Array = NDArray[np.float64]

TAIL = 0.4  # of a stretch of constant speed: where its level is taken
STEP = 0.15  # of a static coefficient above the kinetic one where no peak is seen
LEAST_STEP = 0.02
LENGTHS = (10e-6, 40e-6)  # D [m]
TIMES = (0.2, 1.0, 5.0)  # t_cr [s]


def level_starts(logs: Sequence[Prepared], unknowns: Unknowns) -> Array:
    """Theta (S, n_p) of starts from the levels of logs."""
    speeds, levels = _levels(logs)
    top = max(float(np.nanquantile(_coefficient(log), 0.999)) for log in logs)
    base = logs[0].data.base
    names = unknowns.names
    value = dict(zip(names, unknowns.values(unknowns.start, base).tolist(), strict=True))
    slow, fast = int(np.argmin(speeds)), int(np.argmax(speeds))
    known = {}
    if speeds[fast] > 1.5 * speeds[slow] and "delta_mu_k" in names:
        known["a"] = 2.0 / speeds[fast]
        known["delta_mu_k"] = min(1.2 * (levels[fast] - levels[slow]), -0.005)
    weakened = known.get("delta_mu_k", value.get("delta_mu_k", 0.0))
    share = 1.0 - np.exp(-known.get("a", value.get("a", 0.0)) * speeds[slow])
    mu_k0 = max(float(levels[slow]) - weakened * float(share), 0.01)
    peaked = any(log.fit_mode.name == "continuous" for log in logs)
    mu_s = max(top, mu_k0 + LEAST_STEP) if peaked else mu_k0 + STEP
    rows = []
    for length, time in product(LENGTHS, TIMES):
        made = value | known | {"mu_s": mu_s, "mu_k0": mu_k0, "D": length, "t_cr": time}
        rows.append([made[name] for name in names])
        if not peaked:
            break
    theta = unknowns.theta(np.array(rows), base)
    inside = np.clip(np.where(np.isfinite(theta), theta, unknowns.start), unknowns.lower, unknowns.upper)
    return np.unique(np.where(unknowns.free, inside, unknowns.start), axis=0)


def _coefficient(log: Prepared) -> Array:
    """Friction over normal force of the samples that count (n,)."""
    data = log.data
    mine = (data.weight > 0) & (data.time >= data.begin) & (data.time <= data.end)
    return np.asarray(data.force[mine] / data.normal_force.at(data.time[mine]))


def _levels(logs: Sequence[Prepared]) -> tuple[Array, Array]:
    """Speeds [m/s] and coefficients at the end of every stretch of constant speed."""
    speeds, levels = [], []
    for log in logs:
        data = log.data
        drive = data.programme or Drive((0.0,), (data.drive_speed,))
        for start, stop, speed in moving_pieces(drive, data.begin, data.end):
            mine = (data.time >= stop - TAIL * (stop - start)) & (data.time <= stop) & (data.weight > 0)
            if np.count_nonzero(mine) >= 3:
                speeds.append(speed)
                levels.append(float(np.median(data.force[mine] / data.normal_force.at(data.time[mine]))))
    if not speeds:
        return np.array([logs[0].data.drive_speed]), np.array([float(np.median(_coefficient(logs[0])))])
    return np.array(speeds), np.array(levels)


# ----------------------------------------------------------------------------------------------------------------------
# The start of a fit from the data alone: many small least-squares fits of one settled cycle per log.
#
# Unknowns of each: the search variables, and per log the arrest force and a time shift. One cycle is simulated from the
# arrest force; that it ends at the same force is one more residual, so no limit cycle is iterated. Of a drive programme
# every slip is simulated from the force at which the rest before it begins, through the holds, to that after it: how it
# grows with the rest tells strength and ageing apart, which cycles of one speed do not. Levenberg-Marquardt runs for
# all starts at once; all their perturbations are rows of one batch.
# ----------------------------------------------------------------------------------------------------------------------

PER_HALF_PERIOD = 24  # steps of a slip in the start fit
ITERATIONS = 14
CLOSURE = 0.01  # of the drop: how well arrest forces must agree
GOOD = 1.0  # cost per residual of a start that is right
KEPT = 3  # candidates that are followed to the end; as soon as so many leave nothing to explain, the others no further
NOTHING_LEFT = 0.4  # cost per residual: where an effect lacks, candidates differ in what they make up for it with
BAD_RESIDUAL = 30.0  # what a cycle that never comes to rest counts as, in standard deviations


@dataclass(frozen=True)
class Start:
    """One candidate: theta (n_p,), and its cost per residual (0.5 when right, above 20 when wrong)."""

    theta: Array
    cost: float


class _FeatureFit:
    """The residuals of all features as functions of the unknowns, for many candidates at once. A slip that is like no
    other starts and ends at the forces that the log shows, in place of those that its own cycle repeats."""

    def __init__(self, unknowns: Unknowns, features: list[Features], bases: list[Array]) -> None:
        self.unknowns, self.features = unknowns, features
        self.free = np.flatnonzero(unknowns.free)
        self.base = np.stack(bases)  # (L, n_p)
        self.n_theta, self.n_logs = self.free.size, len(features)
        prior = np.isfinite(unknowns.prior_sd[self.free])
        self.mean = np.where(prior, unknowns.prior_mean[self.free], 0.0)
        self.prior_sd = np.where(prior, unknowns.prior_deviation[self.free], np.inf)
        self.drops = np.array([f.drop for f in features])
        self.width = max(f.times.size for f in features)
        shape = (self.n_logs, self.width)
        self.times, self.wave, self.weight = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        for i, f in enumerate(features):
            self.times[i, : f.times.size], self.wave[i, : f.times.size] = f.times, f.waveform
            self.weight[i, : f.times.size] = 1.0 / f.sd
        self.period = np.array([f.period if np.isfinite(f.period_sd) else 0.0 for f in features])
        self.period_weight = np.array([1.0 / f.period_sd for f in features])
        self.u = np.stack([[f.drive_speed, f.normal_force, 1.0, f.time] for f in features])
        # Of slips that are like no other: the force at the ends, speeds and seconds of the legs of the rest before.
        self.settled = np.array([f.settled for f in features])
        self.begun_at, self.after = np.array([f.arrest for f in features]), np.array([f.after for f in features])
        most = max(len(f.legs) for f in features)
        padded = [[*f.legs, *[(f.drive_speed, 0.0)] * (most - len(f.legs))] for f in features]
        self.legs = np.array(padded).reshape(self.n_logs, most, 2).transpose(1, 2, 0)  # (legs, 2, L)
        first = self.legs[0, 0] if len(self.legs) else self.u[:, 0]
        self.u_begin = np.column_stack([first, self.u[:, 1:]])

    @property
    def count(self) -> int:
        """Number of residuals that count."""
        return int(np.count_nonzero(self.weight)) + 2 * self.n_logs

    def residuals(self, theta: Array, arrest: Array, shift: Array) -> tuple[Array, Array]:
        """theta (S, n_p), arrest (S, L) [N], shift (S, L) [s] -> residuals (S, L, width + 2), and the slope
        of the waveform part with respect to the shift, same shape."""
        model = self.unknowns.model
        s = theta.shape[0]
        p = self.unknowns.values(theta[:, None, :], self.base[None]).reshape(s * self.n_logs, -1)
        u = np.tile(self.u, (s, 1))
        arrest = np.where(self.settled, arrest, self.begun_at)
        x, before = batch.at_force(model, arrest.ravel(), p, np.tile(self.u_begin, (s, 1))), np.zeros(u.shape[0])
        for speed, seconds in self.legs:
            leg = np.tile(np.column_stack([speed, self.u[:, 1:]]), (s, 1))
            x, before = batch.rested(model, x, p, leg, np.tile(seconds, s)), before + np.tile(seconds, s)
        stick, at_onset = batch.stick(model, x, p, u)
        slips = batch.slip(model, at_onset, p, u, PER_HALF_PERIOD)  # settled: the time of day hardly moves in a cycle
        ok = slips.rested & np.isfinite(stick)
        waves, middle = Waves.of_slips(model, slips, p, u, ok)
        duration, end_force = waves.duration, waves.end
        # The middle of the simulated fall is the origin; its position is found on the simulated steps.
        t = np.tile(self.times, (s, 1)) + shift.reshape(-1, 1) + middle[:, None]
        value, slope = waves.with_rates(t)
        out = np.empty((s * self.n_logs, self.width + 2))
        d_shift = np.zeros_like(out)
        weight = np.tile(self.weight, (s, 1))
        out[:, :-2] = (value - np.tile(self.wave, (s, 1))) * weight
        d_shift[:, :-2] = slope * weight
        settled, after = np.tile(self.settled, s), np.tile(self.after, s)
        taken = before + stick + np.where(settled, duration, middle)
        out[:, -2] = (taken - np.tile(self.period, s)) * np.tile(self.period_weight, s)
        ends = np.where(settled, arrest.ravel(), np.where(np.isfinite(after), after, end_force))
        out[:, -1] = (end_force - ends) / (CLOSURE * np.tile(self.drops, s))
        bad = ~ok
        out[bad, :-2] = np.where(weight[bad] > 0, BAD_RESIDUAL, 0.0)
        out[bad, -2:], d_shift[bad] = BAD_RESIDUAL, 0.0
        shape = (s, self.n_logs, self.width + 2)
        return np.clip(np.nan_to_num(out, nan=BAD_RESIDUAL), -1e4, 1e4).reshape(shape), d_shift.reshape(shape)


def candidates(unknowns: Unknowns, features: list[Features], bases: list[Array]) -> Array:
    """Starts (S, n_p) from the levels of the data: strength, drop, period; a grid over what levels do not tell."""
    names = unknowns.names
    load = np.array([f.normal_force for f in features])
    drop = np.array([f.drop for f in features])
    top = max((f.arrest + f.drop) / f.normal_force for f in features)
    largest = int(np.argmax(drop))
    period = np.array([f.period if np.isfinite(f.period) else 1.0 for f in features])
    share = drop / load / np.max(drop / load)
    tellable = (share > 0.05) & (share < 0.97)
    t_cr = float(np.min(period) / 3)
    if np.any(tellable):
        t_cr = float(np.exp(np.mean(np.log(-period[tellable] / np.log1p(-share[tellable])))))
    value = {n: unknowns.values(unknowns.start, bases[largest])[i] for i, n in enumerate(names)}
    relative = drop[largest] / load[largest]
    peak_speed = 0.5 * drop[largest] / np.sqrt(value["stiffness"] * value.get("mass", 0.2))
    stretch = drop[largest] / value["stiffness"]
    out = []
    for a_v in (1.7, 6.0):
        for share_d in (0.08, 0.18):
            for weakening in (0.1, 0.27):
                step = 0.5 * relative * (1 - 0.7 * weakening)
                out.append(
                    value
                    | {
                        "mu_s": top,
                        "mu_k0": max(top - step, 0.2 * top),
                        "delta_mu_k": -weakening * relative,
                        "a": a_v / peak_speed,
                        "D": share_d * stretch,
                        "t_cr": t_cr,
                    }
                )
    made = np.array([[c[n] for n in names] for c in out])
    return _inside(unknowns, unknowns.theta(made, bases[largest]))


def _inside(unknowns: Unknowns, theta: Array) -> Array:
    """Theta within its bounds, and fixed where it is not free."""
    finite = np.where(np.isfinite(theta), theta, unknowns.start)
    return np.where(unknowns.free, np.clip(finite, unknowns.lower, unknowns.upper), unknowns.start)


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
    fold = _FeatureFit(unknowns, features, bases)
    theta = _inside(unknowns, starts)
    n_t, n_l, free, spread = fold.n_theta, fold.n_logs, fold.free, unknowns.spread[fold.free]
    # Weak priors of the start fit: the start itself, within a factor of some five.
    rig = np.isin(np.array(unknowns.names)[free], ("mass", "stiffness", "damping"))
    soft_mean, soft_sd = starts[:, free], np.where(rig, 0.3, 3.0 * spread)
    arrest = np.tile([f.arrest for f in features], (theta.shape[0], 1)).astype(float)
    moving = [theta, arrest, np.zeros((theta.shape[0], n_l))]
    point, damping = [*_linearise(fold, (soft_mean, soft_sd), *moving)], np.full(theta.shape[0], 1e-2)
    for iteration in range(ITERATIONS):
        cost, gradient, curvature = point
        scale = np.einsum("sii->si", curvature)
        damped = curvature + (damping[:, None] * scale + 1e-12)[:, :, None] * np.eye(scale.shape[1])
        move = -np.linalg.solve(damped, gradient[..., None])[..., 0]
        move /= np.maximum(np.max(np.abs(move[:, :n_t]) / (3 * spread), axis=1, initial=1.0), 1.0)[:, None]
        theta = moving[0].copy()
        theta[:, free] += move[:, :n_t]
        moved = [_inside(unknowns, theta), moving[1] + move[:, n_t : n_t + n_l], moving[2] + move[:, n_t + n_l :]]
        new = _linearise(fold, (soft_mean, soft_sd), *moved)
        better = new[0] < cost
        gain = np.where(better, cost - new[0], 0.0)
        moving, point = (
            [np.where(better.reshape(-1, *(1 for _ in a.shape[1:])), a, b) for a, b in zip(after, before, strict=True)]
            for after, before in ((moved, moving), (new, point))
        )
        damping = np.clip(np.where(better, damping * 0.2, damping * 5.0), 1e-8, 1e4)
        right = int(np.count_nonzero(2 * point[0] < NOTHING_LEFT * fold.count)) >= keep
        if (iteration >= 4 or right) and better.size > keep:
            kept = np.argsort(point[0])[: keep if right else max(keep, better.size // 3)]
            moving, point = [a[kept] for a in moving], [a[kept] for a in point]
            damping, soft_mean, gain = damping[kept], soft_mean[kept], gain[kept]
        if (iteration > 5 or right) and np.all(gain < 1e-3 * point[0]):
            break
    return [Start(moving[0][i], float(2 * point[0][i] / fold.count)) for i in np.argsort(point[0])]


def _linearise(
    fold: _FeatureFit, soft: tuple[Array, Array], theta: Array, arrest: Array, shift: Array
) -> tuple[Array, Array, Array]:
    """Half cost (S,), gradient (S, n) and Gauss-Newton curvature (S, n, n), by rows with one thing changed each."""
    s, n_t, n_l = theta.shape[0], fold.n_theta, fold.n_logs
    steps = 1e-4 * fold.unknowns.spread[fold.free]
    force_step = 1e-4 * fold.drops
    lanes_theta, lanes_arrest = [theta], [arrest]
    for i, column in enumerate(fold.free):
        moved = theta.copy()
        moved[:, column] += steps[i]
        lanes_theta.append(moved)
        lanes_arrest.append(arrest)
    lanes_theta.append(theta)
    lanes_arrest.append(arrest + force_step)
    all_r, all_d = fold.residuals(
        np.concatenate(lanes_theta), np.concatenate(lanes_arrest), np.tile(shift, (n_t + 2, 1))
    )
    r = all_r.reshape(n_t + 2, s, n_l, -1)
    base, d_shift = r[0], all_d.reshape(n_t + 2, s, n_l, -1)[0]
    n = n_t + 2 * n_l
    gradient, curvature = np.zeros((s, n)), np.zeros((s, n, n))
    d_theta = (r[1 : n_t + 1] - base) / steps[:, None, None, None]
    cost = 0.5 * np.sum(base**2, axis=(1, 2))
    for log in range(n_l):
        columns = np.concatenate([np.arange(n_t), [n_t + log, n_t + n_l + log]])
        d_arrest = (r[n_t + 1][:, log] - base[:, log]) / force_step[log]
        jac = np.concatenate(
            [d_theta[:, :, log].transpose(1, 0, 2), d_arrest[:, None], d_shift[:, log][:, None]], axis=1
        )
        curvature[np.ix_(np.arange(s), columns, columns)] += np.matmul(jac, jac.transpose(0, 2, 1))
        gradient[:, columns] += np.matmul(jac, base[:, log, :, None])[..., 0]
    for mean, sd in (soft, (fold.mean, fold.prior_sd)):
        off = (theta[:, fold.free] - mean) / sd
        cost = cost + 0.5 * np.sum(off**2, axis=1)
        gradient[:, :n_t] += off / sd
        curvature[:, np.arange(n_t), np.arange(n_t)] += 1.0 / sd**2
    return cost, gradient, curvature
