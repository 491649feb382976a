"""One name, one number: `inspect`, the classical table and the result of a fit agree on what they say of a log."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from data_io import read_log
from identify import Scene
from identify.base.document import to_dict
from identify.cli.logs import StatedRig, document, inspection
from identify.effects import MAIN
from identify.examples import FOLDER, SCENE
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.report.log_document import log_result

MEASURED = Path(__file__).resolve().parents[3] / "shared" / "data" / "paper_on_paper"
UNFITTED = SimpleNamespace(attempt=None, estimated=None, status=None, left_out={})


def _scene(path, which):
    if path.parent == FOLDER:
        scene = Scene.from_toml(SCENE)
        return scene, scene.logs[which]
    if not path.exists():
        pytest.skip(f"{path.name} is not here")
    rig = {"mass": "30.7 g", "stiffness": f"{which} N/m", "damping": "1 N/m", "drive_speed": "42 um/s"}
    scene = Scene.from_document({"effects": MAIN, "rig": rig, "logs": [{"path": str(path)}]}, Path())
    return scene, scene.logs[0]


@pytest.mark.parametrize(("path", "which"), [(FOLDER / "1_mm_per_s.txt.gz", 2), (MEASURED / "k168_v42.csv", 168)])
def test_every_place_says_the_same_of_a_log(path, which):
    scene, entry = _scene(path, which)
    record, rig = read_log(path, step=entry.step), scene.rig_for(entry)
    seen = document(inspection(str(path), record, StatedRig(rig.stiffness, rig.drive_speed, rig.mass)))
    fitted = to_dict(log_result(0, prepare(scene, entry, record, from_scene(scene)), UNFITTED, None))
    (row,), (step,) = seen["classical"]["rows"], seen["steps"]
    assert fitted["classical"]["rows"] == [row]
    assert seen["quality"]["load_N"] == fitted["normal_force_N"] == pytest.approx(row["normal_force_N"])
    assert 100 * seen["quality"]["load_drift"] == pytest.approx(row["normal_force_drift_percent"])
    figures = {name: figure["value"] for name, figure in fitted["quality"]["figures"].items()}
    inspected = {name: figure["value"] for name, figure in seen["quality"]["figures"].items()}
    assert inspected == figures
    assert figures["normal_force"] == pytest.approx(row["normal_force_N"])
    assert 100 * figures["normal_force_drift"] == pytest.approx(row["normal_force_drift_percent"])
    assert (row["drop_N"], row["drop_sd_N"]) == tuple(step["drop_N"])
    assert step["period_s"][0] == pytest.approx(1 / row["frequency_Hz"])
    assert step["stick_slope_N_per_s"][0] == row["stick_slope_N_per_s"]
    assert step["samples_per_slip"] == row["samples_per_slip"]
    assert fitted["slip_count"] == step["cycles"] == row["cycles"]
    assert step["noise_N"] == row["noise_N"]
