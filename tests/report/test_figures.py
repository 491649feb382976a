"""The figures of a fit: their numbers are those of the fit, no label is cut, what was not fitted is not drawn as it."""

from dataclasses import replace

import numpy as np
import pytest

from identify.report import write_report
from identify.report.figures import draw_cycles, draw_measured, measured_cycles
from tests.support.fake_fit import failed, fake_fit


@pytest.fixture(scope="module")
def fit():
    return fake_fit(samples=2000, scatter=0.1)


def test_the_measured_cycles_are_drawn_with_their_numbers(fit):
    """Strength over the load at the onset, hold time from the arrest before; every picture holds those of the table."""
    table, drawn = measured_cycles(fit.logs), draw_measured(fit.logs)
    log, first = fit.logs[0], table["log"] == 1
    onset, arrest, peak, valley = log.measured.T
    assert table["strength"][first] == pytest.approx(peak / np.interp(onset, log.time, log.normal_force))
    assert table["hold_s"][first][1:] == pytest.approx(onset[1:] - arrest[:-1]) and np.isnan(table["hold_s"][0])
    assert table["drop_N"][first] == pytest.approx(peak - valley)
    inside = (log.time >= onset[0]) & (log.time <= onset[-1]) & log.used
    means = drawn.tables["measured_means"]["mean_coefficient"]
    assert means[0] == pytest.approx(np.mean((log.friction_force / log.normal_force)[inside]))
    axes = drawn.figure.axes
    for panel, name, words in zip(
        axes, ("strength", "drop_N", "hold_s"), ("strength", "drop", "hold time"), strict=False
    ):
        counted = sum(bar.get_height() for bar in panel.patches)
        assert counted == np.count_nonzero(np.isfinite(table[name])) and words in panel.get_xlabel()
    against = np.concatenate([line.get_xydata() for line in axes[3].lines])
    np.testing.assert_allclose(against, np.column_stack([table["hold_s"], table["strength"]]))
    speeds = [1e3 * abs(log.drive_speed) for log in fit.logs]
    np.testing.assert_allclose(axes[4].lines[0].get_xydata(), np.column_stack([speeds, means]))


def test_only_a_refused_fit_shows_the_cycles_as_measured(fit, tmp_path):
    two = replace(fit, result={**fit.result, "logs": fit.result["logs"][:2]}, logs=fit.logs[:2])
    write_report(failed(two, "model_misfit", "the model does not follow log 2"), tmp_path)
    page, table = tmp_path / "report.html", tmp_path / "figures" / "measured_cycles.csv"
    text, of_refused = page.read_text(encoding="utf-8"), table.read_bytes()
    assert 'id="measured"' in text and "cycle to cycle as measured" in text and "motion as fitted" not in text
    header = "log,cycle,onset_s,arrest_s,onset_force_N,arrest_force_N,strength,drop_N,hold_s"
    assert of_refused.decode().splitlines()[0] == header and of_refused.count(b"\n") == 19
    write_report(two, tmp_path)
    assert 'id="measured"' not in page.read_text(encoding="utf-8") and table.read_bytes() == of_refused
    assert [path.name for path in (tmp_path / "figures").glob("measured*")] == ["measured_cycles.csv"]
    assert "as fitted" in draw_cycles(fit.logs[0], 1).caption
