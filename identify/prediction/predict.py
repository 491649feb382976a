"""Stability and amplitude at operating points: the nonlinear model's answer, the closed forms beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.errors import SimulationError
from identify.base.quantiles import LEVEL, beta
from identify.base.result import Interval, Number
from identify.model.model import Model
from identify.prediction.batch import CycleBatch, Motions
from identify.prediction.closed_forms import CYCLE, ClosedForms, beyond, closed_forms, forms_of_rows, judged
from identify.prediction.draws import DRAWS, POINT, AnswerInterval, Draws, OperatingPoint
from identify.prediction.groups import MEANING
from identify.prediction.orbit import CycleMap, Orbit, check_calculable, close
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
from identify.prediction.quantities import QUANTITIES, quantities
from identify.prediction.search import CLOSER, StickTest, locate
from identify.prediction.stability import printed_form
from identify.prediction.windows import Outcome, SpeedRange, Windows, outcome_of, speed_windows
from identify.prediction.wording import amplitude_text, certainty_text, closed_form_text, said, stability_text
from identify.simulation.sliding import Sliding, slidings

Array = NDArray[np.float64]

MODEL = "nonlinear model, valid at any speed"
PERIOD, SLIP, PEAK = (list(QUANTITIES).index(name) for name in ("period", "slip_duration", "peak_speed"))
QUIET = 1e-3  # natural frequencies: a growth rate below this is told as if it were this large


# ----------------------------------------------------------------------------------------------------------------------
# What happens at operating points: stick-slip, steady sliding, or both.
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

    @property
    def end(self) -> float | None:
        """Drive speed above which there is no stick-slip [m/s]; None without stick-slip, or where it goes on."""
        return self.windows.end


def solution_set(map_: CycleMap, drive_speed: float) -> SolutionSet:
    """The answer at drive speed [m/s], positive, and at all others.

    Raises:
        SimulationError: the motion cannot be integrated, or there is no steady sliding.
    """
    w = map_.setting(drive_speed)
    (steady,) = slidings(map_.model, w)
    windows = speed_windows(map_.model, w)
    low, high = windows.searched
    batch = CycleBatch(map_.model, w[None])
    found = _settled(batch, drive_speed, windows)
    if bool(found.sticks[0]) != windows.sticks(drive_speed) or not low <= drive_speed <= high:
        # A window narrower than the grid, or a speed at the very edge of one: this speed is a node then.
        windows = speed_windows(map_.model, w, (drive_speed,))
        found = _settled(batch, drive_speed, windows)
    orbit = close(map_, found.y[0], drive_speed, steady.growth) if found.periodic[0] else None
    periodic = orbit is not None and orbit.stable
    outcome = outcome_of(periodic, bool(found.sticks[0]), steady.stable)
    return SolutionSet(outcome, orbit if periodic else None, found.y[0] if found.sticks[0] else None, steady, windows)


def _settled(batch: CycleBatch, speed: float, windows: Windows) -> Motions:
    """What the motion settles on from a rested contact, else from the nearest stick-slip of the windows."""
    found, near = batch.settle(batch.rested()), windows.near(speed)
    return found if found.sticks[0] or near is None else batch.settle(near[None])


# ----------------------------------------------------------------------------------------------------------------------
# What draws of an operating point do.
# ----------------------------------------------------------------------------------------------------------------------


class DrawAnswers:
    """What the rows of `Draws` do around an answer; each is worked out when it is first asked for."""

    def __init__(self, draws: Draws, answer: SolutionSet) -> None:
        self.draws, self._answer = draws, answer
        self.batch = CycleBatch(draws.model, draws.settings)

    @cached_property
    def motions(self) -> Motions:
        """From the stick-slip of the point itself, else from a rested contact."""
        y = self._answer.y
        start = self.batch.rested() if y is None else np.tile(y, (len(self.draws.settings), 1))
        found = self.batch.settle(start)
        left = np.flatnonzero(~found.sticks)
        if y is not None and left.size:
            part = self.batch.take(left)
            found.update(left, part.settle(part.rested()))
        return found

    @cached_property
    def figures(self) -> Array:
        """QUANTITIES (rows, 9) of the orbits, NaN without one."""
        out, settles = np.full((len(self.draws.settings), len(QUANTITIES)), np.nan), self.motions.periodic
        if np.any(settles):
            out[settles] = self.batch.take(settles).figures(self.motions.y[settles])[0]
        return out

    @cached_property
    def sliding_force(self) -> Array:
        """Force (rows,) [N] that the load cell sees in steady sliding."""
        return np.array([state.force for state in slidings(self.draws.model, self.draws.settings)])

    @cached_property
    def forms(self) -> Mapping[str, Array]:
        """Numbers (rows,) of the closed forms and groups."""
        names = (*self.draws.model.parameter_names, "normal_force", "drive_speed")
        return forms_of_rows(dict(zip(names, self.draws.settings.T, strict=True)))

    def limit(self, part: SpeedRange, upper: bool) -> Array:
        """The upper or lower end (rows,) [m/s] of a range with stick-slip, NaN where none is found."""
        speed, model, settings = (part.high if upper else part.low), self.draws.model, self.draws.settings
        assert speed is not None

        def at(rows: NDArray[np.intp], places: Array) -> Array:
            moved = settings[rows].copy()
            moved[:, -1] = np.exp(places)
            return moved

        n, (start, scale) = len(settings), (part.states[-1 if upper else 0], self.batch.scale)
        test = StickTest(model, at, np.tile(start, (n, 1)), scale, rested=True)
        return np.exp(locate(test, np.full(n, np.log(speed)), 1.0 if upper else -1.0, CLOSER, self.draws.count))


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
    return _predictions(model, [point], names or (), draws)[0]


def predictions(
    model: Model, points: Sequence[OperatingPoint], names: Sequence[str], draws: int = DRAWS
) -> list[PointPrediction | NoAnswer]:
    """The predictions of several operating points, sharing what they have in common: see `predict`.

    A point without an answer says why; the others are not held up by it.
    """
    try:
        check_calculable(model)
    except SimulationError as error:
        return [NoAnswer(f"Stability and amplitude: no answer; {error}.") for _ in points]
    try:
        return [*_predictions(model, points, names, draws)]
    except SimulationError as error:
        if len(points) == 1:
            return [NoAnswer(f"no answer for this operating point: {error}")]
        return [answer for point in points for answer in predictions(model, [point], names, draws)]


# Ends of draws over those of the estimate, and the normal force [N] they are of, by end, pair and covariance.
Shared = dict[tuple[int, bool, bytes, bytes], tuple[float, Array]]
ALIKE = 1.03  # ratio of normal forces up to which the same ratios serve both


def _predictions(
    model: Model, points: Sequence[OperatingPoint], names: Sequence[str], draws: int
) -> list[PointPrediction]:
    check_calculable(model)
    unknown = [n for n in names if n not in model.parameter_names and n not in POINT]
    if unknown:
        raise SimulationError(f"the covariance names {unknown[0]!r}; the model has {', '.join(model.parameter_names)}")
    shared: Shared = {}
    maps = [map_of(model, point) for point in points]
    out = []
    for map_, point in zip(maps, points, strict=True):
        answer = solution_set(map_, abs(float(point.drive_speed)))
        out.append(_prediction(map_, answer, _Intervals(map_, answer, point.covariance, tuple(names), draws, shared)))
    return out


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


class _Intervals:
    """Intervals of the answers under a covariance; without one, all are None."""

    def __init__(
        self,
        map_: CycleMap,
        answer: SolutionSet,
        covariance: ArrayLike | None,
        names: tuple[str, ...],
        count: int,
        shared: Shared,
    ) -> None:
        point = dict(zip(POINT, (answer.steady.drive_speed, map_.normal_force), strict=True))
        self.values = dict(zip(map_.model.parameter_names, map_.p.tolist(), strict=True)) | point
        self._map, self._answer, self._shared = map_, answer, shared
        self.of: DrawAnswers | None = None
        if covariance is not None and names:
            self.of = DrawAnswers(Draws.of(map_.model, self.values, names, covariance, count), answer)
            self._key = np.asarray(covariance, float).tobytes()

    def form(self, name: str, value: float) -> AnswerInterval | None:
        """Of a number of the closed forms or of a dimensionless group; None where nothing in it is uncertain."""
        if self.of is None or not np.isfinite(value):
            return None
        rows = self.of.forms[name]
        return None if np.all(rows == rows[0]) else self.of.draws.interval(rows, value)

    def amplitude(self, values: Array) -> list[AnswerInterval | None]:
        """Of QUANTITIES of the orbit, its frequency and its share of slip, and a V_max (where the model has an a)."""
        if self.of is None:
            return [None] * (values.size + 3)
        rows = self.of.figures
        a = self.of.draws.column("a") if "a" in self._map.names else np.zeros(len(rows))
        columns = [*rows.T, 1.0 / rows[:, PERIOD], rows[:, SLIP] / rows[:, PERIOD], a * rows[:, PEAK]]
        now = [1.0 / values[PERIOD], values[SLIP] / values[PERIOD], self.values.get("a", 0.0) * values[PEAK]]
        centres = [*values, *now]
        return [self.of.draws.interval(c, float(v)) for c, v in zip(columns, centres, strict=True)]

    def force(self) -> AnswerInterval | None:
        """Of the force in steady sliding."""
        return None if self.of is None else self.of.draws.interval(self.of.sliding_force, self._answer.steady.force)

    def growth(self) -> AnswerInterval | None:
        """Of the growth rate of a disturbance of steady sliding."""
        if self.of is None:
            return None
        return self.of.draws.interval(self.of.batch.growth, self._answer.steady.growth, QUIET / self._map.time)

    def limit(self, part: SpeedRange, upper: bool) -> AnswerInterval | None:
        """Of a drive speed at which stick-slip ends."""
        speed = part.high if upper else part.low
        if self.of is None or speed is None:
            return None
        windows, load = self._answer.windows, self._map.normal_force
        key = windows.sticking.index(part), upper, self._map.p.tobytes(), self._key
        known, shares = self._shared.get(key, (0.0, np.empty(0)))
        if not 1 / ALIKE <= known / load <= ALIKE:
            shares = self.of.limit(part, upper) / speed
            self._shared[key] = load, shares
        return self.of.draws.interval(speed * shares, speed)


def _prediction(map_: CycleMap, answer: SolutionSet, spread: _Intervals) -> PointPrediction:
    forms = closed_forms(spread.values)
    amplitude, validity = _amplitude(map_, answer, spread)
    made = PointPrediction(
        operating_point={
            "drive_speed": number(answer.steady.drive_speed, "m/s", ""),
            "normal_force": number(map_.normal_force, "N", ""),
        },
        stability=_stability(answer, spread),
        amplitude=AmplitudeAnswer(amplitude),
        groups={
            name: number(value, MEANING[name][0], MEANING[name][1], spread.form(name, value))
            for name, value in asdict(forms.groups).items()
        },
        closed_forms=_closed_forms(forms, answer, amplitude, spread, beyond(map_.model.effects), validity),
    )
    texts = stability_text(made), amplitude_text(made), closed_form_text(made)
    return replace(
        made,
        stability=replace(made.stability, text=texts[0]),
        amplitude=replace(made.amplitude, text=texts[1]),
        closed_forms=replace(made.closed_forms, text=texts[2]),
        text="\n".join(texts),
    )


def _stability(answer: SolutionSet, spread: _Intervals) -> StabilityAnswer:
    steady, windows, orbit = answer.steady, answer.windows, answer.orbit
    low, high = windows.searched
    if not windows.sticking:
        why = f"no stick-slip was found at any drive speed from {said(low, 'm/s')} to {said(high, 'm/s')}"
    elif windows.end is None:
        why = f"stick-slip still exists at {said(high, 'm/s')}, the highest speed tried"
    else:
        why = MODEL

    def limit(part: SpeedRange, upper: bool) -> Number | None:
        speed = part.high if upper else part.low
        return None if speed is None else number(speed, "m/s", MODEL, spread.limit(part, upper))

    between = tuple(StickSlipRange(limit(part, False), limit(part, True)) for part in windows.sticking)
    end = between[-1].high if between else None
    return StabilityAnswer(
        outcome=answer.outcome.value,
        critical_speed=number(None, "m/s", why) if end is None else end,
        sliding=SlidingAnswer(
            stable=steady.stable,
            growth_rate=number(steady.growth, "1/s", MODEL, spread.growth()),
            friction_force=number(steady.force, "N", MODEL, spread.force()),
            eigenvalues=tuple((float(z.real), float(z.imag)) for z in steady.eigenvalues),
            worn=steady.worn,
        ),
        sliding_unstable_between=tuple(windows.unstable),
        searched_between=(low, high),
        stick_slip_between=between,
        windows=tuple(SpeedWindow(window.low, window.high, window.outcome.value) for window in windows.listed()),
        multiplier=None if orbit is None else orbit.multiplier,
        multipliers=tuple((float(z.real), float(z.imag)) for z in orbit.multipliers) if orbit else None,
    )


def _amplitude(map_: CycleMap, answer: SolutionSet, spread: _Intervals) -> tuple[dict[str, Number], Number]:
    """The numbers of the jumps, and a V_max."""
    needs = "the closed forms of a slip need this to be far below 1"
    if answer.orbit is None:
        why = (
            "it sticks and slips, but not periodically" if answer.outcome is Outcome.IRREGULAR else "no stick-slip here"
        )
        return {name: number(None, unit, why) for name, unit in QUANTITIES.items()}, number(None, "", needs)
    values = quantities(map_, answer.orbit.cycle, answer.orbit.drive_speed)
    intervals = spread.amplitude(values)
    told = [*values.tolist(), 1.0 / values[PERIOD], values[SLIP] / values[PERIOD]]
    units = QUANTITIES | {"frequency": "Hz", "share_in_slip": ""}
    rows = zip(units.items(), told, intervals[:-1], strict=True)
    out = {name: number(float(value), unit, MODEL, interval) for (name, unit), value, interval in rows}
    validity = spread.values.get("a", 0.0) * float(values[PEAK])
    return out, number(validity, "", needs, intervals[-1] if validity > 0.0 else None)


def _closed_forms(
    forms: ClosedForms,
    answer: SolutionSet,
    nonlinear: Mapping[str, Number],
    spread: _Intervals,
    ignored: tuple[str, ...],
    validity: Number,
) -> ClosedFormsAnswer:
    alpha, told = float(forms.groups.alpha), forms.numbers
    unaware = f"not valid here: knows nothing of {' and '.join(ignored)}" if ignored else ""

    def beside(name: str, unit: str, other: float | None) -> Number:
        why = unaware or judged(told[name], other, forms.status, alpha)
        return number(told[name], unit, why, spread.form(name, told[name]))

    def alone(name: str, why: str, there: bool = True) -> Number:
        return number(told[name] if there else None, "", why, spread.form(name, told[name]))

    local = unaware or "exact for small disturbances of steady sliding"
    printed = printed_form(float(forms.groups.zeta), float(forms.groups.tau_cr))
    return ClosedFormsAnswer(
        a_V_max=validity,
        slip=forms.status,
        ignores=ignored,
        numbers={
            **{name: beside(name, QUANTITIES[name], nonlinear[name].value) for name in CYCLE},
            "critical_speed": beside("critical_speed", "m/s", answer.end),
            "Pi": alone("Pi", local, not forms.worn),
            "Pi_fc": alone("Pi_fc", local, not forms.worn),
            "Pi_fc_printed": alone("Pi_fc_printed", printed),
            "Omega_c": alone("Omega_c", local, not forms.worn),
        },
    )


# ----------------------------------------------------------------------------------------------------------------------
# How sure an answer is: the share of the draws that stick and slip, and where their jumps lie.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Probability:
    """Probability of an outcome as the interface gives it: share of the draws, with its 95 % interval."""

    value: float
    unit: str
    interval: tuple[float, float]


@dataclass(frozen=True)
class DrawnNumber:
    """A quantity of the jumps with its interval, among the draws that stick and slip."""

    value: float | None
    unit: str
    interval: Interval
    validity: str = "interval from draws"


@dataclass(frozen=True)
class PredictionCertainty:
    """How sure the prediction at an operating point is, as the interface gives it: possible, that stick-slip exists
    there; certain, that it starts by itself too (steady sliding is unstable); None where there is nothing to say; draws
    that were asked, and refused as no pair can have them; open: what the data do not tell, so that nothing could be
    drawn."""

    possible: Probability | None
    certain: Probability | None
    quantities: Mapping[str, DrawnNumber]
    draws: int
    refused: int
    open: tuple[str, ...]
    text: str


def prediction_certainty(
    model: Model, point: OperatingPoint, names: Sequence[str], draws: int = DRAWS, seed: int = 0
) -> PredictionCertainty:
    """Probability of stick-slip at an operating point, and intervals of its jumps.

    Args:
        names: what the covariance of the point is of: parameters, "drive_speed", "normal_force".
        draws: how many.

    Raises:
        SimulationError: a motion that cannot be integrated.
    """
    where = f"{said(abs(point.drive_speed), 'm/s')} and {said(point.normal_force, 'N')}"
    if point.covariance is None or not names:
        why = "nothing that it depends on has an error: give tolerances, priors, or the result of a fit that tells it"
        return PredictionCertainty(None, None, {}, 0, 0, (), f"How sure this is at {where} cannot be said: {why}.")
    map_ = map_of(model, point)
    answer = solution_set(map_, abs(point.drive_speed))
    values = dict(point.values) | dict(zip(POINT, (answer.steady.drive_speed, map_.normal_force), strict=True))
    drawn = Draws.of(model, values, names, point.covariance, draws, seed)
    if drawn.open:
        unknown = tuple(dict.fromkeys(name for each in drawn.open for name in each))
        text = f"Probability of stick-slip at {where}: open, as these data do not tell {', '.join(unknown)}."
        return PredictionCertainty(None, None, {}, 0, 0, unknown, text)
    found = DrawAnswers(drawn, answer)
    sticks = found.motions.sticks
    chances = [_probability(hits) for hits in (sticks, sticks & (found.batch.growth > 0.0))]
    now = {}
    if answer.orbit is not None:
        row = quantities(map_, answer.orbit.cycle, answer.orbit.drive_speed)
        now = dict(zip(QUANTITIES, row.tolist(), strict=True))
    rows = {}
    for (name, unit), column in zip(QUANTITIES.items(), found.figures.T, strict=True):
        interval = drawn.interval(column, now.get(name, np.nan))
        if interval.low is not None:
            rows[name] = DrawnNumber(now.get(name), unit, (interval.low, interval.high))
    certainty = PredictionCertainty(chances[0], chances[1], rows, drawn.count, drawn.refused, (), "")
    return replace(certainty, text=certainty_text(where, certainty))


def _probability(hits: NDArray[np.bool_]) -> Probability:
    n, k = hits.size, int(np.sum(hits))
    tail = (1 - LEVEL) / 2
    low = beta(tail, k, n - k + 1) if k else 0.0
    high = beta(1 - tail, k + 1, n - k) if k < n else 1.0
    return Probability(k / n if n else float("nan"), "", (low, high))
