"""Sizes are said without a power of ten where that is as short."""

from identify.diagnosis.effect_choice import as_listed
from identify.effects import MAIN

PAIR = {"mu_s": 0.62, "mu_k0": 0.43, "delta_mu_k": -0.13, "a": 300.0, "D": 37.4e-6, "t_cr": 0.5}
RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}


def test_sizes_of_effects_are_plain_numbers():
    said = {reason.effect: reason.sentence for reason in as_listed(MAIN, PAIR | RIG, 1.0, 1.667e-6).reasons}
    assert "a stick of about 155 s regains 100 % of the strength" in said["contact_ageing"]
    assert "is 0.0236 % of a cycle" in said["inertia"]
    assert not any("e+" in sentence for sentence in said.values())
    assert "up to about 11.1 mm/s in a slip kinetic friction changes by" in said["velocity_weakening"]
