"""What is written reads back bit for bit; a file is there whole or not at all."""

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from data_io import Finding, LogError, Record, Step, read_log, write_csv, write_hdf5
from data_io.atomic import atomic_path, atomic_write
from data_io.values import LARGEST_FORCE, SIZES

WRITERS = [(write_hdf5, "log.h5"), (write_csv, "log.csv")]
NOT_KEPT = {"path", "sha256", "format"}  # they say where this file is

words = st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=12)
names = st.text(st.characters(exclude_categories=("Cs", "C", "Z")), min_size=1, max_size=8).filter(
    lambda name: name.isprintable() and name not in ("time", "normal_force", "friction_force", "drive_speed")
)
finite = st.floats(allow_nan=False, allow_infinity=False)
forces = st.floats(-LARGEST_FORCE, LARGEST_FORCE)
steps_of_time = st.floats(10 * SIZES["s"][0], 1e6)  # room for the rounding of their sum
scalars = st.one_of(words, st.integers(-(2**60), 2**60), finite, st.booleans())


@st.composite
def records(draw):
    n = draw(st.integers(2, 12))

    def column(elements):
        return np.array(draw(st.lists(elements, min_size=n, max_size=n)))

    friction = column(forces)
    if n > 4 and draw(st.booleans()):
        friction[2] = np.nan
    cut = draw(st.integers(1, n - 1))
    parameters = draw(st.dictionaries(words, words, max_size=3))
    channels = draw(st.lists(names, max_size=3, unique=True))
    return Record(
        time=np.concatenate(([0.0], np.cumsum(column(steps_of_time))[:-1])),
        normal_force=column(forces),
        friction_force=friction,
        drive_speed=draw(st.one_of(st.none(), finite, st.builds(lambda: column(finite)))),
        channels={name: column(st.floats()) for name in channels},
        channel_units={name: draw(st.sampled_from(["", "m", "rpm", "°C", 'a,"b']))for name in channels},
        steps=(Step(1, 3, 0, cut, parameters), Step(1, 7, cut, n)) if draw(st.booleans()) else (),
        metadata=draw(st.dictionaries(words.filter(lambda key: key not in NOT_KEPT), scalars, max_size=3)),
        findings=(Finding("seen", "warning", draw(words)),),
    )  # fmt: skip


def kept(record):
    own = {f"{role}_source" for role in ("time", "normal_force", "friction_force")}
    own |= {"source_file", "source_sha256", "source_format"}  # where the record came from before it was written
    about = record.about()
    return {**about, "metadata": {k: v for k, v in about["metadata"].items() if k not in NOT_KEPT | own}}


def assert_same(record, other):
    assert list(other.columns()) == list(record.columns())
    for name, values in record.columns().items():
        back = other.columns()[name]
        assert np.array_equal(np.isnan(values), np.isnan(back)), name
        assert values[~np.isnan(values)].tobytes() == back[~np.isnan(back)].tobytes(), name
    assert kept(other) == kept(record)


def semicolon_and_comma():
    """What the account says in its line must not be taken for the cell of a header that goes on below it."""
    zero = np.zeros(9)
    told = (Finding("seen", "warning", ";"),)
    return Record(np.arange(9.0), zero, zero, channels={"0": zero, ",0": zero}, findings=told)


@pytest.mark.parametrize(("write", "name"), WRITERS)
@settings(
    max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(record=records())
@example(record=semicolon_and_comma())
def test_round_trip(tmp_path, write, name, record):
    write(record, tmp_path / name)
    once = read_log(tmp_path / name)
    assert_same(record, once)
    write(once, tmp_path / f"again-{name}")
    assert_same(once, read_log(tmp_path / f"again-{name}"))


def sample(n=30):
    steps = (Step(1, 1, 0, 10, {"Velocity": "240"}), Step(1, 2, 10, n))
    return Record(np.arange(n) / 10, np.full(n, -1.0), np.arange(n) / 3, 1e-3, {"a/b": np.ones(n)}, {"a/b": "N"}, steps)


@pytest.mark.parametrize(("write", "name"), WRITERS)
def test_steps_and_options_of_what_we_wrote(tmp_path, write, name):
    write(sample(), tmp_path / name)
    second = read_log(tmp_path / name, step=2)
    assert len(second) == 20 and second.time[0] == 0 and second.metadata["file_time_start"] == 1.0
    assert second.normal_force[0] == -1.0  # our own files say what compression is; nothing is guessed
    assert read_log(tmp_path / name, normal_force="2 N").normal_force[0] == 2.0
    other = {"friction_force": "a/b" if name == "log.csv" else "normal_force"}
    assert np.ptp(read_log(tmp_path / name, columns=other).friction_force) == 0
    with pytest.raises(LogError, match="step 5"):
        read_log(tmp_path / name, step=5)


@pytest.mark.parametrize(("write", "name"), WRITERS)
def test_the_source_is_kept_by_name_and_hash_only(tmp_path, write, name):
    source = tmp_path / "here" / "log.txt"
    source.parent.mkdir()
    source.write_text("T,Fx,Fz\ns,N,N\n0,1,3\n1,1,3\n")
    record = read_log(source)
    write(record, tmp_path / name)
    metadata = read_log(tmp_path / name).metadata
    assert metadata["source_file"] == "log.txt" and metadata["source_sha256"] == record.metadata["sha256"]
    assert b"here" not in (tmp_path / name).read_bytes()
    if name.endswith("h5"):
        with h5py.File(tmp_path / name) as file:
            assert file.attrs["source_file"] == "log.txt" and file.attrs["source_sha256"] == record.metadata["sha256"]


def test_the_layout_is_as_promised(tmp_path):
    write_hdf5(sample(), tmp_path / "log.h5")
    with h5py.File(tmp_path / "log.h5") as file:
        assert file.attrs["format"] == "stickslip-log" and file.attrs["format_version"] == 1
        assert file["run_1/step_1"].attrs["Velocity"] == "240"
        for name, unit in (("time", "s"), ("normal_force", "N"), ("friction_force", "N")):
            assert (
                file[f"run_1/step_2/{name}"].attrs["units"] == unit and file[f"run_1/step_2/{name}"].dtype == np.float64
            )


@pytest.mark.parametrize("write", [write_hdf5, write_csv])
def test_places_that_cannot_be_written_are_named(tmp_path, write):
    for place in (tmp_path, tmp_path / "absent" / "log"):
        with pytest.raises(LogError, match="cannot be written"):
            write(sample(), place)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt, SystemExit])
@pytest.mark.parametrize("mode", ["w", "wb"])
def test_nothing_is_left_of_a_broken_write(tmp_path, failure, mode):
    target = tmp_path / "result.json"
    target.write_text("old")
    with pytest.raises(failure), atomic_write(target, mode) as handle:
        handle.write("half" if mode == "w" else b"half")
        raise failure
    assert target.read_text() == "old" and list(tmp_path.iterdir()) == [target]


def test_an_atomic_write_replaces_and_keeps_the_suffix(tmp_path):
    target = tmp_path / "Maß für Haut.svg"
    target.write_text("old")
    with atomic_path(target) as temporary:
        assert temporary.suffix == ".svg" and temporary.parent == tmp_path
        temporary.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new" and list(tmp_path.iterdir()) == [target]
