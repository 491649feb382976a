"""What a scene restrains a parameter by is named where the data contradict it, with what they say instead."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from experiments.study_problem import DEMO, RIG, SPEEDS, Case, simulated_case
from identify import Scene, fit
from identify.base.outcome import Status
from identify.diagnosis import diagnosis, second_look
from identify.diagnosis.diagnosis import Doubt, diagnose, doubt
from identify.diagnosis.findings import Findings
from identify.diagnosis.hypotheses import Hypothesis, restraints, ties
from identify.effects import MAIN
from identify.estimation.attempt import Attempt
from identify.estimation.search import SearchProblem, search
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene

pytestmark = pytest.mark.usefixtures("no_further_logs")

LOGS = (2, 3)  # 1 and 5 mm/s: soon fitted


@pytest.fixture(scope="module")
def case() -> Case:
    return simulated_case(DEMO, 17)


def scene(**parameters: dict[str, Any]) -> Scene:
    logs = [{"path": f"log_{i}.csv", "drive_speed": SPEEDS[i][0]} for i in LOGS]
    document = {"effects": list(MAIN), "rig": dict(RIG), "logs": logs, "parameters": parameters}
    return Scene.from_document(document, Path())


def said(sentence: str, name: str) -> float:
    number, unit = sentence.split(f"{name} = ")[1].split()[:2]
    return float(number) * (1e-6 if unit == "µm" else 1.0)


def test_a_bound_that_a_misfit_comes_of_is_named(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    for others in ("SLIGHT", "GROSS"):  # which take their time
        monkeypatch.setattr(diagnosis, others, ())
    stated = scene(a={"upper": 150.0})
    unknowns, records = from_scene(stated), [case.records[i] for i in LOGS]
    logs = [prepare(stated, entry, record, unknowns) for entry, record in zip(stated.logs, records, strict=True)]
    attempt, _ = search(SearchProblem(logs, unknowns, thorough=False))
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
        ({"D": {"fixed": 1e-4}}, "D", "the value it is held at (0.1 mm)"),
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


def ended(status: Status, message: str) -> Findings:
    """What a fit found, with an answer that nobody looks into."""
    return Findings(
        status,
        message,
        from_scene(scene()),
        cast(Attempt, SimpleNamespace(gate=SimpleNamespace(possible_causes=""))),
    )


def two_people(**d: Any) -> Scene:
    """The logs of two people, with what the scene says of D besides that each has its own."""
    stated, free = scene(D=d), scene()
    logs = [replace(log, labels={"volunteer": who}) for who in ("V07", "V08") for log in free.logs]
    of_each = {**stated.parameters, "D": replace(stated.parameters["D"], per="volunteer")}
    return replace(free, logs=tuple(logs), parameters=of_each)


@pytest.mark.slow
def test_of_a_parameter_with_groups_those_are_named_that_contradict_its_prior(case: Case) -> None:
    other = simulated_case({**DEMO, "D": 1.8 * DEMO["D"]}, 18)
    records = [one.records[i] for one in (case, other) for i in LOGS]
    mean = DEMO["D"]
    message = fit(two_people(prior={"mean": mean, "sd": 0.1 * mean}), records).result["message"]
    assert said(message, "D (V08)") == pytest.approx(1.8 * mean, rel=0.05)
    assert "D (V07)" not in message and "D = " not in message
    wide = fit(two_people(prior={"mean": 1.4 * mean, "sd": mean}), records).result  # which rules out neither
    assert wide["status"] == "converged" and "ruled out" not in wide["message"]


def test_a_bound_that_an_answer_within_the_noise_sits_at_is_named_first(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    records = [case.records[i] for i in LOGS]
    stated = scene(a={"upper": 0.8 * DEMO["a"]})
    unknowns = from_scene(stated)
    logs = [prepare(stated, entry, record, unknowns) for entry, record in zip(stated.logs, records, strict=True)]
    attempt, _ = search(SearchProblem(logs, unknowns, thorough=False))
    assert attempt is not None and attempt.gate.status is Status.CONVERGED
    freer = scene(damping={"start": RIG["damping"]})  # of which chi^2 is no larger than without the bound alone
    rig = Hypothesis("damping", lambda *_: freer, lambda *_: "a wrong rig")
    monkeypatch.setattr(diagnosis, "SLIGHT", (rig,))

    def asked() -> Doubt | None:
        findings = Findings(Status.CONVERGED, "", unknowns, attempt)
        return doubt(stated, records, logs, findings, beyond=True, anew=False)

    found = asked()
    assert found is not None and found.whole
    assert found.sentence.startswith("a = ") and "(ruled out by its bounds" in found.sentence
    assert found.sentence.endswith("; or a wrong rig")
    assert said(found.sentence, "a") == pytest.approx(DEMO["a"], rel=0.1)
    monkeypatch.setattr(diagnosis, "restraints", lambda _scene, _at_bound: ())  # nobody asks
    unasked = asked()
    assert unasked is not None and unasked.sentence == "a wrong rig" and not unasked.whole


@pytest.mark.parametrize("restrained", [True, False])
def test_an_answer_at_a_bound_of_the_scene_is_looked_at_again(
    restrained: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_bound = ended(Status.AT_BOUND, "a sits at its upper bound")
    found = Doubt("a = 300 s/m (ruled out by its bounds)", 100.0, 0.18, "D", whole=True)
    monkeypatch.setattr(second_look, "sitting", lambda *_: {"a"})
    monkeypatch.setattr(second_look, "doubt", lambda *_args, **_options: found)
    stated = scene(a={"upper": 200.0}) if restrained else scene()
    told, _ = second_look.looked_into(at_bound, stated, [], [], lambda *_: None)
    assert told.status is Status.AT_BOUND and told.message.startswith("a sits at its upper bound")
    assert ("the data ask for a = 300 s/m" in told.message) is restrained


@pytest.mark.parametrize("whole", [True, False], ids=["explained", "still blamed"])
def test_no_log_is_blamed_for_what_the_scene_restrains(whole: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    refused = ended(Status.MODEL_MISFIT, "log_3 contradicts the others")
    monkeypatch.setattr(second_look, "hum", lambda _attempt: "")
    found = Doubt("D = 40 µm (ruled out by the value it is held at (44 µm))", 227.0, 0.18, "a", whole=whole)
    monkeypatch.setattr(second_look, "diagnose", lambda *_: None)
    monkeypatch.setattr(second_look, "doubt", lambda *_args, **_options: found)
    told, _ = second_look.looked_into(refused, scene(), [], [], lambda *_: None)
    assert "the data ask for D = 40 µm" in told.message and told.status is Status.MODEL_MISFIT
    assert ("contradicts" in told.message) is not whole


def test_a_prior_that_the_data_bear_out_is_let_be(case: Case) -> None:
    result = fit(scene(t_cr={"prior": {"mean": 0.52, "sd": 0.02}}), [case.records[i] for i in LOGS]).result
    assert result["status"] == "converged"
    assert result["parameters"]["mu_s"]["value"] == pytest.approx(DEMO["mu_s"], rel=0.02)


def test_only_what_restrains_is_a_suspect() -> None:
    assert restraints(scene(), ("a",)) == ()
    bounded = scene(a={"upper": 1e3}, D={"start": 3e-5}, mass={"start": 0.2, "lower": 0.1, "upper": 0.4})
    assert restraints(bounded, ("D", "mass")) == ()
    assert [hypothesis.parameter for hypothesis in restraints(bounded, ("a", "mass"))] == ["a"]


def test_what_is_left_out_is_the_restraint_alone() -> None:
    stated = scene(mass={"prior": {"mean": 0.25, "sd": 0.01}, "lower": 0.1, "upper": 0.4}, mu_k0={"fixed": 0.5})
    found = {hypothesis.parameter: hypothesis.freed(stated, []) for hypothesis in restraints(stated, ())}
    assert set(found) == {"mass", "mu_k0"}
    mass, held = found["mass"], found["mu_k0"]
    assert mass is not None and held is not None
    assert mass.parameters["mass"].prior_mean is None and mass.parameters["mass"].upper == 0.4
    assert mass.parameters["mu_k0"].fixed == 0.5
    assert held.parameters["mu_k0"].fixed is None and held.parameters["mu_k0"].start == 0.5


@pytest.mark.slow
def test_a_tie_that_the_data_contradict_is_named_with_what_they_say_instead(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    for table in ("SLIGHT", "GROSS"):  # which take their time
        monkeypatch.setattr(diagnosis, table, ())
    records = [case.records[i] for i in LOGS]

    def told(offset: float) -> str:
        others = {name: {"fixed": DEMO[name]} for name in ("D", "t_cr", "a")}  # which could make up for it
        stated = scene(mu_k0={"tie": {"to": "mu_s", "offset": offset}}, **others)
        unknowns = from_scene(stated)
        logs = [prepare(stated, entry, record, unknowns) for entry, record in zip(stated.logs, records, strict=True)]
        attempt, _ = search(SearchProblem(logs, unknowns, thorough=False))
        assert attempt is not None
        cause = diagnose(stated, records, logs, unknowns, attempt)
        return "" if cause is None else cause.sentence

    wrong = told(-0.21)
    assert "(ruled out by its tie (mu_s - 0.21): correct that under [parameters]) explains the misfit" in wrong
    assert said(wrong, "mu_k0") == pytest.approx(DEMO["mu_k0"], rel=0.02)
    assert told(DEMO["mu_k0"] - DEMO["mu_s"]) == ""


def test_what_was_tied_differs_between_the_groups_of_what_it_followed() -> None:
    stated = scene(mu_s={"per": "log"}, mu_k0={"tie": {"to": "mu_s", "offset": -0.19}})
    (tied,) = ties(stated)
    assert restraints(stated, ()) == () and ties(scene()) == ()
    freed = tied.freed(stated, [])
    assert freed is not None and freed.parameters["mu_k0"].tie is None and freed.parameters["mu_k0"].per == "log"
    assert freed.parameters["t_cr"].per is None
