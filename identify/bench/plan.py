"""The plan: what is known of a pair, from its scene, its logs or its fit, and the few logs to record next."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import IdentifyError
from identify.base.quantiles import NORMAL
from identify.base.result import Result
from identify.bench.design import Knowledge, LogDesign, PlannedLog, choose, simulated_log
from identify.estimation.covariance import inverse
from identify.logs.log_data import LogData
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns, from_scene
from identify.model.model import RIG_PARAMETERS
from identify.prediction.sources import Origins, Pair, assumed, pair_of
from identify.scene import Scene
from identify.simulation.drive import Drive

Array = NDArray[np.float64]

PLACES = 4  # of the parameters at which logs are simulated: the likeliest and draws
NOISE = 0.005  # of the friction force, where nothing says how noisy the sensor is
LOAD_ERROR = 1e-3  # relative, of the normal force from cycle to cycle
SLOWEST_RATE = 50.0  # [Hz] that every tribometer samples at
BUDGET = 900.0  # [s] for all logs together
LONGEST = 300.0  # [s] of a log at one speed
BEYOND = 30.0  # times the fastest drive speed, and below the slowest
DIALS = tuple(float(f"{dial}e{decade}") for decade in range(-8, 1) for dial in (1, 3))  # drive speeds to set [m/s]
REPEATED_SLIPS = 10  # of a log that repeats a speed
FARTHEST = math.log(3.0)  # of a logarithm: how far draws go


@dataclass(frozen=True)
class Choices:
    """What can be set at the rig; what is empty is left to the default: speeds [m/s]; loads [N];
    stiffnesses of the springs there are [N/m]; fastest sampling rate [Hz]; targets, names of what is to be identified;
    budget for all logs [s]."""

    speeds: tuple[float, ...] = ()
    loads: tuple[float, ...] = ()
    stiffnesses: tuple[float, ...] = ()
    fastest: float = math.inf
    targets: tuple[str, ...] = ()
    budget: float = BUDGET


@dataclass(frozen=True)
class RecordingPlan:
    """What is known before, with the half lengths (d, k) of the 95 % intervals at each place, relative; the logs to
    record, in order; where the values of the parameters come from."""

    knowledge: Knowledge
    now: Array
    logs: tuple[PlannedLog, ...]
    origins: Origins

    @property
    def then(self) -> Array:
        """Half lengths (d, k) with all logs."""
        return self.logs[-1].halves if self.logs else self.now


def plan(scene: Scene, logs: Sequence[Prepared], choices: Choices, result: Result | None = None) -> RecordingPlan:
    """What to record next.

    Args:
        scene: its values are `fixed`, else `start`, else the documented default.
        logs: that are at hand, of a scene that was not fitted yet.
        result: of a converged fit of the scene, whose estimates stand in place of these values.

    Raises:
        IdentifyError: a target that is not searched, or no log of any design slips.
    """
    pair = Pair() if result is None else pair_of(result, scene, 0)
    if pair.untold:
        raise IdentifyError(f"{pair.untold}; plan from a scene without a fit instead")
    values = dict(scene.values()) | {n: v for n, v in pair.values.items() if n in scene.values()}
    taken = [log for log in (result.logs if result else ()) if not log.reason_left_out]
    stated = [scene.rig.normal_force] if scene.rig.normal_force else []
    loads = [log.normal_force_N for log in taken if log.normal_force_N] or stated or [log.mean_load for log in logs]
    load = float(choices.loads[0] if choices.loads else np.median(loads or [1.0]))
    knowledge = _knowledge(scene, values, load, logs, choices, pair, result)
    driven_at = [[speed for speed, _ in driven(log.data)] for log in logs]
    of_drives = [scene.rig.drive_speed, *(entry.drive_speed for entry in scene.logs)]
    listed = [abs(v) for drive in of_drives if drive is not None for v in Drive.of(drive).speeds if v]
    speeds = [speed for each in driven_at for speed in each] or listed or [1e-3]
    designs = [
        LogDesign(speed, force, spring)
        for spring in choices.stiffnesses or (None,)
        for force in choices.loads or (load,)
        for speed in choices.speeds or dialled(speeds)
    ]
    if all(knowledge.log(design) is None for design in designs):
        raise IdentifyError(
            "no log of any speed that was tried slips with the values of this scene; give starts in [parameters] that "
            "are nearer to the pair, a softer spring or a higher load (--stiffness, --load)"
        )
    lone = [each[0] for each in driven_at if len(each) == 1]
    lone = [abs(log.drive_speed_m_per_s) for log in taken if log.drive_speed_m_per_s] if result else lone
    alike = scene.tolerances.get("specimen") == 0.0 or len({f"{speed:.2g}" for speed in lone}) < max(len(lone), 2)
    chosen = choose(knowledge, designs, choices.budget, None if alike else _repeat(knowledge, sorted(lone), load))
    guessed = tuple(n for n in assumed(scene, values, pair.values) if n in values)
    measured = tuple(n for n in values if n in pair.names)
    origins = Origins(measured, tuple(n for n in values if n not in (*guessed, *measured)), guessed)
    return RecordingPlan(knowledge, knowledge.halves(knowledge.precision), tuple(chosen), origins)


def _knowledge(
    scene: Scene,
    values: Mapping[str, float],
    load: float,
    logs: Sequence[Prepared],
    choices: Choices,
    pair: Pair,
    result: Result | None,
) -> Knowledge:
    """What scene, logs or fit know."""
    unknowns = from_scene(scene)
    base = unknowns.base({name: float(getattr(scene.rig, name)) for name in RIG_PARAMETERS})
    theta = unknowns.theta(np.array([values[name] for name in unknowns.names]), base)
    free = np.flatnonzero(unknowns.free)
    kept = np.flatnonzero(~unknowns.own[free])
    names = [unknowns.names[i] for i in free[kept].tolist()]
    targets = choices.targets or tuple(name for name in names if name not in RIG_PARAMETERS)
    if missing := [name for name in targets if name not in names]:
        raise IdentifyError(f"{missing[0]} is not searched in this scene; expected one of {', '.join(names)}: free it")
    precision = unknowns.prior_precision[np.ix_(free, free)]
    systematic = np.zeros(kept.size)
    if pair.covariance is not None and result is not None:
        known = [i for i, name in enumerate(pair.names) if name in names and np.isfinite(pair.covariance[i, i])]
        at = kept[[names.index(pair.names[i]) for i in known]]
        size = np.where(unknowns.logarithmic, [values[n] for n in unknowns.names], 1.0)[free[at]]
        published = np.asarray(pair.covariance)[np.ix_(known, known)] / np.outer(size, size)
        # More logs lower the errors of noise, and not those of rig and sensors.
        share = np.array([_share_of_noise(result, pair.names[i]) for i in known])
        precision[np.ix_(at, at)] = inverse(published * np.sqrt(np.outer(share, share)))
        systematic[[kept.tolist().index(i) for i in at]] = np.diag(published) * (1.0 - share)
    places = drawn_places(unknowns, theta, precision, base)
    precisions = np.array([precision] * len(places))
    for place, there in enumerate(places):
        for log in logs:
            precisions[place] += _at_hand(unknowns, there, log)
    noise = scene.rig.noise or max((log.data.noise for log in logs), default=NOISE * values["mu_s"] * load)
    return Knowledge(
        unknowns,
        kept,
        targets,
        places,
        precisions[:, kept[:, None], kept[None, :]],
        systematic,
        base,
        noise**2,
        LOAD_ERROR,
        min([1.0 / log.data.interval for log in logs] or [SLOWEST_RATE]),
        LONGEST,
        fastest=choices.fastest,
    )


def _share_of_noise(result: Result, name: str) -> float:
    """The share of a published variance that is noise, the rig taken as exact."""
    entry = next((e for key, e in result.parameters.items() if name in (key, e.parameter)), None)
    low, high = (entry and entry.interval_rig_exact) or (None, None)
    if entry is None or entry.standard_error is None or low is None or high is None:
        return 1.0
    return min((0.5 * (high - low) / (NORMAL * entry.standard_error)) ** 2, 1.0)


def drawn_places(unknowns: Unknowns, theta: Array, precision: Array, base: Array) -> Array:
    """Theta (d, n_p): the likeliest, and draws of the free ones within bounds that make a pair.

    Args:
        precision: (f, f) of what is known; what nothing is known of is drawn over its usual spread.
    """
    random, free = np.random.default_rng(0), np.flatnonzero(unknowns.free)
    unknown = np.diag(precision) == 0.0
    variances, vectors = np.linalg.eigh(
        inverse(precision + np.diag(np.where(unknown, unknowns.spread[free] ** -2.0, 0.0)))
    )
    root, reach = vectors * np.sqrt(np.maximum(variances, 0.0)), np.where(unknowns.logarithmic[free], FARTHEST, np.inf)
    out = [theta]
    for _ in range(100 * PLACES):
        at = theta.copy()
        at[free] += np.clip(root @ random.standard_normal(free.size), -reach, reach)
        at[free] = np.clip(at[free], unknowns.lower[free], unknowns.upper[free])
        values = dict(zip(unknowns.names, unknowns.values(at, base).tolist(), strict=True))
        kinetic = values["mu_k0"] + min(values.get("delta_mu_k", 0.0), 0.0)
        if len(out) < PLACES and kinetic > 0.0 and values["mu_k0"] < values["mu_s"]:
            out.append(at)
    return np.array(out)


def _at_hand(unknowns: Unknowns, theta: Array, log: Prepared) -> Array:
    """Information (f, f) of the free theta that a log at hand is expected to hold, at every speed it was driven at."""
    count, data = int(np.count_nonzero(unknowns.free)), log.data
    total = np.zeros((count, count))
    for speed, seconds in driven(data):
        simulated = simulated_log(unknowns, theta, data.base, LogDesign(speed, log.mean_load), seconds)
        if simulated is not None:
            times = seconds / simulated.duration if simulated.slips else 1.0
            total += simulated.information(1.0 / data.interval, data.noise**2, data.normal_force_sd, times)
    return total


def driven(data: LogData) -> list[tuple[float, float]]:
    """At which speeds [m/s] a log was driven, and for how long each [s]; rests of the drive left out."""
    if data.programme is None:
        return [(data.drive_speed, data.end - data.begin)]
    starts = np.clip([*data.programme.starts, data.end], data.begin, data.end)
    pieces = zip(data.programme.speeds, np.diff(starts).tolist(), strict=True)
    return [(abs(speed), seconds) for speed, seconds in pieces if speed != 0.0 and seconds > 0.0]


def _repeat(knowledge: Knowledge, lone: Sequence[float], load: float) -> tuple[LogDesign, int] | None:
    """A log that repeats the middle one of speeds (rising) that stand in one log only."""
    for speed in sorted(lone, key=lambda speed: abs(math.log(speed / lone[len(lone) // 2]))):
        log = knowledge.log(design := LogDesign(speed, load))
        if log is not None and log.slips:
            return design, min(math.ceil(REPEATED_SLIPS / log.slips), max(int(LONGEST / log.duration), 1))
    return None


def dialled(speeds: Sequence[float]) -> list[float]:
    """Drive speeds that one would set about some [m/s], rising."""
    return [v for v in DIALS if min(speeds) / BEYOND <= v <= max(speeds) * BEYOND]
