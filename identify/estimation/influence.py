"""What each cycle and each sample does to the answer: the parameters linearised in the residuals at a solution.

With U the columns of the inverse of the optimality matrix that belong to the parameters, a residual r with weight w and
slope x of its curve moves them by U^T x w r. Sums of squares of these moves are covariances, whatever the noise is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.base.linear import Factors, optimality_matrix
from identify.shooting.layout import Family, Layout, kept_parameters
from identify.shooting.pattern import Moments, samples_of
from identify.shooting.shooting import Problem

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_COLUMNS = 900  # of right sides: beyond, what a cycle says of its own start and load is not taken out of it


@dataclass(frozen=True)
class Influence:
    """At a solution with f parameters, n unknowns and g cycles, in physical units.

    kept (f,): indices of the parameters among the unknowns, shared ones first, then those of single logs; columns
    (n, f); moves (g, f): what the residuals of each cycle did; white (g, f, f): covariance of the moves of pure white
    noise; absorbed (g, f, f): the part of it that the fit takes out of the residuals; prior (f, f): what the errors of
    priors add; log (g,) the log of each cycle; groups: per family of blocks, the cycle of each block (B,), over all
    logs.
    """

    kept: Indices
    columns: Array
    moves: Array
    white: Array
    absorbed: Array
    prior: Array
    log: Indices
    groups: Sequence[Indices]

    @property
    def covariance(self) -> Array:
        """Covariance (f, f) of the parameters for white noise: the sum over all cycles and priors."""
        return np.asarray(self.white.sum(axis=0) + self.prior)


def influence(problem: Problem, z: Array, cycles: list[int], *, absorbed: bool = True) -> Influence:
    """The influence of the data on the parameters at a solution z (n,) scaled.

    Args:
        cycles: of every log; what follows the last slip counts to its last cycle.
        absorbed: False leaves that part at nought, which saves most of the time.
    """
    layout = problem.layout
    point = problem.evaluate(z, derivatives=True)
    assert point.hessian is not None and point.jacobian is not None
    factors = Factors(optimality_matrix(point.hessian, point.jacobian))
    kept = kept_parameters(layout)
    right = np.zeros((layout.size + layout.rows, kept.size))
    right[kept, np.arange(kept.size)] = layout.scale[kept]
    columns = layout.scale[:, None] * factors.solve(right)[: layout.size]
    groups = _groups(layout, cycles)
    count = sum(cycles)
    f = kept.size
    moves, white = np.zeros((count, f)), np.zeros((count, f, f))
    pulled = np.zeros((layout.size, count * f)) if absorbed and count * f <= MOST_COLUMNS else None
    x = z * layout.scale
    for family, moments, group in zip(layout.families, problem.moments, groups, strict=True):
        bend, slope, pull, d_curve = _family(problem, family, moments, x, columns)
        np.add.at(moves, group, -np.einsum("bkf,bk->bf", slope, pull))
        np.add.at(white, group, np.einsum("bkf,bkg->bfg", slope, bend))
        if pulled is not None:
            local = np.einsum("bks,bkf->bsf", d_curve, bend)
            block, slot = np.nonzero(family.slots >= 0)
            column = group[block][:, None] * f + np.arange(f)
            np.add.at(pulled, (family.slots[block, slot][:, None], column), local[block, slot])
    sd = layout.prior_sd
    apart = layout.beside(columns)
    prior = apart.T @ (apart / sd[:, None] ** 2)
    log = np.repeat(np.arange(len(cycles)), cycles)
    covariance = white.sum(axis=0) + prior
    taken = _absorbed(factors, layout, pulled, white, covariance) if absorbed else np.zeros_like(white)
    return Influence(kept, columns, moves, white, taken, prior, log, groups)


def _groups(layout: Layout, cycles: list[int]) -> list[Indices]:
    """Per family, the number of the cycle of each block (B,), over all logs."""
    offsets = np.concatenate([[0], np.cumsum(cycles)])[:-1]
    last = np.array(cycles) - 1
    return [offsets[f.log] + np.minimum(f.cycle, last[f.log]) for f in layout.families]


def _family(
    problem: Problem, family: Family, moments: Moments, x: Array, columns: Array
) -> tuple[Array, Array, Array, Array]:
    """Per block of a family, over its coefficients k: weighted slopes (B, k, f), slopes (B, k, f) of the curve along
    the columns, weighted residuals (B, k), slopes with respect to the slots (B, k, slots)."""
    slots = family.slot_values(x)
    _, curve, _, d_curve = family.block.evaluate(slots, family.constants, derivatives=True)
    along = np.where((family.slots >= 0)[..., None], columns[family.slots], 0.0)  # (B, slots, f)
    count, cells, order, n_slots = d_curve.shape
    tall = d_curve.reshape(count, cells * order, n_slots)
    slope = np.matmul(tall, along)
    bend = np.matmul(moments.curvature, slope.reshape(count, cells, order, -1)).reshape(slope.shape)
    return bend, slope, moments.slope_at(curve).reshape(count, -1), tall


def _absorbed(factors: Factors, layout: Layout, pulled: Array | None, white: Array, covariance: Array) -> Array:
    """What the fit takes out of the residuals of each cycle: all it knows of its own start, load and events."""
    if pulled is None:
        return np.asarray(np.matmul(np.matmul(white, np.linalg.pinv(covariance)), white))
    count, f = white.shape[:2]
    right = np.vstack([layout.scale[:, None] * pulled, np.zeros((layout.rows, pulled.shape[1]))])
    answer = layout.scale[:, None] * factors.solve(right)[: layout.size]
    return np.einsum("ngf,ngh->gfh", pulled.reshape(-1, count, f), answer.reshape(-1, count, f))


def sample_moves(problem: Problem, z: Array, columns: Array) -> list[Array]:
    """Per log, by how much a force higher by 1 N at each sample moves the parameters (n, f); 0 outside the windows."""
    x = z * problem.layout.scale
    out = [np.zeros((log.time.size, columns.shape[1])) for log in problem.logs]
    for family in problem.layout.families:
        slots = family.slot_values(x)
        _, _, _, d_curve = family.block.evaluate(slots, family.constants, derivatives=True)
        along = np.where((family.slots >= 0)[..., None], columns[family.slots], 0.0)
        count, cells, order, n_slots = d_curve.shape
        slope = np.matmul(d_curve.reshape(count, cells * order, n_slots), along).reshape(count * cells, order, -1)
        for held in samples_of(family, problem.logs):
            weight = problem.logs[held.log].weight[held.samples]
            out[held.log][held.samples] = weight[:, None] * held.of_curve(slope)
    return out
