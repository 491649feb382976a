"""The estimator of uneven records keeps to the time limit of a fit, and a stop signal ends it at once."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from experiments.uneven_records import STIFF, prepared, scene_of, simulated
from identify import fit
from identify.base.budget import time_limit
from identify.scene import Scene
from identify.uneven.answer import UnevenEstimator
from identify.uneven.estimator import maximise
from identify.uneven.events import sticks_of

pytestmark = pytest.mark.usefixtures("no_further_logs")


@pytest.fixture(scope="module")
def track():
    return simulated(STIFF, 36, [1])[0]


def limited(limit: float) -> Scene:
    document = scene_of(STIFF).as_document()
    return Scene.from_document({**document, "fit": {"time_limit": limit}})


@pytest.mark.parametrize("limit", [0.1, 0.6])
def test_a_limit_is_kept_and_what_it_left_out_is_said(track, limit):
    began = time.process_time()
    result = fit(limited(limit), [track.record], estimator=UnevenEstimator()).result
    assert time.process_time() - began < limit + 3.0  # reading and detecting cycles come before it
    assert result["not_tried"] and f"the time limit of {limit:g} s left no time for" in result["message"]
    if result["status"] != "converged":
        assert "longer" in result["message"] and "cycles described one by one" in result["not_tried"]


def test_a_search_that_was_cut_says_so_and_its_answer_is_not_taken(track):
    sticks = sticks_of(prepared(STIFF, track.record)).part(np.arange(18))
    with time_limit(0.01):
        cut = maximise([sticks])
    whole = maximise([sticks])
    assert whole.converged and whole.in_time and not cut.in_time and not cut.converged
    assert cut.evaluations < whole.evaluations
    assert not np.any(np.isfinite(cut.covariance))  # nor is time spent on how sure it would be


def test_a_stop_signal_ends_the_estimate():
    """As a command has it: once in twenty the interrupt itself is lost in compiled code."""
    code = """
from identify.cli.interrupt import interruptible
from experiments.uneven_records import STIFF, prepared, simulated
from identify.uneven.estimator import maximise
from identify.uneven.events import sticks_of
many = [sticks_of(prepared(STIFF, track.record)) for track in simulated(STIFF, 24, [1, 2])]
with interruptible(lambda: None):
    print("begun", flush=True)
    while True:
        maximise(many * 4)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None and process.stdout.readline() == b"begun\n"
        time.sleep(0.5)
        began = time.perf_counter()
        process.send_signal(signal.SIGINT)
        try:
            process.wait(timeout=10.0)
        finally:
            process.kill()
        assert time.perf_counter() - began < 2.0
