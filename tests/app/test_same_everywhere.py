"""The same fit, study and map in page, report, terminal and file: the same words and digits, the same colours."""

import csv
import html
import json
import re

import pytest

from experiments.batch_trials import SCENE as PAIR
from identify.app.folder import Folder
from identify.app.results import batch_seen, fit_seen
from identify.cli.main import main
from identify.report.report_tables import summary
from tests.support.fake_fit import fit_of_a_scene, with_verdicts


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A fit with every verdict, and a batch with it as a group."""
    place, fit = tmp_path_factory.mktemp("same"), with_verdicts(fit_of_a_scene())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("identify.report.figures.pictures", lambda _: ())  # no number is told in them
        for folder in ("stickslip-pair", "study/steel"):
            fit.save(place / folder)
    about = {"group": "steel", "status": "converged", "message": ""}
    (place / "study" / "steel" / "job.json").write_text(json.dumps(about), encoding="utf-8")
    return Folder.at(place), fit


def cells(table):
    return [[cell["text"] for cell in row] for row in table["rows"]]


def test_a_fit_has_the_same_numbers_in_page_report_terminal_and_study(saved):
    folder, fit = saved
    shown, (group,) = cells(fit_seen(folder, "stickslip-pair")["table"]), batch_seen(folder, "study")["groups"]
    assert len(shown) == len(fit.typed.parameters)
    text = (folder.root / "stickslip-pair" / "report.html").read_text(encoding="utf-8")
    (report,) = re.findall(r'<table class="parameters">.*?</table>', text, re.DOTALL)
    words = html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", report)))
    said = [
        re.split(r"\s{2,}|(?<=\d) (?=[−\d])|(?<=[\dm]) (?=[✓≈✗|=<?…])", line.strip())
        for line in summary(fit.typed).splitlines()
    ]
    for symbol, value, interval, *_, unit, verdict in shown:
        assert re.search(rf"{re.escape(symbol)} .*?{re.escape(value)} .*?{re.escape(verdict)}", words), words
        assert interval in words and interval in str(said) and f"'{value}" in str(said)
        name = next(cell for cell in group["shown"] if group["shown"][cell] == f"{value} {unit}".removesuffix(" 1"))
        assert name in fit.typed.parameters


def test_a_map_has_the_same_outcomes_in_page_and_file(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(PAIR + 'drive_speed = "1 mm/s"\nnormal_force = "1 N"\n', encoding="utf-8")
    words = ["--map", "drive_speed", "stiffness", "--points", "3", "--data", str(tmp_path / "map.csv"), "--json"]
    assert main(["stability", "--scene", str(tmp_path / "scene.toml"), *words]) == 0
    page = json.loads(capsys.readouterr().out)["map"]  # what the page draws: identify/app/static/map.js
    with (tmp_path / "map.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    assert [row["outcome"] for row in rows] == [outcome for line in page["outcomes"] for outcome in line]
