"""How long a resting mass stays at rest: the first time at which the drive overcomes the static limit.

Where the breakaway margin (static limit minus force of the drive) is concave in time, as it is for a steady drive and a
contact that saturates, it has one zero at most; anything else is scanned (`first_zero`).
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
import scipy
from numpy.typing import NDArray

from identify.base.compiled import Mapped, compiled
from identify.base.roots import first_zero
from identify.model.model import Model
from identify.simulation.stepper import Situated, symbols

Array = NDArray[np.float64]

_SHARES = np.geomspace(1e-9, 1.0, 24)  # of the longest rest: where its curvature is looked at


@lru_cache(maxsize=32)
def _functions(model: Model) -> tuple[ca.Function, ca.Function, Mapped, Mapped]:
    """By (x at the start, constants, t): the row (breakaway margin [N], force of the drive [N], state);
    the largest second derivative of the margin at some times; for many at once the margin, and what it is without what
    oscillates."""
    x, c, t, p, u = symbols(model)
    rested = model.rest(x, p, u, t)
    force, limit = model.driving_force(rested, p, u), model.grip(rested, p, u)
    margin = limit - ca.fabs(force)
    row = ca.Function("row", [x, c, t], [ca.cse(ca.densify(ca.vertcat(margin, force, rested)))])
    curvature = ca.Function("curvature", [x, c, t], [ca.densify(ca.jacobian(ca.jacobian(margin, t), t))])
    times = ca.SX.sym("times", _SHARES.size)
    largest = ca.mmax(ca.vertcat(*(curvature(x, c, at) for at in ca.vertsplit(times))))
    calm = limit - ca.fabs(model.calm_force(x, p, u, t))
    many = [Mapped(ca.Function("margins", [x, c, t], [ca.cse(ca.densify(q))])) for q in (margin, calm)]
    return row, ca.Function("curvatures", [x, c, times], [ca.cse(largest)]), *many


class Resting:
    """Rests of one model; holds buffers, so one per thread."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self._x, self._c = np.zeros(len(model.states)), np.zeros(len(model.parameters) + 5)
        self._t, self._at_shares = np.zeros(1), np.zeros(_SHARES.size)
        row, curvatures, self._margins, self._calm = _functions(model)
        self._row, self._curvature = compiled(row), compiled(curvatures)
        self._row.bind([self._x, self._c, self._t])
        self._curvature.bind([self._x, self._c, self._at_shares])

    def until(self, x: Array, situated: Situated, limit: float) -> tuple[float | None, Array, float]:
        """Rest from x (n_x,), its speed zero, for at most `limit` [s].

        Returns:
            when the static limit is overcome [s] (0: at once; None: not before the limit), the state then or at the
            limit (n_x,), the force of the drive there [N].

        Raises:
            SimulationError: too fast a vibration to be looked at.
        """
        margin, force = self.margin(x, situated)
        if margin <= 0.0:
            return 0.0, x, force
        onset = None
        if limit > 0.0:
            np.multiply(_SHARES, limit, out=self._at_shares)
            if self.model.vibrates or self._curvature()[0] > 0.0:
                onset = self._by_scan(limit)
            elif self._at(limit)[0] <= 0.0:  # the only zero of a concave margin, to the last digits
                last = 4.0 * np.finfo(float).eps
                onset = float(scipy.optimize.brentq(lambda t: self._at(t)[0], 0.0, limit, xtol=1e-300, rtol=last))
        row = self._at(limit if onset is None else onset)
        return onset, row[2:].copy(), float(row[1])

    def margin(self, x: Array, situated: Situated) -> tuple[float, float]:
        """By how much a mass at rest in x (n_x,) withstands the drive [N], and the force of the drive [N]."""
        self._x[:] = x
        self._c[:-5], self._c[-5:] = situated.p, situated.numbers
        row = self._at(0.0)
        return float(row[0]), float(row[1])

    def _at(self, t: float) -> Array:
        self._t[0] = t
        return self._row()

    def _by_scan(self, limit: float) -> float | None:
        """The first zero of the margin; looked at finely only where what oscillates may take it to zero."""
        period, force = swing(self.model, self._c[:-5])

        def margin(times: Array) -> Array:
            if times.size == 1:
                return self._at(float(times[0]))[:1]
            return self._at_times(self._margins, times)

        def least(times: Array) -> Array:
            return self._at_times(self._calm, times) - (1.0 + 1e-12) * force  # of the force of what oscillates

        return first_zero(margin, limit, period, least)

    def _at_times(self, function: Mapped, times: Array) -> Array:
        """A margin [N] at times (n,) [s]."""
        return function([*(np.repeat(given[None], times.size, axis=0) for given in (self._x, self._c)), times])[0][:, 0]


def swing(model: Model, p: Array) -> tuple[float, float]:
    """Shortest period [s] of what oscillates in the drive (infinite without), bound of its force on the contact [N]."""
    if not model.vibrates:
        return np.inf, 0.0
    forces, omegas = np.array(model.swings(p)).ravel(), np.array(model.waves(p)).ravel()
    moving = forces > 0.0
    return (2.0 * np.pi / float(np.max(omegas[moving])), float(np.sum(forces))) if moving.any() else (np.inf, 0.0)
