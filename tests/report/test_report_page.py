"""The page of a fit as a browser shows it: nothing that is to be read lies behind a scroll bar or beyond an edge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from identify.base.document import from_document
from identify.base.result import OptimumResult, ParameterResult, ProfileResult
from identify.report.force_figure import draw_force
from identify.report.uncertainty_figures import draw_optima, draw_profile
from tests.support.fake_fit import fake_fit


def outside(figure):
    """Labels of an axis that the edge of the figure cuts."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    found = []
    for axes in figure.axes:
        low, high = sorted(axes.get_xlim())
        for place, label in zip(axes.get_xticks(), axes.get_xticklabels(), strict=False):
            box = label.get_window_extent()
            if low <= place <= high and label.get_visible() and label.get_text() and box.x1 > figure.bbox.x1:
                found.append(label.get_text())
    return found


def test_the_last_label_of_a_profile_is_not_cut():
    """delta_mu_k in the last column, with a label that stands at the very end of the axis."""
    half = 0.0003
    values = -0.2 + np.linspace(-half, half, 9)
    curve = {
        "values": values.tolist(),
        "loss": (3.9 * (np.linspace(-1, 1, 9)) ** 2).tolist(),
        "interval": [-0.2 - half, -0.2 + half],
        "standard_error": half / 2,
        "failed": [False, False],
        "at_bound": [False, False],
        "logarithmic": False,
    }
    document = {"level": 0.95, "limit": 3.84, "parameters": dict.fromkeys(("x", "y", "delta_mu_k"), curve)}
    drawing = draw_profile(from_document(ProfileResult, document), {"delta_mu_k": ParameterResult(-0.2)})
    assert drawing is not None
    for axes in drawing.figure.axes:
        axes.set_xlim(-0.2 - half, -0.2 + half)
    assert outside(drawing.figure) == []


def test_a_waterfall_has_a_point_for_every_start_and_rises_from_the_lowest_optimum():
    optima = [OptimumResult(105.0, 2, {"D": 1e-5}), OptimumResult(100.0, 3, {"D": 3e-5})]
    drawing = draw_optima(optima, 3.84)
    rise = drawing.tables["optima"]["chi2_above_lowest"]
    np.testing.assert_allclose(rise, [0.0, 0.0, 0.0, 5.0, 5.0])
    assert outside(drawing.figure) == []


def test_the_last_label_of_a_log_is_not_cut():
    curves = replace(fake_fit(logs=1).logs[0], slip=None)
    time = np.linspace(0.0, 20.0, curves.time.size)
    drawing = draw_force(replace(curves, time=time, cycles=np.empty((0, 5))), 1, True)
    assert outside(drawing.figure) == []
