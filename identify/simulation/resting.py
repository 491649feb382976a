"""How long a resting mass stays at rest: the first time at which the drive overcomes the static limit.

Where the breakaway margin (static limit minus force of the drive) is concave in time, as it is for a steady drive and a
contact that saturates, Newton's method from the far end meets the only zero; anything else is scanned (`first_zero`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import compiled
from identify.base.roots import Course, first_zero
from identify.model.model import Model
from identify.simulation.stepper import Situated, symbols

Array = NDArray[np.float64]

_BENDS = np.geomspace(1e-9, 1.0, 24)  # of the longest rest: where the bend is looked at
_EARLY = np.concatenate([[0.0], np.geomspace(1e-16, 1.0, 193)])  # of the longest rest: where a start is looked at
LANES = 8  # times of one call
NEWTON_STEPS = 60
MARGIN, SLOPE, DRIVE, RESTED = 0, 1, 2, 3  # places in a row
APART = 4.0  # motions of the drive whose frequencies are closer than that are looked at together
SAFETY = 1e-12  # of the force of what is left out of a bound


@lru_cache(maxsize=32)
def _functions(model: Model) -> tuple[ca.Function, ca.Function, ca.Function, ca.Function]:
    """By (x at the start, constants, t): the row (breakaway margin [N], its slope, force of the drive [N], state)
    and the largest second derivative of the margin; for many times the margin, and that under shares (n_w,) of what
    oscillates, LANES times in a call."""
    x, c, t, p, u = symbols(model)
    rested = model.rest(x, p, u, t)
    force = model.driving_force(rested, p, u)
    margin = model.grip(rested, p, u) - ca.fabs(force)
    slope = ca.jacobian(margin, t)
    row = ca.Function("row", [x, c, t], [ca.cse(ca.densify(ca.vertcat(margin, slope, force, rested)))])
    shares = ca.SX.sym("shares", model.waves.numel_out(0))
    partly = model.grip(rested, p, u) - ca.fabs(model.pulled(x, p, u, t, shares))
    bend = ca.Function("bend", [x, c, t], [ca.densify(ca.jacobian(slope, t))])
    times = ca.SX.sym("times", _BENDS.size)
    largest = ca.mmax(ca.vertcat(*(bend(x, c, at) for at in ca.vertsplit(times))))
    bends = ca.Function("bends", [x, c, times], [ca.cse(largest)])
    many = ca.Function("margin", [x, c, t], [ca.cse(ca.densify(margin))])
    some = ca.Function("partly", [x, c, t, shares], [ca.cse(ca.densify(partly))])
    return (
        row,
        bends,
        many.map(LANES, [True, True, False], [False]),
        some.map(LANES, [True, True, False, True], [False]),
    )


class Resting:
    """Rests of one model; holds buffers, so one at a time uses it: see `borrowed`."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self._x, self._c = np.zeros(len(model.states)), np.zeros(len(model.parameters) + 5)
        self._t, self._bends = np.zeros(1), np.zeros(_BENDS.size)
        self._times, self._shares = np.zeros(LANES), np.zeros(model.waves.numel_out(0))
        self._row, self._bend, self._margins, self._partly = (compiled(f) for f in _functions(model))
        self._row.bind([self._x, self._c, self._t])
        self._bend.bind([self._x, self._c, self._bends])
        self._margins.bind([self._x, self._c, self._times])
        self._partly.bind([self._x, self._c, self._times, self._shares])
        self._oscillates = model.vibrates

    def until(
        self, x: Array, situated: Situated, limit: float, *, through_zero: bool = False
    ) -> tuple[float | None, Array, float]:
        """Rest from x (n_x,), its speed zero, for at most `limit` [s].

        Args:
            through_zero: where the drive moves the mass at once, take the negative time at which it would begin to if
                the margin is concave, so that the onset stays a smooth function of the start.

        Returns:
            when the static limit is overcome [s] (0: at once; None: not before the limit), the state then or at the
            limit (n_x,), the force of the drive there [N].

        Raises:
            SimulationError: too fast a vibration to be looked at.
        """
        margin, force = self.margin(x, situated)
        early = margin <= 0.0
        if early and not (through_zero and self._concave(limit)):
            return 0.0, x, force
        onset = None
        if limit > 0.0:
            concave = early or self._concave(limit)
            onset = self._by_newton(limit, -np.inf if early else 0.0) if concave else self._by_scan(0.0, limit)
        return onset, *self._ended(limit if onset is None else onset)

    def from_balance(
        self, x: Array, situated: Situated, limit: float, least: float
    ) -> tuple[float | None, Array, float]:
        """The same from a start that may have no margin: the first margin of more than `least` [N] says whether
        the mass rests."""
        self.margin(x, situated)
        times, onset = _EARLY * limit, None
        margins = self._margins_at(times, None)
        counts = np.flatnonzero(np.abs(margins) > least)
        if counts.size and limit > 0.0:
            first = int(counts[0])
            if margins[first] < 0.0:
                onset = float(times[max(first - 1, 0)])
            elif times[first] < limit:
                onset = self._by_scan(float(times[first]), limit)
        return onset, *self._ended(limit if onset is None else onset)

    def _ended(self, t: float) -> tuple[Array, float]:
        """The state (n_x,) and the force of the drive [N] at the end of a rest."""
        row = self._at(t)
        return row[RESTED:].copy(), float(row[DRIVE])

    def margin(self, x: Array, situated: Situated) -> tuple[float, float]:
        """By how much a mass at rest in x (n_x,) withstands the drive [N], and the force of the drive [N]."""
        self._x[:] = x
        self._c[:-5], self._c[-5:] = situated.p, situated.numbers
        row = self._at(0.0)
        return float(row[MARGIN]), float(row[DRIVE])

    def _at(self, t: float) -> Array:
        self._t[0] = t
        return self._row()

    def _concave(self, limit: float) -> bool:
        """Whether the breakaway margin bends downwards throughout."""
        if self._oscillates:
            return False
        np.multiply(_BENDS, limit, out=self._bends)
        return bool(self._bend()[0] <= 0.0)

    def _by_newton(self, limit: float, earliest: float) -> float | None:
        """The only zero of a concave function that is positive at the earliest time, from the right."""
        t, last = limit, np.inf
        for _ in range(NEWTON_STEPS):
            row = self._at(t)
            value, slope = float(row[MARGIN]), float(row[SLOPE])
            if t == limit and value > 0.0:
                return None
            step = value / slope if slope < 0.0 else 0.0
            # Beyond the last digits the steps no longer shrink, or change sign.
            if step <= 1e-15 * abs(t) or (step >= last and step <= 1e-12 * limit):
                return max(t - max(step, 0.0), earliest)
            t, last = max(t - step, earliest), step
        return t

    def _by_scan(self, since: float, limit: float) -> float | None:
        p, at = self._c[:-5], self._margins_at
        below = [
            Course(lambda t, b=b: at(since + t, b.shares) - b.less, b.period)  # type: ignore[misc]
            for b in bounds(self.model, p)
        ]
        whole = Course(lambda t: at(since + t, None), swing(self.model, p)[0])
        found = first_zero(whole, limit - since, below)
        return None if found is None else since + found

    def _margins_at(self, times: Array, shares: Array | None) -> Array:
        """Breakaway margin [N] at times (n,) [s], under shares (n_w,) of what oscillates (None: all of it)."""
        if shares is not None:
            self._shares[:] = shares
        call, out = self._margins if shares is None else self._partly, np.empty(-(-times.size // LANES) * LANES)
        padded = np.append(times, np.full(out.size - times.size, times[-1]))
        for first in range(0, out.size, LANES):
            self._times[:] = padded[first : first + LANES]
            out[first : first + LANES] = call()
        return out[: times.size]


_IDLE: dict[Model, list[Resting]] = {}


def borrowed(model: Model) -> Resting:
    """Rests nobody uses: some that were given back, or new ones."""
    idle = _IDLE.get(model)
    return idle.pop() if idle else Resting(model)


def give_back(rests: Resting) -> None:
    """Let others use them."""
    _IDLE.setdefault(rests.model, []).append(rests)


@dataclass(frozen=True)
class Bound:
    """The margin under shares (n_w,) of what oscillates, less the forces [N] of the rest of it; its period [s]."""

    shares: Array
    less: float
    period: float


def bounds(model: Model, p: Array) -> list[Bound]:
    """Bounds of the breakaway margin from below: without what oscillates, then with more and more of it, slow first."""
    if not model.vibrates:
        return []
    forces, omegas = np.array(model.swings(p)).ravel(), np.array(model.waves(p)).ravel()
    order = [i for i in np.argsort(omegas).tolist() if forces[i] > 0.0]
    out, shares, period = [], np.zeros(forces.size), np.inf
    for before, i in zip([None, *order], order, strict=False):
        if before is None or omegas[i] > APART * omegas[before]:
            less = (1.0 + SAFETY) * float(np.sum(forces[shares == 0.0]))
            out.append(Bound(shares.copy(), less, period))
        shares[i], period = 1.0, 2.0 * np.pi / float(omegas[i])
    return out


def swing(model: Model, p: Array) -> tuple[float, float]:
    """Shortest period [s] of what oscillates in the drive (infinite without), bound of its force on the contact [N]."""
    if not model.vibrates:
        return np.inf, 0.0
    forces, omegas = np.array(model.swings(p)).ravel(), np.array(model.waves(p)).ravel()
    moving = forces > 0.0
    return (2.0 * np.pi / float(np.max(omegas[moving])), float(np.sum(forces))) if moving.any() else (np.inf, 0.0)
