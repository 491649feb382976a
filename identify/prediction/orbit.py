"""The stick-slip cycle of the composed model, from one arrest to the next, and the periodic orbit: where it closes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import Mapped
from identify.base.errors import SimulationError
from identify.effects import ALL
from identify.model.model import ELONGATION, SPEED, Model, assemble
from identify.model.modes import ModeName
from identify.simulation.phases import DOUBLINGS, Machine, Slide, node_slopes, situated_at, stepped
from identify.simulation.plan import Plan, scales
from identify.simulation.steppers import HIGH

Array = NDArray[np.float64]

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


# The return map: a stick and a slip of the simulator, and how they move with start, parameters and rig.
#
# The setting w (n_w,) = parameters, normal force [N], drive speed [m/s] holds during a stick and its slip.

ACCURATE = 1e-8  # relative tolerance of a step: a tenth of it, and less, is left in durations and jumps
SLIDES_AFTER = 12.0  # half periods sqrt(m/k) pi without coming to rest: the mass slides
DENSE = 0.08  # natural times sqrt(m/k): longest step, as extremes of a slip are sought between its nodes
CREEP = 1e-6  # of a half period: a slip this short is no slip, the contact creeps along with the drive
MOST_TURNS = 200  # of the direction of one slip; more is chatter
GROWN = 25.0  # e-foldings after which a disturbance of steady sliding is taken to have come to rest
LONGEST_PATIENCE = 100.0  # half periods


@lru_cache(maxsize=16)
def rest_slopes(model: Model) -> Mapped:
    """Of a stick, by (x, w, t): derivatives of its breakaway margin and its state by (x, w, t), one column per row."""
    x, w, t = (ca.SX.sym(name, n) for name, n in (("x", len(model.states)), ("w", len(model.parameters) + 2), ("t", 1)))
    p, u = w[:-2], ca.vertcat(w[-1], w[-2], 1, 0)
    rested = model.rest(x, p, u, t)
    margin = model.grip(rested, p, u) - model.driving_force(rested, p, u)
    slope = ca.jacobian(ca.vertcat(margin, rested), ca.vertcat(x, w, t)).T
    return Mapped(ca.Function("rest_slopes", [x, w, t], [ca.densify(slope)]))


@lru_cache(maxsize=16)
def load_slopes(model: Model, *, slides: bool = False) -> Mapped:
    """The force that the sensor shows at rest, or while the mass slides, by (x, w), and its derivatives by these."""
    x, w = ca.SX.sym("x", len(model.states)), ca.SX.sym("w", len(model.parameters) + 2)
    load = (model.sliding_cell if slides else model.load_cell)(x, w[:-2], ca.vertcat(w[-1], w[-2], 1, 0))
    row = ca.horzcat(load, ca.jacobian(load, ca.vertcat(x, w)))
    return Mapped(ca.Function("load", [x, w], [ca.densify(row)]))


@dataclass(frozen=True)
class Cycle:
    """A stick and the slip that follows it, SI.

    start, onset, end: states (n_x,) at rest at the arrest before, at the onset of slip, at the arrest after; stick and
    slip are durations [s]. setting (n_w,): parameters, normal force and drive speed; slides: the slip by modes and
    directions, their starts counted from the onset.
    """

    start: Array
    onset: Array
    end: Array
    stick: float
    slip: float
    setting: Array = field(repr=False)
    slides: tuple[Slide, ...] = field(repr=False)


@dataclass(frozen=True)
class Tangent:
    """Derivatives of a cycle by the rest state before it and by its setting, m = n_y + n_w columns in this order.

    end (n_y, m): rest state after it; stick, slip (m,) durations; nodes: of the states at the nodes of each slide,
    at fixed times since the onset, (nodes, n_x, m).
    """

    end: Array
    stick: Array
    slip: Array
    nodes: tuple[Array, ...] = field(repr=False)


def run_cycle(model: Model, y: Array, w: Array, limit: float, rtol: float = ACCURATE) -> Cycle | None:
    """The cycle that starts at rest in y; None when the mass does not come to rest within `limit` [s].

    Args:
        y: rest state (n_y,), the states without the sliding speed; one beyond its bounds starts there. w: setting
            (n_w,). rtol: relative tolerance of a step.
    """
    typical = scales(model, w[:-2], float(w[-2]))
    typical = replace(typical, longest=min(typical.longest, DENSE * typical.time))
    machine = Machine(model, w[:-2], typical, Plan(rtol, (HIGH,)))
    start = np.insert(np.clip(y, *bounds_at_rest(model)), SPEED, 0.0)
    # Longer than any stick: by then the spring alone pulls with more than a limit as strong as mu_s says.
    k = w[model.parameter_names.index("stiffness")]
    longest = 2.0 * (float(np.max(w[:2])) * w[-2] + k * abs(start[ELONGATION])) / (k * w[-1])
    for _ in range(DOUBLINGS):
        stick, onset, force = machine.rests.until(start, situated_at(w), longest)
        if stick is not None:
            break
        longest *= 2.0
    slides, x, t, rests = list[Slide](), onset, 0.0, False
    mode: ModeName = "slip"
    for _ in range(MOST_TURNS):
        part = machine.slide(mode, x, situated_at(w, -1.0 if force < 0.0 else 1.0, t), limit - t)
        slides.append(part)
        x, t = part.end, part.start + part.duration
        if part.ended_by is None:
            break
        mode = machine.following[mode][part.ended_by]
        if mode == "stick":
            mode = "slip"
            margin, force = machine.rests.margin(x, situated_at(w))
            rests = margin > 0.0
            if rests:
                break
    creeps = t < CREEP * float(half_periods(model, w[None])[0])
    lasted = longest if stick is None else stick
    return Cycle(start, onset, x, lasted, t, w, tuple(slides)) if rests and not creeps else None


def tangent_of(model: Model, cycle: Cycle) -> Tangent:
    """How a cycle moves with its start and its setting: exact derivatives of the steps that were taken."""
    n, w, last = cycle.start.size, cycle.setting, cycle.slides[-1]
    given = [cycle.start[None, :], w[None, :], np.array([cycle.stick])]
    slope = rest_slopes(model)(given)[0].reshape(n + 1, n + w.size + 1)
    free = np.delete(slope[:, :-1], SPEED, 1)
    stick = -free[0] / slope[0, -1] if cycle.stick else np.zeros(free.shape[1])
    nodes = node_slopes(model, cycle.slides, free[1:] + np.outer(slope[1:, -1], stick))
    rate, fixed = stepped(model, last, last.x[-1:], np.zeros(1))[1][0], nodes[-1][-1]
    slip = -fixed[SPEED] / rate[SPEED]
    return Tangent(np.delete(fixed + np.outer(rate, slip), SPEED, 0), stick, slip, tuple(nodes))


def rested(model: Model) -> Array:
    """Rest state (n_y,) with the spring unloaded and every state saturated."""
    return np.array([0.0, *(s.start if s.upper is None else s.upper for s in model.states[2:])])


def bounds_at_rest(model: Model) -> Array:
    """Lowest and highest value of each state at rest, shape (2, n_y)."""
    ends = [(-np.inf if s.lower is None else s.lower, np.inf if s.upper is None else s.upper) for s in model.states]
    return np.delete(np.array(ends), SPEED, 0).T


def half_periods(model: Model, settings: Array) -> Array:
    """Half natural periods (n,) [s] at settings (n, n_w), of the mass on rig and series element together.

    Softened by the root of the whole compliance over that of the rig.
    """
    p, one = settings[:, :-2].T, np.ones(len(settings))
    u = np.stack([0.0 * one, one, one, 0.0 * one])
    low, high = (np.array(model.at_force(force * one[None], p, u)) for force in (0.0, 1.0))
    pull = np.array(model.driving_force(high, p, u) - model.driving_force(low, p, u)).ravel()
    mass, stiffness = (p[model.parameter_names.index(name)] for name in ("mass", "stiffness"))
    softened = np.sqrt((high - low)[ELONGATION] * stiffness / pull)
    return np.asarray(np.pi * np.sqrt(mass / stiffness) * softened)


def slide_limits(model: Model, settings: Array, growth: Array) -> Array:
    """Durations (n,) [s] at settings (n, n_w) after which a mass that has not come to rest is taken to slide on.

    Longer where a disturbance of steady sliding grows (`growth` (n,) [1/s]) but slowly, and under heavy damping, where
    the mass creeps to rest.
    """
    half, p, one = half_periods(model, settings), settings[:, :-2].T, np.ones(len(settings))
    x = np.zeros((len(model.states), one.size))
    pulls = [np.array(model.driving_force(x, p, np.stack([v * one, one, one, 0.0 * one]))).ravel() for v in (0.0, 1.0)]
    mass, stiffness = (p[model.parameter_names.index(name)] for name in ("mass", "stiffness"))
    zeta = (pulls[1] - pulls[0]) / (2.0 * np.sqrt(mass * stiffness))
    with np.errstate(all="ignore"):
        waits = np.where(growth > 0.0, np.clip(GROWN / (growth * half), SLIDES_AFTER, LONGEST_PATIENCE), SLIDES_AFTER)
    return np.asarray(waits * half * np.where(zeta > 1.0, 1.0 + zeta, 1.0))


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
