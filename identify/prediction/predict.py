"""Stability and amplitude at operating points: the nonlinear model's answer, the closed forms beside it, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data_io.spelling import Spelled
from identify.base.document import FURTHER, Json, to_dict
from identify.base.errors import SimulationError
from identify.base.result import Number
from identify.base.wording import range_text, wrapped
from identify.model.model import Model
from identify.prediction.axes import Site
from identify.prediction.closed_forms import CYCLE, MEANING, beyond, closed_forms, judged
from identify.prediction.cycles import CLOSELY, QUANTITIES, ROUGHLY, CycleBatch, Motions, check_calculable
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

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

MODEL = "nonlinear model, valid at any speed"
SHOWN = QUANTITIES | {"frequency": "Hz", "share_in_slip": ""}  # what is reported of the jumps, and its unit
QUIET = 1e-3  # natural frequencies: what a growth rate near zero is measured by
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


@dataclass(frozen=True, repr=False)
class PointPrediction(Spelled):
    """Stability and amplitude at one operating point; shows itself in words. Numbers are None where there is none."""

    operating_point: Mapping[str, Number]
    stability: StabilityAnswer
    amplitude: AmplitudeAnswer
    groups: Mapping[str, Number]
    closed_forms: ClosedFormsAnswer
    text: str = ""

    @property
    def document(self) -> Mapping[str, Json]:
        """As `stickslip stability --json` has it, every number with unit, interval and validity."""
        return to_dict(self)

    def __repr__(self) -> str:
        return "\n".join(wrapped(line) for line in self.text.splitlines())

    def to_frame(self) -> pd.DataFrame:
        """The amplitude as a table, SI: value, lower and upper end (95 %), unit; one row per quantity."""
        import pandas as pd

        rows = {name: (n.value, *n.ends, n.unit) for name, n in self.amplitude.numbers.items()}
        return pd.DataFrame.from_dict(rows, orient="index", columns=["value", "lower", "upper", "unit"])


@dataclass(frozen=True)
class NoAnswer:
    """Why there is no prediction."""

    text: str


# What happens at an operating point, and at draws of it.


@dataclass(frozen=True)
class SolutionSet:
    """The answer of the nonlinear model at one drive speed [m/s].

    y (n_y,): rest state of stick-slip there, where there is some, on the stable orbit where it is periodic; steady:
    steady sliding there; windows: what happens at every other drive speed, the same whatever speed is asked.
    """

    outcome: Outcome
    periodic: bool
    y: Array | None
    steady: Sliding
    windows: Windows


def solution_sets(model: Model, settings: Array) -> list[SolutionSet]:
    """The answers at settings (k, n_w), and at all other drive speeds.

    Raises:
        SimulationError: a motion cannot be integrated, or there is no steady sliding.
    """
    batch, speeds, windows = CycleBatch(model, settings), settings[:, -1].tolist(), speed_windows(model, settings)

    def settled() -> Motions:
        """From a rested contact, else from the stick-slip of the windows that is nearest."""
        motions, states = batch.settle(batch.rested()), batch.rested()
        for i, (found, speed) in enumerate(zip(windows, speeds, strict=True)):
            near = found.near(speed)
            states[i] = states[i] if near is None else near
        left = np.flatnonzero(~motions.sticks)
        motions.update(left, batch.take(left).settle(states[left]))
        return motions

    motions = settled()
    for i, (found, speed) in enumerate(zip(windows, speeds, strict=True)):
        low, high = found.searched
        if motions.sticks[i] != (found.near(speed) is not None) or not low <= speed <= high:
            # A window narrower than the grid, or a speed at the very edge of one: this speed is a node then.
            (windows[i],) = speed_windows(model, settings[i : i + 1], (speed,))
            motions = settled()
    out = []
    for i, steady in enumerate(slidings(model, settings)):
        sticks, periodic = bool(motions.sticks[i]), bool(motions.periodic[i])
        outcome, y = outcome_of(periodic, sticks, steady.stable), motions.y[i] if sticks else None
        out.append(SolutionSet(outcome, periodic, y, steady, windows[i]))
    return out


def numbers_of(draws: Sequence[Draws], answers: Sequence[SolutionSet]) -> list[dict[str, Array]]:
    """Numbers (rows,) by name of some points of one model and of their draws: of the jumps, NaN without an orbit;
    closed forms and groups; of sliding."""
    model, settings = draws[0].model, np.concatenate([each.settings for each in draws])
    batch, counts = CycleBatch(model, settings), [len(each.settings) for each in draws]
    # From the stick-slip of the point itself, else from a rested contact.
    rested, firsts = batch.rested(), np.cumsum([0, *counts[:-1]])
    known = np.array([rested[0] if answer.y is None else answer.y for answer in answers])
    own = np.repeat(known, counts, axis=0)
    motions = batch.settle(own)
    left = np.flatnonzero(~motions.sticks & np.any(own != rested, axis=1))
    motions.update(left, batch.take(left).settle(rested[left]))
    motions.y[firsts], motions.periodic[firsts] = known, [answer.periodic for answer in answers]
    rows, longest = np.full((len(settings), len(QUANTITIES)), np.nan), np.full(len(settings), ROUGHLY)
    longest[firsts], settles = CLOSELY, motions.periodic
    rows[settles] = batch.take(settles).figures(motions.y[settles], longest[settles])
    values = dict(zip((*model.parameter_names, "normal_force", "drive_speed"), settings.T, strict=True))
    forms, columns = closed_forms(values), dict(zip(QUANTITIES, rows.T, strict=True))
    columns |= {"frequency": 1.0 / columns["period"], "share_in_slip": columns["slip_duration"] / columns["period"]}
    columns["a_V_max"] = np.multiply(values.get("a", 0.0), columns["peak_speed"])
    columns |= {f"closed {name}": column for name, column in {**forms.groups, **forms.numbers}.items()}
    columns["friction_force"] = np.array([state.force for state in slidings(model, settings)])
    columns["growth_rate"] = batch.growth
    parts = zip(*(np.split(column, firsts[1:]) for column in columns.values()), strict=True)
    return [dict(zip(columns, part, strict=True)) for part in parts]


def ends_of(asked: Sequence[tuple[Draws, SpeedRange, bool]]) -> list[Array]:
    """Ends (rows,) of ranges with stick-slip, the upper or the lower, of points of one model and their draws, over that
    of the point; NaN where none is found."""
    if not asked:
        return []
    model, settings = asked[0][0].model, np.concatenate([draws.settings for draws, *_ in asked])
    counts, uppers = [len(draws.settings) for draws, *_ in asked], np.array([upper for *_, upper in asked])
    scale = CycleBatch(model, np.array([draws.settings[0] for draws, *_ in asked])).scale
    states = np.array([part.states[-1 if upper else 0] for _, part, upper in asked])
    speeds = np.log(np.array([part.end(upper) for _, part, upper in asked], dtype=float))

    def at(rows: NDArray[np.intp], logarithms: Array) -> Array:
        return np.column_stack([settings[rows, :-1], np.exp(logarithms)])

    test = StickTest(model, at, np.repeat(states / scale, counts, axis=0))
    expected, ahead = np.repeat(speeds, counts), np.repeat(np.where(uppers, 1.0, -1.0), counts)
    ends, firsts = locate(test, expected, ahead, ROUGH), np.cumsum([0, *counts[:-1]])
    lost = np.flatnonzero(np.isnan(ends))
    for row, windows in zip(lost, speed_windows(model, settings[lost]), strict=True):  # of a pair far from the point
        own = [np.log(end) for part in windows.sticking if (end := part.end(bool(ahead[row] > 0.0)))]
        ends[row] = min(own, key=lambda end: abs(end - expected[row]), default=np.nan)
    ends[firsts] = expected[firsts]
    return np.split(np.exp(ends - expected), firsts[1:])


# Predictions.


def predict(site: Site, draws: int = DRAWS) -> PointPrediction:
    """What follows from a pair and a rig at one drive speed (its sign is irrelevant) and normal force.

    Args:
        draws: from the covariance of the site, for intervals.

    Returns:
        every number with unit, interval and validity, None where there is none, and plain words. Intervals hold 95 % of
        the draws, None without a covariance; where the parameters are not known well enough, both ends are None and
        "reason" says which.

    Raises:
        SimulationError: an operating point without meaning, or a motion that cannot be integrated.
    """
    return _predicted([site], draws)[0]


def predictions(points: Sequence[Site], draws: int = DRAWS) -> list[PointPrediction | NoAnswer]:
    """The predictions of several operating points of one model, in one batch: see `predict`.

    A point without an answer says why; the others are not held up by it.
    """
    try:
        return list(_predicted(points, draws)) if points else []
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


def _predicted(points: Sequence[Site], count: int) -> list[PointPrediction]:
    """The predictions, with so many draws; or the first error."""
    for site in points:
        check_site(site)
    points = [replace(site, drive_speed=abs(site.drive_speed)) for site in points]
    answers = solution_sets(points[0].model, np.array([site.setting for site in points]))
    draws = [Draws.of(site, count) for site in points]
    columns = numbers_of(draws, answers)
    ends = [
        (i, place, part, upper, end)
        for i, answer in enumerate(answers)
        for place, part in enumerate(answer.windows.sticking)
        for upper, end in ((False, part.low), (True, part.high))
        if end is not None
    ]

    def key(i: int, place: int, upper: bool) -> tuple[object, ...]:
        """What ends have in common that draws have in the same ratio to the estimate: pair, load, place."""
        site, load = points[i], round(np.log(points[i].normal_force) / ALIKE)
        return place, upper, load, site.setting[:-2].tobytes(), np.asarray(site.covariance).tobytes(), site.names

    asked = {key(i, n, upper): (draws[i], part, upper) for i, n, part, upper, _ in reversed(ends) if draws[i].uncertain}
    shares = dict(zip(asked, ends_of([*asked.values()]), strict=True))
    for i, place, _, upper, end in ends:
        columns[i][f"end {place} {upper}"] = end * shares.get(key(i, place, upper), np.ones(1))
    return [_prediction(*each) for each in zip(points, answers, draws, columns, strict=True)]


def _prediction(site: Site, answer: SolutionSet, draws: Draws, columns: Mapping[str, Array]) -> PointPrediction:
    """columns: the numbers (rows,) of the draws by name."""

    def of_model(name: str, unit: str, why: str = MODEL, size: float = 0.0) -> Number:
        return draws.number(columns[name], unit, why, size)

    def limit(place: int, part: SpeedRange, upper: bool) -> Number | None:
        return of_model(f"end {place} {upper}", "m/s") if part.end(upper) else None

    steady, windows = answer.steady, answer.windows
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
        critical_speed=(between[-1].high if between else None) or Number(None, "m/s", None, no_end),
        sliding=SlidingAnswer(
            stable=steady.stable,
            growth_rate=of_model("growth_rate", "1/s", size=QUIET * natural),
            friction_force=of_model("friction_force", "N"),
            eigenvalues=tuple((float(z.real), float(z.imag)) for z in steady.eigenvalues),
            renewed=steady.renewed,
        ),
        sliding_unstable_between=tuple(windows.unstable),
        searched_between=windows.searched,
        stick_slip_between=between,
        windows=windows.listed(),
    )
    irregular = answer.outcome is Outcome.IRREGULAR
    none = "it sticks and slips, but not periodically" if irregular else "no stick-slip here"
    why = MODEL if answer.periodic else none
    amplitude = {n: of_model(n, unit, why) for n, unit in (SHOWN if answer.periodic else QUANTITIES).items()}
    groups, forms = _closed_forms(site.model, draws, columns, amplitude, windows.end)
    at = {name: Number(getattr(site, name), unit) for name, unit in (("drive_speed", "m/s"), ("normal_force", "N"))}
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
    model: Model, draws: Draws, columns: Mapping[str, Array], amplitude: Mapping[str, Number], end: float | None
) -> tuple[dict[str, Number], ClosedFormsAnswer]:
    """The groups, and the closed forms, each beside what the nonlinear model has."""

    def entry(name: str, unit: str, why: str) -> Number:
        return draws.number(columns[f"closed {name}"], unit, why)

    forms = closed_forms({name: float(draws.column(name)[0]) for name in (*model.parameter_names, *POINT)})
    groups, status = {name: entry(name, *MEANING[name]) for name in forms.groups}, str(forms.status)
    ignored = beyond(model.effects)
    unaware, out = f"not valid here: does not include {' and '.join(ignored)}" if ignored else "", {}
    for name, other in [*((name, amplitude[name].value) for name in CYCLE), ("critical_speed", end)]:
        why = unaware or judged(float(forms.numbers[name]), other, status, float(forms.groups["alpha"]))
        out[name] = entry(name, QUANTITIES.get(name, "m/s"), why)
    for name in ("Pi", "Pi_fc", "Omega_c"):
        why = unaware or "exact for small disturbances of steady sliding"
        out[name] = Number(None, "", None, why) if forms.renewed else entry(name, "", why)
    peak = draws.number(columns["a_V_max"], "", "the closed forms of a slip need this to be far below 1")
    return groups, ClosedFormsAnswer(peak, status, ignored, out)
