"""What is known of rig and scatter before a solve is said before it, and a wrong unit ends the fit."""

from __future__ import annotations

import time

import pytest

from identify import FitError, Scene, fit
from identify.base.progress import Notice
from identify.diagnosis import selection
from identify.estimation.preview import preview
from identify.examples import FOLDER
from identify.logs.scene_records import with_drives, with_records

pytestmark = pytest.mark.usefixtures("no_further_logs")


class _SearchBeganError(Exception):
    """The search has begun."""


def _said_before_the_search(scene, records):
    """Sentences that stay, and the seconds of processor time until the last of them."""
    said, began = [], time.process_time()

    def listen(stage, _share):
        if isinstance(stage, Notice):
            said.append((str(stage), time.process_time() - began))
        if stage in ("finding a start", "fitting all that plainly matters"):
            raise _SearchBeganError

    with pytest.raises(_SearchBeganError):
        fit(scene, records, progress=listen)
    return said


def _example(stiffness, *settings):
    scene = Scene.from_toml(FOLDER / "pair.toml", [f"rig.stiffness={stiffness}", *settings])
    return with_records(with_drives(scene)[0], None)


@pytest.mark.parametrize("settings", [(), ('effects="auto"',)])
def test_a_stiffness_that_all_sticks_contradict_is_said_before_the_search(settings):
    """And before effects are chosen, which takes minutes."""
    ((sentence, seconds),) = _said_before_the_search(*_example('"1720 N/m"', *settings))
    assert sentence.startswith("in the sticks of all logs the force rises at 0.85")
    assert 'stiffness = { start = "1470 N/m" }' in sentence or 'start = "147' in sentence
    assert seconds < 2.0
    assert _said_before_the_search(*_example('"1470 N/m"', *settings)) == []


def test_a_wrong_unit_ends_a_fit_and_a_preview_at_once():
    scene, records = _example('"1470 kN/m"')
    began = time.perf_counter()
    result = fit(scene, records).result
    assert time.perf_counter() - began < 5.0
    assert result["status"] == "model_misfit" and "check the units" in result["message"]
    assert result["search"] == []
    with pytest.raises(FitError, match="check the units"):
        preview(scene, records)


def test_a_preview_says_what_is_known_early_too():
    (sentence,) = preview(*_example('"1720 N/m"')).notices
    assert sentence.startswith("in the sticks of all logs the force rises at 0.85")
    assert preview(*_example('"1470 N/m"')).notices == []


def test_scatter_is_said_before_the_search_and_no_effects_are_compared(monkeypatch):
    """Which effects describe alike cycles, cycles that differ do not tell: minutes of fits would end as they began."""
    scene = Scene.from_toml(FOLDER / "pair_uneven.toml", ['effects="auto"'])
    scene, records = with_records(with_drives(scene)[0], None)
    said = []
    monkeypatch.setattr(selection, "fit_model", lambda *_, **_how: pytest.fail("effects are compared"))
    choice = selection.choose_from_data(scene, records, lambda stage, _share: said.append(str(stage)))
    assert any(words.startswith("friction differs from cycle to cycle") for words in said)
    assert "contact_ageing" in choice.effects and not choice.unfinished
