"""comparison.h5: every table, every pooled quantity with its covariance, and the documents of all fits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from identify.report.document import as_json
from identify.studies.compare import Comparison
from identify.studies.fits import FitEntry
from identify.studies.sheets import Sheet

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
            _put_fit(file.create_group(f"fits/{number}", track_order=True), entry)
        if comparison is not None:
            _put_pooled(file.create_group("pooled", track_order=True), comparison)


def storable(text: str) -> str:
    """HDF5 ends a text at the first zero character and knows no half characters."""
    return text.replace("\0", "\N{REPLACEMENT CHARACTER}").encode("utf-8", "replace").decode("utf-8")


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


def _put_fit(group: h5py.Group, entry: FitEntry) -> None:
    for name in ("name", "status", "message"):
        _text(group, name, getattr(entry, name))
    _text(group, "labels", as_json(dict(entry.labels)))
    _text(group, "document", as_json(dict(entry.document)))


def _text(group: h5py.Group, name: str, text: str) -> None:
    group.create_dataset(name, data=storable(text), dtype=h5py.string_dtype())


def _put_pooled(group: h5py.Group, comparison: Comparison) -> None:
    names = [entry.name for entry in comparison.taken.entries]
    _text(group, "by", comparison.question.by)
    group.create_dataset("fits", data=[storable(n) for n in names], dtype=h5py.string_dtype())
    for number, entry in enumerate(comparison.quantities, 1):
        if entry.pooled is None:
            continue
        inner, mixed = group.create_group(str(number), track_order=True), entry.pooled.mixed
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
