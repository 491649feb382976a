"""The thresholds of the quality gate: one visible table, each number documented and open to override."""

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

from data_io.values import Finding, Frozen, LogError, Severity

# Numbers as people say them.

MOST_PERCENT: Final = 10.0
"""Share above which percents say less than "times"."""


def percent(share: float, digits: int = 0, *, signed: bool = False, of: str = "") -> str:
    """Return a share as "12 %" or "12 % of 3 N"; never as "-0 %", and many times the whole as "2000 times 3 N"."""
    if abs(share) > MOST_PERCENT:
        size = f"{share:+.3g}" if signed else f"{share:.3g}"
        times = "many times" if "e" in size or "inf" in size else f"{size} times"
        return f"{times} {of}".rstrip()
    return f"{100 * share:{'+' if signed else ''}z.{digits}f} %" + (f" of {of}" if of else "")


@dataclass(frozen=True)
class Limit:
    """One threshold: what is measured, in which unit, and which verdict lies beyond it.

    `beyond` says on which side: "above" the value or "below" it.
    """

    name: str
    value: float
    unit: str
    meaning: str
    severity: Severity = "warning"
    beyond: Literal["above", "below"] = "above"


LIMITS: Final = (
    Limit("residual_force", 0.05, "of the sliding force",
          "friction force shown before the drive moves, or while nothing presses"),
    Limit("stopped_rows", 0.0, "of the rows", "rows after the drive has stopped"),
    Limit("friction_drift", 0.10, "of the friction force",
          "change of the friction force over the load from the first to the last third of the slips"),
    Limit("unloaded_rows", 0.0, "of the rows", "rows that press with a tenth of the load or less"),
    Limit("load_drift", 0.10, "of the load", "change of the normal force from first to last tenth"),
    Limit("load_ripple", 0.05, "of the load", "standard deviation of the normal force"),
    Limit("load_ripple_reject", 0.25, "of the load", "the same: the load is not under control", severity="reject"),
    Limit("clipped_rows", 0.0, "of the rows", "rows in which a force sensor stands at its end"),
    Limit("clipped_rows_reject", 0.05, "of the rows", "the same: the peaks are gone", severity="reject"),
    Limit("quantisation", 0.02, "of the range of the friction force",
          "step of the grid on which the values of the friction force lie"),
    Limit("quantisation_reject", 0.2, "of the range of the friction force",
          "the same: a slip is a step or two", severity="reject"),
    Limit("missing_rows", 0.0, "of the rows", "rows missing in gaps of the clock"),
    Limit("missing_rows_reject", 0.2, "of the rows", "the same", severity="reject"),
    Limit("jitter", 0.05, "of the sampling interval", "robust standard deviation of the sampling interval"),
    Limit("jitter_reject", 0.3, "of the sampling interval", "the same", severity="reject"),
    Limit("rate_switch", 1.5, "times", "factor by which the sampling rate changes in mid-log"),
    Limit("repeated_rows", 0.05, "of the rows",
          "rows that repeat every measured value of the row before, quantisation apart"),
    Limit("repeated_rows_reject", 0.6, "of the rows",
          "the same: the logger ran far faster than the sensor", severity="reject"),
    Limit("coefficient", 0.05, "of the coefficient",
          "median difference between the file's coefficient and friction force over normal force"),
    Limit("coefficient_highest", 10.0, "", "friction force over normal force: a wrong unit?"),
    Limit("coefficient_lowest", 0.001, "", "friction force over normal force: a wrong unit?", beyond="below"),
    Limit("spikes", 0.002, "of the rows", "samples far from their neighbours"),
    Limit("spikes_reject", 0.02, "of the rows", "the same", severity="reject"),
    Limit("cycles", 3, "cycles", "stick-slip cycles found, where there are any", beyond="below"),
    Limit("samples_per_slip", 10, "samples",
          "samples from force peak to valley: what a and delta_mu_k need", beyond="below"),
    Limit("samples_per_cycle_reject", 4, "samples",
          "samples per period: with fewer, stick and slip cannot be distinguished", severity="reject", beyond="below"),
    Limit("stick_slope", 0.10, "of k times v_0",
          "difference between the slope of the sticks and stiffness times drive speed"),
)  # fmt: skip
"""Every threshold with its default; `Thresholds` overrides them by name."""

NAMES: Final = tuple(limit.name for limit in LIMITS)
_DEFAULT: Final = {limit.name: limit for limit in LIMITS}


@dataclass(frozen=True)
class Thresholds:
    """The defaults of `LIMITS` with the user's own numbers in place of some of them.

    Raises `LogError` for a name that is not in the table, or a number that is none.
    """

    own: Mapping[str, float] = field(default_factory=Frozen)

    def __post_init__(self) -> None:
        for name, value in self.own.items():
            if name not in _DEFAULT:
                near = difflib.get_close_matches(name, NAMES, n=1, cutoff=0.0)[0]
                raise LogError(
                    f"the threshold {name!r} is not known; did you mean {near!r}? Known are {', '.join(NAMES)}"
                )
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not value >= 0:
                raise LogError(f"the threshold {name} is {value!r}; a number from 0 on was expected (inf: never)")
        object.__setattr__(self, "own", Frozen(dict(self.own)))

    def __getitem__(self, name: str) -> float:
        return float(self.own.get(name, _DEFAULT[name].value))

    def beyond(self, name: str, measured: float) -> bool:
        """Tell whether a measured number lies beyond a threshold; one that is no number does not."""
        if not math.isfinite(measured):
            return False
        return measured > self[name] if _DEFAULT[name].beyond == "above" else measured < self[name]

    def finding(self, code: str, name: str, measured: float, text: str) -> list[Finding]:
        """Return what is to say of a measured number that lies beyond a threshold: one finding, or none."""
        severity = self.severity(name, measured)
        return [] if severity is None else [Finding(code, severity, text)]

    def severity(self, name: str, measured: float) -> Severity | None:
        """Return "reject", "warning" or None by the thresholds `name` and, where there is one, `name`_reject."""
        for key in (f"{name}_reject", name):
            if key in _DEFAULT and self.beyond(key, measured):
                return _DEFAULT[key].severity
        return None


DEFAULTS: Final = Thresholds()
