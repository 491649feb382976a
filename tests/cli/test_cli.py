"""The command line: exit codes, one sentence per error, JSON on standard output, nothing half-written."""

import contextlib
import gzip
import json
import os
import re
import signal
import subprocess
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_io import Record, write_csv, write_hdf5
from identify import examples
from identify.cli import fit as fit_command
from identify.cli import main as cli
from identify.cli.common import Answer, CommandLineError
from identify.cli.folder import check_replaceable, result_folder, stamp
from identify.cli.progress import Progress
from identify.scene import Scene
from tests.support.command import refused, stickslip

RIG = ["--set", "rig.drive_speed=1 mm/s", "--set", "rig.normal_force=1 N"]
SIMULATE = ["simulate", "--scene", examples.SCENE, *RIG, "--out", "a.csv"]
LOG = "T,Fz,Fx\ns,N,N\n" + "".join(f"{0.01 * i:.2f},1.0,{0.3 + 0.001 * (i % 7)}\n" for i in range(200))


def simulated(capsys, path, *more):
    arguments = ["simulate", "--scene", examples.SCENE, *RIG, "--duration", "2", "--rate", "500", "--out", path, *more]
    code, out, err = stickslip(capsys, *arguments)
    assert code == 0, err
    return out


def test_simulated_logs_are_read_back(folder, capsys):
    from data_io import read_log

    words = simulated(capsys, "log.csv", "--noise", "5 mN", "--seed", "3")
    assert "1001 samples" in words
    simulated(capsys, "log.h5", "--noise", "0.005", "--seed", "3")
    simulated(capsys, "quiet.csv")
    noisy, same, quiet = read_log("log.csv"), read_log("log.h5"), read_log("quiet.csv")
    assert (noisy.friction_force == same.friction_force).all() and len(noisy) == 1001
    spread = (noisy.friction_force - quiet.friction_force).std()
    assert 0.0045 < spread < 0.0055
    assert noisy.drive_speed == 1e-3


@pytest.mark.parametrize("name", ["log.csv", "log.h5"])
def test_no_command_writes_over_a_log_that_is_there(folder, capsys, name):
    Path(name).write_text("measured")
    log = examples.FOLDER / "1_mm_per_s.txt.gz"
    commands = [["simulate", "--scene", examples.SCENE, *RIG, "--duration", "1", "--rate", "9"]]
    commands += [["convert", log], ["convert", log, examples.FOLDER / "5_mm_per_s.txt.gz"]] * name.endswith("h5")
    for command in commands:
        told = refused(capsys, *command, "--out", name)
        assert told == f"--out {name} exists and may hold a measured log; choose another name"
        assert Path(name).read_text() == "measured"


@pytest.mark.parametrize("name", ["log.csv", "log.h5"])
def test_a_simulated_log_is_written_over(folder, capsys, name):
    from data_io import read_log

    simulated(capsys, name)
    simulated(capsys, name, "--noise", "5 mN", "--seed", "3")
    assert read_log(name).metadata["seed"] == 3
    record = read_log(name)
    measured = replace(record, metadata={**record.metadata, "simulated": False})
    Path(name).unlink()
    (write_csv if name.endswith("csv") else write_hdf5)(measured, Path(name))
    assert "may hold a measured log" in refused(
        capsys, "simulate", "--scene", examples.SCENE, *RIG, "--duration", "1", "--rate", "9", "--out", name
    )


def test_json_is_one_document_and_words_go_to_standard_error(folder, capsys):
    code, out, err = stickslip(
        capsys,
        "simulate",
        "--scene",
        examples.SCENE,
        *RIG,
        "--duration",
        "1",
        "--rate",
        "100",
        "--out",
        "a.csv",
        "--json",
    )
    assert code == 0 and json.loads(out)["rows"] == 101 and "101 samples" in err


def test_converted_log_holds_the_same_numbers(folder, capsys):
    from data_io import read_log

    log = examples.FOLDER / "1_mm_per_s.txt.gz"
    assert stickslip(capsys, "convert", log, "--out", "a.h5")[0] == 0
    assert (read_log("a.h5").friction_force == read_log(log).friction_force).all()
    assert stickslip(capsys, "convert", log, "--out", "b.h5", "--anonymise")[0] == 0
    assert (read_log("b.h5").friction_force == read_log(log).friction_force).all()
    content = Path("b.h5").read_bytes()
    for word in (b"make_example_logs", b"Jan 2026", b"1_mm_per_s"):
        assert word in Path("a.h5").read_bytes() and word not in content


def write(name, text):
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return name


BAD_LOGS = {
    "missing": (None, "no such file"),
    "empty": ("", "empty"),
    "binary": (bytes(range(256)) * 40, "reader"),
    "no time": (LOG.replace("T,", "Q,"), "time"),
    "no force": (LOG.replace("Fx", "Q"), "friction"),
    "no units": (LOG.replace("s,N,N\n", ""), "unit"),
    "NaN block": (
        "\n".join(
            line if not 40 <= i < 60 else line.split(",")[0] + ",nan,nan" for i, line in enumerate(LOG.split("\n"))
        ),
        "rows",
    ),
    "clock backwards": (LOG.replace("\n1.00,", "\n0.50,"), "clock"),
    "one row": ("\n".join(LOG.split("\n")[:3]) + "\n", "row"),
}


@pytest.mark.parametrize("case", BAD_LOGS)
def test_bad_logs_are_refused_in_one_sentence(folder, capsys, case):
    content, word = BAD_LOGS[case]
    name = "log.csv" if content is None else write("log.csv", content)
    assert stickslip(capsys, "convert", write("good.csv", LOG), "--out", "good.h5")[0] == 0
    sentence = refused(capsys, "convert", name, "--out", "log.h5")
    assert word in sentence and name in sentence
    assert not Path("log.h5").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "no command was given"),
        (["fitt"], "invalid choice: 'fitt'"),
        (["fit"], "--scene"),
        (["fit", "--scene", "none.toml"], "none.toml: no such scene file"),
        (["fit", "--scene", examples.SCENE, "--set", "rig.mas=1"], "'mass'"),
        (["fit", "--scene", examples.SCENE, "--set", "rig.mass=-1 kg"], "mass is -1 kg"),
        (["fit", "--scene", examples.SCENE, "--set", "parameters.mu_s={start=99}"], "start of mu_s is 99"),
        (["fit", "--scene", examples.SCENE, "--columns", "time"], "--columns time=T"),
        (["fit", "--scene", examples.SCENE, "--normal-force", "3 mm"], "--normal-force"),
        (["fit", "--scene", examples.SCENE, "--step", "two"], "--step"),
        (
            ["simulate", "--scene", examples.SCENE, *RIG, "--duration", "1", "--rate", "9", "--out", "a.txt"],
            ".csv or .h5",
        ),
        (
            ["simulate", "--scene", examples.SCENE, *RIG, "--duration", "0", "--rate", "9", "--out", "a.csv"],
            "--duration",
        ),
        (["simulate", "--scene", examples.SCENE, *RIG, "--duration", "1", "--rate", "9 m", "--out", "a.csv"], "--rate"),
        (["simulate", "--scene", examples.SCENE, "--duration", "1", "--rate", "9", "--out", "a.csv"], "drive speed"),
        ([*SIMULATE, "--duration", "1e8", "--rate", "1e6"], "1e+14 samples"),
        ([*SIMULATE, "--duration", "1", "--rate", "0.1"], "1 sample;"),
        ([*SIMULATE, "--duration", "1", "--rate", "9", "--noise", "-1 N"], "--noise is -1 N"),
        ([*SIMULATE, "--duration", "1", "--rate", "9", "--seed", "-1"], "--seed is -1"),
        (["fit", "none.csv", "--scene", examples.SCENE], "none.csv: there is no such log"),
        (["fit", "--scene", examples.SCENE, "--set", "logs.2.path='none.csv'"], "none.csv: there is no such log"),
        (["fit", "--scene", examples.SCENE, "--out", f"{__file__}/a/b"], "which is a file"),
        (["fit", "--scene", examples.SCENE, "--out", "x" * 300], "too long"),
        (["fit", "--sce", examples.SCENE], "--scene"),
        (["inspect", examples.FOLDER / "1_mm_per_s.txt.gz", "--run", "3"], "run 3 was asked for"),
        (["fit", "--scene", examples.SCENE, "--run", "last"], "--run"),
        (["stability", "--scene", examples.SCENE, "--at", "mass=-1 kg"], "--at mass is -1"),
        (["stability", "--scene", examples.SCENE, "--at", "stiffness=0"], "--at stiffness is 0"),
        (["stability", "--scene", examples.SCENE, "--at", "drive_speed=-1 mm/s"], "--at drive_speed is -0.001 m/s"),
        (["stability", "--scene", examples.SCENE, "--at", "normal_force=-2 N"], "--at normal_force is -2 N"),
        (["amplitude", "--scene", examples.SCENE, "--at", "normal_force=0 N"], "--at normal_force is 0 N"),
        (["amplitude", "--scene", examples.SCENE, "--at", "mu_k0=0.9"], "mu_k0 is 0.9 here"),
        (["amplitude", "--scene", examples.SCENE, "--at", "delta_mu_k=-0.9"], "above 0"),
        (["amplitude", "--scene", examples.SCENE, "--plot", "none/a.png"], "folder does not exist"),
        (["amplitude", "--result", "."], "this is a folder"),
    ],
)
def test_wrong_command_lines(folder, capsys, arguments, words):
    assert words in refused(capsys, *arguments)
    assert not list(folder.iterdir())


@pytest.mark.parametrize("name", ["x" * 5000, "/".join(["some folder"] * 500)])
def test_a_long_path_is_shortened_in_the_sentence(folder, capsys, name):
    for command in (
        ["fit", "--scene", name],
        ["fit", "--scene", examples.SCENE, name],
        ["inspect", name],
        ["fit", "--scene", examples.SCENE, "--out", name],
        [*SIMULATE[:-1], f"{name}.csv", "--duration", "1", "--rate", "9"],
    ):
        told = refused(capsys, *command)
        assert len(told) < 500 and name[:50] in told and "…" in told


NO_RESULT = {"schema": 1, "status": "converged", "parameters": {}, "logs": [], "provenance": {"scene": {}}}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 100_000, "not JSON"),
        (bytes(range(256)), "not JSON"),
        ("3", "no result"),
        (json.dumps({**NO_RESULT, "provenance": {}}), "no result"),
        (json.dumps({**NO_RESULT, "parameters": 3}), "no result"),
        (json.dumps({**NO_RESULT, "parameters": {"a": {}}}), "no result"),
        (json.dumps({**NO_RESULT, "logs": [{}]}), "no result"),
        (json.dumps({**NO_RESULT, "logs": [{"sha256": "0"}]}), "no result"),
        (json.dumps({**NO_RESULT, "correlation": {"names": ["a"]}}), "no result"),
        (json.dumps(NO_RESULT), "the scene recorded there: the scene has no effects"),
    ],
)
def test_what_is_no_result_is_refused(folder, capsys, text, words):
    name = write("result.json", text)
    for command in (["verify", name], ["stability", "--result", name], ["amplitude", "--result", name]):
        assert words in refused(capsys, *command)


def test_version_and_help_are_documents_too(folder, capsys):
    code, out, words = stickslip(capsys, "--version", "--json")
    assert code == 0 and json.loads(out)["version"] in words
    code, out, words = stickslip(capsys, "fit", "--help", "--json")
    assert code == 0 and json.loads(out)["status"] == "done" and "--scene" in words
    code, out, _ = stickslip(capsys, "--help")
    assert code == 0 and "first steps" in out


def test_warnings_of_libraries_are_shown_to_developers_only(folder, capsys, monkeypatch):
    def warning(arguments, terminal):
        warnings.warn("overflow in square", RuntimeWarning, stacklevel=1)
        return Answer()

    monkeypatch.setattr(fit_command, "run", warning)
    assert stickslip(capsys, "fit", "--scene", "x") == (0, "", "")
    with pytest.warns(RuntimeWarning, match="overflow"):
        stickslip(capsys, "fit", "--scene", "x", "--debug")


def test_output_into_a_missing_folder(folder, capsys):
    assert "folder" in refused(capsys, "convert", write("log.csv", LOG), "--out", "none/log.h5")


def test_a_defect_is_exit_code_1_without_traceback(folder, capsys, monkeypatch):
    def broken(arguments, terminal):
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr(fit_command, "run", broken)
    code, out, err = stickslip(capsys, "fit", "--scene", "x", "--json")
    assert code == 1 and "Traceback" not in err and "defect of ours" in json.loads(out)["message"]
    code, out, err = stickslip(capsys, "fit", "--scene", "x", "--debug")
    assert code == 1 and "Traceback" in err


def test_interruption_is_exit_code_130(folder, capsys, monkeypatch):
    def interrupted(arguments, terminal):
        raise KeyboardInterrupt

    monkeypatch.setattr(fit_command, "run", interrupted)
    code, out, _ = stickslip(capsys, "fit", "--scene", "x", "--json")
    assert code == 130 and json.loads(out)["status"] == "error"


def test_an_interruption_that_a_solver_swallows_still_ends_the_command(folder, capsys, monkeypatch):
    def swallowing(arguments, terminal):
        with Progress(terminal.notes) as progress, result_folder(folder / "out") as fresh:
            (fresh / "result.json").write_text("{}")
            with contextlib.suppress(KeyboardInterrupt):  # as CasADi does
                os.kill(os.getpid(), signal.SIGINT)
            if arguments.set:
                progress("the next stage")
        return Answer()

    monkeypatch.setattr(fit_command, "run", swallowing)
    for more in ([], ["--set", "rig.mass=1"]):
        code, _, words = stickslip(capsys, "fit", "--scene", "x", *more)
        assert code == 130 and "next stage" not in words and not list(folder.iterdir())
    monkeypatch.setattr(fit_command, "run", lambda arguments, terminal: Answer())
    assert stickslip(capsys, "fit", "--scene", "x")[0] == 0, "it is forgotten with the next command"


def test_an_interruption_that_a_library_makes_an_error_of_is_still_one(folder, capsys, monkeypatch):
    def converting(arguments, terminal):
        try:
            os.kill(os.getpid(), signal.SIGTERM)
        except KeyboardInterrupt:
            raise SystemError("returned a result with an exception set") from None
        return Answer()

    monkeypatch.setattr(fit_command, "run", converting)
    code, out, _ = stickslip(capsys, "fit", "--scene", "x", "--json")
    assert code == 130 and "interrupted" in json.loads(out)["message"]


def test_an_interruption_of_the_garbage_collector_is_remembered_quietly(folder, capsys, monkeypatch):
    class Dying:
        def __del__(self):
            os.kill(os.getpid(), signal.SIGINT)

    def collecting(arguments, terminal):
        Dying()
        return Answer()

    monkeypatch.setattr(fit_command, "run", collecting)
    before = sys.unraisablehook
    code, _, words = stickslip(capsys, "fit", "--scene", "x")
    assert code == 130 and words.count("\n") == 1 and sys.unraisablehook is before


@pytest.mark.parametrize("work", ["{}", "exec({!r})"])
def test_an_interruption_while_the_imports_come_in_is_one_sentence(folder, work):
    signalled = "import os, signal, time; os.kill(os.getpid(), signal.SIGINT); time.sleep(60)"
    (folder / "casadi.py").write_text(work.format(signalled))
    path = os.pathsep.join([str(folder), environment()["PYTHONPATH"]])
    command = [sys.executable, "-m", "identify", "fit", "--scene", "x"]
    done = subprocess.run(command, capture_output=True, text=True, env={**environment(), "PYTHONPATH": path})
    assert done.returncode == 130
    assert done.stderr == "stickslip: interrupted; no half-written result is left behind\n"


def test_help_is_quick_and_brings_no_casadi():
    script = "import sys, identify.cli.main as m; m.build_parser().format_help()"
    script += "; print('casadi' in sys.modules, 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False False"


def test_only_a_log_of_text_brings_pandas(folder):
    time = np.arange(2000) / 1000
    record = Record(time, np.full(time.size, 1.0), np.sin(20 * time))
    write_hdf5(record, folder / "log.h5")
    write_csv(record, folder / "log.csv")
    script = "import sys; from data_io import read_log; read_log(sys.argv[1]); print('pandas' in sys.modules)"
    for name, brought in (("log.h5", "False"), ("log.csv", "True")):
        command = [sys.executable, "-c", script, str(folder / name)]
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment())
        assert done.stdout.strip() == brought, name


def test_a_reader_that_leaves_early_is_no_error(folder):
    process = subprocess.Popen(
        [sys.executable, "-m", "identify", "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment()
    )
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == b"" and process.wait(60) == 0


def environment():
    return {**os.environ, "PYTHONPATH": str(Path(cli.__file__).resolve().parents[2])}


# ---- inspect and scene


def test_inspect_tells_what_is_in_the_logs(folder, capsys):
    slow, stepped = examples.FOLDER / "0.1_mm_per_s.txt.gz", examples.FOLDER / "1_mm_per_s.txt.gz"
    code, words, _ = stickslip(capsys, "inspect", slow, stepped, "--plot", "logs.png")
    assert code == 0 and "5 stick-slip cycles" in words and "column Fx in g" in words
    assert Path("logs.png").stat().st_size > 10_000
    code, out, _ = stickslip(capsys, "inspect", slow, stepped, "--json")
    one, two = json.loads(out)["logs"]
    assert one["rows"] == 10001 and [step["cycles"] for step in two["steps"]] == [0, 13]
    assert one["steps"][0]["noise_N"] == pytest.approx(5e-3, rel=0.05)
    assert two["steps"][1]["stick_slope_N_per_s"][0] == pytest.approx(1470 * 1e-3, rel=0.02)
    assert max(len(line) for line in words.splitlines() if "/" not in line) <= 80


def test_a_first_scene_is_drafted_from_the_logs(folder, capsys):
    logs = sorted(examples.FOLDER.glob("*.txt.gz"))
    code, words, _ = stickslip(capsys, "scene", *logs, "--out", "pair.toml")
    assert code == 0 and "rig.mass, rig.zeta" in words
    sentence = refused(capsys, "fit", "--scene", "pair.toml")
    assert "still to fill in: rig.mass, rig.zeta" in sentence
    text = Path("pair.toml").read_text().replace("TODO kg", "0.2 kg").replace('zeta = "TODO"', 'damping = "147 N/m"')
    Path("pair.toml").write_text(text)
    scene = Scene.from_toml("pair.toml")
    assert scene.rig.stiffness == pytest.approx(1470, rel=0.01), "force per drive distance while it sticks"
    truth = json.loads(examples.TRUTH.read_text())["logs"]
    for entry in scene.logs:
        assert entry.drive_speed == pytest.approx(truth[entry.path.name]["drive_speed"], rel=1e-3)
        assert entry.path.resolve() == examples.FOLDER / entry.path.name
    steps = {entry.path.name: entry.step for entry in scene.logs if entry.step is not None}
    assert steps == {"1_mm_per_s.txt.gz": 2}, "the hold before the test is left out"


def test_a_first_scene_takes_a_rig_that_was_measured(folder, capsys):
    log = examples.FOLDER / "1_mm_per_s.txt.gz"
    Path("bench").mkdir()
    write("bench/rig.toml", 'mass = "0.2 kg"\nstiffness = "1470 N/m"\nzeta = 0.05\n')
    asked = ("scene", log, "--rig", "bench/rig.toml", "--out", "scenes.toml")
    code, words, _ = stickslip(capsys, *asked)
    assert code == 0 and "still to fill in" not in words
    scene = Scene.from_toml("scenes.toml")
    assert (scene.rig.mass, scene.rig.stiffness) == pytest.approx((0.2, 1470.0))
    Path("scenes.toml").unlink()
    assert "cannot be read" in refused(capsys, *asked[:3], "bench/none.toml", *asked[4:])
    write("other.toml", "effects = []\n")
    assert "is no file of a rig" in refused(capsys, *asked[:3], "other.toml", *asked[4:])
    assert not Path("scenes.toml").exists()


def test_what_a_log_does_not_tell_is_left_to_fill_in(folder, capsys):
    rise = (0.4 * (i % 50) / 50 for i in range(500))
    rows = "".join(f"{0.01 * i:.2f},{force:.5f}\n" for i, force in enumerate(rise))
    write("bare.csv", "T,Fx\ns,N\n" + rows)
    code, out, _ = stickslip(capsys, "scene", "bare.csv", "--normal-force", "2 N", "--out", "pair.toml", "--json")
    assert code == 0
    assert json.loads(out)["to_fill_in"] == ["rig.mass", "rig.stiffness", "rig.zeta", "logs.1.drive_speed"]
    assert 'normal_force = "2 N"' in Path("pair.toml").read_text()
    assert "exists" in refused(capsys, "scene", "bare.csv", "--normal-force", "2 N", "--out", "pair.toml")


def test_steps_too_short_to_stand_alone_are_no_logs(folder, capsys):
    step = "T,Fz,Fx\ns,N,N\n"
    rise = "".join(f"{0.01 * i:.2f},2,{0.4 * (i % 50) / 50:.5f}\n" for i in range(500))
    write("steps.csv", f"{step}0,2,0.1\n{step}{rise}")
    assert stickslip(capsys, "scene", "steps.csv", "--out", "pair.toml")[0] == 0
    text = Path("pair.toml").read_text()
    assert text.count("[[logs]]") == 1 and "step = 2" in text


def test_one_run_of_several_is_chosen(folder, capsys):
    text = gzip.decompress((examples.FOLDER / "1_mm_per_s.txt.gz").read_bytes()).decode()
    begin = text.index("Run # 1")
    write("runs.txt", text + text[begin:].replace("Run # 1", "Run # 2"))
    assert "--run" in refused(capsys, "inspect", "runs.txt")
    code, out, _ = stickslip(capsys, "inspect", "runs.txt", "--run", "2", "--json")
    assert code == 0 and [step["run"] for step in json.loads(out)["logs"][0]["steps"]] == [2, 2]
    assert stickslip(capsys, "scene", "runs.txt", "--run", "2", "--out", "pair.toml")[0] == 0
    text = Path("pair.toml").read_text().replace("TODO kg", "0.2 kg").replace('zeta = "TODO"', 'damping = "147 N/m"')
    (entry,) = Scene.from_toml(write("pair.toml", text)).logs
    assert (entry.run, entry.step) == (2, 2)


# ---- fit, and what is done with its result


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """The result folder of a fit of two example logs."""
    out = tmp_path_factory.mktemp("fit") / "Prüfstand 1"
    logs = ["1_mm_per_s.txt.gz", "0.1_mm_per_s.txt.gz"]
    assert cli.main(["fit", *logs, "--scene", str(examples.SCENE), "--out", str(out)]) == 0
    return out


def test_a_fit_leaves_its_folder_and_finds_the_truth(fitted):
    names = {item.name for item in fitted.iterdir()}
    assert names == {"result.json", "report.html", "result.h5", "figures", "classical.csv", "parameters.tex"}
    result = json.loads((fitted / "result.json").read_text())
    truth = json.loads(examples.TRUTH.read_text())["parameters"]
    for name, value in truth.items():
        entry = result["parameters"][name]
        assert entry["verdict"] == "identified" and abs(entry["value"] - value) < 4 * entry["standard_error"]


def test_a_report_unfolds_to_two_pages(fitted):
    page = (fitted / "report.html").read_text(encoding="utf-8")
    page = re.sub(r"<(script|style|svg)[\s\S]*?</\1>", "", page)
    whole, folded = page, r"<details(?![^>]* open)(?:(?!<details)[\s\S])*?</details>"
    while page != (page := re.sub(folded, "", page)):
        pass
    unfolded, everything = (len(re.sub(r"<[^>]+>", " ", text).split()) for text in (page, whole))
    assert unfolded < 1000 < 2000 < everything, "two logs: 1,200 words are the limit for four"
    assert "stick-slip ends above" in page and "Data quality" not in page.split("</nav>")[1]


def test_a_stored_fit_is_verified(fitted, folder, capsys):
    code, words, _ = stickslip(capsys, "verify", fitted / "result.json")
    assert code == 0 and "reproduced" in words
    stored = json.loads((fitted / "result.json").read_text())
    stored["parameters"]["mu_s"]["value"] *= 1.01
    stored["parameters"]["a"]["verdict"] = "weak"
    code, words, _ = stickslip(capsys, "verify", write("changed.json", json.dumps(stored)))
    assert code == 3 and "mu_s was" in words and "a was called weak" in words
    stored["logs"][0]["sha256"] = "0"
    assert "has changed" in refused(capsys, "verify", write("other.json", json.dumps(stored)))
    assert "no result" in refused(capsys, "verify", write("none.json", "{}"))


def test_calculators_carry_the_uncertainty_of_a_fit(fitted, folder, capsys):
    code, out, _ = stickslip(capsys, "amplitude", "--result", fitted / "result.json", "--json")
    drop = json.loads(out)["points"][1]["amplitude"]["drop"]
    assert code == 0 and drop["interval"][0] < drop["value"] < drop["interval"][1]
    assert drop["value"] == pytest.approx(0.523, rel=0.03), "as measured at 0.1 mm/s"


def test_a_point_that_no_log_tested_is_called_extrapolated(fitted, capsys):
    where = ("stability", "--result", fitted / "result.json", "--at")
    for at, said in (("drive_speed=0.5 m/s", True), ("stiffness=3 N/mm", True), ("drive_speed=0.5 mm/s", False)):
        code, words, _ = stickslip(capsys, *where, at)
        assert code == 0 and ("Extrapolated: the logs did not test a" in words) == said, at
    code, out, _ = stickslip(capsys, *where, "drive_speed=0.5 m/s", "--json")
    assert "drive speed of 500 mm/s" in json.loads(out)["points"][0]["extrapolated"]


def test_a_scene_that_lists_no_log_is_told_so(folder, capsys):
    rig = 'effects = ["inertia"]\n[rig]\nmass = 0.2\nstiffness = 1470\n'
    moving = write("moving.toml", f'{rig}drive_speed = "1 mm/s"\n')
    assert refused(capsys, "fit", "--scene", moving).startswith("moving.toml lists no log and none was given; name a")
    assert "there is no such log" in refused(capsys, "fit", "--scene", moving, "--set", 'logs=[{path="slow.csv"}]')
    assert "no drive speed" in refused(capsys, "fit", write("slow.csv", LOG), "--scene", write("rig.toml", rig))


def test_a_folder_without_logs_in_the_place_of_a_log_is_called_one(folder, capsys):
    (folder / "slow.csv").mkdir()
    scene = write("pair.toml", 'effects = ["inertia"]\n[rig]\nmass = 0.2\nstiffness = 1470\ndrive_speed = 1e-3\n')
    for more in (["slow.csv"], ["--set", 'logs=[{path="slow.csv"}]']):
        assert refused(capsys, "fit", *more, "--scene", scene).startswith("slow.csv is a folder that holds no log")


def test_a_log_without_cycles_is_reported_with_exit_code_3(folder, capsys):
    slow = ["--set", "rig.drive_speed=0.1 mm/s"]  # two seconds of it only load the spring
    simulated(capsys, "load.csv", *slow, "--noise", "5 mN")
    code, out, _ = stickslip(capsys, "fit", "load.csv", "--scene", examples.SCENE, *slow, "--out", "load", "--json")
    result = json.loads(out)
    assert code == 3 and result["status"] == "no_cycles" and "load.csv" in result["message"]
    assert len(Path("load/classical.csv").read_text().splitlines()) == 2 and Path("load/report.html").exists()


def test_a_log_that_slides_says_what_it_holds_and_leaves_a_report(folder, capsys, no_further_logs):
    fast = ["--set", "rig.drive_speed=50 mm/s"]
    simulated(capsys, "slide.csv", *fast, "--noise", "5 mN")
    entry = ["fit", "slide.csv", "--scene", examples.SCENE, *fast, "--out", "slide", "--json"]
    code, out, _ = stickslip(capsys, *entry)
    result = json.loads(out)
    assert code == 0 and result["status"] == "converged", result["message"]
    assert {found["verdict"] for found in result["parameters"].values()} <= {"not identifiable", "weak"}
    assert Path("slide/report.html").exists() and Path("slide/figures").exists()


# ---- calculators


def test_calculators_answer_for_each_log(folder, capsys):
    code, out, words = stickslip(capsys, "amplitude", "--scene", examples.SCENE, "--json")
    points = json.loads(out)["points"]
    speeds = [point["operating_point"]["drive_speed"]["value"] for point in points]
    assert code == 0 and speeds == pytest.approx([1e-4 / 60, 1e-4, 1e-3, 5e-3])
    words = " ".join(words.split())
    assert "assumed: mu_s, mu_k0, D, t_cr, delta_mu_k, a" in words
    assert "Over the ranges of what is assumed, at 0.1 mm/min and 0.935 N: the force falls by" in words


def test_an_operating_point_is_asked_for(folder, capsys):
    at = ["--at", "drive_speed=2 mm/s", "normal_force=1 N", "--at", "stiffness=2 N/mm"]  # in one option, or in several
    code, out, _ = stickslip(capsys, "stability", "--scene", examples.SCENE, *at, "--plot", "s.svg", "--json")
    (point,) = json.loads(out)["points"]
    assert code == 0 and Path("s.svg").read_text().startswith("<?xml")
    assert point["operating_point"]["drive_speed"]["value"] == 0.002
    assert point["groups"]["omega_n"]["value"] == pytest.approx((2000 / 0.2) ** 0.5)
    assert "'stiffness'" in refused(capsys, "stability", "--scene", examples.SCENE, "--at", "stifness=3")
    assert "KEY=VALUE" in refused(capsys, "stability", "--scene", examples.SCENE, "--at", "stiffness")
    assert "zero" in refused(capsys, "stability", "--scene", examples.SCENE, "--at", "drive_speed=0")
    assert ".png" in refused(capsys, "stability", "--scene", examples.SCENE, "--plot", "s.txt")
    assert "no such file" in refused(capsys, "stability", "--result", "none.json")


# ---- the output folder


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
    before = stamp(out)
    with result_folder(out) as other:
        (other / "report.html").write_text("of the other")
        (other / "result.json").write_text('{"schema": 1, "status": "converged"}')
    with (
        pytest.raises(CommandLineError, match=r"this result stands in .*out-2"),
        result_folder(out, since=before) as fresh,
    ):
        (fresh / "report.html").write_text("mine")
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


def test_a_place_that_takes_no_folder_is_refused_before_the_work(folder, monkeypatch):
    """Rights alone do not tell: a special or a full file system refuses, too."""
    check_replaceable(folder / "out")
    assert list(folder.iterdir()) == []

    def full(*_args, **_named):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("identify.cli.folder.tempfile.mkdtemp", full)
    with pytest.raises(CommandLineError, match="nothing may be written in"):
        check_replaceable(folder / "out")


def test_new_and_empty_folders_are_fine(folder):
    (folder / "empty").mkdir()
    for out in (folder / "empty", folder / "a" / "b ü"):
        with result_folder(out) as fresh:
            (fresh / "result.json").write_text("{}")
        assert (out / "result.json").exists()


def test_a_signal_takes_the_temporary_folder_away(folder):
    script = (
        "import time\nfrom pathlib import Path\nfrom identify.cli import main as cli, fit\n"
        "from identify.cli.folder import result_folder\n"
        "def run(arguments, terminal):\n"
        "    with result_folder(Path('out')) as fresh:\n"
        "        (fresh / 'result.json').write_text('half')\n"
        "        print('writing', flush=True)\n"
        "        time.sleep(60)\n"
        "fit.run = run\nraise SystemExit(cli.main(['fit', '--scene', 'x']))\n"
    )
    for number in (signal.SIGINT, signal.SIGTERM):
        process = subprocess.Popen(
            [sys.executable, "-c", script], stdout=subprocess.PIPE, env=environment(), cwd=folder
        )
        assert process.stdout is not None and process.stdout.readline() == b"writing\n"
        assert list(folder.iterdir()) != []
        started = time.monotonic()
        process.send_signal(number)
        assert process.wait(30) == 130 and time.monotonic() - started < 20
        process.stdout.close()
        assert list(folder.iterdir()) == []
