"""Dimensionless groups of a rig and a friction law at one drive speed and normal force (EQUATIONS section 1)."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from identify.steady import FrictionLike, RigLike

MEANING = {
    "omega_n": ("rad/s", "natural frequency of the mass on the spring"),
    "zeta": ("", "damping ratio h/2k"),
    "w": ("", "dimensionless load F_n / (v0 sqrt(m k))"),
    "tau_cr": ("", "creep time in units of 1/omega_n"),
    "v_cr": ("m/s", "speed D/t_cr above which sliding wears off all contact ageing"),
    "v_acr": ("", "drive speed over v_cr"),
    "gamma_0": ("", "saturation of the contact in steady sliding"),
    "v_a": ("", "drive speed in units of the speed over which kinetic friction changes"),
    "alpha": ("", "effective damping ratio of the linearised slip; at -1 and below that law runs away"),
    "xi_o": ("", "equilibrium elongation of the linearised slip"),
    "xi_p": ("", "elongation at the onset of slip, damper force included"),
    "xi_p_printed": ("", "elongation at the onset of slip as printed, eq. (12)"),
    "overshoot": ("", "A = xi_p - xi_o"),
    "loading": ("", "loading parameter Phi = 2 alpha + A; stick-slip repeats above Phi_cr(alpha)"),
    "z": ("", "damping of steady sliding with the slope of friction; 2 zeta without it"),
    "Pi": ("", "friction parameter of steady sliding; unstable above Pi_fc"),
}


@dataclass(frozen=True)
class Groups:
    """The groups; units and meanings stand in MEANING. NaN where a rig at rest (v0 = 0) has none."""

    omega_n: float
    zeta: float
    w: float
    tau_cr: float
    v_cr: float
    v_acr: float
    gamma_0: float
    v_a: float
    alpha: float
    xi_o: float
    xi_p: float
    xi_p_printed: float
    overshoot: float
    loading: float
    z: float
    Pi: float

    def sentences(self) -> tuple[str, ...]:
        """One plain sentence per group."""
        return tuple(
            f"{f.name} = {getattr(self, f.name):.4g}{' ' * bool(MEANING[f.name][0])}{MEANING[f.name][0]}: "
            f"{MEANING[f.name][1]}."
            for f in fields(self)
        )


def groups(rig: RigLike, friction: FrictionLike, drive_speed: float, normal_force: float) -> Groups:
    """The dimensionless groups of one operating point.

    Args:
        rig: mass [kg], stiffness [N/m], damping h [N/m].
        friction: mu_s, mu_k0, delta_mu_k, a [s/m], D [m], t_cr [s]; D = 0 means no contact ageing.
        drive_speed: [m/s], sign irrelevant. normal_force: [N].
    """
    v, impedance = np.float64(abs(drive_speed)), np.sqrt(rig.mass * rig.stiffness)
    with np.errstate(all="ignore"):
        omega, zeta = np.sqrt(rig.stiffness / rig.mass), rig.damping / (2 * rig.stiffness)
        w, v_a = normal_force / (v * impedance), friction.a * v
        v_cr = np.float64(friction.D) / friction.t_cr if friction.D > 0 else np.float64(0.0)
        v_acr = v / v_cr if v_cr > 0 else np.float64(np.inf)
        gamma_0 = max(0.0, 1 - v_acr)
        force = normal_force / impedance  # w v0: the groups below hardly know the drive speed
        slope = friction.delta_mu_k * friction.a * force
        step = friction.mu_s - friction.mu_k0
        loading = step * w
        alpha = zeta + slope / 2
        weakened = step + friction.delta_mu_k * np.expm1(-v_a)
    return Groups(
        omega_n=float(omega),
        zeta=float(zeta),
        w=float(w),
        tau_cr=float(omega * friction.t_cr),
        v_cr=float(v_cr),
        v_acr=float(v_acr),
        gamma_0=float(gamma_0),
        v_a=float(v_a),
        alpha=float(alpha),
        xi_o=float((friction.mu_k0 + friction.delta_mu_k * v_a) * w),
        xi_p=float(friction.mu_s * w - 2 * zeta),
        xi_p_printed=float(friction.mu_s * w),
        overshoot=float(loading - 2 * alpha),
        loading=float(loading),
        z=float(2 * zeta + slope * np.exp(-v_a) * (1 - gamma_0)),
        Pi=float(force * weakened / v_cr) if v_cr > 0 else float("nan"),
    )
