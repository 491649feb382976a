"""Uneven records: onsets and the slow level along a record with its odd slips, and strength against rest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from identify.report.style import ARREST, BEHIND, FITTED, ONSET, SHADE, WIDE, Drawing, frame, headroom


def draw_uneven(result: Mapping[str, Any]) -> Iterator[tuple[int, Drawing]]:
    """One figure per log that the estimator of uneven records took, with the number of the log (from 1)."""
    curve = result.get("strength_against_rest") or {}
    for table in result.get("uneven_cycles") or ():
        yield int(table["log"]), _draw(table, curve)


def _draw(table: Mapping[str, Any], curve: Mapping[str, Any]) -> Drawing:
    names = ("cycle", "onset_s", "rest_s", "onset", "drop", "strength", "level", "odd")
    column = {name: np.array([np.nan if v is None else v for v in table[name]], dtype=np.float64) for name in names}
    odd = column["odd"] > 0.9
    figure = Figure(figsize=(WIDE, 3.0))
    grid = figure.add_gridspec(1, 2, width_ratios=(1.9, 1.0), left=0.06, right=0.992, top=0.9, bottom=0.16, wspace=0.18)
    along = figure.add_subplot(grid[0, 0])
    time = column["onset_s"]
    along.vlines(time, column["onset"] - column["drop"], column["onset"], color=BEHIND, linewidth=0.8)
    along.plot(time, column["onset"], "o", color=ONSET, markersize=3.4, label="onset")
    along.plot(time, column["onset"] - column["drop"], "o", color=ARREST, markersize=2.6, label="arrest")
    along.plot(time, column["level"], color=FITTED, linewidth=1.1, label="slow level")
    if odd.any():
        along.plot(time[odd], column["onset"][odd], "x", color="black", markersize=8, label="odd slip")
        for number, x, y in zip(column["cycle"][odd], time[odd], column["onset"][odd], strict=True):
            along.annotate(f"{number:.0f}", (x, y), xytext=(4, 4), textcoords="offset points", fontsize=7.5)
    headroom(along, 0.12)
    along.legend(loc="upper left", ncols=4)
    frame(along, "time (s)", "", "friction over load")
    against = figure.add_subplot(grid[0, 1])
    if "rest_s" in curve:
        against.fill_between(curve["rest_s"], curve["lower"], curve["upper"], color=SHADE, linewidth=0)
        against.plot(curve["rest_s"], curve["strength"], color=FITTED, label="usual strength, 95 % band")
        against.legend(loc="upper right")
    against.plot(column["rest_s"], column["strength"], "o", color=ONSET, markersize=3.2)
    _from_zero(against)
    frame(against, "rest before the slip (s)", "", "strength over load")
    return Drawing(
        name=f"log_{table['log']}_uneven",
        figure=figure,
        alt=f"Onsets, arrests and slow level of the {time.size} cycles of log {table['log']}, and their strengths "
        "against the rest before them.",
        caption="Left: friction over the load at onsets and arrests, and the slow level that the cycles follow; odd "
        "slips are numbered: their level changed by more than the wander explains. Right: strength of every stick "
        "(onset above the slow level) against its rest; line and band: the usual strength, within the rests seen. A "
        "stick is long because the spot was strong, so the points rise more steeply than the line.",
        wide=True,
        tables={f"log_{table['log']}_uneven": column},
    )


def _from_zero(axes: Axes) -> None:
    headroom(axes, 0.1)
    axes.set_ylim(bottom=0.0)
    axes.set_xlim(left=0.0)
