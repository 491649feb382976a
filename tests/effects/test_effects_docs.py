"""The table of docs/effects.md is up to date, and what is off is counted as not there."""

from __future__ import annotations

import pytest

import identify.model.model
from experiments import run_effect_table
from identify.effects import ALL
from identify.model.model import assemble
from tests.support.effects_case import without

PAGE = run_effect_table.PAGE.read_text(encoding="utf-8")
EVERY = pytest.mark.parametrize("effect", ALL, ids=lambda effect: effect.name)


def test_table_of_effects_is_up_to_date():
    assert run_effect_table.page_with({"effects": run_effect_table.effects_table()}, PAGE) == PAGE


@EVERY
def test_an_effect_that_is_off_is_counted_as_not_there(effect, monkeypatch):
    less = without(effect)
    more = (*less, effect.name)
    off = assemble(less)
    others = tuple(e for e in ALL if e is not effect)
    monkeypatch.setattr(identify.model.model, "ALL", others)
    monkeypatch.setattr(identify.model.model, "NAMES", tuple(e.name for e in others))
    gone = identify.model.model._assembled.__wrapped__(less, "drive")
    assert gone.states == off.states and gone.parameters == off.parameters
    for name in run_effect_table.COUNTED:
        assert getattr(gone, name).n_instructions() == getattr(off, name).n_instructions()
    monkeypatch.undo()
    on = assemble(more)
    if effect.parameters:  # control: the counts see what is on
        counts = [sum(getattr(m, name).n_instructions() for name in run_effect_table.COUNTED) for m in (off, on)]
        assert len(on.parameters) > len(off.parameters) and counts[1] != counts[0]
