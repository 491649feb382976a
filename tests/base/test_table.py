"""One table for every outlet: each read back by a program that knows nothing of it."""

from __future__ import annotations

import csv
import io
import math
from html.parser import HTMLParser

import openpyxl
import pytest

from identify.base.table import LINE, Cell, OutputTable, harmless, visible, workbook
from identify.base.wording import range_text

HOSTILE = ("<script>alert(1)</script>", "=1+1", "a\nb", "50 % & $x_1$ #~^\\{}", "x" * 5000, "abc\u202etxt")
TABLE = OutputTable(
    "Lengths of 2 & 3 %",
    ("name", "length [m]", "remark"),
    (
        (Cell("part", note="a heading"),),
        *((Cell(text, text.upper()), Cell(37.4e-6 * k, f"{37.4 * k:g} µm"), text) for k, text in enumerate(HOSTILE, 1)),
        ("nothing", None, math.nan),
    ),
    "lengths",
)


class Rows(HTMLParser):
    """Rows of cells as text, tags, and what cells sort by."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.rows, self.keys = set(), [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("th", "td"):
            self.rows[-1].append("")
            self.keys.append(dict(attrs).get("data-sort"))

    def handle_data(self, data):
        if self.rows and self.rows[-1]:
            self.rows[-1][-1] += data


def test_csv_reads_back_and_no_text_is_a_formula():
    rows = list(csv.reader(io.StringIO(TABLE.to_csv())))
    assert rows[0] == ["name", "length [m]", "remark"] and len(rows) == 2 + len(HOSTILE), (
        "headings of rows are left out"
    )
    assert [float(row[1]) for row in rows[1:-1]] == [37.4e-6 * k for k in range(1, len(HOSTILE) + 1)]
    assert rows[-1] == ["nothing", "", ""]
    assert not [cell for row in rows for cell in row if cell.startswith(("=", "+", "@")) or "\n" in cell]


def test_a_workbook_has_a_sheet_for_each_table():
    other = OutputTable("Other", ("a", "b"), ((1, 2),), "other")
    book = openpyxl.load_workbook(io.BytesIO(workbook([TABLE, other])))
    assert book.sheetnames == ["lengths", "other"]
    cells = list(book["lengths"].iter_rows(values_only=True))
    assert cells[0] == ("name", "length [m]", "remark") and cells[1][1] == pytest.approx(37.4e-6)
    assert "f" not in {cell.data_type for row in book["lengths"].iter_rows() for cell in row}, "no formula"


def test_latex_is_balanced_and_holds_no_command_of_a_text():
    text = TABLE.to_latex()
    body = text[text.index("\\toprule") :]
    assert "\\input" not in body and text.count("\\begin{longtable}") == 1
    bare = text.replace("\\{", "").replace("\\}", "").replace("\\$", "").replace("\\#", "")
    assert bare.count("{") == bare.count("}") and bare.count("$") % 2 == 0 and "#" not in bare
    assert "37.4 $\\mu$m" in text


@pytest.mark.parametrize("sortable", [True, False])
def test_html_shows_texts_and_sorts_by_values(sortable):
    page = Rows(TABLE.to_html(sortable))
    assert "script" not in page.tags and page.rows[1][0].startswith("part") and page.rows[3][1] == "74.8 µm"
    assert max(len(cell) for row in page.rows for cell in row) < 500
    assert (str(37.4e-6) in page.keys) == sortable


def test_texts_are_one_line_that_no_spreadsheet_reads_as_a_formula():
    assert harmless("=1+1") == "'=1+1" and harmless(" \t@x") == "'@x"
    assert harmless(-0.5) == -0.5 and harmless(math.nan) is None and harmless(True) == "yes"
    assert visible("a\nb\u202ec") == "a b\N{REPLACEMENT CHARACTER}c"
    assert visible("y" * 10_000) == "y" * 80 + "… (10000 characters)" and len(str(harmless("y" * 10_000))) < LINE + 30


def test_a_range_has_its_unit_once():
    ranges = [
        range_text(0.023, 0.0428, "m/s"),
        range_text(0.0035, 35.0, "kg"),
        range_text(None, 1.0, "N"),
        range_text(0.52, 0.65, ""),
    ]
    assert ranges == ["23 to 42.8 mm/s", "0.0035 to 35 kg", "– to 1 N", "0.52 to 0.65"]
