"""What an error of the drive speed does to the answer: the fit answers to first order, nothing is solved again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from identify.guess import LogData
from identify.passes import Solved
from identify.shooting import transcribe
from identify.uncertainty import solve_equilibrated
from identify.unknowns import Unknowns

Array = NDArray[np.float64]

STEP = 1e-5  # relative, of the drive speed


def drive_speed_shift(logs: list[LogData], solved: Solved, unknowns: Unknowns) -> Array:
    """How far the free theta (f,) move per relative error of all drive speeds together.

    The optimality conditions are linearised at the answer: KKT matrix times the move equals minus the change of
    gradient and rows that the error makes.
    """
    at_answer = replace(unknowns, start=solved.theta)
    wrong = [replace(log, drive_speed=log.drive_speed * (1 + STEP)) for log in logs]
    here, there = (transcribe(given, solved.guesses, at_answer, solved.grid) for given in (logs, wrong))
    p, q = (problem.evaluate(problem.start, derivatives=True) for problem in (here, there))
    assert p.hessian is not None and p.jacobian is not None and p.gradient is not None and q.gradient is not None
    hessian = p.hessian + sp.triu(p.hessian, 1).T
    kkt = sp.bmat([[hessian, p.jacobian.T], [p.jacobian, None]], format="csc")
    change = np.concatenate([q.gradient - p.gradient, q.rows - p.rows]) / STEP
    move = -solve_equilibrated(kkt, change[:, None])[:, 0]
    count = here.layout.free.size
    return np.asarray(move[:count] * here.layout.scale[:count])
