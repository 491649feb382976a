"""The shooting blocks as functions of numbers: `block_equations` of one kind, mapped over many instances at once.

A block takes its slots (local unknowns) and constants; what it returns is said there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.mapped import Mapped
from identify.model.model import Model
from identify.shooting.block_equations import REST_CELLS, SLIDES, BlockKind, equations

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Block:
    """One kind of block, mapped over many instances.

    Slots, in order: state at the start (n_x,), state at the end (n_x,; absent in a rest), offset of the
    start time [s], offset of the end time [s], deviation of the normal force in this cycle from its measured
    course [N] (of a trembling slip two: at its onset, in its end), then the search variables (n_p,). Constants, in
    order: base values of the parameters (n_p,), row scales (n_x,), drive speed, normal force at the start and at the
    end of the phase and its slope, time of its start, reference duration of it, first and last fraction of it.
    """

    kind: BlockKind
    n_slots: int
    n_rows: int
    n_cells: int
    order: int  # coefficients per cell: 2 linear, 4 cubic
    values: Mapped
    derivatives: Mapped
    expressions: tuple[ca.SX, ca.SX, ca.SX, ca.SX]  # slots, constants, rows, curve
    drive_speed: int  # its place among the constants

    def evaluate(self, slots: Array, constants: Array, *, derivatives: bool) -> tuple[Array, ...]:
        """Rows (B, n_rows) and curves (B, n_cells, order); with derivatives also their Jacobians
        (B, n_rows, n_slots) and (B, n_cells, order, n_slots). slots (B, n_slots), constants (B, n_constants)."""
        count = slots.shape[0]
        out = (self.derivatives if derivatives else self.values)([slots, constants])
        rows, curve = out[0], out[1].reshape(count, self.n_cells, self.order)
        if not derivatives:
            return rows, curve
        by_slot = out[2].reshape(count, self.n_slots, -1)  # CasADi stores matrices by columns
        d_rows = by_slot[:, :, : self.n_rows].transpose(0, 2, 1)
        d_curve = by_slot[:, :, self.n_rows :].reshape(count, self.n_slots, self.n_cells, self.order)
        return rows, curve, d_rows, d_curve.transpose(0, 2, 3, 1)

    def bend(self, slots: Array, constants: Array, on_rows: Array, on_curve: Array, used: tuple[int, ...]) -> Array:
        """Second derivatives (B, n_slots, n_slots) of on_rows . rows + on_curve . curve; weights (B, n_rows) and
        (B, n_cells * order). Built on first use: only creeping solves need it.

        Args:
            used: the slots that are asked for; all others count as constants.
        """
        out = np.zeros((slots.shape[0], self.n_slots, self.n_slots))
        asked = np.array(used)
        some = _second(self, used)([slots, constants, on_rows, on_curve])[0]
        out[:, asked[:, None], asked] = some.reshape(-1, asked.size, asked.size)
        return out


@lru_cache(maxsize=64)
def _second(made: Block, used: tuple[int, ...]) -> Mapped:
    """The mapped function behind `Block.bend`."""
    slots, constants, rows, curve = made.expressions
    on_rows, on_curve = ca.SX.sym("on_rows", made.n_rows), ca.SX.sym("on_curve", curve.numel())
    weighted = ca.dot(on_rows, rows) + ca.dot(on_curve, curve)
    moving = ca.vertcat(*(slots[i] for i in used))
    second, _ = ca.hessian(weighted, moving)
    function = ca.Function(f"{made.kind}_second", [slots, constants, on_rows, on_curve], [ca.densify(second)])
    return Mapped(function)


@lru_cache(maxsize=64)
def block(model: Model, kind: BlockKind, steps: int = 1) -> Block:
    """The block functions of one kind; `steps` RK4 steps per interval (slips only)."""
    s, rows, curve = equations(model, kind, steps)
    slots = s.slots(kind)
    values = ca.Function(f"{kind}_values", [slots, s.constants], [rows, curve])
    # Together they take a fifth less than the two one by one.
    jacobian = ca.densify(ca.jacobian(ca.vertcat(rows, curve), slots))
    derivatives = ca.Function(f"{kind}_derivatives", [slots, s.constants], [rows, curve, jacobian])
    line = model.straight or kind.startswith("steady") or kind == "reageing"
    cells, order = (steps, 4) if kind in SLIDES else (1, 2) if line else (REST_CELLS, 4)
    return Block(
        kind,
        slots.numel(),
        rows.numel(),
        cells,
        order,
        Mapped(values),
        Mapped(derivatives),
        (slots, s.constants, rows, curve),
        len(model.parameters) + len(model.states),
    )
