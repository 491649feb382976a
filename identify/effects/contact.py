"""The contact: it strengthens at rest, moistens, and differs from place to place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import SimpleNamespace

import casadi as ca
import numpy as np

from identify.base.wording import three_figures
from identify.effects.quantities import (
    Effect,
    Expression,
    Importance,
    Parameter,
    Situation,
    State,
    Terms,
    fall,
    stick_time,
)


class ContactAgeing(Effect):
    """State gamma: gamma' = (1 - gamma)/t_cr - |x'|/D, held within 0 and 1 (eq. 2, drive frame)."""

    name = "contact_ageing"
    says = "the contact strengthens while it rests and is renewed by sliding"
    source = "eqs. (2)-(5)"
    parameters = (
        Parameter("D", "m", 1e-8, 1e-1, 40e-6, "D", "relaxation length: sliding that renews the contact"),
        Parameter("t_cr", "s", 1e-5, 1e5, 0.5, "t_cr", "creep time: rest that saturates the contact"),
    )
    states = (State("gamma", "", start=0.0, lower=0.0, upper=1.0),)
    null = {"D": 0.0, "t_cr": 0.0}  # a limit: plain static and kinetic friction, D/t_cr vanishing too

    def terms(self, s: Situation) -> Terms:
        """Strengthening gamma and its rate."""
        gamma = s.x.gamma
        return Terms(strengthening=gamma, rates={"gamma": s.pace * (1 - gamma) / s.p.t_cr - s.v / s.p.D})

    def at_rest(self, s: Situation, aged: Expression) -> Mapping[str, Expression]:
        """Eq. (3a) from any start: 1 - (1 - gamma) exp(-t/t_cr)."""
        return {"gamma": s.x.gamma - (1 - s.x.gamma) * ca.expm1(-aged / s.p.t_cr)}

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """Relaxation length against the travel of the spring in a slip, and creep time against the stick."""
        travel = fall(p, normal_force) / p["stiffness"]
        rest = stick_time(p, normal_force, drive_speed)
        regained = -math.expm1(-rest / p["t_cr"])
        return Importance(
            "D k/((μs − μk0) F_n)",
            p["D"] / travel,
            f"sliding by {1e6 * p['D']:.3g} µm renews the contact, {p['D'] / travel:.2g} of the spring's travel; "
            f"a stick of about {three_figures(rest)} s regains {three_figures(100 * regained)} % of the strength",
        )


class Occlusion(Effect):
    """With the share e(t) = 1 - exp(-t/t_occ): all friction times exp(level e), contact ageing 1 + hastening e as fast.

    A drift in time, not along the track. t counts from the start of the record.
    """

    name = "occlusion"
    says = "friction level and ageing drift in time as the skin moistens"
    source = "occlusion of skin by a closed contact within tens of seconds; first-order approach"
    parameters = (
        Parameter(
            "occlusion_level",
            "",
            -3.0,
            3.0,
            0.1,
            "λ_occ",
            "logarithm of the final change of friction level",
            "linear",
            0.1,
        ),
        Parameter(
            "occlusion_hastening",
            "",
            -0.99,
            20.0,
            0.0,
            "η_occ",
            "final change of the ageing rate",
            "linear",
            0.1,
            "given",
        ),
        Parameter("occlusion_time", "s", 1e-2, 1e6, 30.0, "t_occ", "time in which the skin moistens"),
    )
    null = {"occlusion_level": 0.0, "occlusion_hastening": 0.0}

    def terms(self, s: Situation) -> Terms:
        """The level, and the ageing time gained: the integral of hastening * e."""
        share = -ca.expm1(-s.time / s.p.occlusion_time)
        gained = s.p.occlusion_hastening * (s.time - s.p.occlusion_time * share)
        return Terms(level=s.p.occlusion_level * share, clock=gained)

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """The change of level."""
        share = abs(p["occlusion_level"])
        return Importance("λ_occ", share, f"friction drifts by {100 * share:.3g} % within {p['occlusion_time']:.3g} s")


MODES = 48
SHORTEST = 0.02  # wave lengths shorter than that (of the correlation length) are left out of the field


def _wave_numbers() -> tuple[float, ...]:
    """Wave numbers times the correlation length, one per equal share of the Ornstein-Uhlenbeck spectrum (Cauchy)."""
    highest = 2 * np.pi / SHORTEST
    share = np.arctan(highest) * (np.arange(MODES) + 0.5) / MODES
    return tuple(np.tan(share).tolist())


class FrictionHeterogeneity(Effect):
    """Level: a sum of MODES harmonics of position with the spectrum of an Ornstein-Uhlenbeck field: standard deviation
    field_sd, correlation length field_length (docs/equations.md, section 7). Each stick has its own strength factor
    (lognormal) and its own loading rate. All draws follow from `field_seed`: the same seed is the same track.
    """

    name = "friction_heterogeneity"
    says = "friction level a random field along the track, strength and loading rate scatter per stick"
    source = "docs/equations.md, section 7; random Fourier features of the Ornstein-Uhlenbeck spectrum"
    parameters = (
        Parameter(
            "field_sd",
            "",
            0.0,
            1.0,
            0.02,
            "s_L",
            "standard deviation of the friction level along the track",
            "linear",
            0.01,
            "given",
        ),
        Parameter("field_length", "m", 1e-9, 10.0, 1e-3, "l_L", "correlation length of the level", "log", 0.5, "given"),
        Parameter(
            "strength_sd",
            "",
            0.0,
            2.0,
            0.1,
            "s_S",
            "scatter of ln(strength) from stick to stick",
            "linear",
            0.1,
            "given",
        ),
        Parameter(
            "loading_sd",
            "",
            0.0,
            0.5,
            0.02,
            "s_k",
            "scatter of the loading rate from stick to stick",
            "linear",
            0.05,
            "given",
        ),
        Parameter("field_seed", "", 0.0, 1e6, 1.0, "seed", "which track", "linear", 1.0, "given"),
    )
    states = (State("track", "m", 0.0), State("stick_number", "", 0.0))
    null = {"field_sd": 0.0, "strength_sd": 0.0, "loading_sd": 0.0}

    def terms(self, s: Situation) -> Terms:
        """The field where the mass is, and what this stick was dealt."""
        p = s.p
        # Whole numbers, so that a draw has no derivative.
        seed, stick = ca.floor(p.field_seed + 0.5), ca.floor(s.x.stick_number + 0.5)
        place, field = s.x.track / p.field_length, 0.0
        for i, number in enumerate(_wave_numbers()):
            field = field + ca.cos(number * place + 2 * np.pi * _uniform(seed, i + 0.5))
        spread = np.sqrt(2.0 / MODES)
        return Terms(
            excess=p.field_sd * spread * field,
            strength=p.strength_sd * _normal(seed, stick),
            loading=p.loading_sd * _normal(seed, stick + 1e4),
            rates={"track": s.direction * s.v},
        )

    def finest(self, p: SimpleNamespace) -> Expression:
        """The shortest wave of the field."""
        return ca.if_else(p.field_sd > 0.0, 2 * np.pi / max(_wave_numbers()) * p.field_length, np.inf)

    def at_stick(self, s: Situation) -> Mapping[str, Expression]:
        """The next stick is dealt new factors."""
        return {"stick_number": s.x.stick_number + 1}

    def unfit(self, p: Mapping[str, float]) -> str | None:
        """A fit knows no track."""
        if all(p[name] == value for name, value in self.null.items()):
            return None
        return (
            "the effect friction_heterogeneity draws a track by chance, and nobody knows that of a measured log; take "
            "it out of effects: the report says how unequal the cycles are"
        )

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """The scatter against the fall of friction."""
        share = max(p["field_sd"] / max(abs(p["mu_s"] - p["mu_k0"]), 1e-12), p["strength_sd"], p["loading_sd"])
        return Importance("s_L/(μs − μk0)", share, f"cycles differ by about {100 * share:.3g} %")


def _uniform(seed: Expression, number: Expression) -> Expression:
    """A number in (0, 1) that looks random: the fraction of a large sine."""
    wild = 43758.5453 * ca.sin(12.9898 * number + 78.233 * seed + 0.5)
    return 1e-6 + (1 - 2e-6) * (wild - ca.floor(wild))


def _normal(seed: Expression, number: Expression) -> Expression:
    """A standard normal number that looks random, two uniform ones by Box and Muller."""
    radius = ca.sqrt(-2 * ca.log(_uniform(seed, number)))
    return radius * ca.cos(2 * np.pi * _uniform(seed + 0.37, number + 0.71))
