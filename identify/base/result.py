"""The result of a fit: what result.json holds, as values. Numbers are SI; what is infinite or missing is None.

`Result.to_dict` is the document, key by key in this order; `Result.from_dict` reads it, whichever version wrote it:
what an older one did not write has the default that stands here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from data_io.correct import Change
from data_io.values import Finding
from identify.base.document import FURTHER, OMITTED, Json, from_document, json_schema, to_dict

Array = NDArray[np.float64]
VERDICTS = ("identified", "weak", "bounded", "not profiled", "not identifiable", "at bound", "fixed")
REGIMES = ("stick_slip", "uneven_stick_slip", "near_harmonic", "sliding", "programme")
SECONDS = {"schema": {"additionalProperties": {"type": "number", "minimum": 0}}}
CYCLE_COLUMNS = ("onset_s", "arrest_s", "onset_force_N", "arrest_force_N", "misfit_z")


def one_of(*values: object) -> dict[str, object]:
    """Metadata of a field that holds one of a few values."""
    return {"schema": {"enum": list(values)}}


class Status(Enum):
    """How a fit ended; the value is the word in result.json."""

    CONVERGED = "converged"
    SOLVER_FAILED = "solver_failed"
    WRONG_EVENT_COUNT = "wrong_event_count"
    MODEL_MISFIT = "model_misfit"
    BETTER_START_FOUND = "better_start_found"
    NO_CYCLES = "no_cycles"
    AT_BOUND = "at_bound"


@dataclass(frozen=True)
class LogCurves:
    """What the report draws of one log. Arrays of shape (n,), SI, at the samples of the record.

    `friction_force` is the measured one with the fit's sign applied; `fitted_force` is NaN where
    nothing was fitted (outside the fitted window, masked samples, or no fit at all); `used` marks
    the samples that count; `cycles` has one row of CYCLE_COLUMNS per fitted or detected cycle (misfit: z-score of
    chi^2, NaN if not fitted).
    `raw_force`: the friction force as it was read, with the fit's sign, None where nothing was corrected.
    """

    name: str
    time: Array
    normal_force: Array
    friction_force: Array
    fitted_force: Array
    used: NDArray[np.bool_]
    noise: float
    drive_speed: float
    cycles: Array
    raw_force: Array | None = None


Interval = tuple[float | None, float | None]  # an end that is open is None


@dataclass(frozen=True)
class Value:
    """A number with its unit and its 95 % interval, where it has one."""

    value: float | None = None
    unit: str = ""
    interval: Interval | None = field(default=None, metadata=OMITTED)

    @property
    def ends(self) -> Interval:
        """Both ends of the interval, open ones None."""
        return self.interval or (None, None)


@dataclass(frozen=True)
class Number(Value):
    """A number that follows from others; validity: where it holds; reason: why an end is open; group: of logs."""

    interval: Interval | None = None
    validity: str = ""
    reason: str = field(default="", metadata=OMITTED)
    group: str = field(default="", metadata=OMITTED)


@dataclass(frozen=True)
class ParameterResult(Value):
    """One parameter; interval, standard error and verdict hold errors of rig and sensors, interval_rig_exact the noise
    alone; group, its label (per) and the own name (parameter) of one that differs between groups of logs."""

    interval: Interval | None = None
    standard_error: float | None = None
    level: float | None = None
    verdict: str = field(default="", metadata=one_of(*VERDICTS))
    reason: str = ""
    group: str = field(default="", metadata=OMITTED)
    per: str = field(default="", metadata=OMITTED)
    parameter: str = field(default="", metadata=OMITTED)
    interval_rig_exact: Interval | None = field(default=None, metadata=OMITTED)


@dataclass(frozen=True)
class EffectReason:
    """Why one effect stays or goes; group, value: the dimensionless group that decides; error: relative, of force or
    period without it; statistic: the likelihood ratio it gains on the data. None: not known."""

    effect: str
    kept: bool
    sentence: str
    group: str = ""
    value: float | None = None
    error: float | None = None
    statistic: float | None = None


@dataclass(frozen=True)
class EffectsResult:
    """The effects of the model; chosen: "listed" by the scene or "auto"; one reason per effect that was looked at."""

    names: tuple[str, ...] = ()
    chosen: str = ""
    reasons: tuple[EffectReason, ...] = ()


@dataclass(frozen=True)
class Correlation:
    """Correlation (f, f) of the estimates `names`, and the standard errors [SI] that go with it."""

    names: tuple[str, ...] = ()
    matrix: tuple[tuple[float | None, ...], ...] = ()
    standard_errors: tuple[float | None, ...] = ()


@dataclass(frozen=True)
class WorstCycle:
    """The cycle (from 1) of a log (from 1) that fits worst, in standard deviations."""

    log: int
    cycle: int
    z: float | None = None


@dataclass(frozen=True)
class GateResult:
    """What the goodness of fit was judged by."""

    chi2_per_sample: float | None = None
    worst_cycle: WorstCycle | None = None
    solver: str | None = None
    event_shift_samples: float | None = None
    strength_scatter: float | None = None


@dataclass(frozen=True)
class FitFigures:
    """How large the fit is and how it went."""

    samples: int | None = None
    cycles: int | None = None
    iterations: int | None = None
    rms_N: float | None = None


@dataclass(frozen=True)
class QualityResult:
    """What the quality gate says of a log (accept, accept with warnings, reject), and the numbers it judged by."""

    verdict: str = ""
    findings: tuple[Finding, ...] = ()
    figures: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class ClassicalDirection:
    """All strokes of one direction (1 forth, -1 back): number, mean coefficient with its scatter from stroke to stroke,
    and by how much the last tenth of them differs from the first."""

    direction: int
    strokes: int
    coefficient: float | None
    coefficient_sd: float | None
    trend_percent: float | None


@dataclass(frozen=True)
class ClassicalTable:
    """Figures of the record alone, a row per step and stroke (SI, units in the names), with why one is None and what
    each is; of strokes to and fro the directions apart."""

    rows: tuple[Mapping[str, Json], ...] = ()
    directions: tuple[ClassicalDirection, ...] = ()
    reasons: tuple[Mapping[str, str], ...] = ()
    definitions: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class LogResult:
    """One log; part_of: the number (from 1) of the log of the scene that it is a part of, None where it is whole;
    derived: what the pair does at its speed and load."""

    part_of: int | None = field(default=None, metadata=OMITTED)
    path: str = ""
    sha256: str | None = None
    step: int | None = None
    rows: int | None = None
    labels: Mapping[str, str] = field(default_factory=dict)
    noise_N: float | None = None
    friction_sign: int = field(default=1, metadata=one_of(1, -1))
    regime: str | None = field(default=None, metadata=one_of(*REGIMES, None))
    confidence: float | None = None
    evidence: tuple[str, ...] = ()
    slip_count: int | None = None
    normal_force_N: float | None = None
    drive_speed_m_per_s: float | None = None
    window_s: tuple[float, float] | None = None
    reason_left_out: str | None = None
    classical: ClassicalTable = field(default_factory=ClassicalTable)
    quality: QualityResult = field(default_factory=QualityResult)
    corrections: tuple[Change, ...] = ()
    derived: Mapping[str, Json] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The name of its file."""
        return self.path.replace("\\", "/").rsplit("/", 1)[-1]


@dataclass(frozen=True)
class SearchTrial:
    """One try of the search; logs it took part with (from 1); 2 x cost per sample, None where there is none."""

    strategy: str
    logs: tuple[int, ...] = ()
    status: str = ""
    cost: float | None = None
    seconds: float | None = None


@dataclass(frozen=True)
class Shift:
    """What an error of 1 % in a rig quantity would do to a parameter [SI]."""

    shift: float | None
    unit: str = ""
    in_standard_errors: float | None = None


@dataclass(frozen=True)
class ToleranceResult:
    """An error of rig or sensors that published intervals hold: one standard deviation as a share; source: "scene",
    "usual" or, from the data, "estimated"."""

    relative: float
    source: str = "usual"


@dataclass(frozen=True)
class ProfileCurve:
    """The profile of one parameter: values [SI], loss in units of chi^2, the ends of its interval, whether the way to
    an end failed or met a bound; standard_error of theta, by the curvature."""

    values: tuple[float | None, ...]
    loss: tuple[float | None, ...]
    interval: Interval
    failed: tuple[bool, ...] = ()
    at_bound: tuple[bool, ...] = ()
    standard_error: float | None = None
    logarithmic: bool = False


@dataclass(frozen=True)
class ProfileResult:
    """Profiles by parameter; limit: the loss that the interval ends at."""

    level: float
    limit: float
    parameters: Mapping[str, ProfileCurve]


@dataclass(frozen=True)
class OptimumResult:
    """A local optimum: sum of squares in noise variances, values by name [SI], and how many starts led to it."""

    cost: float
    starts: int
    values: Mapping[str, float]


@dataclass(frozen=True)
class BootstrapInterval:
    """The interval of one parameter among replicates, and their spread over the standard error."""

    interval: Interval
    spread_in_standard_errors: float | None = None


@dataclass(frozen=True)
class BootstrapResult:
    """Intervals by parameter; replicates, and how many of them did not settle."""

    level: float
    replicates: int
    failed: int
    parameters: Mapping[str, BootstrapInterval]


@dataclass(frozen=True)
class AccuracyLevel:
    """What one level of accuracy costs, seconds of processor time, and the error that its steps leave in standard
    errors: the largest, and by parameter; estimated: by steps as fine as its own, without a fit."""

    accuracy: str
    seconds: float
    steps: int | None = None
    error_in_standard_errors: float | None = None
    estimated: bool = True
    left_in_standard_errors: Mapping[str, float | None] | None = None


@dataclass(frozen=True)
class AccuracyResult:
    """The level taken, and what all of them cost; seconds of processor time in the equations, and by effect."""

    taken: str
    equations_s: float
    effects_s: Mapping[str, float]
    levels: tuple[AccuracyLevel, ...]


@dataclass(frozen=True)
class HeldResult:
    """A rig quantity as stated, and where the data would put it; distance in squared standard errors."""

    stated: float
    from_data: float
    standard_error: float
    unit: str
    squared_distance: float


@dataclass(frozen=True)
class CauseResult:
    """One possible cause of a misfit, SI: a quantity (log: of one alone), its class (of those that look alike in
    the data), its score (about the fall of chi^2 with it free), its value as stated and suggested; gains as ratios."""

    quantity: str
    log: str | None
    number: int = field(metadata={"key": "class"})
    score: float
    stated: float | None
    suggested: float
    standard_error: float | None


@dataclass(frozen=True)
class DistributionResult:
    """How static peak, drop or period are spread; quantiles by percent."""

    unit: str
    quantiles: Mapping[str, Value]


@dataclass(frozen=True)
class UnevenCycles:
    """Every cycle of a log (from 1): onset and rest before it [s], force there and drop [N], strength and level over
    the load."""

    log: int
    cycle: tuple[int, ...]
    onset_s: tuple[float, ...]
    rest_s: tuple[float | None, ...]
    onset: tuple[float, ...]
    drop: tuple[float, ...]
    strength: tuple[float | None, ...]
    level: tuple[float | None, ...]


@dataclass(frozen=True)
class StrengthCurve:
    """Usual strength over the load after rests [s], with its 95 % band."""

    rest_s: tuple[float, ...]
    strength: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]


@dataclass(frozen=True)
class UnevenResult:
    """What the estimator of uneven records adds to a result."""

    distributions: Mapping[str, DistributionResult] = field(default_factory=dict)
    strength_against_rest: StrengthCurve | None = None
    uneven_cycles: tuple[UnevenCycles, ...] = ()

    @staticmethod
    def of(result: Result) -> UnevenResult:
        """Of a result; what it only gives a reason for has its default."""
        parts = {
            name: part for name, part in result.more.items() if not isinstance(part, Mapping) or "reason" not in part
        }
        return from_document(UnevenResult, parts)


@dataclass(frozen=True)
class Result:
    """A finished fit, whatever its status; `more`: what an estimator other than the plain one adds. Without success the
    parameters have no values, and `last_iterate` says where the search stood."""

    schema: int = 1
    status: str = field(default="", metadata=one_of(*(status.value for status in Status)))
    message: str = ""
    parameters: Mapping[str, ParameterResult] = field(default_factory=dict)
    effects: EffectsResult = field(default_factory=EffectsResult)
    estimator: str = "plain"
    correlation: Correlation | None = None
    gate: GateResult | None = None
    fit: FitFigures | None = None
    derived: Mapping[str, Number] = field(default_factory=dict)
    logs: tuple[LogResult, ...] = ()
    notes: tuple[str, ...] = ()
    search: tuple[SearchTrial, ...] = ()
    not_tried: tuple[str, ...] = ()
    rig_sensitivity: Mapping[str, Mapping[str, Shift]] | None = field(default=None, metadata=OMITTED)
    tolerances: Mapping[str, ToleranceResult] | None = field(default=None, metadata=OMITTED)
    profile: ProfileResult | None = field(default=None, metadata=OMITTED)
    optima: tuple[OptimumResult, ...] | None = field(default=None, metadata=OMITTED)
    bootstrap: BootstrapResult | None = field(default=None, metadata=OMITTED)
    accuracy_table: tuple[AccuracyLevel, ...] | None = field(default=None, metadata=OMITTED)
    last_iterate: Mapping[str, Value] | None = field(default=None, metadata=OMITTED)
    more: Mapping[str, Json] = field(default_factory=dict, metadata=FURTHER)
    rig_against_data: Mapping[str, HeldResult] | None = field(default=None, metadata=OMITTED)
    causes: tuple[CauseResult, ...] = ()
    timing_s: Mapping[str, float] = field(default_factory=dict, metadata=SECONDS)
    provenance: Mapping[str, Json] = field(default_factory=dict)
    accuracy: AccuracyResult | None = None

    @staticmethod
    def from_dict(document: object, where: str = "the result") -> Result:
        """The result of a document; what stands beside the schema is in `more`.

        Raises:
            DocumentError: it is no such document.
        """
        return from_document(Result, document, where)

    def to_dict(self) -> dict[str, Json]:
        """The document, as JSON knows it."""
        return to_dict(self)

    @staticmethod
    def json_schema() -> dict[str, object]:
        """The JSON schema of result.json."""
        head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "result.json of a fit"}
        return head | json_schema(Result)

    @property
    def converged(self) -> bool:
        """Whether the fit passed its gate."""
        return self.status == Status.CONVERGED.value

    @property
    def scene(self) -> Mapping[str, Json]:
        """The document of the scene it was fitted with; empty where none is recorded."""
        scene = self.provenance.get("scene")
        return scene if isinstance(scene, Mapping) else {}

    @property
    def numbers(self) -> list[int]:
        """The number in the scene (from 0) of every log: one that was cut into parts stands once for each of them."""
        numbers: list[int] = []
        for log in self.logs:
            numbers.append(log.part_of - 1 if log.part_of is not None else numbers[-1] + 1 if numbers else 0)
        return numbers

    def places(self, number: int) -> list[int]:
        """Where log `number` (from 0) of the scene stands: one place (from 0), several where it was cut."""
        return [place for place, own_number in enumerate(self.numbers) if own_number == number]
