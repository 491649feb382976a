"""Where the nonzeros of a shooting problem are: from the dense derivatives of its blocks to its sparse matrices.

It depends on which unknowns and rows each block meets, not on steps, samples or values: problems that differ in
nothing else share it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from identify.shooting.layout import Family, Indices, Layout

Array = NDArray[np.float64]


PORTION = 1024  # blocks worked on at once: few enough for all their derivatives to stay in cache


@dataclass(frozen=True)
class Part:
    """Constant index maps of some blocks of one family, PORTION at most: which entries of their dense Jacobian
    (b, n_rows, n_slots) and Hessian (b, n_slots, n_slots) count, and where these stand among those of all parts."""

    blocks: slice
    jacobian_entries: Indices
    hessian_entries: Indices
    jacobian: slice
    hessian: slice


@dataclass
class _Numbering:
    """The places in the matrices, column by column, of all entries that count so far, part by part."""

    shape: tuple[int, int]
    jacobian: list[Indices]
    hessian: list[Indices]
    counts: tuple[int, int] = (0, 0)

    def part(self, family: Family, blocks: slice) -> Part:
        """The index maps of some blocks, whose entries are counted."""
        m, n = self.shape
        slots, rows = family.slots[blocks], family.rows[blocks]
        known = slots >= 0
        entries = np.flatnonzero(np.broadcast_to(known[:, None, :], (*rows.shape, slots.shape[1])))
        self.jacobian.append((slots[:, None, :] * m + rows[:, :, None]).ravel()[entries])
        # Slots of the end state do not enter the curve, but keeping them keeps one rule for all kinds.
        left, right = slots[:, :, None], slots[:, None, :]
        upper = np.flatnonzero(known[:, :, None] & known[:, None, :] & (left <= right))
        self.hessian.append((right * n + left).ravel()[upper])
        before, self.counts = self.counts, (self.counts[0] + entries.size, self.counts[1] + upper.size)
        return Part(blocks, entries, upper, slice(before[0], self.counts[0]), slice(before[1], self.counts[1]))


@dataclass(frozen=True)
class Scatter:
    """Where a family stands: slots and rows of its blocks, the slots that are an unknown in some block, and the index
    maps part by part."""

    slots: Indices
    rows: Indices
    used: tuple[int, ...]
    parts: tuple[Part, ...]

    @staticmethod
    def of(family: Family, numbering: _Numbering) -> Scatter:
        """That of a family, whose entries are counted."""
        used = np.flatnonzero(np.any(family.slots >= 0, axis=0))
        starts = range(0, family.slots.shape[0], PORTION)
        parts = tuple(numbering.part(family, slice(first, first + PORTION)) for first in starts)
        return Scatter(family.slots, family.rows, tuple(used.tolist()), parts)

    def gradient(self, pull: Array, size: int) -> Array:
        """What the slots of all blocks pull at (B, n_slots), by unknowns (size,)."""
        # What slots that hold a constant pull at is counted in front of all unknowns (KNOWN is -1), and left out.
        return np.asarray(np.bincount(self.slots.ravel() + 1, weights=pull.ravel(), minlength=size + 1)[1:])


def _in_order(places: Indices) -> tuple[Indices, NDArray[np.bool_], Indices]:
    """Places of entries (k,) in a matrix: their order, which of them in this order are not in the place of the one
    before, and these places."""
    order = np.argsort(places, kind="stable")  # block by block they are all but in order, which this makes use of
    places = places[order]
    first = np.append(True, places[1:] != places[:-1])[: places.size]
    return order, first, places[first]


class Pattern:
    """The nonzeros of the Jacobian (m, n) of the rows and of the upper triangle of the Hessian (n, n), both by columns,
    and the index maps of every family."""

    def __init__(self, layout: Layout) -> None:
        n, m = layout.size, layout.rows
        numbering = _Numbering((m, n), [], [])
        self.families = [Scatter.of(family, numbering) for family in layout.families]
        self.shape, self.counts = (m, n), numbering.counts
        order, first, places = _in_order(np.concatenate(numbering.jacobian))
        self._jacobian_order = order
        # Parameters that are tied meet in one column: their entries are added up.
        self._jacobian_first = None if np.all(first) else np.flatnonzero(first)
        self._jacobian_rows, self._jacobian_columns = (places % m).astype(np.int32), places // m
        self._jacobian_starts = np.searchsorted(self._jacobian_columns, np.arange(n + 1)).astype(np.int32)
        order, first, places = _in_order(np.concatenate([*numbering.hessian, (n + 1) * np.arange(n)]))
        self._hessian_slot = np.empty(order.size, dtype=np.int64)
        self._hessian_slot[order] = np.cumsum(first) - 1
        self._hessian_rows, self._hessian_columns = (places % n).astype(np.int32), places // n
        self._hessian_starts = np.searchsorted(self._hessian_columns, np.arange(n + 1)).astype(np.int32)

    def fits(self, layout: Layout) -> bool:
        """Whether a layout has the same unknowns and rows, block by block."""
        return (
            self.shape == (layout.rows, layout.size)
            and len(self.families) == len(layout.families)
            and all(
                np.array_equal(mine.slots, family.slots) and np.array_equal(mine.rows, family.rows)
                for mine, family in zip(self.families, layout.families, strict=True)
            )
        )

    def entries(self) -> tuple[Array, Array]:
        """Room for the entries that count, of the Jacobian and, behind them the diagonal (n,), of the Hessian."""
        return np.empty(self.counts[0]), np.zeros(self.counts[1] + self.shape[1])

    def jacobian(self, entries: Array, scale: Array) -> sp.csc_matrix:
        """The scaled Jacobian from the entries that count."""
        flat = entries[self._jacobian_order]
        if self._jacobian_first is not None:
            flat = np.add.reduceat(flat, self._jacobian_first)
        data = flat * scale[self._jacobian_columns]
        return sp.csc_matrix((data, self._jacobian_rows, self._jacobian_starts), self.shape)

    def hessian(self, entries: Array, scale: Array) -> sp.csc_matrix:
        """The scaled Hessian, upper triangle, from the entries that count and its diagonal."""
        bends = np.bincount(self._hessian_slot, weights=entries, minlength=self._hessian_rows.size)
        data = np.asarray(bends * scale[self._hessian_columns] * scale[self._hessian_rows])
        return sp.csc_matrix((data, self._hessian_rows, self._hessian_starts), (scale.size, scale.size))

    @cached_property
    def sparsities(self) -> tuple[ca.Sparsity, ca.Sparsity]:
        """Those of the Jacobian and of the Hessian in CasADi's words."""
        m, n = self.shape
        jacobian = ca.Sparsity(m, n, self._jacobian_starts.tolist(), self._jacobian_rows.tolist())
        return jacobian, ca.Sparsity(n, n, self._hessian_starts.tolist(), self._hessian_rows.tolist())
