"""What is doubted in a log: wrong units, swapped columns, slow sampling; and what good logs are spared."""

import numpy as np
import pytest

from data_io import Record
from identify.effects import MAIN
from identify.logs.judgement import RecordPart, judge
from identify.logs.segment import segment
from identify.model.model import assemble
from identify.simulation.simulate import run
from tests.logs.test_segment import PAIR


def record_of(rate, duration=8.0, speed=1e-3):
    times = np.arange(int(duration * rate) + 1) / rate
    force = run(assemble(MAIN), PAIR, speed, 1.0, duration).sample(times)["force"]
    random = np.random.default_rng(0)
    force = force + 5e-3 * random.standard_normal(times.size)
    return Record(times, 1.0 + 1e-3 * random.standard_normal(times.size), force)


def judged(record):
    return judge(record, [RecordPart(record.time, record.friction_force, segment(record.time, record.friction_force))])


def codes(record):
    return {finding.code for finding in judged(record).findings}


@pytest.fixture(scope="module")
def good():
    return record_of(500.0)


def test_a_good_log_is_not_doubted(good):
    assert codes(good) == set()
    assert codes(record_of(500.0, speed=0.04)) == set(), "steady sliding is nothing to doubt"


@pytest.mark.parametrize("rate", [15.0, 20.0, 25.0])
def test_stick_slip_sampled_too_slowly_is_not_called_sliding_without_a_word(rate):
    (finding,) = judged(record_of(rate, 12.0)).findings
    assert finding.code == "sampled_too_slowly" and "sample at 200 Hz or more" in finding.message
    assert codes(record_of(200.0, 12.0)) == {"samples_per_slip"}, "and so sampled it is found"


@pytest.mark.parametrize("seed", range(8))
def test_noise_and_drift_are_no_oscillation(seed):
    times = np.arange(400) / 25.0
    force = 0.4 + 0.02 * times / times[-1] + 0.05 * np.random.default_rng(seed).standard_normal(times.size)
    assert "sampled_too_slowly" not in codes(Record(times, np.ones(times.size), force))


def test_a_wrong_unit_and_few_slips_are_named(good):
    for factor in (1e3, 1e-4):
        assert codes(Record(good.time, good.normal_force, factor * good.friction_force)) == {"strange_coefficient"}
    assert "few_cycles" in codes(record_of(500.0, 0.9))


def test_swapped_columns_are_named_before_the_doubts_that_come_of_them(good):
    """No zero is advised from a column that holds the other force; where nothing is swapped, it is."""
    bare = np.where(good.time < 0.4, 0.0, good.friction_force)
    exchanged = judged(Record(good.time, bare, good.normal_force))
    assert exchanged.swapped and exchanged.findings[0].code == "forces_swapped"
    assert exchanged.verdict == "reject" and "ripples" in exchanged.reason
    assert "residual_force" in {finding.code for finding in exchanged.quality.findings}
    assert "residual_force" not in {finding.code for finding in exchanged.findings}
    lifted = Record(good.time, np.where(good.time < 0.4, 0.0, good.normal_force), good.friction_force + 0.1)
    assert "residual_force" in codes(lifted) and not judged(lifted).swapped
