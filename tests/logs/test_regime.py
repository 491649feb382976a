"""What sticks and slips and what only looks like it: the regime of a log, on files as people have them and on draws."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from data_io import read_log
from experiments.regime_records import KINDS, drawn
from identify.cli import main as cli
from identify.cli.logs import StatedRig, inspection
from identify.logs.recorded_drive import drive_of, recorded_drive
from identify.logs.regime import Known, Regime, classify, look

CASES = Path(__file__).resolve().parents[1] / "cases"
MEASURED = Path(__file__).resolve().parents[3] / "shared" / "data" / "paper_on_paper"


def inspected(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict:
    assert cli.main(["inspect", "--json", *arguments]) == 0
    (log,) = json.loads(capsys.readouterr().out)["logs"]
    return log


def claims_nothing(log: dict) -> None:
    """No cycle, stick slope or advice is drawn from what does not stick."""
    assert sum(step["cycles"] for step in log["steps"]) == 0
    codes = {finding["code"] for finding in log["quality"]["findings"]}
    assert not codes & {"stick_slope", "friction_drift", "samples_per_slip", "spikes"}
    assert all(row["drop_N"] is None and row["frequency_Hz"] is None for row in log["classical"]["rows"])


def test_strokes_with_a_position_are_strokes_and_no_slips(capsys: pytest.CaptureFixture[str]) -> None:
    log = inspected(capsys, str(CASES / "strokes_with_position.txt"))
    assert log["regime"] == "sliding" and "8 strokes to and fro" in log["evidence"][0]
    claims_nothing(log)
    forth, back = log["classical"]["directions"]
    assert (forth["strokes"], back["strokes"]) == (4, 4)
    assert forth["coefficient"] == pytest.approx(0.46, abs=0.02) and back["coefficient"] == pytest.approx(
        0.46, abs=0.02
    )


def test_three_hundred_strokes_without_a_position_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    path = str(CASES / "strokes_300_without_position.csv.gz")
    log = inspected(capsys, path, "--columns", "friction_force=Ft", "--normal-force", "5 N")
    assert log["regime"] == "sliding" and "300 strokes" in log["evidence"][0]
    claims_nothing(log)
    assert [way["strokes"] for way in log["classical"]["directions"]] == [150, 150]
    for way in log["classical"]["directions"]:
        assert way["coefficient"] == pytest.approx(1.85 / 5.0, abs=0.02)


def test_slow_noise_at_ten_hertz_is_no_stick_slip(capsys: pytest.CaptureFixture[str]) -> None:
    log = inspected(capsys, str(CASES / "rtec_sliding_at_10_hz.csv"))
    assert log["regime"] == "sliding" and log["quality"]["verdict"] == "accept"
    claims_nothing(log)
    (row,) = log["classical"]["rows"]
    assert row["sliding_mean_coefficient"] == pytest.approx(0.172, abs=0.002) and row["stick_slope_N_per_s"] is None


def test_a_swing_once_a_turn_is_a_rhythm_of_sliding(capsys: pytest.CaptureFixture[str]) -> None:
    log = inspected(capsys, str(CASES / "disc_wobble.csv"))
    assert log["regime"] == "sliding"
    claims_nothing(log)
    (row,) = log["classical"]["rows"]
    assert row["rhythm_Hz"] == pytest.approx(1.31, abs=0.02) and row["rhythm_N"] == pytest.approx(0.04, abs=0.005)
    known = inspection("a.csv", read_log(CASES / "disc_wobble.csv"), StatedRig(5000.0, 27e-3, 0.3)).regime
    assert known.regime is Regime.SLIDING and known.confidence > log["confidence"] > 0.8, "the rig makes it surer"


def test_inspect_without_and_with_the_rig_say_the_same_of_a_near_harmonic_swing() -> None:
    record = read_log(CASES / "near_harmonic.csv.gz")
    for rig in (StatedRig(), StatedRig(2254.0, 1.1e-3), StatedRig(2254.0, 1.1e-3, 30.7e-3)):
        seen = inspection("a.csv", record, rig)
        assert seen.regime.regime is Regime.NEAR_HARMONIC and seen.steps[0].phases.count > 30


def test_a_dip_with_a_floor_is_no_spike(capsys: pytest.CaptureFixture[str]) -> None:
    log = inspected(capsys, str(CASES / "cetr_bump_in_the_track.csv"))
    assert log["quality"]["verdict"] == "accept" and log["quality"]["figures"]["spikes"]["value"] == 0


@pytest.mark.skipif(not MEASURED.is_dir(), reason="the measured records are not beside this checkout")
@pytest.mark.parametrize(("name", "regime"), [
    ("k168_v42", Regime.UNEVEN_STICK_SLIP), ("k1002_v42", Regime.UNEVEN_STICK_SLIP),
    ("k168_v1100", Regime.UNEVEN_STICK_SLIP), ("k1002_v4300", Regime.NEAR_HARMONIC),
])  # fmt: skip
def test_measured_stick_slip_is_found_with_and_without_its_rig(name: str, regime: Regime) -> None:
    record = read_log(MEASURED / f"{name}.csv")
    stiffness, speed = (float(part[1:]) for part in name.split("_"))
    for known in (Known(), Known(stiffness), Known(stiffness, half_period=float(np.pi * np.sqrt(0.0307 / stiffness)))):
        assert look(record, 1e-6 * speed if known.stiffness else None, known).regime is regime


def saw(scatter: float = 0.0, rate: float = 200.0) -> tuple[np.ndarray, np.ndarray]:
    """Twenty-four sticks of 0.5 N/s that end in falls within 20 ms, by 0.3 N give or take `scatter`."""
    random = np.random.default_rng(3)
    knots = [(0.0, 0.5)]
    for drop in 0.3 * np.exp(scatter * random.standard_normal(24)):
        t, low = knots[-1]
        knots += [(t + (0.9 - low) / 0.5, 0.9), (t + (0.9 - low) / 0.5 + 0.02, 0.9 - drop)]
    t, f = np.array(knots).T
    time = np.arange(int(t[-1] * rate)) / rate
    return time, np.interp(time, t, f) + 0.003 * random.standard_normal(time.size)


def test_what_the_rig_says_of_a_saw_tooth_and_of_a_swing() -> None:
    """A saw-tooth is stick-slip though the rig is stated wrongly by 50; a swing as fast as that rig loads is, and as
    slow as a disc turns is none."""
    time, force = saw()
    assert classify(time, force).regime is Regime.STICK_SLIP
    assert classify(time, force, Known(25_000.0, 1e-3)).regime is Regime.STICK_SLIP
    swing = 0.6 + 0.02 * np.sin(2.0 * np.pi * 2.0 * time) + 0.001 * np.random.default_rng(1).standard_normal(time.size)
    assert classify(time, swing).regime is Regime.SLIDING
    assert classify(time, swing, Known(250.0, 1e-3)).regime is Regime.NEAR_HARMONIC
    assert classify(time, swing, Known(25_000.0, 1e-3)).regime is Regime.SLIDING


@pytest.mark.parametrize("known", [Known(), Known(1000.0, 0.03, 0.5 / 13.8)])
def test_a_swing_that_dies_out_is_no_stick_slip(known: Known) -> None:
    time = np.arange(1000) / 1000.0
    force = 0.4 - 0.4 * np.exp(-time) * np.cos(2.0 * np.pi * 13.8 * time)
    assert classify(time, force + 4e-3 * np.random.default_rng(0).standard_normal(1000), known).regime is Regime.SLIDING


@pytest.mark.parametrize("rate", [50.0, 200.0, 2000.0])
def test_drops_that_differ_are_uneven_whatever_the_sampling(rate: float) -> None:
    assert classify(*saw(0.25, rate)).regime is Regime.UNEVEN_STICK_SLIP
    assert classify(*saw(0.0, rate)).regime is Regime.STICK_SLIP


# The last two rise straight enough, and at slopes that no sticks have.
@pytest.mark.parametrize(("kind", "seed"), [*((k, 900) for k in KINDS), ("slow_noise", 38), ("running_in", 40)])
def test_drawn_records_of_every_kind(kind: str, seed: int) -> None:
    made = drawn(kind, seed)
    seen = inspection("a.csv", made.record, StatedRig(made.rig["stiffness"], None, made.rig["mass"])).regime
    assert seen.regime == made.regime, seen.evidence


def largest_drawdown(force):
    """Of means over powers of two, in standard deviations that their second differences show."""
    worst, width = 0.0, 1
    while force.size // width >= 30:
        means = np.add.reduceat(force[: force.size // width * width], range(0, force.size // width * width, width))
        sd = 1.4826 * np.median(np.abs(np.diff(means, 2))) / np.sqrt(6.0)
        worst, width = max(worst, np.max(np.maximum.accumulate(means) - means) / sd), 2 * width
    return worst


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_no_drop_is_said_to_be_noise_that_is_more_and_counts_agree(kind):
    for number in (1, 2):
        record = drawn(kind, number).record
        seen = look(record, drive_of(record, recorded_drive(record)))
        for stroke, verdict in zip(seen.strokes, seen.verdicts, strict=True):
            text, slips = "; ".join(verdict.evidence), verdict.phases.count
            if "no drop of the force" in text:
                force = stroke.direction * record.friction_force[stroke.start : stroke.stop]
                assert largest_drawdown(force) < 12.0
            if verdict.regime is not None:
                assert verdict.regime.slips == (slips > 0) or "then it slides" in text
