"""Starts about an answer: what the data know well keeps near it in half of them."""

import numpy as np
import pytest

from experiments.record_kinds import slide_hold_slide
from identify.estimation.multistart import COST_CUTOFF, _starts
from identify.logs.scene_records import prepare_scene, with_drives
from identify.shooting.starts import level_starts


def test_half_of_the_starts_move_what_the_data_know_well_no_farther_than_their_cost_allows():
    scene, record, _ = slide_hold_slide(0)
    ready = prepare_scene(with_drives(scene, [record])[0], [record])
    logs, unknowns = ready.logs, ready.unknowns
    centre, names = level_starts(logs, unknowns)[0], unknowns.names
    errors = np.where(np.array(names) == "mu_k0", 1e-4, 10.0)[unknowns.free]
    starts = np.array(_starts(logs, unknowns, centre, errors, 0)) - centre
    level, creep = (np.abs(starts[:, names.index(name)]) for name in ("mu_k0", "t_cr"))
    near = level <= (2.0 * COST_CUTOFF) ** 0.5 * 1e-4
    assert 4 <= np.count_nonzero(near) == pytest.approx(0.5 * len(starts), abs=2)
    assert np.median(creep[near]) > 0.2 < np.median(creep[~near])
    assert np.max(level[~near]) > 0.05
