"""The pair, the operating point and the ranges that the tests of maps share."""

from __future__ import annotations

from identify.model.model import assemble
from identify.prediction.axes import Site

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
