"""The samples of the acceptance table: what is drawn for a number, how it is fitted, and what is counted as right.

Every case follows from its sample and its number. Numbers of the second set are those of the first plus SECOND: the
same recipes with other seeds.
"""

from __future__ import annotations

import contextlib
import json
import re
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

import identify
from data_io import LogError, Record
from experiments.case_variants import CAUSES, WRONG, misstated, scene_of_both, two_materials, with_scatter, wrong
from experiments.designs import allowed, design
from experiments.designs import scene_of as design_scene
from experiments.force_plates import KINDS as PLATES
from experiments.force_plates import plated
from experiments.in_vivo import RATES, twin
from experiments.judgement import FRICTION, judged
from experiments.measured_records import FILES, RECORDS, TOGETHER
from experiments.measured_records import scene_of as measured_scene
from experiments.other_laws import LAWS, of_law
from experiments.record_kinds import HELD, KINDS, slide_hold_slide
from experiments.regime_records import KINDS as REGIMES
from experiments.regime_records import drawn
from experiments.strangers import stranger
from experiments.study_problem import (
    DEMO,
    NOISE,
    NORMAL_FORCE,
    RIG,
    SPEEDS,
    USUAL,
    random_case,
    recorded,
    recovery_case,
    scene_of,
)
from experiments.treated_logs import copied, oscillating, specimens, toleranced, treated
from experiments.uneven_records import CASES as UNEVEN
from experiments.uneven_records import SOFT, simulated, unlike
from experiments.uneven_records import scene_of as uneven_scene
from identify import Scene, fit
from identify.base.errors import FitError, IdentifyError
from identify.cli.logs import StatedRig, inspection
from identify.effects import MAIN
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.scene.tables import Course
from identify.simulation.drive import Drive
from identify.simulation.simulate import run

SECOND = 20_000  # a profile was mended on pair 10,011 of the strangers: those from 10,000 on are no longer held out
SLIPLESS = (None, "none", "sliding", "programme")
SCATTERS = (0.0, 0.003, 0.01, 0.03, 0.05, 0.15)
SCATTER_SEED, COVERAGE_SEED = 53, 97
COVERAGE_SPEEDS = ((1e-4, 14.0, 250.0), (1e-3, 2.2, 1000.0), (5e-3, 0.7, 2000.0))
MEMORY = 0.8  # correlation of the noise from sample to sample, in every second case of the coverage
MEASURED = (*((name,) for name in FILES), *TOGETHER)
UNEVEN_EACH = 15
AUTO_SEED = 6360
AUTO: Mapping[str, tuple[tuple[str, ...], tuple[tuple[str, tuple[float, float]], ...]]] = {
    "full": (MAIN, ()),
    "without weakening": (tuple(e for e in MAIN if e != "velocity_weakening"), ()),
    "without damping": (tuple(e for e in MAIN if e != "hysteresis_damping"), ()),
    "lag": ((*MAIN, "sensor_lag"), (("lag_time", (1e-3, 5e-3)),)),
    "skin": ((*MAIN, "skin_compliance"), (("skin_stiffness", (2e3, 2e4)),)),
    "load": ((*MAIN, "load_dependence"), (("load_exponent", (0.1, 0.4)),)),
}
"""Sets of effects that are left to the data, and the ranges of what the last of them adds."""
INVENTED = re.compile(
    r"explains the misfit|not as stated|the sensor lags|a (mass|stiffness|damping) of \S+ (kg|g|N/m|kN/m) instead"
)
"""Sentences that give a quantity of the rig as the cause of a misfit."""

Line = dict[str, Any]
COURSE_SEED = 68


@dataclass(frozen=True)
class Sample:
    """A row of the table.

    count: cases of the whole, from number `first` on; third: how many of them, evenly spread, are run after each step;
    one: runs a case; limit: share of right cases that is asked for (None: as before); answered: the same for cases
    with an answer; coverage: the range that is asked of the share of intervals that hold the truth.
    """

    one: Callable[[int], Line]
    count: int
    third: int
    limit: float | None = None
    first: int = 0
    answered: float | None = None
    coverage: tuple[float, float] | None = None

    def numbers(self, subset: str) -> list[int]:
        """The numbers of "whole" or "third"."""
        some = self.count if subset == "whole" else self.third
        return [self.first + int((i + 0.5) * self.count / some) for i in range(some)]


def fitted(
    scene: Scene,
    records: Sequence[Record] | None,
    truth: Mapping[str, float],
    required: Sequence[str] = FRICTION,
    published: bool = False,
) -> tuple[Line, Mapping[str, Any]]:
    """A fit from the data alone, judged (by the intervals with all tolerances where `published`, else by those of noise
    alone); and its document (empty where it was refused)."""
    try:
        result = fit(scene, records).result
    except (IdentifyError, LogError) as refusal:
        return _refused(str(refusal)), {}
    if published:
        parameters = {name: {**entry, "interval_rig_exact": None} for name, entry in result["parameters"].items()}
        return judged({**result, "parameters": parameters}, truth, required), result
    return judged(result, truth, required), result


def _refused(message: str) -> Line:
    nothing = {"answered": False, "right": False, "false": False, "inside": 0, "outside": 0, "worst": None}
    return {"status": "refused", **nothing, "verdict_errors": [], "verdicts": {}, "message": message}


def recovery(ranges: str, noise: float = 1.0, rate: float = 1.0) -> Callable[[int], Line]:
    """Random pairs of the recovery study, from the data alone."""

    def one(number: int) -> Line:
        case = recovery_case(ranges, number, noise, rate)
        further = [2e-2] * (len(case.records) - len(SPEEDS))
        return fitted(scene_of(case, None, further), case.records, case.truth)[0]

    return one


def record_kind(number: int) -> Line:
    """A kind of record, of KINDS in turn; right only with all logs."""
    kind = KINDS[number % len(KINDS)]
    scene, records = kind.made(number // len(KINDS))
    line, result = fitted(scene, records, kind.pair, required=())
    left_out = [log for log in result.get("logs", ()) if log.get("reason_left_out") is not None]
    return line | {"right": line["right"] and not left_out, "kind": kind.name}


def held(number: int) -> Line:
    """Slide, hold, slide; right: all holds are recognised and t_cr lies within 5 %."""
    scene, record, truth = slide_hold_slide(number)
    holds = sorted(change.hold_s for change in inspection("holds.csv", record).changes)
    seen = len(holds) == len(HELD) and bool(np.allclose(holds, HELD, atol=0.01))
    line, result = fitted(scene, [record], truth, required=("t_cr",))
    creep = result.get("parameters", {}).get("t_cr", {}).get("value")
    near = creep is not None and abs(creep / truth["t_cr"] - 1.0) <= 0.05
    return line | {"kind": "slips" if number % 2 else "slides", "recognised": seen, "right": seen and near}


def wrong_rig(number: int) -> Line:
    """A wrong rig; right: no answer, and the quantity is named with its true value within 5 %."""
    kind = tuple(WRONG)[number % len(WRONG)]
    case, scene, truth = wrong(kind, 1 + number // len(WRONG))
    line, _ = fitted(scene, case.records, case.truth)
    named = names(kind, truth, line["message"])
    return line | {"kind": kind, "named": named, "right": line["status"] != "converged" and named}


def cause(number: int) -> Line:
    """Something stated wrongly, or another law than the scene's; right: the first sentence names the one, or the answer
    is right all the same; of another law no parameter is given and no cause; invented: a wrong one stated as sure."""
    kind = (*CAUSES, *LAWS)[number % (len(CAUSES) + len(LAWS))]
    scene, records, truth = (*of_law(kind, number), {}) if kind in LAWS else misstated(kind, number)
    line, result = fitted(scene, records, truth)
    first = line["message"].split(";")[0]
    named = kind in CAUSES and bool(re.search(CAUSES[kind][0], first)) and line["status"] != "converged"
    sure = "explains the misfit" in first and "cannot distinguish" not in first and not named
    given = [name for name in FRICTION if result.get("parameters", {}).get(name, {}).get("value") is not None]
    right = named or line["right"] if kind in CAUSES else not sure and not given
    return line | {"kind": kind, "named": named, "invented": sure, "given": given, "right": right}


def names(kind: str, truth: float, message: str) -> bool:
    """Whether a message names the quantity and, with its unit, a value within 5 % of the truth [SI]."""
    word, units = {
        "mass": ("mass", {"kg": 1.0, "g": 1e-3}),
        "stiffness": ("stiffness", {"N/m": 1.0, "kN/m": 1e3}),
        "lag": ("lag|sensor", {"ms": 1e-3, "s": 1.0}),
    }[kind]
    if not re.search(word, message):
        return False
    pairs = re.findall(r"([-+]?\d+\.?\d*(?:e[-+]?\d+)?) (kN/m|N/m|kg|g|ms|s)\b", message)
    return any(unit in units and abs(float(value) * units[unit] / truth - 1.0) < 0.05 for value, unit in pairs)


def designed(number: int) -> Line:
    """A design; right: converged, and every verdict is one that the profile by brute force allows."""
    made = design(number)
    line, _ = fitted(design_scene(made), made.records, made.truth, required=())
    may = allowed(number)
    errors = [n for n, words in may.items() if line["verdicts"].get(n, "none") not in words]
    if may:
        line["verdict_errors"] = errors if line["status"] == "converged" else []
    right = line["status"] == "converged" and not line["verdict_errors"]
    return line | {"right": right, "kind": made.kind, "repaired": made.repaired, "truth_known": bool(may)}


def in_vivo(number: int) -> Line:
    """A twin of an in-vivo visit at one of four rates; right: converged without a verdict error."""
    made, rate = twin(number // len(RATES)), RATES[number % len(RATES)]
    line, _ = fitted(made.scene(), made.records(rate), {n: made.truth[n] for n in (*FRICTION, "mass")}, required=())
    right = line["status"] == "converged" and not line["verdict_errors"] and not line["false"]
    return line | {"right": right, "rate": rate}


def both_materials(number: int) -> Line:
    """Two materials on one rig."""
    first, second, own = two_materials(number)
    truth = first.truth | {f"{name} (B)": second.truth[name] for name in own}
    scene = scene_of_both(first, second, own)
    return fitted(scene, [*first.records, *second.records], truth, required=())[0] | {"own": own}


def scattered(number: int) -> Line:
    """Strength that scatters from stick to stick; right: answered, nothing false, no cause invented."""
    scatter, pair = SCATTERS[number % len(SCATTERS)], number // len(SCATTERS)
    case, _ = random_case(np.random.default_rng([SCATTER_SEED, pair]), USUAL)
    records = with_scatter(case, SPEEDS, scatter, pair)
    line, result = fitted(scene_of(case), records, case.truth | {"strength_scatter": scatter or 1e-9}, required=())
    return _without_invention(line) | {"scatter": scatter, "estimator": result.get("estimator")}


def _without_invention(line: Line) -> Line:
    invented = bool(INVENTED.search(line["message"]))
    right = line["status"] == "converged" and not line["false"] and not invented
    return line | {"right": right, "invented": invented}


def coverage(number: int) -> Line:
    """New noise on the same three logs of the demo pair, white or with a memory in turn."""
    random, records = np.random.default_rng([COVERAGE_SEED, number]), []
    memory = MEMORY if number % 2 else 0.0
    for speed, duration, rate in COVERAGE_SPEEDS:
        times = np.arange(round(duration * rate) + 1) / rate
        force = run(assemble(MAIN), DEMO | RIG, speed, NORMAL_FORCE, duration).sample(times)["force"]
        new = random.standard_normal(times.size + 200) * np.sqrt(1.0 - memory**2)
        noise = NOISE * lfilter([1.0], [1.0, -memory], new)[200:]
        records.append(Record(times, np.full(times.size, NORMAL_FORCE), force + noise))
    logs = [{"path": f"log_{i}.csv", "drive_speed": log[0]} for i, log in enumerate(COVERAGE_SPEEDS, 1)]
    scene = Scene.from_document({"effects": [*MAIN, "varying_normal_force"], "rig": dict(RIG), "logs": logs}, Path())
    return fitted(scene, records, DEMO)[0] | {"memory": memory}


def chosen_effects(number: int) -> Line:
    """Effects left to the data (`effects = "auto"`); right: those that the logs were made with, and no others."""
    kind = tuple(AUTO)[number % len(AUTO)]
    effects, more = AUTO[kind]
    random = np.random.default_rng([AUTO_SEED, number])
    model = assemble(effects)
    while True:
        case, _ = random_case(random, USUAL)
        values = case.truth | case.rig | {name: float(np.exp(random.uniform(*np.log(ends)))) for name, ends in more}
        values = {q.name: values.get(q.name, q.default) for q in model.parameters}
        records, slips = [], []
        for (speed, duration, rate), load in zip(SPEEDS[1:], (1.0, 1.4, 0.8), strict=True):
            motion = run(model, values, speed, load, duration)
            records.append(recorded(motion, rate, random, load=load))
            slips.append(motion.arrests.size)
        shown = [i for i, count in enumerate(slips) if count >= 4]
        # Friction that does not weaken hardly ever sticks and slips at the fastest speed.
        if len(shown) >= (2 if kind == "without weakening" else len(slips)):
            break
    logs = [{"path": f"log_{i}.csv", "drive_speed": SPEEDS[1 + i][0]} for i in shown]
    records = [records[i] for i in shown]
    scene = Scene.from_document({"effects": "auto", "rig": dict(case.rig), "logs": logs}, Path())
    line, result = fitted(scene, records, {n: v for n, v in values.items() if n in FRICTION}, required=())
    found = set(result.get("effects", {}).get("names", ())) - {"varying_normal_force"}
    right = line["status"] == "converged" and found == set(effects)
    return line | {"kind": kind, "right": right, "invented": bool(found - set(effects)), "found": sorted(found)}


def behind_plate(number: int) -> Line:
    """A pair behind a plate, or whose sensor stands elsewhere than the scene says; right: the parameters, or the sensor
    named; under 5 % noise it may be refused, without a cause."""
    kind = tuple(PLATES)[number % len(PLATES)]
    made = plated(number // len(PLATES), *PLATES[kind])
    line, _ = fitted(made.scene, made.case.records, made.case.truth)
    named = f'force_sensor = "{made.measured}"' in line["message"] and line["status"] != "converged"
    invented = bool(INVENTED.search(line["message"])) or ("force_sensor" in line["message"] and not named)
    right = named if made.measured != made.stated else line["right"]
    if "noise" in kind:
        right = line["right"] or (line["status"] != "converged" and not invented)
    return line | {"kind": kind, "named": named, "invented": invented, "right": right, "noise": made.noise}


def drawn_course(number: int) -> tuple[Scene, Record, dict[str, float], str, int]:
    """A pair under a sine (0.05 to 5 Hz, half of the cases), under ramps between 0.1 and 5 mm/s, or under either as a
    position column of 10 um shows it: scene, record, truth, which of these, how many slips."""
    random, kind = np.random.default_rng([COURSE_SEED, number]), ("sine", "ramps", "sine", "recorded")[number % 4]
    case, _ = random_case(random, USUAL)
    course, duration = Course(ramps=tuple((3.0 * i, 10 ** random.uniform(-4, -2.3)) for i in range(5))), 12.0
    if kind == "sine" or (kind == "recorded" and random.random() < 0.5):
        turned, frequency = (
            2.0 * case.truth["mu_s"] * NORMAL_FORCE / case.rig["stiffness"],
            0.05 * 100 ** random.random(),
        )
        course = Course((turned * random.uniform(1.5, 4.0), frequency, random.uniform(-np.pi, np.pi)))
        duration = float(np.clip(10.0 / frequency, 2.0, 60.0))
    motion = run(assemble(MAIN), case.truth | case.rig, course, NORMAL_FORCE, duration, accuracy=1e-8)
    time = np.arange(int(1e3 * duration)) / 1e3
    force = motion.sample(time)["force"] + NOISE * random.standard_normal(time.size)
    record, log = Record(time, np.full(time.size, NORMAL_FORCE), force), {"path": "log.csv", "drive": course.table}
    if kind == "recorded":
        position = 1e-5 * np.round(1e5 * Drive.of(course, duration).motion(time)[0])
        record, log = (
            replace(record, channels={"position": position}, channel_units={"position": "m"}),
            {"path": "log.csv"},
        )
    scene = Scene.from_document({"effects": list(MAIN), "rig": dict(case.rig), "logs": [log]}, Path())
    return scene, record, dict(case.truth), kind, int(motion.onsets.size)


def on_course(number: int) -> Line:
    """A pair of `drawn_course`; right: mu_s and mu_k0 are identifiable, too."""
    scene, record, truth, kind, slips = drawn_course(number)
    line, _ = fitted(scene, [record], truth, required=("mu_s", "mu_k0"))
    return line | {"kind": kind, "slips": slips}


def treated_log(number: int) -> Line:
    """Logs smoothed or resampled before; right: nothing false, the treatment named unless the answer is right."""
    (scene, records, truth), kind = treated(number)
    line, _ = fitted(scene, records, truth, required=())
    named = bool(re.search("average|smooth|filter|resampl", line["message"]))
    return line | {"kind": kind, "named": named, "right": not line["false"] and (named or line["right"])}


def copied_log(number: int) -> Line:
    """One log exported again, or a genuine repeat; right: the copy refused by name, the repeat fitted."""
    (scene, records, truth), kind = copied(number)
    line, _ = fitted(scene, records, truth, required=())
    named = "would count twice" in line["message"]
    return line | {"kind": kind, "named": named, "right": named == (kind != "repeat") and not line["false"]}


def regime(number: int) -> Line:
    """The regime of a record, the kinds in turn, as `inspect` has it without and with the rig, and as the fit sees it
    (None where it refuses it before); right: both looks of `inspect`; false: stick-slip is claimed where there is
    none."""
    made = drawn(tuple(REGIMES)[number % len(REGIMES)], 1 + number // len(REGIMES))
    parted = made.regime == "programme" or made.strokes > 1  # a column tells the speed; each part is a log of its own
    stated, speed = made.rig, made.rig["drive_speed"]
    rig = StatedRig(stated["stiffness"], None if parted else speed, stated["mass"])
    looks = [inspection("log", made.record, known).regime for known in (StatedRig(), rig)]
    seen = ["none" if look.regime is None else look.regime.value for look in looks]
    told: list[str | None] = [*seen, None]
    if not parted:
        logs = [{"path": "a.csv", "drive_speed": speed}]
        own = {name: stated[name] for name in ("mass", "stiffness", "damping")}
        scene = Scene.from_document({"effects": list(MAIN), "rig": own, "logs": logs}, Path())
        with suppress(FitError):
            by_fit = prepare(scene, scene.logs[0], made.record, from_scene(scene)).regime
            told[2] = "none" if by_fit is None else by_fit.value
    claimed = not made.slips and any(word not in SLIPLESS for word in told)
    words = f"{made.regime} told as {', '.join(map(str, told))}: {'; '.join(looks[0].evidence)}"
    return _refused(words) | {
        "status": made.regime, "answered": True, "right": set(seen) == {made.regime}, "false": claimed,
        "kind": made.kind,
    }  # fmt: skip


def uneven(number: int) -> Line:
    """A simulated uneven record; right: answered by the uneven estimator, its parameters near the truth."""
    name = tuple(UNEVEN)[number // UNEVEN_EACH % len(UNEVEN)]
    pair = UNEVEN[name]
    (track,) = simulated(pair, 50, [63_000 + number])
    strength = float(np.median(track.effective))  # onset force above the slow level: what fine roughness leaves to tell
    truth = {"strength": strength, "strength_scatter": pair.scatter, "weakening_length": strength / pair.weakening_rate}
    truth |= {"mass": pair.mass, "level_wander": pair.level_wander, "level_roughness": max(pair.roughness, 1e-9)}
    line, result = fitted(uneven_scene(pair), [track.record], truth, required=("strength", "mass"))
    return line | {"right": line["right"] and result.get("estimator") == "uneven", "kind": name}


def unlike_uneven(number: int) -> Line:
    """A simulated uneven record whose rig and law are not those of the scene; right: mass and strength are."""
    track, scene = unlike(number)
    truth = {"strength": float(np.median(track.effective)), "mass": SOFT.mass}
    line, result = fitted(scene, [track.record], truth, required=())
    told = {n: [result["parameters"][n][k] for k in ("value", "interval")] for n in truth} if result else {}
    return line | {"truth": truth, "told": told, "estimator": result.get("estimator")}


def measured(number: int) -> Line:
    """Measured records, paper on paper: no truth; right: answered. What was told is kept."""
    names = MEASURED[number % len(MEASURED)]
    if not RECORDS.is_dir():
        return _refused("no measured records here") | {"records": names}
    line, result = fitted(measured_scene(names), None, {}, required=())
    told = {
        name: [entry["value"], *entry["interval"]]
        for name, entry in result.get("parameters", {}).items()
        if entry["value"] is not None
    }
    done = line["status"] == "converged"
    return line | {"answered": done, "right": done, "records": names, "told": told}


def hard_scene(number: int) -> Line:
    """A row of the table of hard scenes, against a truth from outside; right: within its tolerance, or refused."""
    from experiments.hard_cases import CASES

    case = CASES[number]
    try:
        error = 0.0 if case.truth is None else case.errors(0.0)[0]
        refusal = ""
        if case.truth is None:
            case.scene.run()
    except IdentifyError as refused:
        error, refusal = np.inf, str(refused)
    right = error <= case.tolerance if case.truth is not None else bool(re.search(case.refusal, refusal) and refusal)
    done = {"status": "refused" if refusal else "simulated", "answered": True, "right": right, "false": not right}
    return _refused(refusal) | done | {"kind": case.name, "error": float(error)}


@dataclass
class Commands:
    """How the command line is run in processes of its own; limits count processor time where `cpu_clock` is set."""

    cpu_clock: bool = False

    def run(self, arguments: Sequence[str]) -> tuple[subprocess.CompletedProcess[str], float]:
        """`stickslip` with these arguments, and its processor time [s]."""
        here, product = (str(Path(file).parents[1]) for file in (__file__, identify.__file__))
        lines = ["import sys", f"sys.path[:0] = {[product]!r}", f"sys.path.append({here!r})"]
        if self.cpu_clock:
            lines.append("from experiments.machine import by_processor_time; by_processor_time()")
        lines.append("from identify.cli.main import main; sys.exit(main(sys.argv[1:]))")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            [sys.executable, "-c", "\n".join(lines), *arguments], capture_output=True, text=True, check=False
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return done, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


COMMANDS = Commands()


def strangers_pair(number: int) -> Line:
    """A wide pair by files and the default command; right: answered, no false value, cause or verdict."""
    pair = stranger(number)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        scene = pair.write(folder)
        done, cpu = COMMANDS.run(["fit", "--scene", str(scene), "--out", str(folder / "out")])
        result = {}
        with contextlib.suppress(OSError):
            result = json.loads((folder / "out" / "result.json").read_text(encoding="utf-8"))
    line = judged(result, pair.truth, ()) if result else _refused(done.stderr.strip()[-500:])
    near = line["right"]
    notes = " ".join(result.get("notes", ()))
    line = _without_invention(
        line | {"message": f"{line['message']} {notes}" if INVENTED.search(notes) else line["message"]}
    )
    line |= {"exit": done.returncode, "cycles": [log.cycles for log in pair.logs], "cpu": cpu, "near": near}
    line |= {"late": result.get("not_tried", []), "values": _values(result)}
    return line | {"right": line["right"] and not line["verdict_errors"]}


def _values(result: Mapping[str, Any]) -> dict[str, Any]:
    shown = result.get("last_iterate") or {n: e["value"] for n, e in result.get("parameters", {}).items()}
    return {name: shown.get(name) for name in FRICTION}


SAMPLES: Mapping[str, Sample] = {
    "usual": Sample(recovery("usual"), 200, 24, 198 / 200),
    "noise": Sample(recovery("usual", noise=4.0), 40, 8, 38 / 40),
    "rate": Sample(recovery("usual", rate=0.25), 41, 8, 40 / 41),
    "wide": Sample(recovery("wide, five logs"), 60, 10, 56 / 60),
    "kinds": Sample(record_kind, 45, 16, 40 / 45),
    "holds": Sample(held, 40, 4),
    "wrong_rig": Sample(wrong_rig, 30, 9, 28 / 30),
    "causes": Sample(cause, 70, 14, 0.9),
    "designs": Sample(designed, 40, 8, 37 / 40),
    "two_materials": Sample(both_materials, 26, 6, 23 / 26),
    "in_vivo": Sample(in_vivo, 9, 3, 6 / 9, first=480),
    "scatter": Sample(scattered, 60, 12, 0.9),
    "coverage": Sample(coverage, 200, 40, coverage=(0.93, 0.97)),
    "auto": Sample(chosen_effects, 40, 6, 36 / 40),
    "counterface": Sample(behind_plate, 240, 16, 57 / 60),
    "courses": Sample(on_course, 80, 12, 0.9),
    "treated": Sample(treated_log, 210, 35, 0.9),
    "copies": Sample(copied_log, 40, 10, 38 / 40),
    "oscillating": Sample(lambda number: fitted(*oscillating(number), required=())[0], 20, 5, coverage=(0.93, 1.0)),
    "specimens": Sample(
        lambda number: fitted(*specimens(number), required=(), published=True)[0], 40, 6, coverage=(0.9, 1.0)
    ),
    "tolerances": Sample(
        lambda number: fitted(*toleranced(number), required=(), published=True)[0], 100, 8, coverage=(0.93, 1.0)
    ),
    "regimes": Sample(regime, 400, 60, 396 / 400),
    "uneven": Sample(uneven, 60, 6),
    "unlike": Sample(unlike_uneven, 40, 4, coverage=(0.9, 1.0)),
    "strangers": Sample(strangers_pair, 60, 16, answered=57 / 60, coverage=(0.93, 1.0)),
    "measured": Sample(measured, len(MEASURED), len(MEASURED)),
    "hard": Sample(hard_scene, 69, 69),
}
