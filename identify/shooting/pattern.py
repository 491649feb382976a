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

PORTION = 1 << 15  # samples worked on at once: few enough to stay in cache
LINE = 2  # coefficients of a line


@dataclass(frozen=True)
class CellSamples:
    """Samples of one log in cells of a family: number of the log; cells (k,) that hold any, none twice, how many each
    holds (k,), and of these samples, cell by cell, the index (n,), or their slice where they follow each other, and
    u in [0, 1] (n,). A cell of many samples is cut: its others come later."""

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
            value += _each(taken[:, power], self.lengths)
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

    def slope_at(self, curve: Array) -> Array:
        """Gradient of half the weighted squares with respect to the curve coefficients, shape of curve."""
        return np.asarray(self._bent(curve - self.reference) - self.pull)

    def squares_at(self, curve: Array) -> Array:
        """Sum of squared weighted residuals of each block (B,) at these curve coefficients."""
        step = curve - self.reference
        return np.asarray(self.square + np.sum(step * (self._bent(step) - 2 * self.pull), axis=(1, 2)))

    def around(self, curve: Array) -> Moments:
        """The same samples, compressed around another curve."""
        return replace(self, reference=curve, pull=-self.slope_at(curve), square=self.squares_at(curve))

    def of(self, blocks: slice) -> Moments:
        """Those of some blocks."""
        columns = (self.curvature, self.pull, self.reference, self.square, self.count)
        return Moments(*(column[blocks] for column in columns))

    def _bent(self, step: Array) -> Array:
        return np.asarray(np.matmul(self.curvature, step[..., None])[..., 0])


def samples_of(family: Family, logs: Sequence[LogData], portion: int = PORTION) -> Iterator[CellSamples]:
    """The samples in the cells of a family, log by log and a portion at a time."""
    n_cells = family.block.n_cells
    flat = family.edges.reshape(-1, 2)
    for number, log in enumerate(logs):
        cells = np.flatnonzero(np.repeat(family.log == number, n_cells))
        if cells.size == 0:
            continue
        first, last = np.searchsorted(log.time, flat[cells].T, side="left")
        final = flat[cells, 1] >= log.end
        last = np.where(final, np.searchsorted(log.time, log.end, side="right"), last)
        full = last > first
        cells, first, lengths = cells[full], first[full], (last - first)[full]
        if cells.size == 0:
            continue
        for part, begin, held in _portions(first, lengths, portion):
            ends = begin + held
            sample: Indices | slice
            if np.array_equal(begin[1:], ends[:-1]):  # as a rule: a slice copies nothing
                sample = slice(int(begin[0]), int(ends[-1]))
            else:
                sample = np.arange(int(held.sum())) + np.repeat(ends - np.cumsum(held), held)
            edges = flat[cells[part]]
            u = log.time[sample] - _each(edges[:, 0], held)
            u /= _each(edges[:, 1] - edges[:, 0], held)
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
    beginning = line.reshape(n, order)[:, :LINE]
    for held in samples_of(family, logs, portion):
        log, cells, u = logs[held.log], held.cells, held.u
        weight, force = log.weight[held.samples], log.force[held.samples]
        first = np.cumsum(held.lengths) - held.lengths
        r = force - held.of_curve(beginning)
        number[cells] += held.lengths if weight.min() > 0 else np.add.reduceat((weight > 0).astype(float), first)
        pulled = weight * r
        square[cells] += np.add.reduceat(np.multiply(pulled, r, out=r), first)
        weighed = weight.copy()
        for i in range(2 * order - 1):
            powers[cells, i] += np.add.reduceat(weighed, first)
            weighed *= u
            if i < order:
                pull[cells, i] += np.add.reduceat(pulled, first)
                pulled *= u
    hankel = np.arange(order)[:, None] + np.arange(order)[None, :]
    shape = (count, n_cells)
    about_line = Moments(
        powers[:, hankel].reshape(*shape, order, order),
        pull.reshape(*shape, order),
        line,
        square.reshape(shape).sum(axis=1),
        number.reshape(shape).sum(axis=1),
    )
    return about_line.around(reference)


def _each(values: Array, lengths: Indices) -> Array:
    """What belongs to cells (k, *rest), for each of their samples (n, *rest), or for all of one cell (1, *rest)."""
    return values if lengths.size == 1 else np.repeat(values, lengths, axis=0)


def _portions(first: Indices, lengths: Indices, most: int) -> Iterator[tuple[slice, Indices, Indices]]:
    """So many samples at a time of cells (k,): which cells in a row, and where their samples of it begin, and how many
    they are."""
    ends = np.cumsum(lengths)
    begins = ends - lengths
    for start in range(0, int(ends[-1]), most):
        stop = start + most
        part = slice(int(np.searchsorted(ends, start, side="right")), int(np.searchsorted(begins, stop)))
        skipped = np.maximum(start - begins[part], 0)
        yield part, first[part] + skipped, np.minimum(ends[part], stop) - begins[part] - skipped


BLOCKS_AT_ONCE = 1024  # blocks worked on at once: few enough for all their derivatives to stay in cache


@dataclass(frozen=True)
class IndexMaps:
    """Constant index maps of some blocks of one family: which entries of their dense Jacobian (b, n_rows, n_slots) and
    Hessian (b, n_slots, n_slots) count, and where these stand among those of all parts."""

    blocks: slice
    jacobian_entries: Indices
    hessian_entries: Indices
    jacobian: slice
    hessian: slice


@dataclass(frozen=True)
class Scatter:
    """Where a family stands: slots and rows of its blocks, and the index maps part by part."""

    slots: Indices
    rows: Indices
    parts: tuple[IndexMaps, ...]

    @cached_property
    def used(self) -> tuple[int, ...]:
        """The slots that are an unknown in some block."""
        return tuple(np.flatnonzero(np.any(self.slots >= 0, axis=0)).tolist())

    def gradient(self, pull: Array, size: int) -> Array:
        """Derivatives with respect to the slots of all blocks (B, n_slots), by unknowns (size,)."""
        # Those of slots that hold a constant are counted in front of all unknowns (KNOWN is -1), and left out.
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

    def __init__(self, layout: Layout, at_once: int = BLOCKS_AT_ONCE) -> None:
        n, m = layout.size, layout.rows
        self.shape, self.about = (m, n), layout.prior_about
        jacobian, hessian, self.counts = list[Indices](), list[Indices](), (0, 0)
        self.families = [
            Scatter(f.slots, f.rows, tuple(self._parts(f, at_once, jacobian, hessian))) for f in layout.families
        ]
        order, first, places = _in_order(np.concatenate(jacobian))
        self._jacobian_order = order
        # Parameters that are tied meet in one column: their entries are added up.
        self._jacobian_first = None if np.all(first) else np.flatnonzero(first)
        self._jacobian_rows, self._jacobian_columns = (places % m).astype(np.int32), places // m
        self._jacobian_starts = np.searchsorted(self._jacobian_columns, np.arange(n + 1)).astype(np.int32)
        about = layout.prior_about[layout.varied]
        joins = np.maximum(about, layout.varied) * n + np.minimum(about, layout.varied)
        order, first, places = _in_order(np.concatenate([*hessian, (n + 1) * np.arange(n), joins]))
        self._hessian_slot = np.empty(order.size, dtype=np.int64)
        self._hessian_slot[order] = np.cumsum(first) - 1
        self._hessian_rows, self._hessian_columns = (places % n).astype(np.int32), places // n
        self._hessian_starts = np.searchsorted(self._hessian_columns, np.arange(n + 1)).astype(np.int32)

    def _parts(
        self, family: Family, at_once: int, jacobian: list[Indices], hessian: list[Indices]
    ) -> Iterator[IndexMaps]:
        """The index maps of a family; places of its entries in the matrices, column by column, go to the lists."""
        m, n = self.shape
        for begin in range(0, family.slots.shape[0], at_once):
            blocks = slice(begin, begin + at_once)
            slots, rows = family.slots[blocks], family.rows[blocks]
            known = slots >= 0
            entries = np.flatnonzero(np.broadcast_to(known[:, None, :], (*rows.shape, slots.shape[1])))
            jacobian.append((slots[:, None, :] * m + rows[:, :, None]).ravel()[entries])
            # Slots of the end state do not enter the curve, but keeping them keeps one rule for all kinds.
            left, right = slots[:, :, None], slots[:, None, :]
            upper = np.flatnonzero(known[:, :, None] & known[:, None, :] & (left <= right))
            hessian.append((right * n + left).ravel()[upper])
            before, self.counts = self.counts, (self.counts[0] + entries.size, self.counts[1] + upper.size)
            yield IndexMaps(blocks, entries, upper, slice(before[0], self.counts[0]), slice(before[1], self.counts[1]))

    def fits(self, layout: Layout) -> bool:
        """Whether a layout has the same unknowns and rows, block by block."""
        return (
            self.shape == (layout.rows, layout.size)
            and len(self.families) == len(layout.families)
            and np.array_equal(self.about, layout.prior_about)
            and all(
                np.array_equal(mine.slots, family.slots) and np.array_equal(mine.rows, family.rows)
                for mine, family in zip(self.families, layout.families, strict=True)
            )
        )

    def entries(self) -> tuple[Array, Array]:
        """Room for the entries that count, of the Jacobian and of the Hessian, behind which come those of the priors
        (`Layout.prior_hessian`)."""
        return np.empty(self.counts[0]), np.zeros(self._hessian_slot.size)

    def jacobian(self, entries: Array, scale: Array) -> sp.csc_matrix:
        """The scaled Jacobian from the entries that count."""
        flat = entries[self._jacobian_order]
        if self._jacobian_first is not None:
            flat = np.add.reduceat(flat, self._jacobian_first)
        data = flat * scale[self._jacobian_columns]
        return sp.csc_matrix((data, self._jacobian_rows, self._jacobian_starts), self.shape)

    def hessian(self, entries: Array, scale: Array) -> sp.csc_matrix:
        """The scaled Hessian, upper triangle, from the entries that count and those of the priors."""
        bends = np.bincount(self._hessian_slot, weights=entries, minlength=self._hessian_rows.size)
        data = np.asarray(bends * scale[self._hessian_columns] * scale[self._hessian_rows])
        return sp.csc_matrix((data, self._hessian_rows, self._hessian_starts), (scale.size, scale.size))

    @cached_property
    def sparsities(self) -> tuple[ca.Sparsity, ca.Sparsity]:
        """Those of the Jacobian and of the Hessian in CasADi's words."""
        m, n = self.shape
        jacobian = ca.Sparsity(m, n, self._jacobian_starts.tolist(), self._jacobian_rows.tolist())
        return jacobian, ca.Sparsity(n, n, self._hessian_starts.tolist(), self._hessian_rows.tolist())
