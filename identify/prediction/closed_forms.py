"""The paper's closed forms of a jump in SI, and beside the nonlinear model: values, validity, derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.effects import MAIN
from identify.prediction import amplitude, stability
from identify.prediction.groups import QUANTITIES, FrictionLike, Groups, RigLike, floated, formed, settings

# ----------------------------------------------------------------------------------------------------------------------
# One cycle of the paper's closed forms in SI, for a rig and a friction law (eqs. 8-18).
#
# The linearised slip (docs/equations.md, sections 1 and 4) from the exact breakaway (damper force included), from a
# stick that saturates the contact only as far as it lasts. Exact in its own right; of use where a V_max << 1
# (`Jump.validity`).
# ----------------------------------------------------------------------------------------------------------------------

SATURATED = 38.0  # creep times after which a contact is saturated to the last digit
ROUNDS = 60  # of Newton's method for the saturation
CLOSE, NOISE = 1e-14, 1e-6  # of the saturation, relative: ample; below it steps may stop shrinking
Numbers = float | NDArray[np.float64]


@dataclass(frozen=True)
class Jump:
    """A cycle, SI; floats, or arrays as broadcast; NaN where it does not repeat.

    status: "restick", "steady" (slides on), "no_slip", "runaway" (alpha <= -1), "undefined"; drop of the force the load
    cell sees; frequency 1/period; share_in_slip of the period; amplitude: largest elongation over the equilibrium of
    the slip (eq. 16); largest_force: of the spring; onset_force and arrest_force: of spring and damper;
    saturation of the contact at the onset; validity: a V_max, to be far below 1.
    """

    status: str | NDArray[np.str_]
    drop: Annotated[Numbers, "N"]
    period: Annotated[Numbers, "s"]
    stick_duration: Annotated[Numbers, "s"]
    slip_duration: Annotated[Numbers, "s"]
    slip_distance: Annotated[Numbers, "m"]
    peak_speed: Annotated[Numbers, "m/s"]
    frequency: Annotated[Numbers, "Hz"]
    share_in_slip: Annotated[Numbers, ""]
    amplitude: Annotated[Numbers, "m"]
    largest_force: Annotated[Numbers, "N"]
    onset_force: Annotated[Numbers, "N"]
    arrest_force: Annotated[Numbers, "N"]
    saturation: Annotated[Numbers, ""]
    validity: Annotated[Numbers, ""]


_HINTS = get_type_hints(Jump, include_extras=True)
UNITS = {name: hint.__metadata__[0] for name, hint in _HINTS.items() if name != "status"}  # of the numbers of a jump


def saturations(alpha: ArrayLike, loading: ArrayLike, tau_cr: ArrayLike) -> Any:
    """Saturation s of the contact at the onset of slip in a cycle that repeats, shape as broadcast; NaN without one.

    s = 1 - exp(-drop/tau_cr), the drop being that of a slip with the loading s Phi; the largest such s.

    Args:
        alpha: effective damping ratio. loading: Phi of a saturated contact. tau_cr: creep time; 0: saturated at once.
    """
    shape = np.broadcast_shapes(*(np.shape(q) for q in (alpha, loading, tau_cr)))
    a, phi, T = (np.ravel(np.asarray(q, float)) for q in np.broadcast_arrays(alpha, loading, tau_cr))
    share, before = np.ones(a.shape), np.full(a.shape, np.inf)
    with np.errstate(all="ignore"):
        left = np.flatnonzero((T > 0) & (phi < SATURATED * T))  # the drop is at least Phi
        for _ in range(ROUNDS):
            if not left.size:
                break
            x, p, t = share[left], phi[left], T[left]
            drop, slope = amplitude.drop_of(a[left], x * p - 2 * a[left])
            rest = np.exp(-drop / t)
            rise = rest / t * slope * p
            # 1 - exp(-drop/t) rises ever more slowly with x: where it is steeper than x, no root is left below.
            step = np.where(rise < 1, (x - 1 + rest) / (1 - rise), np.nan)
            share[left] = np.minimum(x - step, 1.0)
            size = np.abs(step)
            # Done, or at the noise of the drop: there steps no longer shrink.
            done = (size <= CLOSE * x) | ((size < NOISE * x) & (size > 0.7 * before[left]))
            before[left] = size
            left = left[~done & np.isfinite(size)]
        share[left] = np.nan
    return share.reshape(shape)[()]


def jump(rig: RigLike, friction: FrictionLike, drive_speed: ArrayLike, normal_force: ArrayLike) -> Jump:
    """The cycle of the closed forms at operating points.

    Args:
        rig: mass [kg], stiffness [N/m], damping h [N/m].
        friction: mu_s, mu_k0, delta_mu_k, a [s/m], D [m], t_cr [s]; t_cr = 0: the contact saturates at once.
        drive_speed: [m/s], sign irrelevant. normal_force: [N]. All of these broadcast.
    """
    with np.errstate(all="ignore"):
        status, columns = _cycle(settings(rig, friction, drive_speed, normal_force))
        return Jump(status, **{name: floated(column) for name, column in columns.items()})


def _cycle(q: Mapping[str, object]) -> tuple[Any, dict[str, Any]]:
    """Status, and the columns of UNITS of `settings`."""
    g = formed(q)
    share = saturations(g["alpha"], g["loading"], g["tau_cr"])
    alpha, overshoot = g["alpha"], share * g["loading"] - 2 * g["alpha"]
    slip = amplitude.slip(alpha, overshoot)
    none = np.where(slip.status == "restick", 0.0, np.nan)
    height = amplitude.slip_maximum(alpha, overshoot)[1] + none
    length, time = q["drive_speed"] / g["omega_n"], 1 / g["omega_n"]
    middle = g["xi_o"] * length * q["stiffness"]
    drop, period = slip.drop * length * q["stiffness"], slip.period * time
    damper = 2 * g["zeta"] * length * q["stiffness"]  # c v0, which the load cell sees while the mass is at rest
    onset = overshoot * length * q["stiffness"] + middle + damper
    columns = {
        "drop": drop,
        "period": period,
        "stick_duration": slip.drop * time,
        "slip_duration": slip.duration * time,
        "slip_distance": period * q["drive_speed"],
        "peak_speed": slip.peak_speed * q["drive_speed"],
        "frequency": 1 / period,
        "share_in_slip": slip.share_in_slip,
        "amplitude": height * length,
        "largest_force": height * length * q["stiffness"] + middle,
        "onset_force": onset + none,
        "arrest_force": onset - drop,
        "saturation": share + none,
        "validity": q["a"] * slip.peak_speed * q["drive_speed"],
    }
    return _told_status(slip.status, share, g["alpha"], g["loading"]), columns


def _told_status(status: Any, share: Any, alpha: Any, loading: Any) -> Any:
    """The status, also where no saturation was found: a cycle that only a saturated contact can begin slides on."""
    lost = np.isnan(share)
    if not np.any(lost):
        return status
    a, phi = (np.broadcast_to(q, np.shape(share))[lost] for q in (alpha, loading))
    saturated = amplitude.slip_status(a, phi - 2 * a)
    told = np.array(status)
    told[lost] = np.where(saturated == "restick", "steady", saturated)
    return told[()]


# ----------------------------------------------------------------------------------------------------------------------
# The paper's closed forms for a scene, in SI, each beside the nonlinear model's answer and judged by it.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

AGREES = 0.05  # relative difference up to which a closed form is called valid at an operating point
KNOWN = (*MAIN, "driven_damping", "linear_weakening", "varying_normal_force")  # effects, at one operating point
SLOW = 1e-6  # s/m, of a weakening that no slip gets to the end of
CYCLE = ("drop", "period", "slip_duration", "peak_speed")


def beyond(effects: Sequence[str]) -> tuple[str, ...]:
    """The effects of which the closed forms know nothing."""
    return tuple(name for name in effects if name not in KNOWN)


def known_settings(values: Mapping[str, Any]) -> dict[str, Any]:
    """What the closed forms take (QUANTITIES) of named values [SI] of a model's parameters, "drive_speed" and
    "normal_force"; what is absent is null (no damping, ageing, weakening). Arrays of one shape, or floats.

    A damping at a frequency of its own is the h that gives the same damper at the natural frequency; weakening in
    proportion to speed is the start of an exponential one that is very slow.
    """
    q = {name: values.get(name, 0.0) for name in QUANTITIES}
    if "damping_frequency" in values:
        q["damping"] = q["damping"] * np.sqrt(q["stiffness"] / q["mass"]) / (2 * np.pi * values["damping_frequency"])
    if "slope" in values:
        q |= {"delta_mu_k": values["slope"] / SLOW, "a": SLOW}
    return dict(zip(q, (np.asarray(value, float)[()] for value in np.broadcast_arrays(*q.values())), strict=True))


@dataclass(frozen=True)
class ClosedForms:
    """The closed forms at one operating point, SI, NaN where they have no answer; `status` says why.

    status: "restick", "steady", "no_slip", "runaway" (of the linearised slip). numbers: "drop", "period",
    "slip_duration", "peak_speed"; "critical_speed" [m/s], below which that slip sticks again; "Pi" and its critical
    value "Pi_fc" decide whether steady sliding is stable (below: stable), "Pi_fc_printed" by the printed eq. (25);
    "Omega_c". worn: the contact does not age in steady sliding.
    """

    groups: Groups
    status: str
    worn: bool
    numbers: Mapping[str, float]


def closed_forms(values: Mapping[str, float]) -> ClosedForms:
    """The closed forms of named values [SI] (docs/equations.md, sections 4 to 6), as for `known_settings`."""
    q = known_settings(values)
    status, numbers, g = _evaluated(q)
    return ClosedForms(
        groups=Groups(**{name: float(value) for name, value in g.items()}),
        status=str(status),
        worn=bool(not (q["D"] > 0 and q["t_cr"] > 0) or g["v_acr"] > 1),
        numbers={name: float(value) for name, value in numbers.items()},
    )


def forms_of_rows(values: Mapping[str, Any]) -> dict[str, Array]:
    """Numbers (n,) of `closed_forms` and of the groups, of many named values [SI], arrays (n,)."""
    _, numbers, g = _evaluated(known_settings(values))
    shape = np.shape(values["drive_speed"])
    return {name: np.broadcast_to(np.asarray(value, float), shape) for name, value in {**g, **numbers}.items()}


def _evaluated(q: Mapping[str, Any]) -> tuple[Any, dict[str, Any], dict[str, Any]]:
    """Status, numbers and groups of `settings`."""
    with np.errstate(all="ignore"):
        g, (status, cycle) = formed(q), _cycle(q)
        ageing = (q["D"] > 0) & (q["t_cr"] > 0)
        limit = stability.critical_loading(g["alpha"])
        fall = (q["mu_s"] - q["mu_k0"]) * q["normal_force"] / np.sqrt(q["mass"] * q["stiffness"])
        local = {
            "Pi_fc": stability.critical_friction(g["z"] / 2, g["tau_cr"]),
            "Pi_fc_printed": stability.critical_friction(g["zeta"], g["tau_cr"], form="printed"),
            "Omega_c": stability.critical_frequency(g["z"] / 2, g["tau_cr"]),
        }
        numbers = {
            **{name: cycle[name] for name in CYCLE},
            "critical_speed": np.where(np.isnan(limit), np.nan, np.where(limit > 0, fall / limit, np.inf)),
            "Pi": g["Pi"],
            **{name: np.where(ageing, value, np.nan) for name, value in local.items()},
        }
    return status, numbers, g


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
