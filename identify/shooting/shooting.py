"""The multiple-shooting problem as numbers: objective, rows and their derivatives, ready for any solver.

The samples are compressed exactly (`pattern.Moments`). Hessian: Gauss-Newton.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from identify.logs.log_data import LogData
from identify.logs.unknowns import Unknowns
from identify.shooting.grid import Grid
from identify.shooting.layout import Layout
from identify.shooting.pattern import Moments, Pattern, compressed, samples_of
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.shooting.transcription import transcribe

Array = NDArray[np.float64]


BLOCKS_AT_ONCE = 1024  # blocks worked on at once: few enough for all their derivatives to stay in cache


def _chunks(count: int) -> list[slice]:
    return [slice(begin, begin + BLOCKS_AT_ONCE) for begin in range(0, count, BLOCKS_AT_ONCE)]


@dataclass(frozen=True)
class Point:
    """Everything at one point z (scaled unknowns): cost, rows, the curve coefficients of every family, and with
    derivatives the gradient (n,), the Jacobian (m, n) sparse and the Gauss-Newton Hessian (n, n) sparse, upper
    triangle."""

    cost: float
    rows: Array
    curves: tuple[Array, ...]
    gradient: Array | None = None
    jacobian: sp.csc_matrix | None = None
    hessian: sp.csc_matrix | None = None


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
        every = self._transcribed(replace(unknowns, free=np.ones_like(unknowns.free)), layout.grid)
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
            for held in samples_of(family, self.logs):
                out[held.log][held.samples] = held.of_curve(curve.reshape(-1, family.block.order))
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
        assert point.hessian is not None
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
    return Problem(logs, transcribe(logs, trajectories, unknowns, grid), pattern=pattern)
