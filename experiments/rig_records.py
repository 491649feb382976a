"""Taps and pulls on a rig, as records of a load cell that lags."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from data_io import Record

SPEED_ERROR = 0.01  # of the drive speed that a record states
TAPS = (0.5, 2.7, 4.9)  # [s]
FINE = 8000.0  # [Hz] of the integration


def tapped(rig: dict[str, float], lag: float, rate: float, noise: float, random: np.random.Generator) -> Record:
    """A record of three taps: pulses of a tenth of a swing on the free rig, seen by a load cell of first order. The
    pulses are constant, so that the exponential of the matrix integrates exactly."""
    mass, stiffness, natural = rig["mass"], rig["stiffness"], np.sqrt(rig["stiffness"] / rig["mass"])
    dashpot = rig["damping"] / natural
    matrix = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-stiffness / mass, -dashpot / mass, 0.0, 1.0 / mass],
            [-stiffness / lag, -dashpot / lag, -1.0 / lag, 0.0],
            [0.0, 0.0, 0.0, 0.0],
        ]
    )
    sub = int(np.ceil(FINE / rate))
    step = expm(matrix / (rate * sub))
    count = int(7.0 * rate) * sub
    at = np.arange(count + 1) / (rate * sub)
    pulse = np.zeros(count + 1)
    for tap in TAPS:
        inside = (at >= tap) & (at < tap + 0.2 * np.pi / natural)
        pulse[inside] = random.uniform(0.5, 1.5) / (0.2 * np.pi)
    shown, state = np.zeros(count + 1), np.zeros(4)
    for i in range(count):
        state[3] = pulse[i]
        state = step @ state
        shown[i + 1] = state[2]
    times, force = at[::sub], shown[::sub] + 0.2 + 0.01 * at[::sub]
    return Record(times, np.ones(times.size), force + noise * random.standard_normal(times.size))


def pulled(rig: dict[str, float], lag: float, rate: float, noise: float, random: np.random.Generator) -> Record:
    """A slow pull on a rigid block, until the drive stops: the record says 0.1 mm/s, which is off by its error."""
    speed = 1e-4 * (1.0 + SPEED_ERROR * random.standard_normal())
    times = np.arange(int(12.0 * rate)) / rate
    driven = np.clip(times - 1.0, 0.0, 9.0)
    lagging = driven - lag * (1.0 - np.exp(-np.clip(times - 1.0, 0.0, None) / lag))
    force = rig["stiffness"] * speed * np.where(times <= 10.0, lagging, driven)
    return Record(times, np.ones(times.size), force + noise * random.standard_normal(times.size), drive_speed=1e-4)
