"""Windows of drive speed of random pairs: the same whatever speed is asked at, and those of plain simulation.

Pairs and rigs are drawn from wide ranges. Each is asked at five drive speeds, one call each; then thousands of motions
are simulated side by side (`brute_force`, no line of the package in it) over a grid of drive speeds, from a
rested contact, from contacts that break loose fresher, and from the stick-slip of neighbouring speeds; steady sliding
is disturbed. An outcome agrees where the answer and the simulation say the same at a drive speed. Where stick-slip is
answered, its drop and period are held against the settled cycle of the simulation.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]

import machine  # noqa: E402
from brute_force import Lanes, begun, simulate, swings_die  # noqa: E402

from identify.base.document import to_dict  # noqa: E402
from identify.model.model import assemble  # noqa: E402
from identify.prediction.axes import Site  # noqa: E402
from identify.prediction.predict import predict  # noqa: E402

Array = NDArray[np.float64]
EFFECTS = ("inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening")
LOGARITHMIC = {
    "mass": (0.02, 1.0),
    "stiffness": (300.0, 5000.0),
    "damping": (5.0, 500.0),
    "a": (50.0, 1000.0),
    "D": (10e-6, 100e-6),
    "t_cr": (0.05, 5.0),
    "normal_force": (0.1, 5.0),
}
ASKED = 5
GRID = 20  # drive speeds of the simulation
FRESH = (0.6, 0.25, 0.05)  # gamma of the contacts that break loose fresher than rested
CYCLES = 60
SETTLED = 1e-4  # relative change of the drop in one cycle
SAME = 2e-3  # relative difference of limits that are called the same
WORDS = {(True, False): "always sticks", (True, True): "bistable", (False, True): "never sticks"}


def random_pairs(count: int, seed: int) -> list[dict[str, float]]:
    """Pairs, rigs and loads of wide ranges, SI."""
    rng = np.random.default_rng(seed)
    pairs: list[dict[str, float]] = []
    while len(pairs) < count:
        pair = {name: float(np.exp(rng.uniform(*np.log(ends)))) for name, ends in LOGARITHMIC.items()}
        pair["mu_s"] = float(rng.uniform(0.3, 1.0))
        pair["mu_k0"] = pair["mu_s"] - float(rng.uniform(0.05, 0.45))
        pair["delta_mu_k"] = float(rng.uniform(-0.3, 0.05))
        if pair["mu_k0"] + pair["delta_mu_k"] > 0.03 and pair["mu_k0"] > 0.1:
            pairs.append(pair)
    return pairs


def speed_span(pair: Mapping[str, float]) -> tuple[float, float]:
    """Drive speeds [m/s] within which something happens."""
    fall = pair["mu_s"] - pair["mu_k0"] - min(0.0, pair["delta_mu_k"])
    typical = fall * pair["normal_force"] / np.sqrt(pair["mass"] * pair["stiffness"])
    return 0.1 * min(typical, pair["D"] / pair["t_cr"]), 5.0 * typical


def spread_speeds(pair: Mapping[str, float], count: int, rng: np.random.Generator) -> Array:
    """Rising drive speeds [m/s], one in each of equal parts of the logarithm."""
    low, high = np.log(speed_span(pair))
    return np.asarray(np.exp(low + (high - low) * (np.arange(count) + rng.uniform(0, 1, count)) / count))


def sticking(pairs: Sequence[Mapping[str, float]], speeds: Array, cycles: int = CYCLES) -> NDArray[np.bool_]:
    """Whether stick-slip exists at drive speeds (pairs, g), by simulation from many starts."""
    count = speeds.shape[1]
    lanes = Lanes.of([pair for pair in pairs for _ in range(count)], speeds.ravel())
    sticks, course = begun(lanes, cycles, FRESH)
    rest = course.rest
    for shift in (1, -1) * 3:  # from the stick-slip of the neighbour, a few times
        grid = sticks.reshape(-1, count)
        beside = np.roll(grid, shift, axis=1)
        beside[:, 0 if shift > 0 else -1] = False
        left = np.flatnonzero((beside & ~grid).ravel())
        if left.size:
            course = simulate(lanes.take(left), rest[:, left - shift], cycles)
            sticks[left], rest[:, left] = ~course.slides, course.rest
    return sticks.reshape(-1, count)


def cycle_errors(
    pairs: Sequence[Mapping[str, float]], answers: Sequence[Sequence[Mapping[str, Any]]], cycles: int = CYCLES
) -> dict[str, Array]:
    """Relative errors (n,) of drop and period by name, of all answers with a stick-slip that settles in time."""
    rows = [
        (pair, one) for pair, each in zip(pairs, answers, strict=True) for one in each
        if one["amplitude"]["drop"]["value"] is not None
    ]  # fmt: skip
    speeds = np.array([one["operating_point"]["drive_speed"]["value"] for _, one in rows])
    lanes = Lanes.of([pair for pair, _ in rows], speeds)
    sticks, course = begun(lanes, cycles, FRESH)
    settled = sticks & (np.abs(simulate(lanes, course.rest, 1).drop / course.drop - 1.0) < SETTLED)
    return {
        name: np.array([one["amplitude"][name]["value"] for _, one in rows])[settled] / getattr(course, name)[settled]
        - 1
        for name in ("drop", "period")
    }


def said_at(document: Mapping[str, Any], speed: float) -> str:
    """What the windows of an answer say of a drive speed [m/s]."""
    windows = document["stability"]["windows"]
    return str(next((w["outcome"] for w in windows if w["from"] <= speed <= w["to"]), windows[-1]["outcome"]))


def contradiction(document: Mapping[str, Any]) -> str:
    """What in an answer contradicts something else in it; "" where nothing does."""
    part, speed = document["stability"], document["operating_point"]["drive_speed"]["value"]
    outcome, window, text = part["outcome"], said_at(document, speed), document["text"]
    sticks = outcome in ("always sticks", "bistable", "sticks irregularly")
    same = outcome == window or (outcome == "sticks irregularly" and window in ("always sticks", "bistable"))
    if not same:
        return f"{outcome} at a speed whose window says {window}"
    if sticks and ("no stick-slip" in text.lower() or not part["stick_slip_between"]):
        return f"{outcome}, and no stick-slip anywhere"
    end = part["critical_speed"]["value"]
    if end is not None and sticks and speed > end:
        return f"{outcome} above the end of stick-slip"
    return ""


def limits(document: Mapping[str, Any]) -> tuple[list[str], Array]:
    """Outcomes of the windows in rising order, and the speeds [m/s] between them."""
    windows = document["stability"]["windows"]
    return [w["outcome"] for w in windows], np.array([w["from"] for w in windows[1:]])


def alike(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether two answers have the same windows."""
    (words, ends), (others, beside) = limits(one), limits(other)
    return words == others and bool(np.all(np.abs(ends / beside - 1.0) < SAME))


def main(fast: bool = False, count: int = 60, seed: int = 50) -> float:
    """Print the table; the share of drive speeds at which answer and simulation agree is returned."""
    count, grid = (2, 4) if fast else (count, GRID)
    rng, pairs = np.random.default_rng(seed + 1), random_pairs(count, seed)
    model, began = assemble(EFFECTS), time.process_time()
    print(machine.describe())
    answers = []
    for pair in pairs:
        asked = spread_speeds(pair, 2 if fast else ASKED, rng)
        answers.append([to_dict(predict(Site(model, pair, float(v), pair["normal_force"]))) for v in asked])
    print(f"{count} pairs asked at {len(answers[0])} drive speeds: {time.process_time() - began:.0f} s of CPU")
    same = [all(alike(each[0], other) for other in each[1:]) for each in answers]
    wrong = [text for each in answers for document in each if (text := contradiction(document))]
    print(f"same windows from every speed asked: {sum(same)} of {count}")
    print(f"answers that contradict themselves: {len(wrong)} of {sum(map(len, answers))} {wrong[:5]}")
    began = time.process_time()
    speeds = np.stack([spread_speeds(pair, grid, rng) for pair in pairs])
    sticks = sticking(pairs, speeds, 12 if fast else CYCLES)
    stable = swings_die(Lanes.of([p for p in pairs for _ in range(grid)], speeds.ravel())).reshape(sticks.shape)
    print(f"simulated in {time.process_time() - began:.0f} s of CPU")
    rows = [
        (said_at(answers[i][0], float(speeds[i, j])), WORDS.get((bool(sticks[i, j]), bool(stable[i, j])), "undecided"))
        for i in range(count)
        for j in range(grid)
    ]
    right = np.array([a == b for a, b in rows]).reshape(count, grid)
    for i, j in np.argwhere(~right).tolist():
        answer, truth = rows[i * grid + j]
        print(f"  pair {i} at {1e3 * speeds[i, j]:.4g} mm/s: {answer}; simulation: {truth}")
    print(f"agree: {np.sum(right)} of {right.size} drive speeds ({100 * np.mean(right):.2f} %), "
          f"{int(np.sum(right.all(axis=1)))} of {count} pairs at all of theirs")  # fmt: skip
    for name, errors in cycle_errors(pairs, answers, 12 if fast else CYCLES).items():
        off = 100.0 * np.abs(errors)
        print(f"{name}: {off.size} compared, median {np.median(off):.4f} %, largest {np.max(off):.4f} %")
    return float(np.mean(right)) if all(same) and not wrong else 0.0


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    main("--fast" in sys.argv, *numbers)
