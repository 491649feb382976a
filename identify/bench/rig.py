"""A rig from short records of it: what each measures, mass, stiffness and damping that fit all of it, and RIG.toml.

Least squares in the logarithms: ln w = (ln k - ln(m + added))/2 for each ring-down, ln k for each stick on a rigid
block, -ln(1/k + 1/k_skin) on skin, each over its standard error; an error of the drive speed, common to all sticks,
and one of the added masses are unknowns with their tolerance. Figures that scatter by more than their errors widen
the intervals (Birge ratio).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.special import chdtrc

from data_io import Record
from identify.base.errors import IdentifyError
from identify.base.quantiles import NORMAL, student
from identify.base.wording import speed_text, three_figures
from identify.bench.ringdown import FEWEST_SAMPLES, FEWEST_SWINGS, ring_downs
from identify.logs.noise import line_slope
from identify.logs.recorded_drive import NOT_STATED, drive_of, recorded_drive
from identify.logs.regime import look

Array = NDArray[np.float64]

RISE = 0.2, 0.8  # of the way from rest to the level that a ramp reaches: its straight part
FEWEST_ROWS = 8  # of a ramp
BENT = 0.1  # by how much the two halves of a ramp may differ in slope
DISAGREE = 0.01  # probability below which figures that agree would scatter so much
UNKNOWN = 1.0  # standard deviation of a logarithm: beyond it a quantity is not known
LIKELY = {"mass": 0.2, "stiffness": 1470.0, "skin_stiffness": 4400.0, "zeta": 0.05}  # where the search starts, SI


# What one record measures.


@dataclass(frozen=True)
class Measured:
    """One figure of a rig from one record.

    kind: "frequency" (natural, undamped [rad/s]), "zeta", "stiffness" [N/m], "series" (stiffness with the skin in
    series [N/m]) or "mass" [kg]; value, and error: standard error, relative; added: mass [kg] that was fixed to the
    rig; by_speed: whether an error of the drive speed is one of the figure; source: where it is from, in words.
    """

    kind: str
    value: float
    error: float
    source: str
    added: float = 0.0
    by_speed: bool = False


def rings(record: Record, name: str, added: float = 0.0) -> list[Measured]:
    """Natural frequency and damping ratio of every tap of a record; none where nothing rings down.

    Raises:
        IdentifyError: too few samples per swing.
    """
    try:
        taps = ring_downs(record.time, record.friction_force)
    except IdentifyError as reason:
        raise IdentifyError(f"{name}: {reason}") from None
    measured = []
    for number, tap in enumerate(taps, 1):
        shown = f"{name}, tap {number}" if len(taps) > 1 else name
        shown += f": rings at {three_figures(tap.frequency / (2 * np.pi))} Hz for {tap.swings:.0f} swings"
        if tap.dry:
            shown += f", which die along a straight line: a guide rubs with {three_figures(tap.dry)} N"
        measured.append(Measured("frequency", tap.frequency, tap.frequency_error, shown, added))
        if tap.zeta_error < 1.0:
            measured.append(Measured("zeta", tap.zeta, tap.zeta_error, shown, added))
    return measured


def sticks(record: Record, path: Path, speed: float | None, on_skin: bool = False) -> list[Measured]:
    """The stiffness that the sticks of a record, or one slow pull, show.

    Args:
        speed: of the drive [m/s]; None: as the record has it.

    Raises:
        IdentifyError: no drive speed, or no straight rise.
    """
    recorded = recorded_drive(record)
    seen = look(record, drive_of(record, recorded))
    drive = recorded.speed if speed is None else speed
    if not drive:
        why = "" if recorded.trouble == NOT_STATED else f" ({recorded.trouble})"
        raise IdentifyError(
            f"{path.name}: no tap rings down in it, and its drive speed is not constant{why}, which turns the slope "
            f'of a stick into a stiffness; for a pull give --drive-speed "{path.name}=0.1 mm/s"; a tap needs '
            f"{FEWEST_SWINGS:.0f} swings above the noise with {FEWEST_SAMPLES:.0f} samples each: sample faster"
        )
    slopes = np.abs(np.concatenate([verdict.phases.stick_slopes for verdict in seen.verdicts] or [np.empty(0)]))
    if slopes.size >= 2:
        slope = float(np.median(slopes))
        spread = 1.4826 * float(np.median(np.abs(slopes - slope))) / slope
        # pi/2 is the price of a median.
        error = spread * math.sqrt(0.5 * math.pi / slopes.size) * float(student(0.975, slopes.size - 1)) / NORMAL
        shown = f"{slopes.size} sticks rise at {three_figures(slope)} N/s"
    else:
        slope, error = _ramp(record.time, record.friction_force, path.name)
        shown = f"a ramp rises at {three_figures(slope)} N/s"
    source = f"{path.name}: {shown} at {speed_text(drive)}{', on skin' if on_skin else ''}"
    return [Measured("series" if on_skin else "stiffness", slope / drive, error, source, by_speed=True)]


def _ramp(time: Array, force: Array, name: str) -> tuple[float, float]:
    """Slope [N/s] of a rise from rest to a level, and its relative standard error; refused if it is not straight."""
    good = np.isfinite(force)
    time, force = time[good], force[good]
    force = force * (1.0 if np.sum(force - force[0]) >= 0.0 else -1.0)
    low, high = np.quantile(force, (0.02, 0.98))
    levels = [low + share * (high - low) for share in RISE]
    top = int(np.argmax(force >= levels[1]))
    below = np.flatnonzero(force[: top + 1] <= levels[0])
    first = int(below[-1]) + 1 if below.size else 0
    t, f = time[first : top + 1], force[first : top + 1]
    if top - first >= FEWEST_ROWS:
        line = np.polyfit(t - t[0], f, 1)
        noise, half = float(np.std(f - np.polyval(line, t - t[0]), ddof=2)), t.size // 2
        halves = [line_slope(t[part], f[part], noise) for part in (slice(half), slice(half, None))]
        error, bend = noise / (np.sqrt(t.size) * float(np.std(t))), abs(halves[1] - halves[0])
        # A line through half the rows is known to sqrt(8) times the error of the whole.
        if line[0] > 0.0 and bend <= BENT * line[0] + 4.0 * np.sqrt(16.0) * error:
            return float(line[0]), float(np.hypot(bend / 4.0, error)) / float(line[0])  # a bend is not known either
    raise IdentifyError(
        f"{name} holds neither a tap that rings down, nor two sticks, nor a straight rise of the force; record one of "
        "these: a tap with the drive at rest, or a slow pull on a rigid block"
    )


# The rig that fits all of it.


@dataclass(frozen=True)
class RigValue:
    """A quantity of a rig [SI] and its relative standard deviation."""

    value: float
    tolerance: float

    @property
    def interval(self) -> tuple[float, float]:
        """Of 95 %, in which the logarithm is normal."""
        reach = math.exp(NORMAL * self.tolerance)
        return self.value / reach, self.value * reach


@dataclass(frozen=True)
class Agreement:
    """Of figures among each other: by how much intervals are widened (1: they agree), the probability that figures
    which agree scatter as these do, and the figure that is farthest off, in words."""

    widening: float
    chance: float
    worst: str


@dataclass(frozen=True)
class RigCalibration:
    """mass [kg], stiffness [N/m], damping ratio zeta; skin_stiffness [N/m]; natural_frequency sqrt(k/m) [rad/s]; None:
    not determined; agreement of all figures among each other."""

    mass: RigValue | None
    stiffness: RigValue | None
    zeta: RigValue | None
    skin_stiffness: RigValue | None
    natural_frequency: RigValue | None
    agreement: Agreement

    @property
    def tied(self) -> float:
        """Tolerance of sqrt(k/m) where mass and stiffness are known together better than apart; 0 where they are not:
        a tap measures their ratio to a thousandth, so that what one is off by the other is off by too."""
        if self.mass is None or self.natural_frequency is None:
            return 0.0
        return self.natural_frequency.tolerance if 2.0 * self.natural_frequency.tolerance < self.mass.tolerance else 0.0

    @property
    def missing(self) -> tuple[str, ...]:
        """What a scene needs and no record determines."""
        names = ("mass", "stiffness", "zeta")
        return tuple(name for name in names if getattr(self, name) is None)


def calibrated(measured: Sequence[Measured], speed_tolerance: float, added_tolerance: float) -> RigCalibration:
    """The rig that fits all figures best.

    Args:
        measured: at least one.
        speed_tolerance, added_tolerance: of the drive speed, and of added masses; relative, one standard deviation.

    Raises:
        IdentifyError: no figure at all.
    """
    if not measured:
        raise IdentifyError("no record determines anything of the rig; give a tap, or a stick on a rigid block")
    zetas = [m for m in measured if m.kind == "zeta"]
    # The damping ratio of the rig as it is used; with an added mass where no other record determines it.
    figures = [m for m in measured if m.kind != "zeta"] + ([m for m in zetas if m.added == 0.0] or zetas)
    kinds = {m.kind for m in figures}
    names = ["mass", "stiffness", *["skin_stiffness"] * ("series" in kinds), *["zeta"] * ("zeta" in kinds)]
    tolerances = np.array([max(speed_tolerance, 1e-9), max(added_tolerance, 1e-9)])

    def predicted(m: Measured, rig: dict[str, float], speed: float, added: float) -> float:
        """Logarithm of what a rig, in logarithms, would show, with relative errors of drive speed and added mass."""
        if m.kind in ("mass", "zeta"):
            return rig[m.kind]
        stiffness = rig["stiffness"]
        if m.kind == "frequency":
            return 0.5 * (stiffness - math.log(math.exp(rig["mass"]) + m.added * (1.0 + added)))
        if m.kind == "series":
            stiffness = -math.log(math.exp(-stiffness) + math.exp(-rig["skin_stiffness"]))
        return stiffness + (speed if m.by_speed else 0.0)

    def off(x: Array) -> Array:
        rig, common = dict(zip(names, x, strict=False)), x[len(names) :]
        rows = [(predicted(m, rig, *(common * tolerances)) - math.log(m.value)) / m.error for m in figures]
        return np.array([*rows, *common])

    begin = np.array([*(math.log(LIKELY[name]) for name in names), 0.0, 0.0])
    best = least_squares(off, begin, x_scale="jac", method="trf", max_nfev=500, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    _, seen, rows = np.linalg.svd(best.jac)
    singular = np.zeros(begin.size)
    singular[: seen.size] = seen
    # What is not determined has a singular value of zero, or of the rounding of differences: its deviation is huge.
    inverse = (rows.T / np.maximum(singular, 1e-9 * seen[0]) ** 2) @ rows
    freedom, total = best.fun.size - int(np.count_nonzero(singular > 1e-6 * seen[0])), float(best.fun @ best.fun)
    agreed = Agreement(1.0, 1.0, "")
    if freedom > 0:
        chance = float(chdtrc(freedom, total))
        birge = math.sqrt(total / freedom) * float(student(0.975, freedom)) / NORMAL
        worst = figures[int(np.argmax(np.abs(best.fun[: len(figures)])))].source
        agreed = Agreement(max(birge, 1.0) if chance < DISAGREE else 1.0, chance, worst)
    deviations = np.sqrt(np.diag(inverse)) * agreed.widening
    known = {
        name: RigValue(math.exp(value), float(deviation)) if deviation < UNKNOWN else None
        for name, value, deviation in zip(names, best.x, deviations, strict=False)
    }
    ratio = np.array([-0.5, 0.5] + [0.0] * (begin.size - 2))
    spread = float(np.sqrt(ratio @ inverse @ ratio)) * agreed.widening
    natural = RigValue(math.exp(ratio @ best.x), spread) if known["mass"] and known["stiffness"] else None
    return RigCalibration(
        known["mass"], known["stiffness"], known.get("zeta"), known.get("skin_stiffness"), natural, agreed
    )


# RIG.toml, for `rig = "RIG.toml"` of a scene, and words.

UNITS = {"mass": "kg", "stiffness": "N/m", "zeta": "", "skin_stiffness": "N/m"}
NAMED = {"mass": "moving mass", "stiffness": "stiffness", "zeta": "damping ratio", "skin_stiffness": "skin in series"}
REMEDIES = {
    "mass": "a tap, and with it a slow pull on a rigid block or a second tap with a known mass fixed to the holder "
    '(--added-mass "LOG=50 g")',
    "stiffness": "a slow pull on a rigid block, or taps with and without a known mass fixed to the holder",
    "zeta": "a tap: the drive at rest, the specimen lifted off",
}


def shown(name: str, known: RigValue) -> str:
    """A quantity in words, with its interval."""
    low, high = (f"{end:.4g}" for end in known.interval)
    return f"{known.value:.4g} {UNITS[name]}".rstrip() + f" (95 %: {low} to {high})"


def rig_toml(rig: RigCalibration, measured: Sequence[Measured]) -> str:
    """The text of RIG.toml; what is not determined is marked TODO."""
    lines = [
        "# The rig as its records have it, written by: stickslip rig",
        '# In a scene: rig = "RIG.toml". The tolerances (one standard deviation) are the priors of every fit.',
        "# A drive_speed or normal_force that all logs share may stand here as well.",
    ]
    for name in ("mass", "stiffness", "zeta"):
        known: RigValue | None = getattr(rig, name)
        if known is None:
            lines.append(f'{name} = "{f"TODO {UNITS[name]}".strip()}"   # not determined; give {REMEDIES[name]}')
        else:
            value = f"{known.value:.6g}" if not UNITS[name] else f'"{known.value:.6g} {UNITS[name]}"'
            interval = " to ".join(f"{end:.4g}" for end in known.interval)
            lines.append(
                f'{name} = {{ value = {value}, tolerance = "{100.0 * known.tolerance:.3g} %" }}   # 95 %: {interval}'
            )
    if rig.tied:
        lines.append(f'natural_frequency_tolerance = "{100.0 * rig.tied:.3g} %"   # sqrt(k/m): both err together')
    if rig.skin_stiffness is not None:
        skin, sd = rig.skin_stiffness.value, rig.skin_stiffness.value * rig.skin_stiffness.tolerance
        lines += ["", "# The skin in series, for a scene with the effect skin_compliance:", "# [parameters]"]
        lines.append(f'# skin_stiffness = {{ prior = {{ mean = "{skin:.4g} N/m", sd = "{sd:.2g} N/m" }} }}')
    lines += ["", "# From:", *(f"#   {words}" for words in dict.fromkeys(m.source for m in measured))]
    if disagreement(rig):
        lines.append(f"# {disagreement(rig)}")
    return "\n".join([*lines, ""])


def disagreement(rig: RigCalibration) -> str:
    """That the figures do not agree, and what to do; "" where they do."""
    agreed = rig.agreement
    if agreed.widening == 1.0:
        return ""
    return (
        f"the records disagree by more than their errors, most of all {agreed.worst}; the intervals are "
        f"{three_figures(agreed.widening)} times as wide for it: repeat that record, check drive speed and added mass"
    )
