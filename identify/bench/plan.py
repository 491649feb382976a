"""The plan: what is known of a pair, from its scene, its logs or its fit, and the few logs to record next; in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import IdentifyError
from identify.base.quantiles import NORMAL
from identify.base.result import Result
from identify.base.wording import columns, speed_text, three_figures, wrapped
from identify.bench.design import SETUP, Knowledge, LogDesign, PlannedLog, choose, promised, simulated_log
from identify.estimation.covariance import IDENTIFIED, WEAK, inverse
from identify.logs.log_data import LogData
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns, from_scene
from identify.model.model import RIG_PARAMETERS
from identify.prediction.cycles import check_calculable
from identify.prediction.sources import Origins, Pair, assumed, pair_of
from identify.prediction.wording import listed
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
HOLDS = (0.3, 1.0, 3.0)  # of the creep time, that a drive is to stand between slips


@dataclass(frozen=True)
class Choices:
    """What can be set at the rig, empty for the default: speeds [m/s], loads [N], stiffnesses of springs [N/m], fastest
    sampling rate [Hz]; targets: names of what is to be identified; budget for all logs [s]; holds: whether the drive
    can stand within a log."""

    speeds: tuple[float, ...] = ()
    loads: tuple[float, ...] = ()
    stiffnesses: tuple[float, ...] = ()
    fastest: float = math.inf
    targets: tuple[str, ...] = ()
    budget: float = BUDGET
    holds: bool = True


@dataclass(frozen=True)
class HoldSeries:
    """A slide-hold-slide log: how long the drive stands [s], each once, and the half lengths (d, k) with it."""

    seconds: tuple[float, ...]
    halves: Array

    @property
    def words(self) -> str:
        """What to do."""
        times = ", ".join(f"{seconds:g}" for seconds in self.seconds)
        return f"slide-hold-slide: let the drive stand for {times} s in one of these logs, each time in a stick"


@dataclass(frozen=True)
class RecordingPlan:
    """What is known before, with the half lengths (d, k) of the 95 % intervals at each place, relative; the logs to
    record, in order; where the values of the parameters come from; holds: of the drive, where they tell t_cr."""

    knowledge: Knowledge
    now: Array
    logs: tuple[PlannedLog, ...]
    origins: Origins
    holds: HoldSeries | None = None

    @property
    def then(self) -> Array:
        """Half lengths (d, k) with all logs and holds."""
        return self.holds.halves if self.holds is not None else self.logs[-1].halves if self.logs else self.now

    @property
    def seconds(self) -> float:
        """That all logs take, setting each up and holds included."""
        return sum(log.duration + SETUP for log in self.logs) + sum(self.holds.seconds if self.holds else ())


def plan(scene: Scene, logs: Sequence[Prepared], choices: Choices, result: Result | None = None) -> RecordingPlan:
    """What to record next.

    Args:
        scene: its values are `fixed`, else `start`, else the documented default.
        logs: that are at hand, of a scene that was not fitted yet.
        result: of a converged fit of the scene, whose estimates stand in place of these values.

    Raises:
        IdentifyError: a target that is not searched, a model without cycles, or no log of any design slips.
    """
    check_calculable(scene.model)
    pair = Pair() if result is None else pair_of(result, 0)
    if pair.refusal:
        raise IdentifyError(f"{pair.refusal}; plan from a scene without a fit instead")
    values = dict(scene.values()) | {n: v for n, v in pair.values.items() if n in scene.values()}
    taken = [log for log in (result.logs if result else ()) if not log.reason_left_out]
    stated = [scene.rig.normal_force] if scene.rig.normal_force else []
    loads = [log.normal_force_N for log in taken if log.normal_force_N] or stated or [log.mean_load for log in logs]
    load = float(choices.loads[0] if choices.loads else np.median(loads or [1.0]))
    knowledge = _knowledge(scene, values, load, logs, choices, pair, result)
    driven_at = [[speed for speed, _ in driven(log.data)] for log in logs]
    of_drives = [scene.rig.drive_speed, *(entry.drive_speed for entry in scene.logs)]
    stated_speeds = [abs(v) for drive in of_drives if drive is not None for _, v in Drive.of(drive).paces if v]
    speeds = [speed for each in driven_at for speed in each] or stated_speeds or [1e-3]
    dialled = [v for v in DIALS if min(speeds) / BEYOND <= v <= max(speeds) * BEYOND]
    every = product(choices.speeds or dialled, choices.loads or (load,), choices.stiffnesses or (None,))
    designs = [LogDesign(*each) for each in every]
    if all(knowledge.log(design) is None for design in designs):
        raise IdentifyError(
            "no log of any speed that was tried slips with the values of this scene; give starts in [parameters] that "
            "are nearer to the pair, a softer spring or a higher load (--stiffness, --load)"
        )
    lone = [each[0] for each in driven_at if len(each) == 1]
    lone = sorted([abs(log.drive_speed_m_per_s) for log in taken if log.drive_speed_m_per_s] if result else lone)
    alike = scene.tolerances.get("specimen") == 0.0 or len({f"{speed:.2g}" for speed in lone}) < max(len(lone), 2)
    repeat = None
    for speed in [] if alike else sorted(lone, key=lambda speed: abs(math.log(speed / lone[len(lone) // 2]))):
        log = knowledge.log(again := LogDesign(speed, load))  # of the middle one that slips
        if repeat is None and log is not None:
            repeat = again, max(min(REPEATED_SLIPS, int(log.count(LONGEST))), 1)
    chosen = choose(knowledge, designs, choices.budget, repeat)
    guessed = tuple(n for n in assumed(scene, values, pair.values) if n in values)
    measured = tuple(n for n in values if n in pair.names)
    origins = Origins(measured, tuple(n for n in values if n not in (*guessed, *measured)), guessed)
    left = choices.budget - sum(log.duration + SETUP for log in chosen) if choices.holds else 0.0
    holds = hold_series(knowledge, {log.design: log.slips for log in chosen}, load, left)
    return RecordingPlan(knowledge, knowledge.halves(knowledge.precision), tuple(chosen), origins, holds)


def hold_series(knowledge: Knowledge, logs: Mapping[LogDesign, int], load: float, budget: float) -> HoldSeries | None:
    """Holds about the creep time, by the static peak after each (eqs. 3 and 5); None where t_cr is no target, known
    well enough with the logs, not told by holds, or they take longer than the budget [s]."""
    names, index, precision = knowledge.names, knowledge.index, knowledge.with_logs(logs)
    before = promised(knowledge.halves(precision))
    if "t_cr" not in [names[i] for i in knowledge.targeted] or before[own := names.index("t_cr")] <= IDENTIFIED:
        return None
    unknowns, information = knowledge.unknowns, np.zeros_like(precision)
    all_values = [unknowns.values(theta, knowledge.base) for theta in knowledge.places]
    places = [dict(zip(unknowns.names, values.tolist(), strict=True)) for values in all_values]
    creep = float(np.exp(np.median(np.log([p["t_cr"] for p in places]))))
    seconds = tuple(float(f"{share * creep:.1g}") for share in HOLDS)
    for total, values, p in zip(information, all_values, places, strict=True):
        variance = knowledge.noise**2 + (knowledge.load_error * load * p["mu_s"]) ** 2
        for hold in seconds:
            fresh = math.exp(-hold / p["t_cr"])
            moves = {"mu_s": 1.0 - fresh, "mu_k0": fresh}
            moves["t_cr"] = -(p["mu_s"] - p["mu_k0"]) * fresh * hold / p["t_cr"] ** 2
            slopes = load * np.array([moves.get(name, 0.0) for name in names])
            slopes *= np.where(unknowns.logarithmic, values, 1.0)[index]
            total += np.outer(slopes, slopes) / variance
    halves = knowledge.halves(precision + information)
    return HoldSeries(seconds, halves) if sum(seconds) <= budget and promised(halves)[own] < 0.8 * before[own] else None


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
    precision, systematic = unknowns.prior_precision[np.ix_(free, free)], np.zeros(kept.size)
    if pair.covariance is not None and result is not None:
        known = [i for i, name in enumerate(pair.names) if name in names and np.isfinite(pair.covariance[i, i])]
        places = [names.index(pair.names[i]) for i in known]
        at = kept[places]
        size = np.where(unknowns.logarithmic, [values[n] for n in unknowns.names], 1.0)[free[at]]
        published = np.asarray(pair.covariance)[np.ix_(known, known)] / np.outer(size, size)
        # More logs lower the errors of noise, and not those of rig and sensors.
        share = np.ones(len(known))
        for number, name in enumerate(pair.names[i] for i in known):
            entry = next((e for key, e in result.parameters.items() if name in (key, e.parameter)), None)
            low, high = (entry and entry.interval_rig_exact) or (None, None)
            if entry and entry.standard_error is not None and low is not None and high is not None:
                share[number] = min((0.5 * (high - low) / (NORMAL * entry.standard_error)) ** 2, 1.0)
        precision[np.ix_(at, at)] = inverse(published * np.sqrt(np.outer(share, share)))
        systematic[places] = np.diag(published) * (1.0 - share)
    noises = [log.noise_N for log in (result.logs if result else ()) if log.noise_N]
    noises += [log.data.noise for log in logs]
    drawn = drawn_places(unknowns, theta, precision, base)
    precisions = np.array([precision] * len(drawn))
    for place, point in enumerate(drawn):
        for log in logs:  # what it is expected to hold, at every speed it was driven at
            rate, load_sd = 1.0 / log.data.interval, log.data.normal_force_sd
            for speed, seconds in driven(log.data):
                trial = simulated_log(unknowns, point, log.data.base, LogDesign(speed, log.mean_load), seconds)
                if trial is not None:
                    precisions[place] += trial.information(rate, log.data.noise**2, load_sd, trial.count(seconds))
    return Knowledge(
        unknowns=unknowns,
        kept=kept,
        targets=targets,
        places=drawn,
        precision=precisions[:, kept[:, None], kept[None, :]],
        systematic=systematic,
        base=base,
        noise=scene.rig.noise or max(noises, default=NOISE * values["mu_s"] * load),
        load_error=LOAD_ERROR,
        rate=min([1.0 / log.data.interval for log in logs] or [SLOWEST_RATE]),
        fastest=choices.fastest,
        longest=LONGEST,
    )


def drawn_places(unknowns: Unknowns, theta: Array, precision: Array, base: Array) -> Array:
    """Theta (d, n_p): the likeliest, and draws of the free ones within bounds that make a pair.

    Args:
        precision: (f, f) of what is known; what nothing is known of is drawn over its usual spread.
    """
    random, free = np.random.default_rng(0), np.flatnonzero(unknowns.free)
    unknown = np.diag(precision) == 0.0
    usual = np.diag(np.where(unknown, unknowns.spread[free] ** -2.0, 0.0))
    variances, vectors = np.linalg.eigh(inverse(precision + usual))
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


def driven(data: LogData) -> list[tuple[float, float]]:
    """At which speeds [m/s] a log was driven, and for how long each [s]; rests of the drive left out."""
    pieces = (data.programme or Drive.of(data.drive_speed)).within(data.begin, data.end)
    ends = [*(begin for begin, _ in pieces[1:]), data.end]
    return [(abs(speed), end - begin) for (begin, speed), end in zip(pieces, ends, strict=True) if speed]


# In the words of a laboratory, as a table of steps to type into a script, and as a document.

TABLE = "log,drive_speed_mm_per_s,duration_s,normal_force_N,sampling_rate_Hz,stiffness_N_per_m"
NOISE_ALONE = "these are intervals of noise alone; errors of the sensors, and of what is taken as exact of the rig, add"
WITH_TOLERANCES = (
    "the intervals include the errors of rig and sensors, which no log lowers, and a usual scatter of specimens where "
    "each speed stands in one log, which a repeat measures"
)
REPEAT = (
    "every drive speed stands in one log only, so that a difference between specimens counts as one of speed: repeat "
    "one speed, or state specimen = 0 under [tolerances] where all logs are of one specimen"
)


def shown_half(halves: Array) -> str:
    """Half lengths (d,) as "± 8 %", or "± 5 to 20 %" where they differ from place to place; two digits."""
    ends = (float(np.min(halves)), float(np.max(halves)))
    low, high = ("" if not end <= WEAK - 1.0 else f"{float(f'{100.0 * end:.2g}'):.15g}" for end in ends)
    if low == high:
        return f"± {low} %" if low else "open"
    return f"± {low} to {high} %" if high else f"± {low} % to open"


def verdict(half: float) -> str:
    """What a fit is expected to call a parameter whose interval has this half length."""
    return "identified" if half <= IDENTIFIED else "weak" if half <= WEAK - 1.0 else "not identifiable"


def described(log: PlannedLog) -> str:
    """A log in lab words."""
    design, minutes = log.design, math.ceil(log.duration / 60.0)
    spring = "" if design.stiffness is None else f" on the spring of {three_figures(design.stiffness)} N/m"
    at = f"{speed_text(design.speed, 3)}, {three_figures(design.normal_force)} N{spring}, at {log.rate:.0f} Hz"
    # Shorter ones with two figures, rounded up.
    step = 10.0 ** (math.floor(math.log10(max(log.duration, 0.1))) - 1)
    long = f"{minutes} min" if minutes > 3 else f"{math.ceil(log.duration / step - 1e-9) * step:.3g} s"
    return f"a log of {long} at {at} ({log.slips} slips){': a repeat with another specimen' * log.repeats}"


def plan_text(plan: RecordingPlan, source: str = "") -> str:
    """The whole plan for a terminal; its first line says what it is of (`source`) and where the values come from."""
    known, now, then = plan.knowledge, promised(plan.now), promised(plan.then)
    open_ = [known.names[i] for i in known.targeted if then[i] > IDENTIFIED]
    if plan.logs:
        moved = [
            f"{known.names[i]} {shown_half(plan.now[:, i])} → {shown_half(plan.then[:, i])}"
            for i in known.targeted
            if then[i] < 0.8 * now[i]
        ]
        these = "this log" if len(plan.logs) == 1 else f"these {len(plan.logs)} logs"
        minutes = f"{math.ceil(plan.seconds / 60.0)} minutes, {SETUP / 60.0:.0f} for setting up each log included"
        summary = f"add {these}: {'; '.join(filter(None, [', '.join(moved), minutes]))}"
    elif not open_:
        summary = "nothing to add: every target is identified already"
    else:
        summary = "no log among those that were tried, and within the budget, is expected to identify more; see below"
    every = [plan.now, *(log.halves for log in plan.logs), *([plan.holds.halves] if plan.holds else [])]
    heads = [f"with {number}" for number in range(1, len(plan.logs) + 1)] + ["with holds"] * (plan.holds is not None)
    rows = [["", "now", *heads, "the fit will call it"]]
    for i, name in enumerate(known.names):
        cells = [shown_half(halves[:, i]) for halves in every]
        rows.append([name, *cells, verdict(float(then[i]))])
    lines = [wrapped(" ".join(filter(None, (source, plan.origins.text))), "", ""), wrapped(summary)]
    lines += [wrapped(f"{number}. {described(log)}", "  ") for number, log in enumerate(plan.logs, 1)]
    lines += [wrapped(REPEAT)] if any(log.repeats for log in plan.logs) else []
    lines += [wrapped(plan.holds.words, "  ")] if plan.holds is not None else []
    lines += ["", columns(rows), wrapped(WITH_TOLERANCES if known.systematic.all() else NOISE_ALONE)]
    if any("to" in cell for row in rows[1:] for cell in row[1:-1]):
        lines.append(wrapped("ranges are over the values that the parameters may have"))
    if open_:
        tried = "no set of logs within the budget, at the speeds, loads and springs that were tried, identifies more"
        lines.append(wrapped(f"{listed(open_)}: {tried}; allow a longer --budget, or another --load or --stiffness"))
    return "\n".join(lines)


def step_table(plan: RecordingPlan) -> str:
    """The step programme, one row per log, as CSV in the units of a CETR script."""
    rows = [TABLE]
    for number, log in enumerate(plan.logs, 1):
        spring = "" if log.design.stiffness is None else f"{log.design.stiffness:.6g}"
        load, drive = f"{log.design.normal_force:.6g}", f"{1e3 * log.design.speed:.6g},{log.duration:.4g}"
        rows.append(f"{number},{drive},{load},{log.rate:.0f},{spring}")
    return "\n".join([*rows, ""])


def plan_document(plan: RecordingPlan) -> dict[str, Any]:
    """What --json prints, SI; half lengths as shares of what each parameter is judged by, null where they are open."""
    names, origins, then = plan.knowledge.names, plan.origins, promised(plan.then)

    def by_name(*halves: Array) -> dict[str, Any]:
        known = [[h if math.isfinite(h) and h < 1e6 else None for h in each.tolist()] for each in halves]
        return {name: row[0] if len(row) == 1 else row for name, *row in zip(names, *known, strict=True)}

    return {
        "measured": list(origins.measured),
        "stated": list(origins.stated),
        "assumed": list(origins.assumed),
        "now": by_name(promised(plan.now)),
        "then": by_name(then),
        "ranges": {k: by_name(h.min(axis=0), h.max(axis=0)) for k, h in (("now", plan.now), ("then", plan.then))},
        "verdicts": {n: verdict(float(h)) for n, h in zip(names, then, strict=True)},
        "seconds": plan.seconds,
        "holds": None
        if plan.holds is None
        else {
            "words": plan.holds.words,
            "seconds": list(plan.holds.seconds),
            "expected": by_name(promised(plan.holds.halves)),
        },
        "logs": [
            {
                "words": described(log),
                "drive": log.design.speed,
                "normal_force": log.design.normal_force,
                "stiffness": log.design.stiffness,
                "duration": log.duration,
                "sampling_rate": log.rate,
                "slips": log.slips,
                "repeats": log.repeats,
                "expected": by_name(promised(log.halves)),
            }
            for log in plan.logs
        ],
    }
