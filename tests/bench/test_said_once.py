"""A log that several parameters ask for is said in full once."""

from types import SimpleNamespace
from typing import Any

from identify.bench.next_log import remedy_for
from identify.report.shown_error import said_once

LOG = "add a log of 52 s at 0.2 mm/s and 0.943 N, sampled at 500 Hz, which is expected to tell it to "


def test_a_log_is_said_in_full_once_and_another_one_too() -> None:
    other = LOG.replace("52 s", "7 s")
    reasons = [f"slips are short: {LOG}2 %", "", f"sticks are long: {LOG}5 %", f"one speed: {other}9 %", "fixed"]
    assert said_once(reasons) == [
        reasons[0],
        "",
        "sticks are long: the same log is expected to tell it to 5 %",
        reasons[3],
        "fixed",
    ]


def test_it_knows_the_advice_as_a_fit_words_it() -> None:
    log = SimpleNamespace(
        duration=52.0, drive_speed=2e-4, normal_force=1.0, sampling_rate=500.0, expected={"a": 0.05, "D": 0.02}
    )
    advice: Any = SimpleNamespace(logs=(log,))
    told = [remedy_for(name, advice) for name in ("a", "D")]
    assert said_once(told) == [told[0], "the same log is expected to tell it to 2 %"]
