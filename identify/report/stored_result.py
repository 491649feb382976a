"""The folder of a fit written and read again: result.json as strict JSON, result.h5 with the curves, page, figures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from data_io.atomic import atomic_hdf5, atomic_write
from identify.base.document import Json, as_json
from identify.base.errors import DocumentError, FitError, SceneError
from identify.base.result import LogCurves, Result
from identify.report.style import REPORTED
from identify.scene import Scene

if TYPE_CHECKING:
    from identify.report.finished import Fit


def read_document(path: Path) -> dict[str, Json]:
    """The document of a stored result.

    Raises:
        FitError: no such file, or no result of ours.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FitError(f"{path}: no such file; give the result.json of a fit") from None
    except IsADirectoryError:
        raise FitError(f"{path}: this is a folder; give the result.json in it") from None
    except (ValueError, RecursionError):
        raise FitError(f"{path}: this is not JSON; give the result.json of a fit") from None
    if isinstance(document, Mapping) and document.get("schema", 1) != 1:
        raise FitError(
            f"{path}: its schema is {document['schema']!r}; expected 1; read it with the version that wrote it"
        )
    if not _is_result(document):
        raise FitError(f"{path}: this is no result of a fit of this version; fit again, or give another result.json")
    return dict(document)


def _is_result(document: object) -> bool:
    """Whether the parts that commands read are there and of the right kind."""
    if not isinstance(document, Mapping) or not {"status", "parameters", "logs", "provenance"} <= set(document):
        return False
    try:
        result = Result.from_dict(document)
    except DocumentError:
        return False
    logs, estimated = result.scene.get("logs", ()), () if result.correlation is None else result.correlation.names
    return (
        isinstance(result.provenance.get("scene"), Mapping)
        and isinstance(logs, Sequence)
        and set(result.numbers) == set(range(len(logs)))
        and all(log.sha256 is not None for log in result.logs)
        and all(entry.verdict for entry in result.parameters.values())
        and set(estimated) <= set(result.parameters)
    )


def read_result(path: Path) -> Result:
    """A stored result; errors as `read_document`."""
    return Result.from_dict(read_document(path))


def scene_of(result: Result, path: Path | str) -> Scene:
    """The scene that a result was fitted with.

    Raises:
        FitError: what is recorded there is no scene any more.
    """
    try:
        return Scene.from_document(result.scene)
    except SceneError as error:
        raise FitError(f"{path}: the scene recorded there: {error}") from None


# The folder: everything is rendered first, then written file by file, each whole or not at all.


def write_report(fit: Fit, folder: Path) -> list[Path]:
    """Write result.json, report.html, result.h5, classical.csv, parameters.tex and figures/ of a fit into `folder`.

    The folder is made where it is missing; files of an earlier report in it are replaced and figures
    that this fit does not have are removed. Returns the written paths, result.json and report.html
    last. Until everything is rendered nothing is touched; an interruption leaves no half file.
    OSError where the folder cannot be written.
    """
    import pandas as pd  # these are slow to import

    from identify.report.figures import pictures
    from identify.report.report_page import render_page
    from identify.report.report_tables import classical_table, parameter_table

    drawn = list(pictures(fit))
    figures = {f"{drawing.name}.svg": drawing.svg for drawing in drawn}
    for name, columns in (table for drawing in drawn for table in drawing.tables.items()):
        figures[f"{name}.csv"] = pd.DataFrame(columns).to_csv(index=False, lineterminator="\n")
    contents = {
        **{f"figures/{name}": text for name, text in figures.items()},
        "classical.csv": classical_table(fit.typed.logs).to_csv(),
        "parameters.tex": parameter_table(fit.typed.parameters).to_latex(),
        "result.json": as_json(fit.result),
        "report.html": render_page(fit, drawn),
    }
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    for pattern in ("log_*_*", "correlation.*", "profile*", "optima.*", *(f"{law}.*" for law in REPORTED)):
        for path in (folder / "figures").glob(pattern):
            if path.suffix in (".svg", ".csv") and path.name not in figures:  # of an earlier report
                path.unlink()
    write_result_h5(fit, folder / "result.h5")
    for name, text in contents.items():
        with atomic_write(folder / name, "wb") as handle:
            handle.write(text.encode("utf-8"))
    return [folder / name for name in ("result.h5", *contents)]


# result.h5: the document of result.json, and the measured and fitted curves of every log.

FORMAT_VERSION = 1
CURVE_UNITS = {"time": "s", "normal_force": "N", "friction_force": "N", "fitted_force": "N", "used": "1"}
CYCLE_UNITS = {"onset": "s", "arrest": "s", "onset_force": "N", "arrest_force": "N", "misfit_z": "1"}


def write_result_h5(fit: Fit, path: Path) -> None:
    """Write the fit to an HDF5 file (an existing one is replaced), whole or not at all.

    `/document`: the text of result.json; `/curves/log_<n>`: time, forces and mask at every sample, and `cycles/`, each
    with `units`.
    """
    import h5py

    with atomic_hdf5(path) as file:
        file.attrs["format"] = "stickslip-result"
        file.attrs["format_version"] = FORMAT_VERSION
        file.create_dataset("document", data=as_json(fit.result), dtype=h5py.string_dtype())
        for position, curves in enumerate(fit.logs, start=1):
            group = file.create_group(f"curves/log_{position}")
            # HDF5 ends a text at the first zero character and knows no half characters.
            name = curves.name.replace("\0", "\N{REPLACEMENT CHARACTER}").encode("utf-8", "replace").decode("utf-8")
            group.attrs.update(name=name, noise_N=curves.noise, drive_speed_m_per_s=curves.drive_speed)
            arrays = {name: (getattr(curves, name), unit) for name, unit in CURVE_UNITS.items()}
            if curves.raw_force is not None:
                arrays["raw_friction_force"] = curves.raw_force, "N"
            columns = zip(CYCLE_UNITS.items(), curves.cycles.T, strict=True)
            arrays |= {f"cycles/{name}": (column, unit) for (name, unit), column in columns}
            for name, (values, unit) in arrays.items():
                # Small arrays stay unpacked: chunking would cost more than it saves.
                packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if len(values) > 4096 else {}
                group.create_dataset(name, data=values, **packing).attrs["units"] = unit


def read_curves(path: Path) -> tuple[LogCurves, ...]:
    """The curves of a result.h5, one per log; none where the file holds none.

    Raises:
        FitError: the file is no result.h5, or damaged.
    """
    import h5py

    try:
        with h5py.File(path) as file:
            groups = file.get("curves", {})
            return tuple(
                LogCurves(
                    name=str(group.attrs["name"]),
                    noise=float(group.attrs["noise_N"]),
                    drive_speed=float(group.attrs["drive_speed_m_per_s"]),
                    cycles=np.stack([group[f"cycles/{name}"][()] for name in CYCLE_UNITS], axis=1),
                    raw_force=group["raw_friction_force"][()] if "raw_friction_force" in group else None,
                    **{name: group[name][()] for name in CURVE_UNITS},
                )
                for group in (groups[f"log_{i}"] for i in range(1, len(groups) + 1))
            )
    except (OSError, KeyError, ValueError) as error:
        raise FitError(f"{path} holds no curves of a fit ({error}); fit again, or delete it to do without") from None
