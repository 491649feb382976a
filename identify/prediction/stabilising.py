"""Stabilising changes: the nearest value of each rig quantity that makes sliding steady with a margin, or keeps it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.base.result import Number
from identify.model.model import Model
from identify.prediction.cycle import CycleMap, check_calculable
from identify.prediction.intervals import POINT, AnswerInterval, OperatingPoint, Spread
from identify.prediction.map_axes import Site, axis, moved
from identify.prediction.map_grid import row_at
from identify.prediction.orbit import long_enough, settle
from identify.prediction.orbit_search import OrbitSearch, losses_of_stability
from identify.prediction.path import Crossing
from identify.prediction.point_prediction import number
from identify.prediction.sources import Tested
from identify.prediction.wording import said, with_interval
from identify.simulation.sliding import growth_rates

# ----------------------------------------------------------------------------------------------------------------------
# The nearest value of one rig quantity at which sliding turns steady, or stops being so: a map over that one quantity.
#
# Steady means that small disturbances of sliding die out and that no stick-slip is found, neither from a rested contact
# (the strongest kick a start can give), nor from one that is almost renewed, nor on the branches of orbits that other
# values have.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

Kind = Literal["end of stick-slip", "loss of stability", "wear of the contact"]
STEP = 1.25  # factor between the values looked at


@dataclass(frozen=True)
class Turn:
    """A value [SI] of a quantity at which the answer changes; rising: whether it is steady above; kind of limit;
    slopes (n_w,) by parameters, normal force and drive speed, NaN where they are not to be had."""

    value: float
    rising: bool
    kind: Kind
    slopes: Array


def nearest_turn(site: Site, name: str, low: float, high: float) -> tuple[bool, Turn | None]:
    """Whether sliding is steady at the point, and the nearest value of a quantity between low and high at which that
    changes; None where it stays the same."""
    q = axis(site, name)
    below, above = (max(int(abs(np.log(end / q.value)) / np.log(STEP) + 1e-9), 0) for end in (low, high))
    places = q.place(q.value) + np.log(STEP) * np.arange(-below, above + 1)
    grid = row_at(site, q, places)
    growth = np.full(grid.shape, np.nan)
    growth[grid.admitted] = growth_rates(site.model, grid.settings[grid.admitted])
    found = OrbitSearch(grid, CycleMap.of(site.model, site.setting), growth).run()
    sticks = found.sticks(grid.shape)
    steady = ((growth < 0.0) & ~sticks)[0]
    here = bool(steady[below])
    other = np.flatnonzero((steady != here) & grid.admitted[0])
    if not other.size:
        return here, None
    far = int(other[np.argmin(np.abs(other - below) - 0.25 * (other > below))])  # of two as near the one above
    near = far - 1 if far > below else far + 1
    edge, rising = ("x", 0, min(near, far)), (far > near) != here
    quiet = near if here else far
    changes: list[tuple[Kind, Crossing]] = []
    if edge in found.ends and sticks[0, near] != sticks[0, far]:
        changes.append(("end of stick-slip", found.ends[edge]))
    if (loss := losses_of_stability(grid, growth).get(edge)) is not None:
        changes.append(("wear of the contact" if loss.wear else "loss of stability", loss))
    if not changes:
        middle = Crossing(0.5 * float(places[near] + places[far]), np.full(site.setting.size, np.nan))
        changes.append(("end of stick-slip", middle))
    # Sliding is steady only beyond them all.
    kind, change = min(changes, key=lambda each: abs(each[1].place - float(places[quiet])))
    value = float(q.value_at(change.place))
    return here, Turn(value, rising, kind, value * change.slopes)


# ----------------------------------------------------------------------------------------------------------------------
# Advice: the nearest change of each quantity of the rig that makes sliding steady with a margin, or keeps it so.
# ----------------------------------------------------------------------------------------------------------------------

MARGIN = 0.2
FACTORS = {
    "drive_speed": 1e5,
    "stiffness": 100.0,
    "stiffness_at_zeta": 100.0,
    "damping": 100.0,
    "mass": 100.0,
    "normal_force": 100.0,
}  # what advice is given on, and how far either way it is looked for
WORDS = {
    "drive_speed": ("drive speed", "m/s"),
    "stiffness": ("stiffness (damping h held)", "N/m"),
    "stiffness_at_zeta": ("stiffness (damping ratio ζ held)", "N/m"),
    "damping": ("damping h", "N/m"),
    "mass": ("mass", "kg"),
    "normal_force": ("normal force", "N"),
}
NEEDS = {
    "stiffness_at_zeta": "damping",
    "damping": "damping",
    "mass": "mass",
}  # the parameter without which there is none
BETWEEN = 3  # values between limit and advice at which it is made sure that nothing comes in between


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
) -> StabilisingAdvice:
    """What to change so that sliding is steady at an operating point.

    Args:
        names: what the covariance of the point is of: parameters, "drive_speed", "normal_force".
        tested: the range in which the pair was tested; what lies outside is marked extrapolated. None: not known.
        margin: share by which the quantity is to stay away from its limit.

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
    spread = None
    if point.covariance is not None and names:
        at = dict(zip(POINT, (speed, load), strict=True))
        spread = Spread(model, site.setting[:-2], names, np.asarray(point.covariance, float), at)
    asked = [name for name in FACTORS if NEEDS.get(name, "stiffness") in model.parameter_names]
    found = {n: nearest_turn(site, n, *_span(site, n)) for n in asked if axis(site, n).value > 0.0}
    changes = [_change(site, n, here, turn, spread, tested, margin) for n, (here, turn) in found.items()]
    return _advice(site, found["drive_speed"][0], changes, margin)


def _change(
    site: Site, name: str, steady: bool, turn: Turn | None, spread: Spread | None, tested: Tested | None, margin: float
) -> ChangeAdvice:
    now, (words, unit), reason = axis(site, name).value, WORDS[name], ""

    def outside(value: float) -> bool:
        return tested is not None and tested.extrapolated(name.removesuffix("_at_zeta"), value)

    if turn is None:
        low, high = _span(site, name)
        reason = f"{'it is steady' if steady else 'it is not steady'} from {said(low, unit)} to {said(high, unit)}"
        nothing = number(None, unit, ""), number(None, unit, reason)
        return ChangeAdvice(name, words, number(now, unit, ""), *nothing, None, None, None, outside(now), reason)
    interval = None if spread is None else spread.positive(turn.value, _slopes(site, name, turn, spread.names))
    advised = turn.value * (1 + margin) if turn.rising else turn.value / (1 + margin)
    scaled, reached = interval, True
    if steady and (now >= advised if turn.rising else now <= advised):
        advised, scaled = now, None
    elif not _steady_up_to(site, name, turn.value, advised):
        reason, reached = "sliding is steady only just beyond this limit: the margin does not fit", False
    if scaled is not None:
        ends = [None if end is None else end * advised / turn.value for end in (scaled.low, scaled.high)]
        scaled = AnswerInterval(ends[0], ends[1], scaled.reason)
    return ChangeAdvice(
        quantity=name,
        label=words,
        now=number(now, unit, ""),
        limit=number(turn.value, unit, turn.kind, interval),
        advised=number(advised if reached else None, unit, reason, scaled),
        zeta=advised / (2.0 * site.values["stiffness"]) if name == "damping" and reached else None,
        at="least" if turn.rising else "most",
        kind=turn.kind,
        extrapolated=outside(advised if reached else turn.value),
        reason=reason,
    )


def _span(site: Site, name: str) -> tuple[float, float]:
    """How far a quantity is looked for [SI]."""
    now = axis(site, name).value
    low, high = now / FACTORS[name], now * FACTORS[name]
    if name in POINT:
        return low, high
    declared = site.model.parameter(name.removesuffix("_at_zeta"))
    return max(low, declared.lower), min(high, declared.upper)


def _slopes(site: Site, name: str, turn: Turn, names: Sequence[str]) -> Array:
    """How a limit moves with what is uncertain. What is known of the quantity itself only to some share now is so at
    its limit too: there it is how far off the set value is."""
    order = (*site.model.parameter_names, "normal_force", "drive_speed")
    slopes = turn.slopes[[order.index(n) for n in names]].copy()
    own = name.removesuffix("_at_zeta")
    if own in names:
        slopes[list(names).index(own)] = -turn.value / axis(site, name).value
    return slopes


def _steady_up_to(site: Site, name: str, limit: float, advised: float) -> bool:
    """Whether sliding is steady from a limit up to the value advised, looked at in BETWEEN places."""
    for share in np.linspace(0.0, 1.0, BETWEEN + 1)[1:].tolist():
        w = np.asarray(moved(site, {name: limit * (advised / limit) ** share}), float)
        map_, growth = CycleMap.of(site.model, w), float(growth_rates(site.model, w)[0])
        if growth >= 0.0 or settle(map_, float(w[-1]), patience=long_enough(growth * map_.half_period)).sticks:
            return False
    return True


def _advice(site: Site, steady: bool, rows: Sequence[ChangeAdvice], margin: float) -> StabilisingAdvice:
    where = f"{said(site.drive_speed, 'm/s')} and {said(site.normal_force, 'N')}"
    share = f"a margin of {100 * margin:.3g} %"
    head = (
        f"Sliding is steady at {where}. To keep it so with {share}, all else held:"
        if steady
        else f"To make sliding steady at {where} with {share}, one of these, all else held:"
    )
    return StabilisingAdvice(steady, margin, tuple(rows), "\n".join([head, *(_sentence(row, steady) for row in rows)]))


def _sentence(row: ChangeAdvice, steady: bool) -> str:
    unit, limit, advised, now, least = row.now.unit, row.limit, row.advised.value, row.now.value, row.at == "least"
    # each limit stands alone, so each says its own reason why its interval is open
    reach = f"{said(limit.value, limit.unit)} ({limit.reason})" if limit.reason else with_interval(limit)
    if limit.value is None:
        return f"- {row.label}: {'any' if steady else 'cannot be reached'}; {row.reason}."
    if advised is None:
        return f"- {row.label}: {row.reason} ({reach})."
    notes = [f"limit {reach}, {row.kind}"]
    if row.extrapolated:
        notes.append("extrapolated: outside the tested range")
    beyond = limit.ends[1] if least else limit.ends[0]
    if beyond is not None and (beyond > advised if least else beyond < advised):
        notes.append("the interval of the limit reaches beyond the margin")
    if advised == now:
        return f"- {row.label}: as it is ({said(advised, unit)}); {'; '.join(notes)}."
    ratio = f" (ζ = {row.zeta:.3g})" if row.zeta is not None else ""
    word = "at least" if least else "at most"
    return f"- {row.label} {word} {said(advised, unit)}{ratio}, now {said(now, unit)} ({'; '.join(notes)})."
