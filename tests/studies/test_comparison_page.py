"""The page of many fits in a headless browser: no overflow, no error, no request, tables that sort when clicked."""

from __future__ import annotations

import pytest

from experiments.pooling_draws import Plan
from identify.studies.compare import ComparisonQuestion, compare, read_fits
from identify.studies.comparison_page import write_comparison
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
    comparison = compare(read_fits([folder]), ComparisonQuestion("material"))
    return write_comparison(comparison, tmp_path_factory.mktemp("out"))[-1]


@pytest.fixture(scope="module")
def browser():
    with Browser() as found:
        yield found


@pytest.mark.parametrize("width", [1280, 400])
def test_nothing_overflows_nothing_is_asked_for_and_tables_sort(page, browser, width):
    browser.requests.clear()
    browser.errors.clear()
    browser.open(page, width)
    assert browser.ask("document.documentElement.scrollWidth") <= width
    outside = browser.ask(
        "Array.from(document.querySelectorAll('body *')).filter(e => !e.closest('.scroll') && !e.closest('svg')"
        f" && e.getBoundingClientRect().right > {width} + 1).length"
    )
    assert outside == 0
    assert browser.requests == [page.resolve().as_uri()] and browser.errors == []
    assert browser.ask("document.querySelectorAll('main img, main script').length") == 0
    heads = browser.ask("Array.from(document.querySelectorAll('#fits thead th')).map(h => h.textContent)")
    place = next(k for k, head in enumerate(heads) if head.startswith("μₛ"))
    keys = f"Array.from(document.querySelectorAll('#fits tbody tr')).map(r => +r.cells[{place}].dataset.sort)"
    before = browser.ask(keys)
    assert before != sorted(before)
    for down, direction in ((False, "ascending"), (True, "descending")):
        browser.click(f"#fits thead th:nth-child({place + 1}) button")
        assert browser.ask(keys) == sorted(before, reverse=down)
        assert browser.ask(f"document.querySelectorAll('#fits th')[{place}].getAttribute('aria-sort')") == direction
