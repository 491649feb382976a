"""Logs that are folders, patterns or files in an archive: fitted from a scene, and found again by `verify`."""

import json
import shutil
import zipfile

import pytest

from data_io import read_log
from data_io.contents import digest_of, log_is_at
from identify.cli.main import main
from identify.examples import FOLDER

pytestmark = pytest.mark.usefixtures("no_predictions")

SCENE = """
name = "series"
effects = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening", "varying_normal_force"]
[rig]
mass = "0.2 kg"
stiffness = "1470 N/m"
damping = "147 N/m"
drive_speed = "1 mm/s"
[[logs]]
path = "{path}"
window = ["0.8 s", "4 s"]
[parameters]
D = { fixed = "37.4 um" }
t_cr = { fixed = "0.5 s" }
delta_mu_k = { fixed = -0.13 }
a = { fixed = "300 s/m" }
"""


@pytest.fixture
def bench(tmp_path):
    """One log of the example pair in three files in a folder, and the first of them in an archive."""
    record = read_log(FOLDER / "1_mm_per_s.txt.gz")
    folder = tmp_path / "logs"
    folder.mkdir()
    part = len(record) // 3 + 1
    for i in range(3):
        rows = slice(i * part, (i + 1) * part)
        columns = (record.time[rows], record.normal_force[rows], record.friction_force[rows])
        lines = [f"{t:.6f},{n:.6f},{f:.6f}\n" for t, n, f in zip(*columns, strict=True)]
        (folder / f"stroke_{i + 1}.csv").write_text("T (s),Fz (N),Fx (N)\n" + "".join(lines), encoding="ascii")
    with zipfile.ZipFile(tmp_path / "packed.zip", "w") as archive:
        archive.write(folder / "stroke_1.csv", "other.csv")
    return tmp_path


def test_a_fit_of_it_verifies_where_it_lay_and_where_it_lies_now(bench, capsys, monkeypatch):
    path = "logs/stroke_*.csv"
    monkeypatch.setattr("identify.report.figures.pictures", lambda _: ())  # neither is what is verified
    (bench / "scene.toml").write_text(SCENE.replace("{path}", path), encoding="utf-8")
    assert main(["fit", "--scene", str(bench / "scene.toml"), "--out", str(bench / "out")]) == 0
    result = bench / "out" / "result.json"
    (log,) = json.loads(result.read_text(encoding="utf-8"))["logs"]
    assert log["sha256"] == digest_of(bench / path) == read_log(bench / path).metadata["sha256"]
    moved = bench / "elsewhere"
    moved.mkdir()
    shutil.move(str(bench / "logs"), str(moved / "logs"))
    capsys.readouterr()
    assert main(["verify", str(result)]) == 2
    assert "no longer there" in capsys.readouterr().err
    assert main(["verify", str(result), str(moved / path)]) == 0
    first = moved / "logs" / "stroke_1.csv"
    first.write_text(first.read_text(encoding="ascii").replace("T (s)", "t (s)"), encoding="ascii")
    shutil.move(str(moved / "logs"), str(bench / "logs"))
    assert main(["verify", str(result)]) == 2
    assert "has changed" in capsys.readouterr().err


def test_nothing_is_nothing(bench, capsys):
    (bench / "empty").mkdir()
    for path in ("none.csv", "empty", "logs/none_*.csv", "packed.zip/none.csv", "none.zip/a.csv"):
        assert not log_is_at(bench / path)
        (bench / "scene.toml").write_text(SCENE.replace("{path}", path), encoding="utf-8")
        assert main(["fit", "--scene", str(bench / "scene.toml"), "--out", str(bench / "out")]) == 2
        said = "is a folder that holds no log" if path == "empty" else "there is no such log"
        assert said in capsys.readouterr().err
