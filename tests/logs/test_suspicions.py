"""What `inspect` doubts in a log: wrong units, swapped columns, slow sampling, few slips, spikes."""

import json
from dataclasses import replace

import numpy as np
import pytest

from data_io import Record, write_csv
from identify import examples
from identify.cli import main as cli
from identify.effects import MAIN
from identify.logs.judgement import judge
from identify.logs.recorded_drive import recorded_drive
from identify.logs.segment import segment
from identify.logs.slip_quality import RecordPart
from identify.model.model import assemble
from identify.simulation.simulate import run

PAIR = {
    "mu_s": 0.62,
    "mu_k0": 0.43,
    "delta_mu_k": -0.13,
    "a": 300.0,
    "D": 37.4e-6,
    "t_cr": 0.5,
    "mass": 0.2,
    "stiffness": 1470.0,
    "damping": 147.0,
}
NOISE = 5e-3


def record_of(rate, duration=8.0, speed=1e-3, seed=0, **columns):
    times = np.arange(int(duration * rate) + 1) / rate
    force = run(assemble(MAIN), PAIR, speed, 1.0, duration).sample(times)["force"]
    random = np.random.default_rng(seed)
    force = force + NOISE * random.standard_normal(times.size)
    load = 1.0 + 1e-3 * random.standard_normal(times.size)
    return Record(times, load, force, **columns)


def codes(record):
    return {finding.code for finding in judge(record, parts(record)).findings}


def parts(record):
    pieces = [(record.time[s.start : s.stop], record.friction_force[s.start : s.stop]) for s in record.steps]
    return [RecordPart(time, force, segment(time, force)) for time, force in pieces]


def test_a_good_log_is_not_doubted():
    assert codes(record_of(500.0)) == set()
    assert codes(record_of(500.0, speed=0.04)) == set(), "steady sliding is nothing to doubt"


@pytest.mark.parametrize("rate", [15.0, 20.0, 25.0])
def test_stick_slip_sampled_too_slowly_is_not_called_sliding_without_a_word(rate, tmp_path, capsys):
    record = record_of(rate, 12.0)
    assert codes(record) == {"sampled_too_slowly"}
    write_csv(record, tmp_path / "slow.csv")
    assert cli.main(["inspect", str(tmp_path / "slow.csv")]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert (
        "verdict: accept with warnings" in out and "the force swings 3.3" in out and "sample at 200 Hz or more" in out
    )
    assert codes(record_of(200.0, 12.0)) == {"samples_per_slip"}, "and so sampled it is found"


@pytest.mark.parametrize("seed", range(20))
def test_noise_and_drift_are_no_oscillation(seed):
    times = np.arange(400) / 25.0
    random = np.random.default_rng(seed)
    force = 0.4 + 0.02 * times / times[-1] + 0.05 * random.standard_normal(times.size)
    assert "sampled_too_slowly" not in codes(Record(times, np.ones(times.size), force))


def test_a_wrong_unit_and_swapped_columns_are_named():
    good = record_of(500.0)
    milli = Record(good.time, good.normal_force, 1e3 * good.friction_force)
    assert codes(milli) == {"strange_coefficient"}
    tiny = Record(good.time, good.normal_force, 1e-4 * good.friction_force)
    assert codes(tiny) == {"strange_coefficient"}
    assert "forces_swapped" in codes(Record(good.time, good.friction_force + 0.3, good.normal_force))
    assert "forces_swapped" not in codes(good)


def test_swapped_columns_are_told_before_the_doubts_that_come_of_them():
    """No zero is advised from a column that holds the other force; where nothing is swapped, it is."""
    good = record_of(500.0)
    bare = np.where(good.time < 0.4, 0.0, good.friction_force)
    exchanged = Record(good.time, bare, good.normal_force)
    found = judge(exchanged, parts(exchanged))
    assert found.swapped and found.findings[0].code == "forces_swapped"
    assert found.verdict == "reject" and "ripples" in found.reason, "the verdict is as before"
    assert "residual_force" in {finding.code for finding in found.quality.findings}
    assert "residual_force" not in {finding.code for finding in found.findings}
    lifted = Record(good.time, np.where(good.time < 0.4, 0.0, good.normal_force), good.friction_force + 0.1)
    told = judge(lifted, parts(lifted))
    assert not told.swapped and "residual_force" in {finding.code for finding in told.findings}


def test_few_slips_and_spikes_are_told():
    assert "few_cycles" in codes(record_of(500.0, 0.9))
    spiked = record_of(500.0)
    force = spiked.friction_force.copy()
    force[[701, 1502, 2203]] += 3.0
    record = Record(spiked.time, spiked.normal_force, force)
    messages = [f.message for f in judge(record, parts(record)).findings if f.code == "spikes"]
    assert messages == ["3 samples jump far from the neighbours (spikes, at 1.402, 3.004, 4.406 s); they are left out"]


def test_the_drive_speed_is_read_from_a_column_as_for_a_scene(tmp_path, capsys):
    good = record_of(500.0, 4.0)
    with_track = Record(
        good.time,
        good.normal_force,
        good.friction_force,
        channels={"Position": 2e-3 * good.time},
        channel_units={"Position": "m"},
    )
    write_csv(with_track, tmp_path / "a.csv")
    assert cli.main(["inspect", str(tmp_path / "a.csv")]) == 0
    assert (
        "drive speed: 2 mm/s, from the slope of column Position".replace(" mm", "\N{NO-BREAK SPACE}mm")
        in capsys.readouterr().out
    )
    assert cli.main(["inspect", str(tmp_path / "a.csv"), "--json"]) == 0
    log = json.loads(capsys.readouterr().out)["logs"][0]
    assert (
        log["drive_speed_m_per_s"] == pytest.approx(2e-3)
        and log["drive_speed_source"] == "from the slope of column Position"
    )


def test_a_position_that_stands_still_is_no_drive():
    good = record_of(500.0, 4.0)
    still, creeping = np.full(good.time.size, -0.69e-3), 1e-9 * good.time
    channels = {"Z": still, "W": creeping, "Position": 2e-3 * good.time}

    def told(*names):
        units = dict.fromkeys(names, "m")
        shown = {name: channels[name] for name in names}
        drive = recorded_drive(replace(good, channels=shown, channel_units=units))
        return drive.speed, drive.source

    assert told("Z", "W", "Position") == (pytest.approx(2e-3), "from the slope of column Position")
    assert told("Z", "W") == (None, "")
    assert told("Z") == (None, "")


def test_the_drive_speed_of_a_log_of_several_steps_is_told_by_step(capsys):
    assert cli.main(["inspect", str(examples.FOLDER / "1_mm_per_s.txt.gz")]) == 0
    assert "step 2: 1\N{NO-BREAK SPACE}mm/s, from column V2" in capsys.readouterr().out
