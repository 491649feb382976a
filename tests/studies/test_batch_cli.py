"""`stickslip batch` from manifest to page with real fits, and what it refuses."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from data_io import Record, write_csv
from experiments.batch_trials import SCENE, write_case
from experiments.study_problem import DEMO, RIG
from identify.base.budget import time_limit
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run
from identify.studies.batch_store import complete, ended
from identify.studies.planning import plan
from identify.studies.workers import make
from tests.support.command import refused, stickslip

HELD = "[parameters]\n" + "".join(
    f"{name} = {{ fixed = {DEMO[name]} }}\n" for name in ("a", "D", "t_cr")
)  # quick to fit
LOGS = (("fast.csv", 1e-3, 1.2), ("slow.csv", 5e-4, 1.8))  # name, drive speed [m/s], duration [s]


@pytest.fixture(scope="module")
def batched(tmp_path_factory):
    """A finished batch: a good group of two logs, a file of garbage, a log that only slides; and its answer."""
    home = tmp_path_factory.mktemp("Proben über Haut")
    for seed, (name, speed, duration) in enumerate(LOGS):
        time = np.arange(int(duration * 500) + 1) / 500
        force = run(assemble(MAIN), DEMO | RIG, speed, 1.0, duration).sample(time)["force"]
        noisy = force + 5e-3 * np.random.default_rng(seed).standard_normal(time.size)
        write_csv(Record(time, np.ones(time.size), noisy), home / name)
    (home / "bad.csv").write_bytes(bytes(range(256)) * 9)
    flat = "".join(f"{i / 100},1,{0.1 + 0.001 * i}\n" for i in range(300))
    (home / "flat.csv").write_text("T,Fz,Fx\ns,N,N\n" + flat)
    (home / "scene.toml").write_text(SCENE + HELD)
    (home / "m.csv").write_text(
        "path,group,drive_speed,material\nfast.csv,good,1 mm/s,=skin\nslow.csv,good,0.5 mm/s,=skin\n"
        "bad.csv,bad,1 mm/s,skin\nflat.csv,flat,1 mm/s,skin\n"
    )
    command = ["-c", "from identify.cli.main import main; import sys; raise SystemExit(main(sys.argv[1:]))"]
    arguments = ["batch", home / "m.csv", "--scene", home / "scene.toml", "--out", home / "out", "--jobs", 1, "--json"]
    done = subprocess.run(
        [sys.executable, *command, *map(str, arguments)], capture_output=True, check=False, timeout=300
    )
    return home, done.returncode, json.loads(done.stdout), done.stderr.decode()


def test_a_fit_that_the_limit_of_its_batch_ends_is_tried_again(batched, tmp_path, monkeypatch):
    home = batched[0]
    monkeypatch.setattr("identify.report.figures.pictures", lambda _: ())
    job = next(job for job in plan(home / "m.csv", home / "scene.toml").jobs if job.group == "good")
    with time_limit(0.0):
        end = make(job, tmp_path / job.folder)
    assert end.limited and complete(tmp_path / job.folder) is not None and ended(tmp_path, job) is None
    assert ended(home / "out", job) is not None, "negative control: within its limit"


def test_a_batch_keeps_what_is_good_and_says_why_the_rest_is_not(batched):
    home, code, answer, words = batched
    assert code == 3 and answer["schema"] == 1 and answer["status"] == "failures"
    ends = {group: end["status"] for group, end in answer["groups"].items()}
    assert ends == {"good": "converged", "bad": "failed", "flat": "no_cycles"}
    assert "bad.csv" in answer["groups"]["bad"]["message"] and "Traceback" not in words
    assert "3/3" in words
    names = {item.name for item in (home / "out" / "good").iterdir()}
    files = {"job.json", "result.json", "report.html", "result.h5", "classical.csv", "parameters.tex"}
    assert names == {*files, "figures"}
    assert {item.name for item in (home / "out" / "bad").iterdir()} == {"job.json"}
    assert (home / "out" / "report.html").stat().st_size > 1000
    result = json.loads((home / "out" / "good" / "result.json").read_text())
    assert (
        abs(result["parameters"]["mu_s"]["value"] - DEMO["mu_s"]) < 4 * result["parameters"]["mu_s"]["standard_error"]
    )
    assert [log["labels"] for log in result["logs"]] == [{"material": "=skin"}] * 2
    assert result["provenance"]["batch"]["group"] == "good" and result["provenance"]["machine"]["host"]
    assert "'=skin" in (home / "out" / "index.csv").read_text()


def test_a_batch_begun_again_refits_nothing(batched, folder, capsys):
    home = batched[0]
    asked = ["batch", home / "m.csv", "--scene", home / "scene.toml", "--out", home / "out"]
    assert "--resume" in refused(capsys, *asked)
    code, out, _ = stickslip(capsys, *asked, "--resume", "--json")
    assert code == 3 and json.loads(out)["kept"] == 3


def test_every_complaint_is_told_and_nothing_is_begun(folder, capsys):
    case = write_case(folder, ["G1"])
    case[0].write_text(
        "path,group,drive_speed,rig.mass\nlog_0_0.csv,G1,1 mm/s,-1 kg\nlog_0_0.csv,G2,,\nnone.csv,G1,,\n"
    )
    asked = ["batch", case[0], "--scene", case[1], "--out", "out"]
    code, out, words = stickslip(capsys, *asked, "--json")
    document = json.loads(out)
    assert code == 2 and document["status"] == "error" and len(document["errors"]) == 3 and "Traceback" not in words
    case[0].write_text("path,drive_speed\nlog_0_0.csv,1 mm/s\n")
    for more, sentence in (
        (["--jobs", 0], "--jobs is 0"),
        (["--time-limit", "0 s"], "--time-limit is 0"),
        (["--time-limit", "3 mm"], "--time-limit"),
        (["--scheduler", "tcp://nowhere", "--jobs", 2], "drop --scheduler"),
    ):
        assert sentence in refused(capsys, *asked, *more)
    code, _, words = stickslip(capsys, *asked, "--set", "rig.mas=1")
    assert code == 2 and "did you mean 'mass'" in words
    assert not Path("out").exists()
