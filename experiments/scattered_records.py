"""Stick-slip whose strength differs from stick to stick, by the integrator of the tests: nothing of the package.

Every stick, and the slip after it, has its own mu_s' = mu_k0 + e^s (mu_s - mu_k0), s normal with standard deviation
`scatter`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import repeat

import numpy as np

from data_io import Record
from experiments.study_problem import Case
from tests.support import oracle

NOISE = 5e-3  # [N], of a load of 1 N


def with_scatter(case: Case, speeds: Sequence[tuple[float, float, float]], scatter: float, seed: int) -> list[Record]:
    """The logs of a case, each of speed [m/s], duration [s] and sampling rate [Hz], with strength that scatters."""
    random, records = np.random.default_rng(seed), []
    for speed, duration, rate in speeds:
        times = np.arange(round(duration * rate) + 1) / rate
        strengths = (float(np.exp(scatter * random.standard_normal())) for _ in repeat(None))
        motion = oracle.simulate(case.truth | case.rig, speed, 1.0, times[-1], rtol=1e-9, strengths=strengths)
        force = motion.force(times) + NOISE * random.standard_normal(times.size)
        records.append(Record(times, np.ones(times.size), force))
    return records
