"""How a fit ended, and the curves behind its report."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Status(Enum):
    """How a fit ended; the value is the word in result.json."""

    CONVERGED = "converged"
    SOLVER_FAILED = "solver_failed"
    WRONG_EVENT_COUNT = "wrong_event_count"
    MODEL_MISFIT = "model_misfit"
    BETTER_START_FOUND = "better_start_found"
    NO_CYCLES = "no_cycles"
    AT_BOUND = "at_bound"


@dataclass(frozen=True)
class SlipDetail:
    """One typical slip on a fine grid, as the fitted model reconstructs it (fig. 3 of the paper).

    All shape (m,), SI: time from the start of the record, force the load cell sees, elongation of
    the spring, sliding speed, gamma (NaN where the model has none), friction coefficient.
    `samples` are the indices of the log's samples in this window.
    """

    cycle: int
    time: Array
    force: Array
    elongation: Array
    sliding_speed: Array
    gamma: Array
    coefficient: Array
    samples: NDArray[np.int64]


@dataclass(frozen=True)
class LogCurves:
    """What the report draws of one log. Arrays of shape (n,), SI, at the samples of the record.

    `friction_force` is the measured one with the fit's sign applied; `fitted_force` is NaN where
    nothing was fitted (outside the fitted window, masked samples, or no fit at all); `used` marks
    the samples that count; `cycles` has one row per fitted or detected cycle:
    onset time [s], arrest time [s], onset force [N], arrest force [N], chi^2 z-score (NaN if not fitted).
    `measured`: the cycles as they were detected (k, 4), the same without the score, whatever a fit makes of them.
    `raw_force`: the friction force as it was read, with the fit's sign, None where nothing was corrected;
    `cuts`: (kind, start [s], stop [s]) of what the scene leaves out, and of the interval of a tare.
    """

    name: str
    time: Array
    normal_force: Array
    friction_force: Array
    fitted_force: Array
    used: NDArray[np.bool_]
    noise: float
    drive_speed: float
    cycles: Array
    measured: Array
    slip: SlipDetail | None
    raw_force: Array | None = None
    cuts: tuple[tuple[str, float, float], ...] = ()
