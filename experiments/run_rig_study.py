"""Do the intervals of `stickslip rig` hold the rig, and do fits that take them as priors hold the friction?

Records: rigs with mass, stiffness and damping drawn within a factor, taps and pulls on a block at 100 Hz to 2 kHz with
noise, and a load cell that lags by 0.1 to 10 ms; half of them with a second tap under a known mass. Drive speed and
added mass are off by what the command allows for (1 %, 0.5 %). Counted: intervals of 95 % that hold the truth.
Fits: pairs of the recovery study, fitted with the rig as its records tell it: its intervals as priors, and its values
taken as exact. Counted: parameters whose interval holds the truth, of fits that converge.
Slips: how far the frequency within slips is from the rig's, which is the model error that is allowed for.
Measured: the mass from the free oscillation of the records of paper on paper, where they are there.

    python experiments/run_rig_study.py records|fits|exact|slips|measured FIRST LAST FILE
    python experiments/run_rig_study.py table FILE...
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record, read_log
from experiments.in_parts import append, by_processor_time, kind_and_cases, started
from experiments.machine import describe
from experiments.study_problem import NOISE, NORMAL_FORCE, RIG, USUAL, random_case, scene_of
from identify import Scene
from identify.base.outcome import Status
from identify.bench.calibration import RigCalibration, calibrated
from identify.bench.records import Measured, rings, sticks
from identify.effects import MAIN
from identify.identification import find
from identify.model.model import assemble
from identify.simulation.simulate import run

Array = NDArray[np.float64]

SEED, RIGS, PAIRS = 52, 100, 100
SPEED_ERROR, ADDED_ERROR = 0.01, 0.005
TAPS = (0.5, 2.7, 4.9)  # [s]
FINE = 8000.0  # [Hz] of the integration
QUANTITIES = ("mass", "stiffness", "zeta")
FRICTION = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
PAPER = Path(__file__).parents[2] / "shared" / "data" / "paper_on_paper"
EXACT_LIMIT = 20.0  # [s] of a fit with a wrong rig: what has no answer by then is refused, after a minute as well
SPRINGS = {"k1002_v4300": (1002.0, 4.3e-3), "k168_v1100": (168.0, 1.1e-3)}


def tapped(rig: dict[str, float], lag: float, rate: float, noise: float, random: np.random.Generator) -> Record:
    """A record of three taps: pulses of a tenth of a swing on the free rig, seen by a load cell of first order. The
    pulses are constant, so that the exponential of the matrix integrates exactly."""
    mass, stiffness, natural = rig["mass"], rig["stiffness"], np.sqrt(rig["stiffness"] / rig["mass"])
    dashpot = rig["damping"] / natural
    matrix = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-stiffness / mass, -dashpot / mass, 0.0, 1.0 / mass],
            [-stiffness / lag, -dashpot / lag, -1.0 / lag, 0.0],
            [0.0, 0.0, 0.0, 0.0],
        ]
    )
    sub = int(np.ceil(FINE / rate))
    step = expm(matrix / (rate * sub))
    count = int(7.0 * rate) * sub
    at = np.arange(count + 1) / (rate * sub)
    pulse = np.zeros(count + 1)
    for tap in TAPS:
        inside = (at >= tap) & (at < tap + 0.2 * np.pi / natural)
        pulse[inside] = random.uniform(0.5, 1.5) / (0.2 * np.pi)
    shown, state = np.zeros(count + 1), np.zeros(4)
    for i in range(count):
        state[3] = pulse[i]
        state = step @ state
        shown[i + 1] = state[2]
    times, force = at[::sub], shown[::sub] + 0.2 + 0.01 * at[::sub]
    return Record(times, np.ones(times.size), force + noise * random.standard_normal(times.size))


def pulled(rig: dict[str, float], lag: float, rate: float, noise: float, random: np.random.Generator) -> Record:
    """A slow pull on a rigid block, until the drive stops: the record says 0.1 mm/s, which is off by its error."""
    speed = 1e-4 * (1.0 + SPEED_ERROR * random.standard_normal())
    times = np.arange(int(12.0 * rate)) / rate
    driven = np.clip(times - 1.0, 0.0, 9.0)
    lagging = driven - lag * (1.0 - np.exp(-np.clip(times - 1.0, 0.0, None) / lag))
    force = rig["stiffness"] * speed * np.where(times <= 10.0, lagging, driven)
    return Record(times, np.ones(times.size), force + noise * random.standard_normal(times.size), drive_speed=1e-4)


def calibration(rig: dict[str, float], random: np.random.Generator) -> RigCalibration:
    """A rig as its records tell it: taps and a pull, or for every second one taps with and without a known mass."""
    rate, lag = float(np.exp(random.uniform(*np.log((100.0, 2000.0))))), 10.0 ** random.uniform(-4.0, -2.0)
    noise = 10.0 ** random.uniform(-2.5, -1.7)
    measured: list[Measured] = rings(tapped(rig, lag, rate, noise, random), "tap")
    if random.random() < 0.5:
        added = 0.25 * RIG["mass"]
        real = added * (1.0 + ADDED_ERROR * random.standard_normal())
        heavier = rig | {"mass": rig["mass"] + real}
        measured += rings(tapped(heavier, lag, rate, noise, random), "tap with added mass", added)
    else:
        measured += sticks(pulled(rig, lag, rate, noise, random), Path("pull"), None)
    return calibrated(measured, SPEED_ERROR, ADDED_ERROR)


def priors_of(found: RigCalibration) -> dict[str, Any]:
    """The rig as a scene takes it from its records: values with tolerances, and what ties them."""
    values = {name: getattr(found, name) for name in QUANTITIES}
    rig: dict[str, Any] = {name: {"value": v.value, "tolerance": v.tolerance} for name, v in values.items()}
    return rig | ({"natural_frequency_tolerance": found.tied} if found.tied else {})


def records(number: int) -> dict[str, Any]:
    """One rig: whether each interval holds it, and the tolerances."""
    random = np.random.default_rng([SEED, number])
    rig = {name: value * 2.0 ** random.uniform(-1.0, 1.0) for name, value in RIG.items()}
    found = calibration(rig, random)
    truth = {"mass": rig["mass"], "stiffness": rig["stiffness"], "zeta": rig["damping"] / (2.0 * rig["stiffness"])}
    line: dict[str, Any] = {"study": "records", "number": number}
    for name, true in truth.items():
        value = getattr(found, name)
        line[name] = None if value is None else bool(value.interval[0] <= true <= value.interval[1])
        line[f"{name}_tolerance"] = None if value is None else value.tolerance
    return line


def fits(number: int, ways: Sequence[str] = ("priors", "exact")) -> dict[str, Any]:
    """One pair, fitted with the rig's intervals as priors, and with its values taken as exact."""
    random = np.random.default_rng([SEED, 1, number])
    case, _ = random_case(random, USUAL)
    found = calibration(case.rig, random)
    line: dict[str, Any] = {"study": "fits", "number": number}
    for way in ways:
        rig = priors_of(found) if way == "priors" else {name: getattr(found, name).value for name in QUANTITIES}
        document = scene_of(case).as_document() | {"rig": rig}
        document["logs"] = [{**log, "path": Path(log["path"]).name} for log in document["logs"]]
        if way == "exact":
            document["fit"] = {"time_limit": EXACT_LIMIT}
        began = time.process_time()
        _, out = find(Scene.from_document(document), case.records, progress=lambda _s, _x: None)
        held = {}
        for e in out.estimates:
            if e.name in FRICTION and e.lower is not None and e.upper is not None:
                held[e.name] = bool(e.lower <= case.truth[e.name] <= e.upper)
        converged = out.status is Status.CONVERGED
        seconds = time.process_time() - began
        line[way] = {"status": out.status.value, "held": held if converged else {}, "seconds": seconds}
    return line


def slips(number: int) -> dict[str, Any]:
    """The frequency within the slips of one pair at two speeds, against that of the rig: logarithm, and its error."""
    random = np.random.default_rng([SEED, 2, number])
    case, _ = random_case(random, USUAL)
    line: dict[str, Any] = {"study": "slips", "number": number, "off": [], "error": []}
    for speed, duration, rate in ((1e-3, 4.0, 2000.0), (5e-3, 2.0, 4000.0)):
        times = np.arange(round(duration * rate)) / rate
        force = run(assemble(MAIN), case.truth | case.rig, speed, NORMAL_FORCE, duration).sample(times)["force"]
        record = Record(times, np.ones(times.size), force + NOISE * random.standard_normal(times.size))
        for m in sticks(record, Path("slips"), speed):
            if m.kind == "frequency":
                natural = np.sqrt(case.rig["stiffness"] / case.rig["mass"])
                line["off"].append(float(np.log(m.value / natural)))
                line["error"].append(m.error)
    return line


def measured(_number: int) -> dict[str, Any]:
    """The mass [kg] from the free oscillation in each fast record of paper on paper, with the stiffness as stated."""
    line: dict[str, Any] = {"study": "measured"}
    for name, (stiffness, speed) in SPRINGS.items():
        path = PAPER / f"{name}.csv"
        if not path.exists():
            continue
        told = [m for m in sticks(read_log(path), path, speed) if m.kind == "frequency"]
        known = Measured("stiffness", stiffness, 0.01, "as stated")
        mass = calibrated([*told, known], SPEED_ERROR, ADDED_ERROR).mass if told else None
        line[name] = None if mass is None else [mass.value, *mass.interval]
    return line


def exact(number: int) -> dict[str, Any]:
    """The negative control alone."""
    return fits(number, ("exact",))


STUDIES = {"records": records, "fits": fits, "exact": exact, "slips": slips, "measured": measured}


def study(name: str, first: int, last: int, file: Path | None = None) -> list[dict[str, Any]]:
    """Cases first to last, each printed, and appended to a file if one is given."""
    out = []
    for number in range(first, last + 1):
        out.append(STUDIES[name](number))
        print(out[-1], flush=True)
        append(file, out[-1])
    return out


def _share(held: Sequence[bool | None]) -> str:
    told = [h for h in held if h is not None]
    return f"{sum(told)} of {len(told)} ({100.0 * sum(told) / max(len(told), 1):.0f} %)"


def table(lines: Sequence[dict[str, Any]]) -> None:
    """Counts of every study there are cases of."""
    print(f"\n{describe()}\n")
    of = {name: [line for line in lines if line["study"] == name] for name in STUDIES}
    if of["records"]:
        print("| rig | interval holds it | tolerance, median |\n| --- | --- | --- |")
        for name in ("mass", "stiffness", "zeta"):
            tolerances = [line[f"{name}_tolerance"] for line in of["records"] if line[name] is not None]
            held = _share([line[name] for line in of["records"]])
            print(f"| {name} | {held} | {100.0 * np.median(tolerances):.2g} % |")
    if of["fits"]:
        print("\n| rig in the fit | pairs | converged | parameters held |\n| --- | --- | --- | --- |")
        for way in ("priors", "exact"):
            mine = [line[way] for line in of["fits"] if way in line]
            held = [h for one in mine for h in one["held"].values()]
            converged = sum(one["status"] == "converged" for one in mine)
            print(f"| {way} | {len(mine)} | {converged} | {_share(held)} |")
    if of["slips"]:
        off = np.array([x for line in of["slips"] for x in line["off"]])
        error = np.array([x for line in of["slips"] for x in line["error"]])
        inside = _share([bool(abs(o) < 1.96 * e) for o, e in zip(off, error, strict=True)])
        print(f"\nfrequency within slips: off by {100 * off.mean():+.1f} % ± {100 * off.std():.1f} %, held {inside}")
    for line in of["measured"]:
        for name in SPRINGS:
            if line.get(name):
                mass, low, high = (1e3 * x for x in line[name])
                print(f"{name}: mass from the free oscillation {mass:.3g} g ({low:.3g} to {high:.3g})")


def main(fast: bool = False) -> list[dict[str, Any]]:
    """The whole study; fast: a few rigs, no fits."""
    counts = {"records": 6, "slips": 1} if fast else {"records": RIGS, "slips": 30, "fits": PAIRS, "measured": 1}
    lines = [line for name, count in counts.items() for line in study(name, 1, count)]
    table(lines)
    return lines


if __name__ == "__main__":
    by_processor_time()
    started(main, table, kind_and_cases(study))
