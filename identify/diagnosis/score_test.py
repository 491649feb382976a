"""Score test of what a fit holds: for each quantity that was stated, how strongly the data ask for another value.

Rig values, drive speeds, gains and zeros, parameters that the scene fixes: each is one more column beside the unknowns
of the shooting problem, by a directional difference of its curves and rows. With the unknowns projected out of it, in
one solve of the optimality conditions at the last iterate, the slope of the cost along the column and its information
say where the data would put the quantity (one Gauss-Newton step), by how much the misfit would fall, and which
quantities look alike in these data (Rao's score test; Cox and Hinkley, Theoretical Statistics, 1974, section 9.3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identify.base.linear import Factors, optimality_matrix
from identify.logs.log_data import LogData
from identify.logs.unknowns import AT_BOUND
from identify.shooting.layout import Layout, transcribe
from identify.shooting.passes import Solved
from identify.shooting.shooting import Problem, samples_of

Array = NDArray[np.float64]

Change = Callable[[LogData, Array, float, float], LogData]
"""A log, with the curve fitted to it (n,) [N], as it is with a held quantity moved from one value to another."""

LEFT = 1e-6  # of the information on a column that must be left with the unknowns projected out
ALIKE = 0.98  # correlation of projected columns from which on the data do not tell two quantities apart


@dataclass(frozen=True)
class Column:
    """A held quantity as a column beside the unknowns.

    change: what its move does to a log; None for the mean of the prior of the unknowns `prior`. size: of the difference
    that stands for the derivative, finite where the quantity is not differentiable at its value; of: all logs together,
    single ones, or both; positive: it can only grow; at: where it is; usual: size of an error that is no surprise;
    most: what is farther off is no answer.
    """

    name: str
    change: Change | None
    size: float
    of: Literal["all", "single", "both"] = "all"
    positive: bool = False
    at: float = 0.0
    usual: float = 0.05
    most: float = np.inf
    prior: tuple[int, ...] = ()


@dataclass(frozen=True)
class Score:
    """One held quantity against the data.

    log: index among those of the fit, None for all of them; score: by how much twice the cost falls, to first order,
    where it is set free, over what the autocorrelation of the noise makes of it; step: how far the data would move it;
    error: standard error of the step; shift (f,): of the free parameters with that step, in search units.
    """

    column: Column
    log: int | None
    score: float
    step: float
    error: float
    shift: Array

    @property
    def key(self) -> tuple[str, int | None]:
        """What is scored: quantity and log."""
        return self.column.name, self.log


@dataclass(frozen=True)
class ScoreTable:
    """Scores, highest first, and the information on their columns with the unknowns projected out (s, s)."""

    scores: tuple[Score, ...]
    information: Array

    @property
    def correlation(self) -> Array:
        """Of the projected columns (s, s)."""
        size = np.sqrt(np.diag(self.information))
        return np.asarray(self.information / np.outer(size, size))

    def classes(self, least: float) -> list[list[Score]]:
        """The scores above a least one by class, highest first: what the data do not tell apart from the first of a
        class is in it."""
        out, left = [], [i for i, one in enumerate(self.scores) if one.score > least]
        while left:
            mine = [i for i in left if i == left[0] or abs(self.correlation[left[0], i]) > ALIKE]
            out.append([self.scores[i] for i in mine])
            left = [i for i in left if i not in mine]
        return out


def score_table(solved: Solved, columns: Sequence[Column], inflation: float = 1.0) -> ScoreTable:
    """The score of every column at the last iterate of a solve; none where the optimality conditions are singular.

    Of a column that is tried with several sizes the one of the highest score counts.

    Args:
        inflation: by how much the autocorrelation and the level of the noise widen a variance.
    """
    problem, z = solved.problem, solved.solution.z
    layout, logs, k = problem.layout, len(problem.logs), len(columns)
    slopes, rows = _differences(solved, columns)
    border = np.concatenate([_products(problem, z, slopes) * layout.scale[:, None], rows], axis=1)  # (l, n + m, k)
    gradient, own = np.zeros(logs * k), np.zeros((logs * k, logs * k))
    for number, (log, curve, slope) in enumerate(zip(problem.logs, solved.fitted, slopes, strict=True)):
        weighted = np.where(np.isfinite(curve), log.weight, 0.0)[:, None] * slope
        mine = slice(number * k, (number + 1) * k)
        gradient[mine] = -weighted.T @ np.where(np.isfinite(curve), log.force - curve, 0.0)
        own[mine, mine] = weighted.T @ slope
    _add_priors(layout, z, columns, (border, gradient, own))
    x, near = z * layout.scale, AT_BOUND * layout.scale
    moving = np.flatnonzero((x - layout.lower > near) & (layout.upper - x > near))
    point = problem.evaluate(z, derivatives=True)
    hessian, jacobian = point.hessian[moving][:, moving].tocsc(), point.jacobian[:, moving].tocsc()
    kept = np.concatenate([moving, layout.size + np.arange(layout.rows)])
    border = border[:, kept].transpose(1, 0, 2).reshape(kept.size, logs * k)
    answer = np.full((kept.size, border.shape[1] + 1), np.nan)
    with suppress(RuntimeError):  # SuperLU's only word for a pivot of zero
        newton = np.concatenate([point.gradient[moving], point.rows])
        answer = Factors(optimality_matrix(hessian, jacobian)).solve(np.column_stack([border, newton]))
    if not np.all(np.isfinite(answer)):
        return ScoreTable((), np.empty((0, 0)))
    # What is scored: every column of all logs, and those of single logs; mixed from the columns of each (s, l k).
    of: list[tuple[int, int | None]] = [(c, None) for c in range(k) if columns[c].of != "single"]
    of += [(c, single) for c in range(k) if columns[c].of != "all" and logs > 1 for single in range(logs)]
    mix = np.zeros((len(of), logs * k))
    for i, (c, single) in enumerate(of):
        mix[i, [c + k * one for one in (range(logs) if single is None else (single,))]] = 1.0
    slope_of = mix @ (gradient - border.T @ answer[:, -1])
    left = mix @ (own - border.T @ answer[:, :-1]) @ mix.T
    moves = np.zeros((layout.size, len(of)))
    moves[moving] = -(answer[: moving.size, :-1] @ mix.T)
    moves = (moves * layout.scale[:, None])[: layout.free.size]
    best: dict[tuple[str, int | None], tuple[int, Score]] = {}
    for i in np.flatnonzero(np.diag(left) > LEFT * np.einsum("ij,jk,ik->i", mix, own, mix)).tolist():
        column, log_number = columns[of[i][0]], of[i][1]
        step, error = -float(slope_of[i] / left[i, i]), float(np.sqrt(inflation / left[i, i]))
        value = 0.0 if column.positive and column.at + step < 0.0 else (step / error) ** 2
        score = Score(column, log_number, value, step, error, moves[:, i] * step)
        if score.key not in best or value > best[score.key][1].score:
            best[score.key] = i, score
    ranked = sorted(best.values(), key=lambda pair: -pair[1].score)
    places = [i for i, _ in ranked]
    return ScoreTable(tuple(score for _, score in ranked), left[np.ix_(places, places)])


def _differences(solved: Solved, columns: Sequence[Column]) -> tuple[list[Array], Array]:
    """Per log the slopes of its curve along the columns (n, k), less those of what its sensor is taken to have shown;
    and the slopes of the rows (l, m, k), those of a log being of its own blocks."""
    problem, curves, x = solved.problem, solved.fitted, solved.solution.x
    logs, layout = problem.logs, problem.layout
    at_answer = problem.evaluate(solved.solution.z, derivatives=True).rows
    owner = np.zeros(layout.rows, dtype=np.int64)
    for family in layout.families:
        owner[family.rows] = family.log[:, None]
    slopes = [np.zeros((log.time.size, len(columns))) for log in logs]
    rows = np.zeros((len(logs), layout.rows, len(columns)))
    for c, column in enumerate(columns):
        if column.change is None:
            continue
        to = column.at + column.size
        changed = [column.change(log, curve, column.at, to) for log, curve in zip(logs, curves, strict=True)]
        moved = curves
        if any(new.force is old.force for new, old in zip(changed, logs, strict=True)):  # it moves the motion
            other_layout = transcribe(changed, list(layout.trajectories), layout.unknowns, layout.grid)
            # A rest in which something decays is cut where its curve asks for that, which may be elsewhere.
            cells = [[f.edges.shape for f in each.families] for each in (layout, other_layout)]
            same = (problem.moments, problem.pattern) if cells[0] == cells[1] else ()
            other = Problem(changed, other_layout, *same)
            z = x / other_layout.scale
            difference = other.evaluate(z, derivatives=False).rows - at_answer
            rows[owner, np.arange(layout.rows), c] = difference / column.size
            moved = other.fitted(z)
        for slope, new, old, after, before in zip(slopes, changed, logs, moved, curves, strict=True):
            slope[:, c] = np.where(np.isfinite(before), (after - before - (new.force - old.force)) / column.size, 0.0)
    return slopes, rows


def _products(problem: Problem, z: Array, slopes: Sequence[Array]) -> Array:
    """The weighted products of the slopes of the curve along the unknowns and along the columns, of each log for itself
    (l, n, k)."""
    layout, k = problem.layout, slopes[0].shape[1]
    x, out = z * layout.scale, np.zeros((len(problem.logs), layout.size + 1, k))
    for family in layout.families:
        _, _, _, d_curve = family.block.evaluate(family.slot_values(x), family.constants, derivatives=True)
        count, cells, order, n_slots = d_curve.shape
        pulled = np.zeros((count * cells, order, k))
        for held in samples_of(family, problem.logs):
            weighed = problem.logs[held.log].weight[held.samples][:, None] * slopes[held.log][held.samples]
            first = np.cumsum(held.lengths) - held.lengths
            for i in range(order):
                pulled[held.cells, i] += np.add.reduceat(weighed, first)
                weighed *= held.u[:, None]
        tall = d_curve.reshape(count, cells * order, n_slots).transpose(0, 2, 1)
        local = np.matmul(tall, pulled.reshape(count, cells * order, k))
        np.add.at(out, (family.log[:, None], family.slots), local)  # KNOWN is -1: the last place, which is left out
    return out[:, :-1]


def _add_priors(layout: Layout, z: Array, columns: Sequence[Column], sums: tuple[Array, Array, Array]) -> None:
    """Add to border (l, n + m, k), gradient (l k,) and own (l k, l k) what the means of priors do, as of log 0."""
    border, gradient, own = sums
    off = layout.off_prior(z * layout.scale)
    for c, column in enumerate(columns):
        for unknown in column.prior:
            sd = layout.prior_sd[unknown]
            border[0, unknown, c] -= layout.scale[unknown] / sd**2
            gradient[c] -= off[unknown] / sd
            own[c, c] += 1.0 / sd**2
