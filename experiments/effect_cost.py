"""What an effect costs, counted: states, parameters, instructions of the model, unknowns and rows of a fit.

Counted on the composition of the main effects without rivals of the effect, once with it and once without.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from identify.base.errors import FitError, IdentifyError
from identify.effects.quantities import Effect
from identify.logs.log_data import LogData
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.scene import Scene
from identify.shooting.grid import Grid
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.shooting.transcription import transcribe
from identify.simulation.drive import NormalForce
from identify.simulation.simulate import initial_states, run
from identify.simulation.trajectory import Trajectory
from tests.support import effects_case as case

CYCLES = 2
SPEED, DURATION, RATE = 5e-4, 5.0, 1000.0  # m/s, s, Hz: slips that wear off all ageing, under every effect
GENTLE = {"excitation_amplitude": 1e-6}  # so that its slips are of the same kind as without it
COUNTED = ("slip", "rest", "grip", "load_cell")


@dataclass(frozen=True)
class Cost:
    """Counts of one composition: states and parameters of the model, instructions by function, and of a fit of
    CYCLES cycles the parameters searched, all unknowns and rows; None where it cannot be laid out, and why."""

    states: int
    parameters: int
    instructions: tuple[int, ...]
    searched: int | None
    unknowns: int | None
    rows: int | None
    why: str = ""


def pair(effect: Effect) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The composition without the effect, and with it."""
    less = case.without(effect)
    return less, (*less, effect.name)


@lru_cache(maxsize=64)
def cost(names: tuple[str, ...]) -> Cost:
    """The counts of one composition."""
    model = assemble(names)
    instructions = tuple(int(getattr(model, name).n_instructions()) for name in COUNTED)
    try:
        fit, why = _laid_out(names), ""
    except IdentifyError as error:
        fit, why = (None, None, None), str(error)
    return Cost(len(model.states), len(model.parameters), instructions, *fit, why)


def _laid_out(names: tuple[str, ...]) -> tuple[int, int, int]:
    """Parameters searched, unknowns and rows of a fit of the first CYCLES cycles of a simulated log."""
    p, load = case.numbers(names), case.load_of(names)
    p |= {name: value for name, value in GENTLE.items() if name in p}
    rig = {n: p[n] for n in ("mass", "stiffness", "damping") if n in p} | {"drive_speed": SPEED}
    told = {q.name: {"start": p[q.name]} for q in assemble(names).parameters if q.kind == "friction"}
    document = {"effects": list(names), "rig": rig, "parameters": told}
    if "power_law" in names:
        document["extrapolate"] = ["power_law"]
    scene = Scene.from_document(document)
    model, unknowns = scene.model, from_scene(scene)
    values = np.array([p[n] for n in model.parameter_names])
    force = load if isinstance(load, float) else tuple(np.array(load).T)
    start = initial_states(model, values, np.array([SPEED, case.LOAD, 1.0, 0.0]), {})
    motion = run(model, p, SPEED, force, DURATION, start=start)
    if motion.arrests.size < CYCLES or motion.onsets.size <= CYCLES:
        raise FitError(f"the mass slides after {motion.arrests.size} of {CYCLES} cycles")
    end = 0.5 * (motion.arrests[CYCLES - 1] + motion.onsets[CYCLES])
    times = np.arange(0.0, end, 1 / RATE)
    shown, base = motion.sample(times)["force"], unknowns.base(p)
    log = LogData(times, shown, np.ones(times.size), base, SPEED, NormalForce.of(force), 0.0, 0.0, float(end))
    layout = transcribe([log], [_guess(motion, Grid(8, 4, 6))], unknowns, Grid(8, 4, 6))
    return layout.free.size, layout.size, layout.rows


def _guess(motion: Trajectory, grid: Grid) -> ShootingTrajectory:
    """The motion itself as the trajectory of its first CYCLES cycles."""
    names = [s.name for s in motion.model.states]

    def states(times: np.ndarray) -> np.ndarray:
        sampled = motion.sample(times.ravel())
        return np.stack([sampled[name] for name in names], axis=-1).reshape(*times.shape, len(names))

    onset, arrest = motion.onsets[:CYCLES], motion.arrests[:CYCLES]
    inside = [
        motion.wear_times[(motion.wear_times > a) & (motion.wear_times < b)] for a, b in zip(onset, arrest, strict=True)
    ]
    wear = np.array([found[0] if found.size else np.nan for found in inside])
    middle = np.where(np.isfinite(wear), wear, arrest)
    first, second = (
        states(a[:, None] + np.linspace(0.0, 1.0, n + 1) * (b - a)[:, None])
        for a, b, n in ((onset, middle, grid.slip), (middle, arrest, grid.worn))
    )
    return ShootingTrajectory.train(states(np.zeros(1))[0], onset, wear, arrest, first, second, np.empty(0))
