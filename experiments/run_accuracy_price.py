"""What a fit says of the price of accuracy against what fits at those levels then cost and leave; effects likewise.

Of the demo and of three random usual pairs: what one fit at the default estimates for coarse and tight, and fits made
at these levels in the same warm process. Processor time, so that a busy machine counts less. Then the share of each
effect by instructions, as a fit says it, and by the time of a slip with and without it, none of them compiled.

    python experiments/run_accuracy_price.py
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import casadi as ca
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record
from experiments.study_problem import DEMO, USUAL, coefficients_only, random_case, scene_of
from identify import FitOptions, Scene, examples, fit
from identify.base.errors import SceneError
from identify.model.model import Model, assemble
from identify.shooting.accuracy import LEVELS, effect_shares
from identify.shooting.blocks import block

WITHIN = 0.3
REPEATS, BLOCKS = 3, 256


def scenes(fast: bool) -> dict[str, tuple[Scene, Sequence[Record] | None]]:
    """By name: a scene, and its records where they are no files."""
    usual = [random_case(np.random.default_rng(seed), USUAL)[0] for seed in (() if fast else (1, 2, 3))]
    demo = Scene.from_toml(examples.SCENE)
    if fast:
        demo = coefficients_only(demo.choose([str(log.path) for log in demo.logs[2:]]), DEMO)
    made: dict[str, tuple[Scene, Sequence[Record] | None]] = {"demo": (demo, None)}
    made |= {f"usual {number}": (scene_of(case), case.records) for number, case in enumerate(usual, 1)}
    return made


def spent(work: Callable[[], object]) -> float:
    """Processor seconds of some work, the least of some repeats."""
    taken = []
    for _ in range(REPEATS):
        since = time.process_time()
        work()
        taken.append(time.process_time() - since)
    return min(taken)


def levels_of(
    name: str, scene: Scene, records: Sequence[Record] | None, repeats: int
) -> list[tuple[str, float, float]]:
    """Of each level, what a default fit says of seconds and of the error over what a fit at that level has of them."""
    results = {}
    for level in LEVELS:
        options = FitOptions(accuracy=level)
        made = [fit(scene, records, asked=options).result for _ in range(repeats + 1)]
        results[level.name] = made[1:] or made  # functions are built once per process
    told = {entry["accuracy"]: entry for entry in results["default"][0]["accuracy"]["levels"]}
    default = min(result["accuracy"]["levels"][1]["seconds"] for result in results["default"])
    own = results["default"][0]["accuracy"]["levels"][1]["seconds"]
    rows = []
    for level in LEVELS:
        entries = [
            next(entry for entry in result["accuracy"]["levels"] if entry["accuracy"] == level.name)
            for result in results[level.name]
        ]
        said, seconds = told[level.name]["seconds"] - own + default, min(entry["seconds"] for entry in entries)
        expected, left = (entry["error_in_standard_errors"] for entry in (told[level.name], entries[0]))
        rows.append((level.name, said / seconds, expected / left))
        numbers = f"{said:8.2f} {seconds:8.2f} {said / seconds:6.2f} {expected:9.2g} {left:9.2g} {expected / left:6.2f}"
        print(f"{name:18s} {level.name:8s} {numbers}")
    return rows


def effects_of(model: Model) -> list[tuple[str, float, float]]:
    """Of each effect, its share of a slip's instructions and of the time that its functions take."""

    def seconds(made: Model) -> float:
        slots, constants, rows, curve = block(made, "slip", 4).expressions
        jacobian = ca.densify(ca.jacobian(ca.vertcat(rows, curve), slots))
        mapped = ca.Function("slip", [slots, constants], [rows, curve, jacobian]).map(BLOCKS)
        rng = np.random.default_rng(0)
        given = [ca.DM(rng.uniform(0.5, 1.0, (size.numel(), BLOCKS))) for size in (slots, constants)]
        return min(spent(lambda: mapped(*given)) for _ in range(5))

    whole, rows = seconds(model), []
    for name, share in effect_shares(model).items():
        try:
            less = seconds(assemble(tuple(other for other in model.effects if other != name)))
        except SceneError:
            continue
        rows.append((name, share, 1.0 - less / whole))
        print(f"{name:24s} {share:6.2f} {1.0 - less / whole:6.2f}")
    return rows


def main(fast: bool = False) -> list[tuple[str, float, float]]:
    """Ratios of seconds and of errors, by level; fast: of two logs of the demo, of which
    only the coefficients are searched."""
    print(
        f"{'scene':18s} {'level':8s} {'said s':>8s} {'cost s':>8s} {'ratio':>6s} {'said s.e.':>10s} {'left s.e.':>10s}"
    )
    rows, made = [], scenes(fast)
    for name, (scene, records) in made.items():
        rows += levels_of(name, scene, records, 0 if fast else REPEATS)
    off = [row for row in rows if any(abs(ratio - 1.0) > WITHIN for ratio in row[1:])]
    print(f"{len(rows) - len(off)} of {len(rows)} within {100 * WITHIN:g} %")
    print("share of the functions of the model: by instructions, by time")
    effects_of(next(iter(made.values()))[0].model)
    return rows


if __name__ == "__main__":
    main()
