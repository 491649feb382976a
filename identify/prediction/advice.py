"""Advice: the nearest change of each quantity of the rig that makes sliding steady with a margin, or keeps it so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.errors import SimulationError
from identify.model.model import Model
from identify.prediction.calculable import check_calculable
from identify.prediction.comparison import number
from identify.prediction.cycle import CycleMap
from identify.prediction.drawn import POINT
from identify.prediction.outlook_words import said, with_interval
from identify.prediction.remedy import Search, Turn
from identify.prediction.spread import Interval, Spread
from identify.prediction.tested import Tested

Array = NDArray[np.float64]

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
class Change:
    """What a quantity has to be: its limit with its interval, and the value advised (None: cannot be reached, `reason`
    says why); least: it is a least value (else a most); extrapolated: outside the tested range."""

    quantity: str
    now: float
    turn: Turn | None
    interval: Interval | None
    advised: float | None
    extrapolated: bool
    reason: str = ""


def advise(
    model: Model,
    values: Mapping[str, float],
    drive_speed: float,
    normal_force: float,
    covariance: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    tested: Tested | None = None,
    margin: float = MARGIN,
) -> dict[str, Any]:
    """What to change so that sliding is steady at an operating point, as a JSON-able document.

    Args:
        values: every parameter of the model by name [SI]. drive_speed: [m/s], not zero. normal_force: [N], positive.
        covariance: (f, f) [SI] of `names` (parameters, "drive_speed", "normal_force"), None without one.
        tested: the range in which the pair was tested; what lies outside is marked extrapolated. None: not known.
        margin: share by which the quantity is to stay away from its limit.

    Returns:
        {"steady", "margin", "changes": [{"quantity", "now", "limit", "advised", "at", "kind", "extrapolated",
        "zeta", "reason"}], "text"}. Limits and advised values are {"value", "unit", "interval", "validity"}, null where
        there is none. All but the one quantity is held; "at" is "least" or "most".

    Raises:
        SimulationError: a model or an operating point without an answer.
    """
    check_calculable(model)
    speed, load = abs(float(drive_speed)), float(normal_force)
    if not (0.0 < speed < np.inf and 0.0 < load < np.inf and 0.0 < margin < np.inf):
        raise SimulationError(
            f"advice was asked at {speed:g} m/s and {load:g} N with a margin of {margin:g}; expected positive numbers"
        )
    map_ = CycleMap(model, load, np.array([float(values[name]) for name in model.parameter_names]))
    search = Search(map_, speed)
    spread = None
    if covariance is not None and names:
        point = dict(zip(POINT, (speed, load), strict=True))
        spread = Spread(model, map_.p, names, np.asarray(covariance, float), point)
    changes = [
        _change(search, name, spread, tested, margin)
        for name in FACTORS
        if NEEDS.get(name, "stiffness") in model.parameter_names and search.now(name) > 0.0
    ]
    return _document(search, changes, margin)


def _change(search: Search, name: str, spread: Spread | None, tested: Tested | None, margin: float) -> Change:
    now = search.now(name)
    low, high = _admissible(search.map.model, name, now / FACTORS[name], now * FACTORS[name])
    turn = search.turn(name, low, high)
    outside = tested is not None and tested.extrapolated(name.removesuffix("_at_zeta"), now)
    if turn is None:
        unit = WORDS[name][1]
        said_so = "it is steady" if search.here.steady else "it is not steady"
        return Change(name, now, None, None, None, outside, f"{said_so} from {said(low, unit)} to {said(high, unit)}")
    interval = None if spread is None else spread.positive(turn.value, _slopes(search, name, turn, spread.names))
    advised = turn.value * (1 + margin) if turn.rising else turn.value / (1 + margin)
    reason = ""
    kept = search.here.steady and (now >= advised if turn.rising else now <= advised)
    if kept:
        advised = now
    elif not _steady_up_to(search, name, turn.value, advised):
        reason, advised = "sliding is steady only just beyond this limit: the margin does not fit", np.nan
    outside = tested is not None and tested.extrapolated(
        name.removesuffix("_at_zeta"), advised if advised > 0 else turn.value
    )
    return Change(name, now, turn, interval, advised if np.isfinite(advised) else None, outside, reason)


def _admissible(model: Model, name: str, low: float, high: float) -> tuple[float, float]:
    if name in POINT:
        return low, high
    declared = model.parameter(name.removesuffix("_at_zeta"))
    return max(low, declared.lower), min(high, declared.upper)


def _slopes(search: Search, name: str, turn: Turn, names: Sequence[str]) -> Array:
    """How a limit moves with what is uncertain. What is known of the quantity itself only to some share now is so at
    its limit too: there it is how far off the set value is."""
    slopes = turn.slopes[[search.map.names.index(n) for n in names]].copy()
    own = name.removesuffix("_at_zeta")
    if own in names:
        slopes[list(names).index(own)] = -turn.value / search.now(name)
    return slopes


def _steady_up_to(search: Search, name: str, limit: float, advised: float) -> bool:
    shares = np.linspace(0.0, 1.0, BETWEEN + 1)[1:]
    return all(search.state(search.moved(name, limit * (advised / limit) ** s)).steady for s in shares.tolist())


def _document(search: Search, changes: Sequence[Change], margin: float) -> dict[str, Any]:
    steady = search.here.steady
    stiffness = search.now("stiffness")
    rows = [_row(change, stiffness) for change in changes]
    where = f"{said(float(search.w[-1]), 'm/s')} and {said(float(search.w[-2]), 'N')}"
    share = f"a margin of {100 * margin:.3g} %"
    head = (
        f"Sliding is steady at {where}. To keep it so with {share}, all else held:"
        if steady
        else f"To make sliding steady at {where} with {share}, one of these, all else held:"
    )
    text = "\n".join([head, *(_sentence(row, steady) for row in rows)])
    return {"steady": steady, "margin": margin, "changes": rows, "text": text}


def _row(change: Change, stiffness: float) -> dict[str, Any]:
    words, unit = WORDS[change.quantity]
    turn, advised, interval = change.turn, change.advised, change.interval
    limit = None if turn is None else turn.value
    scaled = None
    if interval is not None and advised is not None and limit and advised != change.now:
        ends = [None if end is None else end * advised / limit for end in (interval.low, interval.high)]
        scaled = Interval(ends[0], ends[1], interval.reason)
    return {
        "quantity": change.quantity,
        "label": words,
        "now": number(change.now, unit, ""),
        "limit": number(limit, unit, "" if turn is None else turn.kind, interval),
        "advised": number(advised, unit, change.reason, scaled),
        "zeta": None if change.quantity != "damping" or not advised else advised / (2.0 * stiffness),
        "at": None if turn is None else "least" if turn.rising else "most",
        "kind": None if turn is None else turn.kind,
        "extrapolated": change.extrapolated,
        "reason": change.reason,
    }


def _sentence(row: Mapping[str, Any], steady: bool) -> str:
    unit, limit, advised = row["now"]["unit"], row["limit"], row["advised"]
    if limit["value"] is None:
        return f"- {row['label']}: {'any' if steady else 'cannot be reached'}; {row['reason']}."
    if advised["value"] is None:
        return f"- {row['label']}: {row['reason']} ({_limit(limit)})."
    word = "at least" if row["at"] == "least" else "at most"
    ratio = f" (ζ = {row['zeta']:.3g})" if row["zeta"] is not None else ""
    kept = " as it is" if advised["value"] == row["now"]["value"] else f" now {said(row['now']['value'], unit)}"
    notes = [f"limit {_limit(limit)}, {row['kind']}"]
    if row["extrapolated"]:
        notes.append("extrapolated: outside the tested range")
    ends = limit["interval"] or (None, None)
    beyond = ends[1] if row["at"] == "least" else ends[0]
    if beyond is not None and (beyond > advised["value"] if row["at"] == "least" else beyond < advised["value"]):
        notes.append("the interval of the limit reaches beyond the margin")
    if advised["value"] == row["now"]["value"]:
        return f"- {row['label']}:{kept} ({said(advised['value'], unit)}); {'; '.join(notes)}."
    return f"- {row['label']} {word} {said(advised['value'], unit)}{ratio},{kept} ({'; '.join(notes)})."


def _limit(limit: Mapping[str, Any]) -> str:
    """A limit with its interval, or why that is open: each limit stands alone, so each says its own reason."""
    if limit.get("reason"):
        return f"{said(limit['value'], limit['unit'])} ({limit['reason']})"
    return with_interval(limit)
