"""Parquet: units in names and metadata, instants, integers; what is damaged or promises too much is refused."""

import numpy as np
import pandas as pd
import pytest

from data_io import LogError, read_log

pyarrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

N = 400
TIME = np.arange(N) / 100.0
FRICTION = 0.5 + 0.01 * (np.arange(N) % 40)


def written(folder, units=None, **columns):
    schema = pyarrow.table(columns).schema
    for name, unit in (units or {}).items():
        place = schema.get_field_index(name)
        schema = schema.set(place, schema.field(place).with_metadata({"unit": unit}))
    parquet.write_table(pyarrow.table(columns, schema), folder / "a.parquet")
    return folder / "a.parquet"


def right(record):
    assert record.metadata["format"] == "parquet"
    np.testing.assert_allclose(record.time, TIME, atol=1e-12)
    np.testing.assert_allclose(record.friction_force, FRICTION, rtol=1e-12)
    np.testing.assert_allclose(record.normal_force, 3.0, rtol=1e-12)


def test_units_stand_in_the_metadata_of_columns_and_win_over_names(tmp_path):
    units = {"t": "ms", "Fx [N]": "mN", "Fz": "N"}
    path = written(tmp_path, units, t=1e3 * TIME, **{"Fx [N]": 1e3 * FRICTION}, Fz=np.full(N, 3, np.int32))
    right(read_log(path))
    with pytest.raises(LogError, match="no unit was found for column 't'"):
        read_log(written(tmp_path, t=TIME, **{"Fx [N]": FRICTION, "Fz [N]": np.full(N, 3.0)}))


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_instants_are_seconds_from_the_first_on(tmp_path, unit):
    stamps = pd.Timestamp("2026-03-29 01:59:59") + pd.to_timedelta(TIME, "s")
    frame = pd.DataFrame({"Fx [N]": FRICTION, "Fz [N]": 3.0, "note": "dry"}, index=stamps.as_unit(unit))
    frame.index.name = "timestamp"
    frame.to_parquet(tmp_path / "a.parquet")
    right(read_log(tmp_path / "a.parquet"))


def whole(folder):
    return written(folder, **{"Time [s]": TIME, "Fx [N]": FRICTION, "Fz [N]": np.full(N, 3.0)}).read_bytes()


def alike(folder):
    """30 million rows in some kilobytes."""
    zeros = pyarrow.table({name: np.zeros(1_000_000) for name in ("Time [s]", "Fx [N]", "Fz [N]")})
    with parquet.ParquetWriter(folder / "a.parquet", zeros.schema, compression="zstd") as writer:
        for _ in range(30):
            writer.write_table(zeros, row_group_size=1_000_000)
    return (folder / "a.parquet").read_bytes()


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda folder: whole(folder)[:-200], "the Parquet file is damaged"),
        (lambda folder: whole(folder)[:-8] + b"\xff\xff\xff\x7fPAR1", "the Parquet file is damaged"),
        (lambda folder: b"PAR1" + bytes(4000) + b"PAR1", "the Parquet file is damaged"),
        (alike, "promises 720 MB"),
    ],
    ids=["cut", "a footer of 2 GB", "zeros", "30 million rows"],
)
def test_hostile_files_are_refused_in_a_sentence(tmp_path, made, words):
    data = made(tmp_path)
    (tmp_path / "a.parquet").write_bytes(data)
    with pytest.raises(LogError, match=words):
        read_log(tmp_path / "a.parquet")
