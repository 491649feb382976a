"""Designs that cannot tell a parameter, and their repairs: are the verdicts right?

Random pairs (first-row ranges of the recovery study) x designs: one drive speed only; holds too short; slips that hold
a few samples; slow speeds only; and the repair of each. Every design is simulated with 5 mN of noise at 1 N and fitted
from the data alone; the truth is a profile likelihood by brute force from the true motion (`true_profile.py`), of the
same noisy data. Cycles are always resolved (12 samples or more), slips not.

Rules, set beforehand. A parameter is identified where both ends of its 95 % interval lie within 20 % of the value (of
mu_s - mu_k0 for delta_mu_k), weak where within a factor of three, else not identifiable. A verdict is right where the
profile gives the same, or gives it with sides longer or shorter by a quarter: an end that near to a limit may fall on
either side. Where the data leave mu_s - mu_k0 itself open, delta_mu_k may be judged by any size of it that they
allow, and points that a fit met count where the brute force finds them true; where it cannot settle one, no end
before it is known, and any verdict passes (these rules came after the first 200 designs). The verdict on a design is
right where the fit converges and all six verdicts are right. Its remedy is right where the reason beside every
parameter that is called weak or not identifiable asks for what the design lacks: another speed; a slower log, where
holds are too short for t_cr; a higher rate, where slips are not resolved and their shape would tell; a faster log,
where all are slow. A repair cures where no parameter is left not identifiable.

    python experiments/run_design_study.py FIRST LAST FILE
    python experiments/run_design_study.py table FILE...
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record
from experiments.in_parts import append, cases, started
from experiments.machine import describe
from experiments.study_problem import NOISE, NORMAL_FORCE, RIG, USUAL
from experiments.true_profile import OBJECTS, Claims, Truth, true_profiles
from identify.diagnosis.findings import Findings
from identify.effects import MAIN
from identify.identification import find
from identify.model.model import assemble
from identify.scene import Scene
from identify.simulation.simulate import run
from identify.simulation.trajectory import Trajectory

Log = tuple[float, float, float]  # drive speed [m/s], duration [s], sampling rate [Hz]

FRICTION = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
SEED, DESIGNS = 21, 200
CLAIMS = 8  # points of a fit, from below and from above, of which one must be found true
FEWEST = 3  # cycles of each log of a design
SEEN = 12.0  # samples of a cycle, at least: slips may go unresolved, cycles not
SLOWEST: Log = (1e-4 / 60, 800.0, 50.0)
SLOWER: Log = (1e-5, 150.0, 200.0)
SLOW: Log = (1e-4, 20.0, 500.0)
FAST: Log = (1e-3, 4.0, 1000.0)
FASTER: Log = (5e-3, 1.5, 2000.0)
FEW = (2.0, 5.0)  # samples of a slip that is not resolved
LONG_AGEING = (1.5, 6.0)  # t_cr [s] of the pairs whose holds are to be too short
ASKS = {  # what a reason must ask for, by kind of flaw and parameter ("": any other)
    "one speed": {"": ("add a log at", "slower", "faster")},
    "short holds": {"t_cr": ("slower",), "mu_s": ("slower",), "": ("add a", "slower")},
    "unresolved slips": {"t_cr": ("sample at", "add a"), "mu_s": ("sample at", "add a"), "": ("sample at",)},
    "slow only": {"": ("faster log", "add a log at")},
}
KINDS = tuple(ASKS)


@dataclass(frozen=True)
class Design:
    """Logs of a pair: kind of flaw, whether repaired, rejected draws on the way; truth and rig by name."""

    kind: str
    repaired: bool
    rejected: int
    truth: dict[str, float]
    rig: dict[str, float]
    logs: tuple[Log, ...]
    motions: tuple[Trajectory, ...]
    records: tuple[Record, ...]


def design(number: int) -> Design:
    """The design of a number (from 0): pair, kind of flaw and whether it is repaired follow from it."""
    pair, rest = divmod(number, 2 * len(KINDS))
    kind, repaired = KINDS[rest // 2], bool(rest % 2)
    random, rejected = np.random.default_rng([SEED, pair, rest // 2]), 0
    while True:
        truth, rig = _pair(random, kind)
        flawed, mended = _logs(random, kind, rig)
        chosen = mended if repaired else flawed
        if truth["mu_k0"] > 0.0 and truth["mu_k0"] + truth["delta_mu_k"] > 0.05:
            # The repair keeps the pair of its flaw: a pair is taken where all logs of both show cycles.
            motions = {log[:2]: _motion(truth | rig, log) for log in (*flawed, *mended)}
            sound = all(m.arrests.size >= FEWEST and not _reverses(m) for m in motions.values())
            if sound and all(log[2] * log[1] / motions[log[:2]].arrests.size >= SEEN for log in flawed):
                break
        rejected += 1
    noise = np.random.default_rng([SEED, pair, rest])
    taken = tuple(motions[log[:2]] for log in chosen)
    records = tuple(_record(motion, log, noise) for motion, log in zip(taken, chosen, strict=True))
    return Design(kind, repaired, rejected, truth, rig, chosen, taken, records)


def _pair(random: np.random.Generator, kind: str) -> tuple[dict[str, float], dict[str, float]]:
    mu_s, step = random.uniform(*USUAL.mu_s), random.uniform(*USUAL.step)
    truth = {"mu_s": mu_s, "mu_k0": mu_s - step, "delta_mu_k": random.uniform(*USUAL.delta_mu_k)}
    ageing = LONG_AGEING if kind == "short holds" else USUAL.t_cr
    for name, (low, high) in (("a", USUAL.a), ("D", USUAL.D), ("t_cr", ageing)):
        truth[name] = float(np.exp(random.uniform(np.log(low), np.log(high))))
    return truth, {name: value * USUAL.rig ** random.uniform(-1.0, 1.0) for name, value in RIG.items()}


def _logs(random: np.random.Generator, kind: str, rig: dict[str, float]) -> tuple[tuple[Log, ...], tuple[Log, ...]]:
    """The logs of a flawed design and of its repair."""
    if kind == "one speed":
        only = (SLOW, FAST)[int(random.integers(2))]
        return (only,), (SLOWER, SLOW, FAST, FASTER)
    if kind == "short holds":
        return (FAST, FASTER), (SLOWER, SLOW, FAST, FASTER)
    if kind == "unresolved slips":
        slip = float(np.pi * np.sqrt(rig["mass"] / rig["stiffness"]))
        rate = float(np.round(random.uniform(*FEW) / slip))
        return tuple((v, t, rate) for v, t, _ in (SLOWER, SLOW, FAST)), (SLOWER, SLOW, FAST, FASTER)
    return (SLOWEST, SLOWER), (SLOWEST, SLOWER, SLOW, FAST, FASTER)


def _motion(values: dict[str, float], log: Log) -> Trajectory:
    return run(assemble(MAIN), values, log[0], NORMAL_FORCE, log[1])


def _reverses(motion: Trajectory) -> bool:
    return any(phase.situated.direction < 0.0 for phase in motion.phases)


def _record(motion: Trajectory, log: Log, noise: np.random.Generator) -> Record:
    _, duration, rate = log
    times = np.arange(round(duration * rate) + 1) / rate
    force = motion.sample(times)["force"] + NOISE * noise.standard_normal(times.size)
    return Record(times, np.full(times.size, NORMAL_FORCE), force)


def scene_of(made: Design) -> Scene:
    """The scene a user would write."""
    logs = [{"path": f"log_{i}.csv", "drive_speed": log[0]} for i, log in enumerate(made.logs, 1)]
    return Scene.from_document(
        {"effects": [*MAIN, "varying_normal_force"], "rig": dict(made.rig), "logs": logs}, Path()
    )


def truths(
    made: Design,
    scene: Scene,
    answer: np.ndarray | None = None,
    claims: Claims | None = None,
    names: Sequence[str] = FRICTION,
) -> dict[str, Truth]:
    """The profile of each parameter, by brute force from the truth, and from the fit's answer as well, and from what
    the fit claims that the data do not object to, where that is found true."""
    speeds = [log[0] for log in made.logs]
    pair = made.truth | made.rig
    return true_profiles(scene, made.records, made.motions, speeds, pair, names, answer, claims)


def claims_of(found: Findings) -> Claims:
    """Per parameter the points (n_p,) to which the data do not object, of those that a fit met, the outermost first:
    from below and from above."""
    met = found.sure.profiles.met if found.sure is not None and found.sure.profiles is not None else ()
    lowest = min((point.cost for point in met), default=0.0)
    agreed = [point.theta for point in met if 2.0 * (point.cost - lowest) < OBJECTS]
    out = {}
    for name in FRICTION if agreed else ():
        i = found.unknowns.names.index(name)
        rising = sorted(agreed, key=lambda theta, i=i: float(theta[i]))
        out[name] = rising[:CLAIMS], rising[: -CLAIMS - 1 : -1]
    return out


def trial(number: int, names: Sequence[str] = FRICTION) -> dict[str, Any]:
    """One design: fitted, and judged by the truth of the named parameters."""
    made = design(number)
    scene = scene_of(made)
    began = time.process_time()
    _, found = find(scene, made.records, progress=lambda _stage, _share: None)
    fitted = time.process_time()
    told = {e.name: (e.verdict, e.reason) for e in found.estimates if e.name in FRICTION}
    try:
        answer = None if found.attempt is None else found.attempt.solved.theta
        claims = {name: sides for name, sides in claims_of(found).items() if name in names}
        known, unclear = truths(made, scene, answer, claims, names), ""
    except RuntimeError as error:
        known, unclear = {}, str(error)
    line: dict[str, Any] = {
        "number": number,
        "kind": made.kind,
        "repaired": made.repaired,
        "rejected": made.rejected,
        "pair": made.truth | made.rig,
        "logs": made.logs,
        "status": found.status.value,
        "message": found.message,
        "told": told,
        "truth": {name: asdict(t) | {"verdict": t.verdict(), "allowed": t.allowed} for name, t in known.items()},
        "unclear": unclear,
        "seconds": fitted - began,
        "seconds_of_truth": time.process_time() - fitted,
    }
    return line | judged(line)


def judged(line: dict[str, Any]) -> dict[str, Any]:
    """What is right and wrong in a trial."""
    told, truth = line["told"], line["truth"]
    wrong = [n for n in truth if told.get(n, ("none", ""))[0] not in truth[n]["allowed"]]
    asks = ASKS[line["kind"]]
    lacking = [] if line["repaired"] else [n for n in told if told[n][0] in ("weak", "not identifiable")]
    astray = [n for n in lacking if not any(word in told[n][1] for word in asks.get(n, asks[""]))]
    return {
        "wrong": wrong,
        "astray": astray,
        "right": line["status"] == "converged" and not wrong,
        "remedied": not astray,
        "open": [n for n in truth if truth[n]["verdict"] == "not identifiable" and not truth[n]["unclear"]],
    }


def study(first: int, last: int, file: Path | None = None, names: Sequence[str] = FRICTION) -> list[dict[str, Any]]:
    """The designs first to last, judged in these parameters, each printed, and appended to a file if one is given."""
    out = []
    for number in range(first, last + 1):
        line = trial(number, names)
        out.append(line)
        kind = line["kind"] + (", repaired" if line["repaired"] else "")
        print(
            f"{number:4d} {kind:26s} {'right' if line['right'] else 'WRONG':5s} "
            f"{'remedied' if line['remedied'] else 'ASTRAY':8s} {line['status']:15s} {line['seconds']:5.1f} s, truth "
            f"{line['seconds_of_truth']:5.1f} s  open in truth: {', '.join(line['open']) or 'none'} {line['unclear']}",
            flush=True,
        )
        for name in line["wrong"]:
            said, t = line["told"].get(name, ("none", "")), line["truth"][name]
            print(f"     {name}: says {said[0]}, truth {t['verdict']} ({t['low']} .. {t['value']:.4g} .. {t['high']})")
        for name in line["astray"]:
            print(f"     {name}: {line['told'][name][0]}: {line['told'][name][1]}")
        if line["status"] != "converged":
            print(f"     {line['message']}")
        append(file, line)
    return out


def table(lines: Sequence[dict[str, Any]]) -> None:
    """Counts, a row per kind of design."""
    print(f"\n{describe()}\n")
    print(
        "| design | designs | all six verdicts right | remedy right | not identifiable in truth | of these called so |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    for kind in KINDS:
        for repaired in (False, True):
            mine = [line for line in lines if line["kind"] == kind and line["repaired"] == repaired]
            if not mine:
                continue
            closed = [(line, n) for line in mine for n in line["open"]]
            called = sum(line["told"].get(n, ("",))[0] == "not identifiable" for line, n in closed)
            name = f"{kind}, repaired" if repaired else kind
            remedied = "–" if repaired else str(sum(line["remedied"] for line in mine))
            print(f"| {name} | {len(mine)} | {sum(x['right'] for x in mine)} | {remedied} | {len(closed)} | {called} |")
    print(
        f"\n{sum(line['right'] for line in lines)} of {len(lines)} designs judged right in all six parameters; ", end=""
    )
    flawed = [line for line in lines if not line["repaired"]]
    print(f"remedy right in {sum(line['remedied'] for line in flawed)} of {len(flawed)}; ", end="")
    print(f"{sum(line['rejected'] for line in lines)} draws rejected")
    print("status: " + ", ".join(f"{k} {v}" for k, v in Counter(line["status"] for line in lines).most_common()))
    clear = [(line, name, t) for line in lines for name, t in line["truth"].items() if not t["unclear"]]
    pairs = Counter((t["verdict"], line["told"].get(name, ("none",))[0]) for line, name, t in clear)
    print("\n| truth | called identified | weak | not identifiable | other |")
    print("| --- | --- | --- | --- | --- |")
    words = ("identified", "weak", "not identifiable")
    for truth in words:
        row = [pairs[truth, word] for word in words]
        other = sum(v for (t, w), v in pairs.items() if t == truth and w not in words)
        print(f"| {truth} | {' | '.join(map(str, row))} | {other} |")
    cured = Counter()
    by_number = {line["number"]: line for line in lines}
    for line in flawed:
        mended = by_number.get(line["number"] + 1)
        if mended is not None:
            cured[bool(line["open"]), bool(mended["open"])] += 1
    print(f"\n{cured[True, False] + cured[True, True]} flawed designs left some parameter not identifiable; ", end="")
    print(f"the repair left none in {cured[True, False]} of them")
    unclear = sum(t["unclear"] for line in lines for t in line["truth"].values())
    print(f"profiles that the brute force could not finish: {unclear} of {sum(len(line['truth']) for line in lines)}")
    print(f"processor seconds, median: fit {np.median([x['seconds'] for x in lines]):.1f}, ", end="")
    print(f"truth {np.median([x['seconds_of_truth'] for x in lines]):.1f}")


def main(fast: bool = False) -> list[dict[str, Any]]:
    """The whole study; fast: one design, judged in one parameter."""
    lines = study(7, 7, names=("mu_k0",)) if fast else study(0, DESIGNS - 1)
    table(lines)
    return lines


if __name__ == "__main__":
    started(main, table, cases(study))
