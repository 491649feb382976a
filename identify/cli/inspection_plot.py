"""Force and phases of the inspected logs as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from data_io.atomic import atomic_path
from identify.segment import SLIDING, SLIP

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from identify.cli.inspection import Inspection

MOST_POINTS = 20_000


def draw(seen: Sequence[Inspection], path: Path) -> None:
    """One panel per log: friction force over time, slips and sliding shaded."""
    figure = Figure(figsize=(8.0, 2.4 * len(seen) + 0.4), layout="constrained")
    for number, item in enumerate(seen, 1):
        _panel(figure.add_subplot(len(seen), 1, number), item)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=130)


def _panel(axes: Axes, item: Inspection) -> None:
    record = item.record
    every = max(len(record) // MOST_POINTS, 1)
    axes.plot(record.time[::every], record.friction_force[::every], color="0.2", lw=0.7)
    for seen in item.steps:
        time = record.time[seen.step.start : seen.step.stop]
        for phase, colour, label in ((SLIP, "C1", "slip"), (SLIDING, "C0", "sliding")):
            for begin, end in _spans(seen.phases.phase == phase):
                axes.axvspan(float(time[begin]), float(time[end - 1]), color=colour, alpha=0.25, lw=0, label=label)
                label = f"_{label}"  # only the first stands in the legend
    axes.set_title(Path(item.path).name, fontsize=9)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("friction force [N]")
    if axes.get_legend_handles_labels()[1]:
        axes.legend(frameon=False, fontsize=8, loc="upper right")


def _spans(mask: np.ndarray) -> list[tuple[int, int]]:
    """Half-open index ranges in which the mask is true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return [(int(begin), int(end)) for begin, end in zip(edges[::2], edges[1::2], strict=True)]
