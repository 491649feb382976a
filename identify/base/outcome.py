"""How a fit ended, and the curves behind its report."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CYCLE_COLUMNS = ("onset_s", "arrest_s", "onset_force_N", "arrest_force_N", "misfit_z")


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
class LogCurves:
    """What the report draws of one log. Arrays of shape (n,), SI, at the samples of the record.

    `friction_force` is the measured one with the fit's sign applied; `fitted_force` is NaN where
    nothing was fitted (outside the fitted window, masked samples, or no fit at all); `used` marks
    the samples that count; `cycles` has one row of CYCLE_COLUMNS per fitted or detected cycle (misfit: z-score of
    chi^2, NaN if not fitted).
    `raw_force`: the friction force as it was read, with the fit's sign, None where nothing was corrected.
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
    raw_force: Array | None = None
