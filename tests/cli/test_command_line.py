"""The command line: exit codes, one sentence per error, JSON on standard output, help for whoever mistypes."""

import json
from pathlib import Path

import pytest

from identify import examples
from identify.cli.common import Answer
from tests.support.command import refused, stickslip

LOG = examples.FOLDER / "5_mm_per_s.txt.gz"
RIG = ["--set", "rig.drive_speed=1 mm/s", "--set", "rig.normal_force=1 N"]
SIMULATE = ["simulate", "--scene", examples.SCENE, *RIG, "--out", "a.csv"]
NO_RESULT = {"schema": 1, "status": "converged", "parameters": {}, "logs": [], "provenance": {"scene": {}}}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fitt"], "invalid choice: 'fitt'"),
        (["fit"], "--scene"),
        (["fit", "--scene", "none.toml"], "none.toml: no such scene file"),
        (["fit", "--scene", examples.SCENE, "--set", "rig.mas=1"], "'mass'"),
        (["fit", "--scene", examples.SCENE, "--set", "rig.mass=-1 kg"], "mass is -1 kg"),
        (["fit", "--scene", examples.SCENE, "--columns", "time"], "--columns time=T"),
        ([*SIMULATE[:-1], "a.txt", "--duration", "1", "--rate", "9"], ".csv or .h5"),
        ([*SIMULATE, "--duration", "1e8", "--rate", "1e6"], "1e+14 samples"),
        (["fit", "none.csv", "--scene", examples.SCENE], "none.csv: there is no such log"),
        (["fit", "--scene", examples.SCENE, "--out", f"{__file__}/a/b"], "which is a file"),
        (["fit", "--scene", "x.toml", "--acc", "tight"], "unrecognized arguments: --acc"),
        (["stability", "--scene", examples.SCENE, "--at", "stifness=3"], "'stiffness'"),
        (["stability", "--result", "none.json"], "no such file"),
        (["inspect", examples.FOLDER / "1_mm_per_s.txt.gz", "--run", "3"], "run 3 was asked for"),
        (["stability", "--scene", examples.SCENE, "--at", "mass=-1 kg"], "--at mass=-1 kg: mass is -1 kg"),
        (["stability", "--scene", examples.SCENE, "--at", "drive_speed=-1 mm/s"], "--at drive_speed is -0.001 m/s"),
        (["amplitude", "--scene", examples.SCENE, "--at", "mu_k0=0.9"], "--at mu_k0=0.9: mu_k0 = 0.9 is above mu_s"),
        (["amplitude", "--result", "."], "this is a folder"),
        (["figures", "none.toml"], "none.toml: expected the folder of a fit, or its result.json"),
        (["plan", "."], "this is a folder; give the result.json in it"),
    ],
)
def test_wrong_command_lines(folder, capsys, arguments, words):
    assert words in refused(capsys, *arguments)
    assert not list(folder.iterdir())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 100_000, "not JSON"),
        (bytes(range(256)), "not JSON"),
        (json.dumps({**NO_RESULT, "provenance": {}}), "no result"),
        (json.dumps({**NO_RESULT, "parameters": {"a": {}}}), "no result"),
        (json.dumps({**NO_RESULT, "logs": [{"sha256": "0"}]}), "no result"),
        (json.dumps(NO_RESULT), "the scene recorded there: the scene has no effects"),
    ],
)
def test_what_is_no_result_is_refused(folder, capsys, text, words):
    name = "result.json"
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    for command in (["verify", name], ["stability", "--result", name], ["amplitude", "--result", name]):
        assert words in refused(capsys, *command)


def test_version_and_help_are_documents_too(folder, capsys):
    code, out, words = stickslip(capsys, "--version", "--json")
    assert code == 0 and json.loads(out)["version"] in words
    code, out, words = stickslip(capsys, "fit", "--help", "--json")
    assert code == 0 and json.loads(out)["status"] == "done" and "--scene" in words
    code, out, _ = stickslip(capsys, "--help")
    assert code == 0 and "first steps" in out


def test_a_defect_is_exit_code_1_without_traceback(folder, capsys, work):
    def broken(arguments, terminal):
        raise ZeroDivisionError("by zero")

    work(broken)
    code, out, err = stickslip(capsys, "fit", "--scene", "x", "--json")
    assert code == 1 and "Traceback" not in err and "defect of ours" in json.loads(out)["message"]
    code, out, err = stickslip(capsys, "fit", "--scene", "x", "--debug")
    assert code == 1 and "Traceback" in err


@pytest.mark.parametrize("command", ["fit", "stability"])
def test_a_log_given_as_a_scene_is_recognised_and_the_advice_gets_further(command, folder, capsys):
    said = refused(capsys, command, "--scene", LOG)
    assert "this is a log, not a scene; write a scene from it with: stickslip scene" in said
    Path("broken.toml").write_text("[rig\nmass = 1")
    assert "not valid TOML" in refused(capsys, command, "--scene", "broken.toml")
    assert stickslip(capsys, "scene", LOG, "--out", "scene.toml")[0] == 0
    assert "still to fill in" in refused(capsys, command, "--scene", "scene.toml")


def test_quiet_says_the_answer_alone_and_verbose_the_seconds(work, capsys):
    def run(_arguments, terminal):
        with terminal.bar() as progress:
            progress("reading", 0.1)
        terminal.say("the answer")
        return Answer()

    work(run)
    styles = ([], ["--quiet"], ["--verbose"], ["--progress", "json"])
    ends = [stickslip(capsys, "fit", "--scene", "x", *style) for style in styles]
    assert [end[:2] for end in ends] == [(0, "the answer\n")] * 4
    assert [end[2] for end in ends[:2]] == ["reading\n", ""] and ends[2][2].split()[1:] == ["s", "reading"]
    line = json.loads(ends[3][2])
    assert set(line) == {"stage", "share", "seconds"} and line["stage"] == "reading"
    assert "--scene" in stickslip(capsys, "fit", "--quiet")[2], "an error is said all the same"
