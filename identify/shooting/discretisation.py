"""What the integration steps of a fit cost in accuracy: how far the answer would move with half the step.

One Newton step on the same problem with twice as many steps, from the solution: the numerical error of the
discretisation, which is worth showing as a share of each standard error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identify.base.equilibrated import optimality_matrix, solve_equilibrated
from identify.shooting.passes import Solved

Array = NDArray[np.float64]

ORDER = 4  # of the step formula of the shooting


def discretisation_error(solved: Solved) -> Array:
    """Error of theta (f,) of the free parameters that the integration steps leave, signed, in search units."""
    problem, z = solved.problem.with_finer_steps(), solved.solution.z
    point = problem.evaluate(z, derivatives=True)
    assert point.hessian is not None and point.jacobian is not None and point.gradient is not None
    kkt = optimality_matrix(point.hessian, point.jacobian)
    # What the solver left of its own conditions is not the steps' doing: it is taken out.
    own = solved.problem.evaluate(solved.solution.z, derivatives=True)
    assert own.jacobian is not None and own.gradient is not None
    change = point.gradient - own.gradient + (point.jacobian - own.jacobian).T @ solved.solution.multipliers
    left = np.concatenate([change, point.rows - own.rows])
    step = solve_equilibrated(kkt, -left[:, None])[:, 0] * 2**ORDER / (2**ORDER - 1)
    count = problem.layout.free.size
    return np.asarray(-step[:count] * problem.layout.scale[:count])
