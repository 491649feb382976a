"""What a fit found of one parameter, for every group that has its own."""

from __future__ import annotations

from identify.diagnosis.fitted import Fitted
from identify.estimation.shares import shares
from identify.logs.unknowns import stated_rig


def group_values(fitted: Fitted, name: str) -> dict[str, float]:
    """The value [SI] of a parameter by group; of one that is shared by all logs under the empty name."""
    assert fitted.attempt is not None
    unknowns, theta = fitted.unknowns, fitted.attempt.solved.theta
    index, base = unknowns.names.index(name), unknowns.base(stated_rig(fitted.scene))
    found = {"": theta[index]} | {
        share.group: share.theta for share in shares(fitted.attempt, unknowns) if share.index == index
    }
    if len(found) > 1:
        del found[""]
    out = {}
    for group, own in found.items():
        at = theta.copy()
        at[unknowns.source[index]] = own
        out[group] = float(unknowns.values(at, base)[index])
    return out
