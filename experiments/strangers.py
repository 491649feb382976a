"""Wide pairs of a stranger's kind: a scene file and logs as a laboratory that knows nothing of this project has them.

Ranges: see RANGES; up to four drive speeds, each with three cycles or more; sampled at 500 to 2000 Hz; white noise of
0.3 to 1 % of the load. The scene states the rig and no start values; the logs are files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run

Array = NDArray[np.float64]

SEED = 6300
UNIFORM: Mapping[str, tuple[float, float]] = {
    "mu_s": (0.2, 1.2),
    "ratio": (0.45, 0.92),  # mu_k0 / mu_s
    "delta_mu_k": (-0.2, 0.05),
}
LOGARITHMIC: Mapping[str, tuple[float, float]] = {
    "a": (30.0, 3000.0),  # s/m
    "D": (5e-6, 200e-6),  # m
    "t_cr": (0.05, 20.0),  # s
    "mass": (0.05, 2.0),  # kg
    "stiffness": (200.0, 20_000.0),  # N/m
    "zeta": (0.01, 0.3),
    "load": (0.2, 50.0),  # N
    "rate": (500.0, 2000.0),  # Hz
    "noise": (0.003, 0.01),  # of the load
}
LOGS, FEWEST, MOST = 4, 3, 40  # at most so many logs; cycles of each
SLOWEST = 0.02  # least kinetic friction at speed
CYCLES = (4.0, 10.0)  # asked for in each log
PERIOD = (6.0, 4.0)  # shortest, in natural periods, and longest [s] that a speed aims at
LONGEST = 60.0  # s


@dataclass(frozen=True)
class Log:
    """One log: drive speed [m/s], time [s], friction force [N], complete cycles."""

    speed: float
    time: Array
    force: Array
    cycles: int


@dataclass(frozen=True)
class Stranger:
    """A pair with its rig: true parameters by name [SI], damping ratio, load [N], and the logs."""

    truth: Mapping[str, float]
    rig: Mapping[str, float]
    load: float
    logs: tuple[Log, ...]

    def write(self, folder: Path) -> Path:
        """Scene and logs as files in a folder; returns the scene's path."""
        rig = "\n".join(f"{name} = {value!r}" for name, value in self.rig.items())
        effects = ", ".join(f'"{name}"' for name in MAIN)
        scene = f"effects = [{effects}]\n\n[rig]\n{rig}\n"
        for number, log in enumerate(self.logs, 1):
            rows = np.column_stack([log.time, np.full(log.time.size, self.load), log.force])
            header = "time [s],normal force [N],friction force [N]"
            np.savetxt(folder / f"log_{number}.csv", rows, "%.7g", ",", header=header, comments="")
            scene += f'\n[[logs]]\npath = "log_{number}.csv"\ndrive_speed = {log.speed!r}\n'
        path = folder / "pair.toml"
        path.write_text(scene, encoding="utf-8")
        return path


def stranger(number: int) -> Stranger:
    """The pair of a number; drawn again where it slides backwards or fewer than two speeds show FEWEST cycles."""
    random = np.random.default_rng([SEED, number])
    while True:
        v = {name: float(random.uniform(*ends)) for name, ends in UNIFORM.items()}
        v |= {name: float(np.exp(random.uniform(*np.log(ends)))) for name, ends in LOGARITHMIC.items()}
        v["mu_k0"] = v.pop("ratio") * v["mu_s"]
        logs = _logs(v, random) if v["mu_k0"] + v["delta_mu_k"] > SLOWEST else []
        if len(logs) >= 2:
            truth = {name: v[name] for name in ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")}
            return Stranger(truth, {name: v[name] for name in ("mass", "stiffness", "zeta")}, v["load"], tuple(logs))


def _logs(v: Mapping[str, float], random: np.random.Generator) -> list[Log]:
    """The logs of a pair that show enough cycles, the slowest first."""
    values = {**v, "damping": 2.0 * v["zeta"] * v["stiffness"]}
    drop = 2.0 * (v["mu_s"] - v["mu_k0"]) * v["load"] / v["stiffness"]  # m
    natural = 2.0 * np.pi * np.sqrt(v["mass"] / v["stiffness"])
    # One in each of LOGS equal parts of the logarithmic range, so that the speeds of a pair differ.
    shares = (LOGS - 1 - np.arange(LOGS) + random.uniform(0.0, 1.0, LOGS)) / LOGS
    periods = PERIOD[0] * natural * (PERIOD[1] / (PERIOD[0] * natural)) ** shares
    logs, model = [], assemble(MAIN)
    for period in periods.tolist():
        speed = drop / period
        first = v["mu_s"] * v["load"] / v["stiffness"] / speed
        duration = min(first + random.uniform(*CYCLES) * period, LONGEST)
        times = np.arange(round(duration * v["rate"]) + 1) / v["rate"]
        noise = v["noise"] * v["load"] * random.standard_normal(times.size)
        try:
            motion = run(model, values, speed, v["load"], float(times[-1]))
        except SimulationError:
            continue
        if any(phase.situated.direction < 0.0 for phase in motion.phases):
            return []
        if FEWEST <= motion.arrests.size <= MOST:
            logs.append(Log(speed, times, motion.sample(times)["force"] + noise, int(motion.arrests.size)))
    return logs
