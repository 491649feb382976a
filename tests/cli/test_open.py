"""Opening: whatever the bytes, the answer is a record or one sentence; every bad input names what to do."""

import gzip

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings

from data_io import LogError, Record, read_log
from data_io.open import READERS
from experiments.drawn_logs import ANY, CETR, GOOD, SEMICOLON, broken, tables

BAD = {
    "empty": (b"", "is empty"),
    "blank": (b"\n \n", "no rows of numbers"),
    "binary": (bytes(range(256)) * 40, "no reader knows"),
    "zeros": (bytes(5000), "no reader knows"),
    "picture": (b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "no reader knows"),
    "prose": (b"Dear lab, please find attached the log.\n" * 50, "no rows of numbers"),
    "no time column": (GOOD.replace("T,", "Q,").encode(), "no time column.*--columns time="),
    "no force column": (GOOD.replace("Fx", "Q").encode(), "no friction force column.*--columns friction_force="),
    "no load column": (GOOD.replace("Fz", "Q").encode(), "no normal force column.*--normal-force"),
    "no known column": (GOOD.replace("T,Fx,Fz", "A,B,C").encode(), "no time column and no force column.*--columns"),
    "no header": ("".join(GOOD.splitlines(True)[2:]).encode(), "no header row.*--columns time=1"),
    "no units": (GOOD.replace("s,N,N\n", "").encode(), r"no unit.*--units time=s,normal_force=N,friction_force=N"),
    "unknown unit": (GOOD.replace("s,N,N", "s,apples,N").encode(), "'apples' is unknown.*--units friction_force"),
    "wrong unit": (GOOD.replace("s,N,N", "s,mm,N").encode(), "'mm' was found where a unit of N"),
    "two units": (GOOD.replace("T,Fx,", "T,Fx (N),").replace("s,N,", "s,mN,").encode(), "one unit was expected"),
    "block of NaN": ((GOOD + "".join(f"0.{i},nan,3\n" for i in range(41, 48))).encode(), "holds no number in rows"),
    "words for numbers": (GOOD.replace(",3\n", ",three\n").encode(), "holds 'three'"),
    "clock running backwards": ((GOOD + "0.2,1,3\n").encode(), "falls from"),
    "clock standing": (GOOD.replace("0.", "0.0").replace("0.01", "0.02").replace("0.03", "0.02").encode(), "clock"),
    "one row": (b"T,Fx,Fz\ns,N,N\n0,1,3\n", "1 row"),
    "no row": (b"T,Fx,Fz\ns,N,N\n", "no rows of numbers"),
    "row too long": ((GOOD + "0.5,1,3,4\n").encode(), "line 43 holds 4 fields"),
    "decimal commas between commas": (GOOD.replace(".", ",").encode(), "decimal comma|fields"),
    "damaged gz": (gzip.compress(GOOD.encode())[:60], "damaged"),
    "not gz": (b"\x1f\x8b" + b"x" * 40, "damaged"),
    "empty gz": (gzip.compress(b""), "is empty"),
    "damaged hdf5": (b"\x89HDF\r\n\x1a\n" + bytes(300), "damaged"),
}  # fmt: skip


def put(tmp_path, content):
    path = tmp_path / "log.txt"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_sentence(tmp_path, name):
    content, words = BAD[name]
    path = put(tmp_path, content)
    with pytest.raises(LogError, match=words) as caught:
        read_log(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ") and "\n" not in text and ";" in text and len(text) < 500


@pytest.mark.parametrize("text", [GOOD, CETR, SEMICOLON])
def test_the_good_ones_are_read(tmp_path, text):
    assert np.isfinite(read_log(put(tmp_path, text.encode())).friction_force).all()


def test_places_without_a_log(tmp_path):
    for place, words in ((tmp_path / "absent.csv", "no such file"), (tmp_path, "folder"), ("a\0b", "cannot be opened")):
        with pytest.raises(LogError, match=words):
            read_log(place)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"step": 3}, "step 3 was asked for; the log holds step 1"),
        ({"run": 2}, "run 2 was asked for"),
        ({"columns": {"time": "Q"}}, "no column 'Q' was found for time"),
        ({"columns": {"friction": "Fx"}}, "did you mean friction_force"),
        ({"columns": {"time": "Fx"}}, "'N' was found where a unit of s"),
        ({"columns": {"friction_force": "Fx", "normal_force": "Fx"}}, "two purposes"),
        ({"units": {"force": "N"}}, "'force', which is no column"),
        ({"units": {"friction_force": "parsec"}}, "'parsec'"),
        ({"normal_force": "3 apples"}, "'apples' is unknown"),
        ({"normal_force": 0}, "above 0 N"),
        ({"normal_force": "3 mm"}, "'mm' was found"),
    ],
)
def test_wrong_options_are_named(tmp_path, options, words):
    with pytest.raises(LogError, match=words):
        read_log(put(tmp_path, GOOD.encode()), **options)


def test_the_unit_of_the_user_wins(tmp_path):
    path = put(tmp_path, GOOD.encode())
    assert read_log(path, units={"friction_force": "mN"}).friction_force[1] == pytest.approx(1e-3)
    assert read_log(path, units={"Fx": "mN"}).friction_force[1] == pytest.approx(1e-3)


@settings(max_examples=250, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(broken())
def test_mutated_logs_are_records_or_sentences(tmp_path, data):
    try:
        record = read_log(put(tmp_path, data))
    except LogError as error:
        assert "\n" not in str(error)
    else:
        assert isinstance(record, Record) and len(record) >= 2


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(ANY)
@example(b"T,Fx,Fz\ns,N,N\n0,1,2\n1,\xff,2\n")
@example(b"\xef\xbb\xbf")
@example(b"\xff\xfe")
@example(b'"')
def test_any_bytes_are_records_or_sentences(tmp_path, data):
    try:
        read_log(put(tmp_path, data))
    except LogError as error:
        assert "\n" not in str(error)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(tables())
def test_a_sound_table_is_read_to_the_last_digit_in_whatever_layout(tmp_path, drawn):
    record = read_log(put(tmp_path, drawn.data))
    assert drawn.differs(record) == "" and not [f for f in record.findings if f.severity != "info"]


def test_every_reader_has_its_own_name():
    assert len({reader.name for reader in READERS}) == len(READERS)
