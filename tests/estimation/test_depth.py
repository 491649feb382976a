"""What is asked of a fit beyond its values: profile, bootstrap, tables, accuracy, preview. It is there, and right."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np

from identify import examples
from identify.cli import main as cli
from identify.estimation.covariance import information_at
from identify.estimation.profile import converged
from identify.shooting.accuracy import COARSE, DEFAULT, TIGHT, accuracy_costs
from tests.support.two_logs import scene as two_logs
from tests.support.two_logs import searched

LOGS = ["1_mm_per_s.txt.gz", "0.1_mm_per_s.txt.gz"]


def test_what_the_steps_of_a_level_leave_is_foretold():
    """Of an answer with two steps per interval: the error that it is said to have is its distance from that of 24."""
    attempt, unknowns = searched(two_logs())
    size = np.sqrt(np.diag(information_at(attempt.solved, unknowns).covariance()))
    few, many = (converged(attempt.solved, attempt.solved.problem.with_steps(n), size, np.inf) for n in (2, 24))
    costs = accuracy_costs(few, size, COARSE, 2)
    assert [cost.level for cost in costs] == ["coarse", "default", "tight"] and costs[0].seconds == 0.0
    assert all(a.steps <= b.steps and a.seconds <= b.seconds for a, b in pairwise(costs)) and costs[0].steps == 2
    left = [float(np.max(np.abs(cost.errors))) for cost in costs]
    assert left[0] >= left[2] and left[1] <= DEFAULT.share and left[2] <= TIGHT.share
    np.testing.assert_allclose((few.theta - many.theta)[unknowns.free] / size, costs[0].errors, atol=0.2 * left[0])


def test_a_preview_draws_and_stops(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["fit", LOGS[0], "--scene", str(examples.SCENE), "--out", "mine", "--preview", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == "preview" and told["logs"][0]["cycles"] > 3
    assert [item.name for item in tmp_path.iterdir()] == ["mine-preview.png"]
    assert (tmp_path / "mine-preview.png").read_bytes().startswith(b"\x89PNG")
    assert "off by" in told["logs"][0]["text"]
