"""First-order lag of the load cell and its amplifier."""

from __future__ import annotations

import math
from collections.abc import Mapping

from identify.effects.quantities import Effect, Importance, Lag, Parameter, Situation, State, Terms
from identify.effects.typical import slip_time


class SensorLag(Effect):
    """State: the force that is shown, shown' = (force - shown)/lag. Null as the lag goes to zero."""

    name = "sensor_lag"
    says = "first-order lag of the load cell"
    source = "instrument model"
    parameters = (Parameter("lag_time", "s", 1e-6, 10.0, 1e-3, "τ_1", "time constant of the load cell"),)
    states = (State("lagged_force", "N", 0.0),)
    null = {"lag_time": 0.0}  # a limit

    def terms(self, s: Situation) -> Terms:
        """The lag; the model writes its rate."""
        return Terms(lag=Lag("lagged_force", s.p.lag_time))

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """The lag against the natural time of a slip."""
        share = p["lag_time"] * math.pi / slip_time(p, normal_force, drive_speed)
        return Importance("ω_n τ_1", share, f"the load cell lags by {share:.2g} of the natural time of a slip")
