"""Every experiment still runs, in its fast form."""

import runpy
from pathlib import Path

import pytest

from experiments.judgement import judged

FOLDER = Path(__file__).resolve().parent.parent / "experiments"
WINDOWS = FOLDER / "run_window_study.py"  # run by tests/prediction/test_windows.py
FUZZ = FOLDER / "run_reader_fuzz.py"  # by tests/data_io/test_formats.py
# What these time, draw or recover is tested where it stands or in the acceptance table; they take 3 s and more.
LONG = ("batch_faults", "hostile_inputs", "skew_study", "work_precision")
SLOW = [FOLDER / f"run_{name}.py" for name in LONG]
SCRIPTS = sorted(set(FOLDER.glob("run_*.py")) - {WINDOWS, FUZZ, *SLOW})


@pytest.mark.parametrize(
    "script",
    [*SCRIPTS, *(pytest.param(script, marks=pytest.mark.slow) for script in SLOW)],
    ids=lambda path: path.stem,
)
def test_experiment_runs(script, capsys):
    runs(script, capsys)


def runs(script, capsys):
    runpy.run_path(str(script))["main"](fast=True)
    assert capsys.readouterr().out.strip(), "an experiment prints what it found"


def test_a_false_success_and_a_false_verdict_are_seen():
    """The rule of the acceptance table, on an answer made by hand: D is 1 % off, and then 50 %."""

    def line(value, verdict="identified"):
        told = {"value": value, "interval": [0.99 * value, 1.01 * value], "verdict": verdict}
        result = {"status": "converged", "message": "", "parameters": {"D": told}}
        return judged(result, {"D": 40e-6}, required=("D",))

    near, far, weak = line(40.4e-6), line(60e-6), line(40.4e-6, "weak")
    assert near["right"] and (near["inside"], near["outside"]) == (1, 0) and not near["verdict_errors"]
    assert far["false"] and not far["right"] and far["verdict_errors"] == ["D"] and far["worst"] > 30
    assert weak["right"] and not line(40.4e-6, "not identifiable")["right"]


def test_example_logs_are_those_their_script_makes(tmp_path, capsys):
    import gzip

    import numpy as np

    from identify.examples import FOLDER as SHIPPED

    runpy.run_path(str(FOLDER / "make_example_logs.py"))["main"](fast=True, folder=tmp_path)

    def rows(path):
        lines = gzip.decompress(path.read_bytes()).decode("ascii").split("\r\n")
        return np.array(
            [[float(x) for x in line.split(",")] for line in lines if line[:1] in "-0123456789" and "," in line]
        )

    made = sorted(tmp_path.glob("*.txt.gz"))
    assert [path.name for path in made] == ["5_mm_per_s.txt.gz"]
    np.testing.assert_allclose(rows(made[0]), rows(SHIPPED / made[0].name), atol=2e-4)
