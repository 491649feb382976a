"""What the search and the uncertainty found: the stuff the result document is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.diagnosis.held import Held
from identify.estimation.attempt import Attempt
from identify.estimation.certainty import Certainty
from identify.estimation.estimator import Estimated
from identify.estimation.strategies import Trace
from identify.estimation.uncertainty import Estimate, Information
from identify.logs.unknowns import Unknowns

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Findings:
    """What the search and the uncertainty found: status and sentence, the attempt that was accepted or came
    closest (None without one), information and covariance of theta, estimates, why logs took no part, profile intervals
    of theta where the covariance alone could not be trusted, discretisation error by name in standard errors;
    held: the rig as it was stated, against the data; trace: what was tried; estimator: its name; estimated:
    what an estimator found that is not the plain one."""

    status: Status
    message: str
    unknowns: Unknowns
    attempt: Attempt | None
    information: Information | None
    covariance: Array | None
    estimates: list[Estimate]
    left_out: Mapping[int, str]
    profiles: Mapping[str, object]
    discretisation: Mapping[str, float] = field(default_factory=dict)
    sure: Certainty | None = None
    held: list[Held] = field(default_factory=list)
    trace: Trace = field(default_factory=Trace)
    estimator: str = "plain"
    estimated: Estimated | None = None
