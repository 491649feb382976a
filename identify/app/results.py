"""Finished fits and batches as the page shows them: what their files hold, nothing computed."""

from __future__ import annotations

import io
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray
from starlette.responses import Response

from identify.app.curves import MOST_POINTS
from identify.app.folder import Document, Folder, PageError, mapping, read_json
from identify.app.simulations import ONE_AT_A_TIME
from identify.base.errors import IdentifyError
from identify.base.result import Result
from identify.base.table import OutputTable
from identify.report.finished import Fit
from identify.report.report_tables import parameter_table
from identify.report.report_wording import (
    NOT_FOR,
    accuracy_text,
    distribution_lines,
    headline,
    is_uneven,
    plain_symbol,
    tolerances_text,
)
from identify.report.stored_result import plain
from identify.report.style import COLUMN, TWO_COLUMNS, drawing_style, extremes

Array = NDArray[np.float64]
# Words, and the effect whose law it is.
PICTURES = {
    "residual_histogram": ("residuals", ""),
    "logs": ("all logs over each other", ""),
    "friction": ("friction over sliding speed", "velocity_weakening"),
    "ageing": ("strength over rest", "contact_ageing"),
}
FORMS = {"svg": "image/svg+xml", "pdf": "application/pdf", "png": "image/png"}
SHOWN = ("status", "message", "parameters", "search", "not_tried", "accuracy", "timing_s")


def as_shown(table: OutputTable) -> Document:
    """A table in the very words of report and terminal."""
    numbers = [any(isinstance(row[k].value, int | float) for row in table.cells) for k in range(len(table.columns))]
    cells = [[{"text": cell.shown, "note": cell.note, "kind": cell.kind} for cell in row] for row in table.cells]
    return {"columns": table.columns, "numbers": numbers, "rows": cells}


def fit_seen(folder: Folder, name: str) -> Document:
    """What the page shows of the fit in a folder."""
    place = folder.path(name)
    document = read_json(place / "result.json")
    if document is None:
        raise PageError(f"{name} holds no whole result.json; run the fit again")
    result = Result.from_dict(document)
    uneven = None
    if is_uneven(result):
        cycles = [{key: log[key] for key in ("log", "rest_s", "strength")} for log in document["uneven_cycles"]]
        uneven = {
            "headline": headline(result),
            "not_for": NOT_FOR,
            "spread": list(distribution_lines(result)),
            "sticks": cycles,
            "typical": document["strength_against_rest"],
        }
    cycles_of = _cycles(place / "result.h5", len(document["logs"]))
    logs = [
        {
            "path": path.relative_to(folder.root).as_posix() if path.is_relative_to(folder.root) else path.name,
            "left_out": log.get("reason_left_out"),
            "text": (log.get("derived") or {}).get("text", ""),
            "cycles": cycles,
        }
        for log, cycles in zip(document["logs"], cycles_of, strict=True)
        for path in [Path(str(log.get("path")))]
    ]
    whole = result.status == "converged" and uneven is None and all(e.value for e in result.parameters.values())
    laws = ("", *result.effects.names) if whole else ()
    return {key: document.get(key) for key in SHOWN} | {
        "table": as_shown(parameter_table(result.parameters)),
        "tolerances": tolerances_text(result.tolerances or {}),
        "accuracy_line": accuracy_text(result.accuracy),
        "uneven": uneven,
        "effects": (document.get("effects") or {}).get("reasons") or [],
        "logs": logs,
        "symbols": {key: plain_symbol(key) for key in document.get("parameters") or {}},
        "figures": sorted(item.name for item in (place / "figures").glob("*.svg")),
        "drawn": [(kind, words) for kind, (words, effect) in PICTURES.items() if effect in laws],
        "files": sorted(item.name for item in place.iterdir() if item.is_file()),
    }


def fit_picture(folder: Folder, name: str, kind: str, form: str, columns: int) -> Response:
    """One of PICTURES of the fit in a folder, at the width of one or two columns of a paper (a PNG at 300 dpi)."""
    if kind not in PICTURES or form not in FORMS:
        raise PageError(f"a fit has no picture {kind}.{form}; load the page again")
    out = io.BytesIO()
    with ONE_AT_A_TIME, drawing_style():
        figure = getattr(Fit.load(folder.path(name)), f"plot_{kind}")().figure
        figure.set_size_inches(COLUMN if columns == 1 else TWO_COLUMNS)
        figure.savefig(out, format=form, dpi=300)
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
    try:
        with h5py.File(folder.path(name) / "result.h5", "r") as file:
            log = file[f"curves/log_{number}"]
            curves = np.stack([log[key][:] for key in ("time", "friction_force", "fitted_force")])
    except (OSError, KeyError):
        raise PageError(f"{name} keeps no curves of log {number}; run the fit again") from None
    curves = curves[:, slice(*np.searchsorted(curves[0], [begin, end]))]
    curves = np.vstack([curves, curves[1] - curves[2]])
    if curves.shape[1] > MOST_POINTS:
        followed = curves[3] if np.isfinite(curves[3]).any() else curves[1]
        curves = curves[:, extremes(followed, MOST_POINTS // 2)]
    return curves


def batch_seen(folder: Folder, name: str) -> Document:
    """The groups of a batch with what has ended, while it runs and after."""
    place = folder.path(name)
    about = {group["folder"]: group for group in (read_json(place / "batch.json") or {}).get("groups", ())}
    groups = []
    for path in sorted(place.glob("*/job.json")):
        job, fit = read_json(path) or {}, folder.name(path.parent)
        row: Document = fit_row(folder, fit) | {"fit": fit} if (path.parent / "result.json").is_file() else {}
        with suppress(IdentifyError):  # of no whole result
            shown = parameter_table(Result.from_dict(read_json(path.parent / "result.json") or {}).parameters)
            row["shown"] = {
                str(name.value): f"{value.shown} {unit.shown}".removesuffix(" 1")
                for name, value, unit in shown.select("parameter", "value", "unit").cells
            }
        row |= {key: str(job.get(key, "")) for key in ("group", "status", "message")}
        groups.append(row | {"labels": about.get(path.parent.name, {}).get("labels", {})})
    labels = sorted({label for group in about.values() for label in group["labels"]})
    report = place / "report.html"
    return {"groups": groups, "labels": labels, "report": folder.name(report) if report.is_file() else ""}


def _cycles(path: Path, logs: int) -> list[list[Document]]:
    """Onset, arrest [s] and misfit z of the cycles of every log that a fit keeps curves of."""
    out: list[list[Document]] = [[] for _ in range(logs)]
    with suppress(OSError), h5py.File(path, "r") as file:
        for number in range(logs):
            group = file.get(f"curves/log_{number + 1}/cycles", {})
            names = [key for key in ("onset", "arrest", "misfit_z") if key in group and "onset" in group]
            columns = zip(*(group[key][:].tolist() for key in names), strict=True)
            out[number] = plain([dict(zip(names, row, strict=True)) for row in columns])
    return out
