"""Why each effect stays or goes, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from identify.diagnosis.choice import EffectReason, Screen, price
from identify.effects import ALL

UNASKED = {
    "driven_damping": "a damping at a given frequency acts like the one at the natural frequency: list it by name",
    "power_law": "a law measured on wet smooth glass: list it by name",
    "pressure_dependence": "the same as load_dependence where only the load varies: list it by name",
    "force_sensor": "gain and offset of the load cell cannot be told from friction: calibrate, then list it by name",
    "sensor_second_lag": "a second stage of the load cell: list it by name",
    "friction_heterogeneity": "cycles that differ are described by the simulation, not by the fit",
}


@dataclass(frozen=True)
class Gain:
    """What an effect gains on the data: likelihood-ratio statistic, penalty of its parameters, growth of the error on
    kept-back cycles without it."""

    statistic: float
    penalty: float
    held_out: float


def reasons(
    effects: Sequence[str],
    always: Sequence[str],
    looks: Sequence[Screen],
    gains: Mapping[str, Gain],
    notes: Mapping[str, str],
) -> list[EffectReason]:
    """One reason per effect, in the order of their table; notes take the place of what the looks and gains say."""
    by_name = {look.effect: look for look in looks}
    out = []
    for name in (effect.name for effect in ALL):
        stays, cost = name in effects, price(name, effects)
        if name in always:
            out.append(EffectReason(name, True, "the equation of motion of a stick-slip record needs it", cost=cost))
        elif name in notes:
            out.append(EffectReason(name, stays, notes[name], cost=cost))
        elif name in by_name and by_name[name].asked:
            gain = gains.get(name)
            said = f"{by_name[name].sentence}; {_said(gain, stays)}"
            statistic = None if gain is None or not np.isfinite(gain.statistic) else gain.statistic
            held = None if gain is None or not np.isfinite(gain.held_out) else gain.held_out
            out.append(EffectReason(name, stays, said, cost=cost, statistic=statistic, held_out=held))
        elif name in by_name:
            out.append(EffectReason(name, stays, by_name[name].sentence, cost=cost))
        else:
            out.append(EffectReason(name, stays, UNASKED.get(name, "a law that nothing calls for"), cost=cost))
    return out


def _said(gain: Gain | None, stays: bool) -> str:
    if gain is None:
        return "it was tried"
    if not np.isfinite(gain.statistic):
        return "without it no start describes the data" if stays else "it gains nothing"
    verdict = "worth" if stays else "not worth"
    said = (
        f"the fit gains {max(gain.statistic, 0.0):.3g} where its parameters ask for {gain.penalty:.3g}: {verdict} them"
    )
    if np.isfinite(gain.held_out):
        said += f"; without it cycles kept back are predicted with {gain.held_out:.3g} times the error"
    return said
