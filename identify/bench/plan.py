"""The plan: what the logs at hand tell, the few logs to record next, and what a wrong rig would do to their answer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import IdentifyError
from identify.base.quantiles import NORMAL
from identify.bench.designs import Knowledge, PlannedLog, Rehearsals, base_of, choose, dials, driven, told_by
from identify.bench.rehearsal import LogDesign, at_rest, rehearse
from identify.estimation.covariance import inverse
from identify.estimation.tolerances import by_drive_speed
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns, from_scene
from identify.model.model import RIG_PARAMETERS
from identify.prediction.sources import Pair
from identify.scene import Scene
from identify.simulation.drive import Drive

Array = NDArray[np.float64]

PLACES = 6  # of the parameters, at which logs are rehearsed: the likeliest and draws
SEED = 0
NOISE = 0.005  # of the friction force: where nothing says how noisy the sensor is
LOAD_ERROR = 1e-3  # relative, of the normal force from cycle to cycle
SLOWEST_RATE = 50.0  # [Hz] that every tribometer samples at
SETUP = 60.0  # [s] that a log costs beside its duration
MOST = 6  # logs
LONGEST = 300.0  # [s] of a log at one speed
BEYOND = 30.0  # times the drive speed of the scene, up and down
DIALS = (1.0, 3.0)  # of a decade
HOLDS = (1.0, 3.0, 10.0), (10.0, 30.0, 100.0)  # [s]
ENDS, LONGEST_RUN = 120, 1.5  # of a run between holds, that are looked at; up to so many of the longest first cycles
CLEAR = 0.25  # of a stick: an end of a run that far from its slips is clear
ALMOST = 0.95  # of the best end: the earliest that is as good is taken
WRONG = 0.05  # relative, of which the price is told
PRICED = ("mass", "stiffness", "damping", "drive_speed")
MOST_PLACES = 0.8  # of the places, at which what is promised is reached: a median is right for every second pair only
REACH = math.log(3.0)  # of a logarithm: how far draws go


@dataclass(frozen=True)
class Choices:
    """What can be set at the rig, empty or None: the default. speeds [m/s], holds [s] of one log, loads [N],
    stiffnesses of the springs there are [N/m], fastest sampling rate [Hz], noise of a sample [N], load_error: relative;
    asked: names of what is to be told; budget: for all logs [s]."""

    speeds: tuple[float, ...] = ()
    holds: tuple[float, ...] = ()
    loads: tuple[float, ...] = ()
    stiffnesses: tuple[float, ...] = ()
    fastest: float = math.inf
    noise: float | None = None
    load_error: float | None = None
    asked: tuple[str, ...] = ()
    budget: float = 900.0


@dataclass(frozen=True)
class RecordingPlan:
    """knowledge before; now (k,): half lengths of the 95 % intervals at most places, as shares of what each is judged
    by; logs to record; drop_now, drop_then: half lengths of the mean drop at the drive speed of the scene, as shares,
    NaN where no slip was rehearsed; price: by name of what is 5 % wrong, by how much each parameter (k,) would move, as
    the same shares; tolerances: of the rig as stated, relative."""

    knowledge: Knowledge
    now: Array
    logs: tuple[PlannedLog, ...]
    drop_speed: float
    drop_now: float
    drop_then: float
    price: Mapping[str, Array]
    tolerances: Mapping[str, float] = field(default_factory=dict)

    @property
    def then(self) -> Array:
        """Half lengths (k,) with all logs."""
        return self.logs[-1].halves if self.logs else self.now

    @property
    def seconds(self) -> float:
        """That all logs take, setting each up included [s]."""
        return sum(log.duration + SETUP for log in self.logs)


def plan(scene: Scene, logs: Sequence[Prepared], choices: Choices, fitted: Pair | None = None) -> RecordingPlan:
    """What to record next.

    Args:
        scene: with values of everything: fixed, else start, else the documented default.
        logs: that are at hand, of a scene that was not fitted yet.
        choices: what can be set.
        fitted: the values of a fit and their covariance, in place of those of the scene.

    Raises:
        IdentifyError: nothing that is asked for is searched, or no log of any design slips.
    """
    known = _knowledge(scene, logs, choices, fitted)
    load = _load(scene, logs, choices)
    speed = _speed(scene, logs)
    designs = _designs(known, speed, load, choices)
    tried = Rehearsals(known)
    if all(tried.at(design, 0) is None for design in designs):
        raise IdentifyError(
            "no log of any speed that was tried slips with the values of this scene; give starts in [parameters] that "
            "are nearer to the pair, a softer spring or a higher load (--stiffness, --load)"
        )
    chosen = tuple(choose(tried, designs, choices.budget, SETUP, MOST))
    then = known.known + sum((tried.all(log.design, log.times) for log in chosen), start=np.zeros(()))
    at_speed = min(designs, key=lambda design: abs(math.log(design.speed / speed)) + bool(design.holds))
    drop_now, drop_then = (_drop(tried, at_speed, precision[0]) for precision in (known.known, then))
    price = _price(tried, chosen, logs) if chosen else {}
    now = known.halves(known.known)
    return RecordingPlan(known, now, chosen, at_speed.speed, drop_now, drop_then, price, dict(scene.rig.tolerances))


def _knowledge(scene: Scene, logs: Sequence[Prepared], choices: Choices, fitted: Pair | None) -> Knowledge:
    """What scene, logs or fit know."""
    unknowns, values = from_scene(scene), dict(scene.values())
    values |= {name: value for name, value in (fitted.values if fitted else {}).items() if name in values}
    base = unknowns.base({name: float(getattr(scene.rig, name)) for name in RIG_PARAMETERS})
    theta = unknowns.theta(np.array([values[name] for name in unknowns.names]), base)
    free = np.flatnonzero(unknowns.free)
    kept = np.flatnonzero(~unknowns.own[free])
    names = [unknowns.names[i] for i in free[kept].tolist()]
    asked = choices.asked or tuple(name for name in names if name not in RIG_PARAMETERS)
    if missing := [name for name in asked if name not in names]:
        raise IdentifyError(f"{missing[0]} is not searched in this scene; expected one of {', '.join(names)}: free it")
    distance = 2.0 * (values["mu_s"] - values["mu_k0"]) * _load(scene, logs, choices) / values["stiffness"]
    precision = unknowns.prior_precision[np.ix_(free, free)]
    open_ = np.where(np.isfinite(unknowns.prior_sd), np.inf, unknowns.spread)[free]
    covariance = inverse(precision + np.diag(open_**-2.0))
    if fitted is not None and fitted.covariance is not None:
        # What the fit does not tell has an infinite variance there: as open as before it.
        finite = np.isfinite(np.diag(fitted.covariance))
        mine = [i for i, name in enumerate(fitted.names) if name in names and finite[i]]
        told = [names.index(fitted.names[i]) for i in mine]
        size = np.where(unknowns.logarithmic, np.array([values[n] for n in unknowns.names]), 1.0)[free[kept[told]]]
        known = np.asarray(fitted.covariance)[np.ix_(mine, mine)] / np.outer(size, size)
        covariance[np.ix_(kept[told], kept[told])] = known
        precision[np.ix_(kept[told], kept[told])] = inverse(known)
    places = _places(unknowns, theta, covariance, base)
    precisions = np.array([precision] * len(places))
    for place, at in enumerate(places):
        for log in logs:
            precisions[place] += told_by(unknowns, at, log, log.data.normal_force_sd, distance)
    noise = choices.noise or scene.rig.noise or (max(log.data.noise for log in logs) if logs else None)
    return Knowledge(
        unknowns,
        kept,
        asked,
        places,
        precisions[:, kept[:, None], kept[None, :]],
        base,
        (noise or NOISE * values["mu_s"] * _load(scene, logs, choices)) ** 2,
        LOAD_ERROR if choices.load_error is None else choices.load_error,
        min([1.0 / log.data.interval for log in logs] or [SLOWEST_RATE]),
        distance,
        LONGEST,
        fastest=choices.fastest,
        most=MOST_PLACES,
    )


def _places(unknowns: Unknowns, theta: Array, covariance: Array, base: Array) -> Array:
    """Theta (d, n_p): the likeliest, and draws of the free ones within bounds that make a pair."""
    random, free = np.random.default_rng(SEED), np.flatnonzero(unknowns.free)
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    reach = np.where(unknowns.logarithmic[free], REACH, np.inf)
    out = [theta]
    for _ in range(100 * PLACES):
        at = theta.copy()
        at[free] += np.clip(root @ random.standard_normal(free.size), -reach, reach)
        at[free] = np.clip(at[free], unknowns.lower[free], unknowns.upper[free])
        if len(out) < PLACES and _is_pair(dict(zip(unknowns.names, unknowns.values(at, base).tolist(), strict=True))):
            out.append(at)
    return np.array(out)


def _is_pair(values: Mapping[str, float]) -> bool:
    """Whether friction is lower in motion than at rest, and above zero at any speed."""
    kinetic, change = values["mu_k0"], values.get("delta_mu_k", 0.0)
    return 0.0 < kinetic < values["mu_s"] and kinetic + change > 0.0


def _load(scene: Scene, logs: Sequence[Prepared], choices: Choices) -> float:
    loads = [log.mean_load for log in logs]
    known = [*choices.loads[:1], *([scene.rig.normal_force] if scene.rig.normal_force else []), *loads]
    return float(known[0]) if known else 1.0


def _speed(scene: Scene, logs: Sequence[Prepared]) -> float:
    """The drive speed that the scene is about [m/s]."""
    if logs:
        speeds = [speed for log in logs for speed, _ in driven(log.data)]
    else:
        stated = [scene.rig.drive_speed, *(entry.drive_speed for entry in scene.logs)]
        speeds = [abs(v) for drive in stated if drive is not None for v in Drive.of(drive).speeds if v]
    return float(np.exp(np.mean(np.log(speeds)))) if speeds else 1e-3


def _designs(known: Knowledge, speed: float, load: float, choices: Choices) -> list[LogDesign]:
    """Among which is chosen: steady drives, and drives with holds, at about three times the speed of the scene."""
    speeds = choices.speeds or tuple(dials(speed / BEYOND, speed * BEYOND, DIALS))
    out = []
    for spring in choices.stiffnesses or (None,):
        for normal_force in choices.loads or (load,):
            out += [LogDesign(v, normal_force, spring) for v in speeds]
            fast = min(speeds, key=lambda v: abs(math.log(v / (3.0 * speed))))
            steady = LogDesign(fast, normal_force, spring)
            out += [with_holds(known, steady, holds) for holds in ((choices.holds,) if choices.holds else HOLDS)]
    return out


def with_holds(known: Knowledge, steady: LogDesign, holds: Sequence[float]) -> LogDesign:
    """A drive that stands for so long each [s] between runs that end in a stick, after a slip at least: clear of any
    slip at the likeliest place, and at the others as far as can be. A slip in which the drive stops, or that begins
    just before, is another one where the pair is a little different. Where it slides on, runs reach past the peak."""
    base, unknowns = base_of(known.unknowns, known.base, steady), known.unknowns
    values = [dict(zip(unknowns.names, unknowns.values(at, base).tolist(), strict=True)) for at in known.places]
    # As far as the spring is pulled and let go at most, in a slip that meets the friction of a fast one all along.
    weakest = [v["mu_k0"] + min(v.get("delta_mu_k", 0.0), 0.0) for v in values]
    reach = max((3.0 * v["mu_s"] - 2.0 * w) / v["stiffness"] for v, w in zip(values, weakest, strict=True))
    longest = reach * steady.normal_force / steady.speed  # a first cycle
    runs = np.linspace(0.0, LONGEST_RUN * longest, ENDS)[1:]
    programme, at = list[tuple[float, float]](), 0.0
    for hold in (*holds, 0.0):
        programme.append((at, steady.speed))
        run = replace(steady, drive=tuple(programme))
        clear = np.minimum([at_rest(unknowns, theta, base, run, at + runs) for theta in known.places], CLEAR)
        score = np.where(clear[0] >= np.max(clear[0]), np.mean(clear, axis=0), -1.0)
        at += float(runs[int(np.argmax(score >= ALMOST * np.max(score)))]) if np.any(score > 0.0) else longest
        programme += [(at, 0.0)] if hold else []
        at += hold
    return replace(steady, drive=tuple(programme), duration=at)


def _drop(tried: Rehearsals, design: LogDesign, precision: Array) -> float:
    """Half length of the 95 % interval of the mean drop in a log of this design, as a share of it."""
    made = tried.at(design, 0)
    if made is None or not made.drop > 0.0:
        return math.nan
    slopes = made.drop_slopes[tried.knowledge.kept] / made.drop
    return float(NORMAL * np.sqrt(slopes @ inverse(precision) @ slopes))


def _price(tried: Rehearsals, chosen: Sequence[PlannedLog], logs: Sequence[Prepared]) -> dict[str, Array]:
    """By how much each parameter (k,) moves, as shares of what it is judged by, where the rig is wrong by 5 % and the
    fit does not know: linear, from the information of all parameters together at the likeliest place."""
    k = tried.knowledge
    unknowns, theta = k.unknowns, k.places[0]
    rig = np.array([name in RIG_PARAMETERS for name in unknowns.names])
    values = unknowns.values(theta, k.base)
    wide = replace(unknowns, free=unknowns.free | (rig & (values > 0.0)))
    free = np.flatnonzero(wide.free)
    held = [told_by(wide, theta, log, log.data.normal_force_sd, k.distance) for log in logs]
    total = np.asarray(sum(held, start=np.zeros((free.size, free.size))))
    for log in chosen:
        made = rehearse(wide, theta, base_of(unknowns, k.base, log.design), log.design, k.distance, k.longest)
        if made is not None:
            seconds = max(1.0 / log.rate, k.apart)
            load_sd = k.load_error * log.design.normal_force
            total += made.information(1.0 / seconds, k.variance, load_sd, log.times)
    searched = [free.tolist().index(i) for i in np.flatnonzero(unknowns.free)[k.kept].tolist()]
    friction = [place for place in searched if not rig[free[place]]]
    directions = {unknowns.names[i]: np.eye(free.size)[place] for place, i in enumerate(free.tolist()) if rig[i]}
    directions["drive_speed"] = by_drive_speed(wide, values)[free]
    inner, out = inverse(total[np.ix_(friction, friction)]), {}
    for name in (name for name in PRICED if name in directions):
        # The rig is held, wrong: what is searched takes up the error as far as the data let it.
        shift = np.zeros(free.size)
        shift[friction] = inner @ total[friction] @ (WRONG * directions[name])
        out[name] = np.abs(shift[searched]) / k.sizes(theta)
    return out
