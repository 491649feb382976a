"""RIG.toml: what was measured of a rig, for `rig = "RIG.toml"` of a scene, and in words."""

from __future__ import annotations

from collections.abc import Sequence

from identify.base.wording import three_figures
from identify.bench.calibration import RigCalibration, RigValue
from identify.bench.records import Measured

UNITS = {"mass": "kg", "stiffness": "N/m", "zeta": "", "skin_stiffness": "N/m"}
NAMED = {"mass": "moving mass", "stiffness": "stiffness", "zeta": "damping ratio", "skin_stiffness": "skin in series"}
REMEDIES = {
    "mass": "a tap, and with it a slow pull on a rigid block or a second tap with a known mass fixed to the holder "
    '(--added-mass "LOG=50 g")',
    "stiffness": "a slow pull on a rigid block, or taps with and without a known mass fixed to the holder",
    "zeta": "a tap: the drive at rest, the specimen lifted off",
}


def shown(name: str, found: RigValue) -> str:
    """A quantity in words, with its interval."""
    low, high = (f"{end:.4g}" for end in found.interval)
    return f"{found.value:.4g} {UNITS[name]}".rstrip() + f" (95 %: {low} to {high})"


def rig_toml(rig: RigCalibration, measured: Sequence[Measured]) -> str:
    """The text of RIG.toml; what is not determined is marked TODO."""
    lines = [
        "# The rig as its records have it, written by: stickslip rig",
        '# In a scene: rig = "RIG.toml". The tolerances (one standard deviation) are the priors of every fit.',
        "# A drive_speed or normal_force that all logs share may stand here as well.",
    ]
    for name in ("mass", "stiffness", "zeta"):
        found: RigValue | None = getattr(rig, name)
        if found is None:
            lines.append(f'{name} = "{f"TODO {UNITS[name]}".strip()}"   # not determined; give {REMEDIES[name]}')
        else:
            value = f"{found.value:.6g}" if not UNITS[name] else f'"{found.value:.6g} {UNITS[name]}"'
            interval = " to ".join(f"{end:.4g}" for end in found.interval)
            lines.append(
                f'{name} = {{ value = {value}, tolerance = "{100.0 * found.tolerance:.3g} %" }}   # 95 %: {interval}'
            )
    if rig.tied:
        lines.append(f'natural_frequency_tolerance = "{100.0 * rig.tied:.3g} %"   # sqrt(k/m): both err together')
    if rig.skin_stiffness is not None:
        lines += ["", "# The skin in series, for a scene with the effect skin_compliance:", *_skin(rig.skin_stiffness)]
    lines += ["", "# From:", *(f"#   {words}" for words in dict.fromkeys(m.source for m in measured))]
    if disagreement(rig):
        lines.append(f"# {disagreement(rig)}")
    return "\n".join([*lines, ""])


def _skin(found: RigValue) -> tuple[str, str]:
    sd = found.value * found.tolerance
    return (
        "# [parameters]",
        f'# skin_stiffness = {{ prior = {{ mean = "{found.value:.4g} N/m", sd = "{sd:.2g} N/m" }} }}',
    )


def disagreement(rig: RigCalibration) -> str:
    """That the figures do not agree, and what to do; "" where they do."""
    agreed = rig.agreement
    if agreed.widening == 1.0:
        return ""
    return (
        f"the records disagree by more than their errors, most of all {agreed.worst}; the intervals are "
        f"{three_figures(agreed.widening)} times as wide for it: repeat that record, check drive speed and added mass"
    )
