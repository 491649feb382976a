"""A log that was cut into parts, past its fit: batch, verify and the calculators find its parts under one log."""

import json
from pathlib import Path

import numpy as np
import pytest

from data_io import Record, write_csv
from experiments.batch_trials import SCENE
from experiments.study_problem import DEMO
from identify import identification, report
from identify.logs.scene_records import parted, parts_of, with_records
from identify.report.finished import Fit
from identify.studies.batch_store import RESULT, write_document
from identify.studies.planning import plan
from identify.studies.workers import make
from tests.support.command import refused, stickslip

LOGS = """
[[logs]]
path = "back_and_forth.csv"
drive_speed = [[0, "1 mm/s"], [1, "-1 mm/s"]]
[[logs]]
path = "one_way.csv"
drive_speed = "5 mm/s"
stiffness = "3000 N/m"
"""
ERROR = 1e-3  # of every parameter, relative


def answer(scene, records=None, **_):
    """In the place of a fit: the truth, and the logs of the scene cut as a fit cuts them."""
    cut, read = parted(*with_records(scene, records))
    known = {"unit": "", "interval": [None, None], "verdict": "identified", "reason": ""}
    found = {name: {"value": v, "standard_error": ERROR * abs(v), **known} for name, v in DEMO.items()}
    correlation = {"names": list(DEMO), "matrix": np.eye(len(DEMO)).tolist()}
    logs = [_log(*log) for log in zip(cut.logs, read, parts_of(scene, cut.logs), strict=True)]
    versions = {"version": "0", "packages": {}}
    result = {"schema": 1, "status": "converged", "message": "as it is", "parameters": found, "logs": logs}
    provenance = {"scene": scene.as_document(), "seed": 0, "asked": {"accuracy": "default"}, **versions}
    return Fit({**result, "correlation": correlation, "provenance": provenance}, ())


def _log(entry, record, number):
    speed = max(abs(v) for _, v in entry.drive_speed) if isinstance(entry.drive_speed, tuple) else entry.drive_speed
    return {
        **({} if number is None else {"part_of": number}),
        "path": str(entry.path),
        "sha256": record.metadata["sha256"],
        "labels": dict(entry.labels),
        "normal_force_N": 1.0,
        "drive_speed_m_per_s": speed,
        "reason_left_out": None,
    }


@pytest.fixture
def fitted(tmp_path, monkeypatch):
    """The folder of one group of a batch: a log of two strokes and one that goes one way; and how the group ended."""
    monkeypatch.setattr(identification, "fit", answer)
    monkeypatch.setattr("identify.cli.fit.fit", answer)
    monkeypatch.setattr(report, "write_report", lambda fit, part: write_document(part / RESULT, fit.result))
    time = np.arange(400) / 200
    for name in ("back_and_forth.csv", "one_way.csv"):
        force = 0.5 + 0.01 * np.random.default_rng(len(name)).standard_normal(time.size)
        write_csv(Record(time, np.ones(time.size), force), tmp_path / name)
    (tmp_path / "scene.toml").write_text(SCENE + LOGS)
    (tmp_path / "m.csv").write_text("path,group\nback_and_forth.csv,G\none_way.csv,G\n")
    (job,) = plan(tmp_path / "m.csv", tmp_path / "scene.toml").jobs
    return tmp_path / "part", make(job, tmp_path / "part")


@pytest.mark.slow
def test_a_log_of_two_strokes_is_answered_by_batch_verify_and_the_calculators(fitted, folder, capsys):
    part, end = fitted
    assert (end.status, end.message) == ("converged", "as it is"), end.detail
    result = json.loads((part / RESULT).read_text())
    assert [log.get("part_of") for log in result["logs"]] == [1, 1, None]
    code, words, _ = stickslip(capsys, "verify", part / RESULT)
    assert code == 0 and "reproduced" in words
    code, out, _ = stickslip(capsys, "stability", "--result", part / RESULT, "--json")
    points = json.loads(out)["points"]
    assert code == 0 and [p["name"] for p in points] == ["back_and_forth.csv", "one_way.csv"]


def test_a_result_with_too_few_logs_or_parts_of_none_is_no_result(fitted, folder, capsys):
    result = json.loads((fitted[0] / RESULT).read_text())
    for logs in (result["logs"][:2], result["logs"][2:], [log | {"part_of": "1"} for log in result["logs"]]):
        Path("result.json").write_text(json.dumps(result | {"logs": logs}))
        assert "no result" in refused(capsys, "verify", "result.json")
    for changed in (3, 0):
        logs = [result["logs"][0] | {"part_of": changed}, *result["logs"][1:]]
        Path("result.json").write_text(json.dumps(result | {"logs": logs}))
        assert "no result" in refused(capsys, "stability", "--result", "result.json")
