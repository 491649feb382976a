"""Stability and amplitude at operating points: the nonlinear model's answer, the closed forms beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.errors import SimulationError
from identify.base.result import Number
from identify.model.model import Model
from identify.prediction.closed_forms import (
    CYCLE,
    ClosedForms,
    beyond,
    closed_forms,
    form_slopes,
    judged,
)
from identify.prediction.cycle import CycleMap, check_calculable
from identify.prediction.groups import MEANING
from identify.prediction.intervals import POINT, AnswerInterval, Drawn, OperatingPoint, Spread, Uncertain, maps, sampled
from identify.prediction.orbit import patience
from identify.prediction.path import moved_orbit
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
from identify.prediction.probability import answers_of_draws
from identify.prediction.quantities import QUANTITIES, end_slopes, orbit_slopes, quantities, sliding_slopes
from identify.prediction.solutions import SolutionSet, solution_sets
from identify.prediction.stability import printed_form
from identify.prediction.windows import Outcome, StickSlipLimit
from identify.prediction.wording import amplitude_text, closed_form_text, said, stability_text

Array = NDArray[np.float64]

MODEL = "nonlinear model, valid at any speed"
EITHER_SIGN = ("alpha", "z", "overshoot", "loading")  # groups told by their value, not its logarithm
PERIOD, SLIP, PEAK = (list(QUANTITIES).index(name) for name in ("period", "slip_duration", "peak_speed"))
POSITIVE = [i for i, name in enumerate(QUANTITIES) if name not in ("onset_force", "arrest_force")]
QUIET = 1e-3  # natural frequencies: a growth rate below this is told as if it were this large


def predict(
    model: Model,
    values: Mapping[str, float],
    drive_speed: float,
    normal_force: float,
    covariance: ArrayLike | None = None,
    names: Sequence[str] | None = None,
) -> PointPrediction:
    """What follows from a pair and a rig at one drive speed and normal force.

    Args:
        values, drive_speed, normal_force, covariance: as in `OperatingPoint`.
        names: what the covariance is of: parameters, "drive_speed", "normal_force".

    Returns:
        every number with unit, interval and validity, None where there is none, and plain words. Intervals are 95 %, by
        linear propagation (of the logarithm where a quantity is positive), None without a covariance; of jumps and of
        limits of stick-slip that are skew within what is known they are quantiles of draws ("interval_from"); where the
        parameters are not known well enough for either, both ends are None and "reason" says which.

    Raises:
        SimulationError: an operating point without meaning, or a motion that cannot be integrated.
    """
    return _predictions(model, [OperatingPoint(values, drive_speed, normal_force, covariance)], names or (), True)[0]


def predictions(
    model: Model, points: Sequence[OperatingPoint], names: Sequence[str], *, draws: bool = True
) -> list[PointPrediction | NoAnswer]:
    """The predictions of several operating points, sharing what they have in common: see `predict`.

    A point without an answer says why; the others are not held up by it. Without `draws` intervals are those
    of straight lines, however skew the answers are: for many points of one curve.
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
        return [answer for point in points for answer in predictions(model, [point], names, draws=draws)]


def _predictions(
    model: Model, points: Sequence[OperatingPoint], names: Sequence[str], draws: bool
) -> list[PointPrediction]:
    check_calculable(model)
    maps = [_map(model, point) for point in points]
    speeds = [abs(float(point.drive_speed)) for point in points]
    unknown = [n for n in names if n not in model.parameter_names and n not in POINT]
    if unknown:
        raise SimulationError(f"the covariance names {unknown[0]!r}; the model has {', '.join(model.parameter_names)}")
    shared: dict[tuple[int, bytes], Array | None] | None = {} if draws else None
    return [
        _prediction(map_, answer, _Intervals(map_, answer, point.covariance, tuple(names), shared))
        for map_, point, answer in zip(maps, points, solution_sets(maps, speeds), strict=True)
    ]


def _map(model: Model, point: OperatingPoint) -> CycleMap:
    speed, load = abs(float(point.drive_speed)), float(point.normal_force)
    if not (0.0 < speed < np.inf and 0.0 < load < np.inf):
        raise SimulationError(
            f"the operating point is {point.drive_speed:g} m/s and {load:g} N; expected a drive speed that is not "
            "zero and a positive normal force: give both"
        )
    return CycleMap(model, load, np.array([float(point.values[name]) for name in model.parameter_names]))


def _prediction(map_: CycleMap, answer: SolutionSet, spread: _Intervals) -> PointPrediction:
    speed, forms = answer.steady.drive_speed, closed_forms(spread.values)
    amplitude = _amplitude(map_, answer, spread)
    made = PointPrediction(
        operating_point={
            "drive_speed": number(speed, "m/s", ""),
            "normal_force": number(map_.normal_force, "N", ""),
        },
        stability=_stability(answer, spread),
        amplitude=AmplitudeAnswer(amplitude),
        groups={
            name: number(value, MEANING[name][0], MEANING[name][1], spread.form(name, value))
            for name, value in asdict(forms.groups).items()
        },
        closed_forms=_closed_forms(forms, answer, amplitude, spread, beyond(map_.model.effects)),
    )
    texts = stability_text(made), amplitude_text(made), closed_form_text(made)
    return replace(
        made,
        stability=replace(made.stability, text=texts[0]),
        amplitude=replace(made.amplitude, text=texts[1]),
        closed_forms=replace(made.closed_forms, text=texts[2]),
        text="\n".join(texts),
    )


class _Intervals:
    """Intervals of the answers under a covariance; without one, all are None."""

    def __init__(
        self,
        map_: CycleMap,
        answer: SolutionSet,
        covariance: ArrayLike | None,
        names: tuple[str, ...],
        shared: dict[tuple[int, bytes], Array | None] | None,
    ) -> None:
        """shared: draws of limits that several points have in common; None: straight lines only."""
        self._map, self._answer, self._names = map_, answer, names
        matrix = None if covariance is None or not names else np.asarray(covariance, float)
        point = dict(zip(POINT, (answer.steady.drive_speed, map_.normal_force), strict=True))
        self._spread = None if matrix is None else Spread(map_.model, map_.p, names, matrix, point)
        self._shared = shared
        self.values = dict(zip(map_.model.parameter_names, map_.p.tolist(), strict=True)) | point
        self._uncertain = None if matrix is None else Uncertain(map_.model, self.values, names, matrix)
        if self._spread is not None:
            steady = answer.steady
            self._growth, self._force = sliding_slopes(map_, steady.drive_speed, names)

    @cached_property
    def _slopes(self) -> Array:
        """Derivatives of QUANTITIES of the orbit by the names (9, f); there must be an orbit."""
        assert self._answer.orbit is not None
        return orbit_slopes(self._map, self._answer.orbit, self._names)

    @cached_property
    def _drawn(self) -> tuple[Drawn, Array] | None:
        """Draws of what is known, and the QUANTITIES (n, 9) of their orbits (NaN without one), where straight lines do
        not hold; None where they do, or where there is nothing to draw from."""
        orbit = self._answer.orbit
        if self._uncertain is None or orbit is None or self._uncertain.unknown or self._shared is None:
            return None

        def answer(map_: CycleMap, speed: float) -> Array | None:
            moved = moved_orbit(orbit, map_, speed, patience(map_, speed))
            return None if moved is None else quantities(map_, moved.cycle, speed)[POSITIVE]

        centre = quantities(self._map, orbit.cycle, orbit.drive_speed)[POSITIVE]
        if not self._uncertain.is_skew(answer, centre, self._slopes[POSITIVE]):
            return None
        drawn = self._uncertain.draw()
        return drawn, answers_of_draws(self._map.model, drawn, orbit).quantities

    @cached_property
    def _form_slopes(self) -> Mapping[str, Array]:
        return form_slopes(self.values, self._names)

    def form(self, name: str, value: float) -> AnswerInterval | None:
        """Of a number of the closed forms or of a dimensionless group."""
        if self._spread is None or not np.isfinite(value):
            return None
        slopes = self._form_slopes[name]
        if not np.any(slopes):
            return None  # nothing in it is uncertain
        if value > 0.0 and name not in EITHER_SIGN:
            return self._spread.positive(value, slopes)
        return self._spread.signed(value, slopes, abs(value))

    def validity(self, a: float, peak: float) -> AnswerInterval | None:
        """Of a V_max, from the orbit."""
        orbit = self._answer.orbit
        if self._spread is None or orbit is None or not a * peak > 0.0:
            return None
        if self._drawn is not None and "a" in self._map.model.parameter_names:
            drawn, rows = self._drawn
            return sampled(drawn.settings[:, self._map.names.index("a")] * rows[:, PEAK])
        slopes = a * self._slopes[PEAK] + np.array([peak if name == "a" else 0.0 for name in self._names])
        return self._spread.positive(a * peak, slopes)

    def share(self, values: Array) -> AnswerInterval | None:
        """Of the share of a period that is slip; values as of `sensitivity.quantities`."""
        orbit = self._answer.orbit
        if self._spread is None or orbit is None:
            return None
        if self._drawn is not None:
            return sampled(self._drawn[1][:, SLIP] / self._drawn[1][:, PERIOD])
        share = values[SLIP] / values[PERIOD]
        slopes = (self._slopes[SLIP] - share * self._slopes[PERIOD]) / values[PERIOD]
        return self._spread.positive(float(share), slopes)

    def force(self) -> AnswerInterval | None:
        """Of the force in steady sliding."""
        force = self._answer.steady.force
        return None if self._spread is None else self._spread.signed(force, self._force, abs(force))

    def orbit(self, values: Array) -> list[AnswerInterval | None]:
        """Of QUANTITIES of the orbit: from draws where one of them is skew."""
        orbit = self._answer.orbit
        if self._spread is None or orbit is None:
            return [None] * values.size
        if self._drawn is not None:
            return [sampled(column) for column in self._drawn[1].T]
        return [
            self._spread.positive(float(v), s) if i in POSITIVE else self._spread.signed(float(v), s, abs(float(v)))
            for i, (v, s) in enumerate(zip(values, self._slopes, strict=True))
        ]

    def limit(self, limit: StickSlipLimit | None) -> AnswerInterval | None:
        """Of a drive speed at which stick-slip ends: from draws where it is skew."""
        if self._spread is None or self._uncertain is None or limit is None:
            return None
        slopes = end_slopes(self._map, limit, self._names)
        line = self._spread.positive(limit.speed, slopes)
        if limit.orbit is None or self._uncertain.unknown or self._shared is None:
            return line
        key = id(limit.orbit), np.asarray(self._uncertain.covariance).tobytes()
        if key not in self._shared:
            self._shared[key] = _limits_of_draws(limit, slopes, self._uncertain)
        drawn = self._shared[key]
        return line if drawn is None else sampled(limit.speed * drawn)

    def growth(self) -> AnswerInterval | None:
        if self._spread is None:
            return None
        return self._spread.signed(self._answer.steady.growth, self._growth, QUIET / self._map.time)


def _limits_of_draws(limit: StickSlipLimit, slopes: Array, uncertain: Uncertain) -> Array | None:
    """A limit of stick-slip (n,) of every draw over that of the estimate, NaN where there is none; None where it
    follows the parameters in a straight line."""

    def answer(map_: CycleMap, _speed: float) -> Array | None:
        speed = limit.of(map_)
        return None if speed is None else np.array([speed])

    if not uncertain.is_skew(answer, np.array([limit.speed]), slopes[None, :]):
        return None
    ends = [answer(*point) for point in maps(uncertain.model, uncertain.draw())]
    return np.array([np.nan if end is None else float(end[0]) / limit.speed for end in ends])


def _stability(answer: SolutionSet, spread: _Intervals) -> StabilityAnswer:
    steady, windows, orbit = answer.steady, answer.windows, answer.orbit
    low, high = windows.searched
    if not windows.sticking:
        why = f"no stick-slip was found at any drive speed from {said(low, 'm/s')} to {said(high, 'm/s')}"
    elif windows.end is None:
        why = f"stick-slip still exists at {said(high, 'm/s')}, the highest speed tried"
    else:
        why = MODEL

    def limit(found: StickSlipLimit | None) -> Number | None:
        return None if found is None else number(found.speed, "m/s", MODEL, spread.limit(found))

    return StabilityAnswer(
        outcome=answer.outcome.value,
        critical_speed=number(answer.end, "m/s", why, spread.limit(windows.end)),
        sliding=SlidingAnswer(
            stable=steady.stable,
            growth_rate=number(steady.growth, "1/s", MODEL, spread.growth()),
            friction_force=number(steady.force, "N", MODEL, spread.force()),
            eigenvalues=tuple((float(z.real), float(z.imag)) for z in steady.eigenvalues),
            worn=steady.worn,
        ),
        sliding_unstable_between=tuple(windows.unstable),
        searched_between=(low, high),
        stick_slip_between=tuple(StickSlipRange(limit(part.low), limit(part.high)) for part in windows.sticking),
        windows=tuple(SpeedWindow(window.low, window.high, window.outcome.value) for window in windows.listed()),
        multiplier=None if orbit is None else orbit.multiplier,
        multipliers=tuple((float(z.real), float(z.imag)) for z in orbit.multipliers) if orbit else None,
    )


def _amplitude(map_: CycleMap, answer: SolutionSet, spread: _Intervals) -> dict[str, Number]:
    if answer.orbit is None:
        why = (
            "it sticks and slips, but not periodically" if answer.outcome is Outcome.IRREGULAR else "no stick-slip here"
        )
        return {name: number(None, unit, why) for name, unit in QUANTITIES.items()}
    values = quantities(map_, answer.orbit.cycle, answer.orbit.drive_speed)
    intervals = spread.orbit(values)
    rows = zip(QUANTITIES.items(), values.tolist(), intervals, strict=True)
    out = {name: number(value, unit, MODEL, interval) for (name, unit), value, interval in rows}
    period = intervals[1]
    if period is not None and period.low is not None and period.high is not None:
        period = AnswerInterval(1 / period.high, 1 / period.low)
    out["frequency"] = number(1 / values[1], "Hz", MODEL, period)
    out["share_in_slip"] = number(values[3] / values[1], "", MODEL, spread.share(values))
    return out


def _closed_forms(
    forms: ClosedForms,
    answer: SolutionSet,
    nonlinear: Mapping[str, Number],
    spread: _Intervals,
    ignored: tuple[str, ...],
) -> ClosedFormsAnswer:
    alpha, told = float(forms.groups.alpha), forms.numbers
    peak, a = nonlinear["peak_speed"].value, float(forms.groups.v_a) / answer.steady.drive_speed
    validity = (None, None) if peak is None else (a * peak, spread.validity(a, peak))

    unaware = f"not valid here: knows nothing of {' and '.join(ignored)}" if ignored else ""

    def beside(name: str, unit: str, other: float | None) -> Number:
        why = unaware or judged(told[name], other, forms.status, alpha)
        return number(told[name], unit, why, spread.form(name, told[name]))

    def alone(name: str, why: str, there: bool = True) -> Number:
        return number(told[name] if there else None, "", why, spread.form(name, told[name]))

    local = unaware or "exact for small disturbances of steady sliding"
    printed = printed_form(float(forms.groups.zeta), float(forms.groups.tau_cr))
    return ClosedFormsAnswer(
        a_V_max=number(validity[0], "", "the closed forms of a slip need this to be far below 1", validity[1]),
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
