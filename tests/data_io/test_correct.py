"""Cuts and corrections: what was put in comes out, the raw forces stay, everything stands in the account."""

import numpy as np
import pytest

from data_io import LogError, Record
from data_io.correct import Corrections, correct

RATE = 200.0


def to_and_fro(mu=0.3, load=2.0, share=0.0, angle=0.0, zero=0.0, strokes=6, noise=2e-3, wait=0.0, seed=0):
    """What a machine shows of strokes to and fro; the friction and the normal force themselves."""
    random = np.random.default_rng(seed)
    time = np.arange(int((wait + strokes * 5.0) * RATE)) / RATE
    stroke = np.floor((time - wait) / 5.0).astype(int)
    within = (time - wait) - 5.0 * stroke
    sign = np.where(stroke % 2 == 0, 1.0, -1.0)
    turn = np.clip(within / 0.5, 0, 1) * 2 - 1  # the spring is loaded the other way first
    swing = 1 + 0.1 * (2 * ((3 * time) % 1.0) - 1)
    normal = np.where(time < wait, 0.0, load)
    friction = np.where(time < wait, 0.0, mu * load * sign * np.where(turn < 1, turn, swing))
    shown = friction * np.cos(angle) + normal * np.sin(angle) + zero
    pressed = normal * np.cos(angle) - friction * np.sin(angle)
    shown = shown + share * pressed + noise * random.standard_normal(time.size)
    return Record(time, pressed + noise * random.standard_normal(time.size), shown), friction, normal


@pytest.mark.parametrize(("share", "degrees"), [(0.15, 0.0), (-0.05, 0.0), (0.0, 8.0), (0.0, -3.0)])
def test_crosstalk_and_tilt_are_taken_off(share, degrees):
    record, friction, normal = to_and_fro(share=share, angle=np.radians(degrees), mu=0.6)
    given = Corrections(crosstalk=share or None, tilt=np.radians(degrees) or None)
    back = correct(record, given).record
    np.testing.assert_allclose(back.friction_force, friction, atol=0.012)
    np.testing.assert_allclose(back.normal_force, normal, atol=0.012)


def test_a_zero_is_taken_without_what_crosstalk_makes_of_the_load():
    record, friction, _ = to_and_fro(share=0.05, zero=0.3, wait=4.0)
    unloaded = correct(record, Corrections(tare=(0.0, 3.5), crosstalk=0.05)).record
    np.testing.assert_allclose(unloaded.friction_force, friction, atol=0.012)
    # the same zero from an interval under load, where the crosstalk is given
    pressed = Record(
        record.time, np.maximum(record.normal_force, 2.0), record.friction_force + 0.1 * (record.time < 4.0)
    )
    loaded = correct(pressed, Corrections(tare=(0.0, 3.5), crosstalk=0.05))
    np.testing.assert_allclose(loaded.record.friction_force, friction, atol=0.012)
    zero, share = loaded.changes
    assert zero.value == pytest.approx(0.3, abs=1e-3) and zero.standard_error < 1e-3 and share.value == 0.05


def test_the_raw_forces_are_kept_and_the_record_is_not_touched():
    record, *_ = to_and_fro()
    before = record.friction_force.copy()
    corrected = correct(record, Corrections(tare=0.25, normal_tare=0.1)).record
    np.testing.assert_array_equal(corrected.channels["raw friction force"], before)
    np.testing.assert_array_equal(corrected.channels["raw normal force"], record.normal_force)
    np.testing.assert_array_equal(record.friction_force, before)
    np.testing.assert_allclose(corrected.friction_force, before - 0.25, rtol=1e-15)
    assert corrected.channel_units["raw friction force"] == "N"
    assert correct(record, Corrections()).record is record


def test_windows_and_exclusions_are_told_and_counted():
    record, *_ = to_and_fro(strokes=2)
    given = Corrections(window=(1.0, 9.0), exclude=((2.0, 3.0), (5.0, 5.5)))
    corrected = correct(record, given)
    time = record.time
    inside = (time >= 1) & (time <= 9) & ~((time >= 2) & (time <= 3)) & ~((time >= 5) & (time <= 5.5))
    np.testing.assert_array_equal(corrected.used, inside)
    assert [change.kind for change in corrected.changes] == ["window", "exclude", "exclude"]


def test_a_tare_interval_outside_is_refused():
    record, *_ = to_and_fro()
    with pytest.raises(LogError, match="tare interval 50 to 60 s holds no sample"):
        correct(record, Corrections(tare=(50.0, 60.0)))
