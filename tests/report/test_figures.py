"""The figures of a fit: their numbers are those of the fit, no label is cut, what was not fitted is not drawn as it."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from identify.base.document import from_document
from identify.base.outcome import SlipDetail
from identify.base.result import OptimumResult, ParameterResult, ProfileResult
from identify.report import write_report
from identify.report.figures import draw_cycles, draw_force, draw_measured, measured_cycles
from identify.report.reconstruct import AS_FITTED, as_fitted
from identify.report.report_figures import draw_correlation, draw_optima, draw_profile
from tests.support.fake_fit import failed, fake_fit, without_cycles

TIME = np.arange(0.0, 0.2, 0.01)


@pytest.fixture(scope="module")
def fit():
    return fake_fit(samples=2000, scatter=0.1)


def outside(figure):
    """Labels of an axis that the edge of the figure cuts."""
    FigureCanvasAgg(figure).draw()
    cut = []
    for axes in figure.axes:
        low, high = sorted(axes.get_xlim())
        for place, label in zip(axes.get_xticks(), axes.get_xticklabels(), strict=False):
            box = label.get_window_extent()
            if low <= place <= high and label.get_visible() and label.get_text() and box.x1 > figure.bbox.x1:
                cut.append(label.get_text())
    return cut


def test_the_last_label_of_a_profile_and_of_a_log_is_not_cut(fit):
    """delta_mu_k in the last column, with a label at the very end of the axis."""
    half = 0.0003
    curve = {
        "values": (-0.2 + np.linspace(-half, half, 9)).tolist(),
        "loss": (3.9 * (np.linspace(-1, 1, 9)) ** 2).tolist(),
        "interval": [-0.2 - half, -0.2 + half],
        "standard_error": half / 2,
    }
    document = {"level": 0.95, "limit": 3.84, "parameters": dict.fromkeys(("x", "y", "delta_mu_k"), curve)}
    drawing = draw_profile(from_document(ProfileResult, document), {"delta_mu_k": ParameterResult(-0.2)})
    for axes in drawing.figure.axes:
        axes.set_xlim(-0.2 - half, -0.2 + half)
    assert outside(drawing.figure) == []
    log = replace(fit.logs[0], slip=None, time=np.linspace(0.0, 20.0, 2000), cycles=np.empty((0, 5)))
    assert outside(draw_force(log, 1, True).figure) == []


def test_a_waterfall_has_a_point_for_every_start_and_rises_from_the_lowest_optimum():
    drawing = draw_optima([OptimumResult(105.0, 2, {"D": 1e-5}), OptimumResult(100.0, 3, {"D": 3e-5})], 3.84)
    np.testing.assert_allclose(drawing.tables["optima"]["chi2_above_lowest"], [0.0, 0.0, 0.0, 5.0, 5.0])


def test_the_caption_of_the_correlation_is_true_of_what_is_drawn():
    caption = draw_correlation(["a", "b"], np.array([[1.0, 0.97], [0.97, 1.0]])).caption
    assert "the strongest is 0.97, between a and b" in caption


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
    for place, (name, words) in enumerate((("strength", "strength"), ("drop_N", "drop"), ("hold_s", "hold time"))):
        counted = sum(bar.get_height() for bar in axes[place].patches)
        assert counted == np.count_nonzero(np.isfinite(table[name])) and words in axes[place].get_xlabel()
    for position, line in enumerate(axes[3].lines, 1):
        mine = table["log"] == position
        np.testing.assert_allclose(line.get_xydata(), np.column_stack([table["hold_s"], table["strength"]])[mine])
    speeds = [1e3 * abs(log.drive_speed) for log in fit.logs]
    np.testing.assert_allclose(axes[4].lines[0].get_xydata(), np.column_stack([speeds, means]))


def test_logs_with_hardly_a_cycle_or_cycles_alike_but_for_rounding(fit):
    few = replace(fit.logs[0], measured=fit.logs[0].measured[:2])
    assert draw_measured([few, *fit.logs[1:]]).tables["measured_means"]["mean_coefficient"].size == 3
    assert draw_measured(without_cycles(fit).logs) is None
    onset = np.arange(1.0, 9.0)
    arrest = onset + 0.25
    arrest[0] = np.nextafter(arrest[0], 2.0)
    alike = replace(fit.logs[0], measured=np.column_stack([onset, arrest, np.full(8, 0.6), np.full(8, 0.4)]))
    assert sum(bar.get_height() for bar in draw_measured([alike]).figure.axes[2].patches) == 7


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


@pytest.mark.parametrize(("share", "drawn"), [(0.0, True), (0.9, True), (1.1, False)])
def test_a_slip_is_drawn_where_the_fit_has_it(share, drawn):
    """A slip of 60 ms from 0.05 s on; where nothing is fitted, nothing speaks against it."""

    def slip(delay):
        fine = np.linspace(0.03, 0.15, 400)
        force = 1.0 - 0.5 * np.clip((fine - 0.05 - delay) / 0.06, 0.0, 1.0)
        none = np.full(fine.size, np.nan)
        return SlipDetail(1, fine, force, none, none, none, none, np.flatnonzero((TIME > 0.03) & (TIME < 0.15)))

    reference, moved = slip(0.0), slip(share * AS_FITTED * 0.06)
    fitted = np.where((TIME > 0.03) & (TIME < 0.15), np.interp(TIME, reference.time, reference.force), np.nan)
    assert as_fitted(moved, TIME, fitted) == drawn
    assert as_fitted(moved, TIME, np.full(TIME.size, np.nan))
