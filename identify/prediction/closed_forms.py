"""The paper's closed forms of a jump in SI, and beside the nonlinear model: values, validity, derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.dual import Dual, lifted, plain, sqrt, variables
from identify.effects import MAIN
from identify.prediction import amplitude, stability
from identify.prediction.groups import Groups, formed, groups, settings
from identify.prediction.intervals import Interval
from identify.prediction.stability import QUANTITIES, FrictionLike, RigLike

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
UNITS = {
    "drop": "N",
    "period": "s",
    "stick_duration": "s",
    "slip_duration": "s",
    "slip_distance": "m",
    "peak_speed": "m/s",
    "frequency": "Hz",
    "share_in_slip": "",
    "amplitude": "m",
    "largest_force": "N",
    "onset_force": "N",
    "arrest_force": "N",
    "saturation": "",
    "validity": "",
}  # what is said of a jump, and its unit


@dataclass(frozen=True)
class Jump:
    """A cycle, SI; floats, or arrays as broadcast; NaN where it does not repeat.

    status: "restick", "steady" (slides on), "no_slip", "runaway" (alpha <= -1), "undefined"; drop of the force the load
    cell sees; frequency 1/period; share_in_slip of the period; amplitude: largest elongation over the equilibrium of
    the slip (eq. 16); largest_force: of the spring; onset_force and arrest_force: of spring and damper;
    saturation of the contact at the onset; validity: a V_max, to be far below 1.
    """

    status: Any
    drop: Any
    period: Any
    stick_duration: Any
    slip_duration: Any
    slip_distance: Any
    peak_speed: Any
    frequency: Any
    share_in_slip: Any
    amplitude: Any
    largest_force: Any
    onset_force: Any
    arrest_force: Any
    saturation: Any
    validity: Any


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


def jump(
    rig: RigLike,
    friction: FrictionLike,
    drive_speed: ArrayLike,
    normal_force: ArrayLike,
    *,
    derivatives: bool = False,
) -> Any:
    """The cycle of the closed forms at operating points.

    Args:
        rig: mass [kg], stiffness [N/m], damping h [N/m].
        friction: mu_s, mu_k0, delta_mu_k, a [s/m], D [m], t_cr [s]; t_cr = 0: the contact saturates at once.
        drive_speed: [m/s], sign irrelevant. normal_force: [N]. All of these broadcast.
        derivatives: also return {column: {quantity: exact derivative}} over UNITS and `steady.QUANTITIES` (SI).
    """
    q = settings(rig, friction, drive_speed, normal_force)
    with np.errstate(all="ignore"):
        status, columns = _columns(q)
        values = Jump(status, **{name: _told(column) for name, column in columns.items()})
        if not derivatives:
            return values
        _, duals = _columns(variables(q))
        table = {
            name: {k: _told(np.broadcast_to(dual.slopes.get(k, 0.0), np.shape(dual.value))) for k in QUANTITIES}
            for name, dual in duals.items()
            if isinstance(dual, Dual)
        }
    return values, table


def _columns(q: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Status, and the columns of UNITS of `settings` or of their `dual.variables`."""
    g = formed(q)
    share = _lifted_saturation(g["alpha"], g["loading"], g["tau_cr"])
    alpha, overshoot = g["alpha"], share * g["loading"] - 2 * g["alpha"]
    status, slip = _lifted_slip(alpha, overshoot)
    reached = status == "restick"
    height = _lifted_height(alpha, overshoot, reached)
    length, time = q["drive_speed"] / g["omega_n"], 1 / g["omega_n"]
    middle = g["xi_o"] * length * q["stiffness"]
    drop, period = slip["drop"] * length * q["stiffness"], slip["period"] * time
    damper = 2 * g["zeta"] * length * q["stiffness"]  # c v0, which the load cell sees while the mass is at rest
    onset = overshoot * length * q["stiffness"] + middle + damper
    none = np.where(reached, 0.0, np.nan)
    columns = {
        "drop": drop,
        "period": period,
        "stick_duration": slip["drop"] * time,
        "slip_duration": slip["duration"] * time,
        "slip_distance": period * q["drive_speed"],
        "peak_speed": slip["peak_speed"] * q["drive_speed"],
        "frequency": 1 / period,
        "share_in_slip": slip["duration"] / slip["period"],
        "amplitude": height * length,
        "largest_force": height * length * q["stiffness"] + middle,
        "onset_force": onset + none,
        "arrest_force": onset - drop,
        "saturation": share + none,
        "validity": q["a"] * slip["peak_speed"] * q["drive_speed"],
    }
    return _told_status(status, plain(share), plain(g["alpha"]), plain(g["loading"])), columns


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


def _lifted_saturation(alpha: Any, loading: Any, tau_cr: Any) -> Any:
    a, phi, T = plain(alpha), plain(loading), plain(tau_cr)
    share = saturations(a, phi, T)
    if not isinstance(alpha, Dual):
        return share
    # s = 1 - exp(-drop(alpha, s Phi - 2 alpha)/T), differentiated.
    slip, by = amplitude.slip(a, share * phi - 2 * a, derivatives=True)
    reach = np.where(T > 0, np.exp(-slip.drop / T) / T, 0.0)
    whole = 1 - reach * by["overshoot"]["drop"] * phi
    parts = (
        (alpha, reach * (by["alpha"]["drop"] - 2 * by["overshoot"]["drop"]) / whole),
        (loading, reach * by["overshoot"]["drop"] * share / whole),
        (tau_cr, -reach * np.where(T > 0, slip.drop / T, 0.0) / whole),
    )
    return lifted(share, parts)


def _lifted_slip(alpha: Any, overshoot: Any) -> tuple[Any, dict[str, Any]]:
    """Status, and the dimensionless columns of the slip by name."""
    if not isinstance(alpha, Dual):
        slip = amplitude.slip(alpha, overshoot)
        return slip.status, {name: getattr(slip, name) for name in amplitude.COLUMNS}
    slip, by = amplitude.slip(plain(alpha), plain(overshoot), derivatives=True)
    columns = {
        name: lifted(getattr(slip, name), [(alpha, by["alpha"][name]), (overshoot, by["overshoot"][name])])
        for name in amplitude.COLUMNS
    }
    return slip.status, columns


def _lifted_height(alpha: Any, overshoot: Any, reached: Any) -> Any:
    """The amplitude of eq. (16), NaN where the cycle does not repeat."""
    none = np.where(reached, 0.0, np.nan)
    if not isinstance(alpha, Dual):
        return amplitude.slip_maximum(alpha, overshoot)[1] + none
    (_, height), by = amplitude.slip_maximum(plain(alpha), plain(overshoot), derivatives=True)
    return lifted(height, [(alpha, by["alpha"][1]), (overshoot, by["overshoot"][1])]) + none


def _told(value: Any) -> Any:
    return float(value) if np.ndim(value) == 0 else value


# ----------------------------------------------------------------------------------------------------------------------
# The paper's closed forms for a scene, in SI, each beside the nonlinear model's answer and judged by it.
# ----------------------------------------------------------------------------------------------------------------------

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


# ----------------------------------------------------------------------------------------------------------------------
# Exact derivatives of every number of the closed forms at operating points, by rig, pair, speed and load.
# ----------------------------------------------------------------------------------------------------------------------

CYCLE = ("drop", "period", "slip_duration", "peak_speed")
Table = dict[str, dict[str, float]]


def form_slopes(pairs: Sequence[Contact], drive_speed: Array, normal_force: Array) -> list[tuple[Table, Table]]:
    """For every pair (n,) at its drive speed and normal force (n,): (closed forms, groups), {name: {quantity:
    derivative}} over `steady.QUANTITIES`, SI; a quantity that is absent moves nothing. Names as in a prediction."""
    pair = side_by_side(pairs)
    q = variables(settings(pair.rig, pair.friction, drive_speed, normal_force))
    with np.errstate(all="ignore"):
        g = formed(q)
        cycle = jump(pair.rig, pair.friction, drive_speed, normal_force, derivatives=True)[1]
        limit, table = stability.critical_loading(plain(g["alpha"]), derivatives=True)
        fall = (q["mu_s"] - q["mu_k0"]) * q["normal_force"] / sqrt(q["mass"] * q["stiffness"])
        forms: dict[str, Any] = {
            "critical_speed": fall / lifted(limit, [(g["alpha"], table["alpha"])]),
            "Pi": g["Pi"],
            "Pi_fc": _stability(stability.critical_friction, g["z"] / 2, g["tau_cr"]),
            "Pi_fc_printed": _stability(stability.critical_friction, g["zeta"], g["tau_cr"], "printed"),
            "Omega_c": _stability(stability.critical_frequency, g["z"] / 2, g["tau_cr"]),
        }
    slopes = {name: cycle[name] for name in CYCLE} | {name: _slopes(value) for name, value in forms.items()}
    by_group = {name: _slopes(value) for name, value in g.items()}
    return [(_at(slopes, i), _at(by_group, i)) for i in range(len(pairs))]


def _stability(function: Any, zeta: Any, tau_cr: Any, form: str = "derived") -> Any:
    value, table = function(plain(zeta), plain(tau_cr), form, derivatives=True)
    return lifted(value, [(zeta, table["zeta"]), (tau_cr, table["tau_cr"])])


def _slopes(value: Any) -> Mapping[str, Any]:
    return value.slopes if isinstance(value, Dual) else {}


def _at(columns: Mapping[str, Mapping[str, Any]], i: int) -> Table:
    """The derivatives (n,) of every name at one of the points."""
    return {name: {q: float(slope[i]) for q, slope in table.items()} for name, table in columns.items()}
