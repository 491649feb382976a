"""The folder of a fit: everything is rendered first, then written file by file, each whole or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from data_io.atomic import atomic_write
from identify.report.report_tables import classical_table, parameter_table
from identify.report.stored_result import as_json

if TYPE_CHECKING:
    from identify.report.finished import Fit
    from identify.report.style import Columns

FIGURES = "figures"
FIGURE_ENDINGS = (".png", ".svg", ".csv")  # pictures of older reports were PNG too


def write_report(fit: Fit, folder: Path) -> list[Path]:
    """Write result.json, report.html, result.h5, classical.csv, parameters.tex and figures/ of a fit into `folder`.

    The folder is made where it is missing; files of an earlier report in it are replaced and figures
    that this fit does not have are removed. Returns the written paths, result.json and report.html
    last. Until everything is rendered nothing is touched; an interruption leaves no half file.
    OSError where the folder cannot be written.
    """
    from identify.report.figures import measured_cycles
    from identify.report.hdf5 import write_result_h5
    from identify.report.report_figures import pictures  # matplotlib is slow to import
    from identify.report.report_page import render_page

    drawn = list(pictures(fit))
    page, document = render_page(fit, drawn), as_json(fit.result)
    table = classical_table(fit.typed.logs).to_csv()
    latex = parameter_table(fit.typed.parameters).to_latex()
    figures: dict[str, str | bytes] = {"measured_cycles.csv": figure_csv(measured_cycles(fit.logs))}
    for picture in drawn:
        figures[f"{picture.name}.svg"] = picture.svg
        figures.update({f"{name}.csv": figure_csv(columns) for name, columns in picture.tables.items()})
    (folder / FIGURES).mkdir(parents=True, exist_ok=True)
    written = [_write(folder / FIGURES / name, content) for name, content in figures.items()]
    _remove_stale(folder / FIGURES, written)
    write_result_h5(fit, folder / "result.h5")
    written.append(folder / "result.h5")
    written.append(_write(folder / "classical.csv", table))
    written.append(_write(folder / "parameters.tex", latex))
    written.append(_write(folder / "result.json", document))
    written.append(_write(folder / "report.html", page))
    return written


def _write(path: Path, content: str | bytes) -> Path:
    with atomic_write(path, "wb") as handle:
        handle.write(content.encode("utf-8") if isinstance(content, str) else content)
    return path


def _remove_stale(folder: Path, written: Sequence[Path]) -> None:
    """Remove figures of an earlier report (by our file names only): a log that is gone must not seem to be there."""
    kept = {path.name for path in written}
    for pattern in ("log_*_*", "correlation.*", "profile.*", "profile_*", "measured*"):
        for path in folder.glob(pattern):
            if path.suffix in FIGURE_ENDINGS and path.name not in kept:
                path.unlink()


def figure_csv(columns: Columns) -> str:
    """Columns of equal length as CSV, numbers so that they read back exactly; NaN is an empty cell."""
    import pandas as pd  # half a second that `import identify` can spare

    return str(pd.DataFrame(columns).to_csv(index=False, lineterminator="\n"))
