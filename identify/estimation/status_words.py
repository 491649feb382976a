"""What is said of a fit: its status and the sentence with what to do, and what is known before anything is fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.base.wording import three_figures
from identify.effects import ALL, MAIN
from identify.estimation.attempt import Attempt
from identify.logs.prepare import Prepared
from identify.logs.unknowns import AT_BOUND, RIG_REACH, Unknowns
from identify.model.model import RIG_PARAMETERS

Array = NDArray[np.float64]

EXCHANGE = (
    "where the normal force sticks and slips and the friction force does not, exchange the two: in each of these "
    '[[logs]], columns = { normal_force = "…", friction_force = "…" }'
)


def at_bounds(unknowns: Unknowns, theta: Array) -> dict[str, str]:
    """A sentence per free parameter that sits on a bound: the scene's own can be widened, the model's can not."""
    out = {}
    for i in np.flatnonzero(unknowns.free).tolist():
        name = unknowns.names[i]
        for side, (word, bound) in enumerate((("lower", unknowns.lower[i]), ("upper", unknowns.upper[i]))):
            if abs(theta[i] - bound) >= AT_BOUND * unknowns.spread[i]:
                continue
            if unknowns.walls[side, i]:
                out[name] = f"{name} sits at its {word} bound; widen it in [parameters], or fix {name}"
            elif name in RIG_PARAMETERS and abs(bound) == RIG_REACH:
                out[name] = f"{name} sits a factor of three from what [rig] states, and may go no farther; check it"
            else:
                owner = next((e.name for e in ALL if name in {p.name for p in e.parameters}), None)
                without = f", take {owner} out of the effects" if owner is not None and owner not in MAIN else ""
                out[name] = (
                    f"{name} sits at the {word} end of what the model admits: these logs do not tell it; fix {name} in "
                    f"[parameters]{without}, or add a log that tells it"
                )
    return out


def untried(prepared: list[Prepared], left_out: dict[int, str]) -> tuple[Status, str]:
    """Status and sentence where no start could even be placed on the data."""
    if uneven := uneven_words(prepared):
        return Status.MODEL_MISFIT, f"{uneven}; see the cycle scatter and the classical table in the report"
    taken = [log for log in prepared if log.left_out is None]
    if taken and all(log.fit_mode.name != "cycles" for log in taken):
        return Status.MODEL_MISFIT, (
            "no start reproduces how these logs move: check that the drive speed of each, and the times at which it "
            "changes, are as stated, and mass, stiffness and damping; where the force does not change with the speed, "
            "take a window of one speed of each log"
        )
    if taken:
        return Status.MODEL_MISFIT, (
            "no start reproduces the stick-slip of these logs: with this mass, stiffness and drive speed the model "
            "slides steadily; check the rig values, or estimate them under [parameters]"
        )
    reason = "; ".join(left_out.values()) or "no log shows a stick-slip cycle"
    # What is wrong with a log that is rejected, or of which all cycles are skipped, no other test would mend. One that
    # was stopped before its first slip says its own: recorded slower, it would slip later still.
    slower = ", and record slower, with a softer spring or at a higher load"
    remedy = slower if any(log.never_slips and not log.judgement.ends_loading for log in prepared) else ""
    if any(log.judgement.swapped for log in prepared):
        remedy = f"{remedy}; {EXCHANGE}"
    return Status.NO_CYCLES, f"there is nothing to fit: {reason}; see the classical table{remedy}"


def underivable(attempt: Attempt) -> str:
    """Sentence where an answer has no derivatives, so that nothing can be said of how sure it is."""
    misfit = attempt.gate.chi2_per_sample
    size = f" (misfit {misfit:.3g} times the noise variance)" if np.isfinite(misfit) else ""
    return (
        f"the answer ends where the model has no derivatives{size}; check the units of the forces, the drive speed and "
        "when it changes, mass and stiffness"
    )


def ended(attempt: Attempt, bounds: Mapping[str, str]) -> tuple[Status, str]:
    """Status and sentence of an attempt; bounds: a sentence per parameter that sits on one."""
    gate = attempt.gate
    if gate.status is Status.CONVERGED and bounds:
        return Status.AT_BOUND, "; ".join(bounds.values())
    if gate.status is not Status.CONVERGED and (uneven := uneven_words(attempt.fitted_logs)):
        return Status.MODEL_MISFIT, (
            f"{uneven} (misfit {gate.chi2_per_sample:.3g} times the noise variance); "
            "see the cycle scatter and the classical table in the report"
        )
    return gate.status, gate.message


def uneven_words(prepared: Sequence[Prepared]) -> str:
    """A sentence on the log whose cycles scatter most, of those where they are unlike; "" where there is none."""
    log = max((log for log in prepared if log.unlike), key=lambda log: log.scatter, default=None)
    if log is None:
        return ""
    return (
        f"friction differs from cycle to cycle: in {log.name} the drop changes by {100 * log.scatter:.0f} % from one "
        "cycle to the next, which noise does not explain, while the model takes all cycles as alike"
    )


# ----------------------------------------------------------------------------------------------------------------------
# Before anything is fitted: what the logs show of rig and scatter, what is worth a word at once, what ends a fit.
# ----------------------------------------------------------------------------------------------------------------------

UNITS = 30.0  # factor by which sticks rise too slowly where a unit is wrong: nothing soft in series does that
STEEPER = 5.0  # and by which they rise too fast: nothing in series does that, and no rig value is so wrong
STICKS, AGREE = 2, 0.3  # sticks that a unit has to be wrong in, and how much they may differ: cycles may be misread


def prefit_warnings(prepared: Sequence[Prepared]) -> list[str]:
    """Sentences on a stiffness or drive speed that the sticks contradict, and on cycles that differ among
    themselves."""
    taken = [log for log in prepared if log.left_out is None]
    uneven = uneven_words(taken)
    said = [f"{uneven}: a strength of each stick is tried, then the estimator of uneven records"] if uneven else []
    return [*_stick_slopes(taken), *said]


def _stick_slopes(prepared: Sequence[Prepared]) -> list[str]:
    """What the quality gate found of the slopes, of all logs together where all say the same."""
    seen = [log for log in prepared if any(part.slope is not None for part in log.judgement.slips)]
    odd = [(log, f.message) for log in seen for f in log.judgement.findings if f.code == "stick_slope"]
    ratios = np.array([1.0 + next(p.slope for p in log.judgement.slips if p.slope is not None) for log, _ in odd])
    if len(odd) < max(len(seen), 2) or not (np.all(ratios < 1.0) or np.all(ratios > 1.0)):
        return [f"{log.name}: {message}" for log, message in odd]
    ratio, stated = float(np.median(ratios)), odd[0][0].rig.stiffness
    instead = f"{three_figures(ratio * stated)} N/m"
    return [
        f"in the sticks of all logs the force rises at {three_figures(ratio)} times stiffness times drive speed: the "
        f"stiffness is {instead} instead of {three_figures(stated)} N/m, or all drive speeds are off; mend [rig], or "
        f'let it be estimated: [parameters] stiffness = {{ start = "{instead}" }}'
    ]


def wrong_unit(prepared: Sequence[Prepared], *, placed: bool = True) -> str:
    """A sentence where the sticks of a log rise so differently from stiffness times drive speed that a unit must be
    wrong; "" where none do.

    Args:
        placed: False where the model could not be placed on the logs: less is enough to suspect a unit then.
    """
    slower = UNITS if placed else STEEPER
    for log in prepared:
        rise = log.segmentation.stick_slope
        if rise is None or log.segmentation.stick_slopes.size < STICKS or rise[1] > AGREE:
            continue
        for slope in (part.slope for part in log.judgement.slips if part.slope is not None):
            times = 1.0 + slope
            if not 1.0 / slower < times < STEEPER:
                return (
                    f"in the sticks of {log.name} the force rises {times:.3g} times as fast as stiffness times drive "
                    "speed says: check the units of its time and forces, its drive speed and the stiffness of the rig"
                )
    return ""
