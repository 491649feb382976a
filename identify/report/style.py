"""One look for all figures: colours distinct to colour-blind readers, quiet axes, no pyplot."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Columns = Mapping[str, NDArray[np.generic]]  # columns of equal length by name

# Okabe and Ito's colours.
MEASURED, BEHIND, FITTED, RESIDUAL = "#3f4750", "#a3aeb8", "#D55E00", "#56B4E9"
ONSET, ARREST, SLIDING = "#009E73", "#CC79A7", "#0072B2"
SHADE, QUIET = "#e9edf1", "#7a858f"
WIDTHS = {1: 3.4, 2: 7.1}  # of figures [inch], by the columns of a paper that they take
LAW_HEIGHT = 2.4  # of one pair of axes [inch]
FORMS, DPI = ("svg", "pdf", "png"), 300
REPORTED = ("friction_over_speed", "strength_over_rest")  # laws that stand in report.html
TEXT, EDGE, TICK = "#2b333b", "#a9b3bc", "#56616b"
STYLE: dict[str, object] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 7.5,
    "axes.titlesize": 7.5, "axes.titlelocation": "left", "axes.titleweight": "bold", "axes.titlecolor": TEXT,
    "axes.labelsize": 7.5, "axes.labelcolor": TEXT, "axes.edgecolor": EDGE, "axes.linewidth": 0.7,
    "axes.spines.top": False, "axes.spines.right": False, "axes.formatter.useoffset": False,
    **{f"{axis}tick.{key}": value for axis in "xy" for key, value in
       {"color": TICK, "labelsize": 7, "major.width": 0.7, "major.size": 3}.items()},
    "axes.prop_cycle": f"cycler('color', {[SLIDING, FITTED, ONSET, ARREST, RESIDUAL, MEASURED]})",
    "axes.grid": True, "grid.color": "#e4e8ec", "grid.linewidth": 0.6, "axes.axisbelow": True,
    "legend.frameon": False, "legend.fontsize": 7, "legend.handlelength": 1.2, "legend.columnspacing": 1.0,
    "legend.borderaxespad": 0.1, "lines.linewidth": 1.1, "lines.solid_joinstyle": "round",
    "path.simplify": True, "path.simplify_threshold": 0.2, "svg.fonttype": "none", "svg.hashsalt": "stickslip",
    "text.parse_math": False, "figure.facecolor": "white", "savefig.facecolor": "white",
}  # fmt: skip


@dataclass(frozen=True)
class Drawing:
    """One figure of the report.

    name: file name without ending; alt: what a reader who cannot see it should know; caption: what stands below it;
    tables: the data behind it, one CSV file per entry (name -> columns of equal length); log: number of the log it
    belongs to, from 1, or None; svg: the rendered figure; markup: what the page shows of it, "" where only the file
    in the figures folder has room.
    """

    name: str
    figure: Figure | None
    alt: str
    caption: str
    wide: bool = True
    tables: Mapping[str, Columns] = field(default_factory=dict)
    log: int | None = None
    svg: str = ""
    markup: str = ""


@contextmanager
def drawing_style() -> Iterator[None]:
    """Draw and render inside this: matplotlib's own settings are put back afterwards."""
    import matplotlib as mpl  # half a second that `import identify` can spare

    with mpl.rc_context(STYLE):  # type: ignore[arg-type]
        yield


@contextmanager
def axes_of(axes: Axes | None) -> Iterator[Axes]:
    """The axes that are given, or new ones of one column in the one style."""
    from matplotlib.figure import Figure

    with drawing_style():
        yield axes if axes is not None else Figure(figsize=(WIDTHS[1], LAW_HEIGHT), layout="constrained").add_subplot()


def extremes(values: Array, stretches: int) -> NDArray[np.intp]:
    """Rising indices of the lowest and the highest of values (n,) in each stretch: at most 2 * stretches of them.

    All indices of finite values where there are no more than that. Points drawn at these indices keep every outlier.
    """
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) <= 2 * stretches:
        return finite
    size = -(-len(finite) // stretches)
    rows = np.pad(finite, (0, -len(finite) % size), "edge").reshape(-1, size)
    at = np.arange(len(rows))
    return np.unique([rows[at, np.argmin(values[rows], axis=1)], rows[at, np.argmax(values[rows], axis=1)]])


def padded(axes: Axes, values: Array, share: float = 0.08, above: float = 0.0) -> None:
    """y limits around the finite values, so that a flat signal does not fill the panel with its last digits; above:
    more room for a legend, as a share."""
    finite = values[np.isfinite(values)]
    if len(finite):
        low, high = float(finite.min()), float(finite.max())
        pad = share * (high - low) or max(abs(high), 1e-12) * 0.05
        axes.set_ylim(low - pad, high + pad + above * (high - low + 2 * pad))


def svg_text(figure: Figure) -> str:
    """The figure as an SVG file."""
    out = io.StringIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return out.getvalue()
