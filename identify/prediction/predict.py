"""Stability and amplitude at operating points: the nonlinear model's answer, the closed forms beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.errors import SimulationError
from identify.base.quantiles import LEVEL, beta
from identify.base.result import Number
from identify.model.model import Model
from identify.prediction.axes import Site, axis
from identify.prediction.batch import CycleBatch, Motions, cycle_figures
from identify.prediction.closed_forms import CYCLE, ClosedForms, beyond, closed_forms, judged
from identify.prediction.draws import DRAWS, POINT, AnswerInterval, Draws, OperatingPoint
from identify.prediction.groups import MEANING
from identify.prediction.orbit import QUANTITIES, CycleMap, Orbit, check_calculable, close
from identify.prediction.point_prediction import (
    AmplitudeAnswer,
    ClosedFormsAnswer,
    NoAnswer,
    PointPrediction,
    SlidingAnswer,
    SpeedWindow,
    StabilityAnswer,
    StickSlipRange,
    number,
)
from identify.prediction.windows import Outcome, SpeedRange, Windows, outcome_of, speed_windows
from identify.prediction.wording import amplitude_text, closed_form_text, said, stability_text
from identify.simulation.sliding import Sliding, slidings

Array = NDArray[np.float64]

MODEL = "nonlinear model, valid at any speed"
PERIOD, SLIP, PEAK = (list(QUANTITIES).index(name) for name in ("period", "slip_duration", "peak_speed"))
SHOWN = QUANTITIES | {"frequency": "Hz", "share_in_slip": ""}  # what is reported of the jumps, and its unit
QUIET = 1e-3  # natural frequencies: what a growth rate near zero is measured by


# ----------------------------------------------------------------------------------------------------------------------
# What happens at an operating point: stick-slip, steady sliding, or both.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SolutionSet:
    """The answer of the nonlinear model at one drive speed [m/s].

    orbit: periodic stick-slip there, None without one; y (n_y,): rest state of its stick-slip, where there is some;
    steady: steady sliding there; windows: what happens at every other drive speed, the same whatever speed is asked.
    """

    outcome: Outcome
    orbit: Orbit | None
    y: Array | None
    steady: Sliding
    windows: Windows


def solution_set(map_: CycleMap, drive_speed: float) -> SolutionSet:
    """The answer at drive speed [m/s], positive, and at all others.

    Raises:
        SimulationError: the motion cannot be integrated, or there is no steady sliding.
    """
    w = map_.setting(drive_speed)
    (steady,) = slidings(map_.model, w)
    windows, batch = speed_windows(map_.model, w), CycleBatch(map_.model, w[None])
    found, (low, high) = _settled(batch, drive_speed, windows), windows.searched
    if bool(found.sticks[0]) != (windows.near(drive_speed) is not None) or not low <= drive_speed <= high:
        # A window narrower than the grid, or a speed at the very edge of one: this speed is a node then.
        windows = speed_windows(map_.model, w, (drive_speed,))
        found = _settled(batch, drive_speed, windows)
    orbit = close(map_, found.y[0], drive_speed, steady.growth) if found.periodic[0] else None
    orbit = orbit if orbit is not None and orbit.stable else None
    outcome = outcome_of(orbit is not None, bool(found.sticks[0]), steady.stable)
    return SolutionSet(outcome, orbit, found.y[0] if found.sticks[0] else None, steady, windows)


def _settled(batch: CycleBatch, speed: float, windows: Windows) -> Motions:
    """What the motion settles on from a rested contact, else from the nearest stick-slip of the windows."""
    found, near = batch.settle(batch.rested()), windows.near(speed)
    return found if found.sticks[0] or near is None else batch.settle(near[None])


# ----------------------------------------------------------------------------------------------------------------------
# What draws of an operating point do.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class DrawAnswers:
    """What the rows of `Draws` do around an answer at a site; each is computed when it is first needed."""

    draws: Draws
    site: Site
    answer: SolutionSet

    @cached_property
    def batch(self) -> CycleBatch:
        """The settings of all rows."""
        return CycleBatch(self.draws.model, self.draws.settings)

    @cached_property
    def motions(self) -> Motions:
        """From the stick-slip of the point itself, else from a rested contact."""
        y = self.answer.y
        found = self.batch.settle(self.batch.rested() if y is None else np.tile(y, (len(self.draws.settings), 1)))
        left = np.flatnonzero(~found.sticks)
        if y is not None and left.size:
            part = self.batch.take(left)
            found.update(left, part.settle(part.rested()))
        return found

    @cached_property
    def jumps(self) -> Mapping[str, Array]:
        """SHOWN of the orbits, and a V_max where the model has an a; NaN (rows,) without an orbit."""
        rows, settles = np.full((len(self.draws.settings), len(QUANTITIES)), np.nan), self.motions.periodic
        if np.any(settles):
            rows[settles] = self.batch.take(settles).figures(self.motions.y[settles])
        has_a = "a" in self.site.model.parameter_names
        return _jumps(rows, self.draws.column("a") if has_a else np.zeros(len(rows)))

    @cached_property
    def forms(self) -> Mapping[str, Array]:
        """Numbers (rows,) of the closed forms and groups."""
        names = (*self.draws.model.parameter_names, "normal_force", "drive_speed")
        forms = closed_forms(dict(zip(names, self.draws.settings.T, strict=True)))
        return {**forms.groups, **forms.numbers}

    @cached_property
    def sliding_force(self) -> Array:
        """Force (rows,) [N] that the load cell sees in steady sliding."""
        return np.array([state.force for state in slidings(self.draws.model, self.draws.settings)])

    def limit(self, part: SpeedRange, upper: bool) -> Array:
        """The upper or lower end (rows,) [m/s] of a range with stick-slip, NaN where none is found."""
        speed, q = (part.high if upper else part.low), axis(self.site, "drive_speed")
        assert speed is not None
        start = part.states[-1 if upper else 0], self.batch.scale[0]
        return self.draws.ends(self.site, q, q.place(speed), upper, start)

    def probability(self) -> Number:
        """Of stick-slip: the share of the draws that stick and slip, with its interval (Clopper and Pearson)."""
        if self.draws.open:
            names = ", ".join(dict.fromkeys(name for each in self.draws.open for name in each))
            return Number(None, "", None, f"open: {names} is not identifiable here")
        hits, n = int(np.sum(self.motions.sticks[: self.draws.count])), self.draws.count
        tail = (1 - LEVEL) / 2
        low = beta(tail, hits, n - hits + 1) if hits else 0.0
        high = beta(1 - tail, hits + 1, n - hits) if hits < n else 1.0
        return Number(hits / n if n else None, "", (low, high), f"{n} draws of what is uncertain")


def _jumps(rows: Array, a: Array) -> dict[str, Array]:
    """SHOWN of orbits by their QUANTITIES (n, 9), and "a_V_max" (n,)."""
    period = rows[:, PERIOD]
    further = {"frequency": 1.0 / period, "share_in_slip": rows[:, SLIP] / period, "a_V_max": a * rows[:, PEAK]}
    return dict(zip(QUANTITIES, rows.T, strict=True)) | further


# ----------------------------------------------------------------------------------------------------------------------
# Predictions.
# ----------------------------------------------------------------------------------------------------------------------


def predict(
    model: Model,
    values: Mapping[str, float],
    drive_speed: float,
    normal_force: float,
    covariance: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    draws: int = DRAWS,
) -> PointPrediction:
    """What follows from a pair and a rig at one drive speed and normal force.

    Args:
        values, drive_speed, normal_force, covariance: as in `OperatingPoint`.
        names: what the covariance is of: parameters, "drive_speed", "normal_force".
        draws: from the covariance, for intervals.

    Returns:
        every number with unit, interval and validity, None where there is none, and plain words. Intervals hold 95 % of
        the draws, None without a covariance; where the parameters are not known well enough, both ends are None and
        "reason" says which.

    Raises:
        SimulationError: an operating point without meaning, or a motion that cannot be integrated.
    """
    point = OperatingPoint(values, drive_speed, normal_force, covariance)
    return _prediction(model, point, names or (), draws, {})


def predictions(
    model: Model, points: Sequence[OperatingPoint], names: Sequence[str], draws: int = DRAWS
) -> list[PointPrediction | NoAnswer]:
    """The predictions of several operating points, sharing what they have in common: see `predict`.

    A point without an answer says why; the others are not held up by it.
    """
    shared: Shared = {}
    out: list[PointPrediction | NoAnswer] = []
    for point in points:
        try:
            out.append(_prediction(model, point, names, draws, shared))
        except SimulationError as error:
            out.append(NoAnswer(f"no answer for this operating point: {error}"))
    return out


Shared = dict[tuple[object, ...], Array]  # ends of stick-slip of draws over that of the estimate, of points of one pair
ALIKE = 0.03  # of the logarithm of the normal force, up to which the same ratios serve both


def _prediction(
    model: Model, point: OperatingPoint, names: Sequence[str], draws: int, shared: Shared
) -> PointPrediction:
    check_calculable(model)
    unknown = [n for n in names if n not in model.parameter_names and n not in POINT]
    if unknown:
        raise SimulationError(f"the covariance names {unknown[0]!r}; the model has {', '.join(model.parameter_names)}")
    map_ = map_of(model, point)
    speed = abs(float(point.drive_speed))
    answer = solution_set(map_, speed)
    site = Site(model, dict(zip(model.parameter_names, map_.p.tolist(), strict=True)), speed, map_.normal_force)
    values = {**site.values, "drive_speed": speed, "normal_force": site.normal_force}
    drawn = None
    if point.covariance is not None and names:
        drawn = DrawAnswers(Draws.of(model, values, names, point.covariance, draws), site, answer)

    def limit(part: SpeedRange, upper: bool) -> Number | None:
        end = part.high if upper else part.low
        if end is None or drawn is None:
            return None if end is None else number(end, "m/s", MODEL)
        load = round(np.log(site.normal_force) / ALIKE)
        key = (answer.windows.sticking.index(part), upper, load, map_.p.tobytes(), str(point.covariance))
        if key not in shared:
            shared[key] = drawn.limit(part, upper) / end
        return number(end, "m/s", MODEL, drawn.draws.interval(shared[key] * end, end))

    amplitude, validity = _amplitude(model, answer, values, drawn)
    forms = closed_forms(values)
    beside = {name: amplitude[name].value for name in CYCLE} | {"critical_speed": answer.windows.end}
    made = PointPrediction(
        operating_point={"drive_speed": number(speed, "m/s", ""), "normal_force": number(site.normal_force, "N", "")},
        stability=_stability(answer, drawn, QUIET / map_.time, limit),
        amplitude=AmplitudeAnswer(amplitude),
        groups={
            name: number(float(value), *MEANING[name], _of_form(drawn, name, float(value)))
            for name, value in forms.groups.items()
        },
        closed_forms=_closed_forms(forms, model.effects, beside, validity, drawn),
    )
    texts = stability_text(made), amplitude_text(made), closed_form_text(made)
    return replace(
        made,
        stability=replace(made.stability, text=texts[0]),
        amplitude=replace(made.amplitude, text=texts[1]),
        closed_forms=replace(made.closed_forms, text=texts[2]),
        text="\n".join(texts),
    )


def map_of(model: Model, point: OperatingPoint) -> CycleMap:
    """The return map at an operating point.

    Raises:
        SimulationError: a speed or a load without meaning.
    """
    speed, load = abs(float(point.drive_speed)), float(point.normal_force)
    if not (0.0 < speed < np.inf and 0.0 < load < np.inf):
        raise SimulationError(
            f"the operating point is {point.drive_speed:g} m/s and {load:g} N; expected a drive speed that is not "
            "zero and a positive normal force: give both"
        )
    return CycleMap(model, load, np.array([float(point.values[name]) for name in model.parameter_names]))


def _stability(
    answer: SolutionSet, drawn: DrawAnswers | None, quiet: float, limit: Callable[[SpeedRange, bool], Number | None]
) -> StabilityAnswer:
    steady, windows, orbit = answer.steady, answer.windows, answer.orbit
    low, high = windows.searched
    if not windows.sticking:
        why = f"no stick-slip was found at any drive speed from {said(low, 'm/s')} to {said(high, 'm/s')}"
    else:
        why = f"stick-slip still exists at {said(high, 'm/s')}, the highest speed tried"
    between = tuple(StickSlipRange(limit(part, False), limit(part, True)) for part in windows.sticking)
    growth = drawn.draws.interval(drawn.batch.growth, steady.growth, quiet) if drawn else None
    force = drawn.draws.interval(drawn.sliding_force, steady.force) if drawn else None
    return StabilityAnswer(
        outcome=answer.outcome.value,
        critical_speed=(between[-1].high if between else None) or number(None, "m/s", why),
        sliding=SlidingAnswer(
            stable=steady.stable,
            growth_rate=number(steady.growth, "1/s", MODEL, growth),
            friction_force=number(steady.force, "N", MODEL, force),
            eigenvalues=tuple((float(z.real), float(z.imag)) for z in steady.eigenvalues),
            worn=steady.worn,
        ),
        sliding_unstable_between=tuple(windows.unstable),
        searched_between=(low, high),
        stick_slip_between=between,
        windows=tuple(SpeedWindow(window.low, window.high, window.outcome.value) for window in windows.listed()),
        multiplier=None if orbit is None else orbit.multiplier,
        multipliers=tuple((float(z.real), float(z.imag)) for z in orbit.multipliers) if orbit else None,
        probability=drawn.probability() if drawn else Number(None),
    )


def _amplitude(
    model: Model, answer: SolutionSet, values: Mapping[str, float], drawn: DrawAnswers | None
) -> tuple[dict[str, Number], Number]:
    """The numbers of the jumps, and a V_max."""
    needs = "the closed forms of a slip need this to be far below 1"
    if answer.orbit is None:
        irregular = answer.outcome is Outcome.IRREGULAR
        why = "it sticks and slips, but not periodically" if irregular else "no stick-slip here"
        return {name: number(None, unit, why) for name, unit in QUANTITIES.items()}, number(None, "", needs)
    figures = cycle_figures(model, answer.orbit.cycle)[None]
    now = {name: float(row[0]) for name, row in _jumps(figures, np.array([values.get("a", 0.0)])).items()}
    intervals = {name: drawn.draws.interval(drawn.jumps[name], now[name]) if drawn else None for name in now}
    out = {name: number(now[name], unit, MODEL, intervals[name]) for name, unit in SHOWN.items()}
    return out, number(now["a_V_max"], "", needs, intervals["a_V_max"] if now["a_V_max"] > 0.0 else None)


def _of_form(drawn: DrawAnswers | None, name: str, value: float) -> AnswerInterval | None:
    """The interval of a number of the closed forms or of a group; None where nothing in it is uncertain."""
    if drawn is None or not np.isfinite(value):
        return None
    rows = drawn.forms[name]
    return None if np.all(rows == rows[0]) else drawn.draws.interval(rows, value)


def _closed_forms(
    forms: ClosedForms,
    effects: Sequence[str],
    beside: Mapping[str, float | None],
    validity: Number,
    drawn: DrawAnswers | None,
) -> ClosedFormsAnswer:
    """The closed forms, each beside what the nonlinear model has."""
    ignored, numbers = beyond(effects), {name: float(value) for name, value in forms.numbers.items()}
    unaware = f"not valid here: knows nothing of {' and '.join(ignored)}" if ignored else ""
    local = unaware or "exact for small disturbances of steady sliding"
    out = {}
    for name, other in beside.items():
        why = unaware or judged(numbers[name], other, str(forms.status), float(forms.groups["alpha"]))
        out[name] = number(numbers[name], QUANTITIES.get(name, "m/s"), why, _of_form(drawn, name, numbers[name]))
    for name in ("Pi", "Pi_fc", "Pi_fc_printed", "Omega_c"):
        printed = name == "Pi_fc_printed"
        value = None if forms.worn and not printed else numbers[name]
        why = "as printed, eq. (25): too low, as its determinant has zeta where 2 zeta belongs" if printed else local
        out[name] = number(value, "", why, _of_form(drawn, name, numbers[name]))
    return ClosedFormsAnswer(validity, str(forms.status), ignored, out)
