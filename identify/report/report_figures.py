"""All figures of a fit: which there are, and each as SVG and PNG."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from identify.base.result import UnevenResult
from identify.report.cycle_figures import draw_cycles, draw_measured, draw_uneven
from identify.report.draw_slip import draw_phase_plane, draw_slip
from identify.report.force_figure import draw_force
from identify.report.report_wording import plain_symbol, with_group
from identify.report.style import Drawing, drawing_style, printable
from identify.report.text_tables import Columns
from identify.report.uncertainty_figures import draw_correlation, draw_profile

if TYPE_CHECKING:
    from identify.report.finished import Fit


PNG_DPI = 130


@dataclass(frozen=True)
class Picture:
    """A rendered figure. log: number of the log it belongs to, from 1, or None; markup: what the page shows of it, ""
    where only the file in the figures folder has room; the rest as in Drawing."""

    log: int | None
    name: str
    alt: str
    caption: str
    wide: bool
    svg: str
    png: bytes
    tables: Mapping[str, Columns]
    markup: str = ""


def pictures(fit: Fit) -> Iterator[Picture]:
    """Every figure of the fit, drawn one after the other so that only one is held open."""
    with drawing_style(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        for log, drawing in _drawings(fit):
            yield _render(log, drawing)


def _drawings(fit: Fit) -> Iterator[tuple[int | None, Drawing]]:
    for position, curves in enumerate(fit.logs, start=1):
        if len(curves.time) > 1:
            drawing = draw_force(curves, position, fit.converged)
            drawing.figure.suptitle(
                f"log {position} · {printable(curves.name)}",
                x=0.992,
                y=0.985,
                ha="right",
                va="top",
                fontsize=8,
                color="#7a858f",
            )
            yield position, drawing
        if curves.slip is not None and len(curves.slip.time) > 1:
            yield position, draw_slip(curves, curves.slip, position, fit.converged)
            yield position, draw_phase_plane(curves, curves.slip, position)
        if len(curves.cycles):
            yield position, draw_cycles(curves, position, fit.converged)
    result = fit.typed
    yield from draw_uneven(UnevenResult.of(result))
    if not fit.converged and (measured := draw_measured(fit.logs)) is not None:
        yield None, measured
    drawn = draw_profile(result.profile, result.parameters) if result.profile else None
    if drawn is not None:
        yield None, drawn
    if result.correlation is not None and len(result.correlation.names) > 1:
        names = [with_group(name, result.parameters[name].group) for name in result.correlation.names]
        matrix = np.array(result.correlation.matrix, dtype=np.float64)
        yield None, draw_correlation([plain_symbol(name) for name in names], matrix)


def _render(log: int | None, drawing: Drawing) -> Picture:
    svg, png = io.StringIO(), io.BytesIO()
    drawing.figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
    drawing.figure.savefig(
        png, format="png", dpi=PNG_DPI, metadata={"Software": None}, pil_kwargs={"compress_level": 4}
    )
    return Picture(
        log=log,
        name=drawing.name,
        alt=drawing.alt,
        caption=drawing.caption,
        wide=drawing.wide,
        svg=svg.getvalue(),
        png=png.getvalue(),
        tables=drawing.tables,
    )
