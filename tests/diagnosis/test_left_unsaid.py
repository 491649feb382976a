"""A misfit that nothing explains: what the scene shares between groups, and the effects it leaves out, are named."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from experiments.study_problem import RIG
from identify import Scene
from identify.base.outcome import Status
from identify.diagnosis import second_look
from identify.diagnosis.findings import Findings
from identify.diagnosis.second_look import left_unsaid
from identify.effects import MAIN
from identify.estimation.attempt import Attempt
from identify.estimation.strategies import no_time_for, tracing
from identify.logs.unknowns import from_scene

EVERY = ("mu_s", "mu_k0", "D", "t_cr", "delta_mu_k", "a")


def scene(people: tuple[str, ...], effects: tuple[str, ...] = MAIN, **parameters: dict[str, Any]) -> Scene:
    logs = [{"path": f"{who}.csv", "drive_speed": 1e-3, "labels": {"volunteer": who}} for who in people]
    document = {"effects": list(effects), "rig": dict(RIG), "logs": logs, "parameters": parameters}
    return Scene.from_document(document, Path())


def test_what_is_shared_over_a_label_is_named_and_how_it_would_not_be() -> None:
    shared = left_unsaid(scene(("V07", "V08"), mu_s={"per": "volunteer"}, a={"fixed": 300.0}, mu_k0={"fixed": 0.4}))
    assert shared == (
        "; or D, t_cr or delta_mu_k differs by volunteer (V07 and V08) and is shared: give it one value each, "
        '[parameters] D = { per = "volunteer" }'
    )
    assert left_unsaid(scene(("V07", "V07"))) == ""  # one person
    assert left_unsaid(scene(("V07", "V08"), MAIN, **{name: {"per": "volunteer"} for name in EVERY})) == ""


@pytest.mark.parametrize("missing", MAIN[1:])
def test_an_effect_that_the_scene_leaves_out_is_named(missing: str) -> None:
    said = left_unsaid(scene(("V07",), tuple(name for name in MAIN if name != missing)))
    assert said.startswith(f"; or the scene leaves out an effect that matters ({missing})") and '"auto"' in said
    assert left_unsaid(scene(("V07",))) == ""


@pytest.mark.parametrize("status", [Status.MODEL_MISFIT, Status.WRONG_EVENT_COUNT, Status.SOLVER_FAILED])
def test_it_follows_the_sentence_of_a_misfit_alone(status: Status, monkeypatch: pytest.MonkeyPatch) -> None:
    stated = scene(("V07", "V08"))
    monkeypatch.setattr(second_look, "diagnose", lambda *_: None)
    monkeypatch.setattr(second_look, "hum", lambda _attempt: "")
    monkeypatch.setattr(second_look, "doubt", lambda *_args, **_options: None)
    ended = cast(Attempt, SimpleNamespace(gate=SimpleNamespace(possible_causes="perhaps this or that")))
    found = Findings(status, "it does not fit", from_scene(stated), ended)
    told, _ = second_look.looked_into(found, stated, [], [], lambda *_: None)
    more = "" if status is Status.SOLVER_FAILED else f"; perhaps this or that{left_unsaid(stated)}"
    assert told.message == f"it does not fit{more}" and told.status is status
    with tracing():
        no_time_for("hypotheses")
        told, _ = second_look.looked_into(found, stated, [], [], lambda *_: None)
    assert told.message == "it does not fit", "a search that was cut short knows no cause"
