"""The search: from prepared logs to a solution that fits, or the attempt that came closest.

    start  ->  place on the data  ->  solve  ->  goodness of fit  ->  join the logs that took no part

Starts come from the features of the logs, the most promising one first; the first that fits all logs ends the search.
A start of the user is one more start, never the only one. Where parameters differ between groups of logs, every group
is solved by itself first, since a start that fits the mean of two materials fits neither.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.progress import Progress, to_nobody
from identify.base.result import Status
from identify.estimation.attempt import Attempt, place_on, solve_from, solve_placed, usable
from identify.estimation.estimator import in_time, tried
from identify.estimation.goodness_of_fit import loads_stand_in
from identify.estimation.starts import Sources, starts_of
from identify.estimation.stick_strength import with_own_strengths, with_strengths
from identify.logs.prepare import Prepared, settled_part
from identify.logs.unknowns import Unknowns

Array = NDArray[np.float64]

STARTS = 4  # feature starts that are solved at most
COST_CUTOFF = 8.0  # cost per residual of a start that no solve will save


@dataclass(frozen=True)
class SearchProblem:
    """What is searched.

    Attributes
    ----------
    prepared, unknowns: logs and search space.
    known: a start (n_p,) that is solved before all others; sources of these: the data, the user's values
        (unknowns.start), or both.
    seed: of the random starts.
    thorough: False solves the first feature start alone, and none that does not fit one cycle.
    explained: whether something that was stated is clearly why an attempt misfits: no further start is tried then.
    """

    prepared: list[Prepared]
    unknowns: Unknowns
    sources: Sources = "data"
    seed: int = 0
    thorough: bool = True
    explained: Callable[[Attempt], bool] = lambda _attempt: False
    known: Array | None = None
    progress: Progress = to_nobody


def search(problem: SearchProblem) -> tuple[Attempt | None, dict[int, str]]:
    """Find the solution of all logs together.

    Returns
    -------
    attempt: the accepted one, else the one that came closest, None where no start could be placed on any log.
    left_out: by index of a log that took no part, why.
    """
    together = _group_by_group(problem)
    if together is not None:
        return together
    prepared = problem.prepared
    left_out = {i: log.left_out for i, log in enumerate(prepared) if log.left_out is not None}
    able = usable(prepared)
    cycling = [i for i in able if prepared[i].typical > 0]
    starting = [i for i in cycling if not prepared[i].fit_mode.low_snr] or able
    expected = {i for i in able if i in starting or prepared[i].slip_times.size > 1}
    best: Attempt | None = None
    for number, (strategy, theta) in enumerate(_starts(problem, starting) if able else ()):
        at = replace(problem.unknowns, start=theta)
        attempt = tried(strategy, partial(solve_from, prepared, starting, at), logs=starting)
        if attempt is None:
            continue
        if number == 0 and not attempt.fits and problem.explained(attempt):
            best = attempt
            break
        best = _better(best, _completed(problem, attempt, theta, starting, first=number == 0))
        # What passes as autocorrelated noise may yet be a misfit that another start has not.
        if _fits(best) and best.gate.level == 1.0 and expected <= set(best.log_numbers):
            break
    why = "does not stick-slip, or not like this, at the answer of the other logs"
    if best is None:
        why = "is not reproduced by any start: the model slides steadily where it sticks"
    taken = () if best is None else best.log_numbers
    left_out |= {i: f"{prepared[i].name} {why}; it was left out" for i in able if i not in taken}
    missing = [prepared[i].name for i in starting if i not in taken]
    if _fits(best) and missing:  # well as it fits the others, it is no answer
        message = (
            f"no start led to an answer of all logs: the one of the others does not describe {', '.join(missing)}; fit "
            "that log alone, and compare its parameters with theirs"
        )
        best = replace(best, gate=replace(best.gate, status=Status.SOLVER_FAILED, message=message))
    return best, left_out


def _starts(problem: SearchProblem, starting: list[int]) -> Iterator[tuple[str, Array]]:
    """Starts (n_p,) in the order in which they deserve a solve, each with its strategy."""
    chosen = [problem.prepared[i] for i in starting]
    if problem.known is not None:
        yield "known start", problem.known
    apart = [log.pieces if not log.data.on_course and log.typical else () for log in chosen]  # with cycles of their own
    if any(apart) and in_time("pieces first"):
        pieces = [piece for log, own in zip(chosen, apart, strict=True) for piece in (own or (log,))]
        known, _ = search(replace(problem, prepared=pieces, progress=to_nobody))
        if known is not None:
            yield "pieces first", known.solved.theta
    even = alike(chosen)
    problem.progress("finding a start", 0.1)
    cutoff, seed = np.inf if problem.thorough else COST_CUTOFF, problem.seed if even else None
    thetas = starts_of(chosen, problem.unknowns, problem.sources, seed=seed, worst=cutoff)
    # No start of a model of equal cycles fits cycles that differ: one solve shows how badly.
    for number in range(STARTS if problem.thorough and even else 1):
        strategy = "further feature starts" if number else "feature start"
        theta = next(thetas, None) if in_time(strategy) else None
        if theta is None:
            return
        problem.progress(f"solving from start {number + 1}", 0.3 + 0.1 * number)
        yield strategy, theta


def _completed(problem: SearchProblem, attempt: Attempt, theta: Array, starting: list[int], *, first: bool) -> Attempt:
    """What one start leads to, joined by the other logs; with a strength of each stick where loads stand in for that,
    or the first start does not fit: no later one is tried so."""
    prepared, at, alike_sticks = problem.prepared, replace(problem.unknowns, start=theta), attempt
    alike_loads = attempt.gate.level > 1.0 or not loads_stand_in(attempt.solved)  # autocorrelated noise moves loads too
    if problem.thorough and (not alike_loads if attempt.fits else first):
        problem.progress("solving with a strength of each stick", 0.55)
        scattered = tried(
            "strength per stick", lambda: with_own_strengths(alike_sticks, prepared, at), alike_sticks, starting
        )
        if _fits(scattered):
            attempt, prepared = scattered, with_strengths(prepared, scattered.fitted_logs[0].data.strength_sd)
    late = [i for i in usable(prepared) if i not in attempt.log_numbers]
    if not attempt.fits or not late:
        return attempt
    problem.progress("joining the other logs", 0.8)
    others = attempt
    return tried("logs joined", lambda: _joined(others, prepared, late, problem.unknowns), others, late) or attempt


def _joined(best: Attempt, prepared: list[Prepared], late: list[int], unknowns: Unknowns) -> Attempt:
    """Solve again with the logs that took no part so far, each treated in the first way in which the answer can be
    placed on it: all of them at once, else one after the other, so that one that does not fit keeps out no other."""
    at_answer = replace(unknowns, start=best.solved.theta)
    ways = {i: [log for log in _treatments(prepared[i]) if place_on([log], [0], at_answer)] for i in late}
    together = {i: some[0] for i, some in ways.items() if some}
    one_by_one = [{i: log} for i in together for log in ways[i][len(together) == 1 :]]
    logs, joined = list(prepared), set[int]()
    for more in [together, *one_by_one]:
        if not more or joined & set(more) or time_is_up():
            continue
        placed = [more.get(i, log) for i, log in enumerate(logs)]
        numbers = sorted([*best.log_numbers, *more])
        found = solve_from(placed, numbers, replace(unknowns, start=best.solved.theta))
        if _fits(found):
            best, logs = found, placed
            joined |= set(more)
    return best


def _treatments(log: Prepared) -> Iterator[Prepared]:
    """A log as it is, as the model moves whatever was seen of its slips, and its steady end alone."""
    if not log.fit_mode.low_snr:
        yield log
    if log.fit_mode.name == "cycles":
        yield log.as_continuous
        if log.fit_mode.low_snr:
            yield log
    settled = settled_part(log)
    if settled is not None:
        yield settled


def _group_by_group(problem: SearchProblem) -> tuple[Attempt | None, dict[int, str]] | None:
    """Where parameters differ between groups of logs, the answer of all together, from the motions of that of each
    alone and the mean of what they share; None where all share them, or a group is too poor to stand alone."""
    prepared, unknowns = problem.prepared, problem.unknowns
    groups: dict[tuple[str, ...], list[int]] = {}
    for number, log in enumerate(prepared):
        key = tuple(log.data.groups[i] or f"log {number}" for i in np.flatnonzero(unknowns.grouped).tolist())
        groups.setdefault(key, []).append(number)
    if len(groups) < 2:
        return None
    thetas, placed, left_out = list[Array](), [], dict[int, str]()
    for numbers in groups.values():
        logs = [prepared[i] for i in numbers]
        alone, out = search(replace(problem, prepared=logs, unknowns=replace(unknowns, per=())))
        if not _fits(alone):
            return None
        left_out |= {numbers[i]: why for i, why in out.items()}
        thetas.append(alone.solved.theta)
        own = np.where(unknowns.own, alone.solved.theta, np.nan)
        motions = zip(alone.log_numbers, alone.fitted_logs, alone.solved.trajectories, strict=True)
        placed += [(numbers[i], log, replace(motion, own=own)) for i, log, motion in motions]
    start = replace(unknowns, start=np.mean(thetas, axis=0))
    joint = tried("group by group", lambda: solve_placed(sorted(placed, key=lambda each: each[0]), start))
    return None if joint is None else (joint, left_out)


# Which attempt is an answer, and the better of two.


def _fits(attempt: Attempt | None) -> TypeGuard[Attempt]:
    return attempt is not None and attempt.fits


def _better(best: Attempt | None, attempt: Attempt | None) -> Attempt | None:
    if attempt is None or best is None:
        return attempt if best is None else best

    def rank(a: Attempt) -> tuple[bool, int, bool, float]:
        chi2 = a.gate.chi2_per_sample
        off = abs(chi2 - 1.0) if np.isfinite(chi2) else np.inf
        return not a.fits, -len(a.log_numbers), not np.isfinite(a.excess), off

    return min(best, attempt, key=rank)


def alike(prepared: Sequence[Prepared]) -> bool:
    """Whether the cycles of these logs resemble each other, so that more starts than one are worth a solve."""
    return not any(log.unlike for log in prepared)
