"""A fit in Python: what it shows of itself, its tables, its predictions, and the door `identify`."""

import json
import pickle
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import identify
from data_io import read_log
from identify import Fit, FitError, FitOptions, Scene, SceneError, simulate
from identify.base.document import as_json
from identify.report import figures, style
from identify.report.figures import available
from tests.support.fake_fit import EFFECTS, RIG, TRUTH, failed, fit_of_a_scene, with_verdicts


@pytest.fixture(scope="module")
def fit():
    return fit_of_a_scene()


def test_a_fit_shows_its_summary_on_one_screen(fit):
    text = repr(fit)
    assert len(text) < 3000 and len(text.splitlines()) < 30 and max(map(len, text.splitlines())) <= 79
    assert "mu_s" in text and "0.6200" in text and "identified" in text
    refused = repr(failed(fit, "model_misfit", "the model does not follow log 2"))
    assert refused == "model misfit: the model does not follow log 2"


def test_a_notebook_gets_the_first_screen_with_styles_that_stay_inside(fit):
    page = fit._repr_html_()
    assert "fit accepted" in page and 'class="parameters"' in page and "<html" not in page and "<script" not in page
    style = page[page.index("<style>") : page.index("</style>")]
    assert style.replace("<style>", "").strip().startswith("@scope (.stickslip)")
    assert ":root" not in style and "\nbody" not in style


def test_tables_hold_the_numbers_of_the_document(fit):
    frame = fit.parameters
    assert list(frame.index) == list(fit.result["parameters"])
    assert frame.loc["D", "value"] == fit.result["parameters"]["D"]["value"]
    assert frame.loc["D", "lower"] < frame.loc["D", "value"] < frame.loc["D", "upper"]
    assert np.isnan(failed(fit, "model_misfit", "no").parameters["value"]).all()
    assert len(fit.classical) == 4 and set(fit.classical["log"]) == {1, 2, 3, 4}
    cycles = fit.cycles
    first = cycles[cycles["log"] == 1]
    assert np.allclose(first["onset_s"], fit.logs[0].cycles[:, 0])
    assert np.allclose(first["hold_s"].iloc[1:], first["onset_s"].iloc[1:].to_numpy() - first["arrest_s"].iloc[:-1])
    assert np.allclose(cycles["drop_N"], cycles["onset_force_N"] - cycles["arrest_force_N"])


def test_a_folder_of_a_fit_is_loaded_with_its_curves_and_drawn(fit, tmp_path, monkeypatch):
    monkeypatch.setattr("identify.report.figures.pictures", lambda _: ())  # of no matter here
    fit.save(tmp_path)
    again = Fit.load(tmp_path)
    assert again.cycles.equals(fit.cycles) and np.array_equal(again.residuals(2), fit.residuals(2), equal_nan=True)
    left = again.plot_residuals(2).lines[0].get_ydata()
    assert np.nanstd(left) == pytest.approx(np.nanstd(fit.residuals(2)) / fit.logs[1].noise)
    forces = again.plot_forces(2)
    assert np.array_equal(forces.lines[1].get_ydata(), fit.logs[1].fitted_force, equal_nan=True)
    bars = again.plot_residual_histogram()
    assert sum(bar.get_height() * bar.get_width() for bar in bars.patches) == pytest.approx(1.0), "a density"
    assert again.plot_correlation(forces) is forces
    assert next(label.get_text() for label in again.plot_parameters().get_yticklabels()) == "μₛ"


def test_the_laws_are_drawn_with_their_values_and_band(fit):
    """Eq. (6) at both ends of the speeds, eqs. (3) and (5) after a long rest; the band holds the curve."""
    p = {name: entry["value"] for name, entry in fit.result["parameters"].items()}
    friction, ageing = fit.plot_friction(), fit.plot_ageing()
    curve = friction.lines[0].get_ydata()
    assert curve[0] == pytest.approx(p["mu_k0"], rel=1e-2) and curve[-1] == pytest.approx(
        p["mu_k0"] + p["delta_mu_k"], rel=1e-3
    )
    assert ageing.lines[0].get_ydata()[-1] == pytest.approx(p["mu_s"], rel=1e-3)
    band = friction.collections[0].get_paths()[0].vertices[:, 1]
    assert band.min() < curve.min() and band.max() > curve.max()
    with pytest.raises(FitError, match="no profile of a"):
        fit.plot_profile("a")


def test_a_law_with_a_parameter_that_is_not_determined_is_no_figure_of_the_report(fit):
    """Nor one of a scene that is none any more, whose fit still has its report; of a log that was left out no law."""
    laws = {"friction_over_speed", "strength_over_rest"}
    assert laws <= set(available(fit)) and laws & set(available(with_verdicts(fit))) == set()
    lost = replace(fit, result={**fit.result, "provenance": {**fit.result["provenance"], "scene": {"rig": 1}}})
    assert not laws & set(available(lost)) and "intervals" in available(lost)
    first, *others = fit.result["logs"]
    left_out = replace(fit, result={**fit.result, "logs": [{**first, "reason_left_out": "noisy"}, *others]})
    assert available(left_out)["friction_over_speed"].args[2] == {"log": 2}


@pytest.fixture(scope="module")
def exact(fit):
    """The same without errors, so that predictions draw nothing."""
    return replace(fit, result={**fit.result, "correlation": None})


def test_a_stored_fit_predicts_and_has_no_curves(exact, tmp_path):
    (tmp_path / "result.json").write_text(as_json(exact.result), encoding="utf-8")
    again = Fit.from_json(tmp_path / "result.json")
    assert repr(again) == repr(exact) and again.result == json.loads(as_json(exact.result))
    assert exact.plot(2).axes[0].get_ylabel() == "friction force (N)"
    with pytest.raises(FitError, match=r"no values \(model_misfit\): the model does not follow log 2"):
        failed(exact, "model_misfit", "the model does not follow log 2").predict(drive_speed="1 mm/s")
    for curves in (lambda: again.cycles, again.plot):
        with pytest.raises(FitError, match="without curves"):
            curves()
    assert again.predict(drive_speed="1 mm/s").document == again.predict(log=3).document  # log 3 ran at 1 mm/s
    with pytest.raises(FitError, match="this fit has 4, counted from 1"):
        again.predict(log=5)
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(FitError, match="no result of a fit"):
        Fit.from_json(tmp_path / "other.json")


def test_a_prediction_is_that_of_the_scene_with_these_values(exact):
    """Against the forward simulation of a scene that was written by hand with the estimates."""
    parameters = {name: {"fixed": value} for name, value in TRUTH.items()}
    rig = {**RIG, "drive_speed": "2 mm/s"}
    by_hand = simulate(Scene.from_document({"effects": EFFECTS, "rig": rig, "parameters": parameters}), "4 s")
    predicted = exact.predict(drive_speed="2 mm/s")
    period = np.diff(by_hand.onsets)[-1]
    assert predicted.document["amplitude"]["period"]["value"] == pytest.approx(period, rel=1e-4)
    assert predicted.to_frame().loc["period", "value"] == pytest.approx(period, rel=1e-4)
    other = exact.predict(drive_speed="1 mm/s").document["amplitude"]["period"]["value"]
    assert other != pytest.approx(period, rel=1e-2)  # the speed that was asked for decides
    assert "2 mm/s" in repr(predicted) and max(map(len, repr(predicted).splitlines())) <= 79
    moved = exact.simulate("4 s", drive_speed=0.002)
    assert moved.onsets == pytest.approx(by_hand.onsets, rel=1e-6)


def test_a_motion_is_a_table_and_a_picture():
    scene = Scene.from_document({"effects": EFFECTS, "rig": {**RIG, "drive_speed": "1 mm/s"}})
    motion = simulate(scene, "2 s", drive="3 mm/s", normal_force="2 N")
    same = simulate(scene, 2.0, drive=0.003, normal_force=2.0)
    assert np.array_equal(motion.onsets, same.onsets) and motion.onsets.size > 3
    assert str(motion).startswith("simulated motion of 2 s with") and len(str(motion)) < 200
    even, dense = motion.to_frame("1 kHz"), motion.to_frame()
    assert len(even) == 2001 and np.allclose(np.diff(even["time"]), 1e-3)
    assert np.allclose(even["force"], motion.sample(even["time"])["force"])
    assert set(motion.onsets) <= set(dense["time"])  # no slip is between two rows
    assert motion.plot().axes[0].get_ylabel() == "friction force (N)"
    with pytest.raises(SceneError, match="drive speed"):
        simulate(scene, "2 s", drive="3 kg")


@pytest.mark.parametrize(
    ("call", "nearest"),
    [
        (lambda fit: identify.fit("pair.toml", timelimit=3), "time_limit"),
        (lambda fit: read_log("slow.csv", colums={}), "columns"),
        (lambda fit: FitOptions(profil=True), "profile"),
        (lambda fit: fit.predict(drivespeed=1), "drive_speed"),
        (lambda fit: fit.plot_force(), "plot_forces"),
        (lambda fit: fit.scene(1).tolerance, "tolerances"),
    ],
)
def test_a_misspelt_name_is_answered_by_the_nearest(fit, call, nearest):
    with pytest.raises((TypeError, AttributeError), match=f"did you mean '{nearest}'"):
        call(fit)
    assert not hasattr(fit, "_ipython_display_") and pickle.loads(pickle.dumps(fit)).result == fit.result


def test_figures_for_a_paper_have_its_widths_and_captions(fit, tmp_path, monkeypatch):
    """In SVG points: 3.4 and 7.1 inch; no letter below 6 points, at most five entries in a legend."""
    drawn = available(fit)
    monkeypatch.setattr(figures, "available", lambda _: {name: drawn[name] for name in ("log_1_force", "intervals")})
    files = {path.name: path for path in fit.save_figures(tmp_path)}
    captions = files.pop("captions.txt").read_text(encoding="utf-8").split("\n\n")
    assert len(files) == 6 * len(captions) and any(text.startswith("intervals: 95 %") for text in captions)
    for columns, width in ((1, 3.4), (2, 7.1)):
        text = files[f"log_1_force_{columns}_column.svg"].read_text(encoding="utf-8")
        assert float(re.search(r'width="([\d.]+)pt"', text)[1]) == pytest.approx(72 * width, rel=1e-3)
        assert min(float(size) for size in re.findall(r"font[^;]*?([\d.]+)px", text)) >= 6.0
        head = files[f"log_1_force_{columns}_column.png"].read_bytes()[16:20]
        assert int.from_bytes(head, "big") == pytest.approx(300 * width, abs=1)
    with style.drawing_style():
        kinds = {name: draw for name, draw in drawn.items() if not name.startswith(("log_2", "log_3", "log_4"))}
        legends = [axes.get_legend() for draw in kinds.values() for axes in draw(columns=1).figure.axes]
    assert max(len(legend.get_texts()) for legend in legends if legend) <= 5


def test_the_door_lists_what_is_public_and_opens_quickly():
    assert {"Scene", "fit", "Fit", "simulate", "SceneError", "FitError", "IdentifyError"} <= set(dir(identify))
    assert all(getattr(identify, name) is not None for name in dir(identify))
    code = "import sys, identify; identify.__version__; print([m for m in ('numpy', 'casadi') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
