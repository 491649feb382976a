"""Periodic orbits and their end against brute-force simulation by an independent integrator.

For the demo pair and random pairs: force drop and period at several drive speeds, and the drive speed above
which stick-slip ends. Brute force: simulate until the cycles repeat; raise the speed, each run starting where
the last one came to rest, until the mass no longer comes to rest; then halve the bracket.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from identify.model.model import assemble
from identify.prediction.cycle import CycleMap, loads
from identify.prediction.orbit import settle
from identify.prediction.solutions import solution_set
from tests.support import oracle

EFFECTS = ("inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening")
RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
DEMO = {"mu_s": 0.62, "mu_k0": 0.43, "delta_mu_k": -0.13, "a": 300.0, "D": 37.4e-6, "t_cr": 0.5, **RIG}
NORMAL_FORCE = 1.0
SPEEDS = (0.1e-3 / 60, 0.1e-3, 1e-3, 5e-3)
AMPLE = 1e-9  # of the brute force: ample for 1 %, and several times faster
WIDTH = 2e-3  # relative width of the final bracket


def random_pairs(count: int, seed: int) -> tuple[list[dict[str, float]], int]:
    """Pairs of the study ranges, and how many draws were rejected (kinetic friction lost, or reverse slip)."""
    rng = np.random.default_rng(seed)
    pairs: list[dict[str, float]] = []
    rejected = 0
    while len(pairs) < count:
        mu_s, step = rng.uniform(0.4, 0.8), rng.uniform(0.1, 0.25)
        pair = {"mu_s": mu_s, "mu_k0": mu_s - step, "delta_mu_k": rng.uniform(-0.15, -0.02)}
        for name, low, high in (("a", 100, 1000), ("D", 15e-6, 60e-6), ("t_cr", 0.1, 2.0)):
            pair[name] = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        if pair["mu_k0"] + pair["delta_mu_k"] > 0.05 and mu_s <= 3 * pair["mu_k0"]:
            pairs.append({**pair, **RIG})
        else:
            rejected += 1
    return pairs, rejected


def simulated(
    pair: Mapping[str, float], speed: float, start: oracle.State, cycles: int
) -> tuple[float, float, oracle.State] | None:
    """(drop [N], period [s], state at the last arrest) of the settled motion; None when the mass slides."""
    k, m = pair["stiffness"], pair["mass"]
    slip = 2 * np.pi * np.sqrt(m / k)
    stick = 2 * pair["mu_s"] * NORMAL_FORCE / (k * speed)
    state, before = start, None
    for _ in range(cycles):
        run = oracle.simulate(pair, speed, NORMAL_FORCE, stick + 8 * slip, state, rtol=AMPLE)
        if run.onsets.size == 0 or run.arrests.size == 0:
            return None
        # Back to the first arrest from which the mass does not bounce off again.
        onset, arrest = run.onsets[0], run.arrests[0]
        fall = k * float(run.onset_states[0][0] - run.arrest_states[0][0])
        x, v, gamma = run.arrest_states[0]
        state = (float(x), float(v), float(gamma))
        now = (fall, float(arrest))
        if before is not None and abs(now[0] / before[0] - 1) < 1e-5 and abs(now[1] / before[1] - 1) < 1e-5:
            return now[0], now[1], state
        before = now
        assert onset <= arrest
    return (*now, state)


def brute_force_end(pair: Mapping[str, float], start: oracle.State, speed: float) -> float:
    """Drive speed above which the mass no longer comes to rest, by raising it and halving the bracket [m/s]."""
    low, high, state = speed, None, start
    while high is None or high / low > 1 + WIDTH:
        trial = 1.5 * low if high is None else float(np.sqrt(low * high))
        outcome = simulated(pair, trial, state, 40)
        if outcome is None:
            high = trial
        else:
            low, state = trial, outcome[2]
    return float(np.sqrt(low * high))


def confirmed_end(pair: Mapping[str, float], start: oracle.State, end: float) -> float:
    """`end` where stick-slip goes on up to just below it and stops just above it [m/s], else NaN; quicker."""
    state = start
    for share in (0.9, 0.98, 1 - WIDTH):
        outcome = simulated(pair, share * end, state, 40)
        if outcome is None:
            return float("nan")
        state = outcome[2]
    return end if simulated(pair, (1 + WIDTH) * end, state, 40) is None else float("nan")


def check(pair: Mapping[str, float], speeds: tuple[float, ...], fast: bool) -> list[tuple[str, float, float]]:
    """Rows (what, answer, brute force) of one pair."""
    model = assemble(EFFECTS)
    p = np.array([pair[name] for name in model.parameter_names])
    map_ = CycleMap(model, NORMAL_FORCE, p)
    rows: list[tuple[str, float, float]] = []
    state: oracle.State = (0.0, 0.0, 1.0)
    fastest = None
    for speed in speeds:
        orbit, brute = settle(map_, speed).orbit, simulated(pair, speed, (0.0, 0.0, 1.0), 40)
        if orbit is None or brute is None:
            rows.append((f"stick-slip at {speed * 1e3:.3g} mm/s", float(orbit is not None), float(brute is not None)))
            continue
        rows.append((f"drop at {speed * 1e3:.3g} mm/s [N]", float(-np.diff(loads(map_, orbit.cycle))[0]), brute[0]))
        rows.append((f"period at {speed * 1e3:.3g} mm/s [s]", orbit.cycle.stick + orbit.cycle.slip, brute[1]))
        fastest, state = speed, brute[2]
    if fastest is not None:
        end = solution_set(map_, fastest).end
        brute_end = confirmed_end(pair, state, end or np.nan) if fast else brute_force_end(pair, state, fastest)
        rows.append(("end of stick-slip [mm/s]", 1e3 * (end or np.nan), 1e3 * brute_end))
    return rows


def main(fast: bool = False) -> float:
    """Print the comparison; the largest relative difference is returned."""
    pairs, rejected = random_pairs(0 if fast else 20, seed=20)
    print(f"demo pair and {len(pairs)} random pairs ({rejected} draws rejected), F_n = {NORMAL_FORCE} N")
    worst = 0.0
    for i, pair in enumerate([DEMO, *pairs]):
        begun = time.perf_counter()
        for what, answer, brute in check(pair, SPEEDS[2:3] if fast else SPEEDS, fast):
            error = abs(answer / brute - 1) if brute else abs(answer - brute)
            worst = max(worst, error if np.isfinite(error) else np.inf)
            print(f"  pair {i:2d}  {what:28s} {answer:12.6g}  brute force {brute:12.6g}  {100 * error:8.4f} %")
        print(f"  pair {i:2d}  {time.perf_counter() - begun:.1f} s")
    print(f"largest difference {100 * worst:.4f} %")
    return worst


if __name__ == "__main__":
    main(fast="--fast" in sys.argv)
