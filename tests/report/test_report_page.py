"""The page of a fit as a browser shows it: nothing that is to be read lies behind a scroll bar or beyond an edge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from identify.base.document import from_document
from identify.base.result import ParameterResult, ProfileResult
from identify.report.force_figure import draw_force
from identify.report.report_page import render_page
from identify.report.uncertainty_figures import draw_profile
from tests.support.browser import CHROMIUM, Browser
from tests.support.fake_fit import fake_fit

MODELS = ("this fit", "without hysteresis_damping", "without contact_ageing", "without velocity_weakening")
VERDICT = "hysteresis damping earns its place; what was left out is foretold with 28 times the error"


def compared():
    told = {"parameters": 16, "chi2_per_sample": 1.07942, "delta_aic": 5855.1, "delta_bic": 5855.2}
    return [
        {"model": model, **told, "left_out_cycles": 1.0852, "left_out_logs": 27.93, "verdict": VERDICT}
        for model in MODELS
    ]


@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")
def test_the_verdicts_of_the_effects_are_seen_without_scrolling(tmp_path):
    fit = fake_fit(logs=1)
    page = tmp_path / "report.html"
    reason = {"effect": "inertia", "kept": True, "sentence": "the mass resists acceleration"}
    effects = {"names": ["inertia"], "chosen": "listed", "reasons": [reason]}
    told = {**fit.result, "effects": effects, "effects_table": compared()}
    page.write_text(render_page(replace(fit, result=told), []), "utf-8")
    with Browser() as browser:
        browser.open(page, 1200)
        hidden = "Array.from(document.querySelectorAll('#effects .scroll')).map(e => e.scrollWidth - e.clientWidth)"
        assert browser.run(f"Math.max(...{hidden})") == 0
        assert browser.run("document.querySelectorAll('#effects td.words').length") >= len(MODELS)


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


def test_the_last_label_of_a_log_is_not_cut():
    curves = replace(fake_fit(logs=1).logs[0], slip=None)
    time = np.linspace(0.0, 20.0, curves.time.size)
    drawing = draw_force(replace(curves, time=time, cycles=np.empty((0, 5))), 1, True)
    assert outside(drawing.figure) == []
