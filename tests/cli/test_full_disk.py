"""A disk that fills at any byte: one sentence, and neither a half file nor a crash of a library.

The system lets no file grow beyond a limit here, which fails as a full disk does: in the middle of a write.
"""

import resource
import sys
from contextlib import contextmanager

import numpy as np
import pytest

from data_io import LogError, Record, write_archive, write_csv, write_hdf5
from identify.cli.folder import result_folder
from identify.report import write_report
from tests.support.command import refused
from tests.support.fake_fit import fake_fit

SHARES = (0.0, 0.1, 0.5, 0.9, 0.999)  # of a file that fits; none of it reaches the disk then


@contextmanager
def no_file_larger_than(size):
    before, bytecode = resource.getrlimit(resource.RLIMIT_FSIZE), sys.dont_write_bytecode
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(size), before[1]))
    sys.dont_write_bytecode = True  # Python keeps what it could write of it
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.dont_write_bytecode = bytecode


def record():
    random, n = np.random.default_rng(2), 20_000
    return Record(
        time=1e-3 * np.arange(n), normal_force=2.0 + random.normal(0, 0.1, n), friction_force=random.normal(1, 0.1, n)
    )


def write_two(log, path):
    write_archive([log, log], path)


@pytest.mark.parametrize(("write", "name"), [(write_hdf5, "log.h5"), (write_two, "two.h5"), (write_csv, "log.csv")])
def test_a_log_is_written_whole_or_not_at_all(folder, write, name):
    log = record()
    write(log, folder / name)
    size = (folder / name).stat().st_size
    (folder / name).unlink()
    for share in SHARES:
        with no_file_larger_than(share * size), pytest.raises(LogError, match="cannot be written"):
            write(log, folder / name)
        assert list(folder.iterdir()) == []


def test_a_report_is_written_whole_or_not_at_all(folder):
    fit = fake_fit()
    write_report(fit, folder / "whole")
    sizes = sorted(path.stat().st_size for path in (folder / "whole").rglob("*") if path.is_file())
    for size in (sizes[0], sizes[-1]):
        with (
            no_file_larger_than(size - 1),
            pytest.raises(OSError, match="too large"),
            result_folder(folder / "out") as to,
        ):
            write_report(fit, to)
        assert [path.name for path in folder.iterdir()] == ["whole"]


def test_an_anonymous_log_is_not_left_without_its_key(folder, capsys, monkeypatch):
    write_csv(record(), folder / "log.csv")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("identify.cli.logs._write_key", full)
    sentence = refused(capsys, "convert", "log.csv", "--anonymise", "--out", "log.h5", "--quiet")
    assert "No space left" in sentence and [path.name for path in folder.iterdir()] == ["log.csv"]
