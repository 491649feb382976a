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
        until, said = time.monotonic() + {seconds}, False
        while time.monotonic() < until:  # as a solver that takes an interrupt for a failed evaluation
            try:
                said = said or not print("working", file=sys.stderr, flush=True)
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


def test_what_a_solver_says_of_an_interrupt_is_not_shown(tmp_path):
    """A callback that raises is a failed evaluation to CasADi, which says so in words of its own."""
    solver = (
        "import casadi as ca\n"
        "        class Slow(ca.Callback):\n"
        "            def __init__(self):\n"
        "                ca.Callback.__init__(self); self.construct('slow', dict(enable_fd=True))\n"
        "            def eval(self, given):\n"
        "                print('working', file=sys.__stderr__, flush=True); time.sleep(5)\n"
        "                return given\n"
        "        x, slow = ca.MX.sym('x'), Slow()\n"
        "        options = {'ipopt.print_level': 0, 'ipopt.hessian_approximation': 'limited-memory'}\n"
        "        try:\n"
        "            ca.nlpsol('s', 'ipopt', {'x': x, 'f': slow(x)**2}, options)(x0=1.0)\n"
        "        except Exception: pass"
    )
    code, _, words, _ = stopped(tmp_path, signal.SIGINT, before=solver, seconds=0.0)
    assert code == 130 and "CasADi" not in words and "Traceback" not in words
    assert words.splitlines()[-1] == "stickslip: interrupted; no half-written result is left behind"
