"""Drawings for a page as plain SVG: small, sharp in print, drawn in a millisecond; every text is escaped."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from markupsafe import Markup, escape

from identify.studies.clean import brief, visible
from identify.studies.scale import Scale, tick_text

# Okabe and Ito's colours, black and yellow left out; after six groups they begin again with a dashed line.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#B8860B", "#3f4750")
DASHES = ("", "6 3", "2 3")


def colour(place: int) -> str:
    """The colour of the group at a place."""
    return COLOURS[place % len(COLOURS)]


def dash(place: int) -> str:
    """The dash of the group at a place, "" for a full line."""
    return DASHES[place // len(COLOURS) % len(DASHES)]


def svg(width: float, height: float, parts: Iterable[str], label: str) -> Markup:
    """A drawing with a description for those who cannot see it."""
    body = "".join(parts)
    described = escape(visible(label, 300))
    return Markup(
        f'<svg class="drawing" viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{described}">{body}</svg>'
    )


def text(x: float, y: float, words: str, anchor: str = "start", kind: str = "", most: int = 40) -> str:
    """Words at a place."""
    extra = f' class="{kind}"' if kind else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{extra}>{escape(brief(words, most))}</text>'


def line(x1: float, y1: float, x2: float, y2: float, kind: str = "rule") -> str:
    """A straight line."""
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" class="{kind}"/>'


def path(points: Sequence[tuple[float, float]], stroke: str, width: float = 1.6, dashed: str = "") -> str:
    """A line through points; it breaks where one is not finite."""
    words, pen = [], "M"
    for x, y in points:
        if not (math.isfinite(x) and math.isfinite(y)):
            pen = "M"
            continue
        words.append(f"{pen}{x:.1f} {y:.1f}")
        pen = "L"
    extra = f' stroke-dasharray="{dashed}"' if dashed else ""
    return f'<path d="{"".join(words)}" fill="none" stroke="{stroke}" stroke-width="{width:g}"{extra}/>'


def band(upper: Sequence[tuple[float, float]], lower: Sequence[tuple[float, float]], fill: str, opacity: float) -> str:
    """The area between two lines, where both are finite; in pieces where they break."""
    pieces: list[list[int]] = [[]]
    for k, (a, b) in enumerate(zip(upper, lower, strict=True)):
        if all(map(math.isfinite, (*a, *b))):
            pieces[-1].append(k)
        elif pieces[-1]:
            pieces.append([])
    out = []
    for piece in pieces:
        ring = [upper[k] for k in piece] + [lower[k] for k in reversed(piece)]
        if len(piece) > 1:
            d = "L".join(f"{x:.1f} {y:.1f}" for x, y in ring)
            out.append(f'<path d="M{d}Z" fill="{fill}" fill-opacity="{opacity:g}" stroke="none"/>')
    return "".join(out)


def x_axis(scale: Scale, y: float, top: float, title: str, most: int = 6) -> str:
    """Grid lines, ticks and title of a horizontal axis."""
    out = []
    for tick in scale.ticks(most):
        x = scale.at(tick)
        out.append(line(x, top, x, y, "grid") + text(x, y + 13, tick_text(tick), "middle", "tick"))
    return "".join(out) + text((scale.first + scale.last) / 2, y + 28, title, "middle", "title", 60)


def y_axis(scale: Scale, x: float, right: float, title: str, most: int = 5) -> str:
    """Grid lines, ticks and title (above, at the left) of a vertical axis."""
    out = []
    for tick in scale.ticks(most):
        y = scale.at(tick)
        out.append(line(x, y, right, y, "grid") + text(x - 5, y + 3.5, tick_text(tick), "end", "tick"))
    return "".join(out) + text(4, scale.last - 9, title, "start", "title", 60)
