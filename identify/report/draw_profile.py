"""Profiles of the parameters: what the data lose when one is held and the others follow, beside the parabola."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from identify.report.quantity_text import finite, scale_for
from identify.report.report_wording import plain_symbol, with_group
from identify.report.style import FITTED, MEASURED, QUIET, SHADE, WIDE, Drawing
from identify.report.table_csv import Columns

PANELS = 3  # in a row
TICKS = 4
FEWEST = 5  # points that are a curve
TOP = 1.6  # of the limit: the height of a panel


def draw_profile(document: Mapping[str, Any], parameters: Mapping[str, Any]) -> Drawing | None:
    """One panel per profiled parameter; None where no profile has enough points to be a curve.

    Args:
        document: "profile" of the result; parameters: "parameters" of the result.
    """
    curves = {n: c for n, c in (document.get("parameters") or {}).items() if len(c["values"]) >= FEWEST}
    if not curves:
        return None
    limit, rows = float(document["limit"]), -(-len(curves) // PANELS)
    height = 0.5 + 1.75 * rows
    figure = Figure(figsize=(WIDE, height))
    grid = figure.add_gridspec(
        rows, PANELS, left=0.055, right=0.97, top=1 - 0.3 / height, bottom=0.45 / height, hspace=0.62, wspace=0.2
    )
    tables: dict[str, Columns] = {}
    for number, (name, curve) in enumerate(curves.items()):
        axes = figure.add_subplot(grid[number // PANELS, number % PANELS])
        entry = parameters.get(name) or {}
        unit = str(entry.get("unit") or "")
        value = finite(entry.get("value"))
        scale = scale_for(value, unit)
        x, loss = np.array(curve["values"], float) / scale.factor, np.array(curve["loss"], float)
        best = float(x[int(np.argmin(loss))])
        low, high = (None if end is None else end / scale.factor for end in curve["interval"])
        axes.axvspan(low if low is not None else x[0], high if high is not None else x[-1], color=SHADE, linewidth=0)
        fine = np.linspace(x[0], x[-1], 101)
        error = float(curve["standard_error"])
        logarithmic = bool(curve.get("logarithmic"))
        away = np.log(fine / best) if logarithmic else (fine - best) * scale.factor
        axes.plot(fine, (away / error) ** 2, color=QUIET, linewidth=0.9, linestyle="--", label="from the covariance")
        axes.plot(x, loss, "o-", color=FITTED, markersize=3, label="profile")
        axes.axhline(limit, color=MEASURED, linewidth=0.7)
        axes.set_ylim(0.0, TOP * limit)
        axes.xaxis.set_major_locator(MaxNLocator(TICKS))
        title = plain_symbol(with_group(name, entry))
        axes.set_title(f"{title} [{scale.unit}]" if scale.unit else title)
        if number % PANELS == 0:
            axes.set_ylabel("what the data lose")
        if number == 0:
            axes.legend(loc="upper center")
        tables[f"profile_{name}"] = {"value": np.array(curve["values"], float), "loss": loss}
    return Drawing(
        name="profile",
        figure=figure,
        alt=f"Profile likelihood of {', '.join(curves)}: the loss over each parameter, with the 95 % limit.",
        caption=(
            "Profile likelihood: loss of the data, in units of χ², when one parameter is held and all others follow. "
            f"Shaded: the 95 % interval, where the loss stays below {limit:.2f}. Dashed: what the covariance expects."
        ),
        wide=True,
        tables=tables,
    )
