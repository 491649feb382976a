"""Finished fits and batches as the page shows them: what their files say, nothing computed."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from identify.app.curves import MOST_POINTS, STRETCHES
from identify.app.folder import Folder, PageError, read_json
from identify.base.result import Result
from identify.report.report_wording import NOT_FOR, distribution_lines, headline, is_uneven
from identify.report.stored_result import plain
from identify.report.summary import accuracy_text, tolerances_text

Array = NDArray[np.float64]
SHOWN = ("status", "message", "parameters", "gate", "fit", "search", "not_tried", "found_by", "next_logs", "notes",
         "accuracy", "timing_s")  # fmt: skip


def fit_seen(folder: Folder, name: str) -> dict[str, Any]:
    """What the page shows of the fit in a folder.

    Raises:
        PageError: there is no whole result.
    """
    place = folder.path(name)
    document = read_json(place / "result.json")
    if document is None:
        raise PageError(f"{name} holds no whole result.json; run the fit again")
    seen = {key: document.get(key) for key in SHOWN}
    result = Result.from_dict(document)
    seen["tolerances"] = tolerances_text(result.tolerances or {})
    seen["accuracy_line"] = accuracy_text(result.accuracy)
    seen["uneven"] = _uneven(result) if is_uneven(result) else None
    seen["effects"] = (document.get("effects") or {}).get("reasons") or []
    seen["logs"] = [
        {
            "path": _inside(folder, log.get("path")),
            "left_out": log.get("reason_left_out"),
            "drive_speed": log.get("drive_speed_m_per_s"),
            "text": (log.get("derived") or {}).get("text", ""),
            "cycles": cycles,
        }
        for log, cycles in zip(document["logs"], _cycles(place / "result.h5", len(document["logs"])), strict=True)
    ]
    seen["files"] = sorted(item.name for item in place.iterdir() if item.is_file())
    return seen


def _uneven(result: Result) -> dict[str, Any]:
    """Of a pair whose cycles differ: the headline and what it is not for, how peak, drop and period are spread,
    strength over rest (of every stick, and the typical curve with its band)."""
    document: Mapping[str, Any] = result.more
    return {
        "headline": headline(result),
        "not_for": NOT_FOR,
        "spread": list(distribution_lines(result)),
        "sticks": [{key: cycles[key] for key in ("log", "rest_s", "strength")} for cycles in document["uneven_cycles"]],
        "typical": document["strength_against_rest"],
    }


def fit_row(folder: Folder, fit: str) -> dict[str, Any]:
    """One line of the list of fits."""
    document = _table(read_json(folder.path(fit) / "result.json"))
    return {
        "path": fit,
        "status": str(document.get("status", "not whole")).replace("_", " "),
        "message": document.get("message", ""),
        "finished": _table(document.get("provenance")).get("finished", ""),
        "parameters": {
            key: {k: _table(entry).get(k) for k in ("value", "unit", "interval", "verdict")}
            for key, entry in _table(document.get("parameters")).items()
        },
    }


def _table(value: object) -> Mapping[str, Any]:
    """A part of a document that anybody may have written."""
    return value if isinstance(value, Mapping) else {}


def residuals(folder: Folder, name: str, number: int, begin: float, end: float) -> Array:
    """Time [s], measured force [N], fitted force [N], their difference [N] of a log (from 1) of a fit, (4, m): where
    there are more than fit a curve, of each stretch the sample with the largest difference of either sign, or the
    largest force where nothing was fitted to the curve.

    Raises:
        PageError: the fit keeps no curves of this log.
    """
    try:
        with h5py.File(folder.path(name) / "result.h5", "r") as file:
            log = file[f"curves/log_{number}"]
            time, measured, fitted = (log[key][:] for key in ("time", "friction_force", "fitted_force"))
    except (OSError, KeyError):
        raise PageError(f"{name} keeps no curves of log {number}; run the fit again") from None
    rows = slice(*np.searchsorted(time, [begin, end]))
    time, measured, fitted = time[rows], measured[rows], fitted[rows]
    off = measured - fitted
    if time.size > MOST_POINTS:
        starts = np.linspace(0, time.size, STRETCHES + 1).astype(int)
        told = off if np.any(np.isfinite(off)) else measured
        sound = np.where(np.isfinite(told), told, 0.0)
        picked = [a + at(sound[a:b]) for a, b in pairwise(starts) for at in (np.argmin, np.argmax)]
        keep = np.unique(picked)
        time, measured, fitted, off = time[keep], measured[keep], fitted[keep], off[keep]
    return np.stack([time, measured, fitted, off])


def batch_seen(folder: Folder, name: str) -> dict[str, Any]:
    """The groups of a batch with what has ended, while it runs and after."""
    place = folder.path(name)
    document = read_json(place / "batch.json") or {}
    about = {group["folder"]: group for group in document.get("groups", ())}
    groups = []
    for path in sorted(place.glob("*/job.json")):
        job, fit = read_json(path) or {}, folder.name(path.parent)
        row: dict[str, Any] = fit_row(folder, fit) | {"fit": fit} if (path.parent / "result.json").is_file() else {}
        row |= {key: str(job.get(key, "")) for key in ("group", "status", "message")}
        groups.append(row | {"labels": about.get(path.parent.name, {}).get("labels", {})})
    labels = sorted({label for group in about.values() for label in group["labels"]})
    report = place / "report.html"
    return {"groups": groups, "labels": labels, "report": folder.name(report) if report.is_file() else ""}


def _cycles(path: Path, logs: int) -> list[list[dict[str, Any]]]:
    """Onset, arrest [s] and misfit z of the cycles of every log that a fit keeps curves of."""
    out: list[list[dict[str, Any]]] = [[] for _ in range(logs)]
    try:
        with h5py.File(path, "r") as file:
            for number in range(logs):
                group = file.get(f"curves/log_{number + 1}/cycles")
                if group is None or "onset" not in group:
                    continue
                names = [key for key in ("onset", "arrest", "misfit_z") if key in group]
                columns = zip(*(group[key][:].tolist() for key in names), strict=True)
                out[number] = plain([dict(zip(names, row, strict=True)) for row in columns])
    except OSError:
        return out
    return out


def _inside(folder: Folder, path: Any) -> str:
    """The path of a log as the page names it; its name where it lies elsewhere."""
    try:
        return folder.name(Path(str(path)))
    except ValueError:
        return Path(str(path)).name
