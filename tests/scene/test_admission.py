"""What no simulation can be asked is refused in one sentence, before anything moves."""

from __future__ import annotations

import math

import pytest

from experiments.hard_scenes import Scene
from identify.base.errors import SimulationError

NAN = math.nan


@pytest.mark.parametrize(
    ("scene", "sentence"),
    [
        (Scene({}, NAN, 1.0), "drive runs at .*nan.* expected finite"),
        (Scene({}, ((0.0, 1e-3), (0.5, math.inf)), 1.0), "drive runs at .*inf.* expected finite"),
        (Scene({}, 1e-3, NAN), "duration is nan s; expected a positive time"),
        (Scene({}, 1e-3, math.inf), "duration is inf s; expected a positive time"),
        (Scene({}, 1e-3, 1.0, force=NAN), "normal force has the value nan"),
        (Scene({}, 1e-3, 1.0, force=((0.0, 1.0), (NAN, 2.0))), "one value per rising time"),
        (Scene({}, 1e-3, 1.0, force=((0.0, 1.0), (0.5, -1.0))), "falls to -1 N at 0.5 s: lift-off is not simulated"),
        (Scene({"mass": -1.0}, 1e-3, 1.0), "mass is -1 kg; expected a positive number"),
        (Scene({"t_cr": 0.0}, 1e-3, 1.0), "t_cr is 0 s; expected a positive number"),
        (Scene({"damping": -1.0}, 1e-3, 1.0), "damping is -1 N/m; expected a number from 0 on"),
        (Scene({"delta_mu_k": NAN}, 1e-3, 1.0), "delta_mu_k is nan; expected a finite number"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_makes_no_sense_is_refused_by_name(scene: Scene, sentence: str) -> None:
    with pytest.raises(SimulationError, match=sentence):
        scene.run()
