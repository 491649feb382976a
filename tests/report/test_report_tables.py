"""What users read: intervals whose ends differ, one unit per kind of quantity, an operating point, no contradiction."""

import re

import pytest

from identify.base.result import CauseResult, LogResult
from identify.report.report_page import render_page
from identify.report.report_tables import answer_table, causes_table
from tests.support.fake_fit import failed, fake_fit


def entry(value, unit, interval=None, **more):
    return {"value": value, "unit": unit, "interval": interval, "validity": ""} | more


@pytest.fixture(scope="module")
def fit():
    return fake_fit(samples=2000)


def test_a_value_stands_with_its_interval_and_its_validity():
    entries = {"drop": entry(0.5, "N", [0.49, 0.51]), "period": entry(None, "s", validity="not valid here: too fast")}
    second = {"drop": entry(2.0, "N", [1.9, None])}
    logs = [(f"log {n}", LogResult(derived={"amplitude": told})) for n, told in enumerate((entries, second), 1)]
    rows = answer_table(logs).cells
    assert [row[0].shown for row in rows] == ["drop of the force (onset to rest)", "period"]
    assert (rows[0][0].note, rows[0][1].shown, rows[0][1].note) == ("N", "0.500", "0.490 to 0.510")
    assert rows[0][2].note.startswith("above 1.9") and rows[1][2].shown == "–"
    assert (rows[1][1].shown, rows[1][1].note, rows[1][1].kind) == ("–", "not valid here: too fast", "doubt")


@pytest.mark.parametrize("converged", [True, False])
def test_every_entry_of_the_contents_leads_somewhere(fit, converged):
    page = render_page(fit if converged else failed(fit, "model_misfit", "no"), [])
    contents = page[page.index('class="contents"') : page.index("</nav>")]
    targets = re.findall(r'href="#([^"]+)"', contents)
    assert len(targets) >= 6 - 2 * (not converged) and len(set(targets)) == len(targets)
    assert all(f'id="{target}"' in page for target in targets) and ("parameters" in targets) == converged


def test_possible_causes_of_a_misfit_stand_in_one_unit_a_row():
    mass = CauseResult("mass", None, 1, 1234.0, 0.6, 0.34972, 0.0006)
    speeds = CauseResult("drive_speed", None, 2, 20.0, 1.0, 1.017, 0.0006)  # of all logs: a ratio
    texts = [[cell.shown for cell in row] for row in causes_table((mass, speeds)).cells]
    assert texts[0][3:] == ["1234", "0.6 kg", "0.3497 kg", "0.0006 kg"] and texts[1][4:] == ["1", "1.017", "0.0006"]
