"""Trying values: the simulated force over the measured one from one arrest on, and what a fit would start from."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.app.folder import PageError
from identify.estimation.starts import preview
from identify.logs.regime import Regime
from identify.logs.scene_records import with_drives, with_records
from identify.logs.segmented import Segmented
from identify.report.stored_result import plain
from identify.scene import Scene
from identify.scene.values import LogEntry
from identify.simulation.cost import cost
from identify.simulation.drive import Drive
from identify.simulation.simulate import run, simulate

Array = NDArray[np.float64]
POINTS = 1_000  # of a curve, and again of its slips
A_SLIP = (4, 40)  # fewest and most of them in a slip
ACCURACY = 1e-4  # of switch times and forces: finer than a line on a screen
CYCLES = 4.0  # of a simulation whose time is taken
MODERATE = 1e-3  # drive speed where the scene says none [m/s]
LOADS = 200  # pieces of the course of the load
ONE_AT_A_TIME = threading.Lock()  # compiled functions of a model are used by one thread


@dataclass(frozen=True)
class TriedCycles:
    """The cycles of a log that are tried: how many, from which on (from 0)."""

    first: int = 0
    count: int = 8


def tried(
    scene: Scene, entry: LogEntry, log: Segmented, values: Mapping[str, float], stretch: TriedCycles
) -> dict[str, Any]:
    """Simulate some cycles of a log with other values of the parameters.

    The simulation starts at an arrest, at rest, with the measured force in the spring and a fresh contact: what comes
    after is the model's.

    Raises:
        PageError: no cycle to start at, or an unknown parameter. SimulationError: what the model refuses.
    """
    cycles, model = log.found.cycles, scene.model
    if not cycles.count:
        raise PageError("this log shows no slip to start from; choose another log or other cuts")
    unknown = [name for name in values if name not in model.parameter_names]
    if unknown:
        raise PageError(f"the scene has no parameter {unknown[0]}; load the page again")
    first = min(max(stretch.first, 0), cycles.count - 1)
    begin = float(cycles.arrest[first])
    last = min(first + max(stretch.count, 1), cycles.count - 1)
    end = float(cycles.arrest[last]) if last > first else float(log.time[-1])
    rows = slice(*np.searchsorted(log.time, [begin, end]))
    time, force, load = log.time[rows] - begin, log.measured[rows], log.load[rows]
    if time.size < 2:
        raise PageError("too few samples follow that slip; choose an earlier one")
    used = scene.values(entry) | dict(values)
    drive = Drive.of(tuple((max(at - begin, 0.0), speed) for at, speed in log.drive.within(begin, end)))
    start = {"elongation": float(cycles.arrest_force[first]) / used["stiffness"]}
    with ONE_AT_A_TIME:
        made = run(
            model, used, drive, _course(time, load, model.follows_load), float(time[-1]), start=start, accuracy=ACCURACY
        )
        at = _instants(made.duration, made.onsets, made.arrests)
        curve = made.sample(at)
    off = np.interp(time, at, curve["force"]) - force
    measured = cycles.onset[(cycles.onset > begin) & (cycles.onset < end)] - begin
    both = min(measured.size, made.onsets.size)
    step = max(1, -(-time.size // (2 * POINTS)))
    document = {
        "begin": begin,
        "measured": {"time": time[::step], "force": force[::step]},
        "simulated": {
            "time": at,
            "force": curve["force"],
            "speed": curve.get("sliding_speed", np.full(at.size, np.nan)),
            "coefficient": np.where(curve["sliding"] > 0.5, curve["coefficient"], np.nan),
            "rest_coefficient": np.where(curve["sliding"] > 0.5, np.nan, curve["coefficient"]),
        },
        "strength": _strength(made.onsets, made.arrests, curve, at),
        "rms": float(np.sqrt(np.nanmean(off**2))),
        "noise": log.noise,
        "slips": {"measured": int(last - first), "simulated": int(made.onsets.size)},
        "late": float(np.median(made.onsets[:both] - measured[:both])) if both else None,
        "uneven": log.verdict.regime is Regime.UNEVEN_STICK_SLIP,
    }
    return dict(plain(document))


def _instants(duration: float, onsets: Array, arrests: Array) -> Array:
    """Instants that show a simulation: evenly over all of it, and evenly over every slip, however short."""
    ends = np.append(arrests, duration)[np.searchsorted(arrests, onsets, side="right")]
    each = int(np.clip(POINTS // max(onsets.size, 1), *A_SLIP))
    return np.unique(np.concatenate([np.linspace(0.0, duration, POINTS), np.linspace(onsets, ends, each).ravel()]))


def _course(time: Array, load: Array, follows: bool) -> float | tuple[Array, Array]:
    """The load that the simulation gets: its mean, or its course in pieces where the model follows it."""
    if not follows:
        return float(np.nanmean(load))
    sound = np.isfinite(load)
    time, load = time[sound], load[sound]
    edges = np.linspace(0, time.size, min(LOADS, time.size) + 1).astype(int)
    middles, means = (np.add.reduceat(values, edges[:-1]) / np.diff(edges) for values in (time, load))
    return np.append(0.0, middles), np.append(means[0], means)


def _strength(onsets: Array, arrests: Array, curve: Mapping[str, Array], at: Array) -> list[list[float]]:
    """Rest before each simulated onset [s], and the friction coefficient there."""
    begins = np.concatenate([[0.0], arrests])
    rests = [float(onset - begins[begins < onset][-1]) for onset in onsets]
    there = np.interp(onsets, at, curve["coefficient"])
    return [[rest, float(value)] for rest, value in zip(rests, there, strict=True)]


def costs(scene: Scene, entry: LogEntry) -> dict[str, Any]:
    """Milliseconds of a simulated cycle that each effect of the scene takes, at the highest speed of a log, and what
    other accuracies would cost, in words.

    Raises:
        SceneError, SimulationError: a scene that cannot be simulated.
    """
    rig = scene.rig_for(entry)
    speed = max(abs(v) for _, v in rig.drive_speed) if isinstance(rig.drive_speed, tuple) else abs(rig.drive_speed or 0)
    driven = replace(scene, rig=replace(rig, drive_speed=speed or MODERATE, normal_force=rig.normal_force or 1.0))
    values = driven.values(entry)
    gap = abs(values["mu_s"] - values["mu_k0"]) * (driven.rig.normal_force or 1.0)
    period = 4.0 * gap / (values["stiffness"] * (speed or MODERATE))
    with ONE_AT_A_TIME:
        since = process_time()
        motion = simulate(driven, CYCLES * period, accuracy=ACCURACY).refined()
        found = cost(driven, motion, process_time() - since)
    scale = 1e3 / max(motion.onsets.size, 1)
    slips = f"Simulating {motion.onsets.size} slips: {found.text}."
    return {"effects": {name: scale * seconds for name, seconds in found.effects.items()}, "text": slips}


def start_from_data(scene: Scene) -> dict[str, Any]:
    """What a fit would start from, without a fit: the parameters (SI) and where they come from.

    Raises:
        FitError, SceneError, LogError: one sentence.
    """
    with ONE_AT_A_TIME:
        settled, _ = with_drives(scene)
        settled, records = with_records(settled, None)
        seen = preview(settled, records)
    return dict(plain({"source": seen.source, "values": seen.parameters, "logs": [log.told for log in seen.logs]}))
