"""The load cell: gain, offset, averaging and lags."""

from __future__ import annotations

import math
from collections.abc import Mapping

from identify.effects.quantities import Effect, Importance, Lag, Parameter, Situation, State, Terms, fall, slip_time


class ForceSensor(Effect):
    """It shows gain * force + offset, averaged over the last `averaging_time` of each sample (0: the moment)."""

    name = "force_sensor"
    says = "gain and offset of the load cell, averaging over the sample interval"
    source = "instrument model"
    parameters = (
        Parameter("sensor_gain", "", 0.1, 10.0, 1.0, "G", "gain of the load cell", "log", 0.02, "given"),
        Parameter("sensor_offset", "N", -1e4, 1e4, 0.0, "F_0", "offset of the load cell", "linear", 0.01, "given"),
        Parameter(
            "averaging_time",
            "s",
            0.0,
            10.0,
            0.0,
            "T_avg",
            "time over which a sample is averaged",
            "linear",
            1e-3,
            "given",
        ),
    )
    null = {"sensor_gain": 1.0, "sensor_offset": 0.0, "averaging_time": 0.0}

    def terms(self, s: Situation) -> Terms:
        """Gain, offset and averaging, which is a matter of sampling."""
        return Terms(gain=s.p.sensor_gain, offset=s.p.sensor_offset, averaging=s.p.averaging_time)

    def unfit(self, p: Mapping[str, float]) -> str | None:
        """A fit compares forces of the moment."""
        if p["averaging_time"] == 0.0:
            return None
        return (
            f"averaging_time is {p['averaging_time']:g} s: a fit compares forces of the moment; leave it at 0 and add "
            "sensor_lag to effects, which finds half of it as a lag"
        )

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """The largest of its errors: of gain, of zero against the fall of friction, of averaging against a slip."""
        gain, zero = abs(p["sensor_gain"] - 1), abs(p["sensor_offset"]) / fall(p, normal_force)
        blur = p["averaging_time"] / slip_time(p, normal_force, drive_speed)
        return Importance(
            "max(|G − 1|, F_0/((μs − μk0) F_n), T_avg/T_slip)",
            max(gain, zero, blur),
            f"the load cell is off by {100 * gain:.3g} % in gain, {100 * zero:.3g} % of μs − μk0 in zero, and averages "
            f"over {100 * blur:.3g} % of a slip",
        )


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
