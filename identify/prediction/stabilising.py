"""Stabilising changes: the nearest value of each rig quantity that makes sliding steady with a margin, or keeps it.

Steady means that small disturbances of sliding die out and that no stick-slip is found, neither from a rested contact
(the strongest kick a start can give), nor from one that is almost renewed, nor beside what other values have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.base.result import Number
from identify.model.model import Model
from identify.prediction.axes import Axis, Site, admissible, axis, moved
from identify.prediction.batch import CycleBatch
from identify.prediction.draws import DRAWS, POINT, AnswerInterval, Draws, OperatingPoint
from identify.prediction.orbit import check_calculable
from identify.prediction.point_prediction import number
from identify.prediction.search import Survey, in_a_row
from identify.prediction.sources import Tested
from identify.prediction.windows import HALVINGS
from identify.prediction.wording import advice_text, said
from identify.simulation.sliding import clearances

Array = NDArray[np.float64]

STEP = 1.25  # factor between the values looked at
MARGIN = 0.2
BETWEEN = 3  # values between limit and advice at which it is made sure that nothing comes in between
# What advice is given on, and how far either way it is looked for.
CHANGED = {"drive_speed": 1e5}
CHANGED |= dict.fromkeys(("stiffness", "stiffness_at_zeta", "damping", "mass", "normal_force"), 100.0)


@dataclass(frozen=True)
class ChangeAdvice:
    """A change as the interface gives it: the quantity now, its limit and the value advised, which is a least or a most
    one (at; None without a limit)."""

    quantity: str
    label: str
    now: Number
    limit: Number
    advised: Number
    at: str | None
    kind: str | None
    extrapolated: bool
    reason: str


@dataclass(frozen=True)
class StabilisingAdvice:
    """What to change, one of these, so that sliding is steady with a margin, or stays so."""

    steady: bool
    margin: float
    changes: tuple[ChangeAdvice, ...]
    text: str


@dataclass(frozen=True)
class Turn:
    """A coordinate of a quantity at which the answer changes; rising: whether it is steady above; kind of limit; start:
    a rest state (n_y,) of stick-slip beside it with the typical one there, None where it is sliding that changes."""

    place: float
    rising: bool
    kind: str
    start: tuple[Array, Array] | None


def stabilising_changes(
    model: Model,
    point: OperatingPoint,
    names: Sequence[str] = (),
    tested: Tested | None = None,
    margin: float = MARGIN,
    draws: int = DRAWS,
) -> StabilisingAdvice:
    """What to change so that sliding is steady at an operating point.

    Args:
        names: what the covariance of the point is of: parameters, "drive_speed", "normal_force".
        tested: the range in which the pair was tested; what lies outside is marked extrapolated. None: not known.
        margin: share by which the quantity is to stay away from its limit. draws: for the intervals of the limits.

    Returns:
        one change per quantity, all but that one held; limits and advised values without a value where there is none.

    Raises:
        SimulationError: a model or an operating point without an answer.
    """
    check_calculable(model)
    speed, load = abs(float(point.drive_speed)), float(point.normal_force)
    if not (0.0 < speed < np.inf and 0.0 < load < np.inf and 0.0 < margin < np.inf):
        raise SimulationError(
            f"advice is for {speed:g} m/s and {load:g} N with a margin of {margin:g}; expected positive numbers"
        )
    site = Site(model, {name: float(point.values[name]) for name in model.parameter_names}, speed, load)
    if not admissible(model, site.setting):
        raise SimulationError(
            "the values at this point are none that the model takes: mu_s above mu_k0, and friction that stays "
            "positive at speed, were expected; look at the parameters that are not identified"
        )
    drawn = None
    if point.covariance is not None and names:
        values = {**site.values, "drive_speed": speed, "normal_force": load}
        drawn = Draws.of(model, values, names, point.covariance, draws)
    known = (*model.parameter_names, *POINT, *(["stiffness_at_zeta"] if "damping" in model.parameter_names else []))
    moved_ = [axis(site, name) for name in CHANGED if name in known]
    changes = tuple(_change(site, q, drawn, tested, margin) for q in moved_ if q.value > 0.0)
    steady = _steady(CycleBatch(model, site.setting[None]))
    return StabilisingAdvice(
        steady, margin, changes, advice_text(f"{said(speed, 'm/s')} and {said(load, 'N')}", steady, margin, changes)
    )


def _steady(batch: CycleBatch) -> bool:
    """Whether sliding is steady at every row."""
    return bool(np.all(batch.growth < 0.0)) and not np.any(batch.settle(batch.rested()).sticks)


def nearest_turn(site: Site, q: Axis) -> tuple[bool, Turn | None]:
    """Whether sliding is steady at the point, and the nearest value of a quantity at which that changes; None where
    it stays the same as far as it is looked for."""
    low, high = _span(site, q)
    below, above = (int(abs(np.log(end / q.value)) / np.log(STEP) + 1e-9) for end in (low, high))
    places = q.place(q.value) + np.log(STEP) * np.arange(-below, above + 1)

    def settings_at(places: Array) -> Array:
        return moved(site, {q.name: q.value_at(places[:, 0])})

    bad = np.flatnonzero(~admissible(site.model, settings_at(places[:, None]))).tolist()
    first = max((i + 1 for i in bad if i < below), default=0)
    places, own = places[first : min((i for i in bad if i > below), default=places.size)], below - first
    survey = Survey.of(site.model, places[:, None], settings_at, in_a_row(places.size))
    steady = (survey.batch.growth < 0.0) & ~survey.motions.sticks
    other = np.flatnonzero(steady != steady[own])
    if not other.size:
        return bool(steady[own]), None
    far = int(other[np.argmin(np.abs(other - own) - 0.25 * (other > own))])  # of two as near the one above
    near = far - 1 if far > own else far + 1
    rising, out = bool((far > near) != steady[own]), None
    for border, by_motion in ((survey.ends(HALVINGS), True), (survey.losses(), False)):
        for k in np.flatnonzero(np.all(np.sort(border.nodes, axis=1) == sorted((near, far)), axis=1)).tolist():
            place, beside = border.places[k], border.places[k] + 1e-9 * np.array([[-1.0], [1.0]])
            worn = np.prod(np.sign(clearances(site.model, settings_at(beside)))) < 0.0
            kind = "end of stick-slip" if by_motion else "wear of the contact" if worn else "loss of stability"
            start = (border.y[k], border.scale[k]) if by_motion else None
            # Sliding is steady only beyond both.
            if out is None or (out.place < place[0]) == rising:
                out = Turn(float(place[0]), rising, kind, start)
    return bool(steady[own]), out


def _change(site: Site, q: Axis, drawn: Draws | None, tested: Tested | None, margin: float) -> ChangeAdvice:
    own, unit, (steady, turn) = q.name.removesuffix("_at_zeta"), q.unit, nearest_turn(site, q)
    now = number(q.value, unit, "")

    def outside(value: float) -> bool:
        return tested is not None and tested.extrapolated(own, value)

    if turn is None:
        low, high = (said(end, unit) for end in _span(site, q))
        reason = f"{'any, it is steady' if steady else 'cannot be reached, it is not steady'} from {low} to {high}"
        none = number(None, unit, ""), number(None, unit, reason)
        return ChangeAdvice(q.name, q.label, now, *none, None, None, outside(q.value), reason)
    limit, interval, scaled, reason = float(q.value_at(turn.place)), None, None, ""
    if drawn is not None:
        ends = drawn.ends(site, q, turn.place, turn.rising, turn.start)
        # How far off the quantity is now, it will be at the limit: the value to be set is off by as much.
        interval = drawn.interval(ends * q.value / drawn.column(own) if own in drawn.names else ends, limit)
    advised = limit * (1 + margin) if turn.rising else limit / (1 + margin)
    if steady and (q.value >= advised if turn.rising else q.value <= advised):
        advised = q.value
    else:
        shares = np.linspace(0.0, 1.0, BETWEEN + 1)[1:]
        if not _steady(CycleBatch(site.model, moved(site, {q.name: limit * (advised / limit) ** shares}))):
            reason = "sliding is steady only just beyond this limit: the margin does not fit"
        elif interval is not None:
            least, most = (None if end is None else end * advised / limit for end in (interval.low, interval.high))
            scaled = AnswerInterval(least, most, interval.reason)
    return ChangeAdvice(
        quantity=q.name,
        label=q.label,
        now=now,
        limit=number(limit, unit, turn.kind, interval),
        advised=number(None if reason else advised, unit, reason, scaled),
        at="least" if turn.rising else "most",
        kind=turn.kind,
        extrapolated=outside(limit if reason else advised),
        reason=reason,
    )


def _span(site: Site, q: Axis) -> tuple[float, float]:
    """How far a quantity is looked for [SI]."""
    low, high = q.value / CHANGED[q.name], q.value * CHANGED[q.name]
    if q.name in POINT:
        return low, high
    declared = site.model.parameter(q.name.removesuffix("_at_zeta"))
    return max(low, declared.lower), min(high, declared.upper)
