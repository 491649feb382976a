"""Solve a transcribed problem with IPOPT; the only file that spells its options."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.budget import seconds_left
from identify.shooting.shooting import Point, Problem

Array = NDArray[np.float64]
Ports = Sequence[tuple[str, ca.Sparsity]]  # of a function: names and shapes

OUT_OF_ORDER = "Events_Out_Of_Order"
ALWAYS = {  # options of every solve
    "print_time": False,
    "show_eval_warnings": False,  # IPOPT steps back from where a function is not defined
    "no_nlp_grad": True,
    "calc_lam_p": False,
    "calc_lam_x": False,
    "calc_f": False,
    "calc_g": False,
    "ipopt.sb": "yes",
    "ipopt.print_level": 0,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.dual_inf_tol": 1e-2,
    # On a ridge that the data hardly bend, Gauss-Newton creeps: stop where creeping gains nothing.
    "ipopt.acceptable_iter": 4,
    "ipopt.acceptable_tol": 1e10,
    "ipopt.acceptable_dual_inf_tol": 1e10,
    "ipopt.acceptable_constr_viol_tol": 1e-8,
    "ipopt.acceptable_compl_inf_tol": 1e-2,
    "ipopt.nlp_scaling_method": "none",
    # Rows and columns of the parameters meet all others: an ordering that sets them apart, and no permutation.
    "ipopt.mumps_pivot_order": 6,  # MUMPS: approximate minimum degree that looks for rows which are all but dense
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.bound_push": 1e-8,
    "ipopt.bound_frac": 1e-8,
}


@dataclass(frozen=True)
class Solution:
    """What the solver gave back: z (n,) scaled unknowns, x (n,) physical ones, its return_status, whether that means
    success, iterations, cost, largest row, multipliers (m,) of the rows: gradient + J^T multipliers = 0."""

    z: Array
    x: Array
    return_status: str
    success: bool
    iterations: int
    cost: float
    constraint_violation: float
    multipliers: Array


class _NlpCallback(ca.Callback):
    """One function of the problem as CasADi sees it: of arrays, to arrays, with the names and shapes of both."""

    def __init__(self, name: str, inputs: Ports, outputs: Ports, function: Callable[..., Sequence[ArrayLike]]) -> None:
        ca.Callback.__init__(self)
        self._in, self._out, self._function = inputs, outputs, function
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._in)

    def get_n_out(self) -> int:
        return len(self._out)

    def get_name_in(self, i: int) -> str:
        return self._in[i][0]

    def get_name_out(self, i: int) -> str:
        return self._out[i][0]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self._in[i][1]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._out[i][1]

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, given: Sequence[memoryview], wanted: Sequence[memoryview | None]) -> int:
        # CasADi's own memory: its matrix objects would cost more than the functions of a long log.
        arrays = [np.frombuffer(buffer) if buffer is not None else np.zeros(0) for buffer in given]
        for buffer, value in zip(wanted, self._function(*arrays), strict=True):
            if buffer is not None:
                np.frombuffer(buffer)[:] = value
        return 0


def _callbacks(problem: Problem, exact: bool) -> dict[str, _NlpCallback]:
    """The four functions IPOPT takes; the problem remembers the last point."""
    n, m, pattern = problem.layout.size, problem.layout.rows, problem.pattern
    rows, one = ca.Sparsity.dense(m), ca.Sparsity.dense(1)
    xp: Ports = [("x", ca.Sparsity.dense(n)), ("p", ca.Sparsity.dense(0, 1))]

    def values(z: Array, _p: Array) -> Sequence[ArrayLike]:
        point = problem.evaluate(z, derivatives=False)
        return point.cost, point.rows

    def at(z: Array) -> Point:
        return problem.evaluate(z, derivatives=True)

    def hessian(z: Array, _p: Array, on_cost: Array, on_rows: Array) -> Sequence[ArrayLike]:
        if exact:
            return (problem.exact_hessian(z, float(on_cost[0]), on_rows).data,)
        return (at(z).hessian.data * on_cost[0],)

    xpl: Ports = [*xp, ("lam_f", one), ("lam_g", rows)]
    functions: dict[str, tuple[Ports, Ports, Callable[..., Sequence[ArrayLike]]]] = {
        "nlp": (xp, [("f", one), ("g", rows)], values),
        "grad_f": (xp, [("f", one), ("grad_f_x", xp[0][1])], lambda z, _: (at(z).cost, at(z).gradient)),
        "jac_g": (
            xp,
            [("g", rows), ("jac_g_x", pattern.jacobian.sparsity)],
            lambda z, _: (at(z).rows, at(z).jacobian.data),
        ),
        "hess_lag": (xpl, [("triu_hess_gamma_x_x", pattern.hessian.sparsity)], hessian),
    }
    return {name: _NlpCallback(name, *given) for name, given in functions.items()}


def solve(
    problem: Problem,
    *,
    tolerance: float = 1e-8,
    mu_init: float = 1e-4,
    iterations: int = 60,
    exact: bool = False,
    start: Array | None = None,
) -> Solution:
    """Solve the problem from its starting point, or from `start` (n,) scaled.

    Args:
        tolerance: on the scaled optimality conditions.
        mu_init: IPOPT's first barrier parameter: small from a good start.
        iterations: give up after this many.
        exact: with the exact Hessian instead of Gauss-Newton: dearer per iteration, but it does not creep along
            ridges; only near a solution.

    Returns:
        what the solver gave back; a failure with infinite cost where the events of the trajectory do not follow each
        other.
    """
    layout = problem.layout
    first = problem.start if start is None else start
    if np.any(layout.lower > layout.upper) or not np.isfinite(problem.evaluate(first, derivatives=False).cost):
        z, rows = problem.start, np.zeros(layout.rows)
        return Solution(z, layout.start, OUT_OF_ORDER, False, 0, np.inf, np.inf, rows)
    callbacks = _callbacks(problem, exact)
    options = ALWAYS | {name: callbacks[name] for name in ("grad_f", "jac_g", "hess_lag")}
    options |= {
        "ipopt.tol": tolerance,
        "ipopt.acceptable_obj_change_tol": 1e-3 / max(1.0, problem.samples / 2),  # of half chi^2 per iteration
        "ipopt.mu_init": mu_init,
        "ipopt.max_iter": iterations,
    }
    if math.isfinite(left := seconds_left()):
        options["ipopt.max_wall_time"] = max(left, 0.05)  # [s] also at the last moment
    solver = ca.nlpsol("identify", "ipopt", callbacks["nlp"], options)
    lower, upper = layout.lower / layout.scale, layout.upper / layout.scale
    result = solver(x0=first, lbx=lower, ubx=upper, lbg=0.0, ubg=0.0)
    stats, z = solver.stats(), np.array(result["x"]).ravel()
    point = problem.evaluate(z, derivatives=False)
    return Solution(
        z=z,
        x=z * layout.scale,
        return_status=str(stats["return_status"]),
        success=bool(stats["success"]),
        iterations=int(stats["iter_count"]),
        cost=point.cost,
        constraint_violation=float(np.max(np.abs(point.rows), initial=0.0)),
        multipliers=np.array(result["lam_g"]).ravel(),
    )
