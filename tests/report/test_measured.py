"""What a refused fit shows of the record itself: the cycles as measured, as a picture and as CSV."""

from dataclasses import replace

import numpy as np
import pytest

from identify.report.cycle_figures import draw_cycles, draw_measured, measured_cycles
from identify.report.report_files import write_report
from tests.support.fake_fit import failed, fake_fit, without_cycles

pytestmark = pytest.mark.usefixtures("no_further_logs")


def test_the_numbers_are_those_of_the_cycles():
    """Strength over the load at the onset, hold time from the arrest before."""
    logs = fake_fit(samples=2000, scatter=0.1).logs
    drawn = draw_measured(logs)
    assert drawn is not None
    table = measured_cycles(logs)
    first = table["log"] == 1
    cycles = logs[0].measured
    load = np.interp(cycles[:, 0], logs[0].time, logs[0].normal_force)
    assert table["strength"][first] == pytest.approx(cycles[:, 2] / load)
    assert table["hold_s"][first][1:] == pytest.approx(cycles[1:, 0] - cycles[:-1, 1]) and np.isnan(table["hold_s"][0])
    means = drawn.tables["measured_means"]
    inside = (logs[0].time >= cycles[0, 0]) & (logs[0].time <= cycles[-1, 0]) & logs[0].used
    assert means["mean_coefficient"][0] == pytest.approx(
        np.mean((logs[0].friction_force / logs[0].normal_force)[inside])
    )


def test_every_picture_of_the_cycles_holds_their_numbers():
    """Histograms of strength, drop and hold time; strength against hold time; mean coefficient against drive speed."""
    logs = fake_fit(samples=2000, scatter=0.1).logs
    table, drawn = measured_cycles(logs), draw_measured(logs)
    assert table["drop_N"] == pytest.approx(table["onset_force_N"] - table["arrest_force_N"])
    axes = drawn.figure.axes
    for place, (name, words) in enumerate((("strength", "strength"), ("drop_N", "drop"), ("hold_s", "hold time"))):
        counted = sum(np.asarray([bar.get_height() for bar in axes[place].patches]))
        assert counted == np.count_nonzero(np.isfinite(table[name])) and words in axes[place].get_xlabel()
    for number, line in enumerate(axes[3].lines, 1):
        mine = table["log"] == number
        np.testing.assert_allclose(line.get_xydata(), np.column_stack([table["hold_s"], table["strength"]])[mine])
    assert len(axes[3].lines) == len(logs) and axes[3].get_xlabel().startswith("hold time")
    (means,) = axes[4].lines
    speeds = [1e3 * abs(log.drive_speed) for log in logs]
    np.testing.assert_allclose(
        means.get_xydata(), np.column_stack([speeds, drawn.tables["measured_means"]["mean_coefficient"]])
    )


def test_a_log_with_hardly_a_cycle_is_left_out_and_none_at_all_draws_nothing():
    fit = fake_fit(samples=2000)
    few = replace(fit.logs[0], measured=fit.logs[0].measured[:2])
    drawn = draw_measured([few, *fit.logs[1:]])
    assert drawn is not None and drawn.tables["measured_means"]["mean_coefficient"].size == 3
    assert draw_measured(without_cycles(fit).logs) is None


def test_cycles_that_are_alike_but_for_rounding_are_drawn():
    fit = fake_fit(samples=2000)
    onset = np.arange(1.0, 9.0)
    arrest = onset + 0.25
    arrest[0] = np.nextafter(arrest[0], 2.0)
    alike = replace(fit.logs[0], measured=np.column_stack([onset, arrest, np.full(8, 0.6), np.full(8, 0.4)]))
    assert 0.0 < np.ptp(measured_cycles([alike])["hold_s"][1:]) < 1e-15
    drawn = draw_measured([alike])
    assert drawn is not None and sum(bar.get_height() for bar in drawn.figure.axes[2].patches) == 7


def test_only_a_refused_fit_shows_it_and_its_captions_say_as_measured(tmp_path):
    fit = fake_fit(samples=2000, logs=2)
    refused = failed(fit, "model_misfit", "the model does not follow log 2")
    write_report(refused, tmp_path / "refused")
    page = (tmp_path / "refused" / "report.html").read_text(encoding="utf-8")
    assert 'id="measured"' in page and "cycle to cycle as measured" in page and "motion as fitted" not in page
    table = tmp_path / "refused" / "figures" / "measured_cycles.csv"
    header, *rows = table.read_text().splitlines()
    assert (
        header == "log,cycle,onset_s,arrest_s,onset_force_N,arrest_force_N,strength,drop_N,hold_s" and len(rows) == 18
    )
    of_refused = table.read_bytes()
    write_report(fit, tmp_path / "refused")
    assert 'id="measured"' not in (tmp_path / "refused" / "report.html").read_text(encoding="utf-8")
    assert [path.name for path in (tmp_path / "refused" / "figures").glob("measured*")] == ["measured_cycles.csv"]
    assert table.read_bytes() == of_refused
    assert "as fitted" in draw_cycles(fit.logs[0], 1).caption
