"""The quality gate: what a record's clock and force channels look like, in numbers and in sentences.

Knows sampling and sensors only; whether a slip holds enough samples is for those who know slips.
"""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from data_io.frozen import Finding, FloatArray
from data_io.quality_load import UNLOADED, Load, look_at_load
from data_io.quality_signal import Signal, look_at_friction
from data_io.record import Record
from data_io.rest import FEWEST, Rest, Rests, find_rests
from data_io.sampling import Sampling, describe_sampling
from data_io.thinned import kept, shown, thinned
from data_io.thresholds import DEFAULTS, Thresholds
from data_io.wording import percent

Verdict = Literal["accept", "accept with warnings", "reject"]

_COEFFICIENT_NAMES: Final = ("cof", "mu", "µ", "μ", "friction coefficient", "coefficient of friction")


@dataclass(frozen=True)
class Quality:
    """What the gate measured. Findings hold the record's own first, then those of the gate.

    sampling, signal, load_course: see `Sampling`, `Signal`, `Load`. rests: the drive at rest at both ends of the log.
    residual [N]: friction force before the drive moves or while nothing presses, None where the log does not show it.
    coefficient_error: median share by which the file's own coefficient differs from friction / normal force, None
    where the file has none.
    """

    sampling: Sampling
    signal: Signal
    load_course: Load
    rests: Rests
    residual: float | None
    coefficient_error: float | None
    findings: tuple[Finding, ...]

    @property
    def resolution(self) -> float:
        """Step of the grid on which the friction values lie [N], 0 where they show none."""
        return self.signal.resolution

    @property
    def load(self) -> float:
        """Median normal force of the loaded rows [N]."""
        return self.load_course.level

    @property
    def load_drift(self) -> float:
        """Change of the normal force from the first to the last tenth, as share of it."""
        return self.load_course.drift

    @property
    def load_ripple(self) -> float:
        """Standard deviation of the normal force about a straight line, as share of it."""
        return self.load_course.ripple

    @property
    def verdict(self) -> Verdict:
        """The worst finding decides."""
        return verdict_of(self.findings)

    @property
    def figures(self) -> dict[str, tuple[float | None, str]]:
        """Every number of the gate by name, with its unit."""
        sampling, signal, load = self.sampling, self.signal, self.load_course
        locked = self.rests.after
        return {
            "sampling_rate": (sampling.rate, "Hz"),
            "jitter": (sampling.jitter, ""),
            "missing_rows": (sampling.missing, ""),
            "repeated_rows": (signal.repeated, ""),
            "resolution": (signal.resolution, "N"),
            "clipped_rows": (signal.clipped, ""),
            "residual_force": (self.residual, "N"),
            "force_after_stop": (None if locked is None else locked.force, "N"),
            "normal_force": (load.level, "N"),
            "normal_force_drift": (load.drift, ""),
            "normal_force_ripple": (load.ripple, ""),
            "unloaded_rows": (load.unloaded, ""),
            "coefficient_error": (self.coefficient_error, ""),
        }


def verdict_of(findings: tuple[Finding, ...] | list[Finding]) -> Verdict:
    """Return the verdict that findings amount to."""
    severities = {finding.severity for finding in findings}
    return "reject" if "reject" in severities else "accept with warnings" if "warning" in severities else "accept"


def assess(
    record: Record,
    used: npt.NDArray[np.bool_] | None = None,
    thresholds: Thresholds = DEFAULTS,
    speed: FloatArray | None = None,
) -> Quality:
    """Look at a record's clock and forces; never changes it and never fails on a valid record.

    used: (n,) the rows that count (None: all), as the scene cuts them. thresholds: see `data_io.thresholds`.
    speed (n,) [m/s]: how fast the drive moves, where a column is known to be it.
    """
    used = np.ones(len(record), dtype=bool) if used is None else used
    sampling, notes = describe_sampling(record, used, thresholds)
    sound = used & np.isfinite(record.friction_force) & np.isfinite(record.normal_force)
    if np.count_nonzero(sound) < 2:
        text = "fewer than two rows count; widen window, exclude less, or take a longer log"
        nothing = Finding("no_rows", "reject", text)
        return Quality(
            sampling, Signal(0, 0.0, 0.0), Load(0.0, 0.0, 0.0, 0.0), Rests(None, None), None, None,
            (*record.findings, *notes, nothing),
        )  # fmt: skip
    load, about_load = look_at_load(record, sound, thresholds)
    rests = find_rests(record, shown(record.friction_force, sound), speed)
    moving = _moving(sound, rests)
    signal, about_friction = look_at_friction(record, sound, thresholds)
    residual, about_rest = _rest_findings(record, sound, moving, load, rests, thresholds)
    error = _coefficient_error(record, sound, load.level)
    notes += [*about_friction, *about_load, *about_rest]
    if severity := thresholds.severity("coefficient", error or 0.0):
        text = (
            f"the file's own coefficient differs from friction force / normal force by {percent(error or 0.0)} "
            "(median); check zero points and columns"
        )
        notes.append(Finding("coefficient_disagrees", severity, text))
    return Quality(sampling, signal, load, rests, residual, error, (*record.findings, *notes))


def _moving(sound: npt.NDArray[np.bool_], rests: Rests) -> npt.NDArray[np.bool_]:
    moving = sound.copy()
    for rest in (rests.before, rests.after):
        if rest is not None:
            moving[rest.start : rest.stop] = False
    return moving if np.count_nonzero(moving) > 1 else sound


def _rest_findings(
    record: Record,
    sound: npt.NDArray[np.bool_],
    moving: npt.NDArray[np.bool_],
    load: Load,
    rests: Rests,
    limits: Thresholds,
) -> tuple[float | None, list[Finding]]:
    """Return the residual force [N] and what is to say of it and of a stop."""
    sliding = float(np.median(np.abs(thinned(kept(record.friction_force, moving)))))
    unpressed = sound & (record.normal_force < UNLOADED * load.level)
    residual, when, remedy = None, "", ""
    if np.count_nonzero(unpressed) >= FEWEST:
        residual = float(np.median(record.friction_force[unpressed]))
        when, remedy = "while nothing presses", f'tare = "{residual:.3g} N"'
    elif rests.before is not None:
        end = record.time[max(int(0.9 * rests.before.stop), 1)]
        residual = rests.before.force
        when, remedy = f"before the drive moves (to {end:.4g} s)", f'tare = ["0 s", "{end:.4g} s"]'
    notes = []
    share = abs(residual or 0.0) / sliding if sliding else 0.0
    if residual is not None and (severity := limits.severity("residual_force", share)):
        text = (
            f"the friction force shows {residual:.3g} N {when}, {percent(share, of='the sliding force')}; zero the "
            f"sensor or take it off with {remedy}"
        )
        notes.append(Finding("residual_force", severity, text))
    if rests.after is not None:
        notes += _stop(record, rests.after, limits)
    return residual, notes


def _stop(record: Record, rest: Rest, limits: Thresholds) -> list[Finding]:
    since = float(record.time[rest.start])
    cut = f'leave it out with window = ["0 s", "{since:.4g} s"]'
    severity = limits.severity("stopped_rows", rest.rows / len(record))
    if rest.told and severity:
        text = f"the drive stops at {since:.4g} s, and {rest.force:.3g} N stay locked in; {cut}"
        return [Finding("stopped", severity, text)]
    text = f"from {since:.4g} s to the end the force stays at {rest.force:.3g} N; if the drive had stopped, {cut}"
    return [Finding("perhaps_stopped", "info", text)] if severity else []


def _coefficient_error(record: Record, sound: npt.NDArray[np.bool_], load: float) -> float | None:
    name = next((n for n in record.channels if n.strip().casefold() in _COEFFICIENT_NAMES), None)
    if name is None or record.channel_units[name] not in ("", "-", "1"):
        return None
    told = np.abs(record.channels[name])
    usable = sound & np.isfinite(told) & (record.normal_force > 0.5 * load)
    usable &= np.abs(record.friction_force) > 0.1 * np.max(np.abs(record.friction_force[sound]))
    if load <= 0 or not usable.any():
        return None
    own = np.abs(record.friction_force[usable]) / record.normal_force[usable]
    return float(np.median(np.abs(told[usable] - own) / own))
