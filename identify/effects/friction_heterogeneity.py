"""Friction heterogeneity: the level is a random field along the track, strength and loading rate differ per stick."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace

import casadi as ca
import numpy as np

from identify.effects.quantities import Effect, Expression, Importance, Parameter, Situation, State, Terms

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
