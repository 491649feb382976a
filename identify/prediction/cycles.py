"""Many cycles at once: stick and slip of rows of settings, by the steps that one cycle alone is integrated with.

A row is a setting w (n_w,) = parameters, normal force [N], drive speed [m/s], with a rest state y (n_y,). Every row has
a step length of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import Mapped
from identify.base.errors import SimulationError
from identify.effects import ALL
from identify.model.model import ELONGATION, SPEED, Model, assemble
from identify.simulation.phases import FIRST, FLOOR, ROUNDING, rest_row, sticks
from identify.simulation.sliding import growth_rates
from identify.simulation.stepper import (
    DIPS,
    GUARDS,
    MODES,
    N_GUARDS,
    SHORTEST,
    BurstState,
    Stop,
    burst,
    event_functions,
    rate,
    sliding_modes,
)
from identify.simulation.steppers import HIGH

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Rows = NDArray[np.intp]

ACCURACY = 1e-6  # relative tolerance of a step: a hundredth of it, and less, is left in durations and drops
BURSTS = 200  # of trials in one slip at most; it takes two as a rule
RENEWED = 0.01  # of the saturation: of a contact that is almost renewed
ALMOST = 1.0 - 1e-6  # of the elongation at which a contact breaks loose
FREED = 1e-13  # of normal force / stiffness: frees a mass that only the rounding of the forces holds
PLAIN = (3, 1, 2, 4, 8, 16)  # cycles before each search for the orbit by Newton's method
DRIFTING = 10  # cycles at the end of these: a motion that still drifts one way lingers, as just beyond an end
CLOSED = 1e-6  # of the closure of a cycle, in units of normal force / stiffness
RESOLVED = 1e-2  # share of the jump to which a cycle has to close: jumps that fade away look closed before they are
FARTHEST = 0.3  # of one step towards closure, in the same units
STEP = 1e-3  # of the jump, both in typical ones: differences of the return map
ROUGHLY, CLOSELY = 0.3, 0.08  # natural times sqrt(m/k): longest steps where a slip is looked at between its nodes
SLIDES_AFTER = 12.0  # half periods sqrt(m/k) pi without coming to rest: the mass slides
CREEP = 1e-6  # of a half period: a slip this short is no slip, the contact creeps along with the drive
GROWN = 25.0  # e-foldings after which a disturbance of steady sliding is taken to have come to rest
LONGEST_PATIENCE = 100.0  # half periods

QUANTITIES = {
    "drop": "N",
    "period": "s",
    "stick_duration": "s",
    "slip_duration": "s",
    "slip_distance": "m",
    "peak_speed": "m/s",
    "onset_force": "N",
    "arrest_force": "N",
    "peak_to_valley": "N",
}  # what is reported of an orbit, and its unit


# Which models repeat themselves: only they have a cycle, a steady sliding and a critical speed to be asked for.


def check_calculable(model: Model) -> None:
    """Refuse a model of which no cycle is like the one before.

    Raises:
        SimulationError: the effects that are to blame, and what to do.
    """
    if not model.inertial:
        raise SimulationError(
            "the effect inertia is off: stability and amplitude of stick-slip are those of a moving mass; "
            "add inertia to effects and give the mass under [rig]"
        )
    if not (model.clocked or model.jumps):
        return
    own = [e for e in ALL if e.name in model.effects]
    alone = [assemble(tuple(dict.fromkeys(("inertia", *e.needs, e.name)))) for e in own]
    names = [e.name for e, part in zip(own, alone, strict=True) if part.clocked or part.jumps] or list(model.effects)
    raise SimulationError(
        f"with the effect{'s' * (len(names) > 1)} {' and '.join(names)} no cycle is like the one before; leave out for "
        f"stability, amplitude and plans what changes with time or from stick to stick "
        f"({' '.join(f'--without {name}' for name in names)}, or in the scene), or look at a simulation"
    )


# Where cycles may begin, and how long a slip may last.


def bounds_at_rest(model: Model) -> Array:
    """Lowest and highest value of each state at rest, shape (2, n_y)."""
    ends = [(-np.inf if s.lower is None else s.lower, np.inf if s.upper is None else s.upper) for s in model.states]
    return np.delete(np.array(ends), SPEED, 0).T


def slide_limits(model: Model, settings: Array, growth: Array) -> Array:
    """Durations (n,) [s] at settings (n, n_w) after which a mass that has not come to rest is taken to slide on.

    SLIDES_AFTER half natural periods of the mass on rig and series element together (softened by the root of the whole
    compliance over that of the rig); longer where a disturbance of steady sliding grows (`growth` (n,) [1/s]) but
    slowly, and under heavy damping, where the mass creeps to rest.
    """
    p, one = settings[:, :-2].T, np.ones(len(settings))
    mass, stiffness = (p[model.parameter_names.index(name)] for name in ("mass", "stiffness"))

    def pull(x: Array, speed: float = 0.0) -> Array:
        return np.asarray(model.driving_force(x, p, np.stack([speed * one, one, one, 0.0 * one]))).ravel()

    still = np.stack([0.0 * one, one, one, 0.0 * one])
    low, high = (np.array(model.at_force(force * one[None], p, still)) for force in (0.0, 1.0))
    softened = np.sqrt((high - low)[ELONGATION] * stiffness / (pull(high) - pull(low)))
    half = np.pi * np.sqrt(mass / stiffness) * softened
    x = np.zeros((len(model.states), one.size))
    zeta = (pull(x, 1.0) - pull(x)) / (2.0 * np.sqrt(mass * stiffness))
    with np.errstate(all="ignore"):
        waits = np.where(growth > 0.0, np.clip(GROWN / (growth * half), SLIDES_AFTER, LONGEST_PATIENCE), SLIDES_AFTER)
    return np.asarray(waits * half * np.where(zeta > 1.0, 1.0 + zeta, 1.0))


# Rows of cycles.


@lru_cache(maxsize=16)
def _events(model: Model) -> list[Mapped]:
    """Event functions by mode."""
    return [Mapped(event_functions(model, mode)) for mode in MODES[: len(sliding_modes(model.clamped is not None))]]


@lru_cache(maxsize=16)
def _resting_load(model: Model) -> Mapped:
    """By (x at the start of a rest, setting, t): force that the load cell sees [N] after it, and its rate."""
    x, w, t = (ca.SX.sym(name, n) for name, n in (("x", len(model.states)), ("w", len(model.parameters) + 2), ("t", 1)))
    p, u = w[:-2], ca.vertcat(w[-1], w[-2], 1, 0)
    load = model.load_cell(model.rest(x, p, u, t), p, u)
    row = ca.vertcat(load, ca.jacobian(load, t))
    return Mapped(ca.Function("resting_load", [x, w, t], [ca.cse(ca.densify(row))]))


@lru_cache(maxsize=16)
def _shown(model: Model) -> list[Mapped]:
    """By sliding mode, of (x, constants): force that the load cell sees [N], its rate, the acceleration [m/s^2]."""
    out = []
    for mode in MODES[: len(sliding_modes(model.clamped is not None))]:
        x, c = ca.SX.sym("x", len(model.states)), ca.SX.sym("c", len(model.parameters) + 5)
        moving = rate(model, mode)(x, c, 0)
        load = model.sliding_cell(x, c[:-5], ca.vertcat(c[-5], c[-3], c[-4], 0))
        row = ca.vertcat(load, ca.jtimes(load, x, moving), moving[SPEED])
        out.append(Mapped(ca.Function("shown", [x, c], [ca.densify(row)])))
    return out


@dataclass(frozen=True)
class Node:
    """Where the slips of all rows stand after one more trial: states (n, n_x), times (n,) [s] since the onset, and
    places in `MODES` (n,) and directions (n,) of that trial."""

    x: Array
    t: Array
    mode: Array
    direction: Array


@dataclass(frozen=True)
class CycleRows:
    """One stick and slip per row, SI: states (n, n_x) at rest before it, at the onset of slip and after it; durations
    (n,); whether the mass came to rest (n,), and which rows could not be integrated (n,); nodes of the slips where they
    were kept."""

    start: Array
    onset: Array
    end: Array
    stick: Array
    slip: Array
    rests: Bools
    refused: Bools
    nodes: tuple[Node, ...] = ()

    @property
    def y(self) -> Array:
        """Rest states (n, n_y) after the cycles."""
        return np.delete(self.end, SPEED, 1)

    @property
    def jump(self) -> Array:
        """How far (n,) the spring relaxes in the slips [m]."""
        return np.abs(self.onset - self.end)[:, ELONGATION]


@dataclass(frozen=True)
class Motions:
    """What becomes of motions: which go on sticking (n,), which of them settle on an orbit (n,), rest states they came
    to last (n, n_y); which could not be integrated (n,)."""

    sticks: Bools
    periodic: Bools
    y: Array
    refused: Bools

    def update(self, rows: Rows | Bools, other: Motions) -> None:
        """Put those of some rows in place of what was known of them."""
        for name in ("sticks", "periodic", "y", "refused"):
            getattr(self, name)[rows] = getattr(other, name)


@dataclass(frozen=True)
class CycleBatch:
    """Rows of settings (n, n_w) of one model, each with a drive speed above zero."""

    model: Model
    settings: Array

    def take(self, rows: Rows | Bools) -> CycleBatch:
        """Some of the rows."""
        part = CycleBatch(self.model, self.settings[rows])
        part.__dict__["limit"], part.__dict__["growth"] = self.limit[rows], self.growth[rows]
        return part

    @cached_property
    def time(self) -> Array:
        """Natural times sqrt(m/k) (n,) [s]."""
        return np.sqrt(self._column("mass") / self._column("stiffness"))

    @cached_property
    def scale(self) -> Array:
        """Typical rest states (n, n_y)."""
        load, one = self.settings[:, -2], np.ones(len(self.settings))
        sizes = {"m": load / self._column("stiffness"), "N": load}
        return np.stack([sizes.get(s.unit, one) for i, s in enumerate(self.model.states) if i != SPEED], axis=1)

    @cached_property
    def growth(self) -> Array:
        """Growth rates (n,) [1/s] of disturbances of steady sliding."""
        return growth_rates(self.model, self.settings) if len(self.settings) else np.zeros(0)

    @cached_property
    def limit(self) -> Array:
        """Durations (n,) [s] after which a mass that has not come to rest is taken to slide on."""
        return slide_limits(self.model, self.settings, self.growth) if len(self.settings) else np.zeros(0)

    def _column(self, name: str) -> Array:
        return self.settings[:, self.model.parameter_names.index(name)]

    @property
    def _inputs(self) -> Array:
        one = np.ones(len(self.settings))
        return np.stack([self.settings[:, -1], self.settings[:, -2], one, 0.0 * one], axis=1)

    def _at_rest(self, x: Array) -> Array:
        """Rows of `rest_row` of masses that have just come to rest in x (n, n_x)."""
        return rest_row(self.model)([x, self.settings[:, :-2], self._inputs, np.zeros(len(x))])[0]

    def rested(self) -> Array:
        """Rest states (n, n_y) with the spring unloaded and every state saturated: the strongest first kick."""
        saturated = [s.start if s.upper is None else s.upper for s in self.model.states[2:]]
        return np.tile([0.0, *saturated], (len(self.settings), 1))

    def renewed(self) -> Array:
        """Rest states (n, n_y) of contacts that are almost renewed, the spring about to break them loose; rested ones
        where nothing ages."""
        x = np.insert(self.rested(), SPEED, 0.0, axis=1)
        if self.model.clamped is not None and len(x):
            x[:, self.model.clamped] = RENEWED
            slack = self._at_rest(x)
            x[:, ELONGATION] = self.scale[:, ELONGATION]
            stretched = self._at_rest(x)
            x[:, ELONGATION] *= ALMOST * slack[:, 0] / (stretched - slack)[:, 2]
        return np.delete(x, SPEED, 1)

    # One cycle.

    def run(self, y: Array, longest: float | Array = np.inf) -> CycleRows:
        """The cycles that start at rest in y (n, n_y); nodes are kept where steps have a longest, (n,) or one
        for all [natural times]."""
        start = np.insert(np.clip(y, *bounds_at_rest(self.model)), SPEED, 0.0, axis=1)
        stick, onset, force = sticks(self.model, start, self.settings[:, :-2], self._inputs)
        end, slip, rests, refused, kept = self._slip(onset, force, longest)
        rests &= slip >= CREEP * np.pi * self.time
        return CycleRows(start, onset, end, stick, slip, rests, refused, kept)

    def _slip(
        self, x: Array, force: Array, longest: float | Array
    ) -> tuple[Array, Array, Bools, Bools, tuple[Node, ...]]:
        """Slips from states x (n, n_x) under forces [N]: their ends, durations, which rest, refused ones, nodes."""
        n, n_x = x.shape
        at, events, clamped = BurstState(n_x), _events(self.model), self.model.clamped
        lowest = 0.0 if clamped is None else self.model.states[clamped].lower or 0.0
        leaves = np.array(
            [[guard in exits for guard in GUARDS] for exits in sliding_modes(clamped is not None).values()]
        )
        floor = FLOOR * np.insert(self.scale, SPEED, self.settings[:, -2] * self.time / self._column("mass"), axis=1)
        floor[:, SPEED] *= min(ROUNDING / ACCURACY, 1.0)
        tolerances = ACCURACY * np.insert(floor, 0, 1.0, axis=1)
        ones = np.ones(n)
        keep = bool(np.all(np.isfinite(longest)))
        bounds = np.stack([self.limit, longest * self.time, SHORTEST * self.time, ones, np.inf * ones], axis=1)
        situated = np.stack([self.settings[:, -1], ones, self.settings[:, -2], 0 * ones, 0 * ones], axis=1)
        constants = np.concatenate([self.settings[:, :-2], situated], axis=1)
        z, before, modes = np.zeros((n, at.size)), np.zeros(n), np.zeros(n, dtype=int)
        rests, refused, nodes = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool), list[Node]()

        def begin(rows: Rows, h: Array) -> None:
            """Let rows slide on from where they are in their modes, with first steps h (k,) [s]."""
            before[rows] += z[rows, at.t]
            bounds[rows, 0] = np.maximum(self.limit[rows] - before[rows], SHORTEST * self.time[rows])
            x = z[rows, :n_x]
            z[rows] = 0.0
            z[rows, :n_x], z[rows, at.h], z[rows, at.control.stop - 1] = x, h, DIPS
            z[rows, at.which] = 2 * modes[rows]
            for mode, function in enumerate(events):
                mine = rows[modes[rows] == mode]
                if mine.size:
                    z[mine, at.ends] = function([z[mine, :n_x], constants[mine], np.zeros(mine.size)])[0]

        def note() -> None:
            if keep:
                nodes.append(Node(z[:, :n_x].copy(), before + z[:, at.t], modes.copy(), constants[:, -4].copy()))

        active = np.arange(n)
        z[:, :n_x], constants[:, -4] = x, np.where(force < 0.0, -1.0, 1.0)
        begin(active, FIRST * self.time)
        held = active[z[:, at.ends.start + N_GUARDS] < 0.0]  # the speed falls: a last digit holds the mass back
        if held.size:
            z[held, ELONGATION] += constants[held, -4] * FREED * self.scale[held, ELONGATION]
            begin(held, FIRST * self.time[held])
        note()
        for _ in range(BURSTS):
            taken = burst(self.model, HIGH)([each[active] for each in (z, bounds, constants, tolerances)])[0]
            taken = taken.reshape(active.size, HIGH.trials, -1)
            for trial in range(0 if keep else HIGH.trials - 1, HIGH.trials):
                z[active] = taken[:, trial]
                note()
            why = z[active, at.stop]
            refused[active[why == Stop.STUCK]] = True
            # What is met at the very beginning of a step is met there.
            located, active = active[(why == Stop.LOCATED) | (why == Stop.EVENT)], active[why == Stop.NOT_YET]
            ends = z[located, at.ends]
            with np.errstate(all="ignore"):
                away = np.abs(ends[:, :N_GUARDS] / ends[:, N_GUARDS:])
            met = np.argmin(np.where(leaves[modes[located]] & np.isfinite(away), away, np.inf), axis=1)
            stopped, other = located[met == 0], located[met != 0]
            if other.size and clamped is not None:
                z[other[modes[other] == 0], clamped] = lowest
                modes[other] = 1 - modes[other]
                begin(other, np.maximum(z[other, at.control.start + 2], FIRST * self.time[other]))
            if stopped.size:
                z[stopped, SPEED] = 0.0
                row = self.take(stopped)._at_rest(z[stopped, :n_x])
                rests[stopped] = row[:, 0] > 0.0
                turned = stopped[~rests[stopped]]
                modes[turned] = 0
                constants[turned, -4] = np.where(row[~(row[:, 0] > 0.0), 2] < 0.0, -1.0, 1.0)
                begin(turned, FIRST * self.time[turned])
                other = np.append(other, turned)
            active = np.append(active, other)
            if not active.size:
                break
        refused[active] = True
        return z[:, :n_x], before + z[:, at.t], rests, refused, tuple(nodes)

    def settle(self, y: Array) -> Motions:
        """What the motions from rest states y (n, n_y) settle on: plain cycles, and Newton's method now and then.

        A motion that settles on nothing and still drifts one way at the end slides.
        """
        n = len(y)
        none = np.zeros(n, dtype=bool)
        motions = Motions(~none, none, y.copy(), none.copy())
        left, drift, lasted, jump = np.arange(n), np.zeros(n), np.zeros(n, dtype=int), np.ones(n)
        for plain in PLAIN:
            for _ in range(plain):
                if not left.size:
                    return motions
                cycles = self.take(left).run(motions.y[left])
                motions.refused[left] = cycles.refused
                motions.sticks[left] = cycles.rests
                jump[left] = cycles.jump / self.scale[left, ELONGATION]
                left, y = left[cycles.rests], cycles.y[cycles.rests]
                now = np.sign(y[:, ELONGATION] - motions.y[left, ELONGATION])
                lasted[left] = np.where(now == drift[left], lasted[left] + 1, 0)
                motions.y[left], drift[left] = y, now
            if left.size:
                motions.y[left], motions.periodic[left] = self.take(left)._newton(motions.y[left], jump[left])
                left = left[~motions.periodic[left]]
        motions.sticks[left[lasted[left] >= DRIFTING]] = False
        return motions

    def _newton(self, y: Array, jump: Array) -> tuple[Array, Bools]:
        """Rest states (n, n_y) nearer to a stable orbit than y, and whether it is reached (n,)."""
        n, n_y = y.shape
        probes = np.repeat(y[None], n_y + 1, axis=0)
        upper = bounds_at_rest(self.model)[1]
        for i in range(n_y):
            step = STEP * jump * self.scale[:, i]
            probes[i + 1, :, i] += np.where(y[:, i] + step > upper[i], -step, step)
        whole = self.take(np.tile(np.arange(n), n_y + 1)).run(probes.reshape(-1, n_y))
        after, rests = whole.y.reshape(n_y + 1, n, n_y), whole.rests.reshape(n_y + 1, n).all(axis=0)
        moved = np.stack([probes[i + 1, :, i] - y[:, i] for i in range(n_y)], axis=1)
        jacobian = np.moveaxis(after[1:] - after[0], 0, 2) / moved[:, None, :]
        jacobian *= self.scale[:, None, :] / self.scale[:, :, None]
        jacobian[~rests] = 0.0
        stable = rests & np.all(np.abs(np.linalg.eigvals(jacobian)) < 1.0, axis=1)  # the multipliers of the orbit
        residual = (after[0] - y) / self.scale
        safe = np.where(stable[:, None, None], np.eye(n_y) - jacobian, np.eye(n_y))
        move = np.linalg.solve(safe, residual[..., None])[..., 0]
        size = np.max(np.abs(move), axis=1, initial=0.0)
        move *= np.minimum(1.0, FARTHEST / np.maximum(size, 1e-300))[:, None]
        tried = self.run(y + move * self.scale)
        closure = np.max(np.abs((tried.y - y) / self.scale - move), axis=1)
        resolved = RESOLVED * tried.jump / self.scale[:, ELONGATION]
        better = stable & tried.rests & (closure < 0.5 * np.max(np.abs(residual), axis=1) + resolved)
        closed = better & (closure < np.minimum(CLOSED, resolved))
        first = whole.rests[:n]
        plain = np.where(first[:, None], after[0], y)
        return np.where(better[:, None], tried.y, plain), closed

    # What is seen of them: between the nodes of a slip the force is a cubic.

    def figures(self, y: Array, longest: float | Array = ROUGHLY) -> Array:
        """QUANTITIES (n, 9) of the cycles from y (n, n_y), NaN where the mass does not rest."""
        if not len(y):
            return np.empty((0, len(QUANTITIES)))
        cycles = self.run(y, longest)
        zero = np.zeros(len(self.settings))
        onset, arrest = (
            _resting_load(self.model)([x, self.settings, zero])[0][:, 0] for x in (cycles.onset, cycles.end)
        )
        _, h, first, last = self._steps(cycles)
        high, low = _extremes(first[..., 0], last[..., 0], h * first[..., 1], h * last[..., 1])
        fast, _ = _extremes(first[..., 3], last[..., 3], h * first[..., 2], h * last[..., 2])
        highest = np.maximum(onset, np.max(np.where(h > 0.0, high, -np.inf), axis=0))
        lowest = np.minimum(arrest, np.min(np.where(h > 0.0, low, np.inf), axis=0))
        distance = self.settings[:, -1] * cycles.slip - (cycles.end - cycles.onset)[:, ELONGATION]
        durations = [cycles.stick + cycles.slip, cycles.stick, cycles.slip]
        jump = [onset - arrest, *durations, distance, np.max(fast, axis=0), onset, arrest, highest - lowest]
        return np.where(cycles.rests, jump, np.nan).T

    def forces(self, cycles: CycleRows, stick: Array, slip: Array) -> tuple[Array, Array]:
        """What the load cell sees [N], and its rate [N/s], (n, q + r) each: at times (n, q) [s] after the beginning of
        the stick, and (n, r) after that of the slip, whose last step goes on after its end."""
        rests = [_resting_load(self.model)([cycles.start, self.settings, times])[0] for times in stick.T]
        t, h, first, last = self._steps(cycles)
        step = np.empty(slip.shape, dtype=int)
        for row, times in enumerate(slip):
            taken = np.flatnonzero(h[:, row])
            step[row] = taken[np.minimum(np.searchsorted(t[1:][taken, row], times), taken.size - 1)]
        at = step, np.arange(len(slip))[:, None]
        t, h, first, last = t[at], h[at], first[at], last[at]
        s, slope = (slip - t) / h, h * first[..., 1]
        a, b = _cubic(first[..., 0], last[..., 0], slope, h * last[..., 1])
        values = first[..., 0] + s * (slope + s * (b + s * a / 3.0))
        resting = np.stack(rests, axis=1)
        rates = (slope + s * (2.0 * b + s * a)) / h
        return np.hstack([resting[..., 0], values]), np.hstack([resting[..., 1], rates])

    def _steps(self, cycles: CycleRows) -> tuple[Array, Array, Array, Array]:
        """Of the steps between nodes: when the nodes are reached (k + 1, n), lengths (k, n), 0 where a row takes none;
        at both ends (k, n, 4): force, its rate, acceleration, speed."""
        x, t, mode, direction = (np.array([getattr(node, q) for node in cycles.nodes]) for q in Node.__annotations__)
        h, ends = np.diff(t, axis=0), np.zeros((2, len(t) - 1, len(self.settings), 4))
        for number, shown in enumerate(_shown(self.model)):
            step, row = np.nonzero((h > 0.0) & (mode[1:] == number))
            w, zero = self.settings[row], np.zeros(row.size)
            constants = np.column_stack([w[:, :-2], w[:, -1], direction[1:][step, row], w[:, -2], zero, zero])
            for side in (0, 1) if step.size else ():
                state = x[step + side, row]
                ends[side, step, row] = np.column_stack([shown([state, constants])[0], state[:, SPEED]])
        return t, h, *ends


def _cubic(v0: Array, v1: Array, d0: Array, d1: Array) -> tuple[Array, Array]:
    """a and b of the cubics v0 + s (d0 + s (b + s a / 3)) on [0, 1] with ends v0, v1 and slopes d0, d1 there."""
    return 3.0 * (2.0 * (v0 - v1) + d0 + d1), 3.0 * (v1 - v0) - 2.0 * d0 - d1


def _extremes(v0: Array, v1: Array, d0: Array, d1: Array) -> tuple[Array, Array]:
    """The largest and the smallest value of cubics on [0, 1] with ends v0, v1 and slopes d0, d1 there."""
    a, b = _cubic(v0, v1, d0, d1)
    with np.errstate(all="ignore"):
        root = np.sqrt(np.maximum(b * b - a * d0, 0.0))
        near = np.where(b >= 0.0, -b - root, -b + root)  # without cancellation
        places = np.stack([np.zeros_like(v0), np.ones_like(v0), near / a, d0 / near])
    s = np.clip(np.where(np.isfinite(places), places, 0.0), 0.0, 1.0)
    values = v0 + s * (d0 + s * (b + s * a / 3.0))
    return np.max(values, axis=0), np.min(values, axis=0)
