"""Stability and amplitude at one operating point: the nonlinear model's answer, the closed forms beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.comparison import ClosedForms, closed_forms, contact, judged, number
from identify.cycle import CycleMap
from identify.errors import SimulationError
from identify.groups import MEANING
from identify.model import Model
from identify.outlook_words import amplitude_text, closed_form_text, stability_text
from identify.prospect import Outcome, Prospect, prospect
from identify.sensitivity import QUANTITIES, deviation, end_slopes, growth_slopes, orbit_slopes, quantities

Array = NDArray[np.float64]

NORMAL = 1.959963984540054  # half width of a 95 % interval in standard deviations
MODEL = "nonlinear model, valid at any speed"
Interval = tuple[float, float] | None


def outlook(
    model: Model,
    values: Mapping[str, float],
    drive_speed: float,
    normal_force: float,
    covariance: ArrayLike | None = None,
    names: Sequence[str] | None = None,
) -> dict[str, Any]:
    """What follows from a pair and a rig at one drive speed and normal force, as a JSON-able document.

    Args:
        values: every parameter of the model by name, SI.
        drive_speed: [m/s], sign irrelevant, not zero. normal_force: [N], positive.
        covariance: (n, n) of the parameters `names`, in their own SI units (not of logarithms). Every interval
            is 95 %, by linear propagation (of the logarithm where a quantity is positive); None without one.

    Returns:
        {"operating_point", "stability", "amplitude", "closed_forms", "groups", "text"}; every number is
        {"value", "unit", "interval", "validity"}, null where there is none; "text" is plain words, and each of
        "stability", "amplitude" and "closed_forms" has its own "text".

    Raises:
        SimulationError: an operating point without meaning, or a motion that cannot be integrated.
    """
    speed = abs(float(drive_speed))
    if not (0.0 < speed < np.inf and 0.0 < normal_force < np.inf):
        raise SimulationError(
            f"the operating point is {drive_speed:g} m/s and {normal_force:g} N; expected a drive speed that is not "
            "zero and a positive normal force: give both"
        )
    chosen = tuple(names or ()) if covariance is not None else ()
    unknown = [n for n in chosen if n not in model.parameter_names]
    if unknown:
        raise SimulationError(f"the covariance names {unknown[0]!r}; the model has {', '.join(model.parameter_names)}")
    p = np.array([float(values[name]) for name in model.parameter_names])
    map_ = CycleMap(model, float(normal_force), p)
    answer = prospect(map_, speed)
    spread = _Spread(map_, answer, chosen, np.asarray(covariance, float) if chosen else np.zeros((0, 0)))
    forms = closed_forms(contact({n: float(v) for n, v in values.items()}), speed, float(normal_force))
    document: dict[str, Any] = {
        "operating_point": {"drive_speed": number(speed, "m/s", ""), "normal_force": number(normal_force, "N", "")},
        "stability": _stability(answer, spread),
        "amplitude": _amplitude(map_, answer, spread),
        "groups": {
            name: number(value, MEANING[name][0], MEANING[name][1]) for name, value in asdict(forms.groups).items()
        },
    }
    document["closed_forms"] = _closed_forms(forms, answer, document, float(values.get("a", 0.0)))
    document["stability"]["text"] = stability_text(document)
    document["amplitude"]["text"] = amplitude_text(document)
    document["closed_forms"]["text"] = closed_form_text(document)
    document["text"] = "\n".join(document[part]["text"] for part in ("stability", "amplitude", "closed_forms"))
    return document


class _Spread:
    """Intervals of the answers under a covariance; without one, all are None."""

    def __init__(self, map_: CycleMap, answer: Prospect, names: tuple[str, ...], covariance: Array) -> None:
        self._map, self._answer, self._names, self._covariance = map_, answer, names, covariance

    def _positive(self, value: float, slopes: Array) -> Interval:
        width = NORMAL * float(deviation(slopes, self._covariance)) / value if value > 0 else np.nan
        return (value * np.exp(-width), value * np.exp(width)) if np.isfinite(width) and width < 50 else None

    def orbit(self, values: Array) -> list[Interval]:
        orbit = self._answer.orbit
        if not self._names or orbit is None:
            return [None] * values.size
        slopes = orbit_slopes(self._map, orbit, self._names)
        return [self._positive(float(v), s) for v, s in zip(values, slopes, strict=True)]

    def end(self) -> Interval:
        branch = self._answer.branch
        if not self._names or branch is None or branch.end is None:
            return None
        return self._positive(branch.end, end_slopes(self._map, branch, self._names))

    def growth(self) -> Interval:
        if not self._names:
            return None
        rate = self._answer.steady.growth
        slopes = growth_slopes(self._map, self._answer.steady.drive_speed, self._names)
        width = NORMAL * float(deviation(slopes, self._covariance))
        return (rate - width, rate + width)


def _stability(answer: Prospect, spread: _Spread) -> dict[str, Any]:
    steady, branch = answer.steady, answer.branch
    if branch is None:
        why = "no stick-slip was found at any drive speed"
    elif branch.end is None:
        why = f"stick-slip still exists at {branch.highest:.3g} m/s, the highest speed tried"
    else:
        why = MODEL
    return {
        "outcome": answer.outcome.value,
        "critical_speed": number(answer.end, "m/s", why, spread.end()),
        "sliding": {
            "stable": steady.stable,
            "growth_rate": number(steady.growth, "1/s", MODEL, spread.growth()),
            "friction_force": number(steady.force, "N", MODEL),
            "eigenvalues": [[float(z.real), float(z.imag)] for z in steady.eigenvalues],
            "worn": steady.worn,
        },
        "sliding_unstable_between": [list(pair) for pair in answer.unstable],
        "searched_between": list(answer.searched),
        "multiplier": None if answer.orbit is None else answer.orbit.multiplier,
    }


def _amplitude(map_: CycleMap, answer: Prospect, spread: _Spread) -> dict[str, Any]:
    if answer.orbit is None:
        why = (
            "it sticks and slips, but not periodically" if answer.outcome is Outcome.IRREGULAR else "no stick-slip here"
        )
        return {name: number(None, unit, why) for name, unit in QUANTITIES.items()}
    values = quantities(map_, answer.orbit.cycle, answer.orbit.drive_speed)
    rows = zip(QUANTITIES.items(), values.tolist(), spread.orbit(values), strict=True)
    out = {name: number(value, unit, MODEL, interval) for (name, unit), value, interval in rows}
    period = out["period"]
    out["frequency"] = number(
        1 / period["value"], "Hz", MODEL, period["interval"] and (1 / period["interval"][1], 1 / period["interval"][0])
    )
    out["share_in_slip"] = number(values[3] / values[1], "", MODEL)
    return out


def _closed_forms(forms: ClosedForms, answer: Prospect, document: dict[str, Any], a: float) -> dict[str, Any]:
    nonlinear, alpha = document["amplitude"], forms.groups.alpha
    peak = nonlinear["peak_speed"]["value"]
    validity_number = None if peak is None else a * peak

    def beside(value: float, unit: str, other: float | None) -> dict[str, Any]:
        return number(value, unit, judged(value, other, forms.status, alpha))

    local = "exact for small disturbances of steady sliding"
    printed = "as printed, up to a factor 2 too low (2 zeta misread as zeta in its determinant)"
    return {
        "a_V_max": number(validity_number, "", "the closed forms of a slip need this to be far below 1"),
        "slip": forms.status,
        "drop": beside(forms.drop, "N", nonlinear["drop"]["value"]),
        "period": beside(forms.period, "s", nonlinear["period"]["value"]),
        "slip_duration": beside(forms.slip_duration, "s", nonlinear["slip_duration"]["value"]),
        "peak_speed": beside(forms.peak_speed, "m/s", peak),
        "critical_speed": beside(forms.critical_speed, "m/s", answer.end),
        "Pi": number(None if forms.worn else forms.friction_parameter, "", local),
        "Pi_fc": number(None if forms.worn else forms.critical_friction, "", local),
        "Pi_fc_printed": number(forms.critical_friction_printed, "", printed),
        "Omega_c": number(None if forms.worn else forms.critical_frequency, "", local),
    }
