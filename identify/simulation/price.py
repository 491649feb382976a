"""What a simulation costs: processor seconds at other accuracies, and what each effect takes, on a short part.

A simulation runs along a ladder of tolerances, each a hundredth of the one before, until two neighbours agree to the
accuracy that is asked for; another accuracy begins on another rung. So it costs what this one did, less the rungs that
it leaves out, and more for those that it has instead. What a rung costs is timed on a short part of the motion, and
grows with the phases of the motion.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from time import process_time

from identify.base.errors import IdentifyError
from identify.scene import Scene
from identify.simulation.plan import COARSEST as LOOSEST_STEP
from identify.simulation.plan import FINEST as FINEST_STEP
from identify.simulation.plan import SAFETY, other
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

    Args:
        motion: as `Trajectory.refined` has left it.

    Raises:
        SimulationError: as `simulate`.
    """
    taken = motion.accuracy or COARSEST
    levels = (min(taken * FACTOR, COARSEST), taken, max(taken / FACTOR, FINEST))
    rungs = {accuracy: _rungs(accuracy, motion.coarser + 2) for accuracy in levels}
    part, first = _part(motion), rungs[taken][0]
    spent, short = _spent(scene, part, {rtol for found in rungs.values() for rtol in found})
    parts = len(motion.phases) / len(short.phases)
    own = sum(spent[rtol] for rtol in rungs[taken])
    prices = {
        accuracy: max(seconds + parts * (sum(spent[rtol] for rtol in found) - own), 0.0)
        for accuracy, found in rungs.items()
    }
    effects = {}
    for name in scene.model.effects:
        with suppress(IdentifyError, KeyError):  # an effect that others need, or whose values they need
            less = scene.with_effects([kept for kept in scene.model.effects if kept != name])
            without, motion_without = _spent(less, part, [first])
            each = without[first] / max(motion_without.onsets.size, 1)
            whole = spent[first] / max(short.onsets.size, 1)
            share = 1.0 - each / whole if whole > 0.0 else 0.0  # shorter than a tick of the processor's clock
            effects[name] = max(parts * own * share, 0.0)
    return SimulationPrice(taken, prices, effects)


def _rungs(accuracy: float, runs: int) -> list[float]:
    """Relative tolerances of a step of the runs that an accuracy takes, the last of them for its check."""
    found = [min(max(accuracy / SAFETY, FINEST_STEP), LOOSEST_STEP)]
    while len(found) < runs:
        found.append(other(found[-1])[0])
        if found[-1] > found[-2]:
            break  # nothing tighter makes it better
    return found


def _part(motion: Trajectory) -> float:
    """How much of a motion [s] is run again: the first cycles, cut in the middle of a rest, so that no tolerance
    decides whether a slip is still inside."""
    onsets, arrests = motion.onsets, motion.arrests
    if min(onsets.size, arrests.size) <= CYCLES:
        return motion.duration
    arrest = float(arrests[CYCLES - 1])
    return 0.5 * (arrest + float(onsets[onsets > arrest][0]))


def _spent(scene: Scene, duration: float, tolerances: Iterable[float]) -> tuple[dict[float, float], Trajectory]:
    """Processor seconds of a simulation with each relative tolerance of a step, in turns, the least of several where it
    is short; and one of the motions."""
    wanted, taken = sorted(tolerances), list[dict[float, float]]()
    motion = simulate(scene, duration, rtol=wanted[-1])  # builds the functions
    while not taken or (len(taken) < RUNS and sum(sum(turn.values()) for turn in taken) < LONG):
        turn = {}
        for rtol in wanted:
            since = process_time()
            motion = simulate(scene, duration, rtol=rtol)
            turn[rtol] = process_time() - since
        taken.append(turn)
    return {rtol: min(turn[rtol] for turn in taken) for rtol in wanted}, motion
