"""One table for every outlet: rows of values with what a person reads of them, as text, HTML, CSV, LaTeX, workbook."""

from __future__ import annotations

import io
import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from identify.base.wording import DASH, columns, number

if TYPE_CHECKING:
    import pandas as pd
    from jinja2 import Template

Value = str | float | int | bool | None

LINE = 2000  # characters of a cell; Excel takes 32,767
FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "|", "%", "＝", "＋", "－", "＠")  # read as a formula by spreadsheets
LATEX_ROWS = 400  # a longer table is for a spreadsheet
SHEET_NAME = 31  # characters that Excel takes
# What LaTeX's default fonts lack, beyond what pandas escapes.
SYMBOLS = {
    "−": "$-$",
    "·": r"$\cdot$",
    "±": r"$\pm$",
    "×": r"$\times$",
    "²": "$^2$",
    "√": r"$\surd$",
    "…": r"\ldots{}",
    "μ": r"$\mu$",
    "µ": r"$\mu$",
    "Δ": r"$\Delta$",
    "χ": r"$\chi$",
    "–": "--",
    "\N{NO-BREAK SPACE}": "~",
}


@dataclass(frozen=True)
class Cell:
    """One cell.

    value: a number (SI, by the unit in the heading or beside it) or text; text: how it reads, "" for the value as it
    is; note: a smaller remark; kind: class of the style sheet ("good", "fair", "bad" and "plain" are chips); link.
    """

    value: Value = None
    text: str = ""
    note: str = ""
    kind: str = ""
    link: str = ""

    @property
    def shown(self) -> str:
        """What a person reads."""
        if self.text or isinstance(self.value, str):
            return self.text or str(self.value)
        if isinstance(self.value, bool):
            return "yes" if self.value else "no"
        missing = self.value is None or not math.isfinite(self.value)
        return DASH if missing else str(self.value) if isinstance(self.value, int) else number(self.value)


Row = Sequence[Cell | Value]
CHIPS = ("good", "fair", "bad", "plain")


@dataclass(frozen=True)
class OutputTable:
    """A title, column headings (units in them where a column has one) and rows; the first column names the row. A row
    of a single cell is a heading of those below it. name: of its file or sheet."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    name: str = ""

    def __bool__(self) -> bool:
        return bool(self.rows)

    @property
    def cells(self) -> list[list[Cell]]:
        """All rows as cells."""
        return [[c if isinstance(c, Cell) else Cell(c) for c in row] for row in self.rows]

    def select(self, *heads: str) -> OutputTable:
        """The same with these columns only, where it has them."""
        kept = [self.columns.index(head) for head in heads if head in self.columns]
        rows = tuple(tuple(row[k] for k in kept) if len(row) > 1 else row for row in self.rows)
        return replace(self, columns=tuple(self.columns[k] for k in kept), rows=rows)

    def filled(self) -> OutputTable:
        """The same without columns that hold nothing."""
        rows = [[cell.shown for cell in row] for row in self.cells if len(row) > 1]
        return self.select(*(c for k, c in enumerate(self.columns) if {row[k] for row in rows} - {DASH, ""}))

    def to_frame(self) -> pd.DataFrame:
        """The values, text of them as one harmless line, headings of rows left out."""
        import pandas as pd

        body = [[harmless(cell.value) for cell in row] for row in self.cells if len(row) > 1]
        return pd.DataFrame(body, columns=[str(harmless(head)) for head in self.columns], dtype=object)

    def to_text(self, indent: str = "  ") -> str:
        """Aligned columns for a terminal; the first holds names as they are."""
        body = [[_name(row[0]), *(cell.shown for cell in row[1:])] for row in self.cells if len(row) > 1]
        return columns([list(self.columns), *body], indent)

    def to_csv(self) -> str:
        """CSV with a line of headings; numbers read back exactly."""
        return str(self.to_frame().to_csv(index=False, lineterminator="\n"))

    def to_latex(self) -> str:
        """A longtable for \\input into a paper (packages booktabs and longtable); columns without any value are left
        out."""
        import pandas as pd

        kept = [k for k in range(len(self.columns)) if any(c[k].value not in (None, "") for c in self.cells if c[1:])]
        body = [
            [_plain_number(row[k]) if k else visible(_name(row[0])) for k in kept] for row in self.cells if len(row) > 1
        ]
        frame = pd.DataFrame(body[:LATEX_ROWS], columns=[visible(self.columns[k]) for k in kept])
        title = visible(self.title).translate({ord("\\"): "/", ord("~"): "-", ord("^"): None})
        caption = re.sub(r"([&%$#_{}])", r"\\\1", title)  # which pandas leaves as it is
        text = str(frame.to_latex(index=False, escape=True, longtable=True, caption=caption))
        return "".join(SYMBOLS.get(c, c if c.isprintable() or c == "\n" else "?") for c in text)

    def to_html(self, sortable: bool = False, style: str = "grid") -> Markup:
        """A <table> in a box that scrolls; sortable: headings are buttons and cells carry what they sort by; style: its
        class where it is not."""
        cells = self.cells
        numeric = [
            any(isinstance(row[k].value, int | float) for row in cells if len(row) > k)
            and not any(isinstance(row[k].value, str) for row in cells if len(row) > k)
            for k in range(len(self.columns))
        ]
        return Markup(
            _template().render(
                table=self, numeric=numeric, sortable=sortable, style=style, visible=visible, chips=CHIPS
            )
        )


@cache
def _template() -> Template:
    from jinja2 import Environment

    text = Path(__file__).with_name("table.html.j2").read_text(encoding="utf-8")
    return Environment(autoescape=True).from_string(text)


def _name(cell: Cell) -> str:
    return str(cell.value) if isinstance(cell.value, str) else cell.shown


def _plain_number(cell: Cell) -> str:
    if isinstance(cell.value, float) and not cell.text:
        return f"{cell.value:.4g}" if math.isfinite(cell.value) else "--"
    return visible(cell.shown) if cell.value is not None or cell.text else ""


def workbook(tables: Sequence[OutputTable]) -> bytes:
    """An Excel file with one sheet per table; the headings stay in sight."""
    import pandas as pd

    out = io.BytesIO()
    with pd.ExcelWriter(out, engine="openpyxl") as writer:
        for table in tables:
            table.to_frame().to_excel(
                writer, sheet_name=table.name[:SHEET_NAME] or "table", index=False, freeze_panes=(1, 1)
            )
    return out.getvalue()


def visible(text: str, most: int = 80) -> str:
    """One line of at most `most` characters: control characters, line ends and marks that turn the direction of
    reading become a visible sign; how much is cut off is stated."""
    shown = re.sub(r" +", " ", "".join(_sign(c) for c in text[: 4 * most])).strip(" ")
    if len(shown) <= most and len(text) <= 4 * most:
        return shown
    return f"{shown[:most].rstrip()}… ({len(text)} characters)"


def _sign(character: str) -> str:
    if character in "\n\r\t\v\f\x85\u2028\u2029":
        return " "
    # Cc, Cf, Cs, Co, Cn: controls, marks of direction, halves of characters, what nobody has defined
    return "\N{REPLACEMENT CHARACTER}" if unicodedata.category(character)[0] == "C" else character


def harmless(value: Value) -> Value:
    """A value for a spreadsheet: a number as it is (None where not finite), text one line long that no program takes
    for a formula."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return None
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return int(value) if isinstance(value, int) else float(value)
    text = visible(value, LINE)
    return f"'{text}" if text.lstrip().startswith(FORMULA) else text
