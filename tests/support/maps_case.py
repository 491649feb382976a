"""The pair, the operating point, the ranges and the orbit that tests of predictions share."""

from __future__ import annotations

import numpy as np

from experiments import study_problem
from identify.model.model import Model, assemble
from identify.prediction.axes import Site
from identify.prediction.cycles import CycleBatch

ALL = ("inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening")
DEMO = study_problem.RIG | study_problem.DEMO
SITE = Site(assemble(ALL), DEMO, 5e-3, 1.0, area=8e-5)
SPANS = ((2e-3, 5e-2), (500.0, 5000.0))


def settled_orbit(model: Model, w: np.ndarray) -> tuple[CycleBatch, np.ndarray]:
    """At a setting (n_w,): one row, and the rest state (1, n_y) on which the motion from a rested contact settles."""
    batch = CycleBatch(model, w[None])
    settled = batch.settle(batch.rested())
    assert settled.periodic[0]
    y = settled.y
    for _ in range(8):
        y = batch.run(y).y
    return batch, y
