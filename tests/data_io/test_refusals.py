"""Input that is refused in one sentence, packed traps among it, and input just short of it that is read."""

import gzip
import zipfile

import numpy as np
import pytest

from data_io import LogError, Record, Step, read_log, table
from data_io.source import load

HEAD = "T,Fx,Fz\ns,N,N\n"
GOOD = HEAD + "".join(f"{i / 100:.2f},{i % 7}.5,3.0\n" for i in range(40))
UNITS = {"time": "s", "friction_force": "N", "normal_force": "N"}


def clocks(late, falls=False):
    """Two forces, each with a clock of its own, the second one beginning so late [s]."""
    rows = [(i / 10, late + (i - 2 * (i == 9) * falls) / 10, i % 7) for i in range(40)]
    return "T [s],Fx [N],T [s],Fz [N]\n" + "".join(f"{a},{f}.5,{b:.2f},3.0\n" for a, b, f in rows)


def worded(rows):
    return GOOD.replace("0.10,", "0.1,") + "".join(f"{0.4 + i / 100:.2f},over,3.0\n" for i in range(rows)) + "0.9,1,3\n"


# what is refused, with which options, words of the sentence; what just is not, with which options
FILES = {
    "empty": ("", {}, "empty", GOOD, {}),
    "nothing packed": (gzip.compress(b""), {}, "empty", gzip.compress(GOOD.encode()), {}),
    "cut gz": (gzip.compress(GOOD.encode())[:-10], {}, "damaged", gzip.compress(GOOD.encode()), {}),
    "binary": (bytes(range(1, 256)) * 40, {}, "no reader knows", GOOD, {}),
    "no numbers": (HEAD, {}, "at least", HEAD + "0,1,3\n1,1,3\n", {}),
    "no header": (GOOD.removeprefix(HEAD), {}, "no header", GOOD, {}),
    "no known column": (GOOD.replace("T,Fx,Fz", "A,B,C"), {}, "recognised", GOOD, {}),
    "other names": (GOOD.replace("Fx", "B"), {"columns": {"friction_force": "Q"}}, "none of 'Q'|no column 'Q'",
                    GOOD.replace("Fx", "B"), {"columns": {"friction_force": "B"}}),
    "no time": (GOOD.replace("T,", "Q,"), {}, "no time column", GOOD.replace("T,", "Q,"), {"rate": "4 Hz"}),
    "no normal force": (GOOD.replace("Fz", "Q"), {}, "no normal force", GOOD.replace("Fz", "Q"), {"normal_force": 3.0}),
    "no unit": (GOOD.replace("s,N,N\n", ""), {}, "no unit", GOOD.replace("s,N,N\n", ""), {"units": UNITS}),
    "unknown unit": (GOOD.replace("s,N", "s,apples"), {}, "apples", GOOD.replace("s,N", "s,mN"), {}),
    "wrong scale": (GOOD.replace("s,N", "s,V"), {"units": {"friction_force": "2 mm/V"}}, "does not turn",
                    GOOD.replace("s,N", "s,V"), {"units": {"friction_force": "2 N/V"}}),
    "two units": ("T,Fx (N),Fz\ns,mN,N\n0,1,3\n1,1,3\n", {}, "one unit", "T,Fx (N),Fz\ns,N,N\n0,1,3\n1,1,3\n", {}),
    "commas for both": ("T (s),Fx (N),Fz (N)\n" + "0,01,1,5,3,0\n" * 3, {}, "decimal commas", GOOD, {}),
    "thousands": ("T [ms]\tFx [mN]\tFz [mN]\n0\t999\t2,000\n1\t1,001\t2,000\n", {}, "between thousands",
                  "T [ms]\tFx [mN]\tFz [mN]\n0\t0,999\t2,000\n1\t1,001\t2,000\n", {}),
    "long row": (GOOD + "0.5,1,3,4\n", {}, "line 43 holds 4 fields", GOOD + "0.5,1,3,\n", {}),
    "words for numbers": (worded(6), {}, "no number|holds 'over'", worded(5), {}),
    "an empty column": (HEAD + "0,,3\n1,,3\n2,,3\n", {}, "holds no numbers", HEAD + "0,1,3\n1,2,3\n2,,3\n", {}),
    "a clock that falls": (GOOD + "0.38,1.5,3.0\n", {}, "falls", GOOD + "0.395,1.5,3.0\n", {}),
    "a clock that stands": (GOOD + "0.40,1.5,3.0\n" * 9, {}, "repeats itself", GOOD + "0.40,1.5,3.0\n" * 6, {}),
    "a clock that restarts": (HEAD + "".join(f"{i % 4 / 10},{i % 7},3\n" for i in range(40)), {}, "restarts", GOOD, {}),
    "no time at all": (HEAD + "nan,1,3\nnan,1,3\n", {}, "holds no numbers", HEAD + "0,1,3\n1,1,3\n", {}),
    "clocks apart": (clocks(4.0), {}, "overlap", clocks(3.7), {}),
    "one of several clocks falls": (clocks(0.0, falls=True), {}, "does not rise", clocks(0.0), {}),
    "words without end": ("a word\n" * 20_002 + GOOD, {}, "words in a row", "a word\n" * 19_990 + GOOD, {}),
    "headers without end": (HEAD * 5009 + GOOD, {}, "header rows", HEAD * 4990 + GOOD, {}),
    "zero bytes": (GOOD.encode() + bytes(1 << 19) + b"\n0.50,1.5,3.0\n", {}, "zero bytes", GOOD, {}),
    "no rate": (GOOD, {"rate": "4 m"}, "rate", GOOD, {"rate": "4 Hz"}),
    "two clocks": (GOOD, {"rate": "4 Hz", "columns": {"time": "T"}}, "one clock", GOOD, {"columns": {"time": "T"}}),
    "no such role": (GOOD, {"columns": {"friction": "Fx"}}, "did you mean", GOOD, {"columns": {"time": "T"}}),
    "two purposes": (GOOD, {"columns": {"friction_force": "Fx", "normal_force": "Fx"}}, "two purposes",
                     GOOD, {"columns": {"friction_force": "Fx", "normal_force": "Fz"}}),
    "a unit of no column": (GOOD, {"units": {"force": "N"}}, "no column", GOOD, {"units": {"Fx": "N"}}),
    "a load of no force": (GOOD, {"normal_force": "3 mm"}, "normal force", GOOD, {"normal_force": "3 N"}),
    "a load of zero": (GOOD, {"normal_force": 0}, "above 0", GOOD, {"normal_force": 1e-9}),
    "an empty window": (GOOD, {"window": (0.2, 0.2)}, "before its stop", GOOD, {"window": (0.1, 0.2)}),
    "a window outside": (GOOD, {"window": (0.39, 9.0)}, r"holds 1 row", GOOD, {"window": (0.38, 9.0)}),
    "no such run": (GOOD, {"run": 2}, "run 2", GOOD, {"run": 1}),
    "no such step": (GOOD, {"step": 3}, "step 3", GOOD, {"step": 1}),
    "our CSV of later": ("# stickslip-log 9\n# {}\n" + GOOD, {}, "version '9'", GOOD, {}),
    "our CSV without account": ("# stickslip-log 1\n# {}\n" + GOOD, {}, "JSON account", GOOD, {}),
    "damaged HDF5": (b"\x89HDF\r\n\x1a\n" + bytes(300), {}, "damaged", GOOD, {}),
    "old Excel": (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), {}, "old Excel", GOOD, {}),
    "native CETR": (b"#1# Name$pair$\x00\x01\x02" + bytes(50), {}, "native CETR", GOOD, {}),
    "damaged workbook": (b"PK\x03\x04" + bytes(30) + b"[Content_Types].xml" + bytes(300), {}, "damaged", GOOD, {}),
}  # fmt: skip


def put(folder, content):
    path = folder / "log.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("name", FILES)
def test_what_is_refused_and_what_just_is_not(tmp_path, name):
    refused, options, words, read, others = FILES[name]
    with pytest.raises(LogError, match=words) as caught:
        read_log(put(tmp_path, refused), **options)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 700
    assert len(read_log(put(tmp_path, read), **others)) >= 2


def test_a_path_that_is_no_log_is_said(tmp_path):
    for name, words in (("none.csv", "no such file"), ("a\0b", "cannot be opened"), ("", "this is a folder")):
        with pytest.raises(LogError, match=words):
            load(tmp_path / name)
    for number in (1, 3):
        (tmp_path / f"a{number}.csv").write_text(GOOD)
    with pytest.raises(LogError, match="count up"):
        read_log(tmp_path)


ONES = np.ones(20)
RECORDS = {
    "numbers": ({"friction_force": ["a"] * 20}, {"friction_force": ["1"] * 20}),
    "shape": ({"friction_force": np.ones(19)}, {"friction_force": ONES}),
    "no finite number": ({"time": np.r_[np.arange(19.0), np.nan]}, {}),
    "starts at": ({"time": np.arange(20.0) + 1e-9}, {}),
    "does not rise": ({"time": np.r_[np.arange(19.0), 18.0]}, {"time": np.r_[np.arange(19.0), np.nextafter(18.0, 19)]}),
    "which no log does": ({"time": 1e10 * np.arange(20.0)}, {"time": 1e-3 * np.arange(20.0)}),
    "beyond": ({"normal_force": np.r_[np.full(11, 2e9), ONES[11:]]},
               {"normal_force": np.r_[np.full(5, 2e9), ONES[5:]]}),
    "no number in rows": ({"friction_force": np.r_[np.full(6, np.nan), ONES[6:]]},
                          {"friction_force": np.r_[np.full(5, np.nan), ONES[5:]]}),
    "called 'time'": ({"channels": {"time": ONES}}, {"channels": {"times": ONES}}),
    "plain text": ({"channels": {"Z": ONES}, "channel_units": {"Z": "m\n"}}, {"channels": {"Z": ONES}}),
    "drive speed": ({"drive_speed": np.inf}, {"drive_speed": 0.0}),
    "cover rows": ({"steps": (Step(1, 1, 0, 19),)}, {"steps": (Step(1, 1, 0, 20),)}),
    "same run": ({"steps": (Step(1, 1, 0, 9), Step(1, 1, 9, 20))}, {"steps": (Step(1, 1, 0, 9), Step(1, 2, 9, 20))}),
}  # fmt: skip


@pytest.mark.parametrize("words", RECORDS)
def test_a_record_refuses_what_a_fit_could_not_trust(words):
    plain = {"time": np.arange(20.0), "normal_force": ONES, "friction_force": ONES}
    wrong, sound = RECORDS[words]
    with pytest.raises(LogError, match=words):
        Record(**{**plain, **wrong})
    Record(**{**plain, **sound})


PACKED = b"T [s],Fx [N],Fz [N]\n" + b"".join(b"%.2f,0.5,3\n" % (0.02 * i) for i in range(60))
ENDLESS = PACKED + b",,\n" * (24 << 20)


@pytest.mark.parametrize("kind", ["gz", "zip"])
def test_a_trap_is_refused_before_its_rows_are_read(tmp_path, monkeypatch, kind):
    path = tmp_path / f"log.csv.{kind}"
    if kind == "gz":
        path.write_bytes(gzip.compress(ENDLESS))
    else:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("log.csv", ENDLESS)
    monkeypatch.setattr(table, "read_numbers", lambda *_: pytest.fail("rows were read"))
    with pytest.raises(LogError, match="unpacks to more than 100 times its size"):
        read_log(path)
