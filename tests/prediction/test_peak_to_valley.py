"""The force from peak to valley in a cycle, against the motion of an independent integrator, and its slopes."""

from __future__ import annotations

import numpy as np
import pytest

from identify.base.document import to_dict
from identify.model.model import assemble
from identify.prediction.batch import settle
from identify.prediction.predict import predict
from identify.prediction.quantities import QUANTITIES, extremes, orbit_slopes, peak_to_valley, quantities
from tests.prediction.test_orbit import ALL, DEMO, map_of
from tests.support import oracle

PLACE = list(QUANTITIES).index("peak_to_valley")


@pytest.mark.parametrize("speed", [1e-4, 1e-3, 5e-3, 15e-3, 20e-3])
def test_it_is_what_a_load_cell_would_see(speed: float) -> None:
    map_ = map_of()
    orbit = settle(map_, speed).orbit
    assert orbit is not None
    y, period = orbit.y, orbit.cycle.stick + orbit.cycle.slip
    run = oracle.simulate(DEMO, speed, 1.0, 1.2 * period, (float(y[0]), 0.0, float(y[1])))
    slip = np.linspace(run.onsets[0], run.arrests[0], 400_001)
    force = run.force(slip)
    told = peak_to_valley(map_, orbit.cycle)
    assert told == pytest.approx(np.ptp(force), rel=1e-6)
    highest, lowest, _ = extremes(map_, orbit.cycle)
    assert highest.value == pytest.approx(force.max(), rel=1e-6)
    assert lowest.value == pytest.approx(force.min(), rel=1e-6)


def test_near_the_end_of_stick_slip_it_is_many_times_the_drop_and_grows_where_that_fades() -> None:
    rows = []
    for speed in (5e-3, 15e-3, 20e-3):
        map_ = map_of()
        orbit = settle(map_, speed).orbit
        assert orbit is not None
        rows.append(quantities(map_, orbit.cycle, speed))
    drop, wide = np.array(rows)[:, 0], np.array(rows)[:, PLACE]
    assert drop[0] > drop[1] > drop[2] and wide[0] < wide[1] < wide[2]
    assert wide[2] > 4.0 * drop[2]


@pytest.mark.parametrize("speed", [1e-3, 15e-3])
def test_its_slopes_are_those_of_orbits_solved_again(speed: float) -> None:
    map_ = map_of()
    orbit = settle(map_, speed).orbit
    assert orbit is not None
    names = ["mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr", "mass", "stiffness", "damping"]
    slopes = orbit_slopes(map_, orbit, names)[PLACE]
    for name, slope in zip(names, slopes, strict=True):
        ends = []
        for sign in (1, -1):
            other = map_of(**{name: DEMO[name] * (1 + 1e-4 * sign)})
            moved = settle(other, speed).orbit
            assert moved is not None
            ends.append(peak_to_valley(other, moved.cycle))
        again = (ends[0] - ends[1]) / (2e-4 * DEMO[name])
        assert slope * DEMO[name] == pytest.approx(again * DEMO[name], rel=2e-3, abs=2e-5), name


def test_the_answer_leads_with_it() -> None:
    document = to_dict(predict(assemble(ALL), DEMO, 0.02, 1.0))
    assert document["amplitude"]["peak_to_valley"]["value"] == pytest.approx(0.71845, rel=1e-4)
    assert "falls by 0.718 N from peak to valley" in document["amplitude"]["text"]
