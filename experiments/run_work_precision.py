"""What accuracy costs: one table for a simulation, one for a fit, and the orders of the methods, as docs/accuracy.md.

Orders: fixed steps, switches located and not, error against a reference with steps a hundred times finer. Simulation:
error asked for by `accuracy`, estimated and found, and processor time beside scipy's `solve_ivp` with events at a
tolerance that leaves no larger error; what `stickslip simulate --verbose` says of other accuracies beside what they
take, of these scenes and of random pairs and rigs. Fit: of the example and of random usual pairs, what one fit at the
default level says of the others, and what fits at these levels then take and leave.

    python experiments/run_work_precision.py
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record
from experiments.machine import describe
from experiments.reference_methods import LOW, MIDDLE
from experiments.study_problem import DEMO, RIG, coefficients_only, recovery_case, scene_of
from identify import FitOptions, examples, fit
from identify import Scene as FitScene
from identify.effects import MAIN
from identify.model.model import Model, assemble
from identify.shooting.accuracy import LEVELS
from identify.simulation.drive import Drive, NormalForce
from identify.simulation.phases import Machine, Phase, phases
from identify.simulation.plan import Stepping, scales
from identify.simulation.simulate import cost, run, simulate
from identify.simulation.steppers import HIGH, STIFF, Method
from identify.simulation.trajectory import Trajectory, distance
from tests.support import oracle

Array = NDArray[np.float64]

PAIR = DEMO | RIG
ORDER_STEPS: dict[Method, tuple[int, ...]] = {
    LOW: (40, 60, 80, 120, 160, 240),
    MIDDLE: (40, 56, 80, 112),
    HIGH: (8, 9, 10, 11, 12, 13),
    STIFF: (20, 28, 40, 56),
}
ASKED = (1e-3, 1e-5, 1e-7, 1e-9)
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)  # of solve_ivp
PAIRS = range(19)  # of the recovery study, beside the example
RANDOM = 16  # pairs and rigs whose simulations are timed, beside SCENES
WITHIN = 0.3


@dataclass(frozen=True, eq=False)
class Scene:
    """A named simulation: effects, all parameters, drive speed [m/s] and duration [s] under 1 N."""

    name: str
    effects: tuple[str, ...]
    values: dict[str, float]
    drive_speed: float
    duration: float

    @property
    def model(self) -> Model:
        """The composed model."""
        return assemble(self.effects)

    @property
    def document(self) -> FitScene:
        """As a user writes it."""
        rig = {name: self.values[name] for name in RIG} | {"drive_speed": self.drive_speed, "normal_force": 1.0}
        friction = {p.name: self.values[p.name] for p in self.model.parameters if p.name in self.values.keys() - RIG}
        starts = {name: {"start": value} for name, value in friction.items()}
        return FitScene.from_document({"effects": list(self.effects), "rig": rig, "parameters": starts})

    def run(self, accuracy: float | Stepping) -> Trajectory:
        """Simulate it to an accuracy, or with a relative tolerance of steps of one method."""
        return run(self.model, self.values, self.drive_speed, 1.0, self.duration, accuracy=accuracy)


SCENES = (
    Scene("easy: 1 mm/s", MAIN, PAIR, 1e-3, 2.0),
    Scene(
        "linear: friction linear in speed, no ageing", ("inertia", "hysteresis_damping", "linear_weakening"),
        PAIR | {"slope": -2.0}, 1e-3, 2.0,
    ),
    Scene(
        "stiff: a direct effect that sets in at 10 nm/s", (*MAIN, "direct_effect"),
        PAIR | {"direct_strength": 0.005, "direct_speed": 1e-8}, 1e-3, 2.0,
    ),
    Scene("near-critical: 21 mm/s, where stick-slip is about to end", MAIN, PAIR, 2.1e-2, 1.0),
)  # fmt: skip


@dataclass(frozen=True)
class Order:
    """A method's stated order, and the measured slopes with switches located and not."""

    method: Method
    located: float
    not_located: float


def fixed_steps(scene: Scene, method: Method, h: float, *, locate: bool = True) -> tuple[Phase, ...]:
    """The scene with steps of length h [s] and no error control; switches located or not."""
    model = scene.model
    p = np.array([scene.values[name] for name in model.parameter_names])
    scale = replace(scales(model, p, 1.0), longest=h)
    machine = Machine(model, p, scale, Stepping(1e6, method, locate))
    machine.first = dict.fromkeys(machine.first, h)
    x = np.array([state.start for state in model.states], float)
    return tuple(phases(machine, Drive.of(scene.drive_speed), NormalForce.of(1.0), scene.duration, x))


def orders() -> list[Order]:
    """Slope of the error of the first arrest and the second onset over the step length, by equal steps.

    Every slip is half a step longer than a whole number of them, so that steps end at the same share of the last.
    """
    names = ("inertia", "hysteresis_damping", "velocity_weakening")
    scene = Scene("gentle", names, PAIR | {"a": 50.0}, 1e-3, 1.2)
    truth = scene.run(Stepping(1e-14, HIGH))
    slip = truth.phases[1].duration

    def slope(method: Method, locate: bool) -> float:
        lengths = [slip / (count + 0.5) for count in ORDER_STEPS[method]]
        errors = []
        for h in lengths:
            found = Trajectory(scene.model, fixed_steps(scene, method, h, locate=locate), scene.duration)
            errors.append(abs(found.arrests[0] - truth.arrests[0]) + abs(found.onsets[1] - truth.onsets[1]))
        return float(np.polyfit(np.log(lengths), np.log(errors), 1)[0])

    return [Order(method, slope(method, True), slope(method, False)) for method in ORDER_STEPS]


def timed(work: Callable[[], Any], repeats: int) -> tuple[Any, float]:
    """The result of the first, untimed call, and the median processor time [s] of more."""
    result, seconds = work(), []
    for _ in range(repeats):
        since = time.process_time()
        work()
        seconds.append(time.process_time() - since)
    return result, float(np.median(seconds))


def simulations(scenes: Sequence[Scene], asked: Sequence[float], repeats: int) -> list[str]:
    """Rows: accuracy asked for, estimated, found (of switch times over the mean cycle), ms, times as fast as events."""
    rows = []
    for scene in scenes:
        truth = scene.run(Stepping(1e-13, HIGH if scene is not SCENES[2] else STIFF))
        period = scene.duration / truth.onsets.size
        usual = []
        if scene.effects == MAIN:
            for rtol in TOLERANCES:
                asked_for = (scene.values, scene.drive_speed, 1.0, scene.duration)
                events, seconds = timed(partial(oracle.simulate, *asked_for, rtol=rtol), 1)
                if events.onsets.size == truth.onsets.size:
                    usual.append((float(np.max(np.abs(events.onsets - truth.onsets))) / period, seconds))
        for accuracy in asked:
            motion, seconds = timed(partial(scene.run, accuracy), repeats)
            estimate, error = motion.achieved.switches, distance(motion, truth).switches
            others = [spent for off, spent in usual if off <= max(error, 1e-10)]
            faster = f"{min(others) / seconds:.0f}" if others else "–"
            methods = ", ".join(motion.methods)
            rows.append(
                f"| {scene.name} | {accuracy:.0e} | {estimate:.1e} | {error:.1e} | {methods} | {1e3 * seconds:.1f} "
                f"| {faster} |"
            )
    return rows


def random_scenes(count: int) -> list[Scene]:
    """Pairs, rigs and drive speeds around those of the demo."""
    random, out = np.random.default_rng(1), []
    for number in range(count):
        apart = {name: PAIR[name] * np.exp(random.normal(0.0, 0.4)) for name in (*RIG, "a", "D", "t_cr")}
        speed = 1e-3 * float(np.exp(random.normal(0.0, 1.2)))
        out.append(Scene(f"random {number}", MAIN, PAIR | apart, speed, 2e-3 / speed))
    return out


def costs(scenes: Sequence[Scene]) -> tuple[list[str], int, int]:
    """Rows: seconds said over seconds taken at each other accuracy; how many are within WITHIN, of how many. The
    functions are built before, which costs the same at every accuracy."""
    rows, ratios = [], []
    for scene in scenes:
        stated = scene.document

        def least(accuracy: float, stated: FitScene = stated, long: float = scene.duration) -> tuple[Trajectory, float]:
            runs = [timed(lambda: simulate(stated, long, accuracy=accuracy).refined(), 1) for _ in range(3)]
            return runs[0][0], min(seconds for _, seconds in runs)

        motion, taken = least(ASKED[1])
        said = cost(stated, motion, taken).seconds
        mine = [said[level] / least(level)[1] for level in said if level != motion.accuracy]
        ratios += mine
        order = "in order" if list(said.values()) == sorted(said.values()) else "not in order"
        rows.append(f"| {scene.name} | {1e3 * taken:.1f} | {' '.join(f'{q:.2f}' for q in mine)} | {order} |")
    return rows, sum(abs(ratio - 1.0) <= WITHIN for ratio in ratios), len(ratios)


def fits(cases: Sequence[tuple[str, FitScene, Sequence[Record] | None]]) -> tuple[list[str], int, int]:
    """Rows of fits: level, seconds said and taken, error said and left [standard errors]; how many are within WITHIN,
    of how many."""
    rows, good, count = [], 0, 0
    for name, scene, records in cases:
        results = {}
        for level in LEVELS:
            fit(scene, records, options=FitOptions(accuracy=level))  # functions are built once per process
            results[level.name] = fit(scene, records, options=FitOptions(accuracy=level)).result["accuracy"]
        if not all(results.values()):  # a loaded machine has no answer within the time limit
            rows.append(f"| {name} | no answer within the time limit | – | – | – | – |")
            continue
        results = {level: accuracy["levels"] for level, accuracy in results.items()}
        said = {entry["accuracy"]: entry for entry in results["default"]}
        for level in (level.name for level in LEVELS):
            own = next(entry for entry in results[level] if entry["accuracy"] == level)
            numbers = [said[level]["seconds"], own["seconds"]]
            errors = [entry["error_in_standard_errors"] for entry in (said[level], own)]
            good += all(abs(a / b - 1.0) <= WITHIN for a, b in (numbers, errors) if b)
            count += 1
            rows.append(
                f"| {name} | {level} | {numbers[0]:.2f} | {numbers[1]:.2f} | {errors[0]:.1g} | {errors[1]:.1g} |"
            )
    return rows, good, count


def main(fast: bool = False) -> list[Order]:
    """Measure and print; fast: one scene, one short fit."""
    found = orders()
    print(f"{describe()}\n\n| method | stated order | measured, switches located | measured, not located |")
    print("| --- | --- | --- | --- |")
    for o in found:
        print(f"| {o.method.name} | {o.method.order} | {o.located:.2f} | {o.not_located:.2f} |")
    print("\n| scene | asked for | estimated | found | methods | ms | times as fast as solve_ivp with events |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    print("\n".join(simulations(SCENES[:1], ASKED[:1], 1) if fast else simulations(SCENES, ASKED, 7)))
    rows, good, count = costs(SCENES[:1] if fast else (*SCENES, *random_scenes(RANDOM)))
    print("\n| scene | ms | seconds said over taken at other accuracies | levels |\n| --- | --- | --- | --- |")
    print("\n".join(rows), f"\n\n{good} of {count} within {100 * WITHIN:.0f} %")
    demo = FitScene.from_toml(examples.SCENE)
    if fast:
        demo = coefficients_only(demo.choose([str(log.path) for log in demo.logs[3:]]), DEMO)
    cases = [(f"usual {n}", recovery_case("usual", n)) for n in (() if fast else PAIRS)]
    rows, good, count = fits([("example", demo, None), *((name, scene_of(c), c.records) for name, c in cases)])
    print("\n| fit | level | seconds, said | taken | error in standard errors, said | left |")
    print("| --- | --- | --- | --- | --- | --- |")
    print("\n".join(rows))
    print(f"\n{good} of {count} within {100 * WITHIN:.0f} %")
    return found


if __name__ == "__main__":
    main()
