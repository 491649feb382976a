"""Does effects = "auto" find the effects a record was made with?

Random pairs with random subsets of effects are simulated (two logs each, white noise), and the data choose. An effect
is strong enough to be asked for where leaving it out of the model that made the record costs a likelihood-ratio
statistic of at least 50; one of more than 25 must never be dropped. Every record follows from the seed and its own
number, so the study can be run in parts: `run_effect_selection.py FIRST LAST FILE` appends one line of JSON per record,
`run_effect_selection.py table FILE` prints the table.
"""

from __future__ import annotations

import math
import sys
import time
import traceback
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record
from experiments import in_parts
from experiments.machine import describe
from identify.base.budget import time_limit
from identify.base.errors import SimulationError
from identify.diagnosis.fitted import Fitted, fits
from identify.diagnosis.nested import fit_model, fit_shaken, fit_smaller
from identify.diagnosis.selection import choose_from_data
from identify.effects import ALL, NAMES
from identify.model.model import assemble
from identify.scene import Scene
from identify.scene.variant import scene_with
from identify.simulation.plan import Stepping
from identify.simulation.simulate import run

RECORDS, SEED = 100, 20261121
QUICK = 62  # a record that is soon done, for the fast form
RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
NOISE = 5e-3
LOGS = ((1e-4, 12.0, 500.0, 1.0), (1e-3, 2.5, 1000.0, 1.4))  # drive speed [m/s], duration [s], rate [Hz], load [N]
USUAL = {"hysteresis_damping": 0.85, "contact_ageing": 0.85, "velocity_weakening": 0.8}  # chance of being there
EXTRA = 0.3  # chance of each of the others
OTHERS = (
    "direct_effect",
    "load_dependence",
    "varying_normal_force",
    "occlusion",
    "excitation",
    "finger_motion",
    "skin_compliance",
    "sensor_lag",
)
STRONG, KEEP = 50.0, 25.0


@dataclass(frozen=True)
class Trial:
    """One record: effects it was made with, effects chosen, statistic of each true one at the model that made the
    record, seconds, what went wrong; and of a law in whose place an interchangeable one was chosen, what that loses."""

    number: int
    true: tuple[str, ...]
    chosen: tuple[str, ...]
    statistics: dict[str, float]
    seconds: float
    complaint: str = ""
    other_laws: dict[str, float] = field(default_factory=dict)

    def found(self, effect: str) -> bool:
        """Whether the effect was chosen, or a law in its place that says the same."""
        return effect in self.chosen or self.other_laws.get(effect, np.inf) < KEEP

    @property
    def invented(self) -> list[str]:
        """Effects chosen that the record was not made with, nor as another law of one."""
        said = {mate for law, loss in self.other_laws.items() if loss < KEEP for mate in _mates(law)}
        return sorted(set(self.chosen) - set(self.true) - said)


def _mates(effect: str) -> set[str]:
    """The laws that can stand in the place of an effect."""
    role = next(e.role for e in ALL if e.name == effect)
    return {e.name for e in ALL if role and e.role == role and e.name != effect}


def draw(number: int) -> tuple[tuple[str, ...], dict[str, float], list[Record], int]:
    """Effects, parameters and logs of one record, and how many draws were passed over (fewer than three slips)."""
    random = np.random.default_rng([SEED, number])
    passed = 0
    while True:
        chance = USUAL | dict.fromkeys(OTHERS, EXTRA)
        there = {name for name, p in chance.items() if random.uniform() < p}
        effects = tuple(name for name in NAMES if name == "inertia" or name in there)
        truth = RIG | _parameters(random)
        noise_seed = int(random.integers(2**31))
        try:
            logs = _simulated(effects, truth, noise_seed)
        except SimulationError:
            logs = None
        if logs is not None:
            return effects, truth, logs, passed
        passed += 1


def _parameters(random: np.random.Generator) -> dict[str, float]:
    def log(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    mu_s, step = random.uniform(0.4, 0.8), random.uniform(0.1, 0.25)
    defaults = {q.name: q.default for effect in ALL for q in effect.parameters}
    return defaults | {
        "mu_s": mu_s,
        "mu_k0": mu_s - step,
        "delta_mu_k": random.uniform(-0.15, -0.03),
        "a": log(100.0, 1000.0),
        "D": log(15e-6, 60e-6),
        "t_cr": log(0.1, 1.5),
        "direct_strength": log(0.002, 0.012),
        "load_exponent": random.uniform(0.1, 0.4),
        "occlusion_level": random.choice([-1, 1]) * random.uniform(0.03, 0.15),
        "occlusion_time": log(3.0, 30.0),
        "excitation_amplitude": log(0.5e-6, 3e-6),
        "excitation_frequency": random.uniform(25.0, 60.0),
        "excitation_phase": random.uniform(-3.0, 3.0),
        "breathing_amplitude": 0.0,
        "pulse_amplitude": log(2e-6, 10e-6),
        "pulse_frequency": random.uniform(0.9, 1.5),
        "pulse_phase": random.uniform(-3.0, 3.0),
        "tremor_amplitude": log(1e-6, 3e-6),
        "tremor_frequency": random.uniform(8.0, 12.0),
        "tremor_phase": random.uniform(-3.0, 3.0),
        "skin_stiffness": log(2000.0, 20000.0),
        "lag_time": log(1e-3, 5e-3),
        "load_fall": random.uniform(0.05, 0.2),
        "noise": NOISE,
    }


def _simulated(effects: Sequence[str], truth: dict[str, float], seed: int) -> list[Record] | None:
    """The logs of one record; None where one of them shows fewer than three slips or slides in the end."""
    model, random = assemble(tuple(effects)), np.random.default_rng(seed)
    values = {q.name: truth[q.name] for q in model.parameters}
    out = []
    for speed, duration, rate, load in LOGS:
        times = np.arange(round(duration * rate)) / rate
        course: NDArray[np.float64] = np.full(times.size, load)
        given: float | tuple[NDArray[np.float64], NDArray[np.float64]] = load
        if "varying_normal_force" in effects:
            # the load relaxes as that of a finger does
            nodes = np.linspace(0.0, duration, 25)
            relaxed = load * (1.0 - truth["load_fall"] * -np.expm1(-3.0 * nodes / duration))
            given, course = (nodes, relaxed), np.interp(times, nodes, relaxed)
        motion = run(model, values, speed, given, duration, accuracy=Stepping(1e-9))
        arrests = motion.arrests
        if arrests.size < 4 or arrests[-1] < duration - 2.0 * float(np.median(np.diff(arrests))):
            return None
        force = motion.sample(times)["force"] + truth["noise"] * random.standard_normal(times.size)
        out.append(Record(times, course, force))
    return out


def _scene() -> Scene:
    logs = [{"path": f"log_{i}.csv", "drive_speed": speed} for i, (speed, *_) in enumerate(LOGS, 1)]
    return Scene.from_document({"effects": "auto", "rig": dict(RIG), "logs": logs}, Path())


def trial(number: int, limit: float = math.inf) -> Trial:
    """One record of the study, with so many seconds for the choice."""
    effects, truth, records, _ = draw(number)
    began = time.perf_counter()
    try:
        with time_limit(limit):
            choice = choose_from_data(_scene(), records)
    except Exception as error:  # noqa: BLE001 - a study counts what goes wrong
        said = "".join(traceback.format_exception_only(error)).strip()
        return Trial(number, effects, (), {}, time.perf_counter() - began, said)
    seconds = time.perf_counter() - began
    known = {r.effect: r.statistic for r in choice.reasons if r.statistic is not None}
    statistics, other_laws = _at_truth(effects, truth, records, choice.effects, known)
    return Trial(number, effects, choice.effects, statistics, seconds, other_laws=other_laws)


def _at_truth(
    effects: Sequence[str],
    truth: dict[str, float],
    records: Sequence[Record],
    chosen: Sequence[str],
    known: dict[str, float],
) -> tuple[dict[str, float], dict[str, float]]:
    """Statistics of the true effects at the model that made the record, those of a right choice are these already; and
    what a law chosen in the place of a true one loses."""
    asked = [e for e in effects if e != "inertia"]
    if set(chosen) == set(effects):
        return {e: known.get(e, np.inf) for e in asked}, {}
    names = {q.name for q in assemble(tuple(effects)).parameters}
    # Nothing is said of vibrations, whose rhythms the sticks show: one that rests has neither frequency nor phase.
    waves = ("_amplitude", "_frequency", "_phase")
    starts = {name: value for name, value in truth.items() if name in names and not name.endswith(waves)}

    def scene(some: Sequence[str]) -> Scene:
        # The noise that was put in: sums of models that estimate it each for itself cannot be compared.
        made = scene_with(_scene(), some, starts)
        return replace(made, rig=replace(made.rig, noise=NOISE))

    def best(some: Sequence[str]) -> Fitted:
        ways = [fit_model(scene(some), records, sources=source) for source in ("user", "data")]
        return fit_shaken(min(ways, key=lambda fitted: fitted.excess))

    full = best(effects)
    out = dict.fromkeys(asked, np.inf)
    if not fits(full):  # nothing is known: what is missing counts as strong
        return out, {}
    # The chosen model lacks every lost effect: where it is a part of the true one, no statistic is larger than its own.
    part = best(chosen).excess if set(chosen) < set(effects) else np.inf
    for effect in (e for e in asked if e not in chosen):
        smaller = fit_shaken(fit_smaller(full, scene([e for e in effects if e != effect]), records))
        out[effect] = min(smaller.excess, part) - full.excess
    laws = {}
    for effect, mate in ((e, m) for e in asked if e not in chosen for m in _mates(e) & set(chosen)):
        laws[effect] = best([mate if e == effect else e for e in effects]).excess - full.excess
    return out, laws


def table(trials: Sequence[Trial]) -> None:
    """Counts of a study."""
    judged = [t for t in trials if not t.complaint]
    print(f"\n{describe()}")
    print(f"records {len(trials)}, of which {len(trials) - len(judged)} ended with an error\n")
    print("| effect | made with | strong (>= 50) | found | 25 to 50 | found | weaker | found | absent | chosen |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    sums = np.zeros(9, int)
    for name in (*USUAL, *OTHERS, "linear_weakening"):
        row = _row(name, judged)
        sums += row
        print(f"| {name} | " + " | ".join(str(v) for v in row) + " |")
    print("| all | " + " | ".join(str(v) for v in sums) + " |\n")
    complete = [all(t.found(e) for e, s in t.statistics.items() if s >= STRONG) for t in judged]
    clean = [not t.invented for t in judged]
    kept = [all(t.found(e) for e, s in t.statistics.items() if s > KEEP) for t in judged]
    n = len(judged)
    print(f"all strong effects found: {sum(complete)} of {n} records")
    print(f"an effect of more than {KEEP:g} dropped: in {n - sum(kept)} of {n} records")
    print(f"no effect chosen that is not there: {sum(clean)} of {n} records")
    print(
        f"another law in the place of the true one, losing less than {KEEP:g}: {sum(len(t.other_laws) for t in judged)}"
    )
    seconds = [t.seconds for t in judged] or [0.0]
    print(f"seconds of a choice: median {np.median(seconds):.1f}, worst {max(seconds):.1f}")


def _row(name: str, trials: Sequence[Trial]) -> NDArray[np.int64]:
    there = [t for t in trials if name in t.true]
    row = [len(there)]
    for low, high in ((STRONG, np.inf), (KEEP, STRONG), (-np.inf, KEEP)):
        mine = [t for t in there if low <= t.statistics.get(name, np.nan) < high or high == t.statistics.get(name)]
        row += [len(mine), sum(t.found(name) for t in mine)]
    absent = [t for t in trials if name not in t.true]
    return np.array([*row, len(absent), sum(name in t.invented for t in absent)])


def study(first: int, last: int, file: Path | None, limit: float = math.inf) -> list[Trial]:
    """Records number first to last, each printed, and appended to a file if one is given."""
    trials = []
    for number in range(first, last + 1):
        done = trial(number, limit)
        trials.append(done)
        missed = [e for e in done.true if not done.found(e)]
        laws = {e: round(loss, 1) for e, loss in done.other_laws.items()}
        print(
            f"{number:4d} {done.seconds:6.1f} s  {len(done.true)} effects; missed {missed} "
            f"{ {e: round(done.statistics.get(e, np.nan), 1) for e in missed} }; invented {done.invented}"
            f"{f'; another law instead, which loses {laws}' if laws else ''} {done.complaint}",
            flush=True,
        )
        in_parts.append(file, asdict(done))
    return trials


def read(file: Path) -> list[Trial]:
    """The trials of a file."""
    lines = in_parts.read([file])
    return [Trial(**(line | {"true": tuple(line["true"]), "chosen": tuple(line["chosen"])})) for line in lines]


def main(fast: bool = False) -> list[Trial]:
    """The whole study of RECORDS records; fast: one, chosen for within two seconds."""
    trials = study(QUICK, QUICK, None, 2.0) if fast else study(1, RECORDS, None)
    table(trials)
    return trials


if __name__ == "__main__":
    if sys.argv[1:2] == ["table"]:
        table(read(Path(sys.argv[2])))
    elif sys.argv[1:]:
        study(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))
    else:
        main()
