"""One cycle of the paper's closed forms in SI, for a rig and a friction law (eqs. 8-18).

The linearised slip (docs/equations.md, sections 1 and 4) from the exact breakaway (damper force included), from a stick
that saturates the contact only as far as it lasts. Exact in its own right; of use where a V_max << 1 (`Jump.validity`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from identify.base.dual import Dual, lifted, plain, variables
from identify.prediction import amplitude
from identify.prediction.groups import formed, settings
from identify.prediction.steady import QUANTITIES, FrictionLike, RigLike

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
