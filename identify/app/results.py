"""Finished fits and batches as the page shows them: what their files hold, nothing computed."""

from __future__ import annotations

import io
from functools import lru_cache
from itertools import zip_longest
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from starlette.responses import Response

from identify.app.curves import MOST_POINTS
from identify.app.folder import Document, Folder, PageError, PageQuery, mapping
from identify.app.simulations import ONE_AT_A_TIME
from identify.base.document import read_json, to_dict
from identify.base.table import OutputTable
from identify.report.figures import available
from identify.report.finished import Fit
from identify.report.report_tables import accuracy_table, parameter_table
from identify.report.report_wording import NOT_FOR, distribution_lines, headline, is_uneven, tolerances_text
from identify.report.style import DPI, drawing_style, extremes

Array = NDArray[np.float64]
FORMS = {"svg": "image/svg+xml", "pdf": "application/pdf", "png": "image/png"}
SHOWN = ("status", "message", "parameters", "search", "not_tried", "accuracy", "timing_s")


def as_shown(table: OutputTable) -> Document:
    """A table in the very words of report and terminal."""
    numbers = [any(isinstance(row[k].value, int | float) for row in table.cells) for k in range(len(table.columns))]
    cells = [[{"text": cell.shown, "note": cell.note, "kind": cell.kind} for cell in row] for row in table.cells]
    return {"columns": table.columns, "numbers": numbers, "rows": cells}


@lru_cache(maxsize=4)
def _loaded(place: Path, stamp: int) -> Fit:
    return Fit.load(place)


def fit_of(folder: Folder, name: str) -> Fit:
    """The fit in a folder, kept until its document changes.

    Raises:
        FitError: it holds none.
    """
    document = folder.path(name) / "result.json"
    return _loaded(document.parent, document.stat().st_mtime_ns if document.is_file() else 0)


def fit_seen(folder: Folder, name: str) -> Document:
    """What the page shows of the fit in a folder."""
    place, fit = folder.path(name), fit_of(folder, name)
    result, document, uneven = fit.typed, fit.result, None
    if is_uneven(result):
        uneven = {"headline": headline(result), "not_for": NOT_FOR, "spread": list(distribution_lines(result))}
    columns = ("onset", "arrest", "misfit_z")
    logs = [
        {
            "path": path.relative_to(folder.root).as_posix() if path.is_relative_to(folder.root) else path.name,
            "left_out": log.reason_left_out,
            "text": log.derived.get("text", ""),
            "cycles": [dict(zip(columns, row, strict=True)) for row in curves.cycles[:, [0, 1, 4]]] if curves else [],
        }
        for log, curves in zip_longest(result.logs, fit.logs)
        for path in [Path(log.path)]
    ]
    shown = {key: document.get(key) for key in SHOWN} | {
        "table": as_shown(parameter_table(result.parameters)),
        "tolerances": tolerances_text(result.tolerances or {}),
        "costs": as_shown(accuracy_table(result.accuracy)),
        "uneven": uneven,
        "effects": (document.get("effects") or {}).get("reasons") or [],
        "logs": logs,
        "figures": [name for name in available(fit) if result.converged or name.startswith("log")],
        "files": sorted(item.name for item in place.iterdir() if item.is_file()),
    }
    return to_dict(shown)


def fit_picture(folder: Folder, name: str, query: PageQuery) -> Response:
    """A figure of the fit in a folder, at the width of one or two columns of a paper (a PNG at 300 dpi)."""
    drawn, form, out = available(fit_of(folder, name)), query.text("form"), io.BytesIO()
    if query.text("name") not in drawn or form not in FORMS:
        raise PageError(f"a fit has no figure {query.text('name')}.{form}; load the page again")
    with ONE_AT_A_TIME, drawing_style():
        figure = drawn[query.text("name")](columns=2 if query.whole("columns", 1) == 2 else 1).figure
        assert figure is not None
        figure.savefig(out, format=form, dpi=DPI)
    return Response(out.getvalue(), media_type=FORMS[form])


def fit_row(folder: Folder, fit: str) -> Document:
    """One line of the list of fits; of a document that anybody may have written."""
    document = mapping(read_json(folder.path(fit) / "result.json"))
    return {
        "path": fit,
        "status": str(document.get("status", "not whole")).replace("_", " "),
        "message": document.get("message", ""),
        "finished": mapping(document.get("provenance")).get("finished", ""),
        "parameters": {
            key: {k: mapping(entry).get(k) for k in ("value", "unit", "interval", "verdict")}
            for key, entry in mapping(document.get("parameters")).items()
        },
    }


def residuals(folder: Folder, name: str, number: int, begin: float, end: float) -> Array:
    """Time [s], measured force [N], fitted force [N], their difference [N] of a log (from 1) of a fit, (4, m): where
    there are more than fit a curve, of each stretch the sample with the largest difference of either sign, or the
    largest force where nothing was fitted to the curve.
    """
    logs = fit_of(folder, name).logs
    if not 1 <= number <= len(logs):
        raise PageError(f"{name} keeps no curves of log {number}; run the fit again")
    log = logs[number - 1]
    curves = np.stack([log.time, log.friction_force, log.fitted_force, log.friction_force - log.fitted_force])
    curves = curves[:, slice(*np.searchsorted(log.time, [begin, end]))]
    if curves.shape[1] > MOST_POINTS:
        followed = curves[3] if np.isfinite(curves[3]).any() else curves[1]
        curves = curves[:, extremes(followed, MOST_POINTS // 2)]
    return curves


def batch_seen(folder: Folder, name: str) -> Document:
    """The groups of a batch with what has ended, while it runs and after."""
    from identify.studies.compare import read_fits  # which takes as long to load as all the rest of the page

    place, groups = folder.path(name), list[Document]()
    for fit in read_fits([place]):
        if not (fit.folder / "job.json").is_file():
            continue  # the batch has not come to it
        path = folder.name(fit.folder)
        row: Document = fit_row(folder, path) | {"fit": path} if fit.result.status else {}
        row["shown"] = {
            str(name.value): f"{value.shown} {unit.shown}".removesuffix(" 1")
            for name, value, unit in parameter_table(fit.result.parameters).select("parameter", "value", "unit").cells
        }
        row |= {"group": fit.name, "status": fit.status, "message": fit.message, "labels": dict(fit.labels)}
        groups.append(row)
    labels = sorted({label for group in groups for label in group["labels"]})
    report = place / "report.html"
    return {"groups": groups, "labels": labels, "report": folder.name(report) if report.is_file() else ""}
