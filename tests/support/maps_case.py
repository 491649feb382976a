"""The pair, the operating point, the ranges and the orbit that tests of predictions share."""

from __future__ import annotations

import numpy as np

from experiments import study_problem
from identify.model.model import Model, assemble
from identify.prediction.axes import Site
from identify.prediction.batch import CycleBatch
from identify.prediction.orbit import Cycle, run_cycle

ALL = ("inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening")
DEMO = study_problem.RIG | study_problem.DEMO
SITE = Site(assemble(ALL), DEMO, 5e-3, 1.0, area=8e-5)
SPANS = ((2e-3, 5e-2), (500.0, 5000.0))


def settled_cycle(model: Model, w: np.ndarray, rtol: float = 1e-8) -> Cycle:
    """The cycle on which the motion from a rested contact settles at a setting (n_w,)."""
    batch = CycleBatch(model, w[None])
    settled = batch.settle(batch.rested())
    assert settled.periodic[0]
    y = settled.y[0]
    for _ in range(8):
        cycle = run_cycle(model, y, w, float(batch.limit[0]), rtol)
        assert cycle is not None
        y = np.delete(cycle.end, 1)
    return cycle
