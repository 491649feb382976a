"""Start values that lead to no answer of all logs do not stand in the way of one that the data lead to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from data_io import Record
from experiments.record_kinds import FAST, SLOW, Kind
from experiments.study_problem import DEMO, RIG
from identify import answering
from identify.base.outcome import Status
from identify.base.progress import Progress, to_nobody
from identify.diagnosis.findings import Findings
from identify.estimation.attempt import Attempt, solve_from
from identify.estimation.grouped import search_grouped
from identify.estimation.search import SearchProblem
from identify.estimation.status_words import ended, untried
from identify.identification import find
from identify.logs.prepare import Prepared
from identify.scene import Scene

UNUSED = "since the start values led to no answer of all logs"
Search = Callable[..., tuple[Attempt | None, dict[int, str]]]


@pytest.fixture(scope="module")
def made() -> tuple[Scene, list[Record]]:
    return Kind("two speeds", (SLOW, FAST), (), DEMO, RIG).made(0)


def of_one_log(problem: SearchProblem) -> tuple[Attempt | None, dict[int, str]]:
    """What a start ends in that describes the first log and leaves out the second."""
    return solve_from(problem.prepared, [0], problem.unknowns), {1: "log_2.csv slides at the answer of the other"}


def as_it_ended(
    task: answering.Task, prepared: list[Prepared], attempt: Attempt | None, left_out: dict[int, str], _told: Progress
) -> Findings:
    """What a search ended in; how sure it is plays no part here."""
    status, message = untried(prepared, left_out) if attempt is None else ended(attempt, {})
    return Findings(status, message, task.unknowns, attempt, left_out)


def found(
    made: tuple[Scene, list[Record]], monkeypatch: pytest.MonkeyPatch, from_user: Search, from_data: Search
) -> tuple[Findings, list[str]]:
    """What comes of a user's start where searches end so, and which searches there were."""
    asked: list[str] = []

    def search(problem: SearchProblem) -> tuple[Attempt | None, dict[int, str]]:
        asked.append(problem.sources)
        return (from_user if problem.sources == "user" else from_data)(problem)

    monkeypatch.setattr(answering, "search_grouped", search)
    monkeypatch.setattr(answering, "_findings", as_it_ended)
    monkeypatch.setattr(answering, "looked_into", lambda findings, *_: (findings, None))
    scene, records = made
    return find(scene, records, progress=to_nobody, starts="user")[1], asked


def test_a_log_that_the_start_values_leave_out_is_described_from_the_data(made, monkeypatch) -> None:
    answer, asked = found(made, monkeypatch, of_one_log, search_grouped)
    assert asked == ["user", "data"]
    assert answer.status is Status.CONVERGED and answer.attempt.log_numbers == (0, 1) and not answer.left_out
    assert answer.message.endswith(UNUSED)


def test_start_values_that_lead_nowhere_are_no_reason_to_refuse(made, monkeypatch) -> None:
    answer, asked = found(made, monkeypatch, lambda _: (None, {}), search_grouped)
    assert asked == ["user", "data"]
    assert answer.status is Status.CONVERGED and answer.message.endswith(UNUSED)


def test_where_they_lead_to_an_answer_of_all_logs_the_data_are_not_asked(made, monkeypatch) -> None:
    answer, asked = found(made, monkeypatch, search_grouped, search_grouped)
    assert asked == ["user"]
    assert answer.status is Status.CONVERGED and UNUSED not in answer.message


def test_what_the_data_lead_to_counts_only_if_it_is_better(made, monkeypatch) -> None:
    answer, asked = found(made, monkeypatch, of_one_log, of_one_log)
    assert asked == ["user", "data"]
    assert answer.attempt.log_numbers == (0,) and UNUSED not in answer.message

    def refused(problem: SearchProblem) -> tuple[Attempt | None, dict[int, str]]:
        attempt, left_out = search_grouped(problem)
        assert attempt is not None
        return replace(attempt, gate=replace(attempt.gate, status=Status.MODEL_MISFIT)), left_out

    answer, _ = found(made, monkeypatch, of_one_log, refused)
    assert answer.status is Status.CONVERGED and answer.attempt.log_numbers == (0,), (
        "a refusal of all is no answer of all"
    )


def test_the_last_better_answer_is_the_one_that_is_reported(made, monkeypatch) -> None:
    """Each look finds another answer: the numbers reported are those of the last, whether it is looked into or not."""
    scene, records = made
    looks: list[Attempt] = []

    def always_better(findings: Findings, *_: Any) -> tuple[Findings, Attempt]:
        looks.append(replace(findings.attempt, found_by=(f"look {len(looks) + 1}",)))
        return findings, looks[-1]

    monkeypatch.setattr(answering, "_findings", as_it_ended)
    monkeypatch.setattr(answering, "looked_into", always_better)
    seen = []
    monkeypatch.setattr(answering, "rejected_as_incomplete", lambda better, *_: seen.append(better) or better)
    answer = find(scene, records, progress=to_nobody)[1]
    assert len(looks) == answering.ANSWERS
    assert answer.attempt is seen[-1]
