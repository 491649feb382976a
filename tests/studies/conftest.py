"""Pages of many fits are tested with few draws: 400 take minutes, and change no layout."""

from functools import partial

import pytest

from identify.prediction.predict import predictions
from identify.studies import operating_points
from identify.studies.operating_points import GroupAnswer


@pytest.fixture(scope="session", autouse=True)
def few_draws():
    with pytest.MonkeyPatch.context() as patch:
        real = partial(predictions, draws=16)
        patch.setattr(operating_points, "predictions", lambda *points: real(*points[:3]))
        yield


@pytest.fixture
def no_answers(monkeypatch):
    """The groups are not asked what they do at common points: that is tests/studies/test_compare.py's."""
    monkeypatch.setattr(operating_points, "group_answers", lambda _comparison, _ground: ())


@pytest.fixture
def reasons_only(monkeypatch):
    """Of the groups only why they have no answer."""
    monkeypatch.setattr(operating_points, "_answer", lambda _c, _g, group: GroupAnswer(group))
