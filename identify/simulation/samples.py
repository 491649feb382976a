"""The motion at any times: rests in closed form, slips inside the steps they were taken by, many in one call."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import compiled
from identify.model.model import SPEED, Model
from identify.model.modes import ModeName
from identify.simulation.interface import Expression
from identify.simulation.methods import Method
from identify.simulation.phases import Phase, Slide
from identify.simulation.stepping import within

Array = NDArray[np.float64]

LANES = 64  # times of one call
FEW = 8  # the same, for the last ones
SHOWN = 2  # what follows the states in a row: force of the load cell [N], friction over normal force


def moments(model: Model, phases: Sequence[Phase], t: Array) -> dict[str, Array]:
    """Samples (n,) at rising times t (n,) [s]: states by name, "force", "coefficient", "normal_force", "sliding"."""
    starts = np.array([phase.start for phase in phases])
    which = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, None)
    return inside(model, phases, which, t - starts[which])


def inside(model: Model, phases: Sequence[Phase], which: NDArray[np.intp], local: Array) -> dict[str, Array]:
    """The same in phases `which` (n,), rising, at times from the start of each (n,) [s]: late phases lose no digits."""
    local = np.clip(local, 0.0, np.array([phase.duration for phase in phases])[which])
    numbers = np.array([phase.situated.numbers for phase in phases])[which]
    n = len(model.states)
    xth = np.zeros((local.size, 2 * n + 3))
    kinds: dict[tuple[Method | None, ModeName], list[Array]] = {}
    edges = np.searchsorted(which, np.arange(len(phases) + 1))
    for i in np.unique(which).tolist():
        phase, rows = phases[i], np.arange(edges[i], edges[i + 1])
        at = local[rows]
        method = phase.method if isinstance(phase, Slide) else None
        kinds.setdefault((method, phase.mode), []).append(rows)
        if method is None:
            xth[rows, :n], xth[rows, n + 2] = phase.x[0], at
            continue
        node = np.clip(np.searchsorted(phase.t, at, side="right") - 1, 0, max(phase.t.size - 2, 0))
        beyond = np.minimum(node + 1, phase.t.size - 1)
        xth[rows, :n], xth[rows, n] = phase.x[node], phase.t[node]
        xth[rows, n + 1], xth[rows, n + 2] = phase.t[beyond] - phase.t[node], at - phase.t[node]
        xth[rows, n + 3 :] = phase.x[beyond]
    shown = np.empty((local.size, n + SHOWN))
    p = phases[0].situated.p
    tolerances = next((phase.tolerances for phase in phases if isinstance(phase, Slide)), np.ones(n + 1))
    for (method, mode), parts in kinds.items():
        rows = np.concatenate(parts)
        shown[rows] = _evaluated(model, method, mode, xth[rows], numbers[rows], p, tolerances)
    out = {state.name: shown[:, i].copy() for i, state in enumerate(model.states)}
    out["force"], out["coefficient"] = shown[:, n].copy(), shown[:, n + 1].copy()
    out["normal_force"] = numbers[:, 2] + numbers[:, 3] * local
    out["sliding"] = np.array([float(phase.mode != "stick") for phase in phases])[which]
    return out


def _evaluated(
    model: Model, method: Method | None, mode: ModeName, xth: Array, numbers: Array, p: Array, tolerances: Array
) -> Array:
    """Rows (m, n_x + SHOWN) of m times: xth (m, 2 n_x + 3) as in `within`, numbers (m, 5)."""
    out = np.empty((xth.shape[0], len(model.states) + SHOWN))
    first = 0
    for lanes in (LANES, FEW):
        call = compiled(_row(model, method, mode, lanes))
        x, inputs = np.zeros((lanes, xth.shape[1])), np.zeros((lanes, numbers.shape[1]))
        call.bind([x.reshape(-1), inputs.reshape(-1), p, tolerances])
        while xth.shape[0] - first >= (lanes if lanes > FEW else 1):
            part = slice(first, min(first + lanes, xth.shape[0]))
            size = part.stop - part.start
            x[:size], inputs[:size] = xth[part], numbers[part]
            out[part] = call().reshape(lanes, -1)[:size]
            first += size
    return out


@lru_cache(maxsize=64)
def _row(model: Model, method: Method | None, mode: ModeName, lanes: int) -> ca.Function:
    """(as in `within`, inputs (5,), p, tolerances) -> state, force, coefficient; of so many lanes."""
    kind, n = ca.SX if method is None else method.kind, len(model.states)
    xth, drive = kind.sym("xth", 2 * n + 3), kind.sym("drive", 5)
    p, tolerances = kind.sym("p", len(model.parameters)), kind.sym("tolerances", n + 1)
    t = xth[n] + xth[n + 2]
    force = drive[2] + drive[3] * t
    u = ca.vertcat(drive[0], force, drive[1], drive[4] + t)
    if method is None:
        x = model.rest(xth[:n], p, u, t)
        friction = model.driving_force(x, p, u)
    else:
        x = within(model, method, mode)(xth, ca.vertcat(p, drive), tolerances)
        friction = _friction(model, mode, x, p, u)
    row = ca.densify(ca.vertcat(x, model.load_cell(x, p, u), friction / force))
    one = ca.Function("row", [xth, drive, p, tolerances], [row])
    return one.map(lanes, [False, False, True, True], [False])


def _friction(model: Model, mode: ModeName, x: Expression, p: Expression, u: Expression) -> Expression:
    """Friction force while sliding [N]: what the load leaves of the inertia."""
    field = model.saturated if mode == "saturated" else model.slip
    return model.load(x, p, u) - p[model.parameter_names.index("mass")] * field(x, p, u)[SPEED]
