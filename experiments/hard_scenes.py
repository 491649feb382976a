"""What a hard case is made of: a scene, and what a truth from outside says about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]
Programme = float | tuple[tuple[float, float], ...]

# Skin-like: the pair and rig that the cases start from, SI.
PAIR = {
    "mu_s": 0.62,
    "mu_k0": 0.43,
    "delta_mu_k": -0.13,
    "a": 300.0,
    "D": 37.4e-6,
    "t_cr": 0.5,
    "mass": 0.2,
    "stiffness": 1470.0,
    "damping": 147.0,
}
OMEGA = (PAIR["stiffness"] / PAIR["mass"]) ** 0.5  # [rad/s]
V_CR = PAIR["D"] / PAIR["t_cr"]  # [m/s]


@dataclass(frozen=True)
class Scene:
    """Parameters that differ from PAIR, drive, normal force as ((time, force), ...), duration [s], start, effects."""

    change: dict[str, float]
    drive: Programme
    duration: float
    force: Programme = 1.0
    start: dict[str, float] = field(default_factory=dict)
    effects: tuple[str, ...] = MAIN

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of its model."""
        return {p.name: self.change.get(p.name, PAIR.get(p.name, p.default)) for p in assemble(self.effects).parameters}

    def run(self, spoil: float = 0.0) -> Trajectory:
        """Our simulation; `spoil` makes the spring that much stiffer (relative): a control that errors are seen."""
        values = self.values
        values["stiffness"] *= 1.0 + spoil
        load = self.force if isinstance(self.force, (int, float)) else tuple(np.transpose(self.force).tolist())
        return run(assemble(self.effects), values, self.drive, load, self.duration, start=dict(self.start))


@dataclass(frozen=True)
class Answer:
    """What is known from outside. onsets, arrests: the first so many times of each [s] (all of them if `complete`);
    force (n,) [N] at times (n,) [s]."""

    onsets: Array
    arrests: Array
    times: Array
    force: Array
    complete: bool = True


@dataclass(frozen=True)
class HardCase:
    """One row of the table: green where the error stays below `tolerance`, or refused with the sentence `refusal`
    (a regular expression that the message must hold)."""

    name: str
    scene: Scene
    truth: Callable[[Scene], Answer] | None
    source: str
    tolerance: float = 1e-8
    refusal: str = ""

    def errors(self, *spoils: float) -> list[float]:
        """Largest error of switch times over the mean period (or the duration) and of forces over the largest, with a
        spring too stiff by these shares; infinite where switches are missing or too many."""
        assert self.truth is not None
        answer = self.truth(self.scene)
        return [difference(self.scene.run(spoil), answer, self.scene.duration) for spoil in spoils]


def difference(ours: Trajectory, answer: Answer, duration: float) -> float:
    """See HardCase.errors."""
    worst, period = 0.0, duration / max(answer.onsets.size, 1)
    for found, known in ((ours.onsets, answer.onsets), (ours.arrests, answer.arrests)):
        if found.size < known.size or (answer.complete and found.size != known.size):
            return float("inf")
        if known.size:
            worst = max(worst, float(np.max(np.abs(found[: known.size] - known))) / period)
    if answer.times.size:
        force = ours.sample(answer.times)["force"]
        largest = float(np.max(np.abs(answer.force))) or 1.0
        worst = max(worst, float(np.max(np.abs(force - answer.force))) / largest)
    return worst
