"""The multiple-shooting problem as numbers: samples compressed into exact sums, where its nonzeros are, and objective,
rows and their derivatives, ready for any solver. Hessian: Gauss-Newton, exact on request.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi as ca
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from identify.logs.log_data import LogData
from identify.logs.unknowns import Unknowns
from identify.shooting.layout import COARSE_GRID, Family, Grid, Indices, Layout, transcribe
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

# The samples of a log, compressed exactly: what a fit needs of them whatever the curve.
#
# In each cell the model's curve is a polynomial in reference time, so sums of powers of the sample times and of the
# residuals against one curve are all that is needed. The cost of an evaluation does not depend on the sampling rate.

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
        number_of = (np.cumsum(lengths) - lengths) // portion
        for begin in np.flatnonzero(np.diff(number_of, prepend=-1)).tolist():
            part = slice(begin, int(np.searchsorted(number_of, number_of[begin], side="right")))
            counts, ends = lengths[part], first[part] + lengths[part]
            sample: Indices | slice
            if np.array_equal(first[part][1:], ends[:-1]):  # as a rule: a slice copies nothing
                sample = slice(int(first[begin]), int(ends[-1]))
            else:
                sample = np.arange(int(counts.sum())) + np.repeat(ends - np.cumsum(counts), counts)
            edges = flat[cells[part]]
            u = log.time[sample] - np.repeat(edges[:, 0], counts)
            u /= np.repeat(edges[:, 1] - edges[:, 0], counts)
            yield CellSamples(number, cells[part], counts, sample, u)


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
    for chunk in samples_of(family, logs, portion):
        log, cells = logs[chunk.log], chunk.cells
        first = np.cumsum(chunk.lengths) - chunk.lengths
        weight = log.weight[chunk.samples]
        r = log.force[chunk.samples] - chunk.of_curve(line.reshape(n, order)[:, :LINE])
        number[cells] = chunk.lengths if weight.min() > 0 else np.add.reduceat((weight > 0).astype(float), first)
        pulled, weighed = weight * r, weight.copy()
        square[cells] = np.add.reduceat(np.multiply(pulled, r, out=r), first)
        for i in range(2 * order - 1):
            powers[cells, i] = np.add.reduceat(weighed, first)
            weighed *= chunk.u
            if i < order:
                pull[cells, i] = np.add.reduceat(pulled, first)
                pulled *= chunk.u
    hankel = np.arange(order)[:, None] + np.arange(order)[None, :]
    curvature = powers[:, hankel].reshape(count, n_cells, order, order)
    squares, numbers = (column.reshape(count, n_cells).sum(axis=1) for column in (square, number))
    about_line = Moments(curvature, pull.reshape(count, n_cells, order), line, squares, numbers)
    moved = {"pull": -about_line.slope_at(reference), "square": about_line.squares_at(reference)}
    return replace(about_line, reference=reference, **moved)


# Where the nonzeros are: from the dense derivatives of the blocks to sparse matrices. It depends on which unknowns and
# rows each block meets, not on steps, samples or values: problems that differ in nothing else share it.


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
    added (entries,), for several may meet in one column."""

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


# Objective and rows with their derivatives.

BLOCKS_AT_ONCE = 1024  # blocks worked on at once: few enough for all their derivatives to stay in cache


def _chunks(count: int) -> list[slice]:
    return [slice(begin, begin + BLOCKS_AT_ONCE) for begin in range(0, count, BLOCKS_AT_ONCE)]


@dataclass(frozen=True)
class Point:
    """Everything at one point z (scaled unknowns): cost, rows, the curve coefficients of every family, and with
    derivatives (else empty) the gradient (n,), the Jacobian (m, n) sparse and the Gauss-Newton Hessian (n, n) sparse,
    upper triangle."""

    cost: float
    rows: Array
    curves: tuple[Array, ...]
    gradient: Array = field(default_factory=lambda: np.empty(0))
    jacobian: sp.csc_matrix = field(default_factory=lambda: sp.csc_matrix((0, 0)))
    hessian: sp.csc_matrix = field(default_factory=lambda: sp.csc_matrix((0, 0)))


class Problem:
    """min 1/2 sum w (force - curve)^2 + 1/2 sum ((x - mean)/sd)^2  subject to rows(x) = 0.

    Works on scaled unknowns z = x / scale. Holds the last point evaluated.
    """

    def __init__(
        self,
        logs: list[LogData],
        layout: Layout,
        moments: list[Moments] | None = None,
        pattern: Pattern | None = None,
    ) -> None:
        """pattern: of a problem before; taken over where this one has the same unknowns and rows."""
        self.layout = layout
        self.logs = logs
        if moments is None:
            curves = self._curves(layout.start)
            moments = [compressed(f, logs, curve) for f, (_, curve) in zip(layout.families, curves, strict=True)]
        self.moments = moments
        self.pattern = pattern if pattern is not None and pattern.fits(layout) else Pattern(layout)
        self._last: tuple[bytes, bool, Point] | None = None

    def with_all_parameters(self, unknowns: Unknowns, z: Array) -> tuple[Problem, Array]:
        """This problem with every parameter among its unknowns, and its point z (scaled) there.

        Args:
            unknowns: as those of this problem; start holds the values of what is no unknown here, the priors count.
        """
        layout, x = self.layout, z * self.layout.scale
        # Laid out where this problem was, or rests might be cut into other blocks than the samples are compressed in.
        laid_out = replace(unknowns, free=np.ones_like(unknowns.free), start=layout.unknowns.start)
        every = self._transcribed(laid_out, layout.grid)
        theta = unknowns.start.copy()
        theta[layout.free] = x[: layout.free.size]
        out = Problem(self.logs, replace(every, unknowns=unknowns), self.moments)
        return out, np.concatenate([theta, x[layout.free.size :]]) / every.scale

    def with_steps(self, steps: int) -> Problem:
        """The same problem, unknown by unknown and row by row, with so many integration steps in every interval."""
        layout = self.layout
        return Problem(self.logs, self._transcribed(layout.unknowns, replace(layout.grid, steps=steps)))

    def _transcribed(self, unknowns: Unknowns, grid: Grid) -> Layout:
        return transcribe(self.logs, list(self.layout.trajectories), unknowns, grid)

    @property
    def samples(self) -> int:
        """Number of samples that count."""
        return int(sum(m.count.sum() for m in self.moments))

    @cached_property
    def start(self) -> Array:
        """The scaled starting point (n,)."""
        return self.layout.start / self.layout.scale

    def _curves(self, x: Array) -> list[tuple[Array, ...]]:
        """Rows and curves of every family at the unknowns x (n,)."""
        families = self.layout.families
        return [f.block.evaluate(f.slot_values(x), f.constants, derivatives=False) for f in families]

    def fitted(self, z: Array) -> list[Array]:
        """What the load cell sees according to the point z, at every sample of every log (n,) [N]; NaN outside
        the fitted windows."""
        out = [np.full(log.time.size, np.nan) for log in self.logs]
        for family, (_, curve) in zip(self.layout.families, self._curves(z * self.layout.scale), strict=True):
            for chunk in samples_of(family, self.logs):
                out[chunk.log][chunk.samples] = chunk.of_curve(curve.reshape(-1, family.block.order))
        return out

    def block_costs(self, z: Array) -> list[Array]:
        """Per family, the sum of squared weighted residuals of each block (B,)."""
        curves = self.evaluate(z, derivatives=False).curves
        return [moments.squares_at(curve) for moments, curve in zip(self.moments, curves, strict=True)]

    def evaluate(self, z: Array, *, derivatives: bool) -> Point:
        """Cost and rows at z, with derivatives on request; the last point is remembered."""
        key = z.tobytes()
        if self._last is not None and self._last[0] == key and (self._last[1] or not derivatives):
            return self._last[2]
        with np.errstate(all="ignore"):
            point = self._derivatives(z) if derivatives else self._values(z)
        self._last = (key, derivatives, point)
        return point

    def exact_hessian(self, z: Array, on_cost: float, on_rows: Array) -> sp.csc_matrix:
        """Hessian of on_cost * cost + on_rows . rows, upper triangle, in the pattern of the Gauss-Newton one.

        Args:
            on_rows: multipliers (m,).
        """
        point = self.evaluate(z, derivatives=True)
        x, entries = z * self.layout.scale, list[Array]()
        known = zip(self.layout.families, self.moments, self.pattern.families, point.curves, strict=True)
        for family, moments, scatter, curve in known:
            slots, on_curve = family.slot_values(x), on_cost * moments.slope_at(curve)
            second = np.empty((*slots.shape, slots.shape[1]))
            for at in _chunks(slots.shape[0]):
                weights = on_rows[family.rows[at]], on_curve[at].reshape(len(on_curve[at]), -1)
                second[at] = family.block.hessian(slots[at], family.constants[at], *weights)
            entries.append(np.take(second, scatter.hessian))
        summed = self.pattern.hessian.matrix(entries, self.layout.scale, self.layout.scale)
        summed.data += on_cost * point.hessian.data
        return summed

    def _values(self, z: Array) -> Point:
        x, rows = z * self.layout.scale, np.zeros(self.layout.rows)
        cost, made = 0.5 * float(np.sum(self.layout.off_prior(x) ** 2)), self._curves(x)
        for family, moments, (block_rows, curve) in zip(self.layout.families, self.moments, made, strict=True):
            rows[family.rows] = block_rows
            cost += 0.5 * float(np.sum(moments.squares_at(curve)))
        return Point(cost, rows, tuple(curve for _, curve in made))

    def _derivatives(self, z: Array) -> Point:
        layout = self.layout
        x, scale = z * layout.scale, layout.scale
        prior = layout.off_prior(x)
        rows, cost = np.zeros(layout.rows), 0.5 * float(np.sum(prior**2))
        gradient = layout.prior_gradient(prior) * scale
        curves, in_jacobian, in_hessian = list[Array](), list[Array](), list[Array]()
        for family, moments, scatter in zip(layout.families, self.moments, self.pattern.families, strict=True):
            slots, curve, pull = family.slot_values(x), np.empty_like(moments.reference), np.empty(family.slots.shape)
            d_rows, hessian = np.empty((*family.rows.shape, slots.shape[1])), np.empty((*slots.shape, slots.shape[1]))
            for at in _chunks(slots.shape[0]):
                rows[family.rows[at]], curve[at], d_rows[at], d_curve = family.block.evaluate(
                    slots[at], family.constants[at], derivatives=True
                )
                second = np.matmul(moments.curvature[at], d_curve)  # (b, cells, order, n_slots)
                shape = (second.shape[0], -1, second.shape[-1])
                tall = d_curve.reshape(shape).transpose(0, 2, 1)
                pull[at] = np.matmul(tall, moments.slope_at(curve[at], at).reshape(shape[0], -1, 1))[..., 0]
                np.matmul(tall, second.reshape(shape), out=hessian[at])
            in_jacobian.append(np.take(d_rows, scatter.jacobian))
            in_hessian.append(np.take(hessian, scatter.hessian))
            cost += 0.5 * float(np.sum(moments.squares_at(curve)))
            curves.append(curve)
            gradient += scatter.gradient(pull, z.size) * scale
        jacobian = self.pattern.jacobian.matrix(in_jacobian, scale)
        summed = self.pattern.hessian.matrix([*in_hessian, *layout.prior_hessian], scale, scale)
        return Point(cost, rows, tuple(curves), gradient, jacobian, summed)


UNSURE = 0.1  # of a slip: how far off its arrest may be before the first pass is solved


def beside_jumps(log: LogData, trajectory: ShootingTrajectory, share: float) -> LogData:
    """A log without the samples beside its arrests, where the force under the counterface jumps: on which side they are
    is not known before a pass is solved. Within one sample, or this share of a slip."""
    arrests, slips = trajectory.until[trajectory.ending("arrest")], trajectory.slips
    width = max(log.interval, share * float(np.median(slips)) if slips.size else 0.0)
    ends = np.searchsorted(log.time, [arrests - width, arrests + width])
    first, last = (np.bincount(row, minlength=log.time.size + 1)[:-1] for row in ends)
    return replace(log, weight=np.where(np.cumsum(first - last) > 0, 0.0, log.weight))


def shooting_problem(
    logs: list[LogData],
    trajectories: list[ShootingTrajectory],
    unknowns: Unknowns,
    grid: Grid,
    *,
    pattern: Pattern | None = None,
) -> Problem:
    """The multiple-shooting problem of several logs around their trajectories; see `transcribe`, and `Problem` for
    pattern."""
    if unknowns.model.force_sensor == "counterface":
        share = UNSURE if grid is COARSE_GRID else 0.0
        logs = [beside_jumps(log, motion, share) for log, motion in zip(logs, trajectories, strict=True)]
    return Problem(logs, transcribe(logs, trajectories, unknowns, grid), pattern=pattern)
