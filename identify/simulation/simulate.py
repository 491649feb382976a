"""Run the hybrid model forward: stick, slip and renewed contact with located switches, no smoothing.

The friction law is used as it stands (eqs. 1, 2, 5, 6): a mass at rest stays at rest until the drive
overcomes the static limit, and the sign function is never smoothed.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from time import process_time
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data_io.spelling import spelled
from identify.base.errors import IdentifyError, SimulationError
from identify.model.model import ELONGATION, Model, on_course
from identify.scene.tables import quantity
from identify.scene.values import DriveSpeed
from identify.simulation.drive import Drive, NormalForce
from identify.simulation.phases import Machine, phases
from identify.simulation.plan import ACCURACY, Stepping, accuracy_for, admit, scales
from identify.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from identify.scene import Scene

Array = NDArray[np.float64]


def initial_states(model: Model, p: Array, u: Array, given: Mapping[str, float]) -> dict[str, float]:
    """States by name at the start of a simulation, SI.

    A series element and the lags of a load cell start settled at the force that the elongation means at rest, so
    that nothing moves of itself.

    Args:
        p: parameters (n_p,). u: inputs (4,) at the start. given: states by name; "elongation" is the whole one, of
            rig and series element together.

    """
    names = [s.name for s in model.states]
    chosen = {name: value for name, value in given.items() if name in names}
    named = {s.name: s.start for s in model.states} | chosen
    if model.decays.numel_out(0) == 0:
        return named
    unloaded, loaded = (np.array(model.at_force(force, p, u)).ravel() for force in (0.0, 1.0))
    share = (named["elongation"] - unloaded[ELONGATION]) / (loaded[ELONGATION] - unloaded[ELONGATION])
    settled = unloaded + share * (loaded - unloaded)
    return dict(zip(names, settled.tolist(), strict=True)) | chosen


def run(
    model: Model,
    values: dict[str, float],
    drive: DriveSpeed | Drive,
    normal_force: float | NormalForce | tuple[ArrayLike, ArrayLike],
    duration: float,
    *,
    start: dict[str, float] | None = None,
    accuracy: float | Stepping = ACCURACY,
) -> Trajectory:
    """Simulate a model for `duration` [s].

    Args:
        values: every parameter of the model by name, SI.
        drive: drive speed [m/s], a programme of (start [s], speed [m/s]), or a course.
        normal_force: [N], or (times [s], values [N]), piecewise linear.
        start: initial states by name; left out: at rest, spring unloaded, fresh contact.
        accuracy: relative error of switch times and forces that is tolerated; method and steps follow from it. Or the
            stepping itself, for comparisons.

    Raises:
        SimulationError: what the model refuses, by name.
    """
    if not model.inertial:
        raise SimulationError(
            "the effect inertia is off: without a mass the duration of a slip is undefined; add inertia to effects and "
            "give the mass under [rig]"
        )
    admit(model, values, duration)
    stepping, accuracy = (accuracy, ACCURACY) if isinstance(accuracy, Stepping) else (None, accuracy)
    if not 0.0 < accuracy < 1.0:
        raise SimulationError(f"the accuracy is {accuracy}; expected a relative error between 0 and 1, such as 1e-6")
    p = np.array([values[name] for name in model.parameter_names])
    initial = start or {}
    programme, load = Drive.of(drive, duration), NormalForce.of(normal_force)
    model = on_course(model) if programme.accelerates else model
    scale = scales(model, p, float(load.at(0.0)))
    x = np.array([initial.get(s.name, s.start) for s in model.states], dtype=float)

    def made(steps: Stepping) -> Trajectory:
        motion = tuple(phases(Machine(model, p, scale, steps), programme, load, duration, x))
        other, share = steps.other()
        return Trajectory(model, motion, duration, accuracy, lambda: made(other), share)

    return made(stepping or Stepping.of(accuracy))


@spelled
def simulate(
    scene: Scene,
    duration: float | str,
    *,
    drive: DriveSpeed | str | Drive | None = None,
    normal_force: float | str | NormalForce | tuple[ArrayLike, ArrayLike] | None = None,
    accuracy: float | None = None,
    noise: float | str | None = None,
) -> Trajectory:
    """Simulate a scene for `duration` [s] with its `fixed`, else `start`, else documented default values.

    The course of the normal force counts where the effect varying_normal_force is on, else its mean over the
    duration. Every quantity may be a number in SI or text with a unit, such as "20 s".

    Parameters
    ----------
    scene : Scene
        what is simulated.
    duration : float | str
        of the motion [s].
    drive, normal_force : DriveSpeed | str | Drive | None, optional
        replace those of the scene's rig; units and forms as in `run`.
    accuracy : float | None, optional
        relative error of switch times and forces that is tolerated; None: an order below the noise, `ACCURACY`
        where there is none.
    noise : float | str | None, optional
        that the record is to carry [N]; None: what the scene says.

    Returns
    -------
    Trajectory

    Raises
    ------
    SimulationError
        no drive speed or normal force is given, or what the model refuses.
    SceneError
        the effects are still to be chosen, or one of them is outside its measured range; text that is no quantity.
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
    course, programme = NormalForce.of(force), Drive.of(speed, duration)
    load = course if model.follows_load else NormalForce.of(course.mean(0.0, duration))
    scene.check_ranges(None, programme.paces, (min(load.values), max(load.values)))
    u = np.array([programme.at(0.0), float(load.at(0.0)), 1.0, 0.0])
    p = np.array([values[name] for name in model.parameter_names])
    start = initial_states(model, p, u, asdict(scene.initial))
    if accuracy is None:
        accuracy = accuracy_for(
            scene.rig.noise if noise is None else noise, max(values["mu_s"], values["mu_k0"]) * max(load.values)
        )
    return run(model, values, programme, load, duration, start=start, accuracy=accuracy)


# What a simulation costs: processor seconds at other accuracies, and what each effect takes; measured. The motion, or
# its first cycles where it is long, is simulated again at each accuracy and without each effect; what is measured on a
# part grows with the number of phases.

FINEST, COARSEST = 1e-12, 0.1
CYCLES = 20  # of the part of a longer one


@dataclass(frozen=True)
class SimulationCost:
    """seconds: of processor time by accuracy, of the one taken as it was; effects: seconds of them that each effect
    takes: with all less without it, for as many slips; what cannot be left out is not there."""

    taken: float
    seconds: dict[float, float]
    effects: dict[str, float]

    @property
    def text(self) -> str:
        """In one line."""
        levels = [f"{a:.1g}: about {s:.2g} s" for a, s in self.seconds.items() if a != self.taken]
        dearest = sorted(self.effects.items(), key=lambda item: -item[1])
        effects = f". Of it {', '.join(f'{name} {seconds:.1g} s' for name, seconds in dearest)}" if dearest else ""
        return f"{self.seconds[self.taken]:.2g} s of processor time; at accuracy {'; '.join(levels)}{effects}"


def cost(scene: Scene, motion: Trajectory, seconds: float) -> SimulationCost:
    """The cost of a motion of a scene that took so many processor seconds, the building of its functions included.

    Args:
        motion: as `Trajectory.refined` has left it.

    Raises:
        SimulationError: as `simulate`.
    """
    taken, part = motion.accuracy or COARSEST, motion.duration
    # A long one is simulated again by its first cycles.
    if seconds > 2.0 and min(motion.onsets.size, motion.arrests.size) > CYCLES:
        # Cut in the middle of a rest, so that no tolerance decides whether a slip is still inside.
        arrest = float(motion.arrests[CYCLES - 1])
        part = 0.5 * (arrest + float(motion.onsets[motion.onsets > arrest][0]))

    def timed(of: Scene, accuracy: float) -> tuple[Trajectory, float]:
        """A motion, and its processor seconds: the least of several where it is short."""
        again, spent, begun = simulate(of, part, accuracy=accuracy).refined(), np.inf, process_time()
        while spent == np.inf or process_time() - begun < min(0.3, 3.5 * spent):  # the first one built the functions
            since = process_time()
            simulate(of, part, accuracy=accuracy).refined()
            spent = min(spent, process_time() - since)
        return again, spent

    runs = {a: timed(scene, a) for a in (min(taken * 100.0, COARSEST), taken, max(taken / 100.0, FINEST))}
    rising = dict(zip(runs, np.maximum.accumulate([spent for _, spent in runs.values()]).tolist(), strict=True))
    # The rest is the building of functions, the same at every accuracy.
    own = min(len(motion.phases) / len(runs[taken][0].phases) * rising[taken], seconds)
    levels = {a: seconds - own + own * s / rising[taken] if rising[taken] else seconds for a, s in rising.items()}
    effects = {}
    for name in scene.model.effects:
        with suppress(IdentifyError, KeyError):  # an effect that others need, or whose values they need
            less = timed(scene.with_effects([kept for kept in scene.model.effects if kept != name]), taken)
            each, whole = (spent / max(made.onsets.size, 1) for made, spent in (less, runs[taken]))
            effects[name] = max(own * (1.0 - each / whole), 0.0) if whole else 0.0
    return SimulationCost(taken, levels, effects)
