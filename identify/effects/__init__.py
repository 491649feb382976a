"""The table of effects. A new effect is one file here and one line in ALL."""

import sys

from identify.effects.contact import ContactAgeing, FrictionHeterogeneity, Occlusion
from identify.effects.excitation import Excitation, FingerMotion
from identify.effects.load import LoadDependence, PressureDependence, VaryingNormalForce
from identify.effects.quantities import Effect
from identify.effects.rig import DrivenDamping, HysteresisDamping, Inertia, SkinCompliance
from identify.effects.sensor import ForceSensor, SensorLag, SensorSecondLag
from identify.effects.velocity import DirectEffect, LinearWeakening, PowerLaw, VelocityWeakening

ALL: tuple[Effect, ...] = (
    Inertia(),
    HysteresisDamping(),
    DrivenDamping(),
    ContactAgeing(),
    VelocityWeakening(),
    LinearWeakening(),
    PowerLaw(),
    DirectEffect(),
    LoadDependence(),
    PressureDependence(),
    VaryingNormalForce(),
    Occlusion(),
    FrictionHeterogeneity(),
    Excitation(),
    FingerMotion(),
    SkinCompliance(),
    ForceSensor(),
    SensorLag(),
    SensorSecondLag(),
)
"""All of them, in the order of the table."""
NAMES: tuple[str, ...] = tuple(effect.name for effect in ALL)
MAIN: tuple[str, ...] = ("inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening")
"""The effects of the paper's model (eqs. 1-6)."""


def register(effect: Effect) -> None:
    """Add an effect that is defined outside the package to the table, for this process.

    It has to come first: every other room takes the table as it is when it is imported.

    Args:
        effect: its name, parameters, states and ports; units and shapes as `Effect` says.

    Raises:
        SceneError: the name is taken, or a model was composed from the table already.
    """
    from identify.base.errors import SceneError

    global ALL, NAMES
    if effect.name in NAMES:
        raise SceneError(f"an effect called {effect.name!r} is in the table already; give the new one another name")
    if "identify.model.model" in sys.modules:
        raise SceneError(
            f"the effect {effect.name!r} comes too late: the table is in use; call identify.effects.register before "
            "anything else of identify is imported or used"
        )
    ALL = (*ALL, effect)
    NAMES = tuple(each.name for each in ALL)
