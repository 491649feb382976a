"""Stability or amplitude over drive speed as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from data_io.atomic import atomic_path
from identify.cli.common import CommandLineError
from identify.prediction.batch import CycleBatch
from identify.prediction.orbit import CycleMap
from identify.prediction.predict import SolutionSet, solution_set
from identify.prediction.quantities import QUANTITIES
from identify.simulation.sliding import sliding

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from identify.cli.points import PairAtPoint

MM = 1e3


def draw(point: PairAtPoint, speeds: Sequence[float], part: str, path: Path) -> None:
    """Draw `part` ("stability" or "amplitude") for the pair and load of `point`; `speeds` [m/s] are marked.

    Raises:
        CommandLineError: there is nothing to draw.
    """
    p = np.array([point.values[name] for name in point.model.parameter_names])
    map_ = CycleMap(point.model, point.normal_force, p)
    answer = solution_set(map_, min(speeds))
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.add_subplot()
    (_stability if part == "stability" else _amplitude)(axes, map_, answer, speeds)
    for number, speed in enumerate(dict.fromkeys(speeds)):
        axes.axvline(MM * speed, color="0.6", lw=0.8, ls=":", label=None if number else "asked for")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("drive speed [mm/s]")
    axes.set_title(f"normal force {point.normal_force:.3g} N", fontsize=10)
    axes.legend(frameon=False, fontsize=8)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=150)


def _stability(axes: Axes, map_: CycleMap, answer: SolutionSet, speeds: Sequence[float]) -> None:
    """Growth rate of a disturbance of steady sliding, and where stick-slip exists."""
    windows = answer.windows
    fastest = 3.0 * max(
        *speeds, answer.end or 0.0, *(stop for _, stop in windows.unstable if stop < windows.searched[1])
    )
    grid = np.geomspace(0.3 * min(speeds), fastest, 200)
    steady = [sliding(map_.model, map_.p, float(v), map_.normal_force) for v in grid]
    worn = np.array([state.worn for state in steady])
    growth = np.array([state.growth for state in steady])
    for part, label in ((~worn, "growth rate of a disturbance of steady sliding"), (worn, None)):
        axes.plot(MM * grid[part], growth[part], color="C0", label=label)  # it jumps where the contact wears out
    axes.axhline(0.0, color="0.3", lw=0.8)
    for number, known in enumerate(windows.sticking):
        low = grid[0] if known.low is None else known.low
        high = fastest if known.high is None else known.high
        axes.axvspan(MM * low, MM * high, color="C1", alpha=0.15, label=None if number else "stick-slip exists")
    axes.set_xlim(MM * grid[0], MM * fastest)
    axes.set_ylabel("growth rate [1/s]; below 0: steady sliding is stable")


def _amplitude(axes: Axes, map_: CycleMap, answer: SolutionSet, speeds: Sequence[float]) -> None:
    """Fall of the force in a jump, and its onset and arrest levels, wherever jumps settle on one size."""
    parts = answer.windows.sticking
    if not parts:
        raise CommandLineError("there is no stick-slip at any drive speed, so there is no amplitude to draw")
    slowest = 0.3 * min(*speeds, *(part.speeds[-1] for part in parts))
    names = list(QUANTITIES)
    for number, part in enumerate(parts):
        shown = part.periodic & (part.speeds >= slowest)
        v = part.speeds[shown]
        settings = np.stack([map_.setting(float(speed)) for speed in v]).reshape(v.size, -1)
        rows = CycleBatch(map_.model, settings).figures(part.states[shown])[0]
        for name, label, style in (
            ("onset_force", "force at the onset of a jump", "C0-"),
            ("arrest_force", "force at its end (rest)", "C2-"),
            ("peak_to_valley", "peak to valley", "C1-"),
        ):
            axes.plot(MM * v, rows[:, names.index(name)], style, label=None if number else label)
        limits = [limit for limit in (part.low, part.high) if limit is not None]
        for n, limit in enumerate(limits):
            axes.axvline(MM * limit, color="C3", lw=1.0, label=None if number or n else "stick-slip ends")
    axes.set_ylabel("force [N]")
    axes.set_ylim(bottom=0.0)
