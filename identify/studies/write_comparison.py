"""The folder of a comparison: page, tables as CSV, Excel and LaTeX, HDF5 of everything, and the document."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from data_io.atomic import atomic_path, atomic_write
from identify.report.document import as_json
from identify.studies.compare import Comparison
from identify.studies.comparison_page import Answers, notes, render
from identify.studies.comparison_store import write_h5
from identify.studies.comparison_views import sentences
from identify.studies.fits import PAGE, count
from identify.studies.reporting import items
from identify.studies.sheets import Sheet, comparison_sheets, fits_sheet
from identify.studies.spreadsheet import workbook
from identify.studies.tables_text import as_csv, as_latex

DOCUMENT = "comparison.json"
NAMES = (DOCUMENT, PAGE, "comparison.xlsx", "comparison.tex", "comparison.h5", "tables")
IN_LATEX = ("parameters", "differences", "scatter", "operating_points", "reporting")


def write_comparison(comparison: Comparison, answers: Answers, folder: Path, home: Path | None = None) -> list[Path]:
    """Write everything into `folder` (made where missing); returns the paths, the page last.

    Args:
        home: where the folder will stand in the end, for the links to the pages of the fits (default: `folder`).

    Raises:
        OSError: the folder cannot be written.
    """
    sheets = all_sheets(comparison, answers)
    title = f"by {comparison.question.by}"
    page = render(title, comparison.entries, comparison, answers, home or folder)
    (folder / "tables").mkdir(parents=True, exist_ok=True)
    contents: dict[str, str | bytes] = {f"tables/{sheet.name}.csv": as_csv(sheet) for sheet in sheets}
    contents["comparison.xlsx"] = workbook(sheets)
    contents["comparison.tex"] = as_latex([sheet for sheet in sheets if sheet.name in IN_LATEX])
    contents[DOCUMENT] = as_json(document(comparison, sheets))
    contents[PAGE] = page
    written = []
    with atomic_path(folder / "comparison.h5") as temporary:
        write_h5(temporary, comparison.entries, sheets, comparison)
    written.append(folder / "comparison.h5")
    for name, content in contents.items():
        with atomic_write(folder / name, "wb") as handle:
            handle.write(content.encode("utf-8") if isinstance(content, str) else content)
        written.append(folder / name)
    return written


def all_sheets(comparison: Comparison, answers: Answers) -> tuple[Sheet, ...]:
    """Every table of a comparison."""
    told = comparison_sheets(comparison, answers.ground, answers.groups, items(comparison.entries))
    return (*told, fits_sheet(comparison.entries))


def document(comparison: Comparison, sheets: tuple[Sheet, ...]) -> Mapping[str, Any]:
    """The comparison as JSON: the question, what differs in words, notes, and every table but that of the fits."""
    taken = comparison.taken
    return {
        "schema": 1,
        "status": "done",
        "by": comparison.question.by,
        "subject": taken.subject,
        "adjusted": list(taken.adjusted),
        "groups": list(comparison.groups),
        "fits": len(comparison.entries),
        "compared": count(taken.entries),
        "in_words": {
            e.quantity.name: said[2] for e, said in zip(comparison.quantities, sentences(comparison), strict=True)
        },
        "notes": notes(comparison),
        "tables": {
            sheet.name: [dict(zip(sheet.heads, row, strict=True)) for row in sheet.rows]
            for sheet in sheets
            if sheet.name != "fits"
        },
    }
