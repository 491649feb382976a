"""Ctrl-C and SIGTERM end a command within two seconds, whatever it is at; an output folder is replaced whole."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from identify.cli import interrupt
from identify.cli.arguments import check_replaceable, result_folder
from identify.cli.common import Answer, CommandLineError
from tests.support.command import stickslip

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


DEAF = """
import sys, time
from pathlib import Path
from identify.cli import main as cli, fit
from identify.cli import interrupt
from identify.cli.arguments import result_folder

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

fit.fit_logs = run
sys.argv = ["stickslip", "fit", "--scene", "x", *sys.argv[1:]]
raise SystemExit(cli.main())
"""


def stopped(folder, number, *arguments, before="pass", seconds=60.0):
    """Exit code, output, words and seconds of a deaf command that was sent a signal."""
    script = DEAF.format(before=before, seconds=seconds)
    process = subprocess.Popen(
        [sys.executable, "-c", script, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=ENVIRONMENT,
        cwd=folder,
        text=True,
    )
    assert process.stderr is not None and process.stderr.readline() == "working\n"
    assert list(folder.iterdir()) != []
    began = time.monotonic()
    process.send_signal(number)
    out, words = process.communicate(timeout=30)
    return process.returncode, out, words, time.monotonic() - began


def test_a_command_that_does_not_listen_is_ended(tmp_path):
    code, out, words, took = stopped(tmp_path, signal.SIGTERM, "--json")
    assert code == 130 and words == "stickslip: interrupted; no half-written result is left behind\n"
    assert json.loads(out)["status"] == "error"
    assert took < 2.0 and list(tmp_path.iterdir()) == []


def test_a_command_that_has_to_put_things_in_order_may_take_its_time(tmp_path):
    longer = interrupt.GRACE + 1.0
    code, _, _, took = stopped(tmp_path, signal.SIGINT, before="interrupt.ends_by_itself()", seconds=longer)
    assert code == 130 and took > interrupt.GRACE and list(tmp_path.iterdir()) == []


def test_an_interruption_that_a_solver_swallows_still_ends_the_command(folder, capsys, work):
    def swallowing(arguments, terminal):
        with terminal.bar() as progress, result_folder(folder / "out") as fresh:
            (fresh / "result.json").write_text("{}")
            with contextlib.suppress(KeyboardInterrupt):  # as CasADi does
                os.kill(os.getpid(), signal.SIGINT)
            if arguments.set:
                progress("the next stage")
        return Answer()

    work(swallowing)
    for more in ([], ["--set", "rig.mass=1"]):
        code, _, words = stickslip(capsys, "fit", "--scene", "x", *more)
        assert code == 130 and "next stage" not in words and not list(folder.iterdir())
    work(lambda arguments, terminal: Answer())
    assert stickslip(capsys, "fit", "--scene", "x")[0] == 0, "it is forgotten with the next command"


def test_an_interruption_while_the_imports_come_in_is_one_sentence(folder):
    signalled = "import os, signal, time; os.kill(os.getpid(), signal.SIGINT); time.sleep(60)"
    (folder / "casadi.py").write_text(f"exec({signalled!r})")
    path = os.pathsep.join([str(folder), ENVIRONMENT["PYTHONPATH"]])
    command = [sys.executable, "-m", "identify", "fit", "--scene", "x"]
    done = subprocess.run(command, capture_output=True, text=True, env={**ENVIRONMENT, "PYTHONPATH": path})
    assert done.returncode == 130
    assert done.stderr == "stickslip: interrupted; no half-written result is left behind\n"


def result_in(path, text="{}"):
    path.mkdir()
    (path / "result.json").write_text('{"schema": 1, "status": "converged"}')
    (path / "report.html").write_text(text)
    return path


def test_a_result_of_ours_is_replaced_whole(folder):
    out = result_in(folder / "out", "old")
    (out / "figures").mkdir()
    with result_folder(out) as fresh:
        (fresh / "report.html").write_text("new")
        assert (out / "report.html").read_text() == "old", "until all is written"
    assert [item.name for item in out.iterdir()] == ["report.html"]
    assert list(folder.iterdir()) == [out]


def test_what_another_command_wrote_meanwhile_is_not_replaced(folder):
    out = result_in(folder / "out", "old")
    with pytest.raises(CommandLineError, match=r"this result stands in .*out-2"), result_folder(out) as fresh:
        (fresh / "report.html").write_text("mine")
        with result_folder(out) as other:
            (other / "report.html").write_text("of the other")
            (other / "result.json").write_text('{"schema": 1, "status": "converged"}')
    assert (out / "report.html").read_text() == "of the other"
    assert (folder / "out-2" / "report.html").read_text() == "mine" and len(list(folder.iterdir())) == 2


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError, OSError])
def test_an_interruption_leaves_the_old_result(folder, error):
    out = result_in(folder / "out", "old")
    with pytest.raises(error), result_folder(out) as fresh:
        (fresh / "report.html").write_text("half")
        raise error
    assert (out / "report.html").read_text() == "old" and list(folder.iterdir()) == [out]


def test_what_is_not_ours_is_not_replaced(folder):
    strange = folder / "photos"
    strange.mkdir()
    (strange / "cat.png").write_text("")
    with pytest.raises(CommandLineError, match="no result of ours"):
        check_replaceable(strange)
    noted = result_in(folder / "out")
    (noted / "notes.txt").write_text("mine")
    with pytest.raises(CommandLineError, match=r"notes\.txt"):
        check_replaceable(noted)
    with pytest.raises(CommandLineError, match="is a file"):
        check_replaceable(noted / "notes.txt")
    with pytest.raises(CommandLineError, match="runs in"):
        check_replaceable(Path())
