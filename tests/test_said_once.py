"""A log that several parameters ask for is said in full once."""

from identify.report.said_once import said_once

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
