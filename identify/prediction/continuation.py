"""Stick-slip and steady sliding continued over one quantity of rig, pair or operating point, and where they change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.prediction.chart import Chart, Range, charted
from identify.prediction.map_axes import Axis, Site
from identify.prediction.outline import Edge
from identify.prediction.plane import row
from identify.prediction.sliding import slidings

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class Change:
    """Where an answer changes: value of the quantity [SI], its derivatives (n_w,) by parameters, normal force and
    drive speed, and whether the answer holds below that value (else above)."""

    value: float
    slopes: Array
    below: bool


@dataclass(frozen=True)
class Continuation:
    """Answers over one quantity, values (n,) [SI], rising; NaN where there is none.

    figures: `sensitivity.QUANTITIES` of the orbit (n,); multipliers (n, n_y): its Floquet multipliers, largest
    magnitude first; eigenvalues (n, n_x) of steady sliding [1/s], descending real part; force of steady sliding [N];
    ends: where stick-slip ends; losses: where steady sliding becomes unstable.
    """

    quantity: Axis
    values: Array
    outcomes: NDArray[np.str_]
    figures: Mapping[str, Array]
    multipliers: Complexes
    eigenvalues: Complexes
    sliding_force: Array
    ends: tuple[Change, ...]
    losses: tuple[Change, ...]


def continuation(site: Site, name: str, span: Range | None = None, points: int = 120) -> Continuation:
    """Orbits and steady sliding of an operating point while one quantity (`axes.known_axes`) moves.

    Args:
        span: of the quantity [SI]; None: around its value at the point.

    Raises:
        SimulationError: a quantity, range or model that cannot be continued.
    """
    grid = row(site, name, span, points)
    chart, sea = charted(grid)
    admitted, settings = grid.admitted[0], grid.settings[0]
    n_x = len(site.model.states)
    multipliers = np.full((points, n_x - 1), np.nan + 0j)
    for (_, i), orbit in sea.orbits.items():
        multipliers[i] = orbit.multipliers
    eigenvalues, force = np.full((points, n_x), np.nan + 0j), np.full(points, np.nan)
    w = np.ascontiguousarray(settings[admitted])
    steady = slidings(site.model, np.ascontiguousarray(w[:, :-2]), w[:, -1].copy(), w[:, -2].copy())
    for i, state in zip(np.flatnonzero(admitted).tolist(), steady, strict=True):
        eigenvalues[i, : state.eigenvalues.size] = state.eigenvalues
        force[i] = state.force
    return Continuation(
        grid.x,
        grid.x_values,
        chart.outcomes[0],
        {key: values[0] for key, values in chart.figures.items()},
        multipliers,
        eigenvalues,
        force,
        _changes(chart, np.isfinite(chart.multiplier[0]), "sticking"),
        _changes(chart, chart.growth[0] >= 0.0, "unstable"),
    )


def _changes(chart: Chart, inside: NDArray[np.bool_], which: str) -> tuple[Change, ...]:
    crossings = chart.sticking.crossings if which == "sticking" else chart.unstable.crossings
    q = chart.plane.x
    out = []
    for edge in sorted(crossings, key=_column):
        crossing = crossings[edge]
        value = float(q.value_at(crossing.place))
        per_place = value if q.logarithmic else q.value_at(1.0)
        out.append(Change(value, per_place * crossing.slopes, bool(inside[edge[2]])))
    return tuple(out)


def _column(edge: Edge) -> int:
    return edge[2]
