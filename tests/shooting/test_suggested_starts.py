"""Where a settled cycle leads astray, the last search goes on with what the levels of the data suggest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from experiments.in_vivo import twin
from identify.estimation.starts import starts_of
from identify.logs.prepare import Prepared, prepare
from identify.logs.unknowns import Unknowns, from_scene
from identify.logs.vibration import tuned

NUMBER, RATE = 26, 1000.0  # the same finger at 500 Hz was answered, at 1000 Hz no start led anywhere
Finger = tuple[list[Prepared], Unknowns, Unknowns]


@pytest.fixture(scope="module")
def finger() -> Finger:
    """Two logs of friction that drifts by 6 % in a grip that trembles; contacts age for 9.6 s. The search as the scene
    has it, and from the truth."""
    made = twin(NUMBER)
    scene = made.scene()
    unknowns = from_scene(scene)
    prepared = [prepare(scene, *of_log, unknowns) for of_log in zip(scene.logs, made.records(RATE), strict=True)]
    prepared, unknowns = tuned(prepared, unknowns)
    truth = unknowns.theta(np.array([made.truth[name] for name in unknowns.names]), prepared[0].data.base)
    return prepared, unknowns, replace(unknowns, start=truth)


def test_features_of_a_settled_cycle_know_nothing_of_a_contact_that_ages_on(finger: Finger) -> None:
    logs, unknowns, true = finger
    at = unknowns.names.index("t_cr")
    assert all(theta[at] < true.start[at] - np.log(8.0) for theta in starts_of(logs, unknowns))
