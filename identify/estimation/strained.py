"""What an answer had to take up beside the noise: the normal force of every cycle, and the strength of every stick.

The misfit of the samples does not see it: what a wrong answer gets wrong from cycle to cycle, these take up.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from identify.base.quantiles import student
from identify.base.wording import three_figures
from identify.logs.log_data import LogData
from identify.shooting.passes import Solved
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

FARTHEST = 6.0  # standard errors of a load, and standard deviations of the sum of their squares
SPANS_A_SLIP = 0.5  # of the strength: a stick that is off by less spans no slip that was missed
CHANCE = 1e-7  # by which the strength of a stick is so far off those of all others


def strained_load(solved: Solved, names: Sequence[str]) -> str:
    """A sentence where cycles fit only because their normal force was moved further than its measurement allows; ""
    where none do."""
    model = solved.problem.layout.unknowns.model
    remedy = "" if "occlusion" in model.effects else ", or add occlusion to effects"
    for data, trajectory, name in zip(solved.problem.logs, solved.trajectories, names, strict=True):
        off = _load_pulls(data, trajectory)
        if not off.size:
            continue
        worst = int(np.argmax(np.abs(off)))
        cycle = np.append(np.arange(trajectory.deviation.size), trajectory.slip_parts)[worst]
        if max(_excess(off), abs(float(off[worst]))) > FARTHEST:
            return (
                f"{name}: the cycles fit only if their normal force is off by up to {abs(off[worst]):.0f} standard "
                f"errors of its measured course (cycle {cycle + 1}), or friction drifts or differs from cycle to "
                f"cycle; check the sensor of the normal force, leave those cycles out{remedy}"
            )
    return ""


def loads_stand_in(solved: Solved) -> bool:
    """Whether the normal forces of some log are off by more than their errors, so that they may stand in for something
    else that differs from cycle to cycle."""
    pulls = (
        _load_pulls(data, trajectory) for data, trajectory in zip(solved.problem.logs, solved.trajectories, strict=True)
    )
    return any(off.size and _excess(off) > 0.0 for off in pulls)


def _excess(off: Array) -> float:
    """Standard deviations by which the squares of so many standard normal numbers exceed their mean."""
    return (float(off @ off) - off.size) / float(np.sqrt(2.0 * off.size))


def _load_pulls(data: LogData, trajectory: ShootingTrajectory) -> Array:
    """By how many of its standard errors the normal force is off in every part, then at the end of every slip; empty
    where it is exact."""
    if not data.normal_force_sd > 0.0 or not trajectory.deviation.size:
        return np.empty(0)
    slid = trajectory.slip_deviation.size
    mean = np.zeros(trajectory.deviation.size)
    mean[trajectory.slip_parts] = data.expected[0]
    at_onset = (trajectory.deviation - mean) / data.onset_load_sd_at(trajectory.loaded_at)
    return np.append(
        at_onset, (trajectory.slip_deviation - data.expected[1]) / data.load_sd_at(trajectory.slid_at[:slid])
    )


def odd_stick(solved: Solved, names: Sequence[str]) -> str:
    """A sentence where the strength of one stick is off as no scatter of the others explains (Grubbs 1950); "" where
    none is, or where strengths are not told apart."""
    layout = solved.problem.layout
    off, n = layout.beside(solved.solution.x)[layout.varied], layout.varied.size
    if n < 3:
        return ""
    worst = int(np.argmax(np.abs(off)))
    times = abs(float(off[worst])) / float(np.sqrt(np.sum(np.delete(off, worst) ** 2) / (n - 1)))
    if times < float(student(1.0 - 0.5 * CHANCE / n, n - 1)):
        return ""
    log = next(i for i, place in enumerate(layout.places) if layout.varied[worst] in place.strength)
    cycle = int(np.flatnonzero(layout.places[log].strength == layout.varied[worst])[0])
    share = float(off[worst]) / layout.unknowns.strength(solved.theta)
    slip = "a slip was missed or invented, or " if abs(share) > SPANS_A_SLIP else ""
    return (
        f"{names[log]}, cycle {cycle + 1} fits only with a static friction {times:.0f} times as far off as the other "
        f"sticks scatter, its strength (mu_s - mu_k0) off by {100.0 * share:+.2g} %: perhaps {slip}the force was cut "
        "off or disturbed; look at it in the report and exclude that stretch"
    )


def stick_scatter(solved: Solved) -> float | None:
    """Standard deviation of mu_s - mu_k0 from stick to stick, over its mean; None where it is the same in all."""
    unknowns, sd = solved.problem.layout.unknowns, max(log.strength_sd for log in solved.problem.logs)
    if not sd > 0.0:
        return None
    strength = unknowns.strength(solved.theta)
    return sd / strength if strength > 0.0 else None


def scatter_words(solved: Solved) -> str:
    """What is said of it, to go behind the sentence of an answer; "" where it is the same in all sticks."""
    scatter = stick_scatter(solved)
    if scatter is None:
        return ""
    return f"; strength (mu_s - mu_k0) differs from stick to stick by {three_figures(100.0 * scatter)} %"
