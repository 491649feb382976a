"""A few cycles of every fit, read from its result.h5: enough to see at a glance which fits look odd."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import h5py
import numpy as np
from numpy.typing import NDArray

from identify.report.quantity_text import quantity
from identify.studies.fits import FitEntry

Array = NDArray[np.float64]

CYCLES = 3
POINTS = 150  # per thumbnail
MOST_SAMPLES = 200_000


@dataclass(frozen=True)
class Excerpt:
    """A stretch of one log: time [s], measured and fitted force [N] (NaN where nothing is fitted), words on it."""

    time: tuple[float, ...] = ()
    measured: tuple[float, ...] = ()
    fitted: tuple[float, ...] = ()
    words: str = ""


def excerpt(entry: FitEntry) -> Excerpt:
    """About three cycles in the middle of the log of middle speed; empty where there are no curves."""
    path = entry.folder / "result.h5"
    try:
        if not path.is_file():
            return Excerpt()
        with h5py.File(path, "r") as file:
            curves = file.get("curves")
            if curves is None or not len(curves):
                return Excerpt()
            ordered = sorted(curves.values(), key=lambda log: abs(float(log.attrs.get("drive_speed_m_per_s", 0.0))))
            return _of(ordered[len(ordered) // 2])
    except (OSError, KeyError, ValueError, TypeError, RuntimeError):  # a damaged file spoils its own picture only
        return Excerpt()


def _of(log: h5py.Group) -> Excerpt:
    count = min(log["time"].shape[0], MOST_SAMPLES)
    time = np.asarray(log["time"][:count], float)
    first, last = _window(log, time)
    part = slice(first, last)
    measured = np.asarray(log["friction_force"][part], float)
    fitted = np.asarray(log["fitted_force"][part], float)
    kept = _kept(measured, POINTS)
    speed = quantity(abs(float(log.attrs.get("drive_speed_m_per_s", np.nan))), "m/s", 3)
    length = quantity(float(time[last - 1] - time[first]), "s", 2)
    return Excerpt(
        tuple(time[part][kept].tolist()),
        tuple(measured[kept].tolist()),
        tuple(fitted[kept].tolist()),
        f"{speed}, {length}",
    )


def _window(log: h5py.Group, time: Array) -> tuple[int, int]:
    """Indices of about CYCLES cycles in the middle, from the onsets that the fit stored; else the middle third."""
    onsets = np.asarray(log["cycles/onset"][:], float) if "cycles/onset" in log else np.zeros(0)
    onsets = np.sort(onsets[np.isfinite(onsets)])
    if len(onsets) < 2:
        begin, end = time[0] + (time[-1] - time[0]) / 3, time[0] + 2 * (time[-1] - time[0]) / 3
    else:
        middle = max((len(onsets) - CYCLES) // 2, 0)
        period = float(np.median(np.diff(onsets)))
        begin = onsets[middle] - 0.5 * period
        end = onsets[min(middle + CYCLES - 1, len(onsets) - 1)] + 0.5 * period
    first, last = (int(i) for i in np.searchsorted(time, [begin, end]))
    return (first, last) if last - first >= 2 else (0, len(time))


def _kept(values: Array, most: int) -> NDArray[np.int64]:
    """Indices of the lowest and the highest sample of every stretch, so that a fast slip keeps its depth."""
    n = len(values)
    if n <= most:
        return np.arange(n)
    edges = np.linspace(0, n, most // 2 + 1).astype(int)
    filled = np.where(np.isfinite(values), values, np.nanmean(values) if np.any(np.isfinite(values)) else 0.0)
    found = {0, n - 1}
    for a, b in pairwise(edges.tolist()):
        found |= {a + int(np.argmin(filled[a:b])), a + int(np.argmax(filled[a:b]))}
    return np.array(sorted(found))
