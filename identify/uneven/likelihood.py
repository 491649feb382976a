"""The likelihood of a record whose cycles differ: slips are filtered, strength and level of a stick integrated out.

Forces are over the load. A stick met at a level l has strength A, its onset is at l + A; A scatters about the strength
g(T) that the contact has regained after a rest T. Sliding by u takes friction to l + b(u) + x(u) + A h(u/g): b is
Brownian along the track and goes on under the next stick, x (Ornstein-Uhlenbeck) is fine roughness, h the law of
weakening. For every cycle the likelihood is computed on nodes of A; between cycles the level is matched by its moments.

The functions here take parameters as arrays (7, p): p sets at once, so that differences between neighbouring sets cost
one pass. Arrays in a slip are flat, cycles outermost, so that those still sliding are a leading slice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.uneven.events import Rig, Sticks

Array = NDArray[np.float64]

# Logarithms of these are searched, in this order.
PARAMETERS = ("strength", "weakening_rate", "t_cr", "mass", "level_wander", "strength_scatter", "level_roughness")
ROUGHNESS_LENGTH = 6e-6  # [m] 3 to 8 um fit measured records about equally
ROUNDED = 0.05  # of the strength: over which the end of the weakening is rounded, for the sake of second derivatives
START_SPEED = (0.5, 0.3)  # sd of the speed at the first sample: of itself, and of the drive speed
HUBER = 4.0  # sd beyond which an innovation counts by its size, not its square
ODD, ODD_WANDER = 0.05, 4.0  # share of odd slips, and by how much more their level wanders
FIRST_LEVEL = 1.0  # of the drop: sd of the level where no cycle is seen before
LEAST_HAZARD = 0.02  # of kappa / A: a spot is met, however fast the contact strengthens


@dataclass(frozen=True)
class Nodes:
    """Where the likelihood of every cycle is computed: log_strength (c, n), evenly spaced per cycle."""

    log_strength: Array

    @property
    def step(self) -> Array:
        """Between neighbouring nodes (c,)."""
        return (self.log_strength[:, -1] - self.log_strength[:, 0]) / (self.log_strength.shape[1] - 1)

    @staticmethod
    def wide(sticks: Sticks, count: int = 25) -> Nodes:
        """From 8 % of the drop to 140 % of it: an undamped slip falls by twice the strength if the level stays."""
        log_drop = np.log(np.maximum(sticks.drop, 1e-6))
        return Nodes(log_drop[:, None] + np.linspace(np.log(0.08), np.log(1.4), count))

    @staticmethod
    def about(mean: Array, sd: Array, count: int = 13) -> Nodes:
        """As far as a strength with this mean and sd of its logarithm, each (c,), may lie."""
        return Nodes(mean[:, None] + sd[:, None] * np.linspace(-5.0, 5.0, count))


@dataclass(frozen=True)
class Cycles:
    """What the likelihood finds of every cycle, each (c, p): log_likelihood given all before; and once the cycle itself
    was seen: log_strength of the stick with its deviation, level at the onset and after the slip, odd: the probability
    that the slip is."""

    log_likelihood: Array
    log_strength: Array
    log_strength_sd: Array
    level: Array
    level_after: Array
    odd: Array


def log_likelihood(sticks: Sticks, nodes: Nodes, theta: Array) -> Cycles:
    """Of every cycle, given those before.

    Args:
        theta: logarithms of PARAMETERS (7, p), SI, mass over the load [s^2/m].
    """
    met = _Met.of(sticks, theta)
    slips = _filtered(sticks, nodes, met, theta)
    return _chained(sticks, nodes, met, slips, theta)


@dataclass(frozen=True)
class _Met:
    """Onsets (c, p): force [1], time from there to the anchor [s], speed at the anchor [m/s]; regained strength g [1]
    and its rate [1/s]."""

    force: Array
    earlier: Array
    speed: Array
    regained: Array
    rate: Array

    @staticmethod
    def of(sticks: Sticks, theta: Array) -> _Met:
        strength, weakening, creep, mass = np.exp(theta[:4])
        earlier, speed = onset_motion(sticks.slid, sticks.rig, weakening, mass)
        force = sticks.line[:, None] - sticks.rig.rate * earlier
        typical = sticks.typical_rest if np.isfinite(sticks.rest).any() else 1.0
        rest = np.where(np.isfinite(sticks.rest), sticks.rest, typical)[:, None] - earlier
        rest = np.maximum(rest, 1e-3 * typical)
        full = strength / -np.expm1(-typical / creep)
        # What the slip before left, at a strength of half its drop: nothing, but after the shortest slips.
        left = np.maximum(0.5 * sticks.drop[:, None] - weakening * sticks.end[:, None], 0.0)
        left = np.vstack([np.zeros(mass.size), left[:-1]]) * sticks.follows[:, None]
        fading = np.exp(-rest / creep)
        regained = -full * np.expm1(-rest / creep) + left * fading
        rate = np.where(sticks.follows[:, None], np.maximum(full - left, 0.0) * fading / creep, 0.0)
        return _Met(force, earlier, speed, regained, rate)


def onset_motion(slid: Array, rig: Rig, weakening: Array, mass: Array) -> tuple[Array, Array]:
    """Time (c, p) [s] from rest until the mass has slid so far (c,) [m], and its speed then [m/s].

    Near the onset m u'' + c u' - (w - k) u = kappa t, from rest; u grows with t whatever the sign of w - k.
    """
    excess = weakening - rig.stiffness
    excess = np.where(np.abs(excess) < 1e-4 * rig.stiffness, 1e-4 * rig.stiffness, excess)
    root = np.sqrt(rig.damping**2 + 4.0 * mass * excess + 0j)
    fast, slow = (-rig.damping + root) / (2.0 * mass), (-rig.damping - root) / (2.0 * mass)
    sum_, slope = rig.rate * rig.damping / excess**2, rig.rate / excess
    first = (slope - slow * sum_) / (fast - slow)
    second = sum_ - first
    target = np.maximum(slid, 1e-12)[:, None]
    time = np.cbrt(6.0 * mass * target / rig.rate)
    for _ in range(12):
        one, two = first * np.exp(fast * time), second * np.exp(slow * time)
        there = (one + two).real - slope * time - sum_
        speed = np.maximum((fast * one + slow * two).real - slope, 1e-3 * rig.drive_speed)
        time = np.maximum(time - (there - target) / speed, 0.2 * time)
    one, two = first * np.exp(fast * time), second * np.exp(slow * time)
    return time, np.maximum((fast * one + slow * two).real - slope, 1e-3 * rig.drive_speed)


def weakened(reach: Array) -> tuple[Array, Array]:
    """Law of weakening: share of the strength left after a share of the sliding that takes it all, and its slope."""
    left = 1.0 - reach
    root = np.sqrt(left * left + ROUNDED**2)
    return 0.5 * (left + root), -0.5 * (1.0 + left / root)


@dataclass(frozen=True)
class _Slips:
    """Filtered slips (c, n, 2, p), usual and odd: log likelihood of the samples; mean and variance of the level's
    change from onset to arrest."""

    log_likelihood: Array
    change: Array
    variance: Array


def _filtered(sticks: Sticks, nodes: Nodes, met: _Met, theta: Array) -> _Slips:
    """Extended Kalman filter of (u, v, b, x) over the samples of all slips, on all nodes, for all parameter sets."""
    order = np.argsort(-sticks.samples, kind="stable")
    shape = (sticks.count, nodes.log_strength.shape[1], 2, theta.shape[1])
    block = int(np.prod(shape[1:]))

    def flat(values: Array, axes: str) -> Array:
        """Values over some of the axes cycle, node, odd, parameters ("cnop"), in the order of the filter, flat."""
        index = tuple(slice(None) if name in axes else None for name in "cnop")
        return np.array(np.broadcast_to(values[index], shape)[order]).reshape(-1)

    rig, odd = sticks.rig, np.array([1.0, ODD_WANDER**2])
    k, c, kappa = rig.stiffness, rig.damping, rig.rate
    _, weakening, _, mass, wander, _, rough = np.exp(theta)
    strength = flat(np.exp(nodes.log_strength), "cn")
    onset, earlier = flat(met.force, "cp"), flat(met.earlier, "cp")
    level = onset - strength
    reach = flat(weakening / met.regained, "cp")
    per_mass, wandering, roughness = flat(1.0 / mass, "p"), flat(odd[:, None] * wander**2, "op"), flat(rough**2, "p")
    u, v, b, x = flat(sticks.slid, "c"), flat(met.speed, "cp"), np.zeros(strength.size), np.zeros(strength.size)
    noise = sticks.noise**2
    uu = np.full(u.size, noise / k**2)
    vv = (START_SPEED[0] * v + START_SPEED[1] * rig.drive_speed) ** 2
    bb, xx = wandering * u, -roughness * np.expm1(-2.0 * u / ROUGHNESS_LENGTH)
    uv, ub, ux, vb, vx, bx = (np.zeros(u.size) for _ in range(6))
    total = np.zeros(u.size)
    done = {name: np.empty(u.size) for name in ("total", "b", "bb")}
    samples, time, force = sticks.samples[order], sticks.time[order], sticks.force[order]
    above, arrest = flat(sticks.above, "c"), flat(sticks.arrest, "c")
    active = sticks.count
    for i in range(1, int(samples[0]) if samples.size else 0):
        still = int(np.count_nonzero(samples > i))
        size = still * block
        if still < active:
            state = (u, v, b, x, uu, uv, ub, ux, vv, vb, vx, bb, bx, xx, total)
            rows = slice(size, active * block)
            _arrested(tuple(values[size:] for values in state), rows, above, arrest, level, per_mass, noise, rig, done)
            u, v, b, x, uu, uv, ub, ux, vv, vb, vx, bb, bx, xx, total = (values[:size] for values in state)
            active = still
        here = slice(0, size)
        h = np.repeat(time[:still, i] - time[:still, i - 1], block)
        after = np.repeat(time[:still, i], block) + earlier[here]
        measured = np.repeat(force[:still, i], block)
        pm, a_strength, base = per_mass[here], strength[here], onset[here]
        # Mean: midpoint rule; fine roughness enters by its mean over the step, exact for a given speed.
        speed = 0.5 * (v + np.sqrt(v * v + rig.drive_speed**2))
        q = np.minimum(speed * h / ROUGHNESS_LENGTH, 50.0) + 1e-9
        fade = np.exp(-q)
        mean_share = -np.expm1(-q) / q
        left, slope = weakened(reach[here] * u)
        pull = base + kappa * (after - h) - level[here] - b - mean_share * x
        start = (pull - k * u - c * v - a_strength * left) * pm
        middle, half = u + 0.5 * h * v, v + 0.5 * h * start
        left, slope = weakened(reach[here] * middle)
        force_slope = -(k + a_strength * reach[here] * slope) * pm
        acceleration = (pull + 0.5 * h * kappa - k * middle - c * half - a_strength * left) * pm
        u, v, x = u + h * half, v + h * acceleration, fade * x
        # Covariance: to second order in the step.
        d, hh = -c * pm, 0.5 * h * h
        fuu, fuv = 1.0 + hh * force_slope, h + hh * d
        fvu, fvv = h * force_slope + hh * force_slope * d, 1.0 + h * d + hh * (force_slope + d * d)
        fub, fvb = -hh * pm, -pm * (h + hh * d)
        fux, fvx = mean_share * fub, mean_share * fvb
        au, av, ab, ax = (
            fuu * uu + fuv * uv + fub * ub + fux * ux,
            fuu * uv + fuv * vv + fub * vb + fux * vx,
            fuu * ub + fuv * vb + fub * bb + fux * bx,
            fuu * ux + fuv * vx + fub * bx + fux * xx,
        )
        cv, cb, cx = (
            fvu * uv + fvv * vv + fvb * vb + fvx * vx,
            fvu * ub + fvv * vb + fvb * bb + fvx * bx,
            fvu * ux + fvv * vx + fvb * bx + fvx * xx,
        )
        cu = fvu * uu + fvv * uv + fvb * ub + fvx * ux
        grown = wandering[here] * speed * h
        rough_now, one_less = roughness[here], -np.expm1(-q)
        averaged = rough_now * np.where(
            q > 1e-3, (2.0 * q - 2.0 * one_less - one_less * one_less) / (q * q), 2.0 * q / 3.0
        )
        crossed = rough_now * one_less * one_less / q
        uu, uv, ub, ux = (
            au * fuu + av * fuv + ab * fub + ax * fux,
            au * fvu + av * fvv + ab * fvb + ax * fvx,
            ab,
            fade * ax,
        )
        vv = cu * fvu + cv * fvv + cb * fvb + cx * fvx + (averaged + grown / 3.0) * (h * pm) ** 2
        vb, vx = cb - 0.5 * grown * h * pm, fade * cx - crossed * h * pm
        bb, bx = bb + grown, fade * bx
        xx = fade * fade * xx + rough_now * (1.0 - fade * fade)
        # The sample: spring and damper.
        hu, hv, hb, hx = -k * uu - c * uv, -k * uv - c * vv, -k * ub - c * vb, -k * ux - c * vx
        variance = -k * hu - c * hv + noise
        off = measured - (base + kappa * after - k * u - c * v)
        size_ = np.abs(off) / np.sqrt(variance)
        far = np.maximum(size_ / HUBER, 1.0)
        total = total - 0.5 * np.log(variance) - 0.5 * (size_ / far) ** 2 - HUBER * (size_ - size_ / far)
        gain = off / (far * variance)
        u, v, b, x = u + hu * gain, v + hv * gain, b + hb * gain, x + hx * gain
        w = 1.0 / variance
        uu, uv, ub, ux = uu - hu * hu * w, uv - hu * hv * w, ub - hu * hb * w, ux - hu * hx * w
        vv, vb, vx = vv - hv * hv * w, vb - hv * hb * w, vx - hv * hx * w
        bb, bx, xx = bb - hb * hb * w, bx - hb * hx * w, xx - hx * hx * w
    state = (u, v, b, x, uu, uv, ub, ux, vv, vb, vx, bb, bx, xx, total)
    _arrested(state, slice(0, active * block), above, arrest, level, per_mass, noise, rig, done)
    back = np.argsort(order)
    return _Slips(*(done[name].reshape(shape)[back] for name in ("total", "b", "bb")))


def _arrested(
    state: tuple[Array, ...],
    rows: slice,
    above: Array,
    arrest: Array,
    level: Array,
    per_mass: Array,
    noise: float,
    rig: Rig,
    done: dict[str, Array],
) -> None:
    """The end of slips: how far the last sample lies above the next stick line tells the speed there, by the
    deceleration; and a slip ends the sooner the stronger that is."""
    _, v, b, x, _, _, _, _, vv, vb, vx, bb, bx, xx, total = state
    k, c = rig.stiffness, rig.damping
    delta, pm = above[rows], per_mass[rows]
    # Where the deceleration is not positive there is no arrest: rounded off far below what any slip shows.
    least = 0.1 * delta * pm
    raw = (level[rows] + b + x - arrest[rows]) * pm
    root = np.sqrt(raw * raw + least * least)
    a, da = 0.5 * (raw + root), 0.5 * (1.0 + raw / root) * pm
    s = np.sqrt(c * c + 2.0 * k * delta / a)
    speed = a / k * (c + s)
    slope = ((c + s) / k - delta / (a * s)) * da
    off = v - speed
    hv, hb, hx = vv - slope * (vb + vx), vb - slope * (bb + bx), vx - slope * (bx + xx)
    variance = hv - slope * (hb + hx) + noise / s**2
    size = np.abs(off) / np.sqrt(variance)
    far = np.maximum(size / HUBER, 1.0)
    done["total"][rows] = (
        total - 0.5 * np.log(variance) - 0.5 * (size / far) ** 2 - HUBER * (size - size / far) + np.log(a)
    )
    done["b"][rows] = b - hb * off / (far * variance)
    done["bb"][rows] = bb - hb * hb / variance


def _chained(sticks: Sticks, nodes: Nodes, met: _Met, slips: _Slips, theta: Array) -> Cycles:
    """Cycle after cycle: the level that the cycles before leave, the stick's time, and its slip."""
    wander, scatter = np.exp(theta[4]), np.exp(theta[5])
    strength = np.exp(nodes.log_strength)[..., None]
    level = met.force[:, None, :] - strength
    z = (nodes.log_strength[..., None] - np.log(met.regained)[:, None, :]) / scatter
    # The rate at which spots of that strength are met while the contact strengthens: long sticks are strong spots.
    usual = sticks.rig.rate / strength
    hazard = usual - (met.rate / met.regained)[:, None, :]
    least = LEAST_HAZARD * usual
    hazard = 0.5 * (hazard + np.sqrt(hazard**2 + least**2))
    log_stick = -0.5 * z**2 - np.log(scatter) + np.log(hazard)
    log_weight = nodes.log_strength[..., None] + np.log(nodes.step)[:, None, None]
    log_slip = slips.log_likelihood + np.log([1.0 - ODD, ODD])[:, None]
    count, sets = sticks.count, theta.shape[1]
    found = {name: np.empty((count, sets)) for name in Cycles.__annotations__}
    mean = variance = np.zeros(sets)
    for j in range(count):
        if not sticks.follows[j]:
            mean = np.full(sets, 0.5 * (sticks.line[j] + sticks.arrest[j]))
            variance = np.full(sets, (FIRST_LEVEL * sticks.drop[j]) ** 2)
        log_prior = -0.5 * (level[j] - mean) ** 2 / variance - 0.5 * np.log(variance)
        log_before = log_prior + log_stick[j] + log_weight[j]  # (n, p)
        joint = log_before[:, None, :] + log_slip[j]
        top = joint.max(axis=(0, 1))
        weight = np.exp(joint - top)
        whole = weight.sum(axis=(0, 1))
        weight /= whole
        found["log_likelihood"][j] = np.log(whole) + top
        at = weight.sum(axis=1)
        eta = nodes.log_strength[j][:, None]
        found["log_strength"][j] = (at * eta).sum(axis=0)
        found["log_strength_sd"][j] = np.sqrt((at * (eta - found["log_strength"][j]) ** 2).sum(axis=0))
        found["odd"][j] = weight[:, 1].sum(axis=0)
        found["level"][j] = (at * level[j]).sum(axis=0)
        after = level[j][:, None, :] + slips.change[j]
        mean = (weight * after).sum(axis=(0, 1))
        found["level_after"][j] = mean
        variance = (weight * ((after - mean) ** 2 + slips.variance[j])).sum(axis=(0, 1))
        variance = np.maximum(variance, 1e-4 * wander**2 * sticks.end[j])
    return Cycles(**found)
