"""The comparison of effects keeps to the time limit of the fit, and what it did not come to is said."""

from __future__ import annotations

import time
from dataclasses import replace

from identify import Scene, examples, fit
from identify.diagnosis.selection import NO_TIME


def test_effects_are_compared_within_the_time_limit():
    scene = Scene.from_toml(examples.SCENE)
    scene = Scene.from_document(scene.as_document() | {"effects": "auto"})
    scene = replace(scene.choose([str(log.path) for log in scene.logs[2:]]), time_limit=1.5)
    began = time.process_time()
    told = fit(scene).result
    assert "comparison of effects" in told["not_tried"] and "--time-limit" in told["message"]
    assert any(reason["sentence"] == NO_TIME for reason in told["effects"]["reasons"])
    assert time.process_time() - began < 5.0  # with reading, and the pass that was under way
    assert "contact_ageing" in told["effects"]["names"]
