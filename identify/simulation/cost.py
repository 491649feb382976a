"""What a simulation costs: processor seconds at other accuracies, and what each effect takes; measured.

The motion, or its first cycles where it is long, is simulated again at each accuracy and without each effect; what is
measured on a part grows with the number of phases.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from time import process_time

import numpy as np

from identify.base.errors import IdentifyError
from identify.scene import Scene
from identify.simulation.simulate import simulate
from identify.simulation.trajectory import Trajectory

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
    levels = (min(taken * 100.0, COARSEST), taken, max(taken / 100.0, FINEST))
    motions, spent = _timed({a: lambda a=a: simulate(scene, part, accuracy=a).refined() for a in levels})  # type: ignore[misc]
    parts = len(motion.phases) / len(motions[taken].phases)
    rising = dict(zip(spent, np.maximum.accumulate(list(spent.values())).tolist(), strict=True))
    own = min(parts * rising[taken], seconds)  # the rest is the building of functions, the same at every accuracy
    levels_cost = {a: seconds - own + own * s / rising[taken] if rising[taken] else seconds for a, s in rising.items()}
    effects = {}
    for name in scene.model.effects:
        with suppress(IdentifyError, KeyError):  # an effect that others need, or whose values they need
            less = scene.with_effects([kept for kept in scene.model.effects if kept != name])
            others, without = _timed({taken: lambda less=less: simulate(less, part, accuracy=taken).refined()})  # type: ignore[misc]
            each, whole = (
                time[taken] / max(found[taken].onsets.size, 1) for time, found in ((without, others), (spent, motions))
            )
            effects[name] = max(own * (1.0 - each / whole), 0.0) if whole else 0.0
    return SimulationCost(taken, levels_cost, effects)


def _timed(runs: Mapping[float, Callable[[], Trajectory]]) -> tuple[dict[float, Trajectory], dict[float, float]]:
    """The motions, and the processor seconds of each: the least of several, taken in turns, where they are short."""
    motions = {key: run() for key, run in runs.items()}  # builds the functions
    spent, begun = dict.fromkeys(runs, np.inf), process_time()
    for _ in range(3):
        for key, run in runs.items():
            since = process_time()
            run()
            spent[key] = min(spent[key], process_time() - since)
        if process_time() - begun > 0.3:
            break
    return motions, spent
