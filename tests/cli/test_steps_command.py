"""`stickslip steps`: every option of a log means there what it means elsewhere."""

import json

import pytest

from data_io import LogError, list_steps
from identify.cli import main as cli

STEP = "T,Fx\ns,N\n" + "".join(f"{0.01 * i:.2f},{0.3 + 0.001 * (i % 7)}\n" for i in range(20))


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "two.csv"
    path.write_text(STEP + STEP)
    return str(path)


def _listed(capsys, *arguments):
    code = cli.main(["steps", *arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_the_steps_are_listed_and_one_is_chosen(log, capsys):
    code, document = _listed(capsys, log)
    assert code == 0 and [step["step"] for step in document["logs"][0]["steps"]] == [1, 2]
    code, document = _listed(capsys, log, "--step", "2", "--run", "1")
    assert code == 0 and [step["step"] for step in document["logs"][0]["steps"]] == [2]
    assert "normal_force_N" not in document["logs"][0]


def test_a_step_that_is_not_there_is_refused(log, capsys):
    code, document = _listed(capsys, log, "--step", "3")
    assert code == 2
    assert "step 3 was asked for; the log holds step 1 of run 1, step 2 of run 1; choose one" in document["message"]
    with pytest.raises(LogError, match="step 1 of run 4 was asked for"):
        list_steps(log, step=1, run=4)


def test_the_load_that_is_given_is_told_and_checked(log, capsys):
    code, document = _listed(capsys, log, "--normal-force", "300 gf")
    assert code == 0 and document["logs"][0]["normal_force_N"] == pytest.approx(2.94, abs=0.01)
    assert cli.main(["steps", log, "--normal-force", "3 N"]) == 0
    assert "two.csv, under 3 N as given" in capsys.readouterr().out.replace("\N{NO-BREAK SPACE}", " ")
    assert _listed(capsys, log, "--normal-force", "3 s")[0] == 2
    with pytest.raises(LogError, match="above 0 N"):
        list_steps(log, normal_force=-1.0)


def test_columns_and_units_are_taken(log, capsys):
    code, document = _listed(capsys, log, "--columns", "time=T", "--units", "time=ms")
    assert code == 0 and document["logs"][0]["steps"][0]["duration_s"] == pytest.approx(0.19e-3)
