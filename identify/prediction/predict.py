"""Stability and amplitude at operating points: the nonlinear model's answer, the closed forms beside it, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

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
from identify.prediction.draws import DRAWS, POINT, Draws
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


def solution_sets(model: Model, settings: Array) -> list[SolutionSet]:
    """The answers at settings (k, n_w), and at all other drive speeds.

    Raises:
        SimulationError: a motion cannot be integrated, or there is no steady sliding.
    """
    batch, steady, windows = CycleBatch(model, settings), slidings(model, settings), speed_windows(model, settings)

    def settled() -> tuple[Motions, list[Array | None]]:
        """From a rested contact, else from the stick-slip of the windows that is nearest; and that."""
        motions, near = (
            batch.settle(batch.rested()),
            [each.near(w[-1]) for each, w in zip(windows, settings, strict=True)],
        )
        begun = {i: y for i, y in enumerate(near) if y is not None and not motions.sticks[i]}
        if begun:
            motions.update(np.array([*begun]), batch.take(np.array([*begun])).settle(np.array([*begun.values()])))
        return motions, near

    motions, near = settled()
    for i, (y, found, speed) in enumerate(zip(near, windows, settings[:, -1].tolist(), strict=True)):
        if bool(motions.sticks[i]) != (y is not None) or not found.searched[0] <= speed <= found.searched[1]:
            # A window narrower than the grid, or a speed at the very edge of one: this speed is a node then.
            (windows[i],) = speed_windows(model, settings[i : i + 1], (speed,))
            motions = settled()[0]
    figures = iter(batch.take(motions.periodic).figures(motions.y[motions.periodic], CLOSELY))
    out = []
    for i, state in enumerate(steady):
        sticks, row = bool(motions.sticks[i]), next(figures) if motions.periodic[i] else None
        outcome = outcome_of(row is not None, sticks, state.stable)
        out.append(SolutionSet(outcome, row, motions.y[i] if sticks else None, state, windows[i]))
    return out


def drawn_numbers(draws: Sequence[Draws], answers: Sequence[SolutionSet]) -> list[dict[str, Array]]:
    """Numbers (rows,) by name of the draws of some points of one model around their answers: of the jumps, NaN without
    an orbit; closed forms and groups; of sliding."""
    if not draws:
        return []
    model, settings = draws[0].model, np.concatenate([each.settings for each in draws])
    batch, counts = CycleBatch(model, settings), [len(each.settings) for each in draws]
    # From the stick-slip of the point itself, else from a rested contact.
    rested = batch.rested()
    own = np.repeat([rested[0] if answer.y is None else answer.y for answer in answers], counts, axis=0)
    motions = batch.settle(own)
    left = np.flatnonzero(~motions.sticks & np.any(own != rested, axis=1))
    motions.update(left, batch.take(left).settle(rested[left]))
    rows = np.full((len(settings), len(QUANTITIES)), np.nan)
    rows[motions.periodic] = batch.take(motions.periodic).figures(motions.y[motions.periodic])
    values = dict(zip((*model.parameter_names, "normal_force", "drive_speed"), settings.T, strict=True))
    forms = closed_forms(values)
    columns = _jumps(rows, values) | {f"closed {name}": q for name, q in {**forms.groups, **forms.numbers}.items()}
    columns["friction_force"] = np.array([state.force for state in slidings(model, settings)])
    columns["growth_rate"] = batch.growth
    parts = zip(*(np.split(column, np.cumsum(counts)[:-1]) for column in columns.values()), strict=True)
    return [dict(zip(columns, part, strict=True)) for part in parts]


def drawn_ends(asked: Sequence[tuple[Draws, SpeedRange, bool]]) -> list[Array]:
    """Ends (rows,) of ranges with stick-slip, the upper or the lower, for the rows of draws of one model, over that of
    the estimate; NaN where none is found.

    They are sought in LOCATED of the draws and in the moved points. Of the other draws they are the regression on their
    settings, with the residuals of those in turn: what it costs is to close in on ends, where motions settle late.
    """
    if not asked:
        return []
    sought = [np.delete(np.arange(len(draws.settings)), np.arange(LOCATED, draws.count)) for draws, *_ in asked]
    settings = np.concatenate([draws.settings[rows] for (draws, *_), rows in zip(asked, sought, strict=True)])
    of, uppers = np.repeat(np.arange(len(asked)), [len(rows) for rows in sought]), [upper for *_, upper in asked]
    model, first = asked[0][0].model, np.array([draws.settings[0] for draws, *_ in asked])
    states = np.array([part.states[-1 if upper else 0] for _, part, upper in asked])
    speeds = np.log(np.array([part.end(upper) for _, part, upper in asked], dtype=float))

    def at(rows: NDArray[np.intp], logarithms: Array) -> Array:
        return np.column_stack([settings[rows, :-1], np.exp(logarithms)])

    test = StickTest(model, at, states[of], CycleBatch(model, first).scale[of], rested=True)
    ends = locate(test, speeds[of], np.where(uppers, 1.0, -1.0)[of], ROUGH)
    parts = zip(asked, sought, speeds.tolist(), strict=True)
    return [
        np.exp(_completed(draws, rows, ends[of == i]) - speed) for i, ((draws, *_), rows, speed) in enumerate(parts)
    ]


def _completed(draws: Draws, sought: NDArray[np.intp], found: Array) -> Array:
    """Of all rows, from what was found in those that were sought."""
    count, ends = draws.count, np.full(len(draws.settings), np.nan)
    ends[sought] = found
    known = np.flatnonzero(np.isfinite(ends[:LOCATED]))
    if count > LOCATED and known.size:
        varied = draws.settings[:count, np.ptp(draws.settings[:count], axis=0) > 0.0]
        design = np.column_stack([np.ones(count), (varied - varied.mean(axis=0)) / varied.std(axis=0)])
        weights = np.linalg.lstsq(design[known], ends[known], rcond=None)[0]
        residuals = ends[:LOCATED] - design[:LOCATED] @ weights
        residuals *= np.sqrt(known.size / max(known.size - len(weights), 1))
        others = np.arange(LOCATED, count)
        ends[others] = design[others] @ weights + residuals[others % LOCATED]
    return ends


@dataclass(frozen=True, eq=False)
class DrawnAnswers:
    """The draws of a point, and their numbers (rows,) by name."""

    draws: Draws
    columns: Mapping[str, Array]


def _number(
    drawn: DrawnAnswers | None, value: float | None, unit: str, validity: str, name: str, size: float = 0.0
) -> Number:
    """One of the numbers, with its interval where there are draws; size: see `Draws.number`."""
    if drawn is None or value is None or not np.isfinite(value):
        return number(value, unit, validity)
    return drawn.draws.number(value, unit, validity, drawn.columns[name], size)


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
    names: Sequence[str] = (),
    draws: int = DRAWS,
) -> PointPrediction:
    """What follows from a pair and a rig at one drive speed and normal force.

    Args:
        values, drive_speed, normal_force, covariance, names: as in `Site`.
        draws: from the covariance, for intervals.

    Returns:
        every number with unit, interval and validity, None where there is none, and plain words. Intervals hold 95 % of
        the draws, None without a covariance; where the parameters are not known well enough, both ends are None and
        "reason" says which.

    Raises:
        SimulationError: an operating point without meaning, or a motion that cannot be integrated.
    """
    site = Site(model, values, drive_speed, normal_force, covariance=covariance, names=tuple(names))
    return _predicted([site], draws)[0]


def predictions(points: Sequence[Site], draws: int = DRAWS) -> list[PointPrediction | NoAnswer]:
    """The predictions of several operating points of one model, in one batch: see `predict`.

    A point without an answer says why; the others are not held up by it.
    """
    try:
        return list(_predicted(points, draws))
    except SimulationError as error:
        if len(points) == 1:
            return [NoAnswer(f"no answer for this operating point: {error}")]
    return [answer for point in points for answer in predictions([point], draws)]


def check_site(site: Site) -> None:
    """Refuse an operating point without an answer.

    Raises:
        SimulationError: the model has no cycle, a speed, a load or a covariance without meaning.
    """
    check_calculable(site.model)
    if not (0.0 < abs(site.drive_speed) < np.inf and 0.0 < site.normal_force < np.inf):
        raise SimulationError(
            f"the operating point is {site.drive_speed:g} m/s and {site.normal_force:g} N; expected a drive speed that "
            "is not zero and a positive normal force: give both"
        )
    unknown = [n for n in site.names if n not in site.model.parameter_names and n not in POINT]
    if unknown:
        known = ", ".join(site.model.parameter_names)
        raise SimulationError(f"the covariance names {unknown[0]!r}; the model has {known}")


def _predicted(points: Sequence[Site], draws: int) -> list[PointPrediction]:
    """The predictions, or the first error."""
    for site in points:
        check_site(site)
    points = [replace(site, drive_speed=abs(site.drive_speed)) for site in points]
    answers = solution_sets(points[0].model, np.array([site.setting for site in points]))
    return [_prediction(*each) for each in zip(points, answers, _drawn(points, answers, draws), strict=True)]


def _drawn(points: Sequence[Site], answers: Sequence[SolutionSet], count: int) -> list[DrawnAnswers | None]:
    """What the draws of each point do, None of one that is known exactly.

    Ends of stick-slip over that of the estimate are shared by points of one pair under nearly the same load.
    """
    uncertain = [i for i, site in enumerate(points) if site.covariance is not None and site.names]
    drawn = {i: Draws.of(points[i], count) for i in uncertain}
    columns = dict(zip(drawn, drawn_numbers([*drawn.values()], [answers[i] for i in drawn]), strict=True))
    ranges = [(i, place, part) for i in drawn for place, part in enumerate(answers[i].windows.sticking)]
    limits = [(i, place, upper, part) for i, place, part in ranges for upper in (False, True) if part.end(upper)]

    def key(i: int, place: int, upper: bool) -> tuple[object, ...]:
        site = points[i]
        known = site.setting[:-2].tobytes(), np.asarray(site.covariance).tobytes(), site.names
        return place, upper, round(np.log(site.normal_force) / ALIKE), known

    asked = {key(i, place, upper): (drawn[i], part, upper) for i, place, upper, part in reversed(limits)}
    shares = dict(zip(asked, drawn_ends([*asked.values()]), strict=True))
    for i, place, upper, _ in limits:
        columns[i][f"end {place} {upper}"] = shares[key(i, place, upper)]
    return [DrawnAnswers(drawn[i], columns[i]) if i in drawn else None for i in range(len(points))]


def _prediction(site: Site, answer: SolutionSet, drawn: DrawnAnswers | None) -> PointPrediction:
    values = {**site.values, "drive_speed": site.drive_speed, "normal_force": site.normal_force}

    def of_model(value: float | None, unit: str, name: str, size: float = 0.0) -> Number:
        return _number(drawn, value, unit, MODEL, name, size)

    def limit(place: int, part: SpeedRange, upper: bool) -> Number | None:
        end = part.end(upper)
        if end is None or drawn is None:
            return None if end is None else number(end, "m/s", MODEL)
        return drawn.draws.number(end, "m/s", MODEL, end * drawn.columns[f"end {place} {upper}"])

    steady, windows, figures = answer.steady, answer.windows, answer.figures
    ranges = enumerate(windows.sticking)
    between = tuple(StickSlipRange(limit(i, part, False), limit(i, part, True)) for i, part in ranges)
    fastest = shown(windows.searched[1], "m/s")
    if between:
        no_end = f"stick-slip still exists at {fastest}, the highest speed tried"
    else:
        no_end = f"no stick-slip was found at any drive speed from {range_text(*windows.searched, 'm/s')}"
    natural = float(np.sqrt(site.values["stiffness"] / site.values["mass"]))
    stability = StabilityAnswer(
        outcome=answer.outcome.value,
        critical_speed=(between[-1].high if between else None) or number(None, "m/s", no_end),
        sliding=SlidingAnswer(
            stable=steady.stable,
            growth_rate=of_model(steady.growth, "1/s", "growth_rate", QUIET * natural),
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
    groups, forms = _closed_forms(site.model, values, amplitude, windows.end, validity, drawn)
    at = {name: number(values[name], unit, "") for name, unit in (("drive_speed", "m/s"), ("normal_force", "N"))}
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
    drawn: DrawnAnswers | None,
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
