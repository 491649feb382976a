"""The drawings of the page: forest plots of parameters, curves over drive speed, small pictures of every fit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from identify.report.quantity_text import scale_for
from identify.report.report_wording import plain_symbol
from identify.studies.compare import Comparison, PooledQuantity
from identify.studies.drawing import band, colour, dash, line, path, svg, text, x_axis, y_axis
from identify.studies.multiples import Excerpt
from identify.studies.operating_points import Curve, GroupAnswer
from identify.studies.scale import Scale, around

WIDTH, ROW = 460.0, 34.0
LEFT, RIGHT = 108.0, 12.0
CURVE_HEIGHT = 300.0
FAR = 2.5  # times what the fits span: an interval is drawn no further
TALLEST = 2.0  # times the highest curve: a band is drawn no higher


def forest(comparison: Comparison, entry: PooledQuantity) -> Markup:
    """One parameter: for each group the mean with its 95 % interval, and every fit as a faint mark."""
    quantity, pooled = entry.quantity, entry.pooled
    if pooled is None:
        return Markup("")
    means = {mean.group: mean for mean in pooled.means}
    shown = [quantity.shown(float(v)) for v in pooled.mixed.y]
    ends = [quantity.shown(v) for m in pooled.means for v in (*(m.interval or ()), m.value)]
    unit = scale_for(float(np.median(shown)), quantity.unit)
    inside = _without_far(shown, ends)
    height = 22.0 + ROW * len(comparison.groups) + 34.0
    axis = around([v / unit.factor for v in inside], LEFT, WIDTH - RIGHT)
    bottom = height - 34.0
    title = f"{plain_symbol(quantity.name)}{f' [{unit.unit}]' if unit.unit else ''}"
    parts = [x_axis(axis, bottom, 16.0, title, 5)]
    for place, group in enumerate(comparison.groups):
        y = 22.0 + ROW * (place + 0.5)
        parts.append(text(LEFT - 8, y + 3.5, group, "end", "", 15))
        own = [v for v, i in zip(shown, pooled.rows, strict=True) if comparison.taken.setting.group[i] == group]
        parts += [_tick_mark(axis, v / unit.factor, y, colour(place)) for v in own]
        mean = means.get(group)
        if mean is None:
            continue
        middle = axis.at(quantity.shown(mean.value) / unit.factor)
        if mean.interval:
            a, b = (axis.at(_clipped(axis, quantity.shown(v) / unit.factor)) for v in mean.interval)
            parts.append(path([(a, y), (b, y)], colour(place), 2.6))
            beyond = [v for v in (quantity.shown(v) / unit.factor for v in mean.interval) if v != _clipped(axis, v)]
            parts += [_arrow(axis, v, y, colour(place)) for v in beyond]
        filled = colour(place) if mean.interval else "#fff"
        parts.append(f'<circle cx="{middle:.1f}" cy="{y:.1f}" r="4.6" fill="{filled}" stroke="{colour(place)}"/>')
    label = f"{quantity.name} by {comparison.question.by}: pooled means with 95 % intervals, every fit as a small mark"
    return svg(WIDTH, height, parts, label)


def _tick_mark(axis: Scale, value: float, y: float, stroke: str) -> str:
    """One fit as a small upright stroke; beyond the edge as an arrow head at it."""
    if axis.low <= value <= axis.high:
        x = axis.at(value)
        return f'<line x1="{x:.1f}" y1="{y + 7:.1f}" x2="{x:.1f}" y2="{y + 13:.1f}" stroke="{stroke}" class="mark"/>'
    return _arrow(axis, value, y + 10.0, stroke, 0.6)


def _arrow(axis: Scale, value: float, y: float, stroke: str, opacity: float = 1.0) -> str:
    """An arrow head at the edge beyond which a value lies."""
    x, sign = (axis.last, -1) if value > axis.high else (axis.first, 1)
    return f'<path d="M{x:.1f} {y:.1f}l{6 * sign} -3v6z" fill="{stroke}" fill-opacity="{opacity:g}"/>'


def _clipped(axis: Scale, value: float) -> float:
    return min(max(value, axis.low), axis.high)


def _without_far(shown: Sequence[float], ends: Sequence[float]) -> list[float]:
    """Values for the axis: all means, intervals as far as they are not far from what was found (an interval from two
    fits may span decades), and the fits that are not far from those."""
    least, most = min(shown), max(shown)
    far = FAR * max(most - least, 0.1 * abs(most))
    ends = [min(max(v, least - far), most + far) for v in ends]
    low, high = min(ends), max(ends)
    quarter = np.percentile(shown, [25, 75])
    room = 4.0 * max(float(quarter[1] - quarter[0]), 0.25 * (high - low))
    return [*ends, *(v for v in shown if low - room <= v <= high + room)]


def curves(answers: Sequence[GroupAnswer], which: str, marks: Sequence[float]) -> Markup:
    """Curves of all groups over drive speed [mm/s], "friction" or "amplitude", with the bands of their means and a
    thin line where 95 % of people and runs lie; `marks`: the common drive speeds [m/s]."""
    told = [(k, a.group, a.friction if which == "friction" else a.amplitude) for k, a in enumerate(answers)]
    drawn = [(k, group, curve) for k, group, curve in told if curve is not None and np.any(np.isfinite(curve.value))]
    if not drawn:
        return Markup("")
    top, bottom = 30.0 + 15.0 * math.ceil(len(drawn) / 3), CURVE_HEIGHT - 36.0
    speeds = np.concatenate([c.speed for _, _, c in drawn]) * 1e3
    x = Scale(float(speeds.min()), float(speeds.max()), 48.0, WIDTH - RIGHT, True)
    levels = np.concatenate([np.concatenate([c.value, c.low, c.high]) for _, _, c in drawn])
    people = np.concatenate([c.people_high for _, _, c in drawn])
    most = TALLEST * float(np.nanmax(np.abs(np.concatenate([c.value for _, _, c in drawn]))))
    levels = np.clip(levels[np.isfinite(levels)], -0.25 * most, most)
    y = _from_zero(levels, people[np.isfinite(people)], bottom, top)
    title = "friction coefficient in steady sliding" if which == "friction" else "force from peak to valley [N]"
    parts = [x_axis(x, bottom, top, "drive speed [mm/s]"), y_axis(y, 48.0, WIDTH - RIGHT, title)]
    parts += [line(x.at(v * 1e3), top, x.at(v * 1e3), bottom, "mark") for v in marks]
    for place, (k, group, curve) in enumerate(drawn):
        parts.append(_curve(curve, x, y, k))
        at = 50.0 + 135.0 * (place % 3), 18.0 + 15.0 * (place // 3)
        parts.append(path([(at[0], at[1]), (at[0] + 18, at[1])], colour(k), 2.4, dash(k)))
        parts.append(text(at[0] + 23, at[1] + 3.5, group, "start", "", 16))
    return svg(WIDTH, CURVE_HEIGHT, parts, f"{title} against drive speed for every group, with 95 % bands")


def _from_zero(levels: np.ndarray, people: np.ndarray, bottom: float, top: float) -> Scale:
    """From zero to the highest band; the scatter of people may take half as much again."""
    high = 1.06 * float(levels.max())
    if people.size:
        high = max(high, min(1.03 * float(people.max()), 1.5 * high))
    return Scale(min(0.0, float(levels.min())), high, bottom, top + 14.0)


def _curve(curve: Curve, x: Scale, y: Scale, place: int) -> str:
    def points(values: np.ndarray) -> list[tuple[float, float]]:
        kept = np.where((values >= y.low) & (values <= y.high), values, np.nan)
        return [
            (x.at(1e3 * v), y.at(w) if math.isfinite(w) else math.nan) for v, w in zip(curve.speed, kept, strict=True)
        ]

    high, low = (np.clip(ends, y.low, y.high) for ends in (curve.high, curve.low))
    return (
        band(points(high), points(low), colour(place), 0.18)
        + path(points(curve.people_low), colour(place), 0.7, "2 3")
        + path(points(curve.people_high), colour(place), 0.7, "2 3")
        + path(points(curve.value), colour(place), 2.0, dash(place))
    )


def thumbnail(excerpt: Excerpt) -> Markup:
    """One fit in small: the measured force of a few cycles of one log, the fitted one over it."""
    width, height = 190.0, 78.0
    if len(excerpt.time) < 2:
        return Markup("")
    x = Scale(excerpt.time[0], max(excerpt.time[-1], excerpt.time[0] + 1e-12), 1.0, width - 1.0)
    levels = [v for v in (*excerpt.measured, *excerpt.fitted) if math.isfinite(v)]
    y = around(levels, height - 2.0, 2.0)
    measured = [
        (x.at(t), y.at(v) if math.isfinite(v) else math.nan)
        for t, v in zip(excerpt.time, excerpt.measured, strict=True)
    ]
    fitted = [
        (x.at(t), y.at(v) if math.isfinite(v) else math.nan) for t, v in zip(excerpt.time, excerpt.fitted, strict=True)
    ]
    parts = [path(measured, "#a3aeb8", 1.6), path(fitted, "#D55E00", 0.9)]
    return svg(width, height, parts, f"measured and fitted force, {excerpt.words}")
