"""Stabilising changes: the nearest value of each rig quantity that makes sliding steady with a margin, or keeps it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.errors import SimulationError
from identify.model.model import Model
from identify.prediction.closed_forms import number
from identify.prediction.cycle import CycleMap, check_calculable
from identify.prediction.intervals import POINT, Interval, Spread
from identify.prediction.orbit import Orbit, close, settle
from identify.prediction.path import PathEnd, drive_speed_path, trace
from identify.prediction.sources import Tested
from identify.prediction.windows import long_enough
from identify.prediction.wording import said, with_interval
from identify.simulation.sliding import clearances, growth_rates

# ----------------------------------------------------------------------------------------------------------------------
# The nearest value of one rig quantity at which sliding turns steady, or stops being so: the composed model asked.
#
# Steady means that small disturbances of sliding die out and that no stick-slip is found, neither from a rested contact
# (the strongest kick a start can give) nor from the stick-slip of the last value that had it. Outwards in both
# directions from the value there is, in steps of a factor; then the step is halved, and the limit polished along its
# tangent, which also tells how it moves with everything else.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

Kind = Literal["end of stick-slip", "loss of stability", "wear of the contact"]
TIED = {"stiffness_at_zeta": ("stiffness", "damping")}  # settings that one quantity moves in proportion
STEP = 1.25  # factor between the values looked at
HALVINGS = 22
NEAR = 1e-4  # share of the value by which the stick-slip that is followed to its end lies inside
DIFFERENCE, LEAST = 1e-5, 1e-6  # relative step of a difference, and absolute for what is zero
REACH = 0.5  # of the logarithm of the drive speed, within which that end is looked for
POLISHED = 0.02  # share by which the end of stick-slip may differ from where it was found


@dataclass(frozen=True)
class Turn:
    """A value [SI] of a quantity at which the answer changes; rising: whether it is steady above; kind of limit;
    slopes (n_w,) by parameters, normal force and drive speed, NaN where they are not to be had."""

    value: float
    rising: bool
    kind: Kind
    slopes: Array


@dataclass(frozen=True)
class _State:
    steady: bool
    growth: float
    orbit: Orbit | None


class Search:
    """An operating point whose settings are moved one at a time: setting w (n_w,) as `CycleMap.setting`."""

    def __init__(self, map_: CycleMap, drive_speed: float, orbit: Orbit | None = None) -> None:
        self.map, self.w = map_, map_.setting(drive_speed)
        self.here = self.state(self.w, orbit)

    def state(self, w: Array, near: Orbit | None = None) -> _State:
        """What happens at a setting; `near` is a stick-slip close by."""
        growth = float(self._growth(w[None, :])[0])
        map_, speed = self.map.at(w), float(w[-1])
        wait = long_enough(growth * map_.half_period)
        orbit = close(map_, near.y, speed, patience=wait) if near is not None else None
        if orbit is not None and orbit.stable:
            return _State(False, growth, orbit)
        settled = settle(map_, speed, patience=wait)
        return _State(growth < 0 and not settled.sticks, growth, settled.orbit)

    def columns(self, name: str) -> list[int]:
        """The places in a setting that a quantity moves: its own, or those of TIED, whose first it is told by."""
        return [self.map.names.index(n) for n in TIED.get(name, (name,))]

    def now(self, name: str) -> float:
        """The value a quantity has at the operating point."""
        return float(self.w[self.columns(name)[0]])

    def moved(self, name: str, value: float) -> Array:
        """The setting with one quantity at another value."""
        w, columns = self.w.copy(), self.columns(name)
        w[columns[1:]] *= value / self.now(name)
        w[columns[0]] = value
        return w

    def turn(self, name: str, low: float, high: float) -> Turn | None:
        """The nearest value between low and high at which the answer changes; None where it stays the same."""
        now, steps = self.now(name), _outwards(self.now(name), low, high)
        growth = self._growth(np.stack([self.moved(name, after) for _, after in steps])) if steps else np.empty(0)
        for (before, after), rate in zip(steps, growth, strict=True):
            if rate >= 0 and not self.here.steady:
                continue  # not steady there either
            state = self.state(self.moved(name, after), self.here.orbit if before == now else None)
            if state.steady != self.here.steady:
                return self._narrowed(name, before, after)
        return None

    def _growth(self, w: Array) -> Array:
        return growth_rates(self.map.model, np.ascontiguousarray(w[:, :-2]), w[:, -1], w[:, -2])

    def _narrowed(self, name: str, near: float, far: float) -> Turn:
        """The change between two values, of which `near` answers as the operating point does."""
        steady_near = self.here.steady
        states = {steady_near: self.state(self.moved(name, near)), not steady_near: self.state(self.moved(name, far))}
        for _ in range(HALVINGS):
            middle = float(np.sqrt(near * far))
            state = self.state(self.moved(name, middle), states[False].orbit)
            states[state.steady] = state
            near, far = (middle, far) if state.steady == steady_near else (near, middle)
        loud, quiet = (far, near) if steady_near else (near, far)
        if states[False].growth >= 0:  # unstable right up to the limit
            return self._by_stability(name, loud, quiet)
        value, slopes = self._by_fold(name, float(np.sqrt(loud * quiet)), states[False].orbit)
        return Turn(value, quiet > loud, "end of stick-slip", slopes)

    def _by_stability(self, name: str, loud: float, quiet: float) -> Turn:
        value = float(np.sqrt(loud * quiet))
        w = self.moved(name, value)
        ends = self._growth(np.stack([self.moved(name, loud), self.moved(name, quiet)]))
        far = self._growth(np.stack([self.moved(name, value * (1 + s)) for s in (-1e-3, 1e-3)]))
        jumps = abs(ends[1] - ends[0]) > 0.5 * abs(far[1] - far[0])
        steps = DIFFERENCE * np.where(w == 0.0, LEAST / DIFFERENCE, np.abs(w))
        each = np.concatenate([w + np.diag(steps), w - np.diag(steps)])
        if jumps:
            rates = clearances(self.map.model, np.ascontiguousarray(each[:, :-2]), each[:, -1], each[:, -2])
        else:
            rates = self._growth(each)
        by = (rates[: w.size] - rates[w.size :]) / (2.0 * steps)
        with np.errstate(all="ignore"):
            slopes = -by / self._rate(name, by, w, value)
        return Turn(value, quiet > loud, "wear of the contact" if jumps else "loss of stability", slopes)

    def _rate(self, name: str, by: Array, w: Array, value: float) -> float:
        """Derivative by a quantity, from those by the settings it moves."""
        columns = self.columns(name)
        return float(by[columns] @ w[columns]) / value

    def _by_fold(self, name: str, value: float, orbit: Orbit | None) -> tuple[float, Array]:
        """Limit and slopes from the fold over drive speed at the value found; NaN slopes without one."""
        unknown = value, np.full(self.w.size, np.nan)
        if orbit is None:
            return unknown
        speed = float(self.w[-1])
        at = self.w if name == "drive_speed" else self.moved(name, value)
        end = self._fold(self.map.at(at), orbit)
        if end is None:
            return unknown
        ending, slopes = float(np.exp(end.place)), np.exp(end.place) * end.slopes
        if name == "drive_speed":
            slopes[-1] = np.nan
            return ending, slopes
        slopes[-1] = -1.0  # the end of stick-slip is to stay at the drive speed
        by = self._rate(name, slopes, at, value)
        with np.errstate(all="ignore"):
            better = value * float(np.exp((speed - ending) / (by * value)))
            slopes = -slopes / by
        return (better, slopes) if abs(better / value - 1) < POLISHED else (value, slopes)

    def _fold(self, map_: CycleMap, orbit: Orbit) -> PathEnd | None:
        """The fold over the logarithm of the drive speed nearest to an orbit, towards faster or slower drives."""
        ends = []
        here = float(np.log(orbit.drive_speed))
        for sign in (1, -1):
            place = here - sign * 10 * NEAR
            speed = float(np.exp(place))
            seed = close(map_, orbit.y, speed) or settle(map_, speed).orbit
            if seed is not None:
                setting_path = drive_speed_path(seed.cycle.setting)
                path = trace(
                    map_,
                    seed,
                    setting_path if sign > 0 else setting_path.reversed(),
                    sign * place,
                    sign * place + REACH,
                )
                ends += [] if path.end is None else [PathEnd(sign * path.end.place, sign * path.end.slopes)]
        return min(ends, key=lambda end: abs(end.place - here), default=None)


def _outwards(now: float, low: float, high: float) -> list[tuple[float, float]]:
    """Steps (from, to) away from `now` within low and high, alternating between up and down, nearest first."""
    steps = []
    for factor, end in ((STEP, high), (1 / STEP, low)):
        count = int(np.floor(np.log(end / now) / np.log(factor) + 1e-9))
        places = [now * factor**i for i in range(max(count, 0) + 1)]
        steps.append(list(pairwise(places)))
    up, down = steps
    longest = max(len(up), len(down))
    return [pair for i in range(longest) for pair in (*up[i : i + 1], *down[i : i + 1])]


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
class StabilisingChange:
    """What a quantity has to be: its limit with its interval, and the value advised (None: cannot be reached, `reason`
    says why); least: it is a least value (else a most); extrapolated: outside the tested range."""

    quantity: str
    now: float
    turn: Turn | None
    interval: Interval | None
    advised: float | None
    extrapolated: bool
    reason: str = ""


def stabilising_changes(
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


def _change(
    search: Search, name: str, spread: Spread | None, tested: Tested | None, margin: float
) -> StabilisingChange:
    now = search.now(name)
    low, high = _admissible(search.map.model, name, now / FACTORS[name], now * FACTORS[name])
    turn = search.turn(name, low, high)
    outside = tested is not None and tested.extrapolated(name.removesuffix("_at_zeta"), now)
    if turn is None:
        unit = WORDS[name][1]
        said_so = "it is steady" if search.here.steady else "it is not steady"
        return StabilisingChange(
            name, now, None, None, None, outside, f"{said_so} from {said(low, unit)} to {said(high, unit)}"
        )
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
    return StabilisingChange(name, now, turn, interval, advised if np.isfinite(advised) else None, outside, reason)


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


def _document(search: Search, changes: Sequence[StabilisingChange], margin: float) -> dict[str, Any]:
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


def _row(change: StabilisingChange, stiffness: float) -> dict[str, Any]:
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
