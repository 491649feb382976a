"""The comparison of effects keeps to the time limit of the fit, and what it did not come to is said."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest

from identify import Scene, examples, fit
from identify.diagnosis.selection import NO_TIME


@pytest.mark.parametrize(("limit", "unfinished"), [(3.0, True), pytest.param(300.0, False, marks=pytest.mark.slow)])
def test_effects_are_compared_within_the_time_limit(limit, unfinished):
    scene = Scene.from_toml(examples.SCENE)
    scene = Scene.from_document(scene.as_document() | {"effects": "auto"})
    scene = replace(scene.choose([str(log.path) for log in scene.logs[2:]]), time_limit=limit)
    began = time.process_time()
    told = fit(scene).result
    assert ("comparison of effects" in told["not_tried"]) is unfinished
    assert any(reason["sentence"] == NO_TIME for reason in told["effects"]["reasons"]) is unfinished
    if unfinished:
        assert time.process_time() - began < limit + 4.0  # reading, and the pass that was under way
        assert "--time-limit" in told["message"]
    assert "contact_ageing" in told["effects"]["names"]
