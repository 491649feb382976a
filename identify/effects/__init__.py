"""The table of effects. A new effect is one file here and one line in ALL."""

from identify.effects.contact_ageing import ContactAgeing
from identify.effects.hysteresis_damping import HysteresisDamping
from identify.effects.inertia import Inertia
from identify.effects.velocity_weakening import VelocityWeakening
from identify.quantities import Effect

ALL: tuple[Effect, ...] = (
    Inertia(),
    HysteresisDamping(),
    ContactAgeing(),
    VelocityWeakening(),
)
NAMES: tuple[str, ...] = tuple(effect.name for effect in ALL)
