"""`stickslip verify`: what it compares, what it says of it, and from which starts it searches again."""

import copy
from types import SimpleNamespace

import pytest

from identify import examples, identification
from identify.base.outcome import Status
from identify.base.result import Result
from identify.cli import main as cli
from identify.cli import verify
from identify.diagnosis.findings import Findings
from identify.report import stored_result
from identify.scene import Scene
from tests.support.fake_fit import fake_fit


def _entry(value, error, interval, verdict):
    return {"value": value, "standard_error": error, "interval": interval, "verdict": verdict}


STORED = {
    "status": "converged",
    "message": "",
    "parameters": {
        "mu_s": _entry(0.6, 0.001, [0.598, 0.602], "identified"),
        "t_cr": _entry(2.0, None, [None, 3.0], "not identifiable"),
        "a": _entry(500.0, None, [None, None], "fixed"),
    },
}


def _compared(**changed):
    again = copy.deepcopy(STORED)
    for name, entry in changed.items():
        again["parameters"][name] |= entry
    return verify.compare(Result.from_dict(STORED), Result.from_dict(again))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"t_cr": {"interval": [None, None]}}, "the upper end of t_cr was 3 and is open now"),
        ({"t_cr": {"interval": [0.1, 3.0]}}, "the lower end of t_cr was open and is 0.1 now"),
        ({"t_cr": {"interval": [None, 300.0]}}, "the upper end of t_cr was 3 and is 300 now"),
        ({"mu_s": {"value": 0.61}}, "mu_s was 0.6 and is 0.61 now"),
        ({"a": {"value": 501.0}}, "a was 500 and is 501 now"),
    ],
)
def test_what_differs_is_said(changed, said):
    assert _compared(**changed) == [said]


def test_between_its_ends_a_value_that_nothing_tells_may_lie_anywhere():
    assert not _compared(t_cr={"value": 1.0, "interval": [None, 3.01]})
    assert not _compared(mu_s={"value": 0.600001, "interval": [0.0, 1.0]}), "a value with an error has it for its ends"


@pytest.mark.parametrize(("asked", "recorded"), [("data", "data"), ("user", "user"), (None, "data")])
def test_starts_are_recorded(monkeypatch, asked, recorded):
    """The scene gives no start, so that the data's are taken if nobody says."""
    searched = []

    def plain(task, starts, *_):
        searched.append(starts)
        return [], Findings(Status.NO_CYCLES, "", task.unknowns)

    monkeypatch.setattr(identification, "plain_or_uneven", plain)
    monkeypatch.setattr(identification, "result_of", lambda *_: Result())
    result = identification.fit(Scene.from_toml(examples.SCENE_AT_50_HZ), starts=asked).result
    assert (result["provenance"]["starts"], searched) == (recorded, [recorded])


@pytest.mark.parametrize(("recorded", "taken"), [("data", "data"), ("user", "user"), (None, None), ("odd", None)])
def test_verify_searches_from_the_recorded_starts(monkeypatch, recorded, taken):
    scene, asked = Scene.from_toml(examples.SCENE_AT_50_HZ), []
    provenance = {"version": "0", "packages": {}, "scene": {}, "seed": 7, "starts": recorded}
    result = Result.from_dict(dict(fake_fit().result) | {"provenance": provenance})

    def fit(_scene, *, starts, seed, **_):
        asked.append((starts, seed))
        return SimpleNamespace(typed=result)

    monkeypatch.setattr(identification, "fit", fit)
    monkeypatch.setattr(stored_result, "read_result", lambda _: result)
    monkeypatch.setattr(stored_result, "scene_of", lambda *_: scene)
    monkeypatch.setattr(verify, "unchanged", lambda path, *_: path)
    monkeypatch.setattr(Result, "places", lambda *_: [0])
    assert cli.main(["verify", "result.json"]) == 0
    assert asked == [(taken, 7)]
