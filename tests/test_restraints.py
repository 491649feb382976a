"""What a scene restrains a parameter by is named where the data contradict it, with what they say instead."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from experiments.study_problem import DEMO, RIG, SPEEDS, Case, simulated_case
from identify import Scene, fit
from identify.diagnosis import diagnosis, second_look
from identify.diagnosis.diagnosis import diagnose
from identify.diagnosis.restraints import restraints
from identify.effects import MAIN
from identify.outcome import Status
from identify.preparation.prepare import prepare
from identify.preparation.unknowns import from_scene
from identify.search.search import search

LOGS = (2, 3)  # 1 and 5 mm/s: soon fitted


@pytest.fixture(scope="module")
def case() -> Case:
    return simulated_case(DEMO, 17)


def scene(**parameters: dict[str, Any]) -> Scene:
    logs = [{"path": f"log_{i}.csv", "drive_speed": SPEEDS[i][0]} for i in LOGS]
    document = {"effects": list(MAIN), "rig": dict(RIG), "logs": logs, "parameters": parameters}
    return Scene.from_document(document, Path())


def said(sentence: str, name: str) -> float:
    return float(sentence.split(f"{name} = ")[1].split()[0])


def test_a_bound_that_a_misfit_comes_of_is_named(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    for others in ("SLIGHT", "GROSS"):  # which take their time
        monkeypatch.setattr(diagnosis, others, ())
    stated = scene(a={"upper": 150.0})
    unknowns, records = from_scene(stated), [case.records[i] for i in LOGS]
    logs = [prepare(stated, entry, record, unknowns) for entry, record in zip(stated.logs, records, strict=True)]
    attempt, _ = search(logs, unknowns, thorough=False)
    assert attempt is not None and attempt.gate.status is not Status.CONVERGED
    cause = diagnose(stated, records, logs, unknowns, attempt)
    assert cause is not None
    ruled_out = "(ruled out by its bounds (0.001 s/m to 150 s/m): correct that under [parameters]) explains the misfit"
    assert ruled_out in cause.sentence
    assert said(cause.sentence, "a") == pytest.approx(DEMO["a"], rel=0.1)


@pytest.mark.parametrize(
    ("restrained", "name", "by"),
    [
        ({"t_cr": {"prior": {"mean": 2.0, "sd": 0.02}}}, "t_cr", "its prior (2 s ± 0.02 s)"),
        ({"D": {"fixed": 1e-4}}, "D", "the value it is held at (0.0001 m)"),
    ],
    ids=["prior", "held"],
)
def test_an_answer_within_the_noise_is_refused_for_what_the_data_contradict(
    case: Case, restrained: dict[str, Any], name: str, by: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    records = [case.records[i] for i in LOGS]
    result = fit(scene(**restrained), records).result
    assert result["status"] == "model_misfit" and f"(ruled out by {by}: correct" in result["message"]
    assert said(result["message"], name) == pytest.approx(DEMO[name], rel=0.1)
    monkeypatch.setattr(second_look, "restraints", lambda _scene, _at_bound: ())  # nobody asks
    unasked = fit(scene(**restrained), records).result
    assert unasked["status"] == "converged"
    assert abs(unasked["parameters"]["mu_s"]["value"] / DEMO["mu_s"] - 1.0) > 0.1


def test_a_prior_that_the_data_bear_out_is_let_be(case: Case) -> None:
    result = fit(scene(t_cr={"prior": {"mean": 0.52, "sd": 0.02}}), [case.records[i] for i in LOGS]).result
    assert result["status"] == "converged"
    assert result["parameters"]["mu_s"]["value"] == pytest.approx(DEMO["mu_s"], rel=0.02)


def test_only_what_restrains_is_a_suspect() -> None:
    assert restraints(scene(), ("a",)) == ()
    bounded = scene(a={"upper": 1e3}, D={"start": 3e-5}, mass={"start": 0.2, "lower": 0.1, "upper": 0.4})
    assert restraints(bounded, ("D", "mass")) == ()
    assert [suspect.parameter for suspect in restraints(bounded, ("a", "mass"))] == ["a"]


def test_what_is_left_out_is_the_restraint_alone() -> None:
    stated = scene(mass={"prior": {"mean": 0.25, "sd": 0.01}, "lower": 0.1, "upper": 0.4}, mu_k0={"fixed": 0.5})
    found = {suspect.parameter: suspect.freed(stated, []) for suspect in restraints(stated, ())}
    assert set(found) == {"mass", "mu_k0"}
    mass, held = found["mass"], found["mu_k0"]
    assert mass is not None and held is not None
    assert mass.parameters["mass"].prior_mean is None and mass.parameters["mass"].upper == 0.4
    assert mass.parameters["mu_k0"].fixed == 0.5
    assert held.parameters["mu_k0"].fixed is None and held.parameters["mu_k0"].start == 0.5
