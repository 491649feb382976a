"""Intervals of drop, period and critical speed against an independent Monte Carlo, in scenes of which many are skew.

Pairs, rigs and loads as in the study of windows; what is known of each is drawn too (half a percent to twelve percent,
some of it correlated), and the drive speed from deep in the stick-slip to just below its end. The Monte Carlo draws
the parameters on its own (normal, by the logarithm where they are positive and searched so) and simulates every draw
with `brute_force`, no line of the package in it. Coverage: the share of its values inside the interval, among
the draws that stick and slip; it is to be 93 to 97 %.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]

import machine  # noqa: E402
from brute_force import Lanes, begun, simulate  # noqa: E402
from run_window_study import EFFECTS, random_pairs  # noqa: E402

from identify.base.document import to_dict  # noqa: E402
from identify.model.model import assemble  # noqa: E402
from identify.prediction.axes import Site  # noqa: E402
from identify.prediction.predict import predict  # noqa: E402

Array = NDArray[np.float64]
NAMES = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr", "mass", "damping")
LINEAR = ("mu_s", "mu_k0", "delta_mu_k")  # not searched by their logarithm
KNOWN = (0.005, 0.12)  # relative standard deviations; of friction coefficients a fifth
STARTS = (0.5, 0.7, 0.85, 0.95)  # of the limit, at which stick-slip is looked for
RISE, HALVINGS, CYCLES = 1.06, 7, 30


@dataclass(frozen=True)
class Case:
    """A scene: pair, drive speed [m/s], covariance of NAMES [SI], and the answer."""

    pair: Mapping[str, float]
    speed: float
    covariance: Array
    document: Mapping[str, Any]

    def interval(self, name: str) -> tuple[Mapping[str, Any], Any]:
        """The entry of a quantity and its interval."""
        stability, amplitude = self.document["stability"], self.document["amplitude"]
        entry = stability["critical_speed"] if name == "critical speed" else amplitude[name]
        return entry, entry["interval"]


def cases(count: int, seed: int) -> list[Case]:
    """Scenes with periodic stick-slip and an end of it."""
    rng, model = np.random.default_rng(seed), assemble(EFFECTS)
    out: list[Case] = []
    for pair in random_pairs(10 * count, seed):
        if len(out) == count:
            break
        first = to_dict(predict(Site(model, pair, 1e-3, pair["normal_force"])))["stability"]
        if first["critical_speed"]["value"] is None or len(first["stick_slip_between"]) != 1:
            continue
        end, low = first["critical_speed"]["value"], first["stick_slip_between"][0]["from"]
        speed = float(end * np.exp(-rng.exponential(1.0)) * 0.97)
        if low is not None and speed < 1.05 * low["value"]:
            continue
        level = float(np.exp(rng.uniform(*np.log(KNOWN))))
        sizes = np.array([abs(pair[name]) * (0.2 if name in LINEAR else 1.0) for name in NAMES])
        mixing = np.eye(len(NAMES)) + 0.4 * rng.standard_normal((len(NAMES),) * 2)
        correlation = mixing @ mixing.T
        sd = level * sizes / np.sqrt(np.diag(correlation))
        covariance = correlation * np.outer(sd, sd)
        site = Site(model, pair, speed, pair["normal_force"], covariance=covariance, names=NAMES)
        document = to_dict(predict(site))
        if document["amplitude"]["drop"]["value"] is not None:
            out.append(Case(pair, speed, covariance, document))
    return out


def drawn(case: Case, count: int, rng: np.random.Generator) -> list[dict[str, float]]:
    """Pairs as what is known of one has them."""
    centre = np.array([case.pair[name] for name in NAMES])
    logs = np.array([name not in LINEAR for name in NAMES])
    scale = np.where(logs, centre, 1.0)
    steps = rng.multivariate_normal(np.zeros(len(NAMES)), case.covariance / np.outer(scale, scale), count)
    moved = np.where(logs, centre * np.exp(np.where(logs, steps, 0.0)), centre + steps)
    rows = [{**case.pair, **dict(zip(NAMES, row.tolist(), strict=True))} for row in moved]
    return [p for p in rows if p["mu_s"] > p["mu_k0"] > 0 and p["mu_k0"] + min(p["delta_mu_k"], 0.0) > 0]


def ends(lanes: Lanes, expected: Array) -> Array:
    """Drive speeds (n,) [m/s] above which stick-slip that has begun does not go on; NaN where none was found."""
    n = expected.size
    low, rest = np.full(n, np.nan), np.zeros((2, n))
    for share in STARTS:
        sticks, course = begun(lanes.at(share * expected), CYCLES)
        low[sticks], rest[:, sticks] = share * expected[sticks], course.rest[:, sticks]
    high, rising = np.full(n, np.nan), np.flatnonzero(np.isfinite(low))
    while rising.size:
        course = simulate(lanes.at(RISE * low).take(rising), rest[:, rising], CYCLES)
        gone, on = rising[course.slides], rising[~course.slides]
        high[gone] = RISE * low[gone]
        low[on], rest[:, on] = RISE * low[on], course.rest[:, ~course.slides]
        rising = on[low[on] < 100.0 * expected[on]]
    closed = np.flatnonzero(np.isfinite(high))
    for _ in range(HALVINGS):
        middle = np.sqrt(low[closed] * high[closed])
        trial = low.copy()
        trial[closed] = middle
        course = simulate(lanes.at(trial).take(closed), rest[:, closed], CYCLES)
        low[closed] = np.where(course.slides, low[closed], middle)
        high[closed] = np.where(course.slides, middle, high[closed])
        rest[:, closed] = np.where(course.slides, rest[:, closed], course.rest)
    return np.asarray(np.sqrt(low * high))


def main(fast: bool = False, count: int = 30, draws: int = 150, seed: int = 70) -> dict[str, float]:
    """Print and return the pooled coverage by quantity."""
    count, draws = (2, 12) if fast else (count, draws)
    print(machine.describe())
    began = time.process_time()
    scenes = cases(count, seed)
    print(f"{len(scenes)} scenes answered in {time.process_time() - began:.0f} s of CPU", flush=True)
    rng, began = np.random.default_rng(seed + 1), time.process_time()
    pairs = [drawn(case, draws, rng) for case in scenes]
    place = np.repeat(np.arange(len(scenes)), [len(p) for p in pairs])
    flat = [p for each in pairs for p in each]
    lanes = Lanes.of(flat, np.array([scenes[i].speed for i in place]))
    sticks, course = begun(lanes, 10 if fast else 60)
    values = {"drop": np.where(sticks, course.drop, np.nan), "period": np.where(sticks, course.period, np.nan)}
    if not fast:
        expected = np.array([scenes[i].interval("critical speed")[0]["value"] for i in place])
        values["critical speed"] = ends(lanes, expected)
    print(f"{lanes.drive.size} draws simulated in {time.process_time() - began:.0f} s of CPU")
    hits: dict[str, list[bool]] = {}
    for i, case in enumerate(scenes):
        for name, column in values.items():
            (_, interval), found = case.interval(name), column[(place == i) & np.isfinite(column)]
            if interval is not None and interval[0] is not None and found.size >= 0.3 * draws:  # neither open nor rare
                hits.setdefault(name, []).extend(((found >= interval[0]) & (found <= interval[1])).tolist())
    for name, row in sorted(hits.items()):
        print(f"{name:24s} {100 * np.mean(row):5.1f} % of {len(row)}")
    return {name: float(np.mean(hits[name])) for name in values if name in hits}


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    main("--fast" in sys.argv, *numbers)
