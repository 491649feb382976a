"""The tail of the report: contents, definitions, tables to paste, no number that means nothing."""

import re

import pytest

from identify.report.report_page import render_page
from identify.report.report_tables import answer_table, parameter_table, sentences, without_groups_of
from identify.report.uncertainty_figures import draw_correlation
from tests.support.fake_fit import failed, fake_fit, with_verdicts


@pytest.fixture(scope="module")
def page():
    return render_page(fake_fit(samples=2000), [])


def test_every_entry_of_the_contents_leads_somewhere(page):
    contents = page[page.index('class="contents"') : page.index("</nav>")]
    targets = re.findall(r'href="#([^"]+)"', contents)
    assert len(targets) >= 6 and len(set(targets)) == len(targets)
    assert all(f'id="{target}"' in page for target in targets)
    refused = render_page(failed(fake_fit(samples=2000), "model_misfit", "no"), [])
    contents = refused[refused.index('class="contents"') : refused.index("</nav>")]
    assert all(f'id="{target}"' in refused for target in re.findall(r'href="#([^"]+)"', contents))
    assert "#parameters" not in contents


def test_a_number_that_is_next_to_nothing_is_said_so():
    entries = {"multiplier": {"value": 1.9e-295, "unit": ""}, "force": {"value": 1.9e-12, "unit": "N"}}
    table = answer_table([("log 1", {"stability": entries})])
    assert [row[1].shown for row in table.rows if len(row) > 1] == ["below 10⁻⁹", "1.9·10⁻⁶\N{NO-BREAK SPACE}µN"]


def test_groups_are_those_that_say_something_and_stability_of_several_logs_is_a_table():
    group = {"value": 1.0, "unit": ""}
    kept = without_groups_of({"groups": {"omega_n": group, "xi_p_printed": group, "v_cr": group}}, {"v_cr": group})
    assert list(kept["groups"]) == ["omega_n"]
    entries = {
        "stability": {"text": "It sticks.", "sliding_unstable_between": [[1e-9, 0.01]]},
        "amplitude": {"text": "It falls."},
    }
    assert sentences(entries) == ("It sticks.", "It falls.") and sentences(entries, several=True) == ("It falls.",)
    table = answer_table([("log 1", entries)])
    assert table is not None and table.rows[1][0].shown == "steady sliding is unstable at"
    assert table.rows[1][1].shown.endswith("to 10\N{NO-BREAK SPACE}mm/s")


def test_the_caption_of_the_correlation_is_true_of_what_is_drawn():
    import numpy as np

    near = draw_correlation(["a", "b"], np.array([[1.0, 0.97], [0.97, 1.0]])).caption
    assert "the strongest is 0.97, between a and b" in near and "tell only" not in near


def test_the_parameters_are_a_latex_table():
    fit = with_verdicts(fake_fit(samples=2000))
    text = parameter_table(fit.typed.parameters).to_latex()
    rows = [line for line in text.splitlines() if line.endswith(r"\\") and not line.startswith(("parameter", "\\"))]
    assert len(rows) == 6 and all(row.count("&") == 4 for row in rows)
    assert rows[0].startswith(r"mu\_s & 0.6200 $\pm$ 0.0011 & 0.6178 to 0.6222 & 1 & ")
    assert any(r"$\mu$m" in row for row in rows)
    assert not re.search(r"(?<!\\)[%_](?!\{)", "\n".join(rows)), "nothing that LaTeX takes for something else"
