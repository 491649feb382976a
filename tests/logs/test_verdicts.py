"""Every warning and every rejection: a log that triggers it, one that just does not, and the threshold moved away."""

import math
from dataclasses import replace

import numpy as np
import pytest

from data_io.quality import LIMITS, REJECT, Thresholds
from identify.logs.judgement import judge
from tests.support.verdict_cases import CASES, RATE, N, made, saw

LIMIT = {limit.name: limit for limit in LIMITS}


def told(case, code, own=None):
    """Severity of a finding, None where it is not said, or only as an aside."""
    record, parts = case
    severities = {f.severity for f in judge(record, parts, Thresholds(own or {})).findings if f.code == code}
    return max(severities - {"info"}, default=None, key=("warning", "reject").index)


def test_a_clean_log_is_accepted_without_a_word():
    judged = judge(*made(slope=0.2 / 0.36))
    assert judged.verdict == "accept" and judged.findings == ()


def test_every_threshold_has_its_cases():
    assert list(CASES) == list(LIMIT)


@pytest.mark.parametrize("name", CASES)
def test_a_log_a_bit_beyond_a_threshold_is_told_and_one_a_bit_within_is_not(name):
    make, beyond, within, code, *rejected = CASES[name]
    assert told(make(beyond), code) == "warning" and told(make(within), code) is None
    never = math.inf if LIMIT[name].beyond == "above" else 0.0
    assert told(make(beyond), code, {name: never}) is None, "a threshold that is moved away is silent"
    assert LIMIT[name].rejects == bool(rejected)
    for value, verdict in zip(rejected, ("reject", "accept with warnings"), strict=False):
        assert judge(*make(value)).verdict == verdict


@pytest.mark.parametrize("told", [True, False])
def test_friction_that_falls_with_its_load_does_not_drift(told):
    time = np.arange(N) / RATE
    load = 1.0 - 0.25 * time / time[-1]
    record, (part,) = made((0.4 + saw(time)) * load, normal=load)
    codes = {finding.code for finding in judge(record, [replace(part, load=load if told else None)]).findings}
    assert ("friction_drift" in codes) != told


def test_the_page_of_thresholds_is_the_table(request):
    page = (request.config.rootpath / "docs" / "quality.md").read_text(encoding="utf-8")
    for limit in LIMITS:
        rejects = f"{REJECT * limit.value:g}" if limit.rejects else "-"
        row = f"| `{limit.name}` | {limit.value:g} | {rejects} | {limit.unit} | {limit.meaning} |"
        assert row in page, row
    table = page.partition("## Findings")[0]
    assert table.count("| `") == len(LIMITS)
