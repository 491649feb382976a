"""Starts where no log repeats its cycles: from the levels of peaks and sliding, a grid over what they do not tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from identify.drive import Drive
from identify.manner import moving_pieces
from identify.prepare import Prepared
from identify.unknowns import Unknowns

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
    peaked = any(log.manner.name == "course" for log in logs)
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
        data = replace(logs[0].data)
        return np.array([data.drive_speed]), np.array([float(np.median(_coefficient(logs[0])))])
    return np.array(speeds), np.array(levels)
