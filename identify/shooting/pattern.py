"""Where the nonzeros of a shooting problem are: from the dense derivatives of its blocks to its sparse matrices.

It depends on which unknowns and rows each block meets, not on steps, samples or values: problems that differ in
nothing else share it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from identify.shooting.layout import Family, Indices, Layout

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scatter:
    """Constant index maps of one family: which entries of its dense Jacobian (B, n_rows, n_slots) and Hessian
    (B, n_slots, n_slots) count, and the row and column of each; the slots that are an unknown (B * n_slots,), and those
    that are one in some block."""

    slots: Indices
    rows: Indices
    jacobian_entries: Indices
    jacobian_rows: Indices
    jacobian_columns: Indices
    hessian_entries: Indices
    hessian_rows: Indices
    hessian_columns: Indices
    known_slots: NDArray[np.bool_]
    used: tuple[int, ...]

    @staticmethod
    def of(family: Family) -> Scatter:
        """The index maps of a family."""
        count, n_slots = family.slots.shape
        n_rows = family.block.n_rows
        rows = np.broadcast_to(family.rows[:, :, None], (count, n_rows, n_slots)).ravel()
        columns = np.broadcast_to(family.slots[:, None, :], (count, n_rows, n_slots)).ravel()
        entries = np.flatnonzero(columns >= 0)
        left = np.broadcast_to(family.slots[:, :, None], (count, n_slots, n_slots)).ravel()
        right = np.broadcast_to(family.slots[:, None, :], (count, n_slots, n_slots)).ravel()
        # Slots of the end state do not enter the curve, but keeping them keeps one rule for all kinds.
        upper = np.flatnonzero((left >= 0) & (right >= 0) & (left <= right))
        known = family.slots >= 0
        return Scatter(
            family.slots,
            family.rows,
            entries,
            rows[entries],
            columns[entries],
            upper,
            left[upper],
            right[upper],
            known.ravel(),
            tuple(np.flatnonzero(np.any(known, axis=0)).tolist()),
        )


def _by_columns(rows: Indices, columns: Indices, height: int) -> tuple[Indices, NDArray[np.bool_], Indices]:
    """Entries (k,) of a matrix column by column: their order, which of them in this order are not in the place of the
    one before, and the number of each such place, column * height + row."""
    keys = columns * height + rows
    order = np.argsort(keys, kind="stable")  # block by block they are all but in order, which this makes use of
    keys = keys[order]
    first = np.append(True, keys[1:] != keys[:-1])[: keys.size]
    return order, first, keys[first]


class Pattern:
    """The nonzeros of the Jacobian (m, n) of the rows and of the upper triangle of the Hessian (n, n), both by columns,
    and the index maps of every family."""

    def __init__(self, layout: Layout) -> None:
        self.families = [Scatter.of(family) for family in layout.families]
        n, m = layout.size, layout.rows
        self.shape = (m, n)
        d_row = np.concatenate([f.jacobian_rows for f in self.families])
        d_col = np.concatenate([f.jacobian_columns for f in self.families])
        order, first, keys = _by_columns(d_row, d_col, m)
        self._jacobian_order = order
        # Parameters that are tied meet in one column: their entries are added up.
        self._jacobian_first = None if np.all(first) else np.flatnonzero(first)
        self._jacobian_rows, self._jacobian_columns = (keys % m).astype(np.int32), keys // m
        self._jacobian_starts = np.searchsorted(self._jacobian_columns, np.arange(n + 1)).astype(np.int32)
        h_row = np.concatenate([*(f.hessian_rows for f in self.families), np.arange(n)])
        h_col = np.concatenate([*(f.hessian_columns for f in self.families), np.arange(n)])
        order, first, keys = _by_columns(h_row, h_col, n)
        self._hessian_slot = np.empty(order.size, dtype=np.int64)
        self._hessian_slot[order] = np.cumsum(first) - 1
        self._hessian_rows, self._hessian_columns = (keys % n).astype(np.int32), keys // n
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

    def jacobian(self, parts: Sequence[Array], scale: Array) -> sp.csc_matrix:
        """The scaled Jacobian from the entries of every family that count."""
        flat = np.concatenate(parts)[self._jacobian_order]
        if self._jacobian_first is not None:
            flat = np.add.reduceat(flat, self._jacobian_first)
        data = flat * scale[self._jacobian_columns]
        return sp.csc_matrix((data, self._jacobian_rows, self._jacobian_starts), self.shape)

    def hessian(self, parts: Sequence[Array], diagonal: Array, scale: Array) -> sp.csc_matrix:
        """The scaled Hessian, upper triangle, from the entries of every family that count and the diagonal (n,)."""
        n = diagonal.size
        bends = np.bincount(
            self._hessian_slot, weights=np.concatenate([*parts, diagonal]), minlength=self._hessian_rows.size
        )
        data = np.asarray(bends * scale[self._hessian_columns] * scale[self._hessian_rows])
        return sp.csc_matrix((data, self._hessian_rows, self._hessian_starts), (n, n))

    @cached_property
    def sparsities(self) -> tuple[ca.Sparsity, ca.Sparsity]:
        """Those of the Jacobian and of the Hessian in CasADi's words."""
        m, n = self.shape
        jacobian = ca.Sparsity(m, n, self._jacobian_starts.tolist(), self._jacobian_rows.tolist())
        return jacobian, ca.Sparsity(n, n, self._hessian_starts.tolist(), self._hessian_rows.tolist())
