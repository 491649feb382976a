"""Tables as text: the classical table of all logs and the data behind a figure as CSV, the parameters as LaTeX."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from identify.base.document import Json
from identify.base.result import LogResult, ParameterResult
from identify.report.report_views import ParameterView, parameter_views
from identify.report.stored_result import plain

Columns = Mapping[str, NDArray[np.generic]]  # columns of equal length by name
Row = Mapping[str, Json]


def classical_rows(logs: Sequence[LogResult]) -> list[tuple[int, Row]]:
    """The rows of every log's classical table, each with the number of its log (from 1)."""
    return [(number, row) for number, log in enumerate(logs, start=1) for row in log.classical.rows]


def column_names(rows: Sequence[tuple[int, Row]]) -> list[str]:
    """All columns that occur, in the order in which they first occur."""
    return list(dict.fromkeys(name for _, row in rows for name in row))


def classical_csv(logs: Sequence[LogResult]) -> str:
    """The classical table of all logs (SI, units in the column names); an empty cell where a value is missing."""
    rows = classical_rows(logs)
    columns = column_names(rows)
    body = ([number, logs[number - 1].path, *(row.get(name) for name in columns)] for number, row in rows)
    return _text(["log", "path", *columns], body)


def figure_csv(columns: Columns) -> str:
    """Columns of equal length as CSV, numbers so that they read back exactly; NaN is an empty cell."""
    return _text(list(columns), zip(*(values.tolist() for values in columns.values()), strict=True))


def _text(header: Sequence[str], body: Iterator[Sequence[object]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([["" if cell is None else cell for cell in plain(list(row))] for row in body])
    return out.getvalue()


# ----------------------------------------------------------------------------------------------------------------------
# parameters.tex: the parameters of a fit as a LaTeX table ready to paste, symbols and lab units included.
# ----------------------------------------------------------------------------------------------------------------------

GREEK = {"μ": r"\mu", "Δμ": r"\Delta\mu", "ζ": r"\zeta", "ω": r"\omega", "α": r"\alpha", "τ": r"\tau", "γ": r"\gamma"}
ESCAPED = str.maketrans(
    {"%": r"\%", "&": r"\&", "_": r"\_", "#": r"\#", "−": "$-$", "µ": r"\textmu ", "²": "$^2$", "±": r"$\pm$"}
)


def latex_table(parameters: Mapping[str, ParameterResult]) -> str:
    """A `tabular` (needs booktabs), one row per parameter: symbol, meaning, unit, value with its standard error, the
    95 % interval and, beside it, the one of noise alone."""
    views = parameter_views(parameters)
    both = any(view.exact for view in views)
    heads = ["parameter", "", "unit", "value", r"95\,\% interval", *([r"rig exact"] if both else [])]
    lines = [
        "% needs \\usepackage{booktabs}; standard errors and intervals hold errors of rig and sensors",
        rf"\begin{{tabular}}{{lll{'r' * (len(heads) - 3)}}}",
        r"\toprule",
        " & ".join(heads) + r" \\",
        r"\midrule",
        *(" & ".join(_cells(view, both)) + r" \\" for view in views),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def _cells(view: ParameterView, both: bool) -> list[str]:
    base = GREEK.get(view.symbol, view.symbol)
    subscript = rf"_{{\mathrm{{{view.subscript.translate(ESCAPED)}}}}}" if view.subscript else ""
    group = f" ({view.group.translate(ESCAPED)})" if view.group else ""
    value = view.value if not view.error else f"{view.value} ± {view.error}"
    cells = [view.meaning, view.unit or "1", value, view.interval, *([view.exact] if both else [])]
    return [f"${base}{subscript}${group}", *(cell.translate(ESCAPED) for cell in cells)]
