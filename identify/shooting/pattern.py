"""Samples compressed into exact sums; and where the nonzeros of a shooting problem are.

The pattern leads from the dense derivatives of its blocks to its sparse matrices. It depends on which unknowns and rows
each block meets, not on steps, samples or values: problems that differ in nothing else share it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from identify.logs.log_data import LogData
from identify.shooting.layout import Family, Indices, Layout

# ----------------------------------------------------------------------------------------------------------------------
# The samples of a log, compressed exactly: what a fit needs of them whatever the curve.
#
# In each cell the model's curve is a polynomial in reference time, so sums of powers of the sample times and of the
# residuals against one curve are all that is needed. The cost of an evaluation does not depend on the sampling rate.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

PORTION = 1 << 15  # samples worked on at once, about: few enough to stay in cache
LINE = 2  # coefficients of a line


@dataclass(frozen=True)
class CellSamples:
    """Samples of one log in cells of a family: number of the log; cells (k,) that hold any, how many each holds (k,),
    and of these samples, cell by cell, the index (n,), or their slice where they follow each other, and u in [0, 1]
    (n,)."""

    log: int
    cells: Indices
    lengths: Indices
    samples: Indices | slice
    u: Array

    def of_curve(self, coefficients: Array) -> Array:
        """A curve, by its coefficients in every cell of the family (..., order, *rest), at the samples (n, *rest), by
        Horner's rule."""
        order, rest = coefficients.shape[1], coefficients.shape[2:]
        taken = coefficients[self.cells]
        u = self.u.reshape(-1, *(1 for _ in rest))
        value = np.repeat(taken[:, order - 1], self.lengths, axis=0)
        for power in range(order - 2, -1, -1):
            value *= u
            value += np.repeat(taken[:, power], self.lengths, axis=0)
        return value


@dataclass(frozen=True)
class Moments:
    """The compressed samples of one family: with w = weight, r = force - reference curve, u in [0, 1]:
    curvature (B, cells, order, order) = sum w u^(i+j); pull (B, cells, order) = sum w u^i r;
    reference (B, cells, order) coefficients; square (B,) = sum w r^2; count (B,) samples that count."""

    curvature: Array
    pull: Array
    reference: Array
    square: Array
    count: Array

    def slope_at(self, curve: Array, blocks: slice = slice(None)) -> Array:
        """Gradient of half the weighted squares of some blocks with respect to their curve coefficients."""
        step = curve - self.reference[blocks]
        return np.asarray(np.matmul(self.curvature[blocks], step[..., None])[..., 0] - self.pull[blocks])

    def squares_at(self, curve: Array) -> Array:
        """Sum of squared weighted residuals of each block (B,) at these curve coefficients."""
        return np.asarray(
            self.square + np.sum((curve - self.reference) * (self.slope_at(curve) - self.pull), axis=(1, 2))
        )


def samples_of(family: Family, logs: Sequence[LogData], portion: int = PORTION) -> Iterator[CellSamples]:
    """The samples in the cells of a family, log by log and some cells at a time."""
    flat = family.edges.reshape(-1, 2)
    for number, log in enumerate(logs):
        cells = np.flatnonzero(np.repeat(family.log == number, family.block.n_cells))
        first, last = np.searchsorted(log.time, flat[cells].T, side="left")
        final = flat[cells, 1] >= log.end
        last = np.where(final, np.searchsorted(log.time, log.end, side="right"), last)
        full = last > first
        cells, first, lengths = cells[full], first[full], (last - first)[full]
        chunk = (np.cumsum(lengths) - lengths) // portion
        for begin in np.flatnonzero(np.diff(chunk, prepend=-1)).tolist():
            part = slice(begin, int(np.searchsorted(chunk, chunk[begin], side="right")))
            held, ends = lengths[part], first[part] + lengths[part]
            sample: Indices | slice
            if np.array_equal(first[part][1:], ends[:-1]):  # as a rule: a slice copies nothing
                sample = slice(int(first[begin]), int(ends[-1]))
            else:
                sample = np.arange(int(held.sum())) + np.repeat(ends - np.cumsum(held), held)
            edges = flat[cells[part]]
            u = log.time[sample] - np.repeat(edges[:, 0], held)
            u /= np.repeat(edges[:, 1] - edges[:, 0], held)
            yield CellSamples(number, cells[part], held, sample, u)


def compressed(family: Family, logs: Sequence[LogData], reference: Array, portion: int = PORTION) -> Moments:
    """The samples in the cells of a family, compressed around a curve (B, cells, order).

    Sample by sample only the line that the curve begins with is taken off, which leaves residuals small enough for
    their squares to be exact; the rest of it moves the sums.
    """
    order, n_cells, count = family.block.order, family.block.n_cells, family.slots.shape[0]
    n = count * n_cells
    powers, pull = np.zeros((n, 2 * order - 1)), np.zeros((n, order))
    square, number = np.zeros(n), np.zeros(n)
    line = np.where(np.arange(order) < LINE, reference, 0.0)
    for held in samples_of(family, logs, portion):
        log, cells = logs[held.log], held.cells
        first = np.cumsum(held.lengths) - held.lengths
        weight = log.weight[held.samples]
        r = log.force[held.samples] - held.of_curve(line.reshape(n, order)[:, :LINE])
        number[cells] = held.lengths if weight.min() > 0 else np.add.reduceat((weight > 0).astype(float), first)
        pulled, weighed = weight * r, weight.copy()
        square[cells] = np.add.reduceat(np.multiply(pulled, r, out=r), first)
        for i in range(2 * order - 1):
            powers[cells, i] = np.add.reduceat(weighed, first)
            weighed *= held.u
            if i < order:
                pull[cells, i] = np.add.reduceat(pulled, first)
                pulled *= held.u
    hankel = np.arange(order)[:, None] + np.arange(order)[None, :]
    curvature = powers[:, hankel].reshape(count, n_cells, order, order)
    squares, numbers = (column.reshape(count, n_cells).sum(axis=1) for column in (square, number))
    about_line = Moments(curvature, pull.reshape(count, n_cells, order), line, squares, numbers)
    moved = {"pull": -about_line.slope_at(reference), "square": about_line.squares_at(reference)}
    return replace(about_line, reference=reference, **moved)


@dataclass(frozen=True)
class Scatter:
    """Where a family stands: slots and rows of its blocks, and which entries of their dense Jacobians
    (B, n_rows, n_slots) and Hessians (B, n_slots, n_slots) count."""

    slots: Indices
    rows: Indices
    jacobian: Indices
    hessian: Indices

    def gradient(self, by_slot: Array, size: int) -> Array:
        """Derivatives with respect to the slots of all blocks (B, n_slots), by unknowns (size,)."""
        # Those of slots that hold a constant are counted in front of all unknowns (KNOWN is -1), and left out.
        return np.asarray(np.bincount(self.slots.ravel() + 1, weights=by_slot.ravel(), minlength=size + 1)[1:])


@dataclass(frozen=True)
class Nonzeros:
    """Those of a sparse matrix, by columns: rows and columns (k,), where columns begin; to which of them each entry is
    added (entries,), for parameters that are tied meet in one column."""

    shape: tuple[int, int]
    rows: NDArray[np.int32]
    columns: Indices
    starts: NDArray[np.int32]
    of_entry: Indices

    @staticmethod
    def of(entries: list[Indices], shape: tuple[int, int]) -> Nonzeros:
        """From the rows and the columns (2, ...) of all entries."""
        rows, columns = np.concatenate(entries, axis=1)
        places, of_entry = np.unique(columns * shape[0] + rows, return_inverse=True)
        columns = places // shape[0]
        starts = np.searchsorted(columns, np.arange(shape[1] + 1)).astype(np.int32)
        return Nonzeros(shape, (places % shape[0]).astype(np.int32), columns, starts, of_entry)

    def matrix(self, entries: Sequence[Array], scale: Array, row_scale: Array | None = None) -> sp.csc_matrix:
        """The matrix of entries, columns times `scale` (n,) and rows times `row_scale`; entries that are left out at
        the end are zero."""
        values = np.concatenate(entries)
        data = scale[self.columns] * np.bincount(self.of_entry[: values.size], values, self.rows.size)
        if row_scale is not None:
            data = data * row_scale[self.rows]
        return sp.csc_matrix((data, self.rows, self.starts), self.shape)

    @cached_property
    def sparsity(self) -> ca.Sparsity:
        """The same for CasADi."""
        return ca.Sparsity(*self.shape, self.starts.tolist(), self.rows.tolist())


class Pattern:
    """The nonzeros of the Jacobian (m, n) of the rows and of the upper triangle of the Hessian (n, n), and where every
    family stands in them; behind the entries of the families in the Hessian come those of the priors, as
    `Layout.prior_hessian` has them."""

    def __init__(self, layout: Layout) -> None:
        self.about, self.families = layout.prior_about, list[Scatter]()
        jacobian, hessian = list[Indices](), list[Indices]()
        for family in layout.families:
            slots, rows = family.slots, family.rows
            known = slots >= 0
            by_row, by_column = np.broadcast_arrays(rows[:, :, None], slots[:, None, :])
            entries = np.flatnonzero(by_column >= 0)
            jacobian.append(np.stack([by_row.ravel()[entries], by_column.ravel()[entries]]))
            # Slots of the end state do not enter the curve, but keeping them keeps one rule for all kinds.
            left, right = np.broadcast_arrays(slots[:, :, None], slots[:, None, :])
            upper = np.flatnonzero(known[:, :, None] & known[:, None, :] & (left <= right))
            hessian.append(np.stack([left.ravel()[upper], right.ravel()[upper]]))
            self.families.append(Scatter(slots, rows, entries, upper))
        n, varied, about = layout.size, layout.varied, layout.prior_about[layout.varied]
        hessian += [np.tile(np.arange(n), (2, 1)), np.sort(np.stack([varied, about]), axis=0)]
        self.jacobian = Nonzeros.of(jacobian, (layout.rows, n))
        self.hessian = Nonzeros.of(hessian, (n, n))

    def fits(self, layout: Layout) -> bool:
        """Whether a layout has the same unknowns and rows, block by block."""
        return (
            self.jacobian.shape == (layout.rows, layout.size)
            and len(self.families) == len(layout.families)
            and np.array_equal(self.about, layout.prior_about)
            and all(
                np.array_equal(mine.slots, family.slots) and np.array_equal(mine.rows, family.rows)
                for mine, family in zip(self.families, layout.families, strict=True)
            )
        )
