"""Every format from a look-alike file, read to exact values; its broken variants are refused or read with a warning."""

import gzip
import random
import resource
import time
import zipfile

import numpy as np
import pytest

from data_io import LogError, read_log
from experiments import run_reader_fuzz
from experiments.lookalikes import ALL, TEXTS, rows
from experiments.mutations import ORDER, TEXT

SMALL = rows(60)


def put(folder, kind, data=None):
    path = folder / kind.file_name
    path.write_bytes(kind.make(SMALL).data if data is None else data)
    return path


def codes(record, severity="warning"):
    return {finding.code for finding in record.findings if finding.severity == severity}


@pytest.mark.parametrize("name", ALL)
def test_every_format_is_read_to_the_last_digit(tmp_path, name):
    kind = ALL[name]
    record = read_log(put(tmp_path, kind), **kind.options)
    assert record.metadata["format"] == kind.form
    far = float(record.metadata.get("file_time_start", 0.0))  # of a clock of the day, whose own last digit it is
    for column, written in kind.make(SMALL).columns().items():
        rtol, atol = (4e-16, 1e-15) if column != "time" else (2e-15, 1e-15 + np.spacing(far))
        np.testing.assert_allclose(getattr(record, column), written, rtol=rtol, atol=atol)


@pytest.mark.parametrize("name", TEXTS)
def test_broken_variants(tmp_path, name):
    kind = ALL[name]
    made, outcomes = kind.make(SMALL), {}
    for mutation in (each for each in TEXT if TEXT[each].oracle != "any"):
        data = TEXT[mutation].change(made.data, random.Random(0))
        path = put(tmp_path, kind, data)
        outcomes[mutation] = run_reader_fuzz.judge(path, kind, made, [TEXT[mutation]], data)
    assert [(mutation, end) for mutation, end in outcomes.items() if end.startswith("WRONG")] == []


def test_broken_and_drawn_logs_hold_no_defect(capsys):
    outcomes = run_reader_fuzz.main(count=90, first=10**6, draws=40)
    assert outcomes["WRONG"] == 0, capsys.readouterr().out
    assert min(outcomes[o] for o in ("read as written", "read with a warning", "refused")) > 9


@pytest.mark.parametrize("name", [name for name in TEXTS if name != "bare tab"])
def test_chosen_channels_are_those_of_the_whole_log(tmp_path, name):
    kind = ALL[name]
    path = put(tmp_path, kind, kind.make(rows(600)).data)
    whole, few = read_log(path, **kind.options), read_log(path, channels=(), **kind.options)
    for column in ("time", "normal_force", "friction_force"):
        np.testing.assert_array_equal(getattr(few, column), getattr(whole, column))
    if whole.channels:
        one = next(iter(whole.channels))
        assert one in read_log(path, channels=(one,), **kind.options).channels


def test_gigabytes_of_zeros_are_refused_before_memory_goes(tmp_path):
    path = tmp_path / "bomb.txt.gz"
    path.write_bytes(gzip.compress(bytes(1 << 24), 6) * 10)  # 160 MiB
    before, begun = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    with pytest.raises(LogError, match="100 times"):
        read_log(path)
    head = gzip.compress(b"T,Fx,Fz\ns,N,N\n" + b"0.1,2,3\n" * 100)
    path.write_bytes(head + path.read_bytes())
    with pytest.raises(LogError, match=r"zero bytes|100 times"):
        read_log(path)
    path.write_bytes(gzip.compress(b"T,Fx,Fz\ns,N,N\n") + gzip.compress(b"0,1,2\n" * (1 << 20), 6) * 10)
    with pytest.raises(LogError, match="100 times"):
        read_log(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 400_000  # KiB
    assert time.process_time() - begun < 20


def test_a_line_without_end_is_refused(tmp_path):
    (tmp_path / "log.txt").write_bytes(b"T,Fx,Fz\ns,N,N\n0,1,2\n" + b"7" * (1 << 22))
    with pytest.raises(LogError, match="no line ends within a MiB below line"):
        read_log(tmp_path / "log.txt")


def test_an_archive_names_its_members(tmp_path):
    kind = ALL["nano"]
    path = tmp_path / "logs.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("slow.txt", kind.make(rows(40)).data)
        archive.writestr("fast.txt", kind.make(rows(50)).data)
    with pytest.raises(LogError, match=r"2 files \(slow.txt, fast.txt\)"):
        read_log(path)
    assert len(read_log(path / "fast.txt")) == 50
    with pytest.raises(LogError, match=r"no 'other.txt'"):
        read_log(path / "other.txt")
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(LogError):
        read_log(path)


STROKE = """Run # 1
Step No. 1
Data Count = 3
{started}
T,Fx,Fz
sec,N,N
0.00,{a},2
0.01,{a},2
0.02,{a},2
"""


def series(folder, names, started=True):
    for k, name in enumerate(names):
        line = f"Started at: 10:00:{10 * k:02d}.500 12 May 2022" if started else ""
        (folder / name).write_text(STROKE.format(started=line, a=k + 1))


@pytest.mark.parametrize("started", [True, False])
def test_a_series_of_files_is_one_test(tmp_path, started):
    series(tmp_path, ["s_8.txt", "s_9.txt", "s_10.txt"], started)
    record = read_log(tmp_path / "s_*.txt")
    assert record.friction_force.tolist() == [1, 1, 1, 2, 2, 2, 3, 3, 3]
    assert [(s.number, s.parameters["file"]) for s in record.steps] == [(1, "s_8.txt"), (2, "s_9.txt"), (3, "s_10.txt")]
    assert record.time[3] == pytest.approx(10.0 if started else 0.03)
    assert ("step_gap_unknown" in codes(record)) != started and "joined_files" in codes(record, "info")
    assert len(read_log(tmp_path, step=2)) == 3


def test_files_that_may_be_several_tests_are_not_joined(tmp_path):
    series(tmp_path, ["k168_v42.txt", "k168_v1100.txt"], started=False)
    with pytest.raises(LogError, match="neither say when they were started nor count up"):
        read_log(tmp_path)
    with pytest.raises(LogError, match="no file fits"):
        read_log(tmp_path / "x*.txt")


@pytest.mark.parametrize("name", [name for name in TEXTS if name not in run_reader_fuzz.FIXED])
def test_the_order_of_columns_does_not_matter(tmp_path, name):
    kind = ALL[name]
    made = kind.make(SMALL)
    data = ORDER.change(made.data, random.Random(1))
    assert (data == made.data) == (name == "blanks")
    path = put(tmp_path, kind, data)
    assert run_reader_fuzz.judge(path, kind, made, [ORDER], data) == "read as written"
