"""Taps and pulls on a rig, as records of a load cell that lags."""

from __future__ import annotations

import numpy as np
from scipy.signal import cont2discrete, lfilter

from data_io import Record

SPEED_ERROR = 0.01  # of the drive speed that a record states
TAPS = (0.5, 2.7, 4.9)  # [s]
FINE = 8000.0  # [Hz] of the integration


def tapped(rig: dict[str, float], lag: float, rate: float, noise: float, random: np.random.Generator) -> Record:
    """A record of three taps: pulses of a tenth of a swing on the free rig, seen by a load cell of first order. The
    pulses are constant, so that holding them from sample to sample is exact."""
    mass, stiffness, natural = rig["mass"], rig["stiffness"], np.sqrt(rig["stiffness"] / rig["mass"])
    dashpot, sub = rig["damping"] / natural, int(np.ceil(FINE / rate))
    cell = (-dashpot, -stiffness), np.polymul([lag, 1.0], [mass, dashpot, stiffness])  # its force by that of the tap
    numerator, denominator, _ = cont2discrete(cell, 1.0 / (rate * sub))
    at = np.arange(int(7.0 * rate) * sub + 1) / (rate * sub)
    pulse = np.zeros(at.size)
    for tap in TAPS:
        pulse[(at >= tap) & (at < tap + 0.2 * np.pi / natural)] = random.uniform(0.5, 1.5) / (0.2 * np.pi)
    times, force = at[::sub], lfilter(numerator.ravel(), denominator, pulse)[::sub] + 0.2 + 0.01 * at[::sub]
    return Record(times, np.ones(times.size), force + noise * random.standard_normal(times.size))


def pulled(rig: dict[str, float], lag: float, rate: float, noise: float, random: np.random.Generator) -> Record:
    """A slow pull on a rigid block, until the drive stops: the record says 0.1 mm/s, which is off by its error."""
    speed = 1e-4 * (1.0 + SPEED_ERROR * random.standard_normal())
    times = np.arange(int(12.0 * rate)) / rate
    driven = np.clip(times - 1.0, 0.0, 9.0)
    lagging = driven - lag * (1.0 - np.exp(-np.clip(times - 1.0, 0.0, None) / lag))
    force = rig["stiffness"] * speed * np.where(times <= 10.0, lagging, driven)
    return Record(times, np.ones(times.size), force + noise * random.standard_normal(times.size), drive_speed=1e-4)
