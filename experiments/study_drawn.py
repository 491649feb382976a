"""The worked study, drawn: three materials, volunteers, two sites, three speeds; every log simulated with noise.

Truths are those of an average person; people, a person on a material, sites and runs scatter about them as friction
of skin does. One log is spoilt on purpose and one run is an outlier, so that the page has both to show.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_io.atomic import atomic_write
from identify.base.errors import IdentifyError
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run

Array = NDArray[np.float64]

NAMES = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
MATERIALS = {  # means of an average person at the forearm
    "UHMWPE": (0.55, 0.42, -0.10, 320.0, 34e-6, 0.45),
    "cotton": (0.68, 0.47, -0.12, 280.0, 44e-6, 0.60),
    "silicone": (0.82, 0.55, -0.15, 240.0, 52e-6, 0.90),
}
SITES = {"forearm": 1.0, "palm": 1.12}  # factors on all coefficients
# Standard deviations of logarithms: between people, of a person on a material, between runs.
PEOPLE = (0.08, 0.08, 0.12, 0.20, 0.15, 0.15)
CROSSED = (0.03, 0.03, 0.05, 0.08, 0.06, 0.06)
RUNS = (0.015, 0.015, 0.04, 0.06, 0.05, 0.05)
HYDRATION = 0.004  # of the logarithm of all coefficients, per unit of hydration
DRYING = -0.01  # the same, per trial
RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
LOAD, NOISE = 1.0, 5e-3
# Drive speed [m/s], duration [s], sampling rate [Hz].
SPEEDS = ((1e-4, 16.0, 500.0), (1e-3, 3.0, 1000.0), (5e-3, 1.2, 2000.0))
OUTLIER, SPOILT = ("V03", "cotton", "palm"), ("V05", "silicone", "forearm")


@dataclass(frozen=True)
class Visit:
    """One group of logs: whose, on what, where, in which order, how moist, and its true parameters."""

    volunteer: str
    material: str
    site: str
    order: int
    hydration: float
    truth: dict[str, float]

    @property
    def name(self) -> str:
        """Name of the group."""
        return f"{self.volunteer}_{self.material}_{self.site}"


def visits(volunteers: int, seed: int = 7) -> list[Visit]:
    """All visits of so many volunteers, each with every material at every site, in random order."""
    random = np.random.default_rng(seed)
    found = []
    for v in range(volunteers):
        person, moist = random.standard_normal(6) * PEOPLE, random.normal(40.0, 6.0)
        order = random.permutation(len(MATERIALS) * len(SITES)) + 1
        crossed = {material: random.standard_normal(6) * CROSSED for material in MATERIALS}
        for k, (material, site) in enumerate((m, s) for m in MATERIALS for s in SITES):
            hydration = float(np.round(moist + random.normal(0.0, 2.0), 1))
            shift = person + crossed[material] + random.standard_normal(6) * RUNS
            common = np.log(SITES[site]) + HYDRATION * (hydration - 40.0) + DRYING * (order[k] - 3.5)
            shift[:3] += common
            who = f"V{v + 1:02d}"
            if (who, material, site) == OUTLIER:
                shift[:3] += 0.35
            values = _bounded(np.array(MATERIALS[material]) * np.exp(shift))
            truth = dict(zip(NAMES, values.tolist(), strict=True))
            found.append(Visit(who, material, site, int(order[k]), hydration, truth))
    return found


def _bounded(values: Array) -> Array:
    """Kinetic friction stays below static friction and above zero, as a pair that sticks and slips has it."""
    out = values.copy()
    out[1] = min(out[1], 0.9 * out[0])
    out[2] = max(out[2], -0.6 * out[1])
    return out


def write_logs(folder: Path, drawn: list[Visit], seed: int = 11) -> Path:
    """Every log as CSV and the manifest of the batch; returns the manifest."""
    model = assemble(MAIN)
    rows = []
    for number, visit in enumerate(drawn):
        random = np.random.default_rng([seed, number])
        for k, (speed, duration, hertz) in enumerate(SPEEDS):
            path = folder / f"{visit.name}_{k + 1}.csv"
            times = np.arange(round(duration * hertz) + 1) / hertz
            try:
                force = run(model, visit.truth | RIG, speed, LOAD, duration).sample(times)["force"]
            except IdentifyError as error:
                raise SystemExit(f"{visit.name}: {error}") from None
            force = force + NOISE * random.standard_normal(times.size)
            if (visit.volunteer, visit.material, visit.site) == SPOILT:
                force = LOAD * 0.5 + 0.02 * random.standard_normal(times.size)  # the sensor came loose
            with atomic_write(path) as handle:
                handle.write("time [s],normal force [N],friction force [N]\n")
                for t, f in zip(times, force, strict=True):
                    handle.write(f"{t:.6f},{LOAD:.4f},{f:.6f}\n")
            labels = (visit.material, visit.volunteer, visit.site, visit.order, visit.hydration)
            rows.append([path.name, visit.name, f"{1000 * speed:g} mm/s", *labels])
    manifest = folder / "manifest.csv"
    with manifest.open("w", newline="", encoding="utf-8") as handle:
        writer = csv.writer(handle)
        writer.writerow(["path", "group", "drive_speed", "material", "volunteer", "site", "order", "hydration"])
        writer.writerows(rows)
    return manifest
