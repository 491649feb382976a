"""What is asked of a fit beyond its values: profile, bootstrap, tables, accuracy, preview. It is there, and right."""

from __future__ import annotations

import json

import numpy as np
import pytest

from identify import Asked, examples, fit
from identify.cli import main as cli
from identify.scene import Scene
from identify.shooting.accuracy import COARSE, DEFAULT, TIGHT
from tests.support.document_check import check_document

LOGS = ["1_mm_per_s.txt.gz", "0.1_mm_per_s.txt.gz"]


def asked_for(**asked):
    """The document of a fit of two example logs with this asked for."""
    return check_document(fit(Scene.from_toml(examples.SCENE).choose(LOGS), asked=Asked(**asked)).result)


@pytest.mark.slow
@pytest.mark.usefixtures("no_predictions")
def test_profile_intervals_agree_with_the_covariance_where_the_data_tell_much():
    document = asked_for(profile=True)
    profile = document["profile"]
    assert profile["limit"] == pytest.approx(3.8415, abs=1e-4)
    assert set(profile["parameters"]) == {"mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr"}
    for name, curve in profile["parameters"].items():
        entry = document["parameters"][name]
        assert entry.get("interval_rig_exact", entry["interval"]) == pytest.approx(curve["interval"])
        values, loss = np.array(curve["values"]), np.array(curve["loss"])
        assert np.all(np.diff(values) > 0) and values.size >= 7
        assert np.min(loss) == pytest.approx(0.0, abs=1e-6) and loss[0] > 3.5 and loss[-1] > 3.5
        # The ends are where the loss reaches its limit: by the curve itself, in between its points.
        root = np.sqrt(loss) * np.sign(values - entry["value"])
        ends = np.interp([-np.sqrt(3.8415), np.sqrt(3.8415)], root, values)
        half = 0.5 * (curve["interval"][1] - curve["interval"][0])
        assert curve["interval"] == pytest.approx(ends, abs=0.05 * half)


@pytest.mark.usefixtures("no_predictions")
def test_accuracy_table_foretells_what_steps_of_a_level_leave():
    """Of a coarse fit: the errors that it is said to have are its distance from the answer with many steps."""
    coarse, tight = (asked_for(accuracy=level, accuracy_table=True) for level in (COARSE, TIGHT))
    rows = coarse["accuracy_table"]
    assert [row["accuracy"] for row in rows] == ["coarse", "default", "tight"]
    assert rows[0]["steps"] <= rows[1]["steps"] <= rows[2]["steps"]
    assert 0 < rows[0]["seconds"] <= rows[1]["seconds"] <= rows[2]["seconds"]
    left = [max(abs(e) for e in row["left_in_standard_errors"].values()) for row in rows]
    assert left[0] >= left[2] and left[1] <= DEFAULT.share and left[2] <= TIGHT.share
    levels = coarse["accuracy"]["levels"]
    assert [level["estimated"] for level in levels] == [False, True, True]
    assert [level["error_in_standard_errors"] for level in levels] == pytest.approx(left)
    reached = next(level for level in tight["accuracy"]["levels"] if not level["estimated"])
    assert reached["steps"] == rows[2]["steps"], "the steps that a level is said to need are those it takes"
    for name, error in rows[0]["left_in_standard_errors"].items():
        before, after = (document["parameters"][name] for document in (coarse, tight))
        ends = np.array([before["value"], after["value"], *before.get("interval_rig_exact", before["interval"])])
        first, last, low, high = np.log(ends) if name in ("a", "D", "t_cr") else ends
        assert 3.92 * (first - last) / (high - low) == pytest.approx(error, abs=0.2 * left[0] + left[2])


def test_a_preview_draws_and_stops(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["fit", LOGS[0], "--scene", str(examples.SCENE), "--out", "mine", "--preview", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == "preview" and told["logs"][0]["cycles"] > 3
    assert [item.name for item in tmp_path.iterdir()] == ["mine-preview.png"]
    assert (tmp_path / "mine-preview.png").read_bytes().startswith(b"\x89PNG")
    assert "off by" in told["logs"][0]["text"]
