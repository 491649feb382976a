"""What a map of the nonlinear model costs, and whether it is right: 60 x 60 nodes by continuation, on one core.

Per pair of quantities: processor seconds (the machine may be shared), then random nodes against plain simulation
(`brute_force`: outcome, drop and period) and random crossings of the end of stick-slip against a simulation that is
brought there from inside: it sticks a percent before the end, and slides a percent behind it.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]

import brute_force  # noqa: E402
import machine  # noqa: E402
from run_orbit_check import DEMO, EFFECTS  # noqa: E402
from run_pair_study import OUTCOMES  # noqa: E402

from identify.model.model import assemble  # noqa: E402
from identify.prediction.chart import Chart, chart  # noqa: E402
from identify.prediction.map_axes import Site  # noqa: E402

PLANES = (
    ("drive_speed", "stiffness"),
    ("drive_speed", "normal_force"),
    ("pressure", "area"),
    ("damping", "mass"),
    ("t_cr", "D"),
    ("mu_k0", "mu_step"),
    ("drive_speed", "a"),
)
MODEL = assemble(EFFECTS)
INSIDE = 0.01  # of a coordinate, before and behind an end


def _pair(w: np.ndarray) -> tuple[brute_force.Pair, float]:
    values = dict(zip(MODEL.parameter_names, w[:-2].tolist(), strict=True))
    return brute_force.Pair.of(values, float(w[-2])), float(w[-1])


def check_nodes(made: Chart, count: int, rng: np.random.Generator) -> tuple[int, float]:
    """Wrong outcomes among `count` random nodes, and the largest relative error of drop and period there."""
    wrong, worst = 0, 0.0
    nodes = np.argwhere(made.plane.admitted)
    for j, i in nodes[rng.choice(len(nodes), count, replace=False)].tolist():
        pair, speed = _pair(made.plane.settings[j, i])
        found, stable = brute_force.settled(pair, speed), brute_force.slides_on(pair, speed)
        said = str(made.outcomes[j, i])
        if found is None:  # the end of stick-slip is checked apart
            wrong += (said == "never sticks") is not stable and said != "bistable"
            continue
        wrong += said != OUTCOMES[True, stable]
        errors = (made.figures["drop"][j, i] / found.drop - 1, made.figures["period"][j, i] / found.period - 1)
        worst = max(worst, *(abs(float(e)) for e in errors))
    return wrong, worst


def check_ends(made: Chart, count: int, rng: np.random.Generator) -> tuple[int, int]:
    """Ends of stick-slip that were looked at, and how many of them simulation contradicts."""
    edges = list(made.sticking.crossings)
    chosen = [edges[k] for k in rng.choice(len(edges), min(count, len(edges)), replace=False)] if edges else []
    wrong = 0
    for edge in chosen:
        way, begin, finish = made.plane.way(edge)
        place = made.sticking.crossings[edge].place
        first = np.isfinite(made.multiplier[edge[1], edge[2]])
        start, side = (begin, 1.0) if first else (finish, -1.0)
        state: brute_force.State | None = None
        for at, sticks in ((start, True), (place - side * INSIDE, True), (place + side * INSIDE, False)):
            pair, speed = _pair(way.setting(at))
            found = brute_force.settled(pair, speed, (0.0, 1.0) if state is None else state)
            if (found is not None) is not sticks:
                wrong += 1
                break
            state = None if found is None else found.end
    return len(chosen), wrong


def main(fast: bool = False) -> float:
    """Print costs and checks; the processor seconds of the dearest map are returned."""
    print(machine.describe())
    points, site, rng = (8 if fast else 60), Site(MODEL, DEMO, 5e-3, 1.0, area=8e-5), np.random.default_rng(3)
    print(f"demo pair at 5 mm/s and 1 N, {points} x {points} nodes")
    dearest = 0.0
    for names in PLANES[:1] if fast else PLANES:
        begun, clock = time.process_time(), time.perf_counter()
        made = chart(site, names, points=(points, points))
        spent, passed = time.process_time() - begun, time.perf_counter() - clock
        dearest = max(dearest, spent)
        shares = ", ".join(f"{100 * share:.0f} % {word}" for word, share in made.shares.items())
        print(f"{names[0]} x {names[1]}: {spent:.1f} s of processor ({passed:.1f} s by the clock); {shares}")
        wrong, worst = check_nodes(made, 3 if fast else 30, rng)
        ends, contradicted = check_ends(made, 1 if fast else 10, rng)
        print(
            f"    {3 if fast else 30} nodes: {wrong} outcomes wrong, drop and period within {100 * worst:.2g} %; "
            f"{ends} ends: {contradicted} wrong",
            flush=True,
        )
    print(f"dearest map: {dearest:.1f} s of processor")
    return dearest


if __name__ == "__main__":
    main(fast="--fast" in sys.argv)
