"""Words arrive as UTF-8 whatever the console says of itself, and exit codes do not depend on who listens."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from data_io import read_log
from identify.cli import main as cli

ROOT = Path(__file__).parents[2]
PLAIN = ROOT / "tests/cases/plain.csv"
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}


def command(*words, shell):
    """Run `stickslip` with what a shell puts behind it; returns the finished process."""
    run = ["bash", "-c", f'"$@" {shell}', "bash", sys.executable, "-m", "identify", *words]
    return subprocess.run(run, capture_output=True, env=ENVIRONMENT, timeout=60, check=False)


def shown(monkeypatch, *words, encoding):
    """What a console of that encoding shows of a command in this process."""
    console = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", console)
    assert cli.main([str(word) for word in words]) == 0
    return console.buffer.getvalue().decode("utf-8")


def test_a_minus_sign_is_never_lost(monkeypatch):
    told = shown(monkeypatch, "inspect", PLAIN, encoding="cp1252")
    (line,) = (text for text in told.split("\n") if "normal force drift" in text)
    assert "−" in line and "?" not in line
    document = json.loads(shown(monkeypatch, "inspect", PLAIN, "--json", encoding="ascii"))
    assert document["status"] == "done"


@pytest.mark.parametrize(
    ("word", "code", "closed"),
    [("--version", 0, "2>&1 | true"), ("inspect", 2, "<&- >&- 2>&-"), ("inspect", 2, "2>/dev/full")],
)
def test_exit_code_is_that_of_the_work_whoever_listens(word, code, closed):
    """Of the two commands that are the quickest to start: one that answers, one that is refused."""
    done = command(word, shell=f"{closed}; exit ${{PIPESTATUS[0]}}")
    assert done.returncode == code
    assert b"Traceback" not in done.stderr and b"Exception ignored" not in done.stderr


def test_full_disk_behind_standard_output_is_an_error_in_words():
    done = command("--version", shell=">/dev/full; exit ${PIPESTATUS[0]}")
    assert done.returncode == 2
    assert done.stderr.decode().startswith("stickslip: ") and done.stderr.count(b"\n") == 1


def test_file_that_is_read_does_not_take_the_place_of_a_closed_output(tmp_path):
    out = tmp_path / "log.h5"
    assert command("convert", str(PLAIN), "--out", str(out), shell="<&- >&- 2>&-").returncode == 0
    assert read_log(out).time.size == read_log(PLAIN).time.size


def test_help_is_quick_and_brings_no_casadi():
    script = "import sys, identify.cli.main as m; m.build_parser().format_help()"
    script += "; print('casadi' in sys.modules, 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False False"
