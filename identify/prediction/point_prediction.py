"""What is predicted at an operating point, as values: stability, amplitude, the closed forms beside them, in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from identify.base.document import FURTHER
from identify.base.result import Number
from identify.prediction.draws import AnswerInterval

FROM, TO = (MappingProxyType({"key": key}) for key in ("from", "to"))  # keys of documents that Python keeps for itself


@dataclass(frozen=True)
class SlidingAnswer:
    """Steady sliding: whether small disturbances die out, their growth rate, the friction force, eigenvalues [1/s] as
    (real, imaginary); worn: the contact does not age while it slides."""

    stable: bool
    growth_rate: Number
    friction_force: Number
    eigenvalues: tuple[tuple[float, float], ...]
    worn: bool


@dataclass(frozen=True)
class StickSlipRange:
    """The drive speeds between which stick-slip exists; None where that was not found within the search."""

    low: Number | None = field(metadata=FROM)
    high: Number | None = field(metadata=TO)


@dataclass(frozen=True)
class SpeedWindow:
    """What the pair does between two drive speeds [m/s]."""

    low: float = field(metadata=FROM)
    high: float = field(metadata=TO)
    outcome: str


@dataclass(frozen=True)
class StabilityAnswer:
    """What the pair does here and over all drive speeds [m/s]; multipliers: of the orbit here, None without one;
    probability: that stick-slip exists here, the share of the draws of what is uncertain, with its 95 % interval."""

    outcome: str
    critical_speed: Number
    sliding: SlidingAnswer
    sliding_unstable_between: tuple[tuple[float, float], ...]
    searched_between: tuple[float, float]
    stick_slip_between: tuple[StickSlipRange, ...]
    windows: tuple[SpeedWindow, ...]
    multiplier: float | None
    multipliers: tuple[tuple[float, float], ...] | None
    text: str = ""
    probability: Number = field(default_factory=lambda: Number(None))


@dataclass(frozen=True)
class AmplitudeAnswer:
    """Size and timing of the jumps, by name of `orbit.QUANTITIES`, and their frequency and share of slip."""

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
    """The whole prediction at one operating point; every number is None where there is none. Its document is what
    `stickslip stability --json` and result.json hold."""

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


def number(value: float | None, unit: str, validity: str, interval: AnswerInterval | None = None) -> Number:
    """A number as the interface gives it; what is not finite has neither value nor interval."""
    if value is None or not np.isfinite(value):
        return Number(None, unit, None, validity)
    if interval is None:
        return Number(float(value), unit, None, validity)
    reason = f"interval open: {interval.reason}" if interval.reason else ""
    return Number(float(value), unit, (interval.low, interval.high), validity, reason)
