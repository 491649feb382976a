"""How the models of a selection are weighed: likelihood-ratio statistics, and what their parameters cost (Schwarz)."""

from __future__ import annotations

import numpy as np

from identify.diagnosis.fitted import Fitted
from identify.effects import ALL

ENOUGH = 25.0  # statistic of an effect that is never dropped: nothing costs more
CONFUSED = ("load_dependence",)  # logs that differ in load differ in speed as well, mostly, and drifts look the same
ALIKE, UNLIKE = 0.1, 0.1  # relative difference of speeds that are one, and of loads that are two


def statistic(larger: Fitted, smaller: Fitted) -> float:
    """Likelihood-ratio statistic of the larger model; an estimated or wrong noise level is taken out."""
    if larger.attempt is None:
        return 0.0 if smaller.attempt is None else -np.inf
    noise = max(1.0, 1.0 + larger.excess / larger.samples) if np.isfinite(larger.excess) else 1.0
    return float((smaller.excess - larger.excess) / noise) if np.isfinite(larger.excess) else -np.inf


def penalty(larger: Fitted, smaller: Fitted) -> float:
    """What the parameters of an effect must gain at least, never more than ENOUGH."""
    if larger.attempt is None:
        return ENOUGH
    least = float(np.log(larger.samples))
    return float(np.clip(_price(larger, larger.samples) - _price(smaller, larger.samples), least, ENOUGH))


def better(other: Fitted, than: Fitted) -> float:
    """By how much another model is better, its parameters paid for."""
    if other.attempt is None:
        return -np.inf
    return -statistic(than, other) + _price(than, other.samples) - _price(other, other.samples)


def _price(fitted: Fitted, samples: int) -> float:
    """What the parameters of a model cost on so many samples: the logarithm of their number each, and ENOUGH for an
    effect that the design of the logs confuses with others."""
    each = float(np.log(samples))
    confused = [name for name in CONFUSED if searched(fitted, name)] if not _told_apart(fitted) else []
    return fitted.searched * each + len(confused) * max(ENOUGH - each, 0.0)


def searched(fitted: Fitted, effect: str) -> bool:
    """Whether a parameter of this effect is searched."""
    own = {q.name for e in ALL if e.name == effect for q in e.parameters}
    return any(free and name in own for name, free in zip(fitted.unknowns.names, fitted.unknowns.free, strict=True))


def _told_apart(fitted: Fitted) -> bool:
    """Whether two logs at about one drive speed were taken under different loads."""
    at = [(log.data.drive_speed, log.data.mean_normal_force) for log in fitted.prepared]
    return any(
        abs(speed - other) <= ALIKE * abs(speed) and abs(load - under) > UNLIKE * load
        for i, (speed, load) in enumerate(at)
        for other, under in at[:i]
    )
