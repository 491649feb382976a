"""The load cell: gain, offset, and averaging over the sample interval."""

from __future__ import annotations

from identify.quantities import Effect, Parameter, Situation, Terms


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
        """Gain and offset; averaging is a matter of sampling."""
        return Terms(gain=s.p.sensor_gain, offset=s.p.sensor_offset)
