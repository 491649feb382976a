"""The table of effects. A new effect is one file here and one line in FILES."""

from importlib import import_module

from identify.quantities import Effect

FILES = """
inertia
hysteresis_damping
driven_damping
contact_ageing
velocity_weakening
linear_weakening
power_law
direct_effect
load_dependence
pressure_dependence
varying_normal_force
occlusion
friction_heterogeneity
excitation
finger_motion
skin_compliance
force_sensor
sensor_lag
sensor_second_lag
""".split()


def _effect(name: str) -> Effect:
    """What the file `name` holds: the class of that name (skin_compliance: SkinCompliance)."""
    found = getattr(import_module(f"identify.effects.{name}"), name.title().replace("_", ""))()
    if not isinstance(found, Effect) or found.name != name:
        raise TypeError(f"identify/effects/{name}.py holds {found!r}; expected an effect whose name is {name!r}")
    return found


ALL: tuple[Effect, ...] = tuple(_effect(name) for name in FILES)
"""All of them, in the order of the table."""
NAMES: tuple[str, ...] = tuple(FILES)
MAIN: tuple[str, ...] = ("inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening")
"""The effects of the paper's model (eqs. 1-6)."""
