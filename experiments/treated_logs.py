"""Logs as laboratories hand them on: smoothed, resampled, exported twice, under an oscillating load, of specimens.

Each case is a scene, its records and the true parameters; the pair follows from the number.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, filtfilt, savgol_filter

from data_io import Record
from experiments.judgement import FRICTION
from experiments.study_problem import NOISE, RIG, SPEEDS, USUAL, Case, random_case, recorded
from identify import Scene
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.drive import NormalForce
from identify.simulation.simulate import run

Array = NDArray[np.float64]
Treated = tuple[Scene, list[Record], Mapping[str, float]]
SEED = 20261130
SWING, SWING_FREQUENCY, LOAD_NOISE = 0.1, 3.0, 0.002  # of the load; Hz; of the load


def _case(sample: int, number: int) -> tuple[Case, np.random.Generator]:
    random = np.random.default_rng([SEED, sample, number])
    return random_case(random, USUAL)[0], random


def _scene(case: Case, logs: list[float], effects: tuple[str, ...] = MAIN) -> Scene:
    entries = [{"path": f"log_{i}.csv", "drive_speed": speed} for i, speed in enumerate(logs, 1)]
    return Scene.from_document({"effects": list(effects), "rig": dict(case.rig), "logs": entries}, Path())


def _blocks(time: Array, force: Array) -> tuple[Array, Array]:
    """Means of four samples each; the clock of the first of each."""
    whole = time.size // 4 * 4
    return time[:whole:4], force[:whole].reshape(-1, 4).mean(axis=1)


def _resampled(time: Array, force: Array) -> tuple[Array, Array]:
    """At 0.83 of the rate, by straight lines."""
    new = np.linspace(time[0], time[-1], int(0.83 * time.size))
    return new, np.interp(new, time, force)


TREATMENTS: Mapping[str, Callable[[Array, Array], tuple[Array, Array]]] = {
    "average of 3": lambda t, f: (t, uniform_filter1d(f, 3)),
    "average of 5": lambda t, f: (t, uniform_filter1d(f, 5)),
    "average of 11": lambda t, f: (t, uniform_filter1d(f, 11)),
    "Butterworth": lambda t, f: (t, filtfilt(*butter(4, 0.1), f)),
    "Savitzky-Golay": lambda t, f: (t, savgol_filter(f, 15, 2)),
    "block average": _blocks,
    "resampled": _resampled,
}


def treated(number: int) -> tuple[Treated, str]:
    """Smoothed or resampled logs of a pair, by the treatments in turn."""
    kind = tuple(TREATMENTS)[number % len(TREATMENTS)]
    case, _ = _case(0, number // len(TREATMENTS))
    records = []
    for record in case.records[1:]:
        time, force = TREATMENTS[kind](record.time, record.friction_force)
        records.append(Record(time, np.full(time.size, record.normal_force[0]), force))
    return (_scene(case, [speed for speed, *_ in SPEEDS[1:]]), records, case.truth), kind


def _lines(record: Record) -> tuple[Array, Array, Array]:
    time, force = _resampled(record.time, record.friction_force)
    return time, np.full(time.size, record.normal_force[0]), force


COPIES: Mapping[str, Callable[[Record], Record]] = {
    "rounded": lambda r: replace(r, friction_force=np.round(r.friction_force, 2)),
    "shifted clock": lambda r: Record(r.time[7:] - r.time[7], r.normal_force[7:], r.friction_force[7:]),
    "other units": lambda r: replace(r, friction_force=np.round(1e3 * r.friction_force) / 1e3),
    "thinned": lambda r: Record(r.time[::2], r.normal_force[::2], r.friction_force[::2]),
    "resampled": lambda r: Record(*_lines(r)),
}


def copied(number: int) -> tuple[Treated, str]:
    """A pair of which one log was exported again, by the copies in turn; every third case a genuine repeat instead."""
    kind = "repeat" if number % 3 == 0 else tuple(COPIES)[number % len(COPIES)]
    case, random = _case(1, number)
    which = int(random.integers(2, len(case.records)))
    speed, duration, rate = SPEEDS[which]
    if kind == "repeat":
        more = recorded(run(assemble(MAIN), case.truth | case.rig, speed, 1.0, duration), rate, random)
    else:
        more = COPIES[kind](case.records[which])
    return (_scene(case, [*(v for v, *_ in SPEEDS[1:]), speed]), [*case.records[1:], more], case.truth), kind


def oscillating(number: int) -> Treated:
    """A load that swings by SWING, its column with LOAD_NOISE."""
    case, random = _case(2, number)
    effects, records = (*MAIN, "varying_normal_force"), []
    for speed, duration, rate in SPEEDS[1:]:
        frequency, phase = SWING_FREQUENCY * random.uniform(0.8, 1.2), random.uniform(0.0, 2.0 * np.pi)

        def load(t: Array, frequency: float = frequency, phase: float = phase) -> Array:
            return np.asarray(1.0 + SWING * np.sin(2.0 * np.pi * frequency * t + phase))

        time, fine = np.arange(round(duration * rate) + 1) / rate, np.linspace(0.0, duration, int(800 * duration) + 1)
        motion = run(assemble(effects), case.truth | case.rig, speed, NormalForce.of((fine, load(fine))), duration)
        noise = random.standard_normal((2, time.size))
        records.append(
            Record(time, load(time) + LOAD_NOISE * noise[0], motion.sample(time)["force"] + NOISE * noise[1])
        )
    return _scene(case, [speed for speed, *_ in SPEEDS[1:]], effects), records, case.truth


# What a scene allows for unless it says otherwise (relative; zeros in shares of the load).
USUAL_ERRORS = {"mass": 0.02, "stiffness": 0.02, "damping": 0.2, "speed": 0.01, "gain": 0.01, "zero": 0.005}


def toleranced(number: int) -> Treated:
    """Rig, drive speed, gains and zeros of both sensors off by what a scene allows for; one specimen."""
    case, random = _case(4, number)
    off = {name: sd * random.standard_normal(2) for name, sd in USUAL_ERRORS.items()}
    rig = {name: value * float(np.exp(off[name][0])) for name, value in case.rig.items()}
    records = []
    for record in case.records[1:]:
        force, load = (
            signal * (1.0 + off["gain"][i]) + off["zero"][i]
            for i, signal in enumerate((record.friction_force, record.normal_force))
        )
        records.append(Record(record.time, load, force))
    scene = _scene(replace(case, rig=rig), [speed * (1.0 + float(off["speed"][0])) for speed, *_ in SPEEDS[1:]])
    document = scene.as_document() | {"tolerances": {"specimen": 0}}
    return Scene.from_document(document, Path()), records, case.truth


SPECIMENS = (1e-4, 3e-4, 1e-3, 3e-3)  # m/s
SPECIMEN_NOISE = 3e-3  # N


def specimens(number: int) -> Treated:
    """Each speed in one log of its own specimen: friction, and its static part, scatter by 2 to 5 % from log to log."""
    random = np.random.default_rng([SEED, 3, number])
    mu_s = random.uniform(0.45, 0.8)
    truth = {"mu_s": mu_s, "mu_k0": mu_s - random.uniform(0.12, 0.25), "delta_mu_k": -random.uniform(0.04, 0.12)}
    for name, ends in (("a", (150.0, 600.0)), ("D", (20e-6, 60e-6)), ("t_cr", (0.15, 1.5))):
        truth[name] = float(np.exp(random.uniform(*np.log(ends))))
    scatter, logs, records = random.uniform(0.02, 0.05), [], []
    for speed in sorted(random.choice(SPECIMENS, random.integers(2, 5), replace=False)):
        gain, static = np.exp(scatter * random.standard_normal(2))
        own = {name: truth[name] * (gain if name in FRICTION[:3] else 1.0) for name in FRICTION}
        own["mu_s"] = own["mu_k0"] + (own["mu_s"] - own["mu_k0"]) * static
        duration = float(np.clip(8.0 * 0.2 / (RIG["stiffness"] * speed), 2.0, 40.0))
        rate = 1000.0 if speed > 5e-4 else 500.0  # Hz
        motion = run(assemble(MAIN), own | RIG, float(speed), 1.0, duration)
        records.append(recorded(motion, rate, random, SPECIMEN_NOISE))
        logs.append({"path": f"{1e3 * speed:g}_mm_per_s.csv", "drive_speed": float(speed)})
    document = {"effects": list(MAIN), "rig": RIG, "logs": logs, "tolerances": {"specimen": scatter}}
    return Scene.from_document(document), records, truth
