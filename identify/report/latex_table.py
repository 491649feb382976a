"""parameters.tex: the parameters of a fit as a LaTeX table ready to paste, symbols and lab units included."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from identify.report.report_views import ParameterView, parameter_views

GREEK = {"μ": r"\mu", "Δμ": r"\Delta\mu", "ζ": r"\zeta", "ω": r"\omega", "α": r"\alpha", "τ": r"\tau", "γ": r"\gamma"}
ESCAPED = str.maketrans(
    {"%": r"\%", "&": r"\&", "_": r"\_", "#": r"\#", "−": "$-$", "µ": r"\textmu ", "²": "$^2$", "±": r"$\pm$"}
)


def latex_table(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """A `tabular` (needs booktabs), one row per parameter: symbol, meaning, unit, value with its standard error, the
    95 % interval with the rig taken as exact and, where it is known, the one with the tolerances of rig and sensors."""
    views = parameter_views(parameters)
    both = any(view.practical for view in views)
    heads = ["parameter", "", "unit", "value", r"95\,\% interval", *([r"95\,\%, tolerances"] if both else [])]
    lines = [
        "% needs \\usepackage{booktabs}; standard errors and the first interval take rig and sensors as exact",
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
    cells = [view.meaning, view.unit or "1", value, view.interval, *([view.practical] if both else [])]
    return [f"${base}{subscript}${group}", *(cell.translate(ESCAPED) for cell in cells)]
