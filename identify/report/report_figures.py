"""All figures of a fit: which there are, each drawn once, as SVG; and an SVG made fit to stand inside a page."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from identify.base.quantiles import LEVEL, chi_square
from identify.base.result import UnevenResult
from identify.report.report_wording import plain_symbol, with_group

if TYPE_CHECKING:
    from identify.report.finished import Fit
    from identify.report.style import Columns, Drawing


@dataclass(frozen=True)
class Picture:
    """A figure as SVG. log: number of the log it belongs to, from 1, or None; markup: what the page shows of it, ""
    where only the file in the figures folder has room; the rest as in Drawing."""

    log: int | None
    name: str
    alt: str
    caption: str
    wide: bool
    svg: str
    tables: Mapping[str, Columns]
    markup: str = ""


def pictures(fit: Fit) -> Iterator[Picture]:
    """Every figure of the fit, drawn one after the other so that only one is held open."""
    from identify.report.style import drawing_style

    with drawing_style(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        for log, drawing in _drawings(fit):
            yield _render(log, drawing)


def _drawings(fit: Fit) -> Iterator[tuple[int | None, Drawing]]:
    # Matplotlib is slow to import: only who writes a report pays for it.
    from identify.report.cycle_figures import draw_cycles, draw_measured, draw_uneven
    from identify.report.draw_slip import draw_phase_plane, draw_slip
    from identify.report.force_figure import draw_force
    from identify.report.uncertainty_figures import draw_correlation, draw_optima, draw_profile

    for position, curves in enumerate(fit.logs, start=1):
        if len(curves.time) > 1:
            yield position, draw_force(curves, position, fit.converged)
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
    if result.optima and sum(optimum.starts for optimum in result.optima) > 1:
        yield None, draw_optima(result.optima, chi_square(LEVEL, len(result.optima[0].values)))
    if result.correlation is not None and len(result.correlation.names) > 1:
        names = [with_group(name, result.parameters[name].group) for name in result.correlation.names]
        matrix = np.array(result.correlation.matrix, dtype=np.float64)
        yield None, draw_correlation([plain_symbol(name) for name in names], matrix)


def _render(log: int | None, drawing: Drawing) -> Picture:
    svg = io.StringIO()
    drawing.figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
    return Picture(log, drawing.name, drawing.alt, drawing.caption, drawing.wide, svg.getvalue(), drawing.tables)


# ----------------------------------------------------------------------------------------------------------------------
# Matplotlib's SVG made fit to stand inside an HTML page: small, self-contained, ids of its own.
# ----------------------------------------------------------------------------------------------------------------------

FONTS = "system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif"
_TAG = re.compile(r"<[^>]*>")
_LONG_NUMBER = re.compile(r"(-?\d+\.\d\d)\d+")
_FONT = re.compile(r"'DejaVu Sans'(?:, *sans-serif)?")


def inline_svg(text: str, prefix: str) -> str:
    """The <svg> element of an SVG file for use inside HTML.

    Prolog, metadata and name-space addresses go (HTML implies them); `prefix` keeps the ids of several
    figures in one page apart; coordinates are cut to a hundredth of a point; width and height become
    the page's business. Texts stay as they are. ValueError where there is no viewBox.
    """
    body = text[text.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r"<!--.*?-->", "", body, flags=re.DOTALL)
    head, rest = body.split(">", 1)
    box = re.search(r'viewBox="([^"]*)"', head)
    if box is None:
        raise ValueError("this SVG has no viewBox, so it cannot be scaled to the page")

    def tidy(tag: re.Match[str]) -> str:
        kept = re.sub(r'\bid="', f'id="{prefix}-', tag[0])
        kept = kept.replace('href="#', f'href="#{prefix}-').replace("url(#", f"url(#{prefix}-")
        kept = _FONT.sub(FONTS, _LONG_NUMBER.sub(r"\1", kept))
        return re.sub(r"\s*\n\s*", " ", kept)

    rest = re.sub(r">\s*\n\s*<", ">\n<", _TAG.sub(tidy, rest))
    return f'<svg viewBox="{box.group(1)}" aria-hidden="true" focusable="false">{rest.rstrip()}'
