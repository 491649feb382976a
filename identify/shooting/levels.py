"""Starts where no log repeats its cycles: from the levels of peaks and sliding, a grid over what they do not tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from identify.logs.manner import moving_pieces
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.simulation.drive import Drive

Array = NDArray[np.float64]

TAIL = 0.4  # of a stretch of constant speed: where its level is taken
STEP = 0.15  # of a static coefficient above the kinetic one where no peak is seen
LEAST_STEP = 0.02
LENGTHS = (10e-6, 40e-6)  # D [m]
FINE_LENGTHS = (6e-6, 12e-6, 25e-6, 50e-6, 100e-6)  # where nothing else is open
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
    peaked = any(log.manner.name == "course" for log in logs)
    mu_s = max(top, mu_k0 + LEAST_STEP) if peaked else mu_k0 + STEP
    rows = []
    rests, peaks = _peaks(logs)
    times: tuple[float, ...] = TIMES
    if rests.size > 1 and np.max(rests) > 1.5 * np.min(rests):
        mu_s, t_cr = _strengthening(rests, peaks, mu_k0)
        times = (t_cr,)
    for length, time in product(LENGTHS if len(times) > 1 else FINE_LENGTHS, times):
        made = value | known | {"mu_s": mu_s, "mu_k0": mu_k0, "D": length, "t_cr": time}
        rows.append([made[name] for name in names])
        if not peaked:
            break
    theta = unknowns.theta(np.array(rows), base)
    inside = np.clip(np.where(np.isfinite(theta), theta, unknowns.start), unknowns.lower, unknowns.upper)
    return np.unique(np.where(unknowns.free, inside, unknowns.start), axis=0)


def _peaks(logs: Sequence[Prepared]) -> tuple[Array, Array]:
    """Durations [s] of rests between a stop of the drive and the peak after its restart, and the coefficients there."""
    rests, peaks = [], []
    for log in logs:
        data = log.data
        if data.programme is None:
            continue
        for start, stop, _ in moving_pieces(data.programme, data.begin, data.end):
            stopped = [t for t in data.programme.starts if t < start and data.programme.at(t) == 0.0]
            if not stopped or data.programme.at(np.nextafter(start, -np.inf)) != 0.0:
                continue
            mine = np.flatnonzero((data.time >= start) & (data.time <= stop) & (data.weight > 0))
            if mine.size < 3:
                continue
            coefficient = data.force[mine] / data.normal_force.at(data.time[mine])
            top = int(np.argmax(coefficient))
            rests.append(float(data.time[mine[top]]) - stopped[-1])
            peaks.append(float(coefficient[top]))
    return np.array(rests), np.array(peaks)


def _strengthening(rests: Array, peaks: Array, mu_k0: float) -> tuple[float, float]:
    """mu_s and t_cr [s] of the saturating growth that describes peaks after rests best."""
    best, found = np.inf, (float(np.max(peaks)), float(np.median(rests)))
    for t_cr in np.geomspace(0.1 * float(np.min(rests)), 10.0 * float(np.max(rests)), 60).tolist():
        grown = -np.expm1(-rests / t_cr)
        step = float(grown @ (peaks - mu_k0) / (grown @ grown))
        square = float(np.sum((peaks - mu_k0 - step * grown) ** 2))
        if step > 0.0 and square < best:
            best, found = square, (mu_k0 + max(step, LEAST_STEP), t_cr)
    return found


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
        data = replace(logs[0].data)
        return np.array([data.drive_speed]), np.array([float(np.median(_coefficient(logs[0])))])
    return np.array(speeds), np.array(levels)
