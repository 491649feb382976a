"""LabVIEW TDMS: every scaling applied in order, unknown ones refused, clocks of waveforms, groups as runs."""

import numpy as np
import pytest

from data_io import LogError, read_log

nptdms = pytest.importorskip("nptdms")

N = 400
COUNTS = (1000 + 10 * (np.arange(N) % 40)).astype(np.int16)
START = np.datetime64("2026-01-15T10:00:00.000000", "us")


def polynomial(place, *coefficients):
    """Properties of one scaling, a polynomial of its input."""
    prefix = f"NI_Scale[{place}]_Polynomial"
    told = {f"{prefix}_Coefficients[{i}]": value for i, value in enumerate(coefficients)}
    return {f"NI_Scale[{place}]_Scale_Type": "Polynomial", f"{prefix}_Coefficients_Size": len(coefficients),
            f"{prefix}_Input_Source": 0xFFFFFFFF if place == 0 else place - 1, **told}  # fmt: skip


def linear(place, slope, zero):
    prefix = f"NI_Scale[{place}]_Linear"
    return {f"NI_Scale[{place}]_Scale_Type": "Linear", f"{prefix}_Slope": slope, f"{prefix}_Y_Intercept": zero,
            f"{prefix}_Input_Source": 0xFFFFFFFF if place == 0 else place - 1}  # fmt: skip


def wave(interval=0.01, start=0.0, unit="N", **more):
    moment = START + np.timedelta64(int(1e6 * start), "us")
    return {"wf_increment": interval, "wf_start_offset": 0.0, "wf_start_time": moment, "unit_string": unit, **more}


def written(folder, *channels):
    with nptdms.TdmsWriter(folder / "a.tdms") as writer:
        writer.write_segment([nptdms.ChannelObject(*channel) for channel in channels])
    return folder / "a.tdms"


def test_all_scalings_in_their_order(tmp_path):
    """Counts to volts by a polynomial, volts to newtons by a line: 0.5 mV a count and 2 N/V minus 0.1 N."""
    scales = {"NI_Number_Of_Scales": 2, "NI_Scaling_Status": "unscaled", **polynomial(0, 0.0, 0.5e-3, 0.0, 0.0)}
    scales |= linear(1, 2.0, -0.1)
    path = written(
        tmp_path, ("daq", "Fx", COUNTS, wave() | scales), ("daq", "Fz", np.full(N, 3.0), wave())
    )  # fmt: skip
    record = read_log(path)
    np.testing.assert_allclose(record.friction_force, 2.0 * 0.5e-3 * COUNTS - 0.1, rtol=1e-12)
    assert record.metadata["format"] == "tdms" and record.time[-1] == pytest.approx(3.99)


def test_counts_without_a_scaling_never_pass_as_newtons(tmp_path):
    path = written(tmp_path, ("daq", "Fx", COUNTS, wave()), ("daq", "Fz", np.full(N, 3.0), wave()))
    with pytest.raises(LogError, match="no unit was found for column 'Fx'"):
        read_log(path)
    record = read_log(path, units={"friction_force": "0.5 mN"})
    np.testing.assert_allclose(record.friction_force, 0.5e-3 * COUNTS, rtol=1e-12)


def test_an_unknown_scaling_is_refused(tmp_path):
    magic = {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Magic", "NI_Scaling_Status": "unscaled"}
    path = written(tmp_path, ("daq", "Fx", COUNTS, wave() | magic), ("daq", "Fz", np.full(N, 3.0), wave()))
    with pytest.raises(LogError, match="channel 'Fx' holds numbers with a scaling of the kind 'Magic'"):
        read_log(path)


def test_groups_are_runs(tmp_path):
    path = written(
        tmp_path,
        ("notes", "Temperature", np.ones(9), {}),
        ("slow", "Fx_N", np.arange(N) % 7 + 0.5, wave()), ("slow", "Fz_N", np.full(N, 3.0), wave()),
        ("fast", "Fx_N", np.arange(N) % 5 + 0.5, wave()), ("fast", "Fz_N", np.full(N, 4.0), wave()),
    )  # fmt: skip
    with pytest.raises(LogError, match=r"runs in the log: 1, 2; .*--run"):
        read_log(path)
    both = {record.steps[0].parameters["group"]: record for record in (read_log(path, run=run) for run in (1, 2))}
    assert both["fast"].normal_force[0] == 4.0 and both["slow"].friction_force[6] == 6.5
