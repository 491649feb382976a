"""How a rest that is no straight line is cut into blocks, and where the contact stands once it re-aged before it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identify.model.model import SPEED, Model
from identify.shooting.block_equations import REST_CELLS
from identify.shooting.blocks import block

Array = NDArray[np.float64]

DECAYED = (3.0, 8.0, 18.0)  # time constants at which a rest is cut: what decays is followed until it is gone
CELLS_PER_PERIOD = 8  # of an oscillation while the mass rests
MOST_PARTS = 4000  # of one rest


def parts_of_rest(rates: Array, frequencies: Array, duration: float) -> list[tuple[float, float]]:
    """Fractions of a rest [s] that one block each can follow: fine where something decays, and where it oscillates.

    Args:
        rates: of what decays [1/s]; frequencies: of what oscillates [rad/s].
    """
    if duration <= 0.0:
        return [(0.0, 1.0)]
    ends = [c / r for r in rates for c in DECAYED if c / r < duration]
    edges = np.unique([0.0, *ends, duration])
    longest = min((REST_CELLS * 2 * np.pi / (CELLS_PER_PERIOD * w) for w in frequencies), default=np.inf)
    cuts = [
        np.linspace(a, b, 1 + min(max(int(np.ceil((b - a) / longest)), 1), MOST_PARTS))[:-1] for a, b in pairwise(edges)
    ]
    inner = np.append(np.concatenate(cuts), duration) / duration
    return list(zip(inner[:-1].tolist(), inner[1:].tolist(), strict=True))


def cut(constants: Array, part: tuple[float, float], straight: bool) -> tuple[Array, Array]:
    """The constants of a rest for one part of it (fractions), and the windows of its cells (cells, 2) [s].

    Args:
        constants: of the block of the whole rest; straight: one cell follows it.
    """
    own = constants.copy()
    own[-2:] = part
    since, duration = constants[-4], constants[-3]
    edges = since + duration * np.linspace(*part, (1 if straight else REST_CELLS) + 1)
    return own, np.stack([edges[:-1], edges[1:]], axis=1)


def after_reageing(model: Model, state: Array, theta: Array, moment: Array, rows: Array) -> Array:
    """A state at rest once the contact re-aged (n_x,).

    Args:
        state: where the mass would rest with the contact still at its bound (n_x,); theta: as the slots of a block take
            it; moment: the constants of the block "reageing"; rows: its row scales (n_x,).
    """
    slots = np.concatenate([state, np.zeros(state.size + 3), theta])
    found = block(model, "reageing").evaluate(slots[None], moment[None], derivatives=False)[0][0]
    value, others = state.copy(), [i for i in range(state.size) if i != SPEED]
    value[SPEED] = 0.0
    value[others] = np.where(np.isfinite(found), -found * rows[others], value[others])
    return value
