"""Tables as CSV and as LaTeX; text is made harmless on the way."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from identify.report.quantity_text import number
from identify.studies.clean import cell, latex
from identify.studies.sheets import Sheet

LATEX_COLUMNS = 12  # wider tables are for a spreadsheet
LATEX_ROWS = 400
_ASCII = str.maketrans({"−": "-", "·": "x"})


def as_csv(sheet: Sheet) -> str:
    """The table as CSV, numbers so that they read back exactly."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([cell(head) for head in sheet.heads])
    writer.writerows([["" if (value := cell(c)) is None else value for c in row] for row in sheet.rows])
    return out.getvalue()


def as_latex(sheets: Sequence[Sheet]) -> str:
    """Tables for \\input into a paper (packages booktabs and longtable); nothing outside them is set."""
    head = "% needs \\usepackage{booktabs,longtable}, \\usepackage[T1]{fontenc}\n"
    return head + "\n".join(_table(sheet) for sheet in sheets)


def _table(sheet: Sheet) -> str:
    used = [k for k in range(len(sheet.heads)) if any(row[k] not in (None, "") for row in sheet.rows)][:LATEX_COLUMNS]
    columns = "".join("r" if _numeric(sheet, k) else "l" for k in used)
    lines = [f"\\begin{{longtable}}{{{columns}}}", f"\\caption{{{latex(sheet.title)}}}\\\\", "\\toprule"]
    lines += [" & ".join(latex(sheet.heads[k]) for k in used) + " \\\\", "\\midrule", "\\endhead"]
    lines += [" & ".join(_shown(row[k]) for k in used) + " \\\\" for row in sheet.rows[:LATEX_ROWS]]
    return "\n".join([*lines, "\\bottomrule", "\\end{longtable}", ""])


def _numeric(sheet: Sheet, column: int) -> bool:
    return all(row[column] is None or isinstance(row[column], int | float) for row in sheet.rows)


def _shown(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return "--" if value != value else _tex_number(float(value))
    return latex(str(value))


def _tex_number(value: float) -> str:
    """Four digits; powers of ten as LaTeX writes them."""
    text = number(value).translate(_ASCII)
    if "x10" not in text:
        return f"${text}$"
    mantissa = text.split("x10")[0]
    return f"${mantissa}\\cdot 10^{{{f'{value:.3e}'.split('e')[1].lstrip('+')}}}$".replace("{-0", "{-").replace(
        "{0", "{"
    )
