"""The paper's closed forms for a scene, in SI, each beside the nonlinear model's answer and judged by it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.effects import MAIN
from identify.prediction import stability
from identify.prediction.groups import Groups, groups
from identify.prediction.jump import jump
from identify.prediction.spread import Interval
from identify.prediction.steady import FrictionLike, RigLike

Array = NDArray[np.float64]

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


def side_by_side(pairs: Sequence[Contact]) -> Contact:
    """Several pairs (n,) as one whose quantities are arrays (n,), as the closed forms take them."""

    def column(parts: Sequence[Any]) -> SimpleNamespace:
        return SimpleNamespace(**{name: np.array([getattr(one, name) for one in parts]) for name in vars(parts[0])})

    return Contact(column([pair.rig for pair in pairs]), column([pair.friction for pair in pairs]))


def closed_forms(pair: Contact, drive_speed: float, normal_force: float) -> ClosedForms:
    """The closed forms at drive speed [m/s], positive, and normal force [N] (docs/equations.md, sections 4 to 6)."""
    return closed_forms_each([pair], np.array([drive_speed]), np.array([normal_force]))[0]


def closed_forms_each(pairs: Sequence[Contact], drive_speed: Array, normal_force: Array) -> list[ClosedForms]:
    """The closed forms of several pairs (n,), each at its own drive speed and normal force (n,); see `closed_forms`."""
    pair = side_by_side(pairs)
    rig, friction = pair.rig, pair.friction
    g = groups(rig, friction, drive_speed, normal_force)
    cycle = jump(rig, friction, drive_speed, normal_force)
    limit = stability.critical_loading(g.alpha)
    ageing = (np.asarray(friction.D) > 0) & (np.asarray(friction.t_cr) > 0)
    with np.errstate(all="ignore"):
        fall = (friction.mu_s - friction.mu_k0) * normal_force / np.sqrt(rig.mass * rig.stiffness)
        columns = {
            "drop": cycle.drop,
            "period": cycle.period,
            "slip_duration": cycle.slip_duration,
            "peak_speed": cycle.peak_speed,
            "saturation": cycle.saturation,
            "critical_speed": np.where(np.isnan(limit), np.nan, np.where(limit > 0, fall / limit, np.inf)),
            "friction_parameter": g.Pi,
            "critical_friction": np.where(ageing, stability.critical_friction(g.z / 2, g.tau_cr), np.nan),
            "critical_friction_printed": np.where(
                ageing, stability.critical_friction(g.zeta, g.tau_cr, form="printed"), np.nan
            ),
            "critical_frequency": np.where(ageing, stability.critical_frequency(g.z / 2, g.tau_cr), np.nan),
        }
    return [
        ClosedForms(
            groups=Groups(**{name: float(column[i]) for name, column in asdict(g).items()}),
            status=str(cycle.status[i]),
            worn=bool(not ageing[i] or g.v_acr[i] > 1),
            **{name: float(column[i]) for name, column in columns.items()},
        )
        for i in range(len(pairs))
    ]


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

    Ends of an interval that is open are null too, and "reason" says why; "interval_from" is "draws" where the interval
    is that of draws.
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
    if finite and interval is not None and interval.drawn:
        out["interval_from"] = "draws"
    return out
