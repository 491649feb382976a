"""The table of docs/effects.md is up to date."""

from __future__ import annotations

from experiments import run_effect_table

PAGE = run_effect_table.PAGE.read_text(encoding="utf-8")


def test_table_of_effects_is_up_to_date():
    assert run_effect_table.page_with({"effects": run_effect_table.effects_table()}, PAGE) == PAGE
