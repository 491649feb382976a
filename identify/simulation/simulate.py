"""Run the hybrid model forward: stick, slip and worn contact with located switches, no smoothing.

The friction law is used as it stands (eqs. 1, 2, 5, 6): a mass at rest stays at rest until the drive
overcomes the static limit, and the sign function is never smoothed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.errors import SimulationError
from identify.model.model import SPEED, Model
from identify.model.modes import ModeName
from identify.scene.tables import quantity
from identify.simulation.drive import Drive, NormalForce, breaks
from identify.simulation.phases import Machine, Phase, initial_states
from identify.simulation.plan import ACCURACY, SAFETY, Plan, Stepping, accuracy_for, admit, plan, scales
from identify.simulation.quasistatic_phases import BalancedMachine, BalancedTrajectory, sizes
from identify.simulation.stepper import Situated
from identify.simulation.trajectory import Second, Trajectory

if TYPE_CHECKING:
    from identify.scene import Scene

Array = NDArray[np.float64]

MAX_PHASES = 2_000_000
STALLED = 1000  # rests and slides within one moment of the machine: chatter, refused by name


def phases(
    machine: Machine | BalancedMachine, drive: Drive, normal_force: NormalForce, duration: float, x: Array
) -> Iterator[Phase]:
    """The phases of the motion from state x (n_x,), one by one, until `duration` [s].

    Raises:
        SimulationError: chatter (stick and slip without time passing), or a slip that cannot be integrated.
    """
    model, p = machine.model, machine.p
    ends = breaks(drive, normal_force, duration)
    t, segment, marked, longest = 0.0, 0, -np.inf, 0.0
    mode: ModeName = "stick"
    direction = 1.0
    if isinstance(machine, Machine) and x[SPEED] != 0.0:
        direction = float(np.sign(x[SPEED]))
        force, slope = normal_force.line(0.0)
        mode = machine.begins(Situated(p, drive.at(0.0), direction, force, slope), x)
    made: Sequence[Phase]
    for number in range(MAX_PHASES):
        force, slope = normal_force.line(t)
        situated = Situated(p, drive.at(t), direction, force, slope, t)
        limit = max(float(ends[segment]) - t, 0.0)
        if mode == "stick":
            stick = machine.rest(x, situated, limit)
            direction, made = -1.0 if stick.drive_force < 0.0 else 1.0, (stick,)
        else:
            made = machine.slide(mode, x, situated, limit)
        phase = made[-1]
        end, longest = phase.start + phase.duration, max(longest, phase.duration)
        if number % STALLED == STALLED - 1:
            if t - marked < machine.moment:
                raise SimulationError(machine.chatter(t, longest))
            marked, longest = t, 0.0
        yield from (phase for phase in made if machine.counts(phase))
        t, x, mode = end, phase.end, phase.mode
        if phase.ended_by is None:
            t, segment = float(ends[segment]), segment + 1
            if segment == ends.size:
                return
        elif mode == "stick":
            mode = "slip"
        else:
            mode = machine.following[mode][phase.ended_by]
            if mode == "stick" and model.jumps:
                x = np.array(model.at_stick(x, p, situated.at(phase.duration))).ravel()
    raise SimulationError(f"the simulation reached {t:.6g} s of {duration:.6g} s in {MAX_PHASES} phases; shorten it")


def run(
    model: Model,
    values: dict[str, float],
    drive: float | Drive | tuple[tuple[float, float], ...],
    normal_force: float | NormalForce | tuple[ArrayLike, ArrayLike],
    duration: float,
    *,
    start: dict[str, float] | None = None,
    accuracy: float | Stepping = ACCURACY,
) -> Trajectory:
    """Simulate a model for `duration` [s].

    Args:
        values: every parameter of the model by name, SI.
        drive: drive speed [m/s], or a programme of (start [s], speed [m/s]).
        normal_force: [N], or (times [s], values [N]), piecewise linear.
        start: initial states by name; left out: at rest, spring unloaded, fresh contact.
        accuracy: relative error of switch times and forces that is tolerated; method and steps follow from it. Or the
            stepping itself, for comparisons.

    Raises:
        SimulationError: what the model refuses, by name.
    """
    admit(model, values, duration, start or {})
    asked = accuracy if isinstance(accuracy, Stepping) else Stepping(accuracy / SAFETY)
    accuracy = ACCURACY if isinstance(accuracy, Stepping) else accuracy
    if not 0.0 < accuracy < 1.0:
        raise SimulationError(f"the accuracy is {accuracy}; expected a relative error between 0 and 1, such as 1e-6")
    p = np.array([values[name] for name in model.parameter_names])
    initial = start or {}
    x = np.array([initial.get(s.name, s.start) for s in model.states], dtype=float)
    programme, load = Drive.of(drive), NormalForce.of(normal_force)
    force = float(load.at(0.0))
    build: Callable[..., Machine | BalancedMachine]
    kind: type[Trajectory]
    if model.balance is None:
        scale = scales(model, p, force)
        first, build, kind = plan(model, p, scale, asked), partial(Machine, model, p, scale), Trajectory
    else:
        build, kind = partial(BalancedMachine, model, p, sizes(model, p, force), duration), BalancedTrajectory
        first = Plan(asked.rtol, ())

    def made(steps: Plan) -> Trajectory:
        with closing(build(steps, locate=asked.locate)) as machine:
            motion = tuple(phases(machine, programme, load, duration, x))
        other, share = steps.other()
        return kind(model, motion, duration, accuracy, Second(lambda: made(other), share, other.rtol < steps.rtol))

    return made(first)


def simulate(
    scene: Scene,
    duration: float | str,
    *,
    drive: float | str | Drive | tuple[tuple[float, float], ...] | None = None,
    normal_force: float | str | NormalForce | tuple[ArrayLike, ArrayLike] | None = None,
    accuracy: float | None = None,
    noise: float | str | None = None,
    rtol: float | None = None,
) -> Trajectory:
    """Simulate a scene for `duration` [s] with its `fixed`, else `start`, else documented default values.

    The course of the normal force counts where the effect varying_normal_force is on, else its mean over the
    duration. Every quantity may be a number in SI or text with a unit, such as "20 s".

    Args:
        drive, normal_force: replace those of the scene's rig; units and forms as in `run`.
        accuracy: relative error of switch times and forces that is tolerated; None: an order below the noise,
            `ACCURACY` where there is none.
        noise: that the record is to carry [N]; None: what the scene says.

    Raises:
        SimulationError: no drive speed or normal force is given, or what the model refuses.
        SceneError: the effects are still to be chosen, or one of them is outside its measured range; text that is no
            quantity.
    """
    duration = quantity(duration, "s", "the duration")
    speed = scene.rig.drive_speed if drive is None else drive
    force = scene.rig.normal_force if normal_force is None else normal_force
    speed = quantity(speed, "m/s", "the drive speed") if isinstance(speed, str) else speed
    force = quantity(force, "N", "the normal force") if isinstance(force, str) else force
    noise = quantity(noise, "N", "the noise") if isinstance(noise, str) else noise
    if speed is None:
        raise SimulationError("the scene has no drive speed; give drive_speed under [rig]")
    if force is None:
        raise SimulationError("the scene has no normal force; give normal_force under [rig]")
    model, values = scene.model, scene.values()
    course, programme = NormalForce.of(force), Drive.of(speed)
    load = course if model.follows_load else NormalForce.of(course.mean(0.0, duration))
    scene.check_ranges(
        None, tuple(zip(programme.starts, programme.speeds, strict=True)), (min(load.values), max(load.values))
    )
    u = np.array([programme.at(0.0), float(load.at(0.0)), 1.0, 0.0])
    p = np.array([values[name] for name in model.parameter_names])
    start = initial_states(model, p, u, asdict(scene.initial))
    if accuracy is None:
        accuracy = accuracy_for(
            scene.rig.noise if noise is None else noise, max(values["mu_s"], values["mu_k0"]) * max(load.values)
        )
    return run(model, values, programme, load, duration, start=start, accuracy=Stepping(rtol) if rtol else accuracy)
