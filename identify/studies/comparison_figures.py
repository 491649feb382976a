"""The drawings of the page: forest plots of parameters, curves over drive speed, small pictures of every fit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import h5py
import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from identify.base.wording import number, quantity, scale_for
from identify.report.report_wording import plain_symbol
from identify.studies.compare import Comparison, PooledQuantity
from identify.studies.fits import FitEntry
from identify.studies.labels import brief, visible
from identify.studies.operating_points import GroupAnswer, SpeedCurve

# ----------------------------------------------------------------------------------------------------------------------
# A few cycles of every fit, read from its result.h5: enough to see at a glance which fits look odd.
# ----------------------------------------------------------------------------------------------------------------------

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


# ----------------------------------------------------------------------------------------------------------------------
# Axes for drawings inside a page: from numbers to places, linear or logarithmic, with ticks a person would choose.
# ----------------------------------------------------------------------------------------------------------------------

STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True)
class AxisScale:
    """From `low`..`high` to `first`..`last` (points of the drawing); logarithmic where `log`."""

    low: float
    high: float
    first: float
    last: float
    log: bool = False

    def at(self, value: float) -> float:
        """The place of a value."""
        a, b, v = (math.log(x) if self.log else x for x in (self.low, self.high, value))
        return self.first + (v - a) / (b - a) * (self.last - self.first)

    def ticks(self, most: int = 6) -> list[float]:
        """Values to mark: round numbers, or powers of ten."""
        if self.log:
            decades = range(math.ceil(math.log10(self.low) - 1e-9), math.floor(math.log10(self.high) + 1e-9) + 1)
            if len(decades) >= 2:
                return [10.0**k for k in decades]
        raw = (self.high - self.low) / most
        unit = 10.0 ** math.floor(math.log10(raw))
        step = next(unit * s for s in STEPS if unit * s >= raw * (1 - 1e-9))
        first = math.ceil(self.low / step - 1e-9)
        return [round(k * step, 12) for k in range(first, math.floor(self.high / step + 1e-9) + 1)]


def around(values: Sequence[float], first: float, last: float, log: bool = False, share: float = 0.06) -> AxisScale:
    """A scale around all finite values, with a little room."""
    kept = [v for v in values if math.isfinite(v) and (v > 0.0 or not log)]
    low, high = (min(kept), max(kept)) if kept else (1.0, 2.0)
    if log:
        room = max(share * math.log(high / low), 0.02)
        return AxisScale(low * math.exp(-room), high * math.exp(room), first, last, True)
    room = share * (high - low) or 0.05 * abs(high) or 0.05
    return AxisScale(low - room, high + room, first, last)


def tick_texts(ticks: Sequence[float]) -> list[str]:
    """Ticks as text, with as many digits as tell them apart."""
    values = [0.0 if abs(value) < 1e-15 else value for value in ticks]
    tried = ([number(value, digits) for value in values] for digits in (4, 6, 8, 12))
    return next((texts for texts in tried if len(set(texts)) == len(values)), [repr(value) for value in values])


# ----------------------------------------------------------------------------------------------------------------------
# Drawings for a page as plain SVG: small, sharp in print, drawn in a millisecond; every text is escaped.
# ----------------------------------------------------------------------------------------------------------------------

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


def x_axis(scale: AxisScale, y: float, top: float, title: str, most: int = 6) -> str:
    """Grid lines, ticks and title of a horizontal axis."""
    out = []
    ticks = scale.ticks(most)
    for tick, words in zip(ticks, tick_texts(ticks), strict=True):
        x = scale.at(tick)
        out.append(line(x, top, x, y, "grid") + text(x, y + 13, words, "middle", "tick"))
    return "".join(out) + text((scale.first + scale.last) / 2, y + 28, title, "middle", "title", 60)


def y_axis(scale: AxisScale, x: float, right: float, title: str) -> str:
    """Grid lines, ticks and title (above, at the left) of a vertical axis."""
    out = []
    ticks = scale.ticks(5)
    for tick, words in zip(ticks, tick_texts(ticks), strict=True):
        y = scale.at(tick)
        out.append(line(x, y, right, y, "grid") + text(x - 5, y + 3.5, words, "end", "tick"))
    return "".join(out) + text(4, scale.last - 9, title, "start", "title", 60)


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


def _tick_mark(axis: AxisScale, value: float, y: float, stroke: str) -> str:
    """One fit as a small upright stroke; beyond the edge as an arrow head at it."""
    if axis.low <= value <= axis.high:
        x = axis.at(value)
        return f'<line x1="{x:.1f}" y1="{y + 7:.1f}" x2="{x:.1f}" y2="{y + 13:.1f}" stroke="{stroke}" class="mark"/>'
    return _arrow(axis, value, y + 10.0, stroke, 0.6)


def _arrow(axis: AxisScale, value: float, y: float, stroke: str, opacity: float = 1.0) -> str:
    """An arrow head at the edge beyond which a value lies."""
    x, sign = (axis.last, -1) if value > axis.high else (axis.first, 1)
    return f'<path d="M{x:.1f} {y:.1f}l{6 * sign} -3v6z" fill="{stroke}" fill-opacity="{opacity:g}"/>'


def _clipped(axis: AxisScale, value: float) -> float:
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
    x = AxisScale(float(speeds.min()), float(speeds.max()), 48.0, WIDTH - RIGHT, True)
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


def _from_zero(levels: np.ndarray, people: np.ndarray, bottom: float, top: float) -> AxisScale:
    """From zero to the highest band; the scatter of people may take half as much again."""
    high = 1.06 * float(levels.max())
    if people.size:
        high = max(high, min(1.03 * float(people.max()), 1.5 * high))
    return AxisScale(min(0.0, float(levels.min())), high, bottom, top + 14.0)


def _curve(curve: SpeedCurve, x: AxisScale, y: AxisScale, place: int) -> str:
    def points(values: np.ndarray) -> list[tuple[float, float]]:
        kept = np.where((values >= y.low) & (values <= y.high), values, np.nan)
        return [(x.at(1e3 * v), y.at(w)) for v, w in zip(curve.speed, kept, strict=True)]

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
    x = AxisScale(excerpt.time[0], max(excerpt.time[-1], excerpt.time[0] + 1e-12), 1.0, width - 1.0)
    y = around((*excerpt.measured, *excerpt.fitted), height - 2.0, 2.0)
    measured, fitted = (
        [(x.at(t), y.at(v)) for t, v in zip(excerpt.time, values, strict=True)]
        for values in (excerpt.measured, excerpt.fitted)
    )
    parts = [path(measured, "#a3aeb8", 1.6), path(fitted, "#D55E00", 0.9)]
    return svg(width, height, parts, f"measured and fitted force, {excerpt.words}")
