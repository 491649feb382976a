"""What a hard case is made of: a scene, and a truth from outside about it: the independent integrator of the tests, and
closed forms in 40 digits."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import mpmath as mp
import numpy as np
from numpy.typing import NDArray

sys.path.append(str(Path(__file__).resolve().parent.parent))
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run
from identify.simulation.trajectory import Trajectory
from tests.support import oracle

mp.mp.dps = 60
NONE = np.empty(0)
SAMPLES = 801
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


def _times(scene: Scene) -> Array:
    """Sample times clear of the steps of the drive, where the damper makes the force jump."""
    steps = [] if isinstance(scene.drive, (int, float)) else [t for t, _ in scene.drive]
    times = np.linspace(0.0, scene.duration, SAMPLES)[1:]
    return times[[all(abs(t - s) > 1e-6 * scene.duration for s in steps) for t in times]]


def by_integration(method: str = "DOP853", rtol: float = oracle.RTOL) -> Callable[[Scene], Answer]:
    """Events and forces of the event-driven integrator, which shares no line with the package."""

    def truth(scene: Scene) -> Answer:
        start = scene.start
        state = (start.get("elongation", 0.0), start.get("sliding_speed", 0.0), start.get("gamma", 0.0))
        values = {name: scene.values.get(name, 0.0) for name in oracle.Law.__annotations__}
        values["a"] = values["a"] or 1.0
        run = oracle.simulate(values, scene.drive, scene.force, scene.duration, state, rtol=rtol, method=method)
        times = _times(scene)
        # Where a slip begins or turns round without a rest before it, it counts an onset; the package does not.
        return Answer(np.setdiff1d(run.onsets, [0.0, *run.arrests]), run.arrests, times, run.force(times))

    return truth


def continued(cycles: int) -> Callable[[Scene], Answer]:
    """The integrator for some cycles; then every onset follows the one before by the same period."""

    def truth(scene: Scene) -> Answer:
        assert isinstance(scene.drive, float)
        full = scene.values
        reach = full["mu_s"] * float(scene.force) / (full["stiffness"] * scene.drive)  # type: ignore[arg-type]
        run = oracle.simulate(full, scene.drive, scene.force, min(cycles * reach, scene.duration))
        periods = np.diff(run.onsets)
        assert abs(periods[-1] / periods[-2] - 1.0) < 1e-11, "the cycle has not settled"
        more = int((scene.duration - run.onsets[-1]) / periods[-1])
        onsets = np.concatenate([run.onsets, run.onsets[-1] + periods[-1] * np.arange(1, more + 1)])
        return Answer(onsets, NONE, NONE, NONE, complete=False)

    return truth


def linear_slip(scene: Scene) -> Answer:
    """Static and kinetic friction, the latter linear in speed: sticks are straight, slips obey eq. (13).

    docs/equations.md, section 4. The first return to rest is the first zero of V/v_0 = 1 - xi' after the start,
    bracketed on a fine grid.
    """
    v = {name: mp.mpf(value) for name, value in scene.values.items()}
    v0, load = mp.mpf(scene.drive), mp.mpf(scene.force)  # type: ignore[arg-type]
    k, m, c = v["stiffness"], v["mass"], v.get("damping", 0) * mp.sqrt(v["mass"] / v["stiffness"])
    omega = mp.sqrt(k / m)
    alpha = (c + load * v.get("slope", 0)) / (2 * mp.sqrt(k * m))
    onset_force = v["mu_s"] * load
    x_on, x_eq = (onset_force - c * v0) / k, (v["mu_k0"] + v.get("slope", 0) * v0) * load / k
    over = (x_on - x_eq) * omega / v0
    inside = mp.sqrt(mp.mpc(1 - alpha**2))

    def waves(tau: mp.mpf) -> tuple[mp.mpf, mp.mpf]:
        small = abs(inside * tau) < mp.mpf(10) ** -18
        return mp.re(mp.cos(inside * tau)), mp.re(tau if small else mp.sin(inside * tau) / inside)

    def motion(tau: mp.mpf) -> tuple[mp.mpf, mp.mpf]:
        """Elongation over equilibrium (times omega/v_0) and its rate (over v_0)."""
        C, S = waves(tau)
        decay = mp.exp(-alpha * tau)
        return decay * (over * C + (1 + alpha * over) * S), decay * (C - (alpha + over) * S)

    end = _first_rest(lambda tau: 1 - motion(tau)[1], mp.mpf(scene.duration) * omega)
    return _cycles(scene, (x_on, x_eq, v0, omega, k, c), motion, end)


def forces_of(truth: Callable[[Scene], Answer]) -> Callable[[Scene], Answer]:
    """Its forces only: where the speed just touches zero, a rest that lasts no time may be counted or not."""
    return lambda scene: replace(truth(scene), onsets=NONE, arrests=NONE, complete=False)


def _first_rest(speed: Callable[[mp.mpf], mp.mpf], limit: mp.mpf) -> mp.mpf | None:
    """First zero of the speed after tau = 0, None before the limit; later periods only fade. Dips between the times of
    the grid are followed to their lowest point."""
    grid = [mp.mpf(i) / 200 for i in range(1, int(min(limit, 13) * 200))]
    values = [speed(tau) for tau in grid]
    for i in range(1, len(grid) - 1):
        low, high = grid[i - 1], grid[i]
        if values[i] > 0 and values[i - 1] > values[i] < values[i + 1]:
            high = mp.findroot(lambda tau: mp.diff(speed, tau), grid[i], tol=1e-30)
        if speed(high) <= 0:
            return mp.findroot(speed, (low, high), solver="anderson", tol=1e-60, verify=False)
    return None


def _cycles(
    scene: Scene, known: tuple[mp.mpf, ...], motion: Callable[[mp.mpf], tuple[mp.mpf, mp.mpf]], end: mp.mpf | None
) -> Answer:
    """Sticks and slips repeated to the end of the scene; forces at samples."""
    x_on, x_eq, v0, omega, k, c = known
    onsets, arrests, rests = [x_on / v0], [], [(mp.mpf(0), mp.mpf(0))]
    while end is not None and onsets[-1] + end / omega < scene.duration:
        arrests.append(onsets[-1] + end / omega)
        x = x_eq + motion(end)[0] * v0 / omega
        rests.append((arrests[-1], x))
        onsets.append(arrests[-1] + (x_on - x) / v0)
    onsets = [t for t in onsets if t < scene.duration]
    times, force = _times(scene)[:: SAMPLES // 25], []
    for t in times:
        began = [t0 for t0 in onsets if t0 <= t]
        rest = [r for r in rests if r[0] <= t][-1]
        if began and began[-1] >= rest[0]:
            x, rate = motion((mp.mpf(float(t)) - began[-1]) * omega)
            force.append(k * (x_eq + x * v0 / omega) + c * v0 * rate)
        else:
            force.append(k * (rest[1] + v0 * (mp.mpf(float(t)) - rest[0])) + c * v0)
    return Answer(*(np.array([float(y) for y in q]) for q in (onsets, arrests)), times, np.array(force, float))


def first_onset(
    pull: Callable[[dict[str, float], mp.mpf], mp.mpf], step: float, begin: float = 0.0
) -> Callable[[Scene], Answer]:
    """The first time at which `pull(values, t)`, driving force minus grip of a mass at rest [N], is zero.

    Scanned from `begin` [s], before which it cannot be, at `step` [s], finer than any vibration in it, then refined
    in 40 digits.
    """

    def truth(scene: Scene) -> Answer:
        values, first = scene.values, int(begin / step)
        for i in range(first + 1, int(scene.duration / step) + 1):
            if pull(values, mp.mpf(i) * step) >= 0:
                t = mp.findroot(lambda t: pull(values, t), ((i - 1) * step, i * step), solver="anderson")
                return Answer(np.array([float(t)]), NONE, NONE, NONE, complete=False)
        raise ValueError("the mass never moves")

    return truth
