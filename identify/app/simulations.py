"""What the page simulates while a person waits: tried values, what a fit would start from, an operating point."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.app.folder import Document, PageError
from identify.base.document import to_dict, to_document
from identify.base.result import LogResult, Result
from identify.estimation.preview import preview
from identify.logs.prepare import Segmented
from identify.logs.regime import Regime
from identify.logs.scene_records import with_drives, with_records
from identify.prediction.axes import Site, axis, known_axes, moved_values
from identify.prediction.predict import predict
from identify.prediction.sources import Tested, pair_of, scenes_at, site_of
from identify.scene import Scene
from identify.simulation.drive import Drive
from identify.simulation.simulate import run

Array = NDArray[np.float64]
POINTS = 1_000  # of a curve, and again of its slips
A_SLIP = (4, 120)  # fewest and most of them in a slip
ACCURACY = 1e-4  # of switch times and forces: finer than a line on a screen
LOADS = 200  # pieces of the load over time
ONE_AT_A_TIME = threading.Lock()  # compiled functions of a model are used by one thread
SPEED, LOAD = "drive_speed", "normal_force"


def tried(scene: Scene, log: Segmented, values: Mapping[str, float], chosen: range) -> Document:
    """Simulate some cycles (from 0) of a log with other values of the parameters.

    The simulation starts at an arrest, at rest, with the measured force in the spring and a fresh contact: what comes
    after is the model's.
    """
    cycles, model = log.phases.cycles, scene.model
    if not cycles.count:
        raise PageError("this log shows no slip to start from; choose another log or other cuts")
    if unknown := [name for name in values if name not in model.parameter_names]:
        raise PageError(f"the scene has no parameter {unknown[0]}; load the page again")
    first, last = (min(number, cycles.count - 1) for number in (chosen.start, chosen.stop))
    begin = float(cycles.arrest[first])
    end = float(cycles.arrest[last]) if last > first else float(log.time[-1])
    rows = slice(*np.searchsorted(log.time, [begin, end]))
    time, force, load = log.time[rows] - begin, log.measured[rows], log.load[rows]
    if time.size < 2:
        raise PageError("too few samples follow that slip; choose an earlier one")
    used = scene.values(log.entry) | dict(values)
    drive = Drive.of(tuple((max(at - begin, 0.0), speed) for at, speed in log.drive.within(begin, end)))
    start = {"elongation": float(cycles.arrest_force[first]) / used["stiffness"]}
    loading: tuple[Array, Array] | float = float(np.nanmean(load))
    if model.follows_load:  # in pieces
        sound = np.isfinite(load)
        count = int(np.count_nonzero(sound))
        edges = np.linspace(0, count, min(LOADS, count) + 1).astype(int)
        middles, means = (np.add.reduceat(v[sound], edges[:-1]) / np.diff(edges) for v in (time, load))
        loading = np.append(0.0, middles), np.append(means[0], means)
    with ONE_AT_A_TIME:
        motion = run(model, used, drive, loading, float(time[-1]), start=start, accuracy=ACCURACY)
        # Evenly over all of it, and evenly over every slip, however short.
        ends = np.append(motion.arrests, motion.duration)[np.searchsorted(motion.arrests, motion.onsets, side="right")]
        each = np.linspace(motion.onsets, ends, int(np.clip(POINTS // max(motion.onsets.size, 1), *A_SLIP)))
        at = np.unique(np.concatenate([np.linspace(0.0, motion.duration, POINTS), each.ravel()]))
        curve = motion.sample(at)
    onsets = cycles.onset[(cycles.onset > begin) & (cycles.onset < end)] - begin
    both, step = min(onsets.size, motion.onsets.size), max(1, -(-time.size // (2 * POINTS)))
    sliding, coefficient = curve["sliding"] > 0.5, curve["coefficient"]
    document = {
        "begin": begin,
        "measured": {"time": time[::step], "force": force[::step]},
        "simulated": {
            "time": at,
            "force": curve["force"],
            "speed": curve.get("sliding_speed", np.full(at.size, np.nan)),
            "coefficient": np.where(sliding, coefficient, np.nan),
        },
        "rms": float(np.sqrt(np.nanmean((np.interp(time, at, curve["force"]) - force) ** 2))),
        "noise": log.noise,
        "slips": {"measured": last - first, "simulated": int(motion.onsets.size)},
        "late": float(np.median(motion.onsets[:both] - onsets[:both])) if both else None,
        "uneven": log.verdict.regime is Regime.UNEVEN_STICK_SLIP,
    }
    return to_dict(document)


def start_from_data(scene: Scene) -> Document:
    """What a fit would start from, without a fit: the parameters (SI) and where they come from."""
    with ONE_AT_A_TIME:
        settled, _ = with_drives(scene)
        settled, records = with_records(settled, None)
        seen = preview(settled, records)
    return to_dict({"source": seen.source, "values": seen.parameters})


def site_at(scene: Scene, result: Result | None, number: int) -> Site:
    """The operating point of a log (from 0) of a scene, with the values of a fit where there is one."""
    entry, log, values = scene.logs[number] if number < len(scene.logs) else None, LogResult(), dict[str, float]()
    if result is not None:
        number = min(number, len(result.logs) - 1)
        log, pair = result.logs[number], pair_of(result, number)
        if pair.refusal or not pair.values:
            raise PageError(pair.refusal or "this fit has no values; correct the fit first")
        values = dict(pair.values)
    return site_of(scenes_at(scene, entry, log, values)[0])


def axes_of(site: Site) -> list[Document]:
    """The quantities a map can be over, with their values here."""
    names = [name for name in known_axes(site.model) if site.area is not None or name not in ("area", "pressure")]
    keys = ("name", "label", "unit", "value", "logarithmic")
    return [{key: getattr(axis(site, name), key) for key in keys} for name in names]


def answer_at(site: Site, result: Result | None, changes: Mapping[str, float]) -> Document:
    """Outcome, numbers and words at a point, what of it no log tested, and the drive speeds [m/s] at which the outcome
    changes.
    """
    if len(changes) > 4 or any(name not in known_axes(site.model) for name in changes):
        raise PageError("an operating point is changed by quantities of the map only; load the page again")
    moved = moved_values(site, dict(changes))
    values = {name: float(moved[name]) for name in site.model.parameter_names}
    speed, load = float(moved.get(SPEED, site.drive_speed)), float(moved.get(LOAD, site.normal_force))
    with ONE_AT_A_TIME:
        answer = predict(replace(site, values=values, drive_speed=speed, normal_force=load))
    tested = None if result is None else Tested.of_result(result)
    document = {
        "outcome": answer.stability.outcome,
        "text": answer.text,
        "beyond": tested.beyond({SPEED: speed, LOAD: load, "stiffness": values["stiffness"]}) if tested else "",
        "tested": {name: list(span) for name, span in tested.ranges.items()} if tested else {},
        "numbers": to_document(answer.amplitude.numbers),
        "ends": [window.high for window in answer.stability.windows[:-1]],
    }
    return to_dict(document)
