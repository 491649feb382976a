"""What a simulation costs: processor seconds at other accuracies, and what each effect takes, on a short part."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from time import process_time

from identify.base.errors import IdentifyError
from identify.scene import Scene
from identify.simulation.simulate import simulate
from identify.simulation.trajectory import Trajectory

FACTOR = 100.0  # by which coarse and tight differ from the accuracy taken
FINEST, COARSEST = 1e-12, 0.1
CYCLES = 20  # of the short part; of a motion without that many, all of it
RUNS = 3
LONG = 0.3  # [s] of processor time in all after which no further run makes a figure better


@dataclass(frozen=True)
class SimulationPrice:
    """seconds: of processor time, by accuracy (of the one taken: as it was, the others estimated); effects: seconds of
    them that each effect takes: with all less without it, for as many slips; what cannot be left out is not there."""

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


def price(scene: Scene, motion: Trajectory, seconds: float) -> SimulationPrice:
    """The price of a motion of a scene that took so many processor seconds, the building of its functions included.

    Raises:
        SimulationError: as `simulate`.
    """
    taken, arrests = motion.accuracy or COARSEST, motion.arrests
    part = float(arrests[CYCLES - 1]) if arrests.size >= CYCLES else motion.duration
    own, slips = _spent(scene, part, taken)
    parts = motion.duration / part
    levels = {min(taken * FACTOR, COARSEST): 0.0, taken: seconds, max(taken / FACTOR, FINEST): 0.0}
    for accuracy in levels:
        if accuracy != taken:
            levels[accuracy] = max(seconds + parts * (_spent(scene, part, accuracy)[0] - own), 0.0)
    effects = {}
    for name in scene.model.effects:
        with suppress(IdentifyError, KeyError):  # an effect that others need, or whose values they need
            less = scene.with_effects([other for other in scene.model.effects if other != name])
            without, others = _spent(less, part, taken)
            effects[name] = max(parts * (own - without * max(slips, 1) / max(others, 1)), 0.0)
    return SimulationPrice(taken, levels, effects)


def _spent(scene: Scene, duration: float, accuracy: float) -> tuple[float, int]:
    """Processor seconds of a simulation with its check, the least of several where it is short, and its slips."""
    slips, taken = 0, list[float]()
    while len(taken) < 2 or (len(taken) <= RUNS and sum(taken) < LONG):
        since = process_time()
        slips = simulate(scene, duration, accuracy=accuracy).refined().onsets.size
        taken.append(process_time() - since)
    return min(taken[1:]), slips  # the first one builds the functions
