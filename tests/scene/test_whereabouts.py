"""Logs that are folders, patterns or files in an archive: one digest wherever they lie, a sentence where none do."""

import shutil

import pytest

from data_io import read_log
from data_io.contents import digest_of, log_is_at
from identify.cli.main import main
from tests.scene.test_scene import GOOD


@pytest.fixture
def strokes(tmp_path):
    """One log in three files, which a pattern names."""
    (tmp_path / "logs").mkdir()
    for i in range(3):
        rows = "".join(f"{10 * i + j},1,0.{j}\n" for j in range(9))
        (tmp_path / "logs" / f"stroke_{i + 1}.csv").write_text(f"T (s),Fz (N),Fx (N)\n{rows}")
    return tmp_path / "logs" / "stroke_*.csv"


def test_a_series_is_known_by_its_digest_where_it_lay_and_where_it_lies_now(strokes, tmp_path):
    digest = digest_of(strokes)
    assert digest == read_log(strokes).metadata["sha256"]
    shutil.move(str(tmp_path / "logs"), str(tmp_path / "elsewhere"))
    moved = tmp_path / "elsewhere" / strokes.name
    assert digest_of(moved) == digest and log_is_at(moved) and not log_is_at(strokes)
    first = tmp_path / "elsewhere" / "stroke_1.csv"
    first.write_text(first.read_text().replace("T (s)", "t (s)"))
    assert digest_of(moved) != digest, "negative control"


@pytest.mark.parametrize("path", ["none.csv", "empty", "logs/none_*.csv", "none.zip/a.csv"])
def test_nothing_is_nothing(strokes, tmp_path, capsys, path):
    (tmp_path / "empty").mkdir()
    assert not log_is_at(tmp_path / path)
    (tmp_path / "scene.toml").write_text(GOOD.replace("slow.csv", path).partition('[[logs]]\npath = "sub')[0])
    assert main(["fit", "--scene", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]) == 2
    said = "is a folder that holds no log" if path == "empty" else "there is no such log"
    assert said in capsys.readouterr().err
