"""The table of strategies, its trace, and the time limit of a fit."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

from data_io import Record
from experiments.study_problem import recovery_case, scene_of
from identify import Scene, SceneError, fit
from identify.base import budget
from identify.base.budget import no_time_limit, seconds_left, time_is_up, time_limit
from identify.base.outcome import Status
from identify.diagnosis.findings import Findings
from identify.estimation import search
from identify.estimation.strategies import STRATEGIES, Strategy, Trace, Trial, may_run, run_strategy, tracing
from identify.examples import FOLDER
from identify.identification import _with_trace
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.scene.toml import read_toml

pytestmark = pytest.mark.usefixtures("no_further_logs")


def test_every_row_has_a_title_of_its_own_and_says_when_it_applies() -> None:
    assert len({row.title for row in STRATEGIES}) == len(STRATEGIES)
    assert all(row.when and row.does for row in STRATEGIES)


@pytest.fixture(scope="module")
def joint() -> dict:
    return dict(fit(Scene.from_toml(FOLDER / "pair.toml")).result)


def test_a_result_says_what_was_tried_and_what_led_to_the_answer(joint) -> None:
    tried = joint["search"]
    assert joint["status"] == "converged" and joint["found_by"][0] == Strategy.FEATURE_START.title
    assert joint["not_tried"] == []
    assert [trial["strategy"] for trial in tried[: len(joint["found_by"])]] == joint["found_by"]
    assert set(tried[0]) == {"strategy", "logs", "status", "cost", "seconds"} and tried[0]["logs"] == [1, 2, 3, 4]
    # Of a truth that is fitted the cost per sample is that of noise, and what was tried lasted no longer than the fit.
    assert 0.95 < tried[0]["cost"] < 1.05
    assert sum(trial["seconds"] for trial in tried) < joint["timing_s"]["total"]


def test_limits_nest_and_are_lifted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "time", time)
    assert seconds_left() == float("inf") and not time_is_up()
    with time_limit(100.0):
        with time_limit(1000.0):
            assert 99.0 < seconds_left() <= 100.0
        with time_limit(0.0):
            assert time_is_up() and seconds_left() == 0.0
            with no_time_limit():
                assert not time_is_up()
        assert not time_is_up()


def test_what_is_due_when_the_time_is_up_is_noted_and_not_tried() -> None:
    with tracing() as trace, time_limit(0.0):
        assert run_strategy(Strategy.JOINED, lambda: pytest.fail("it was tried")) is None
        assert not may_run(Strategy.JOINED)
    assert trace.not_tried == [Strategy.JOINED.title] and trace.trials == []
    with tracing([Strategy.JOINED]) as trace:
        assert run_strategy(Strategy.JOINED, lambda: pytest.fail("it is switched off")) is None
    assert trace.not_tried == []


@pytest.mark.parametrize("limit", [0.02, 0.3])
def test_a_fit_whose_time_is_up_ends_with_what_it_has(limit: float) -> None:
    scene = Scene.from_toml(FOLDER / "pair.toml", [f"fit.time_limit={limit}"])
    found = fit(scene)
    result = found.result
    spent = sum(trial["seconds"] for trial in result["search"])
    assert spent < 1.1 * limit + 1.0, "one pass may be under way"
    if found.status is not Status.CONVERGED:
        assert (
            f"the time limit of {limit:g} s left no time for" in result["message"]
            and "--time-limit" in result["message"]
        )
        assert result["not_tried"] and all(p["value"] is None for p in result["parameters"].values())


def _advised(message: str) -> float | None:
    """The time limit [s] that a message advises."""
    said = re.findall(r'--time-limit "(\S+) s"', message)
    return float(said[0]) if said else None


def test_a_longer_time_that_is_advised_leads_to_an_answer() -> None:
    limit, tried = 0.02, list[float]()
    while limit is not None and len(tried) < 8:
        tried.append(limit)
        result = fit(Scene.from_toml(FOLDER / "pair.toml", [f"fit.time_limit={limit}"])).result
        limit = _advised(str(result["message"])) if result["not_tried"] else None
    assert result["status"] == "converged" and not result["not_tried"]
    assert len(tried) > 1 and tried == sorted(set(tried)), "advice was followed, and none was given twice"


def test_advice_of_more_time_ends_before_it_is_beyond_belief() -> None:
    """A fit that is never done: the sentence changes from time to time that is tried, and ends without more of it."""
    unknowns = from_scene(Scene.from_toml(FOLDER / "pair.toml"))
    findings = Findings(Status.MODEL_MISFIT, "it does not fit", unknowns)
    tried = [Trial("hypotheses: mass", (), "examined", None, 1.0)]
    said, limit = list[str](), 60.0
    while limit is not None:
        said.append(_with_trace(findings, Trace(tried, ["hypotheses", "one log out"]), limit).message)
        limit = _advised(said[-1])
    assert "left no time for: hypotheses (begun), one log out" in said[0]
    assert len(said) == len(set(said)) <= 3
    assert "fewer or shorter logs" in said[-1] and "a longer one" not in said[-1]


def test_without_a_repair_a_missed_slip_costs_the_answer() -> None:
    """Negative control of the table: a row that is switched off is not tried, and what it buys is lost."""
    case = recovery_case("usual", 1)
    scene = scene_of(case, None)
    record = case.records[1]
    spoiled = record.friction_force.copy()
    middle = slice(record.time.size // 3, record.time.size // 3 + 40)
    spoiled[middle] += 0.05
    records = [case.records[0], Record(record.time, record.normal_force, spoiled), *case.records[2:]]
    with tracing([row for row in STRATEGIES if row is not Strategy.FEATURE_START]) as trace:
        refused = fit(scene, records)
    assert refused.status is not Status.CONVERGED
    assert {trial.strategy for trial in trace.trials} == {Strategy.FEATURE_START.title}


def test_starts_that_the_time_did_not_suffice_for_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first start misfits, and the time is up with it: the rows that were due next are said, not passed over."""
    case = recovery_case("usual", 1)
    scene, really = scene_of(case, None), search.solve_from

    def late(*given, **how):
        found = really(*given, **how)
        monkeypatch.setattr(budget, "now", lambda: float("inf"))
        return replace(found, gate=replace(found.gate, status=Status.MODEL_MISFIT))

    monkeypatch.setattr(search, "solve_from", late)
    unknowns = from_scene(scene)
    logs = [prepare(scene, *pair, unknowns) for pair in zip(scene.logs, case.records, strict=True)]
    with tracing() as trace, time_limit(1e6):
        found, _ = search.search(search.SearchProblem(logs, unknowns))
    assert found is not None and found.gate.status is Status.MODEL_MISFIT
    assert Strategy.FURTHER_STARTS.title in trace.not_tried and len(trace.trials) == 1


@pytest.mark.parametrize("text", ['"0 s"', '"-3 s"', '"5 N"', '"soon"'])
def test_a_limit_that_is_none_is_refused(text: str) -> None:
    document = read_toml(FOLDER / "pair.toml", [f"fit.time_limit={text}"])
    with pytest.raises(SceneError, match="time_limit"):
        Scene.from_document(document, FOLDER)


def test_a_limit_is_kept_in_the_document() -> None:
    scene = Scene.from_toml(FOLDER / "pair.toml", ['fit.time_limit="2 min"'])
    assert scene.time_limit == 120.0
    assert Scene.from_document(scene.as_document()).time_limit == 120.0
    assert "fit" not in Scene.from_toml(FOLDER / "pair.toml").as_document()


def test_the_report_says_in_one_sentence_what_led_to_the_answer() -> None:
    from identify.report.report_page import _search

    def told(tried: tuple[str, ...], not_tried: tuple[str, ...] = ()) -> str:
        trials = [SimpleNamespace(strategy=name) for name in tried]
        return _search(SimpleNamespace(search=trials, found_by=list(tried[:1]), not_tried=list(not_tried)))

    assert told(("feature start",)) == "Found by feature start; nothing else was tried."
    late = told(("feature start", "logs joined"), ("hypotheses",))
    assert late.endswith("tried besides: logs joined; there was no time for hypotheses.")
    assert told(()) == ""
