"""Record: refuses what a fit could not trust, cannot be changed, goes through frames and processes unchanged."""

import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from data_io import LogError, Record, Step
from data_io.values import LARGEST_FORCE


def ramp(n=20, **changes):
    values = {"time": np.arange(n) * 0.1, "normal_force": np.full(n, 3.0), "friction_force": np.linspace(0, 1, n)}
    return Record(**{**values, **changes})


def with_gap(length, n=40):
    friction = np.linspace(0, 1, n)
    friction[10 : 10 + length] = np.nan
    return friction


def test_columns_are_read_only_copies_of_float64():
    source = np.arange(20, dtype=np.int64)
    record = ramp(friction_force=source, channels={"Z": source})
    source[0] = 99
    assert record.friction_force[0] == 0 and record.friction_force.dtype == np.float64
    for values in (*record.columns().values(), *record.channels.values()):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0
    with pytest.raises(FrozenInstanceError):
        record.time = source
    with pytest.raises(TypeError):
        record.metadata["path"] = "x"


def test_missing_normal_and_friction_rows_count_together():
    normal = np.full(40, 3.0)
    normal[15:18] = np.inf
    with pytest.raises(LogError, match="rows 11 to 18"):
        ramp(40, friction_force=with_gap(5), normal_force=normal)


def test_a_process_gets_the_same_frozen_record():
    record = ramp(drive_speed=1e-3, channels={"Z": np.ones(20)}, metadata={"path": "p"})
    other = pickle.loads(pickle.dumps(record))
    assert other.about() == record.about() and not other.time.flags.writeable


numbers = st.floats(allow_nan=False, allow_infinity=False)
forces = st.floats(-LARGEST_FORCE, LARGEST_FORCE)


@given(
    st.lists(st.tuples(st.floats(1e-6, 1e3), forces, forces, st.floats()), min_size=2, max_size=30),
    st.one_of(st.none(), numbers),
)
def test_frames_bring_everything_back(rows, drive_speed):
    steps, normal, friction, channel = np.array(rows).T
    time = np.concatenate(([0.0], np.cumsum(steps)[:-1]))
    record = Record(
        time,
        normal,
        friction,
        drive_speed,
        {"Z": channel},
        {"Z": "m"},
        (Step(1, 4, 0, len(rows), {"a": "b"}),),
        {"k": 1.5},
    )
    other = Record.from_frame(record.to_frame())
    for name, values in record.columns().items():
        assert other.columns()[name].tobytes() == values.tobytes()
    assert other.about() == record.about()


def test_a_bare_frame_is_shifted_to_zero():
    frame = pd.DataFrame({"time": [5.0, 6.0], "normal_force": [1, 1], "friction_force": [0.1, 0.2], "V1": [1, 2]})
    record = Record.from_frame(frame)
    assert record.time.tolist() == [0, 1] and record.metadata["file_time_start"] == 5.0 and "V1" in record.channels
