"""The pair, the operating point, the ranges and the orbit that tests of predictions share."""

from __future__ import annotations

import numpy as np

from identify.model.model import assemble
from identify.prediction.axes import Site
from identify.prediction.batch import CycleBatch
from identify.prediction.orbit import Cycle, CycleMap

ALL = ("inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening")
DEMO = {
    "mass": 0.2,
    "stiffness": 1470.0,
    "damping": 147.0,
    "mu_s": 0.62,
    "mu_k0": 0.43,
    "delta_mu_k": -0.13,
    "a": 300.0,
    "D": 37.4e-6,
    "t_cr": 0.5,
}
SITE = Site(assemble(ALL), DEMO, 5e-3, 1.0, area=8e-5)
SPANS = ((2e-3, 5e-2), (500.0, 5000.0))


def settled_cycle(map_: CycleMap, drive_speed: float) -> Cycle:
    """The cycle on which the motion from a rested contact settles at a drive speed [m/s]."""
    batch = CycleBatch(map_.model, map_.setting(drive_speed)[None])
    settled = batch.settle(batch.rested())
    assert settled.periodic[0]
    y = settled.y[0]
    for _ in range(8):
        cycle = map_.run(y, drive_speed)
        assert cycle is not None
        y = np.delete(cycle.end, 1)
    return cycle
