"""Whether a fit leaves nothing to complain of: every cycle is described, and no log contradicts the others."""

from __future__ import annotations

import numpy as np

from identify.base.outcome import Status
from identify.diagnosis.fitted import Fitted
from identify.estimation.agreement import contradiction, pulls_of_logs
from identify.estimation.allowed import influence_at
from identify.estimation.attempt import judged
from identify.logs.unknowns import stated_rig
from identify.scene import Scene


def nothing_amiss(fitted: Fitted, scene: Scene, memory: float) -> bool:
    """Whether a fit passes the gate by itself, and its logs agree.

    Args:
        scene: whose rig the values are given for; memory: by how much that of the noise widens a variance.
    """
    if fitted.attempt is None or judged(fitted.attempt).gate.status is not Status.CONVERGED:
        return False
    solved, names = fitted.attempt.solved, [log.name for log in fitted.attempt.prepared]
    try:
        found = pulls_of_logs(solved.problem, solved.solution.z, influence_at(solved), memory)
    except np.linalg.LinAlgError:  # directions that no log tells
        return False
    return not contradiction(found, fitted.unknowns, solved.theta, fitted.unknowns.base(stated_rig(scene)), names)
