"""A second lag of the load cell behind the first: together a second-order (overdamped) sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping

from identify.effects.quantities import Effect, Importance, Lag, Parameter, Situation, State, Terms
from identify.effects.typical import slip_time


class SensorSecondLag(Effect):
    """State: what the second stage shows of the first. Null as its lag goes to zero."""

    name = "sensor_second_lag"
    says = "second lag behind the first: a second-order load cell"
    source = "instrument model"
    parameters = (Parameter("second_lag_time", "s", 1e-6, 10.0, 1e-3, "τ_2", "time constant of the second stage"),)
    states = (State("second_lagged_force", "N", 0.0),)
    null = {"second_lag_time": 0.0}  # a limit
    needs = ("sensor_lag",)

    def terms(self, s: Situation) -> Terms:
        """The lag; the model writes its rate."""
        return Terms(lag=Lag("second_lagged_force", s.p.second_lag_time))

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """The lag against the natural time of a slip."""
        share = p["second_lag_time"] * math.pi / slip_time(p, normal_force, drive_speed)
        return Importance("ω_n τ_2", share, f"its second stage lags by {share:.2g} of the natural time of a slip")
