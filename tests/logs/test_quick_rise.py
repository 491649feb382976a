"""A fast log is fitted from within its first stick, which is over long before the force stops rising."""

from __future__ import annotations

import pytest

from experiments.study_problem import FIFTH, NORMAL_FORCE, recovery_case, scene_of
from identify.effects import MAIN
from identify.logs import fit_mode
from identify.logs.prepare import Prepared, prepare
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.simulation.simulate import run


def begun(number: int) -> tuple[Prepared, float]:
    """The fastest log of a pair as it is prepared, and when it begins to slip in truth [s]."""
    case = recovery_case("wide, five logs", number)
    scene = scene_of(case, None, [FIFTH[0]])
    onset = run(assemble(MAIN), case.truth | case.rig, FIFTH[0], NORMAL_FORCE, 0.1).onsets[0]
    return prepare(scene, scene.logs[4], case.records[4], from_scene(scene)), float(onset)


@pytest.mark.parametrize("number", [73, 77])
def test_the_fit_of_a_fast_log_begins_before_its_first_slip(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Drives of 20 mm/s: the force peaks 15 ms after the onset, and what it rises by until then is no stick."""
    log, onset = begun(number)
    assert log.data.begin < onset < log.segmentation.cycles.onset[0]
    monkeypatch.setattr(fit_mode, "SHORT_LOADING", 0.0)  # without it
    assert begun(number)[0].data.begin > onset
