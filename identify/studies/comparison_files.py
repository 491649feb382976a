"""Tables as CSV and as LaTeX; text is made harmless on the way."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from data_io.atomic import atomic_path, atomic_write
from identify.base.wording import number
from identify.report.hdf5 import storable
from identify.report.stored_result import as_json
from identify.studies.compare import Comparison
from identify.studies.comparison_page import Answers, notes, render
from identify.studies.comparison_views import sentences
from identify.studies.fits import PAGE, FitEntry, count
from identify.studies.labels import cell, latex
from identify.studies.reporting import items
from identify.studies.sheets import Sheet, comparison_sheets, fits_sheet, workbook

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
    numeric = [all(isinstance(row[k], int | float | None) for row in sheet.rows) for k in used]
    columns = "".join("r" if one else "l" for one in numeric)
    lines = [f"\\begin{{longtable}}{{{columns}}}", f"\\caption{{{latex(sheet.title)}}}\\\\", "\\toprule"]
    lines += [" & ".join(latex(sheet.heads[k]) for k in used) + " \\\\", "\\midrule", "\\endhead"]
    lines += [" & ".join(_shown(row[k]) for k in used) + " \\\\" for row in sheet.rows[:LATEX_ROWS]]
    return "\n".join([*lines, "\\bottomrule", "\\end{longtable}", ""])


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


# ----------------------------------------------------------------------------------------------------------------------
# comparison.h5: every table, every pooled quantity with its covariance, and the documents of all fits.
# ----------------------------------------------------------------------------------------------------------------------

FORMAT_VERSION = 1


def write_h5(path: Path, entries: Sequence[FitEntry], sheets: Sequence[Sheet], comparison: Comparison | None) -> None:
    """Write the file (an existing one is replaced).

    `/tables/<name>`: one dataset per column, named in attribute `heads`; `/fits/<n>`: name, status, message, labels
    as attributes and `document`, the text of result.json; `/pooled/<parameter>`: what the pooling took and gave.
    """
    with h5py.File(path, "w", track_order=True) as file:
        file.attrs["format"] = "stickslip-comparison"
        file.attrs["format_version"] = FORMAT_VERSION
        for sheet in sheets:
            _put_sheet(file.create_group(f"tables/{sheet.name}", track_order=True), sheet)
        for number, entry in enumerate(entries, 1):
            group = file.create_group(f"fits/{number}", track_order=True)
            texts = {name: getattr(entry, name) for name in ("name", "status", "message")}
            texts |= {"labels": as_json(dict(entry.labels)), "document": as_json(dict(entry.document))}
            for name, text in texts.items():
                _text(group, name, text)
        if comparison is not None:
            _put_pooled(file.create_group("pooled", track_order=True), comparison)


def _put_sheet(group: h5py.Group, sheet: Sheet) -> None:
    group.attrs["title"] = storable(sheet.title)
    for k, head in enumerate(sheet.heads):
        column = [row[k] for row in sheet.rows]
        name = f"column_{k + 1:03d}"
        if all(v is None or (isinstance(v, int | float) and not isinstance(v, bool)) for v in column):
            data = group.create_dataset(name, data=np.array([np.nan if v is None else float(v) for v in column]))
        else:
            texts = [storable("" if v is None else str(v)) for v in column]
            data = group.create_dataset(name, data=texts, dtype=h5py.string_dtype())
        data.attrs["head"] = storable(head)


def _text(group: h5py.Group, name: str, text: str) -> None:
    group.create_dataset(name, data=storable(text), dtype=h5py.string_dtype())


def _put_pooled(group: h5py.Group, comparison: Comparison) -> None:
    names = [entry.name for entry in comparison.taken.entries]
    _text(group, "by", comparison.question.by)
    group.create_dataset("fits", data=[storable(n) for n in names], dtype=h5py.string_dtype())
    for place, entry in enumerate(comparison.quantities, 1):
        if entry.pooled is None:
            continue
        inner, mixed = group.create_group(str(place), track_order=True), entry.pooled.mixed
        inner.attrs["quantity"] = storable(entry.quantity.name)
        inner.attrs["unit"] = storable(entry.quantity.unit)
        inner.attrs["logarithm"] = entry.quantity.logarithmic
        _text(inner, "columns", as_json({"columns": list(entry.pooled.design.columns)}))
        _text(inner, "components", as_json({"components": [c.name for c in mixed.components]}))
        arrays: dict[str, Any] = {
            "rows": np.array(entry.pooled.rows),
            "y": mixed.y,
            "X": mixed.X,
            "noise_variance": mixed.noise,
            "beta": mixed.beta,
            "covariance": mixed.covariance,
            "component_variance": mixed.theta,
        }
        for name, values in arrays.items():
            inner.create_dataset(name, data=values)


# ----------------------------------------------------------------------------------------------------------------------
# The folder of a comparison: page, tables as CSV, Excel and LaTeX, HDF5 of everything, and the document.
# ----------------------------------------------------------------------------------------------------------------------

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
