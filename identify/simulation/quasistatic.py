"""Run a model without inertia forward: rest, sliding in balance of forces, located switches, jumps of the speed.

It is the limit of a vanishing mass with hysteresis damping h > 0 and stiffness k fixed, reached with sqrt(m). (Without
any damping a mass on an ageing contact is unstable, however small: it swings up at the rate k_D/(2 t_cr (k - k_D)),
k_D = (mu_s - mu_k) F_n/D.) Where friction falls as sliding sets in, or softens with distance faster than the spring
unloads (k < k_D), the motion jumps to another place: refused by name.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.model.model import Model
from identify.model.modes import ModeName, sliding_modes
from identify.simulation.drive import Drive, NormalForce, breaks
from identify.simulation.plan import other
from identify.simulation.quasistatic_balance import settle
from identify.simulation.quasistatic_collocation import Collocator
from identify.simulation.quasistatic_phases import BalancedPhase, Slide, sizes, stick
from identify.simulation.quasistatic_trajectory import BalancedTrajectory
from identify.simulation.situated import Situated
from identify.simulation.trajectory import Second

Array = NDArray[np.float64]

MAX_PHASES = 2_000_000
STALLED, MOMENT = 1000, 1e-10  # so many phases in a row, each no longer than that share of the whole: chatter


def balanced(
    model: Model,
    p: Array,
    drive: Drive,
    normal_force: NormalForce,
    duration: float,
    x: Array,
    *,
    rtol: float = 1e-11,
    accuracy: float | None = None,
    locate: bool = True,
) -> BalancedTrajectory:
    """The motion of a model without inertia from rest at state x (n_x,), for `duration` [s]; arguments as `run`.

    Raises:
        SimulationError: a jump to another place, or phases without time passing.
    """
    motion = tuple(_phases(model, p, (drive, normal_force), duration, x, rtol, locate))
    following, share = other(rtol)

    def again() -> BalancedTrajectory:
        outside = (drive, normal_force)
        return balanced(model, p, *outside, duration, x, rtol=following, accuracy=accuracy, locate=locate)

    return BalancedTrajectory(model, motion, duration, accuracy, Second(again, share, following < rtol))


def _phases(
    model: Model,
    p: Array,
    outside: tuple[Drive, NormalForce],
    duration: float,
    x: Array,
    rtol: float,
    locate: bool,
) -> Iterator[BalancedPhase]:
    drive, normal_force = outside
    machine = Collocator(model, rtol, sizes(model, p, float(normal_force.at(0.0))))
    ends = breaks(drive, normal_force, duration)
    t, v, segment, stalled, direction, folded = 0.0, 0.0, 0, 0, 1.0, False
    mode: ModeName = "stick"
    for _ in range(MAX_PHASES):
        force, slope = normal_force.line(t)
        situated = Situated(p, drive.at(t), direction, force, slope, t)
        limit = float(ends[segment]) - t
        phase, following = _phase(machine, mode, (x, v, folded), situated, limit, locate)
        stalled = stalled + 1 if phase.duration <= MOMENT * duration else 0
        if stalled > STALLED:
            raise SimulationError(
                f"the contact changes between rest and slide without time passing at {t:.6g} s (chatter): "
                "without inertia nothing holds it either way; add the effect inertia"
            )
        if phase.duration > 0.0 or phase.ended_by is not None:
            yield phase  # of no duration too: an arrest at a step of the drive is an arrest
        t, x, v, folded = t + phase.duration, phase.x[-1], float(phase.v[-1]), phase.ended_by == "fold"
        if phase.ended_by is None:
            t, segment = float(ends[segment]), segment + 1
            if segment == ends.size:
                return
        if mode == "stick" and following != "stick":
            u = np.array([situated.drive_speed, float(normal_force.at(t)), 1.0, t])
            direction = float(np.sign(np.array(model.driving_force(x, p, u)).item())) or 1.0
        elif mode != "stick" and following == "stick" and model.jumps:
            x = np.array(model.at_stick(x, p, situated.at(phase.duration))).ravel()
        mode = following
    raise SimulationError(f"the simulation reached {t:.6g} s of {duration:.6g} s in {MAX_PHASES} phases; shorten it")


def _phase(
    machine: Collocator,
    mode: ModeName,
    at: tuple[Array, float, bool],
    situated: Situated,
    limit: float,
    locate: bool,
) -> tuple[BalancedPhase, ModeName]:
    """One phase of `limit` [s] at most, and the mode that follows it; at: state, speed, whether that has folded."""
    model, start, (x, v, folded) = machine.model, situated.time, at
    if mode == "stick":
        phase = stick(model, x, situated, start, limit)
        return phase, "stick" if phase.ended_by is None else "slip"
    speed = settle(machine, mode, x, situated, v, folded=folded)
    if speed is None:
        still = BalancedPhase(mode, start, situated, np.zeros(1), x[None, :], "speed", np.zeros(1))
        return still, "stick"
    phase = Slide(machine, mode, situated, locate=locate).run(x, speed, start, limit)
    if phase.ended_by is None or phase.ended_by == "fold":
        return phase, mode
    return phase, dict(sliding_modes(model.clamped is not None)[mode].exits)[phase.ended_by]
