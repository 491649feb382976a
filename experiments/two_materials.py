"""Two materials on one rig, fitted together: what is shared, and what each material has for itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from experiments.study_problem import SPEEDS, USUAL, Case, random_case, scene_of, simulated_case
from identify import Scene

SEED = 20261129
OWN = (("mu_s", "mu_k0"), ("D", "t_cr"), ("mu_s", "mu_k0", "D"), ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr"))
APART = 0.35  # standard deviation of the logarithm of what a material has for itself, of coefficients half as much


def two_materials(number: int) -> tuple[Case, Case, tuple[str, ...]]:
    """Two pairs on one rig that share all but the parameters named; drawn anew until both stick and slip."""
    random = np.random.default_rng([SEED, number])
    first, _ = random_case(random, USUAL)
    own = OWN[number % len(OWN)]
    while True:
        factor = {n: float(np.exp(APART * random.standard_normal() * (1 if n in "aDt_cr" else 0.5))) for n in own}
        truth = {n: value * factor.get(n, 1.0) for n, value in first.truth.items()}
        slides = truth["mu_k0"] + truth["delta_mu_k"]
        if not (slides > 0.05 and truth["mu_k0"] + 0.05 < truth["mu_s"] <= 3 * truth["mu_k0"]):
            continue
        second = simulated_case(truth, int(random.integers(2**31)), rig=first.rig)
        if not second.reverses and sum(n >= 3 for n in second.cycles) >= 2:
            return first, second, own


def scene_of_both(first: Case, second: Case, own: tuple[str, ...]) -> Scene:
    """The scene of the logs of both, the parameters named per material (A, B)."""
    plain = scene_of(first, further=[speed for speed, _, _ in SPEEDS])
    logs = tuple(replace(log, labels={"material": "A" if i < len(SPEEDS) else "B"}) for i, log in enumerate(plain.logs))
    specs = {n: replace(plain.parameters[n], per="material") for n in own}
    return replace(plain, logs=logs, parameters={**plain.parameters, **specs})
