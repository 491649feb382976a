"""Speed columns: the programme that was put in comes out, with noise and ramps; what is none is called none."""

import numpy as np
import pytest

from data_io.drive import evened, steps_of

TIME = np.arange(8000) / 500.0
PROGRAMMES = {
    "one speed": ((0.0, 1e-3),),
    "steps": ((0.0, 2e-4), (4.0, 1e-3), (8.0, 4e-3), (10.0, 1e-3), (13.0, 2e-4)),
    "slide, hold, slide": ((0.0, 1e-3), (4.0, 0.0), (4.4, 1e-3), (9.0, 0.0), (12.0, 1e-3)),
    "strokes": ((0.0, 1e-3), (4.0, -1e-3), (8.0, 1e-3), (12.0, -1e-3)),
    "a slow programme": ((0.0, 1e-6), (8.0, 3e-6)),
}


def column(programme, noise=0.0, ramp=1, seed=1):
    starts, speeds = np.transpose(programme)
    speed = speeds[np.searchsorted(starts, TIME, side="right") - 1]
    speed = np.convolve(np.pad(speed, ramp // 2, mode="edge"), np.ones(ramp) / ramp, "valid")[: TIME.size]
    return speed + noise * np.abs(speeds).max() * np.random.default_rng(seed).standard_normal(TIME.size)


@pytest.mark.parametrize(("noise", "ramp"), [(0.0, 1), (0.002, 1), (0.03, 1), (0.002, 9)])
@pytest.mark.parametrize("name", PROGRAMMES)
def test_a_programme_is_told_back(name, noise, ramp):
    programme = PROGRAMMES[name]
    found = steps_of(TIME, column(programme, noise, ramp))
    assert found.trouble == "" and len(found.programme) == len(programme)
    assert [t for t, _ in found.programme] == pytest.approx([t for t, _ in programme], abs=0.012)
    fast = max(abs(v) for _, v in programme)
    assert [v for _, v in found.programme] == pytest.approx([v for _, v in programme], rel=5e-3, abs=0.1 * noise * fast)


def test_holds_are_exactly_zero_and_strokes_equally_fast():
    held = steps_of(TIME, column(PROGRAMMES["slide, hold, slide"], 0.02)).programme
    assert held[1][1] == 0.0 and held[3][1] == 0.0
    strokes = steps_of(TIME, column(PROGRAMMES["strokes"], 0.02)).programme
    assert len({abs(v) for _, v in strokes}) == 1
    assert evened([1.0, -1.004, 0.0, 1.2]) == [1.002, -1.002, 0.0, 1.2]


def test_spikes_gaps_and_quantisation_are_no_steps():
    speed = np.round(column(PROGRAMMES["steps"], 0.01), 4)
    speed[[500, 501, 6000]] = 0.5
    speed[3000:3003] = np.nan
    found = steps_of(TIME, speed)
    assert [v for _, v in found.programme] == pytest.approx([v for _, v in PROGRAMMES["steps"]], rel=0.01, abs=5e-6)


NONE = {
    "a sine": 1e-3 * np.sin(2 * np.pi * TIME / 5),
    "a fast sine": 1e-3 * np.sin(2 * np.pi * TIME * 20),
    "a sine in noise": 1e-3 + 2e-4 * np.sin(TIME) + 1e-4 * np.random.default_rng(2).standard_normal(TIME.size),
    "a long ramp": np.interp(TIME, [0, 5, 12, 16], [1e-3, 1e-3, 2e-3, 2e-3]),
    "speeding up": 1e-4 * TIME,
}


@pytest.mark.parametrize("name", NONE)
def test_what_changes_gradually_is_no_programme(name):
    found = steps_of(TIME, NONE[name])
    assert found.programme is None and "gradually" in found.trouble and not found.stands
