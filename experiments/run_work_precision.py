"""What accuracy costs in time: work-precision tables and diagrams of simulation and fit, as docs/accuracy.md has them.

a. Orders: fixed steps, switches located and not, error against a reference with steps a hundred times finer.
b. Simulation: every method over a ladder of tolerances on an easy, a linear, a stiff and a near-critical scene, with
   scipy's event-driven and friction-smoothing programs beside them where they know the law.
c. What `accuracy` delivers: error asked for, estimated, and found.
d. Each effect: time of a simulation with it over that without.
e. Fit: parameters on ever finer grids, in standard errors.

    python experiments/run_work_precision.py [--docs] [--fast]     --docs: write docs/accuracy.md and its pictures
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")  # before numpy: one core means one thread

import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments import accuracy_page, grid_refinement  # noqa: E402
from experiments.machine import describe  # noqa: E402
from experiments.reference_methods import LINEAR, LOW, MIDDLE, OUTSIDE  # noqa: E402
from experiments.rivals import GivenUpError, Law, onsets_by_events, passages_by_smoothing  # noqa: E402
from experiments.study_problem import DEMO, RIG  # noqa: E402
from experiments.workprec import (  # noqa: E402
    Point,
    Scene,
    fixed_steps,
    ladder,
    measured_order,
    one_core,
    point,
    timed,
)
from identify.base.errors import SceneError, SimulationError  # noqa: E402
from identify.effects import ALL as EFFECTS  # noqa: E402
from identify.effects import MAIN  # noqa: E402
from identify.effects.quantities import Effect  # noqa: E402
from identify.simulation.steppers import (  # noqa: E402
    HIGH,
    STIFF,
    Method,
)
from identify.simulation.trajectory import Trajectory, distance  # noqa: E402

Array = NDArray[np.float64]

PAIR = DEMO | RIG
GENTLE = ("inertia", "hysteresis_damping", "velocity_weakening")
EASY = Scene("easy", "the test problem at 1 mm/s", MAIN, PAIR, 1e-3, 2.0)
LINEAR_SCENE = Scene(
    "linear", "friction linear in speed, no ageing", ("inertia", "hysteresis_damping", "linear_weakening"),
    PAIR | {"slope": -2.0}, 1e-3, 2.0,
)  # fmt: skip
STIFF_SCENE = Scene(
    "stiff", "a direct effect that sets in at 10 nm/s: decay rates up to 2.5e6/s", (*MAIN, "direct_effect"),
    PAIR | {"direct_strength": 0.005, "direct_speed": 1e-8}, 1e-3, 2.0,
)  # fmt: skip
CRITICAL = Scene(
    "near-critical", "21 mm/s, where stick-slip of the test problem is about to end", MAIN, PAIR, 2.1e-2, 1.0
)
SCENES = (EASY, LINEAR_SCENE, STIFF_SCENE, CRITICAL)
WIDTHS = (1e-3, 1e-4, 1e-5)  # of the tanh [m/s]
SMOOTHED_RTOL = 1e-7
PASSED = 1e-2  # sliding speed whose passage marks a slip in smoothed friction [m/s]
ORDER_STEPS: dict[Method, tuple[int, ...]] = {
    LOW: (40, 60, 80, 120, 160, 240),
    MIDDLE: (40, 56, 80, 112),
    HIGH: (8, 9, 10, 11, 12, 13),
    STIFF: (20, 28, 40, 56),
}


@dataclass(frozen=True)
class Order:
    """A method's stated order, and the measured slopes with switches located and not."""

    method: Method
    located: float
    not_located: float


def orders() -> list[Order]:
    """Slope of the error of the first arrest and the second onset over the step length, by equal steps.

    Every slip is half a step longer than a whole number of them, so that steps end at the same share of the last.
    """
    names = GENTLE
    scene = Scene("gentle", "", names, PAIR | {"a": 50.0}, 1e-3, 1.2)
    truth = scene.run(rtol=1e-14, method=HIGH)
    slip = truth.phases[1].duration

    def slope(method: Method, locate: bool) -> float:
        lengths = [slip / (count + 0.5) for count in ORDER_STEPS[method]]
        errors = []
        for h in lengths:
            found = Trajectory(scene.model, fixed_steps(scene, method, h, locate=locate), scene.duration)
            errors.append(abs(found.arrests[0] - truth.arrests[0]) + abs(found.onsets[1] - truth.onsets[1]))
        return measured_order(lengths, errors)

    return [Order(method, slope(method, True), slope(method, False)) for method in ORDER_STEPS]


def reference(scene: Scene) -> tuple[Trajectory, float]:
    """The scene at 1e-13, and how far a second method at its tightest is from it (of a cycle)."""
    closed = scene is LINEAR_SCENE
    truth = scene.run(rtol=1e-13, method=LINEAR if closed else HIGH)
    other = scene.run(rtol=1e-13, method=HIGH) if closed else scene.run(rtol=1e-11, method=STIFF)
    return truth, distance(truth, other).switches


def work(scene: Scene, repeats: int, fast: bool) -> tuple[list[Point], float]:
    """Points of all programs on one scene, and how well its reference is known."""
    truth, known = reference(scene)
    rtols = (1e-4, 1e-7) if fast else (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)
    out: list[Point] = []
    for method in (LOW, MIDDLE, HIGH, STIFF, LINEAR):
        few = tuple(r for r in rtols if r >= 1e-8) if method is LOW else rtols
        out += ladder(scene, method, few if method is not LINEAR else rtols[:1], truth.onsets, repeats)
    if not fast and scene is EASY:
        out += ladder(scene, OUTSIDE, (1e-6, 1e-8), truth.onsets, 1)
    if scene in (EASY, CRITICAL):
        out += rivals(scene, truth, 1 if fast else 3, fast)
    return out, known


def rivals(scene: Scene, truth: Trajectory, repeats: int, fast: bool) -> list[Point]:
    """scipy's programs: events, and tanh-smoothed friction of several widths."""
    law, period = Law(scene.values, scene.drive_speed, 1.0), scene.duration / truth.onsets.size
    out = []
    for rtol in (1e-6,) if fast else (1e-4, 1e-6, 1e-8, 1e-10):
        program = f"events, {'DOP853'}"
        found = lambda rtol=rtol: onsets_by_events(law, scene.duration, rtol)  # noqa: E731
        out.append(point(program, f"{rtol:.0e}", found, truth.onsets, period, repeats))
    passed = max(PASSED, 2.0 * scene.drive_speed)
    marks = passages(truth, passed)
    for method in ("LSODA",) if fast else ("LSODA", "Radau"):
        for width in WIDTHS[:1] if fast else WIDTHS:
            try:
                found = lambda m=method, w=width: smoothed(scene, law, w, m, passed)  # noqa: E731
                out.append(point(f"tanh, {method}", f"width {width:.0e}", found, marks, period, 1))
            except GivenUpError:
                out.append(Point(f"tanh, {method}", f"width {width:.0e}", np.nan, np.nan, np.nan, np.nan))
    return out


def smoothed(scene: Scene, law: Law, width: float, method: str, passed: float) -> Array:
    """Passages of the smoothed program at the tolerance of the table."""
    return passages_by_smoothing(law, scene.duration, width, SMOOTHED_RTOL, method, passed)


def passages(truth: Trajectory, speed: float) -> Array:
    """Times at which the sliding speed rises through `speed`, from the dense output by bisection [s]."""
    times = np.linspace(0.0, truth.duration, 200_001)
    v = truth.sample(times)["sliding_speed"]
    low = times[np.flatnonzero((v[:-1] < speed) & (v[1:] >= speed))]
    high = low + times[1]
    for _ in range(50):
        middle = 0.5 * (low + high)
        above = truth.sample(middle)["sliding_speed"] >= speed
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return high


def delivered(fast: bool) -> list[tuple[str, float, float, float, str]]:
    """Scene, accuracy asked for, estimated error, error found (switch times), methods."""
    rows = []
    for scene in SCENES[:2] if fast else SCENES:
        truth, _ = reference(scene)
        for accuracy in (1e-4,) if fast else (1e-3, 1e-5, 1e-7, 1e-9):
            found = scene.run(accuracy=accuracy)
            estimate = found.achieved
            assert estimate is not None
            error = distance(found, truth).switches
            rows.append((scene.name, accuracy, estimate.switches, error, ", ".join(found.methods)))
    return rows


def cost_of_effects(repeats: int, effects: Sequence[Effect] = EFFECTS) -> list[tuple[str, float]]:
    """Time of 2 s of the test problem with one more effect at its defaults over that without."""
    motion, plain = timed(EASY.run, repeats)
    per_slip = float(np.median(plain)) / motion.onsets.size
    rows = []
    for effect in effects:
        if effect.name in MAIN:
            names: tuple[str, ...] = tuple(n for n in MAIN if n != effect.name)
        else:
            rivals_ = {e.name for e in EFFECTS if effect.role and e.role == effect.role}
            needed = (*MAIN, *effect.needs)
            names = (*(n for n in needed if n not in rivals_), effect.name)
        values = {q.name: q.default for e in EFFECTS for q in e.parameters} | PAIR
        scene = Scene(effect.name, "", names, values, 1e-3, 2.0)
        try:
            found, seconds = timed(lambda scene=scene: scene.run(), repeats)  # type: ignore[misc]
        except (SceneError, SimulationError):
            continue  # without inertia nothing slips
        share = float(np.median(seconds)) / max(found.onsets.size, 1) / per_slip
        rows.append((f"without {effect.name}" if effect.name in MAIN else effect.name, share))
    return rows


def main(fast: bool = False, docs: bool = False) -> list[Order]:
    """Measure and print. fast: few points, one repetition, three small grids. docs: write the page and its pictures."""
    repeats = 1 if fast else 7
    with one_core():
        found = orders()
        works = {scene: work(scene, repeats, fast) for scene in (SCENES[:1] if fast else SCENES)}
        asked = delivered(fast)
        costs = cost_of_effects(*((1, EFFECTS[3:5]) if fast else (15,)))
        grids = grid_refinement.table((1, 2) if fast else (1, 2, 4, 8, 12, 24), (2, 3) if fast else (0, 1, 2, 3))
    page = accuracy_page.page(describe(), found, works, asked, costs, grids)
    print(page)
    if docs:
        accuracy_page.write(page, works)
    return found


def _given(words: Sequence[str]) -> None:
    main(fast="--fast" in words, docs="--docs" in words)


if __name__ == "__main__":
    _given(sys.argv[1:])
