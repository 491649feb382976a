"""Ctrl-C and SIGTERM end a command within two seconds, whatever it is at; nothing half-written stays."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from identify.cli import interrupt

ROOT = Path(__file__).resolve().parents[2]
DEAF = """
import sys, time
from pathlib import Path
from identify.cli import main as cli, fit
from identify.cli import interrupt
from identify.cli.folder import result_folder

def run(arguments, terminal):
    with result_folder(Path("out")) as fresh:
        (fresh / "result.json").write_text("half")
        {before}
        print("working", file=sys.stderr, flush=True)
        until = time.monotonic() + {seconds}
        while time.monotonic() < until:  # as a solver that takes an interrupt for a failed evaluation
            try:
                time.sleep(0.01)
            except KeyboardInterrupt:
                pass

fit.run = run
sys.argv = ["stickslip", "fit", "--scene", "x", *sys.argv[1:]]
raise SystemExit(cli.main())
"""


def stopped(folder, number, *arguments, before="pass", seconds=60.0):
    """Exit code, output, words and seconds of a deaf command that was sent a signal."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    script = DEAF.format(before=before, seconds=seconds)
    process = subprocess.Popen(
        [sys.executable, "-c", script, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment,
        cwd=folder,
        text=True,
    )
    assert process.stderr is not None and process.stderr.readline() == "working\n"
    assert list(folder.iterdir()) != []
    began = time.monotonic()
    process.send_signal(number)
    out, words = process.communicate(timeout=30)
    return process.returncode, out, words, time.monotonic() - began


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_command_that_does_not_listen_is_ended(tmp_path, number):
    code, out, words, took = stopped(tmp_path, number)
    assert (code, out) == (130, "") and words == "stickslip: interrupted; no half-written result is left behind\n"
    assert took < 2.0 and list(tmp_path.iterdir()) == []


def test_the_document_is_printed_all_the_same(tmp_path):
    code, out, _, _ = stopped(tmp_path, signal.SIGTERM, "--json")
    assert code == 130 and json.loads(out)["status"] == "error"


def test_a_command_that_has_to_put_things_in_order_may_take_its_time(tmp_path):
    longer = interrupt.GRACE + 1.0
    code, _, _, took = stopped(tmp_path, signal.SIGINT, before="interrupt.ends_by_itself()", seconds=longer)
    assert code == 130 and took > interrupt.GRACE and list(tmp_path.iterdir()) == []
