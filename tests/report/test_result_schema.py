"""The schema of result.json: every document that the tests see is held to it (`document_check`)."""

from __future__ import annotations

import copy

import pytest

from identify import Scene, fit
from identify.base.outcome import Status
from identify.examples import FOLDER
from identify.logs.regime import Regime
from tests.support.document_check import SCHEMA, check_document, validator


@pytest.fixture(scope="module")
def document() -> dict:
    return check_document(fit(Scene.from_toml(FOLDER / "pair.toml")).result)


def test_the_schema_lists_what_the_program_says() -> None:
    assert set(SCHEMA["properties"]["status"]["enum"]) == {status.value for status in Status}
    regimes = SCHEMA["$defs"]["log"]["properties"]["regime"]["enum"]
    assert {each.value for each in Regime} <= set(regimes)


@pytest.mark.parametrize(
    ("path", "wrong"),
    [
        (("status",), "fine"),
        (("parameters", "mu_s", "value"), "0.62"),
        (("parameters", "mu_s", "verdict"), "good"),
        (("parameters", "mu_s", "interval"), [0.6]),
        (("search", 0, "more"), 1),
        (("search", 0, "logs"), [0]),
        (("timing_s", "total"), -1.0),
        (("logs", 0, "friction_sign"), 0),
    ],
)
def test_what_breaks_a_promise_is_seen(document, path, wrong) -> None:
    broken = copy.deepcopy(document)
    place = broken
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = wrong
    assert validator().is_valid(document) and not validator().is_valid(broken)
