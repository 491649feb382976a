"""Maps as files, pictures, on the command line and from scripts."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import pytest

from identify.base.errors import SimulationError
from identify.cli.main import main
from identify.prediction import sources
from identify.prediction.maps import line_map, stability_map, write_map
from identify.report.draw_map import draw_map
from tests.support.maps_case import SITE, SPANS


@pytest.fixture(scope="module")
def speed_and_stiffness():
    return stability_map(SITE, "drive_speed", "stiffness", *SPANS, (9, 7))


def test_a_map_is_stored_whole(tmp_path, speed_and_stiffness):
    made = speed_and_stiffness
    files = write_map(made, tmp_path / "map.csv")
    with files[0].open(encoding="utf-8") as handle:
        rows = list(csv.DictReader(handle))
    assert len(rows) == 63 and len(files) == 2
    first = rows[0]
    assert float(first["drive_speed [m/s]"]) == made.plane.x_values[0]
    assert float(first["drop [N]"]) == made.figures["drop"][0, 0]
    assert first["outcome"] == made.outcomes[0, 0]
    lines = list(csv.DictReader(files[1].open(encoding="utf-8")))
    assert len(lines) == sum(len(p) for b in (made.sticking, made.unstable) for p in made.values_of(b))
    with pytest.raises(SimulationError, match="no format"):
        write_map(made, tmp_path / "map.txt")
    answer = line_map(SITE, "mass", points=3)
    (path,) = write_map(answer, tmp_path / "line.csv")
    assert len(path.read_text(encoding="utf-8").splitlines()) == 4


@pytest.mark.parametrize("part", ["stability", "amplitude"])
def test_a_picture_is_one_journal_column_wide(tmp_path, speed_and_stiffness, part):
    import matplotlib.image

    tested = sources.Tested({"drive_speed": (1e-3, 5e-3), "stiffness": (1e3, 2e3)})
    draw_map(speed_and_stiffness, tmp_path / "map.png", part, [(1e-3, 1470.0), (5e-3, 1470.0)], tested)
    shape = matplotlib.image.imread(tmp_path / "map.png").shape
    assert shape[1] == pytest.approx(90 / 25.4 * 300, rel=0.01)


SCENE = """
effects = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]
[rig]
mass = "0.2 kg"
stiffness = { value = "1470 N/m", tolerance = "3 %" }
damping = "147 N/m"
drive_speed = "5 mm/s"
normal_force = "1 N"
[contact]
area = "0.8 cm^2"
[parameters]
mu_s = { fixed = 0.62 }
mu_k0 = { fixed = 0.43 }
delta_mu_k = { fixed = -0.13 }
a = { start = "300 s/m", prior = { mean = "300 s/m", sd = "20 s/m" } }
D = { fixed = "37.4 um" }
t_cr = { fixed = "0.5 s" }
"""


def test_the_command_line_draws_and_stores_maps(tmp_path, capsys):
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE, encoding="utf-8")
    asked = ["stability", "--scene", str(scene), "--json", "--map", "pressure", "area", "--points", "4"]
    files = ["--plot", str(tmp_path / "map.png"), "--data", str(tmp_path / "map.csv")]
    assert main([*asked, "--range", "pressure=2 kPa:50 kPa", *files]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["map"]["x"]["values"][0] == pytest.approx(2e3) and len(document["map"]["outcomes"]) == 4
    assert (tmp_path / "map.png").exists() and (tmp_path / "map.csv").exists()
    line = ["amplitude", "--scene", str(scene), "--json", "--map", "normal_force", "--points", "8"]
    assert main([*line, "--plot", str(tmp_path / "line.png")]) == 0
    (end,) = json.loads(capsys.readouterr().out)["map"]["end_of_stick_slip"]
    assert end["holds"] == "above" and end["value"] == pytest.approx(0.1503, rel=1e-3)


def test_scripts_map_a_scene_by_names(tmp_path):
    import identify

    path = tmp_path / "scene.toml"
    path.write_text(SCENE, encoding="utf-8")
    scene = identify.Scene.from_toml(path)
    made = identify.stability_map(scene, "drive_speed", "pressure", (2e-3, 5e-2), points=3)
    assert made.outcomes.shape == (3, 3) and made.plane.y.value == pytest.approx(1.0 / 0.8e-4)
    with pytest.raises(SimulationError, match="normal force"):
        identify.stability_map(replace(scene, rig=replace(scene.rig, normal_force=None)), "mass", "D")
