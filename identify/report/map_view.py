"""How a map is seen: its coordinates as numbers on axes, in units of handy size, and the look all its parts share."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.path import Path
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from identify.prediction.chart import Boundary
from identify.prediction.map_axes import Axis
from identify.report.quantity_text import Scale, number, scale_for

Array = NDArray[np.float64]

FONT = 7.5
NARROW = 30.0  # ratio of the ends of an axis up to which it has numbers between the decades


class View:
    """Coordinates of the plane as numbers on the axes, in units of handy size."""

    def __init__(self, x: Axis, y: Axis) -> None:
        self.axes = (x, y)
        self.scales: tuple[Scale, ...] = tuple(scale_for(abs(q.value), q.unit) for q in (x, y))

    def shown(self, places: Array) -> Array:
        """Points (n, 2) in coordinates as on the axes."""
        columns = [
            q.value_at(places[:, i]) / s.factor for i, (q, s) in enumerate(zip(self.axes, self.scales, strict=True))
        ]
        return np.column_stack(columns)

    def line(self, which: int, places: Array) -> Array:
        """Coordinates of one axis (n,) as on it."""
        return np.asarray(self.axes[which].value_at(places) / self.scales[which].factor)

    def label(self, which: int) -> str:
        """Words and unit of an axis."""
        q, unit = self.axes[which], self.scales[which].unit.replace("m^2", "m²")
        return f"{q.label} [{unit}]" if unit else q.label


def region_path(boundary: Boundary, view: View) -> Path | None:
    """The region inside a boundary."""
    loops = [np.vstack([points, points[:1]]) for points in (view.shown(loop.points) for loop in boundary.loops)]
    if not loops:
        return None
    codes = [np.r_[Path.MOVETO, np.full(len(p) - 2, Path.LINETO), Path.CLOSEPOLY] for p in loops]
    return Path(np.vstack(loops), np.concatenate(codes))


def ticks_in_powers(axis: Any, ends: Array) -> None:
    """Plain numbers at the decades, and between them where there are fewer than two."""
    if ends[1] < NARROW * ends[0]:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda v, _: number(v, 3)))
    axis.set_minor_formatter(NullFormatter())
