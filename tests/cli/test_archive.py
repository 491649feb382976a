"""Archives: many logs in one file with an index, checked bit for bit, in parts, and without what names anybody."""

import json
import re

import h5py
import numpy as np
import pytest

from data_io import LogError, Record, Step, read_log, write_archive, write_hdf5
from data_io.anonymise import anonymous, is_plain_setting, is_usual
from data_io.hdf5 import read_index
from identify import examples
from identify.cli import main as cli

LOGS = [examples.FOLDER / name for name in ("1_mm_per_s.txt.gz", "5_mm_per_s.txt.gz", "0.1_mm_per_s.txt.gz")]
HEAD = """Created by CETR Data Viewer ver.2.19.106 05/12/22 14:43:46
C:\\Users\\meier\\secret project\\skin.tst

Run # 1
Script file C:\\Users\\meier\\skin on paper.cts
Run date 12 May 2022 12:21:50
Operator = Anna Meier
Note: volunteer V07 was nervous
Step No. 1

Set Force    = -200
Velocity     = 2
Sample of Anna = 3
Duration     = 2.17
Started at: 12:21:58.029 12 May 2022

T,Fx,Fz,COF,Annas Kanal
sec,g,g,,mm
"""


def cetr(folder, name="Anna Meier.txt", rows=60):
    path = folder / name
    random = np.random.default_rng(3)
    lines = [f"{i / 50:.4f},{random.normal(50, 5):.4f},-200.1,0.25,{i / 7:.6f}" for i in range(rows)]
    path.write_text(HEAD + "\n".join(lines) + "\n")
    return path


def same_numbers(record, other):
    for name, values in record.columns().items():
        assert values.tobytes() == other.columns()[name].tobytes(), name


def test_a_batch_of_logs_goes_into_one_archive_with_an_index(tmp_path):
    records = [read_log(path) for path in LOGS]
    entries = write_archive(iter(records), tmp_path / "all.h5")
    assert read_index(tmp_path / "all.h5") == pytest.approx(entries, nan_ok=True) or len(entries) == 3
    index = read_index(tmp_path / "all.h5")
    for number, (record, entry) in enumerate(zip(records, index, strict=True), start=1):
        back = read_log(tmp_path / "all.h5", run=number)
        same_numbers(record, back)
        assert (entry.run, entry.rows, entry.steps) == (number, len(record), len(record.steps))
        assert entry.source_file == LOGS[number - 1].name and entry.source_sha256 == record.metadata["sha256"]
        assert entry.duration == record.time[-1] and entry.normal_force == pytest.approx(0.935, abs=1e-3)
        assert [dict(s.parameters) for s in back.steps] == [dict(s.parameters) for s in record.steps]
        assert back.metadata["Script file"] == record.metadata["Script file"]
    with pytest.raises(LogError, match=r"runs 1, 2, 3.*--run"):
        read_log(tmp_path / "all.h5")
    assert read_index(LOGS[0]) == ()


def test_nothing_but_the_run_that_was_chosen_is_read(tmp_path, monkeypatch):
    write_archive([read_log(path) for path in LOGS], tmp_path / "all.h5")
    read = []
    plain = h5py.Dataset.__getitem__

    def counted(self, *arguments, **options):
        read.append(self.name)
        return plain(self, *arguments, **options)

    monkeypatch.setattr(h5py.Dataset, "__getitem__", counted)
    read_log(tmp_path / "all.h5", run=2, channels=["COF"])
    names = ("COF", "friction_force", "normal_force", "time")
    assert sorted(set(read) - {"/run_2/about"}) == [f"/run_2/step_1/{name}" for name in names]


def test_metadata_checksum_and_provenance_are_complete(tmp_path):
    source = cetr(tmp_path)
    record = read_log(source)
    write_hdf5(record, tmp_path / "log.h5")
    with h5py.File(tmp_path / "log.h5") as file:
        attrs, step = dict(file.attrs), file["run_1/step_1"]
        assert attrs["source_file"] == "Anna Meier.txt" and attrs["source_sha256"] == record.metadata["sha256"]
        assert re.fullmatch(r"stick-slip-workbench \d.*", attrs["created_by"])
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", attrs["created"])
        assert step["time"].compression == "gzip" and step["time"].fletcher32 and step["time"].shuffle
        about = json.loads(file["about"][()])["metadata"]
    assert about["Operator"] == "Anna Meier" and about["friction_force_source"] == "column Fx in g"
    assert about["source_format"] == record.metadata["format"]


def test_an_archive_of_nothing_never_appears(tmp_path):
    with pytest.raises(LogError, match="no log is left"):
        write_archive([], tmp_path / "log.h5")
    assert list(tmp_path.iterdir()) == []


def test_a_window_from_the_first_row_on_is_read_and_nothing_else(tmp_path):
    n = 5000
    steps = (Step(1, 1, 0, 2000), Step(1, 2, 2000, n))
    record = Record(np.arange(n) / 100, np.ones(n), np.arange(n) * 1.0, channels={"Z": np.ones(n)}, steps=steps)
    write_hdf5(record, tmp_path / "log.h5")
    part = read_log(tmp_path / "log.h5", step=2, window=(5.0, 6.0), channels=())
    assert part.friction_force.tolist() == list(range(2500, 2601)) and not part.channels
    assert part.metadata["file_time_start"] == 25.0 and part.time[0] == 0.0
    with pytest.raises(LogError, match=r"holds 0 row.*runs from 0 to 29.99 s, .* shows 20 s; move"):
        read_log(tmp_path / "log.h5", step=2, window=(30.0, 40.0))
    with pytest.raises(LogError, match="start before its stop"):
        read_log(tmp_path / "log.h5", window=(2.0, 1.0))
    text = cetr(tmp_path)
    cut = read_log(text, window=(0.5, 0.7))
    np.testing.assert_array_equal(cut.friction_force, read_log(text).friction_force[25:36])
    assert cut.metadata["file_time_start"] == pytest.approx(0.5)


def test_columns_of_any_group_are_found_by_their_usual_names(tmp_path):
    path = tmp_path / "daq.h5"
    with h5py.File(path, "w") as file:
        for test in ("slow", "fast"):
            group = file.create_group(f"tests/{test}")
            for name, unit in (("Time", "ms"), ("Fx", "mN"), ("Fz", "N")):
                values = np.arange(1, 51.0) * (2 if test == "fast" else 1)
                group.create_dataset(name, data=values, chunks=(7,), compression="lzf").attrs["units"] = unit
            group["comment"] = "words"
    assert [read_log(path, run=run).friction_force[0] for run in (1, 2)] == [2e-3, 1e-3]  # in the order of their names
    assert read_log(path, run=1).metadata["group"] == "/tests/fast"
    with pytest.raises(LogError, match="runs 1, 2"):
        read_log(path)
    with pytest.raises(LogError, match="step 3 was asked for"):
        read_log(path, step=3)


def test_anonymous_files_name_nobody_and_the_key_tells_all(tmp_path, capsys):
    folder = tmp_path / "Anna"
    folder.mkdir()
    source, out = cetr(folder), tmp_path / "log.h5"
    assert cli.main(["convert", str(source), "--out", str(out), "--anonymise"]) == 0
    record, back = read_log(source), read_log(out)
    raw = out.read_bytes()
    for word in ("Anna", "Meier", "meier", "secret", "skin", "V07", "2022", record.metadata["sha256"]):
        assert word.encode() not in raw and word not in json.dumps(back.about(), default=str), word
    same_numbers(Record(record.time, record.normal_force, record.friction_force), back)
    assert dict(back.steps[0].parameters) == {"Set Force": "-200", "Velocity": "2", "Duration": "2.17"}
    assert set(back.channels) == {"COF", "channel 2"} and back.metadata["friction_force_source"] == "column Fx in g"
    np.testing.assert_array_equal(back.channels["channel 2"], record.channels["Annas Kanal"])
    key = json.loads((tmp_path / "log.key.json").read_text())
    (told,) = key["logs"].values()
    assert told["metadata"]["Operator"] == "Anna Meier" and told["metadata"]["sha256"] == record.metadata["sha256"]
    assert told["channels"] == {"channel 2": "Annas Kanal"}
    assert told["steps"][0]["parameters"]["Started at"] == "12:21:58.029 12 May 2022"
    assert (tmp_path / "log.key.json").stat().st_mode & 0o077 == 0
    # the key is never written over by that of other logs
    for other in ([], ["--key", str(tmp_path / "log.key.json")]):
        out.unlink(missing_ok=True)
        assert cli.main(["convert", str(source), "--out", str(out), "--anonymise", *other]) == 2
        assert "may be the key of other logs" in capsys.readouterr().err
        assert json.loads((tmp_path / "log.key.json").read_text()) == key


@pytest.mark.parametrize(
    ("name", "value", "plain"),
    [
        ("Set Force", "-200", True),
        ("Velocity", "0.1 mm/s", True),
        ("Set Force", "200 please", False),
        ("Serial number", "12345", False),
        ("Operator", "7", False),
        ("Duration", "about 3", False),
        ("Größe", "3", False),
        ("Started at", "12:21:58", False),
        ("Laps", 12, True),
        ("Annas Zahl", 12, False),
    ],
)
def test_settings_that_stay_are_numbers_under_usual_names(name, value, plain):
    assert is_plain_setting(name, value) == plain


def test_usual_names_of_columns_stay():
    assert all(
        map(is_usual, ["Fx", "V1", "COF", "Z", "XYZ", "Friction force", "Temperature", "Laps", "Rotary.Velocity"])
    )
    assert not any(map(is_usual, ["Anna", "Kraft von Meier", "Probe 7", "", "12"]))
    safe = anonymous(Record(np.arange(3.0), np.ones(3), np.ones(3), channels={"Anna": np.ones(3)}))
    assert list(safe.record.channels) == ["channel 1"]


def test_convert_archives_many_logs_and_tells_which_were_left_out(tmp_path, capsys):
    bad = tmp_path / "bad.txt"
    bad.write_text("no log at all\n")
    arguments = ["convert", *map(str, [LOGS[0], bad, LOGS[1]]), "--out", str(tmp_path / "all.h5"), "--json"]
    assert cli.main(arguments) == 3
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == "incomplete" and told["logs"] == [str(LOGS[0]), str(LOGS[1])]
    assert [item["path"] for item in told["failed"]] == [str(bad)]
    assert [entry.source_file for entry in read_index(tmp_path / "all.h5")] == [LOGS[0].name, LOGS[1].name]
    assert cli.main(["inspect", str(tmp_path / "all.h5"), "--json"]) == 0
    seen = json.loads(capsys.readouterr().out)["logs"]
    assert [log["path"].endswith(f"run {n} ({LOGS[n - 1].name})") for n, log in enumerate(seen, start=1)] == [
        True,
        True,
    ]
    assert all(log["quality"]["verdict"] == "accept" for log in seen)


def test_raw_data_are_never_written_over(tmp_path, capsys):
    path = tmp_path / "log.h5"
    write_hdf5(read_log(LOGS[1]), path)
    before = path.read_bytes()
    assert cli.main(["convert", str(path), "--out", str(path)]) == 2
    assert "may hold a measured log" in capsys.readouterr().err and path.read_bytes() == before
    assert cli.main(["convert", str(path), "--out", str(tmp_path / "b.h5"), "--key", str(tmp_path / "k.json")]) == 2
