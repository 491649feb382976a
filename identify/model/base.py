"""What every model has: its first parameters and states, its inputs, and where they stand."""

from __future__ import annotations

from typing import Literal

from identify.effects.quantities import Parameter, State

# What every model has: the spring of the rig and Coulomb friction.
BASE_PARAMETERS = (
    Parameter("mu_s", "", 1e-3, 20.0, 0.6, "μs", "static friction coefficient of a saturated contact", "linear", 0.1),
    Parameter("mu_k0", "", 1e-4, 20.0, 0.45, "μk0", "kinetic friction coefficient at slow sliding", "linear", 0.1),
    Parameter(
        "stiffness", "N/m", 1e-2, 1e9, 1470.0, "k", "stiffness of the rig along the drive", spread=0.05, kind="rig"
    ),
)
BASE_STATES = (State("elongation", "m", 0.0), State("sliding_speed", "m/s", 0.0))
RIG_PARAMETERS = ("mass", "stiffness", "damping")
FRICTION_PARAMETERS = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
INPUTS = ("drive_speed", "normal_force", "direction", "time")
ELONGATION, SPEED = 0, 1  # among the states
TIME = 3  # among the inputs
ForceSensorPlace = Literal["drive", "counterface"]
FORCE_SENSORS: tuple[ForceSensorPlace, ...] = ("drive", "counterface")
