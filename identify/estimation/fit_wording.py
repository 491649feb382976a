"""What is said of a fit: what the logs contradict before it, how it ended and what to do, and what these logs cannot
determine and which test would."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from identify.base.result import Status
from identify.base.wording import speed_text, three_figures
from identify.effects import ALL, MAIN
from identify.estimation.attempt import Attempt
from identify.estimation.covariance import Estimate
from identify.logs.prepare import Prepared
from identify.logs.unknowns import AT_BOUND, RIG_REACH, Unknowns
from identify.model.model import RIG_PARAMETERS
from identify.prediction.wording import listed
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

EXCHANGE = (
    "where the normal force sticks and slips and the friction force does not, exchange the two: in each of these "
    '[[logs]], columns = { normal_force = "…", friction_force = "…" }'
)
SLOWER = "slower, with a softer spring or at a higher load"
SCATTER_SHOWN = "see the cycle scatter and the classical table in the report"

RESOLVED = 12  # samples of a slip from which on its shape can be read
WANTED = 25  # samples of a slip to ask for
STEEPER = 5.0  # and by which they rise too fast: nothing in series does that, and no rig value is so wrong
STICKS, AGREE = 2, 0.3  # sticks that a unit has to be wrong in, and how much they may differ: cycles may be misread


def prefit_warnings(prepared: Sequence[Prepared]) -> list[str]:
    """Sentences on a stiffness or drive speed that the sticks contradict, of all logs together where all say the same,
    and on cycles that differ among themselves."""
    taken = [log for log in prepared if log.left_out is None]
    uneven = uneven_words(taken)
    then = [f"{uneven}: a strength of each stick is tried, then the estimator of uneven records"] if uneven else []
    seen = [log for log in taken if log.judgement.slope_errors]
    odd = [(log, f.message) for log in seen for f in log.judgement.findings if f.code == "stick_slope"]
    ratios = np.array([1.0 + log.judgement.slope_errors[0] for log, _ in odd])
    if len(odd) < max(len(seen), 2) or not (np.all(ratios < 1.0) or np.all(ratios > 1.0)):
        return [*(f"{log.name}: {message}" for log, message in odd), *then]
    ratio, stated = float(np.median(ratios)), odd[0][0].rig.stiffness
    instead = f"{three_figures(ratio * stated)} N/m"
    return [
        f"in the sticks of all logs the force rises at {three_figures(ratio)} times stiffness times drive speed: the "
        f"stiffness is {instead} instead of {three_figures(stated)} N/m, or all drive speeds are off; correct "
        f'[rig], or let it be estimated: [parameters] stiffness = {{ start = "{instead}" }}',
        *then,
    ]


def wrong_unit(prepared: Sequence[Prepared], *, placed: bool = True) -> str:
    """A sentence where the sticks of a log rise so differently from stiffness times drive speed that a unit must be
    wrong; "" where none do.

    Args:
        placed: False where the model could not be placed on the logs: less is enough to suspect a unit then.
    """
    # Nothing soft in series makes sticks rise thirty times as slowly.
    slower = 30.0 if placed else STEEPER
    for log in prepared:
        rise = log.segmentation.stick_slope
        if rise is None or log.segmentation.stick_slopes.size < STICKS or rise[1] > AGREE:
            continue
        for slope in log.judgement.slope_errors:
            if not 1.0 / slower < 1.0 + slope < STEEPER:
                return (
                    f"in the sticks of {log.name} the force rises {1.0 + slope:.3g} times as fast as stiffness times "
                    "drive speed: check the units of its time and forces, its drive speed and the stiffness of "
                    "the rig"
                )
    return ""


def uneven_words(prepared: Sequence[Prepared]) -> str:
    """A sentence on the log whose cycles scatter most, of those where they are unlike; "" where there is none."""
    log = max((log for log in prepared if log.unlike), key=lambda log: log.scatter, default=None)
    if log is None:
        return ""
    return (
        f"friction differs from cycle to cycle: in {log.name} the drop changes by {100 * log.scatter:.0f} % from one "
        "cycle to the next, which noise does not explain, while the model takes all cycles as alike"
    )


def at_bounds(unknowns: Unknowns, theta: Array) -> dict[str, str]:
    """A sentence per free parameter that sits on a bound: the scene's own can be widened, the model's can not."""
    out = {}
    for i in np.flatnonzero(unknowns.free).tolist():
        name = unknowns.names[i]
        for side, (word, bound) in enumerate((("lower", unknowns.lower[i]), ("upper", unknowns.upper[i]))):
            if abs(theta[i] - bound) >= AT_BOUND * unknowns.spread[i]:
                continue
            if unknowns.user_bounds[side, i]:
                out[name] = f"{name} sits at its {word} bound; widen it in [parameters], or fix {name}"
            elif name in RIG_PARAMETERS and abs(bound) == RIG_REACH:
                out[name] = f"{name} sits a factor of three from what [rig] states, and may go no farther; check it"
            else:
                owner = next((e.name for e in ALL if name in {p.name for p in e.parameters}), None)
                without = f", take {owner} out of the effects" if owner is not None and owner not in MAIN else ""
                out[name] = (
                    f"{name} is at the {word} end of what the model admits: these logs do not determine it; fix {name} "
                    f"in [parameters]{without}, or add a log that does"
                )
    return out


def untried(prepared: list[Prepared], left_out: dict[int, str]) -> tuple[Status, str]:
    """Status and sentence where no start could even be placed on the data."""
    if uneven := uneven_words(prepared):
        return Status.MODEL_MISFIT, f"{uneven}; {SCATTER_SHOWN}"
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
    slower = any(log.never_slips and not log.judgement.ends_loading for log in prepared)
    remedy = f", and record {SLOWER}" if slower else ""
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
    if attempt.fits and bounds:
        return Status.AT_BOUND, "; ".join(bounds.values())
    if not attempt.fits and (uneven := uneven_words(attempt.fitted_logs)):
        misfit = f"misfit {gate.chi2_per_sample:.3g} times the noise variance"
        return Status.MODEL_MISFIT, f"{uneven} ({misfit}); {SCATTER_SHOWN}"
    return gate.status, gate.message


def slides_only(logs: Sequence[Prepared], trajectories: Sequence[ShootingTrajectory]) -> str:
    """A sentence of an answer to logs of which none sticks; "" where one does."""
    if onsets(trajectories):
        return ""
    level = _without_cycles(logs, trajectories)["mu_k0"]
    return f"these logs slide without a stick that ends: {level}; the classical table has the coefficients"


# What these logs cannot determine, and what test would: in lab words, from their own figures.


def hints(
    logs: Sequence[Prepared], trajectories: Sequence[ShootingTrajectory], unknowns: Unknowns, theta: Array
) -> dict[str, str]:
    """Per parameter, what stands beside a verdict other than identified.

    Args:
        logs, trajectories: the fitted logs and the motion behind them; theta (n_p,) the answer.
    """
    slipping = [(log, g) for log, g in zip(logs, trajectories, strict=True) if g.cycles]
    if not slipping:
        return _without_cycles(logs, trajectories)
    slips = [float(np.median(g.arrest - g.onset)) for _, g in slipping]
    samples = max(slip / log.data.interval for slip, (log, _) in zip(slips, slipping, strict=True))
    speeds = sorted({log.data.drive_speed for log, _ in slipping})
    if samples < RESOLVED:
        remedy = f"sample at {round_up(WANTED / min(slips)):.0f} Hz or more, or add a log that slips for longer"
        shape = f"slips have at most {samples:.0f} samples, so their shape is not resolved: {remedy}"
    elif len(speeds) == 1:
        remedy = f"add a log at {1e3 * 10 * speeds[0]:.2g} mm/s or more, with {WANTED} samples per slip"
        shape = f"one drive speed ({1e3 * speeds[0]:.3g} mm/s) shows one kind of slip: {remedy}"
    else:
        shape = f"the slips of these {len(speeds)} speeds are too alike: add a faster log, or more cycles"
    out = dict.fromkeys(("a", "delta_mu_k", "D", "mu_k0", "mass", "damping"), shape)
    if "t_cr" in unknowns.names:
        sticks, t_cr = np.concatenate([g.sticks for _, g in slipping]), np.exp(theta[unknowns.names.index("t_cr")])
        rests = "sticks of different length are needed: add a slower and a faster log"
        if sticks.size and np.min(sticks) > 3 * t_cr:
            rests = (
                f"every stick lasts {np.min(sticks):.2g} s or more, long enough to saturate the contact: add a faster "
                "log, with sticks of a few tenths of that"
            )
        elif sticks.size and np.max(sticks) < t_cr:
            rests = f"the longest stick is {np.max(sticks):.2g} s, too short to saturate the contact: add a slower log"
        out |= dict.fromkeys(("t_cr", "mu_s"), rests)
    return out


def onsets(trajectories: Sequence[ShootingTrajectory]) -> int:
    """How many sticks end within these motions."""
    return sum(trajectory.ending("onset").size for trajectory in trajectories)


def not_determined(
    estimates: list[Estimate], trajectories: Sequence[ShootingTrajectory], reasons: Mapping[str, str]
) -> list[Estimate]:
    """The estimates without numbers for what no single peak determines: how strong a contact gets, and how soon."""
    if onsets(trajectories) > 1:
        return estimates
    return [
        Estimate(e.name, e.unit, e.value, None, None, None, "not identifiable", reasons.get(e.name, e.reason))
        if e.name in ("mu_s", "t_cr") and e.verdict in ("identified", "weak")
        else e
        for e in estimates
    ]


def _without_cycles(logs: Sequence[Prepared], trajectories: Sequence[ShootingTrajectory]) -> dict[str, str]:
    """Of logs that slide, or stick once: what they hold, and what would tell more."""
    sticks, slower = onsets(trajectories), f"add a log that sticks and slips: {SLOWER}"
    last = [log.data.speed_at(log.data.end) for log in logs]
    words = listed([speed_text(speed, 3) for speed in sorted({speed for speed in last if speed} or set(last))])
    level = f"a log that slides determines the friction level at its speed ({words}) and no more"
    out = dict.fromkeys(("mu_k0", "delta_mu_k", "a"), f"{level}: {slower}, and logs that slide at other speeds")
    out |= dict.fromkeys(("mu_s", "t_cr", "D"), f"{level}: {slower}")
    if sticks:
        peaks = "one stick shows" if sticks == 1 else f"{sticks} sticks show"
        hold = f"{peaks} the strength after those rests: add holds that last a tenth and ten times as long"
        out |= {"mu_s": hold, "t_cr": hold, "D": f"the peaks have too few samples: sample faster, or {slower}"}
    return out


def round_up(rate: float) -> float:
    """The next sampling rate [Hz] that one would set."""
    return float(next(r for r in (100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 1e9) if r >= min(rate, 1e9)))
