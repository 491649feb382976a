"""Every command that writes, on a disk that fills at some byte: exit code 2, one sentence, and no half file.

The system lets no file grow beyond a limit here, which fails as a full disk does: in the middle of a write.
"""

import resource
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from data_io import Record, write_csv
from experiments.batch_trials import SCENE as PAIR
from identify.cli import main as cli
from tests.support.fake_fit import fake_fit

SCENE = PAIR + 'drive_speed = "0.5 mm/s"\nnormal_force = "2 N"\n'
SHARES = (0.0, 0.3, 0.97)  # of the largest file that a command writes
LONG = ("plan", "plot", "simulate")  # commands that are tried at one share only


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


@pytest.fixture
def case(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)
    time = np.arange(4000) / 200.0
    random = np.random.default_rng(0)
    force = 0.8 + 0.4 * ((time / 0.5) % 1.0) + 0.002 * random.standard_normal(time.size)
    write_csv(Record(time, np.full(time.size, 2.0), force), Path("log.csv"))
    return tmp_path


def files(folder):
    return {path for path in folder.rglob("*") if path.is_file() and path.name != ".lock"}


COMMANDS = {
    "convert": ["convert", "log.csv", "--out", "new.h5"],
    "anonymise": ["convert", "log.csv", "--anonymise", "--out", "new.h5"],
    "simulate": ["simulate", "--scene", "scene.toml", "--duration", "5 s", "--rate", "200 Hz", "--out", "new.csv"],
    "scene": ["scene", "log.csv", "--out", "new.toml"],
    "plot": ["inspect", "log.csv", "--plot", "new.svg"],
    "plan": ["plan", "scene.toml", "--out", "new.csv", "--speed", "0.5 mm/s"],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_what_a_command_writes_is_whole_or_not_there(case, capsys, name):
    before = files(case)
    assert cli.main([*COMMANDS[name], "--quiet"]) == 0
    made = files(case) - before
    largest = max(path.stat().st_size for path in made)
    for path in made:
        path.unlink()
    capsys.readouterr()
    for share in SHARES[1:2] if name in LONG else SHARES:
        with no_file_larger_than(share * largest):
            assert cli.main([*COMMANDS[name], "--quiet"]) == 2
        _, words = capsys.readouterr()
        assert words.count("\n") == 1 and "too large" in words and "new" in words
        assert files(case) == before


def test_a_fit_leaves_no_half_report(case, capsys, monkeypatch):
    monkeypatch.setattr("identify.cli.fit.fit", lambda *_, **__: fake_fit(400, 1))
    Path("fit.toml").write_text(SCENE + '[[logs]]\npath = "log.csv"\n')
    before = files(case)
    capsys.readouterr()
    with no_file_larger_than(30_000):  # as the page is, and some figures
        assert cli.main(["fit", "--scene", "fit.toml", "--out", "new", "--quiet"]) == 2
    _, words = capsys.readouterr()
    assert words.count("\n") == 1 and "too large" in words and files(case) == before
