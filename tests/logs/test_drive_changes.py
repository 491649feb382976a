"""Holds and velocity steps: recognised, and read as the laws of friction that made them have them."""

import json

import numpy as np
import pytest

from data_io import Record
from identify.base.document import to_dict
from identify.cli.logs import document, inspection, lines
from identify.logs.draft import DraftLog, draft
from identify.logs.drive_changes import drive_changes, summary
from identify.logs.regime import look
from tests.support import oracle

STEPS = ((0.0, 1e-5), (60.0, 1e-4), (80.0, 1e-5), (140.0, 3e-5))
A, B, D_C = 0.010, 0.015, 50e-6
PAIR = {"mu_s": 0.62, "mu_k0": 0.43, "delta_mu_k": -0.05, "a": 100.0, "D": 37.4e-6, "t_cr": 5.0}
RIGS = {
    "slides": {"mass": 0.05, "stiffness": 20000.0, "damping": 4000.0},
    "sticks and slips": {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0},
}
HOLDS = (1.0, 10.0, 30.0)


def by_the_slip_law(programme, noise, b=B, rate=100.0, duration=200.0):
    """Friction of a stiff rig with rate and state, the state evolving with slip (Ruina 1983): in closed form."""
    time = np.arange(int(duration * rate)) / rate
    starts, speeds = np.transpose(programme)
    piece = np.searchsorted(starts, time, side="right") - 1
    state, friction = 0.0, np.empty(time.size)  # state: ln(V theta / D_c)
    for i, (speed, end) in enumerate(zip(speeds, [*starts[1:], duration], strict=True)):
        state += np.log(speed / speeds[max(i - 1, 0)])
        mine = piece == i
        left = state * np.exp(-speed * (time[mine] - starts[i]) / D_C)
        friction[mine] = 0.6 + A * np.log(speed / speeds[0]) + b * (left - np.log(speed / speeds[0]))
        state *= np.exp(-speed * (end - starts[i]) / D_C)
    friction += noise * np.random.default_rng(5).standard_normal(time.size)
    return Record(time, np.full(time.size, 2.0), 2.0 * friction, drive_speed=speeds[piece])


def changes_of(record, programme):
    return drive_changes(record, look(record, programme))


def test_direct_and_evolution_effect_are_those_of_rate_and_state():
    for change, ratio in zip(changes_of(by_the_slip_law(STEPS, 1e-3), STEPS), (10.0, 0.1, 3.0), strict=True):
        assert change.direct_effect == pytest.approx(A * np.log(ratio), rel=0.1)
        assert change.evolution_effect == pytest.approx(-B * np.log(ratio), rel=0.1)
        assert change.D_c_m == pytest.approx(D_C, rel=0.1)
        steady = (A - B) * np.log(ratio)
        assert change.after_coefficient - change.before_coefficient == pytest.approx(steady, abs=2e-4)


def test_without_an_evolution_none_is_named():
    for noise in (1e-3, 1e-2):
        for change in changes_of(by_the_slip_law(STEPS, noise, b=0.0), STEPS):
            assert change.D_c_m is change.direct_effect is change.evolution_effect is None


def slide_hold_slide(rig):
    speed, slide, programme, start = 1e-3, 1.0, [], 0.0
    for hold in HOLDS:
        programme += [(start, speed), (start + slide, 0.0)]
        start += slide + hold
    programme = (*programme, (start, speed))
    run = oracle.simulate(PAIR | rig, programme, 1.0, start + slide)
    time, force = oracle.noisy_log(run, start + slide, 1000, 2e-3, seed=1)
    starts, speeds = np.transpose(programme)
    drive = speeds[np.searchsorted(starts, time, side="right") - 1]
    return Record(time, np.ones(time.size), force, drive_speed=drive)


@pytest.mark.parametrize("name", RIGS)
def test_each_hold_has_its_time_and_the_peak_after_it(name, tmp_path):
    record = slide_hold_slide(RIGS[name])
    seen = inspection("shs.csv", record)
    assert [change.hold_s for change in seen.changes] == pytest.approx(HOLDS, abs=2e-3)
    assert summary(seen.changes) == "slide-hold-slide, 3 holds of 1\N{NO-BREAK SPACE}s to 30\N{NO-BREAK SPACE}s"
    for change in seen.changes:
        begin = change.start_s + change.hold_s
        after = (record.time >= begin) & (record.time < begin + 0.4)
        assert change.peak_coefficient == pytest.approx(np.max(record.friction_force[after]), abs=8e-3)
        assert change.peak_coefficient > change.before_coefficient + 0.02
    told = json.loads(json.dumps(to_dict(document(seen)), allow_nan=False))
    assert [change["hold_s"] for change in told["drive_changes"]] == pytest.approx(HOLDS, abs=2e-3)
    assert "slide-hold-slide" in "\n".join(lines(seen)) and "hold of" in "\n".join(lines(seen))
    text = draft([DraftLog(tmp_path / "shs.csv", None, record)], tmp_path, {}).text
    assert "# slide-hold-slide, 3 holds" in text


def test_turns_and_one_speed_are_no_change():
    record = by_the_slip_law(STEPS, 1e-3)
    assert changes_of(record, 1e-5) == () == changes_of(record, None)
    to_and_fro = Record(record.time, record.normal_force, np.where(record.time < 100.0, 1.0, -1.0))
    assert changes_of(to_and_fro, ((0.0, 1e-3), (98.0, 0.0), (100.0, -1e-3))) == ()
