"""Slips that the noise hides are followed by the model, not as they were seen."""

import pytest

from experiments.study_problem import NOISE
from identify import Scene
from identify.effects import MAIN
from identify.logs.segment import segment
from identify.model.model import assemble
from identify.simulation.simulate import run
from tests.support.two_logs import drawn, prepared

FAINT, FAST, FASTEST = (1e-4, 20.0, 500.0), (1e-3, 4.0, 1000.0), (5e-3, 1.5, 2000.0)
RIG = {"mass": 0.2148, "stiffness": 1436.0, "damping": 83.31}
# Slips of 7 mN at 0.1 mm/s.
HIDDEN = {"mu_s": 0.5729, "mu_k0": 0.5188, "delta_mu_k": -0.05276, "a": 408.2, "D": 1.134e-4, "t_cr": 0.4387}


def test_slips_that_hardly_exceed_the_noise_are_not_detected_and_the_log_is_followed() -> None:
    drives = (FAINT, FAST, FASTEST)
    entries = [{"path": f"log_{i}.csv", "drive_speed": drive[0]} for i, drive in enumerate(drives)]
    scene = Scene.from_document({"effects": [*MAIN, "varying_normal_force"], "rig": RIG, "logs": entries})
    first, *others = prepared(scene, drawn(drives, HIDDEN | RIG, seed=3))[0]
    assert [log.fit_mode.name for log in (first, *others)] == ["continuous", "cycles", "cycles"]
    motion = run(assemble(MAIN), HIDDEN | RIG, FAINT[0], 1.0, FAINT[1])
    assert first.segmentation.count == 0 and motion.arrests.size > 100
    # What lies between slips that were not seen holds them: lines through it would show twice the noise.
    assert first.segmentation.noise == pytest.approx(NOISE, rel=0.05)
    # A quarter of the noise, and every slip is seen.
    time, force, true = first.record.time, first.record.friction_force, motion.sample(first.record.time)["force"]
    clear = segment(time, true + 0.25 * (force - true), half_period=first.rig.half_period)
    assert not clear.low_snr and abs(clear.count - motion.arrests.size) <= 1
