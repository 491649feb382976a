"""Stability and amplitude at operating points: the nonlinear model's answer, the closed forms beside it, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.document import FURTHER
from identify.base.errors import SimulationError
from identify.base.result import Number
from identify.base.wording import range_text
from identify.model.model import Model
from identify.prediction.axes import Site
from identify.prediction.closed_forms import CYCLE, MEANING, beyond, closed_forms, judged
from identify.prediction.cycles import CLOSELY, QUANTITIES, CycleBatch, Motions, check_calculable
from identify.prediction.draws import DRAWS, POINT, Draws, OperatingPoint
from identify.prediction.windows import (
    ROUGH,
    Outcome,
    SpeedRange,
    StickTest,
    Window,
    Windows,
    locate,
    outcome_of,
    speed_windows,
)
from identify.prediction.wording import amplitude_text, closed_form_text, shown, stability_text
from identify.simulation.sliding import Sliding, slidings

Array = NDArray[np.float64]

MODEL = "nonlinear model, valid at any speed"
SHOWN = QUANTITIES | {"frequency": "Hz", "share_in_slip": ""}  # what is reported of the jumps, and its unit
QUIET = 1e-3  # natural frequencies: what a growth rate near zero is measured by
LOCATED = 64  # draws of which the end of stick-slip is sought
ALIKE = 0.03  # of the logarithm of the load, up to which draws of one pair end in the same ratio to the estimate


# The answer as values; its document is what `stickslip stability --json` and result.json hold.


@dataclass(frozen=True)
class SlidingAnswer:
    """Steady sliding: whether small disturbances die out, their growth rate, the friction force, eigenvalues [1/s] as
    (real, imaginary); renewed: the contact does not age while it slides."""

    stable: bool
    growth_rate: Number
    friction_force: Number
    eigenvalues: tuple[tuple[float, float], ...]
    renewed: bool


@dataclass(frozen=True)
class StickSlipRange:
    """The drive speeds between which stick-slip exists; None where that was not found within the search."""

    low: Number | None = field(metadata={"key": "from"})
    high: Number | None = field(metadata={"key": "to"})


@dataclass(frozen=True)
class StabilityAnswer:
    """What the pair does here and over all drive speeds [m/s]."""

    outcome: str
    critical_speed: Number
    sliding: SlidingAnswer
    sliding_unstable_between: tuple[tuple[float, float], ...]
    searched_between: tuple[float, float]
    stick_slip_between: tuple[StickSlipRange, ...]
    windows: tuple[Window, ...]
    text: str = ""


@dataclass(frozen=True)
class AmplitudeAnswer:
    """Size and timing of the jumps, by name of `cycles.QUANTITIES`, and their frequency and share of slip."""

    numbers: Mapping[str, Number] = field(metadata=FURTHER)
    text: str = ""


@dataclass(frozen=True)
class ClosedFormsAnswer:
    """The paper's closed forms, each judged by the nonlinear model's answer; ignores: effects they know nothing of."""

    a_V_max: Number
    slip: str
    ignores: tuple[str, ...]
    numbers: Mapping[str, Number] = field(metadata=FURTHER)
    text: str = ""


@dataclass(frozen=True)
class PointPrediction:
    """The whole prediction at one operating point; every number is None where there is none."""

    operating_point: Mapping[str, Number]
    stability: StabilityAnswer
    amplitude: AmplitudeAnswer
    groups: Mapping[str, Number]
    closed_forms: ClosedFormsAnswer
    text: str = ""


@dataclass(frozen=True)
class NoAnswer:
    """Why there is no prediction."""

    text: str


def number(value: float | None, unit: str, validity: str) -> Number:
    """A number as the interface gives it, None where it is not finite."""
    return Number(float(value) if value is not None and np.isfinite(value) else None, unit, None, validity)


# What happens at an operating point, and at draws of it.


@dataclass(frozen=True)
class SolutionSet:
    """The answer of the nonlinear model at one drive speed [m/s].

    figures: QUANTITIES (9,) of the stable orbit there, None without one; y (n_y,): rest state of stick-slip there,
    where there is some; steady: steady sliding there; windows: what happens at every other drive speed, the same
    whatever speed is asked.
    """

    outcome: Outcome
    figures: Array | None
    y: Array | None
    steady: Sliding
    windows: Windows


def solution_set(model: Model, w: Array) -> SolutionSet:
    """The answer at a setting w (n_w,), and at all other drive speeds.

    Raises:
        SimulationError: the motion cannot be integrated, or there is no steady sliding.
    """
    drive_speed, (steady,), batch = float(w[-1]), slidings(model, w), CycleBatch(model, w[None])

    def settled(windows: Windows) -> Motions:
        """From a rested contact, else from the nearest stick-slip of the windows."""
        motions, near = batch.settle(batch.rested()), windows.near(drive_speed)
        return motions if motions.sticks[0] or near is None else batch.settle(near[None])

    windows = speed_windows(model, w)
    motions, (low, high) = settled(windows), windows.searched
    if bool(motions.sticks[0]) != (windows.near(drive_speed) is not None) or not low <= drive_speed <= high:
        # A window narrower than the grid, or a speed at the very edge of one: this speed is a node then.
        windows = speed_windows(model, w, (drive_speed,))
        motions = settled(windows)
    sticks, y = bool(motions.sticks[0]), motions.y[0]
    figures = batch.figures(y[None], CLOSELY)[0] if motions.periodic[0] else None
    outcome = outcome_of(figures is not None, sticks, steady.stable)
    return SolutionSet(outcome, figures, y if sticks else None, steady, windows)


@dataclass(frozen=True, eq=False)
class DrawAnswers:
    """What the rows of `Draws` do around an answer; each is computed when it is first needed."""

    draws: Draws
    answer: SolutionSet

    @cached_property
    def batch(self) -> CycleBatch:
        """The settings of all rows."""
        return CycleBatch(self.draws.model, self.draws.settings)

    @cached_property
    def motions(self) -> Motions:
        """From the stick-slip of the point itself, else from a rested contact."""
        y, batch = self.answer.y, self.batch
        motions = batch.settle(batch.rested() if y is None else np.tile(y, (len(self.draws.settings), 1)))
        left = np.flatnonzero(~motions.sticks)
        if y is not None and left.size:
            motions.update(left, batch.take(left).settle(batch.take(left).rested()))
        return motions

    @cached_property
    def numbers(self) -> Mapping[str, Array]:
        """Numbers (rows,) by name: of the jumps, NaN without an orbit; closed forms and groups; of sliding."""
        rows, settles = np.full((len(self.draws.settings), len(QUANTITIES)), np.nan), self.motions.periodic
        if np.any(settles):
            rows[settles] = self.batch.take(settles).figures(self.motions.y[settles])
        names = (*self.draws.model.parameter_names, "normal_force", "drive_speed")
        values = dict(zip(names, self.draws.settings.T, strict=True))
        forms = closed_forms(values)
        force = np.array([state.force for state in slidings(self.draws.model, self.draws.settings)])
        formed = {f"closed {name}": column for name, column in {**forms.groups, **forms.numbers}.items()}
        return {**_jumps(rows, values), **formed, "friction_force": force}

    def limit(self, part: SpeedRange, upper: bool) -> Array:
        """The upper or lower end (rows,) [m/s] of a range with stick-slip, NaN where none is found.

        It is sought in LOCATED of the draws and in the moved points. Of the other draws it is the regression on their
        settings, with the residuals of those in turn: what it costs is to close in on ends, where motions settle late.
        """
        settings, speed, count = self.draws.settings, part.high if upper else part.low, self.draws.count
        assert speed is not None
        sought = np.delete(np.arange(len(settings)), np.arange(LOCATED, count))

        def at(rows: NDArray[np.intp], logarithms: Array) -> Array:
            return np.column_stack([settings[sought[rows], :-1], np.exp(logarithms)])

        start = part.states[-1 if upper else 0], self.batch.scale[0]
        test = StickTest(self.draws.model, at, *(np.tile(each, (sought.size, 1)) for each in start), rested=True)
        ends = np.full(len(settings), np.nan)
        ends[sought] = locate(test, np.full(sought.size, np.log(speed)), 1.0 if upper else -1.0, ROUGH)
        known = np.flatnonzero(np.isfinite(ends[:LOCATED]))
        if count > LOCATED and known.size:
            varied = settings[:count, np.ptp(settings[:count], axis=0) > 0.0]
            design = np.column_stack([np.ones(count), (varied - varied.mean(axis=0)) / varied.std(axis=0)])
            weights = np.linalg.lstsq(design[known], ends[known], rcond=None)[0]
            residuals = ends[:LOCATED] - design[:LOCATED] @ weights
            residuals *= np.sqrt(known.size / max(known.size - len(weights), 1))
            others = np.arange(LOCATED, count)
            ends[others] = design[others] @ weights + residuals[others % LOCATED]
        return np.exp(ends)


def _number(drawn: DrawAnswers | None, value: float | None, unit: str, validity: str, name: str) -> Number:
    """One of the numbers, with its interval where there are draws."""
    if drawn is None or value is None or not np.isfinite(value):
        return number(value, unit, validity)
    return drawn.draws.number(value, unit, validity, drawn.numbers[name])


def _jumps(rows: Array, values: Mapping[str, float | Array]) -> dict[str, Array]:
    """SHOWN of orbits by their QUANTITIES (n, 9), and "a_V_max" (n,), 0 where the model has no a."""
    known = dict(zip(QUANTITIES, rows.T, strict=True))
    further = {"frequency": 1.0 / known["period"], "share_in_slip": known["slip_duration"] / known["period"]}
    return known | further | {"a_V_max": np.multiply(values.get("a", 0.0), known["peak_speed"])}


# Predictions.


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
    return _prediction(model, OperatingPoint(values, drive_speed, normal_force, covariance), names or (), draws, {})


def predictions(
    model: Model, points: Sequence[OperatingPoint], names: Sequence[str], draws: int = DRAWS
) -> list[PointPrediction | NoAnswer]:
    """The predictions of several operating points, sharing what they have in common: see `predict`.

    A point without an answer says why; the others are not held up by it.
    """
    shared: dict[tuple[object, ...], Array] = {}
    out: list[PointPrediction | NoAnswer] = []
    for point in points:
        try:
            out.append(_prediction(model, point, names, draws, shared))
        except SimulationError as error:
            out.append(NoAnswer(f"no answer for this operating point: {error}"))
    return out


def site_at(model: Model, point: OperatingPoint) -> Site:
    """The site of an operating point.

    Raises:
        SimulationError: a model without an answer, a speed or a load without meaning.
    """
    check_calculable(model)
    speed, load = abs(float(point.drive_speed)), float(point.normal_force)
    if not (0.0 < speed < np.inf and 0.0 < load < np.inf):
        raise SimulationError(
            f"the operating point is {point.drive_speed:g} m/s and {load:g} N; expected a drive speed that is not "
            "zero and a positive normal force: give both"
        )
    return Site(model, {name: float(point.values[name]) for name in model.parameter_names}, speed, load)


def _prediction(
    model: Model,
    point: OperatingPoint,
    names: Sequence[str],
    draws: int,
    shared: dict[tuple[object, ...], Array],
) -> PointPrediction:
    """shared: ends of stick-slip of draws over that of the estimate, of points of one pair."""
    site = site_at(model, point)
    unknown = [n for n in names if n not in model.parameter_names and n not in POINT]
    if unknown:
        raise SimulationError(f"the covariance names {unknown[0]!r}; the model has {', '.join(model.parameter_names)}")
    speed, load = site.drive_speed, site.normal_force
    answer = solution_set(model, site.setting)
    values = {**site.values, "drive_speed": speed, "normal_force": load}
    drawn = None
    if point.covariance is not None and names:
        drawn = DrawAnswers(Draws.of(model, values, names, point.covariance, draws), answer)

    def of_model(value: float | None, unit: str, name: str) -> Number:
        return _number(drawn, value, unit, MODEL, name)

    def limit(part: SpeedRange, upper: bool) -> Number | None:
        end = part.high if upper else part.low
        if end is None or drawn is None:
            return None if end is None else number(end, "m/s", MODEL)
        place = answer.windows.sticking.index(part)
        key = (place, upper, round(np.log(load) / ALIKE), site.setting[:-2].tobytes(), str(point.covariance))
        if key not in shared:
            shared[key] = drawn.limit(part, upper) / end
        return drawn.draws.number(end, "m/s", MODEL, shared[key] * end)

    steady, windows, figures = answer.steady, answer.windows, answer.figures
    between = tuple(StickSlipRange(limit(part, False), limit(part, True)) for part in windows.sticking)
    fastest = shown(windows.searched[1], "m/s")
    if between:
        no_end = f"stick-slip still exists at {fastest}, the highest speed tried"
    else:
        no_end = f"no stick-slip was found at any drive speed from {range_text(*windows.searched, 'm/s')}"
    growth = number(steady.growth, "1/s", MODEL)
    if drawn is not None:
        natural = float(np.sqrt(site.values["stiffness"] / site.values["mass"]))
        growth = drawn.draws.number(steady.growth, "1/s", MODEL, drawn.batch.growth, QUIET * natural)
    stability = StabilityAnswer(
        outcome=answer.outcome.value,
        critical_speed=(between[-1].high if between else None) or number(None, "m/s", no_end),
        sliding=SlidingAnswer(
            stable=steady.stable,
            growth_rate=growth,
            friction_force=of_model(steady.force, "N", "friction_force"),
            eigenvalues=tuple((float(z.real), float(z.imag)) for z in steady.eigenvalues),
            renewed=steady.renewed,
        ),
        sliding_unstable_between=tuple(windows.unstable),
        searched_between=windows.searched,
        stick_slip_between=between,
        windows=windows.listed(),
    )
    if figures is None:
        irregular = answer.outcome is Outcome.IRREGULAR
        why = "it sticks and slips, but not periodically" if irregular else "no stick-slip here"
        amplitude, peak = {name: number(None, unit, why) for name, unit in QUANTITIES.items()}, None
    else:
        now = {name: float(row[0]) for name, row in _jumps(figures[None], values).items()}
        amplitude, peak = {name: of_model(now[name], unit, name) for name, unit in SHOWN.items()}, now["a_V_max"]
    validity = replace(of_model(peak, "", "a_V_max"), validity="the closed forms of a slip need this to be far below 1")
    groups, forms = _closed_forms(model, values, amplitude, windows.end, validity, drawn)
    at = {"drive_speed": number(speed, "m/s", ""), "normal_force": number(load, "N", "")}
    prediction = PointPrediction(at, stability, AmplitudeAnswer(amplitude), groups, forms)
    texts = stability_text(prediction), amplitude_text(prediction), closed_form_text(prediction)
    return replace(
        prediction,
        stability=replace(prediction.stability, text=texts[0]),
        amplitude=replace(prediction.amplitude, text=texts[1]),
        closed_forms=replace(prediction.closed_forms, text=texts[2]),
        text="\n".join(texts),
    )


def _closed_forms(
    model: Model,
    values: Mapping[str, float],
    amplitude: Mapping[str, Number],
    end: float | None,
    validity: Number,
    drawn: DrawAnswers | None,
) -> tuple[dict[str, Number], ClosedFormsAnswer]:
    """The groups, and the closed forms, each beside what the nonlinear model has."""

    def entry(name: str, value: float | None, unit: str, why: str) -> Number:
        return _number(drawn, value, unit, why, f"closed {name}")

    forms = closed_forms(values)
    groups = {name: entry(name, float(value), *MEANING[name]) for name, value in forms.groups.items()}
    ignored, numbers = beyond(model.effects), {name: float(value) for name, value in forms.numbers.items()}
    unaware = f"not valid here: does not include {' and '.join(ignored)}" if ignored else ""
    out = {}
    for name, other in [*((name, amplitude[name].value) for name in CYCLE), ("critical_speed", end)]:
        why = unaware or judged(numbers[name], other, str(forms.status), float(forms.groups["alpha"]))
        out[name] = entry(name, numbers[name], QUANTITIES.get(name, "m/s"), why)
    for name in ("Pi", "Pi_fc", "Omega_c"):
        why = unaware or "exact for small disturbances of steady sliding"
        out[name] = entry(name, None if forms.renewed else numbers[name], "", why)
    return groups, ClosedFormsAnswer(validity, str(forms.status), ignored, out)
