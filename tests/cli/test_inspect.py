"""`inspect`: the verdict a person looking at the plot agrees with, and a plot that shows what was found."""

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from data_io import Record, write_csv, write_hdf5
from identify import examples
from identify.cli import inspection_plot
from identify.cli import main as cli
from identify.cli.inspection import StatedRig, inspection
from tests.support.verdict_cases import noise, saw

MEASURED = Path(__file__).resolve().parents[3] / "shared" / "data" / "paper_on_paper"
# what somebody who looks at the plot says of each record, beside its spikes
SEEN = {
    "k168_v42": {"spikes", "uneven_cycles", "friction_drift"},
    "k1002_v42": {"spikes", "uneven_cycles"},
    "k168_v1100": {"spikes", "uneven_cycles", "stick_slope"},
    "k1002_v4300": {"spikes", "near_harmonic", "stick_slope"},
}


@pytest.mark.parametrize("name", SEEN)
def test_the_verdict_on_measured_records_is_that_of_a_person(name, capsys):
    path = MEASURED / f"{name}.csv"
    if not path.is_file():
        pytest.skip("the measured paper-on-paper records are not on this machine")
    stiffness, speed = (word[1:] for word in name.split("_"))
    arguments = ["inspect", str(path), "--stiffness", f"{stiffness} N/m", "--drive-speed", f"{speed} um/s", "--json"]
    assert cli.main(arguments) == 0
    quality = json.loads(capsys.readouterr().out)["logs"][0]["quality"]
    assert quality["verdict"] == "accept with warnings"
    assert {f["code"] for f in quality["findings"] if f["severity"] != "info"} == SEEN[name]


def log_with_everything():
    """Rest with an offset, stick-slip with three spikes and a gap, a stop; the drive's own column tells of it."""
    time = np.delete(np.arange(6000) / 500.0, slice(2500, 2505))
    moving = (time >= 1.0) & (time < 11.0)
    force = np.where(moving, 0.4 + saw(time - 1.0), np.where(time < 1.0, 0.05, 0.33)) + noise(1, time.size)
    rows = np.searchsorted(time, [3.1, 6.7, 8.3])
    force[rows] += 0.3
    track = 1e-3 * np.clip(time - 1.0, 0.0, 10.0)
    return Record(
        time, 1.0 + noise(2, time.size), force, channels={"Position": track}, channel_units={"Position": "m"}
    ), time[rows]


def drawn(monkeypatch, seen, path):
    figures = []
    monkeypatch.setattr(Figure, "savefig", lambda self, *_, **__: figures.append(self) or path.touch())
    monkeypatch.setattr(inspection_plot, "atomic_path", lambda target: __import__("contextlib").nullcontext(target))
    inspection_plot.draw(seen, path)
    return figures[0].subfigs


def test_the_plot_shows_phases_and_spikes_as_found(monkeypatch, tmp_path):
    record, times = log_with_everything()
    seen = inspection("a.csv", record)
    codes = {f.code for f in seen.judgement.findings}
    assert codes == {"residual_force", "stopped", "dropouts", "spikes"}
    (part,) = drawn(monkeypatch, [seen], tmp_path / "a.png")
    whole, close = part.axes[:2]
    handles = dict(zip(*reversed(whole.get_legend_handles_labels()), strict=True))
    assert {"slip", "spike"} <= set(handles) and close.get_title().endswith(" s")
    spikes = next(line for line in whole.lines if line.get_label() == "spike")
    np.testing.assert_array_equal(spikes.get_xdata(), times)
    assert part.get_suptitle().startswith("a.csv · accept with warnings: ")
    low, high = whole.get_ylim()
    assert low < record.friction_force.min() and high > record.friction_force.max()


def test_a_clean_log_shows_neither_spikes_nor_rests(monkeypatch, tmp_path):
    time = np.arange(4000) / 500.0
    seen = inspection("clean.csv", Record(time, 1.0 + noise(2), 0.4 + saw(time) + noise(1)))
    (part,) = drawn(monkeypatch, [seen], tmp_path / "a.png")
    labels = set(part.axes[0].get_legend_handles_labels()[1])
    assert labels == {"slip"} and part.get_suptitle() == "clean.csv · accept"


def test_no_spike_of_a_long_log_is_thinned_away(monkeypatch, tmp_path):
    time = np.arange(60_000) / 2000.0
    force = 0.4 + saw(time) + noise(1, time.size)
    force[30_001] += 1.0
    seen = inspection("long.csv", Record(time, np.ones(time.size), force))
    (part,) = drawn(monkeypatch, [seen], tmp_path / "a.png")
    assert part.axes[0].get_ylim()[1] > 1.4


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_pictures_of_several_logs_are_written(tmp_path, ending, capsys):
    record, _ = log_with_everything()
    for name in ("one $log$.csv", "zwei µ.csv"):
        write_csv(record, tmp_path / name)
    plot = tmp_path / f"both.{ending}"
    logs = sorted(str(path) for path in tmp_path.glob("*.csv"))
    assert cli.main(["inspect", *logs, "--plot", str(plot)]) == 0
    assert plot.stat().st_size > 5000 and "verdict: accept with warnings" in capsys.readouterr().out


def test_one_bad_log_among_many_is_rejected_and_the_others_are_seen(tmp_path, capsys):
    record, _ = log_with_everything()
    write_csv(record, tmp_path / "good.csv")
    (tmp_path / "bad.csv").write_text("T,Fx,Fz\ns,N,N\n0,1,1\n1,1,1\n0.5,1,1\n")
    assert cli.main(["inspect", str(tmp_path / "bad.csv"), str(tmp_path / "good.csv"), "--json"]) == 2
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == "error" and "1 of 2 logs cannot be read" in told["message"]
    verdicts = [log["quality"]["verdict"] for log in told["logs"]]
    assert verdicts == ["reject", "accept with warnings"]
    assert "falls from" in told["logs"][0]["quality"]["findings"][0]["message"]


def test_several_logs_end_in_a_table_of_all(tmp_path, capsys):
    logs = [examples.FOLDER / name for name in ("1_mm_per_s.txt.gz", "0.1_mm_per_s_at_50_Hz.txt.gz")]
    (tmp_path / "bad.csv").write_text("T,Fx,Fz\ns,N,N\n0,1,1\n1,1,1\n0.5,1,1\n")
    assert cli.main(["inspect", *map(str, logs), str(tmp_path / "bad.csv")]) == 2
    head, stepped, coarse, bad = capsys.readouterr().out.splitlines()[-4:]
    assert head.split()[0] == "log" and max(map(len, (head, stepped, coarse, bad))) <= 80
    assert stepped.split() == ["1_mm_per_s.txt.gz", "1000", "Hz", "several", "stick", "slip", "13", "accept"]
    assert coarse.split()[:3] == ["0.1_mm_per_s_at_50_Hz.t…", "50", "Hz"] and coarse.endswith("warnings")
    assert bad.split() == ["bad.csv", *["–"] * 4, "reject"]


def test_the_table_of_all_names_every_run_of_an_archive(tmp_path, capsys):
    logs = [str(examples.FOLDER / f"{speed}_mm_per_s.txt.gz") for speed in (1, 5)]
    archive = str(tmp_path / "a.h5")
    assert cli.main(["convert", *logs, "--out", archive]) == 0
    capsys.readouterr()
    assert cli.main(["inspect", archive, archive]) == 0
    lines = capsys.readouterr().out.splitlines()[-4:]
    assert [line.strip()[:10] for line in lines] == ["a.h5 run 1", "a.h5 run 2"] * 2


def test_thresholds_rig_and_window_of_the_command_line(tmp_path, capsys):
    record, _ = log_with_everything()
    write_hdf5(record, tmp_path / "a.h5")
    base = ["inspect", str(tmp_path / "a.h5"), "--json"]

    def codes(*more):
        assert cli.main([*base, *more]) == 0
        (log,) = json.loads(capsys.readouterr().out)["logs"]
        return {f["code"] for f in log["quality"]["findings"] if f["severity"] != "info"}, log

    assert codes()[0] == {"residual_force", "stopped", "dropouts"}
    moved = "residual_force=0.5,stopped_rows=1,missing_rows=0.1"
    assert codes("--threshold", moved)[0] == set()
    found, log = codes("--window", "1.2 s,4 s", "--channels", "none")
    assert found == set() and log["columns"].keys() == {"time", "normal_force", "friction_force"}
    # the sticks rise by 0.2 N in 0.36 s
    assert "stick_slope" not in codes("--stiffness", "555 N/m", "--drive-speed", "1 mm/s")[0]
    assert "stick_slope" in codes("--stiffness", "640 N/m", "--drive-speed", "1 mm/s")[0]
    for wrong in (
        ["--threshold", "jiter=1"],
        ["--threshold", "jitter=much"],
        ["--window", "3"],
        ["--stiffness", "2 kg"],
    ):
        assert cli.main([*base, *wrong]) == 2


def test_the_gate_of_the_report_and_that_of_inspect_are_one():
    record, _ = log_with_everything()
    told = inspection("a.csv", record, StatedRig(500.0, 1e-3)).judgement.result()
    assert told.figures["residual_force"].value == pytest.approx(0.05, abs=1e-3)
    assert told.figures["force_after_stop"].value == pytest.approx(0.33, abs=1e-3)
    assert told.figures["missing_rows"].value == 5 and told.figures["spikes"].value == 3
    assert told.figures["stick_slope_error"].value == pytest.approx(0.2 / 0.36 / 0.5 - 1, abs=0.02)


def test_a_long_log_shows_its_progress_and_a_short_one_does_not(tmp_path, capsys, monkeypatch):
    record, _ = log_with_everything()
    write_hdf5(record, tmp_path / "a.h5")
    assert cli.main(["inspect", str(tmp_path / "a.h5")]) == 0
    assert "reading" not in capsys.readouterr().err
    monkeypatch.setattr("identify.cli.common.LONG", 1000)
    assert cli.main(["inspect", str(tmp_path / "a.h5")]) == 0
    assert "reading a.h5" in capsys.readouterr().err
