"""Stabilising changes: the nearest value of each rig quantity that makes sliding steady with a margin, or keeps it.

Steady means that small disturbances of sliding die out and that no stick-slip is found, neither from a rested contact
(the strongest kick a start can give), nor from one that is almost renewed, nor beside what other values have.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.base.result import Number
from identify.model.model import Model
from identify.prediction.axes import Axis, Site, admissible, axis, moved
from identify.prediction.batch import CycleBatch
from identify.prediction.draws import DRAWS, POINT, AnswerInterval, Draws, OperatingPoint
from identify.prediction.maps import ends_of_draws
from identify.prediction.orbit import check_calculable
from identify.prediction.point_prediction import number
from identify.prediction.search import CLOSEST, StickTest, bisect, explore
from identify.prediction.sources import Tested
from identify.prediction.windows import HALVINGS
from identify.prediction.wording import advice_text, said
from identify.simulation.sliding import clearances, growth_rates

Array = NDArray[np.float64]

Kind = Literal["end of stick-slip", "loss of stability", "wear of the contact"]
STEP = 1.25  # factor between the values looked at
MARGIN = 0.2
BETWEEN = 3  # values between limit and advice at which it is made sure that nothing comes in between
# What advice is given on: words, unit, how far either way it is looked for, the parameter without which there is none.
CHANGED: Mapping[str, tuple[str, str, float, str]] = {
    "drive_speed": ("drive speed", "m/s", 1e5, "stiffness"),
    "stiffness": ("stiffness (damping h held)", "N/m", 100.0, "stiffness"),
    "stiffness_at_zeta": ("stiffness (damping ratio ζ held)", "N/m", 100.0, "damping"),
    "damping": ("damping h", "N/m", 100.0, "damping"),
    "mass": ("mass", "kg", 100.0, "mass"),
    "normal_force": ("normal force", "N", 100.0, "stiffness"),
}


@dataclass(frozen=True)
class Turn:
    """A coordinate of a quantity at which the answer changes; rising: whether it is steady above; kind of limit; start:
    a rest state (n_y,) of stick-slip beside it with the typical one there, None where it is sliding that changes."""

    place: float
    rising: bool
    kind: Kind
    start: tuple[Array, Array] | None


def nearest_turns(site: Site, names: Sequence[str]) -> dict[str, tuple[bool, Turn | None]]:
    """Whether sliding is steady at the point, and the nearest value of each quantity at which that changes; None where
    it stays the same as far as it is looked for."""
    axes = [axis(site, name) for name in names]
    grids = [_grid(site, q) for q in axes]
    settings = [moved(site, {q.name: q.value_at(places)}) for q, (places, _) in zip(axes, grids, strict=True)]
    ok = [admissible(site.model, each) for each in settings]
    if not all(good[own] for good, (_, own) in zip(ok, grids, strict=True)):
        raise SimulationError(
            "the values at this point are none that the model takes: mu_s above mu_k0, and friction that stays "
            "positive at speed, were expected; look at the parameters that are not identified"
        )
    batch = CycleBatch(site.model, np.concatenate([each[good] for each, good in zip(settings, ok, strict=True)]))
    first = np.cumsum([0, *(int(good.sum()) for good in ok)])
    number_of, beside = np.arange(first[-1]), np.full((first[-1], 2), -1)
    inner = ~np.isin(number_of, first)
    beside[inner, 0] = number_of[inner] - 1
    beside[np.flatnonzero(inner) - 1, 1] = number_of[inner]
    found = explore(batch, beside)
    steady = (batch.growth < 0.0) & ~found.sticks
    here, edges = {}, {}
    for k, (name, (places, own)) in enumerate(zip(names, grids, strict=True)):
        rows = np.full(places.size, -1)
        rows[ok[k]] = np.arange(first[k], first[k + 1])
        here[name] = bool(steady[rows[own]])
        other = np.flatnonzero((rows >= 0) & (steady[rows] != here[name]))
        if other.size:
            far = int(other[np.argmin(np.abs(other - own) - 0.25 * (other > own))])  # of two as near the one above
            near = far - 1 if far > own else far + 1
            edges[name] = (axes[k], places[near], places[far], rows[near], rows[far], (far > near) != here[name])
    turns = _turns(site, edges, batch, found.sticks, found.y)
    return {name: (here[name], turns.get(name)) for name in names}


def _grid(site: Site, q: Axis) -> tuple[Array, int]:
    """Coordinates (n,) looked at, and which of them is the point's own."""
    low, high = _span(site, q.name)
    below, above = (max(int(abs(np.log(end / q.value)) / np.log(STEP) + 1e-9), 0) for end in (low, high))
    return q.place(q.value) + np.log(STEP) * np.arange(-below, above + 1), below


def _turns(
    site: Site,
    edges: Mapping[str, tuple[Axis, float, float, int, int, bool]],
    batch: CycleBatch,
    sticks: NDArray[np.bool_],
    y: Array,
) -> dict[str, Turn]:
    """The places of the changes on edges of quantities, each between two rows of a batch."""
    model, growth, changes = site.model, batch.growth, list[tuple[str, bool, int, float, float]]()
    for name, (_, near, far, a, b, _rising) in edges.items():
        for by_motion, holds in ((True, sticks), (False, growth >= 0.0)):
            if holds[a] != holds[b]:
                inside = (near, far) if holds[a] else (far, near)
                changes.append((name, by_motion, a if holds[a] else b, *inside))

    def settings(which: NDArray[np.intp], places: Array) -> Array:
        given = [(edges[changes[i][0]][0], place) for i, place in zip(which, places, strict=True)]
        return np.stack([moved(site, {q.name: q.value_at(place)}) for q, place in given])

    out: dict[str, Turn] = {}
    for by_motion in (True, False):
        mine = np.array([i for i, change in enumerate(changes) if change[1] == by_motion], dtype=int)
        if not mine.size:
            continue
        from_, start, stop = (np.array([changes[i][k] for i in mine]) for k in (2, 3, 4))

        def at(rows: NDArray[np.intp], places: Array, mine: NDArray[np.intp] = mine) -> Array:
            return settings(mine[rows], places)

        def growing(rows: NDArray[np.intp], places: Array, mine: NDArray[np.intp] = mine) -> NDArray[np.bool_]:
            return growth_rates(model, settings(mine[rows], places)) >= 0.0

        test = StickTest(model, at, y[from_], batch.scale[from_])
        inner, outer = bisect(test, start, stop, HALVINGS) if by_motion else bisect(growing, start, stop, CLOSEST)
        worn = np.prod([np.sign(clearances(model, settings(mine, each))) for each in (inner, outer)], axis=0) < 0.0
        for k, i in enumerate(mine.tolist()):
            name, place = changes[i][0], float(0.5 * (inner[k] + outer[k]))
            kind: Kind = "end of stick-slip" if by_motion else "wear of the contact" if worn[k] else "loss of stability"
            near_state = (test.shares[k] * batch.scale[from_[k]], batch.scale[from_[k]]) if by_motion else None
            turn = Turn(place, edges[name][5], kind, near_state)
            # Sliding is steady only beyond both.
            if name not in out or (out[name].place < place) == turn.rising:
                out[name] = turn
    return out


# ----------------------------------------------------------------------------------------------------------------------
# Advice: the nearest change of each quantity of the rig that makes sliding steady with a margin, or keeps it so.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ChangeAdvice:
    """A change as the interface gives it: the quantity now, its limit and the value advised, which is a least or a most
    one (at; None without a limit); zeta: of the damping advised."""

    quantity: str
    label: str
    now: Number
    limit: Number
    advised: Number
    zeta: float | None
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
            f"advice was asked at {speed:g} m/s and {load:g} N with a margin of {margin:g}; expected positive numbers"
        )
    site = Site(model, {name: float(point.values[name]) for name in model.parameter_names}, speed, load)
    drawn = None
    if point.covariance is not None and names:
        values = dict(site.values) | dict(zip(POINT, (speed, load), strict=True))
        drawn = Draws.of(model, values, names, point.covariance, draws)
    asked = [name for name, (*_, needs) in CHANGED.items() if needs in model.parameter_names]
    found = nearest_turns(site, [name for name in asked if axis(site, name).value > 0.0])
    changes = tuple(_change(site, n, here, turn, drawn, tested, margin) for n, (here, turn) in found.items())
    steady = found["drive_speed"][0]
    where = f"{said(speed, 'm/s')} and {said(load, 'N')}"
    return StabilisingAdvice(steady, margin, changes, advice_text(where, steady, margin, changes))


def _change(
    site: Site, name: str, steady: bool, turn: Turn | None, drawn: Draws | None, tested: Tested | None, margin: float
) -> ChangeAdvice:
    q, (words, unit, *_), reason = axis(site, name), CHANGED[name], ""
    now, own = q.value, name.removesuffix("_at_zeta")

    def outside(value: float) -> bool:
        return tested is not None and tested.extrapolated(own, value)

    if turn is None:
        low, high = _span(site, name)
        reason = f"{'it is steady' if steady else 'it is not steady'} from {said(low, unit)} to {said(high, unit)}"
        nothing = number(None, unit, ""), number(None, unit, reason)
        return ChangeAdvice(name, words, number(now, unit, ""), *nothing, None, None, None, outside(now), reason)
    limit, interval = float(q.value_at(turn.place)), None
    if drawn is not None:
        ends = ends_of_draws(drawn, site, q, turn.place, turn.rising, turn.start)
        # How far off the quantity is now, it will be at the limit: the value to be set is off by as much.
        interval = drawn.interval(ends * now / drawn.column(own) if own in drawn.names else ends, limit)
    advised = limit * (1 + margin) if turn.rising else limit / (1 + margin)
    scaled, reached = interval, True
    if steady and (now >= advised if turn.rising else now <= advised):
        advised, scaled = now, None
    elif not _steady_up_to(site, name, limit, advised):
        reason, reached = "sliding is steady only just beyond this limit: the margin does not fit", False
    if scaled is not None:
        ratio = advised / limit
        ends_now = [None if end is None else end * ratio for end in (scaled.low, scaled.high)]
        scaled = AnswerInterval(ends_now[0], ends_now[1], scaled.reason)
    return ChangeAdvice(
        quantity=name,
        label=words,
        now=number(now, unit, ""),
        limit=number(limit, unit, turn.kind, interval),
        advised=number(advised if reached else None, unit, reason, scaled),
        zeta=advised / (2.0 * site.values["stiffness"]) if name == "damping" and reached else None,
        at="least" if turn.rising else "most",
        kind=turn.kind,
        extrapolated=outside(advised if reached else limit),
        reason=reason,
    )


def _span(site: Site, name: str) -> tuple[float, float]:
    """How far a quantity is looked for [SI]."""
    now, factor = axis(site, name).value, CHANGED[name][2]
    if name in POINT:
        return now / factor, now * factor
    declared = site.model.parameter(name.removesuffix("_at_zeta"))
    return max(now / factor, declared.lower), min(now * factor, declared.upper)


def _steady_up_to(site: Site, name: str, limit: float, advised: float) -> bool:
    """Whether sliding is steady from a limit up to the value advised, looked at in BETWEEN places."""
    shares = np.linspace(0.0, 1.0, BETWEEN + 1)[1:]
    batch = CycleBatch(site.model, moved(site, {name: limit * (advised / limit) ** shares}))
    return bool(np.all(batch.growth < 0.0)) and not np.any(batch.settle(batch.rested()).sticks)
