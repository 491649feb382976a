"""The paper's closed forms for a scene, in SI, each beside the nonlinear model's answer and judged by it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from identify.calculators.spread import Interval
from identify.closed_forms import stability
from identify.closed_forms.groups import Groups, groups
from identify.closed_forms.jump import jump
from identify.closed_forms.steady import FrictionLike, RigLike
from identify.effects import MAIN

AGREES = 0.05  # relative difference up to which a closed form is called valid at an operating point
KNOWN = (*MAIN, "driven_damping", "linear_weakening", "varying_normal_force")  # effects, at one operating point
SLOW = 1e-6  # s/m, of a weakening that no slip gets to the end of


@dataclass(frozen=True)
class Contact:
    """Rig and friction of a scene as the calculators take them; effects a model lacks stand at their null."""

    rig: RigLike
    friction: FrictionLike


def beyond(effects: Sequence[str]) -> tuple[str, ...]:
    """The effects of which the closed forms know nothing."""
    return tuple(name for name in effects if name not in KNOWN)


def contact(values: Mapping[str, float]) -> Contact:
    """The rig and friction of named parameter values; what is absent is null (no damping, ageing, weakening).

    A damping at a frequency of its own is the h that gives the same damper at the natural frequency; weakening in
    proportion to speed is the start of an exponential one that is very slow.
    """
    rig = {name: values.get(name, 0.0) for name in ("mass", "stiffness", "damping")}
    if "damping_frequency" in values:
        natural = np.sqrt(rig["stiffness"] / rig["mass"]) / (2 * np.pi)
        rig["damping"] *= float(natural / values["damping_frequency"])
    friction = {name: values.get(name, 0.0) for name in ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")}
    if "slope" in values:
        friction |= {"delta_mu_k": values["slope"] / SLOW, "a": SLOW}
    return Contact(SimpleNamespace(**rig), SimpleNamespace(**friction))


@dataclass(frozen=True)
class ClosedForms:
    """The closed forms at one operating point, SI, NaN where they have no answer; `status` says why.

    status: "restick", "steady", "no_slip", "runaway" (of the linearised slip); critical_speed [m/s] is the drive
    speed below which that slip sticks again; friction_parameter and its critical values decide whether steady
    sliding is stable (below: stable), by the derived and by the printed eq. (25).
    """

    groups: Groups
    status: str
    drop: float
    period: float
    slip_duration: float
    peak_speed: float
    saturation: float
    critical_speed: float
    friction_parameter: float
    critical_friction: float
    critical_friction_printed: float
    critical_frequency: float
    worn: bool


def closed_forms(pair: Contact, drive_speed: float, normal_force: float) -> ClosedForms:
    """The closed forms at drive speed [m/s], positive, and normal force [N] (docs/equations.md, sections 4 to 6)."""
    rig, friction = pair.rig, pair.friction
    g = groups(rig, friction, drive_speed, normal_force)
    cycle = jump(rig, friction, drive_speed, normal_force)
    limit = float(stability.critical_loading(g.alpha))
    fall = (friction.mu_s - friction.mu_k0) * normal_force / np.sqrt(rig.mass * rig.stiffness)
    critical_speed = float("nan") if np.isnan(limit) else fall / limit if limit > 0 else float("inf")
    ageing = friction.D > 0 and friction.t_cr > 0
    return ClosedForms(
        groups=g,
        status=str(cycle.status),
        drop=cycle.drop,
        period=cycle.period,
        slip_duration=cycle.slip_duration,
        peak_speed=cycle.peak_speed,
        saturation=cycle.saturation,
        critical_speed=critical_speed,
        friction_parameter=g.Pi,
        critical_friction=float(stability.critical_friction(g.z / 2, g.tau_cr)) if ageing else float("nan"),
        critical_friction_printed=(
            float(stability.critical_friction(g.zeta, g.tau_cr, form="printed")) if ageing else float("nan")
        ),
        critical_frequency=float(stability.critical_frequency(g.z / 2, g.tau_cr)) if ageing else float("nan"),
        worn=not ageing or g.v_acr > 1,
    )


def judged(value: float, answer: float | None, status: str, alpha: float) -> str:
    """Whether a closed form holds here: it is compared with the nonlinear model's `answer` (None: there is none)."""
    if status == "runaway":
        return f"not valid here: the linear law runs away (alpha = {alpha:.3g}, at or below -1)"
    if not np.isfinite(value) and answer is None:
        return "valid here: like the nonlinear model it has no such motion"
    if not np.isfinite(value):
        return "not valid here: it has no answer where the nonlinear model has one"
    if answer is None or not np.isfinite(answer):
        return "not valid here: the nonlinear model has no such motion"
    off = abs(value / answer - 1)
    return f"valid here: within {_percent(off)}" if off <= AGREES else f"not valid here: off by {_percent(off)}"


def _percent(share: float) -> str:
    if share > 3:
        return f"a factor {share + 1:.0f}"
    return f"{100 * share:.1f} %" if share < 0.0995 else f"{100 * share:.0f} %"


def number(value: Any, unit: str, validity: str, interval: Interval | None = None) -> dict[str, Any]:
    """One number of an answer as the interface writes it; what is not finite becomes null.

    Ends of an interval that is open are null too, and "reason" says why.
    """
    finite = value is not None and bool(np.isfinite(value))
    out: dict[str, Any] = {
        "value": float(value) if finite else None,
        "unit": unit,
        "interval": [interval.low, interval.high] if finite and interval is not None else None,
        "validity": validity,
    }
    if finite and interval is not None and interval.reason:
        out["reason"] = f"interval open: {interval.reason}"
    return out
