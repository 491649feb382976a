"""Where the paper's closed forms hold: their errors by a V_max, and their outcomes against plain simulation.

Part 1: 200 scenes whose a V_max (of the nonlinear model) spans 1e-3 to 10, twice: with a contact as the closed forms
assume it (worn out at once: slips a thousand times longer than D), and with D and t_cr of the study ranges. Error of
drop, period, amplitude (largest elongation over the equilibrium) and peak speed by decade; the limit up to which 95 %
of the scenes are within 5 %. Truth: the periodic orbit, which `run_pair_study` holds against simulation; a few scenes
are simulated here too.

Part 2: outcomes over three planes, of the map of the nonlinear model and of the closed forms, against plain simulation
(`brute_force`): from a rested contact, brought from slower drives, and from disturbed sliding.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]

import brute_force  # noqa: E402
import machine  # noqa: E402
from run_orbit_check import DEMO, EFFECTS, RIG  # noqa: E402
from run_pair_study import OUTCOMES  # noqa: E402

from identify.model.model import assemble  # noqa: E402
from identify.prediction.chart import chart  # noqa: E402
from identify.prediction.chart_bands import sliding_margin, slip_margin  # noqa: E402
from identify.prediction.closed_forms import jump, known_settings  # noqa: E402
from identify.prediction.cycle import CycleMap  # noqa: E402
from identify.prediction.map_axes import Site, moved_values  # noqa: E402
from identify.prediction.orbit import Orbit, settle  # noqa: E402
from identify.prediction.quantities import QUANTITIES, extremes, quantities  # noqa: E402
from identify.simulation.trajectory import moments  # noqa: E402

Array = NDArray[np.float64]

SHOWN = ("drop", "period", "amplitude", "peak_speed")
GOOD = 0.05  # error up to which a closed form counts as valid
DECADES = (1e-3, 1e-2, 1e-1, 1.0, 10.0)
LENGTHS = (0.0, 3.0, 10.0, 30.0, 100.0, np.inf)  # slip over D, of the error map
MODEL = assemble(EFFECTS)
PLANES: tuple[tuple[str, str, dict[str, float]], ...] = (
    ("drive_speed", "stiffness", {}),
    ("drive_speed", "normal_force", {"delta_mu_k": -0.02, "a": 30.0, "D": 2e-6}),
    ("drive_speed", "damping", {"delta_mu_k": -0.005, "a": 10.0, "D": 1e-7, "t_cr": 1e-3}),
)  # quantities, and what differs from the demo pair


@dataclass(frozen=True)
class Scene:
    """Values, drive speed [m/s], a V_max of the orbit, slip over D, errors of SHOWN (NaN: no closed form)."""

    values: dict[str, float]
    drive_speed: float
    a_v_max: float
    length: float
    errors: Array


def _orbit(values: dict[str, float], speed: float) -> tuple[CycleMap, Orbit] | None:
    map_ = CycleMap(MODEL, 1.0, np.array([values[n] for n in MODEL.parameter_names]), rtol=1e-8)
    orbit = settle(map_, speed).orbit
    return None if orbit is None else (map_, orbit)


def _largest_elongation(found: tuple[CycleMap, Orbit]) -> float:
    """During the slip [m]."""
    map_, orbit = found
    times = np.linspace(0.0, orbit.cycle.slip, 4001)
    return float(np.max(moments(map_.model, orbit.cycle.slides, times)["elongation"]))


def _scene(rng: np.random.Generator, target: float, assumed: bool) -> Scene | None:
    """A scene whose a V_max is `target`; `assumed`: the contact wears out at once. None: it does not stick there."""
    step, mu_s = rng.uniform(0.1, 0.25), rng.uniform(0.4, 0.8)
    values = {**RIG, "mu_s": mu_s, "mu_k0": mu_s - step, "delta_mu_k": rng.uniform(-0.15, -0.02), "a": 1.0}
    values["D"] = float(np.exp(rng.uniform(np.log(15e-6), np.log(60e-6))))
    values["t_cr"] = float(np.exp(rng.uniform(np.log(0.1), np.log(2.0))))
    if assumed:
        values["D"] = 2e-3 * step / values["stiffness"]  # a thousandth of the slip 2 step F_n / k
    speed = float(np.exp(rng.uniform(np.log(1e-5), np.log(2e-3))))
    if values["mu_k0"] + values["delta_mu_k"] < 0.05 or mu_s > 3 * values["mu_k0"]:
        return None
    for _ in range(40):
        found = _orbit(values, speed)
        if found is None:
            return None
        ratio = target / (values["a"] * extremes(found[0], found[1].cycle)[2].value)
        if abs(ratio - 1) < 1e-3:
            break
        values["a"] *= float(np.clip(ratio, 0.1, 10.0))
    else:
        return None
    map_, orbit = found
    told = dict(zip(QUANTITIES, quantities(map_, orbit.cycle, speed).tolist(), strict=True))
    fresh = values["mu_k0"] - values["delta_mu_k"] * np.expm1(-values["a"] * speed)
    told["amplitude"] = _largest_elongation(found) - fresh / values["stiffness"]
    pair = SimpleNamespace(**known_settings(values))
    closed = jump(pair, pair, speed, 1.0)
    errors = np.array([abs(getattr(closed, name) / told[name] - 1) for name in SHOWN])
    return Scene(values, speed, target, told["slip_distance"] / values["D"], errors)


def scenes(count: int, assumed: bool, seed: int) -> tuple[list[Scene], int]:
    """Scenes with a V_max even in powers over DECADES, and how many draws were rejected."""
    rng = np.random.default_rng(seed)
    found: list[Scene] = []
    rejected = 0
    for target in np.geomspace(DECADES[0], DECADES[-1], count).tolist():
        while (scene := _scene(rng, target, assumed)) is None:
            rejected += 1
        found.append(scene)
    return found, rejected


def error_table(found: list[Scene]) -> float:
    """Print errors by decade; the a V_max up to which 95 % of the scenes are within GOOD in all but peak speed."""
    print(f"{'a V_max':>16s} {'scenes':>7s} {'no answer':>10s}" + "".join(f"{n:>22s}" for n in SHOWN))
    for low, high in pairwise(DECADES):
        here = [s for s in found if low <= s.a_v_max < high or (high == DECADES[-1] and s.a_v_max == high)]
        errors = np.array([s.errors for s in here])
        answered = errors[np.isfinite(errors[:, 0])]
        cells = [
            f"{100 * np.median(column):8.3g} {100 * np.max(column):8.3g} %" if column.size else "-"
            for column in answered.T
        ] or ["-"] * len(SHOWN)
        row = "".join(f"{cell:>22s}" for cell in cells)
        print(f"{low:7.0e}..{high:7.0e} {len(here):7d} {len(here) - len(answered):10d}{row}")
    ordered = sorted(found, key=lambda s: s.a_v_max)
    wrong = np.cumsum([not np.all(s.errors[:3] <= GOOD) for s in ordered])
    share = wrong / np.arange(1, len(ordered) + 1)
    good = np.flatnonzero((share <= 0.05) & (np.arange(len(ordered)) >= 9))  # a few scenes show no share
    return ordered[int(good[-1])].a_v_max if good.size else float("nan")


def error_map(found: list[Scene]) -> None:
    """Print the median error of the drop by a V_max and by slip over D."""
    print("median error of the drop by a V_max (rows) and by slip distance over D (columns); scenes in brackets")
    print(f"{'':16s}" + "".join(f"{f'{a:g} to {b:g}':>18s}" for a, b in pairwise(LENGTHS)))
    for low, high in pairwise(DECADES):
        cells = []
        for a, b in pairwise(LENGTHS):
            here = [s.errors[0] for s in found if low <= s.a_v_max <= high and a <= s.length < b]
            known = [e for e in here if np.isfinite(e)]
            said = f"{100 * np.median(known):.3g} %" if known else "no answer" if here else "-"
            cells.append(f"{said} ({len(here)})")
        print(f"{low:7.0e}..{high:7.0e}" + "".join(f"{cell:>18s}" for cell in cells))


def check_truth(found: list[Scene], count: int) -> float:
    """Largest difference of drop and period between orbit and plain simulation over a few scenes."""
    worst = 0.0
    for scene in found[:: max(len(found) // count, 1)]:
        result = _orbit(scene.values, scene.drive_speed)
        brute = brute_force.settled(brute_force.Pair.of(scene.values), scene.drive_speed)
        assert result is not None and brute is not None
        told = quantities(*(result[0], result[1].cycle), scene.drive_speed)
        worst = max(worst, abs(told[0] / brute.drop - 1), abs(told[1] / brute.period - 1))
    return worst


def simulated_plane(sites: list[list[tuple[brute_force.Pair, float]]]) -> NDArray[np.str_]:
    """Outcomes (n_y, n_x) of rows of (pair, drive speed) at rising drive speeds."""
    out = np.empty((len(sites), len(sites[0])), dtype="<U20")
    for j, row in enumerate(sites):
        state: Any = None
        for i, (pair, speed) in enumerate(row):
            found = brute_force.settled(pair, speed)
            if found is None and state is not None:
                found = brute_force.settled(pair, speed, state)
            state = None if found is None else found.end
            out[j, i] = OUTCOMES[found is not None, brute_force.slides_on(pair, speed)]
    return out


def closed_plane(site: Site, x: str, y: str, grid: tuple[Array, Array]) -> NDArray[np.str_]:
    """Outcomes (n_y, n_x) by the closed forms; "no answer" where the linear slip runs away."""
    values = moved_values(site, {x: grid[0], y: grid[1]})
    with np.errstate(all="ignore"):
        q = known_settings(values)
        slip, sliding = slip_margin(q), sliding_margin(q)
    words = np.array(
        [
            [OUTCOMES[bool(a <= 0), bool(b > 0)] for a, b in zip(*rows, strict=True)]
            for rows in zip(slip, sliding, strict=True)
        ]
    )
    return np.where(np.isnan(slip), "no answer", words)


def agreement(name: str, said: NDArray[np.str_], truth: NDArray[np.str_], borders: NDArray[np.bool_]) -> int:
    """Print the table of outcomes said (rows) against simulated (columns); how many differ away from a border."""
    words = list(OUTCOMES.values())
    counts = Counter(zip(said.ravel().tolist(), truth.ravel().tolist(), strict=True))
    others = sorted({str(s) for s in np.unique(said)} - set(words))
    print(f"  {name + ' / simulation':28s}" + "".join(f"{w:>16s}" for w in words))
    for row in [*words, *others]:
        print(f"  {row:28s}" + "".join(f"{counts.get((row, w), 0):16d}" for w in words))
    differ = said != truth
    print(
        f"  right: {int(np.sum(~differ))} of {said.size}; wrong next to a simulated border: "
        f"{int(np.sum(differ & borders))}"
    )
    return int(np.sum(differ & ~borders))


def _borders(truth: NDArray[np.str_]) -> NDArray[np.bool_]:
    """Nodes with a neighbour of another outcome."""
    out = np.zeros(truth.shape, dtype=bool)
    out[:, 1:] |= truth[:, 1:] != truth[:, :-1]
    out[:, :-1] |= truth[:, 1:] != truth[:, :-1]
    out[1:] |= truth[1:] != truth[:-1]
    out[:-1] |= truth[1:] != truth[:-1]
    return out


def plane_study(x: str, y: str, changes: dict[str, float], points: int) -> int:
    """Compare one plane; how many outcomes of the nonlinear map are wrong."""
    values = {**DEMO, **changes}
    site = Site(MODEL, values, 5e-3, 1.0)
    made = chart(site, (x, y), points=(points, points))
    grid = np.meshgrid(made.plane.x_values, made.plane.y_values)
    names = (*MODEL.parameter_names, "normal_force", "drive_speed")
    rows = [
        [
            (brute_force.Pair.of(w, w["normal_force"]), w["drive_speed"])
            for w in (dict(zip(names, node.tolist(), strict=True)) for node in row)
        ]
        for row in made.plane.settings
    ]
    truth = simulated_plane(rows)
    print(f"{x} x {y}, {points} x {points}, demo pair{''.join(f', {k} = {v:g}' for k, v in changes.items())}")
    borders = _borders(truth)
    agreement("nonlinear map", made.outcomes, truth, borders)
    for j, i in np.argwhere(made.outcomes != truth).tolist():
        print(
            f"    {x} {made.plane.x_values[i]:.4g}, {y} {made.plane.y_values[j]:.4g}: {made.outcomes[j, i]}, "
            f"simulation {truth[j, i]}; growth rate {made.growth[j, i]:.3g} 1/s, multiplier {made.multiplier[j, i]:.3g}"
        )
    away = agreement("closed forms", closed_plane(site, x, y, (grid[0], grid[1])), truth, borders)
    print(f"  closed forms wrong away from any border: {away}")
    return int(np.sum(made.outcomes != truth))


def main(fast: bool = False) -> float:
    """Print errors, limits and tables; the share of outcomes that the nonlinear map has wrong is returned."""
    begun = time.perf_counter()
    print(machine.describe())
    count = 4 if fast else 200
    for assumed, title in ((True, "contact worn out at once"), (False, "D and t_cr of the study ranges")):
        found, rejected = scenes(count, assumed, seed=5)
        print(f"\n{count} scenes, {title} ({rejected} draws rejected); median and largest error")
        limit = error_table(found)
        reach = f"up to a V_max = {limit:.2g}" if np.isfinite(limit) else "at no a V_max; what counts is slip over D"
        print(f"95 % of the scenes within {100 * GOOD:g} % in drop, period and amplitude: {reach}")
        if not assumed:
            error_map(found)
        worst = check_truth(found, 1 if fast else 10)
        print(f"orbit against simulation, drop and period of a few of them: within {100 * worst:.2g} %")
    points, wrong, total = (3 if fast else 14), 0, 0
    for x, y, changes in PLANES[:1] if fast else PLANES:
        print()
        wrong += plane_study(x, y, changes, points)
        total += points * points
    print(f"\noutcomes of the nonlinear map that simulation contradicts: {wrong} of {total}")
    print(f"{time.perf_counter() - begun:.0f} s")
    return wrong / total


if __name__ == "__main__":
    main(fast="--fast" in sys.argv)
