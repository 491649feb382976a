"""Where steady sliding loses its stability, along the edges of a grid, and how those places move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.model.model import Model
from identify.prediction.outline import Edge
from identify.prediction.plane import Plane
from identify.prediction.sliding import clearances, growth_rates

Array = NDArray[np.float64]

ROUNDS, SPLITS = 3, 16  # of narrowing a crossing, and by how much each round narrows it
STEP, LEAST = 1e-5, 1e-6  # relative step of a setting, and absolute for what is zero
JUMPS = 0.1  # share of the change over an edge that is left in a narrowed crossing where the rate jumps


@dataclass(frozen=True)
class Crossing:
    """Where a boundary crosses an edge: coordinate there, and its derivatives by the setting (n_w,)."""

    place: float
    slopes: Array


def growth_at(model: Model, settings: Array) -> Array:
    """Growth rate of the least stable disturbance of steady sliding [1/s] at settings (n, n_w), shape (n,)."""
    w = np.ascontiguousarray(settings)
    return growth_rates(model, w[:, :-2], w[:, -1], w[:, -2])


def losses_of_stability(plane: Plane, growth: Array) -> dict[Edge, Crossing]:
    """Every edge over which the growth rate (n_y, n_x) of steady sliding changes its sign, and where."""
    edges = plane.edges(growth >= 0.0)
    if not edges:
        return {}
    model, ways = plane.site.model, [plane.way(edge) for edge in edges]
    low, high = np.array([w[1] for w in ways]), np.array([w[2] for w in ways])
    shares = np.linspace(0.0, 1.0, SPLITS + 1)
    first = last = np.empty(0)
    for turn in range(ROUNDS):
        places = low[:, None] + shares * (high - low)[:, None]
        settings = np.array([[way[0].setting(p) for p in row] for way, row in zip(ways, places.tolist(), strict=True)])
        rates = growth_at(model, settings.reshape(-1, settings.shape[-1])).reshape(places.shape)
        change = (rates[:, 1:] >= 0.0) != (rates[:, :1] >= 0.0)
        at, rows = np.argmax(change, axis=1), np.arange(len(edges))
        low, high = places[rows, at], places[rows, at + 1]
        before, after = rates[rows, at], rates[rows, at + 1]
        if turn == 0:
            first = np.abs(rates[:, -1] - rates[:, 0])
        last = np.abs(after - before)
    found = low + before / (before - after) * (high - low)
    jumps = last > JUMPS * first
    found = np.where(jumps, 0.5 * (low + high), found)
    settings = np.array([way[0].setting(p) for way, p in zip(ways, found.tolist(), strict=True)])
    along = np.array([way[0].slope(p) for way, p in zip(ways, found.tolist(), strict=True)])
    slopes = _slopes(model, settings, along, jumps)
    return {edge: Crossing(float(p), s) for edge, p, s in zip(edges, found, slopes, strict=True)}


def _slopes(model: Model, settings: Array, along: Array, jumps: NDArray[np.bool_]) -> Array:
    """Derivatives of the crossings (n, n_w) at settings (n, n_w), where the coordinate moves them by `along`.

    Where the growth rate jumps, the contact wears out, and it is the clearance of its state that is zero.
    """
    n, n_w = settings.shape
    steps = STEP * np.where(settings == 0.0, LEAST / STEP, np.abs(settings))
    moves = np.zeros((n, 2, n_w, n_w))
    moves[:, 0, np.arange(n_w), np.arange(n_w)], moves[:, 1, np.arange(n_w), np.arange(n_w)] = steps, -steps
    moved = np.ascontiguousarray((settings[:, None, None, :] + moves).reshape(-1, n_w))
    values = growth_at(model, moved).reshape(n, 2, n_w)
    if np.any(jumps):
        cleared = clearances(model, moved[:, :-2], moved[:, -1], moved[:, -2]).reshape(n, 2, n_w)
        values = np.where(jumps[:, None, None], cleared, values)
    by_setting = (values[:, 0] - values[:, 1]) / (2.0 * steps)
    with np.errstate(all="ignore"):
        return np.asarray(-by_setting / np.sum(by_setting * along, axis=1)[:, None])
