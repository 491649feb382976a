"""The page of many fits in a headless browser: no overflow, no error, no request, tables that sort when clicked."""

from __future__ import annotations

import pytest

from experiments.pooling_draws import Plan
from identify.studies import operating_points
from identify.studies.comparison_page import write_batch_report
from tests.support.browser import CHROMIUM, Browser
from tests.support.comparing_case import write_study

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")
EVIL = "<img src='http://127.0.0.1:9/x' onerror='alert(1)'>" + "w" * 500


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("batch")
    write_study(folder, Plan("page", volunteers=3, runs=2, gap=4.0))
    for path in list(folder.glob("M3_*/result.json")):
        path.write_text(path.read_text(encoding="utf-8").replace('"M3"', f'"{EVIL}"'), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(operating_points, "group_answers", lambda *_: ())
        return write_batch_report(folder)


@pytest.fixture(scope="module")
def browser():
    with Browser() as found:
        yield found


@pytest.mark.parametrize("width", [1280, 400])
def test_nothing_overflows_and_nothing_is_asked_for(page, browser, width):
    browser.requests.clear()
    browser.errors.clear()
    browser.open(page, width)
    assert browser.run("document.documentElement.scrollWidth") <= width
    outside = browser.run(
        "Array.from(document.querySelectorAll('body *')).filter(e => !e.closest('.scroll') && !e.closest('svg')"
        f" && e.getBoundingClientRect().right > {width} + 1).length"
    )
    assert outside == 0
    assert browser.requests == [page.resolve().as_uri()]
    assert browser.errors == []
    assert browser.run("document.querySelectorAll('main img, main script').length") == 0


def test_tables_sort_when_their_heads_are_clicked(page, browser):
    browser.open(page, 1280)
    head = "#fits thead th:nth-child({}) button"
    column = "Array.from(document.querySelectorAll('#fits tbody tr')).map(r => r.cells[{}].getAttribute('data-sort'))"
    place = 1 + browser.run(
        "Array.from(document.querySelectorAll('#fits thead th')).findIndex(h => h.textContent.startsWith('μₛ'))"
    )
    before = [float(v) for v in browser.run(column.format(place - 1))]
    assert before != sorted(before)
    browser.click(head.format(place))
    assert [float(v) for v in browser.run(column.format(place - 1))] == sorted(before)
    browser.click(head.format(place))
    assert [float(v) for v in browser.run(column.format(place - 1))] == sorted(before, reverse=True)
    assert (
        browser.run(f"document.querySelectorAll('#fits thead th')[{place - 1}].getAttribute('aria-sort')")
        == "descending"
    )
    browser.click(head.format(1))
    names = browser.run(column.format(0))
    assert names == sorted(names)


def test_a_script_of_a_label_would_not_run(page, browser, tmp_path):
    """The negative control: a script that did get into the page is stopped by the page's own policy."""
    spoilt = tmp_path / "spoilt.html"
    text = page.read_text(encoding="utf-8")
    spoilt.write_text(text.replace("</main>", "<script>document.title = 'taken'</script></main>"), encoding="utf-8")
    browser.errors.clear()
    browser.open(spoilt, 1280)
    assert browser.run("document.title") != "taken"
    assert any("Content Security Policy" in error for error in browser.errors)
