"""The search: from prepared logs to a solution that fits, or the best reason why none does.

Features give starts, starts are placed on the data, placed starts are solved; the goodness-of-fit tests decide.
`STARTS` are rows of the table of strategies, tried from top to bottom until an answer fits, or the time is up. Logs
with few cycles, and logs that slide at the first answer, join after it. No start of the user is needed; one that is
given is one more start, never the only one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.base.progress import Progress, to_nobody
from identify.estimation.attempt import FIRST, Attempt, solve_by_continuation, solve_from, stalled, usable
from identify.estimation.events import join, with_events_mended
from identify.estimation.goodness_of_fit import PER_CYCLE
from identify.estimation.starts import Sources, slips_one_by_one, starts_of
from identify.estimation.stick_strength import with_own_strengths, with_strengths
from identify.estimation.strained import loads_stand_in
from identify.estimation.strategies import Strategy, may_run, run_strategy
from identify.logs.prepare import Prepared, settled_part
from identify.logs.unknowns import Unknowns
from identify.shooting.starts import level_starts

Array = NDArray[np.float64]

# Cycles a log must show to take part in the start, where it is no drive programme that slips; where the short logs
# mislead it, they come after.
LEAST = (1, 3)
SLIPS = 2  # of a log that is not left out before it was looked at together with all others
FURTHER = 3  # feature starts that are solved beside the first
COST_CUTOFF = 8.0  # cost per residual of a start that no solve will save


@dataclass(frozen=True)
class SearchProblem:
    """What is searched: logs and unknowns; sources: starts from the data, from the user's values (unknowns.start), or
    both; the seed of what is drawn; thorough: False takes the first feature start alone, and none that does not fit one
    cycle."""

    prepared: list[Prepared]
    unknowns: Unknowns
    sources: Sources = "data"
    seed: int = 0
    thorough: bool = True
    progress: Progress = to_nobody


def search(problem: SearchProblem) -> tuple[Attempt | None, dict[int, str]]:
    """Find the solution of all logs together.

    Returns:
        the accepted attempt, else the one that came closest, None where nothing could be tried; and per index of a
        log that took no part, why.
    """
    prepared = problem.prepared
    left_out = {i: log.left_out for i, log in enumerate(prepared) if log.left_out is not None}
    able = [i for i in range(len(prepared)) if i not in left_out]
    if not able:
        return None, left_out
    cycling = [[i for i in able if prepared[i].typical >= least] for least in LEAST]
    low_snr = {i for i in able if prepared[i].fit_mode.low_snr}
    starting = [i for i in able if (i in cycling[0] or slips_one_by_one(prepared[i])) and i not in low_snr]
    choices = [starting, [i for i in cycling[0] if i not in low_snr], *cycling, able]
    slips = {i for i in able if prepared[i].falls.size >= SLIPS}
    best: Attempt | None = None
    for number, logs in enumerate([some for n, some in enumerate(choices) if some and some not in choices[:n]]):
        if number > 0 and not may_run(Strategy.OTHER_LOGS):
            break
        found = _from_logs(problem, logs, able)
        if number > 0 and found is not None:
            found = replace(found, found_by=(Strategy.OTHER_LOGS.title, *found.found_by))
        best = _better(best, found)
        if _fits(best) and low_snr | slips <= set(best.log_numbers):
            break
    if not _fits(best):
        best = run_strategy(Strategy.STEADY_PARTS, lambda: _levels_only(problem, able), logs=able) or best
    return best, left_out | _missing(best, prepared, able)


def _levels_only(problem: SearchProblem, able: list[int]) -> Attempt | None:
    """What logs hold that slide in the end, where the way there is not described: their level; None where that does not
    fit either, or some log is more than one course to sliding."""
    prepared, unknowns = problem.prepared, problem.unknowns
    parts = [settled_part(prepared[i]) for i in able]
    if any(part is None or len(prepared[i].pieces) > 1 for part, i in zip(parts, able, strict=True)):
        return None
    having = list(prepared)
    for i, part in zip(able, parts, strict=True):
        having[i] = part or prepared[i]
    theta = level_starts([having[i] for i in able], unknowns)[0]
    found = solve_from(having, able, replace(unknowns, start=theta))
    return found if _fits(found) else None


@dataclass
class _Progressing:
    """The search from the features of some logs: the best attempt so far, and the starts the solver was lost from."""

    problem: SearchProblem
    logs: list[int]
    able: list[int]
    best: Attempt | None = None
    lost: list[Array] = field(default_factory=list)
    solved: int = 0

    @property
    def unequal(self) -> bool:
        """Whether cycles differ among themselves, so that no start of a model of equal cycles will fit, or a quick try
        is all that is wanted: one try shows how badly."""
        return not self.problem.thorough or not alike(self.chosen)

    def settled(self) -> bool:
        """Whether nothing more is to be tried: what passes as autocorrelated noise may yet be a misfit that another
        start has not."""
        best = self.best
        return _fits(best) and best.gate.level == 1.0 and set(self.logs) <= set(best.log_numbers)

    @property
    def chosen(self) -> list[Prepared]:
        """The logs of the start."""
        return [self.problem.prepared[i] for i in self.logs]

    def at(self, theta: Array) -> Unknowns:
        """The unknowns with this start."""
        return replace(self.problem.unknowns, start=theta)


def _from_logs(problem: SearchProblem, logs: list[int], able: list[int]) -> Attempt | None:
    """The search that starts from the features of these logs; the others that are able join at its answer."""
    state = _Progressing(problem, logs, able)
    problem.progress("finding a start", 0.1)
    starts = _feature_starts(state)
    for strategy, applies, tries in STARTS:
        if state.settled():
            break
        for attempt in tries(state, strategy, starts) if applies(state) else ():
            state.best = _better(state.best, attempt)
            if state.settled():
                break
    return None if state.best is None else rejected_as_incomplete(state.best, problem.prepared, logs)


# ----------------------------------------------------------------------------------------------------------------------
# Rows that start: each tells which starts it has, and how these are solved.
# ----------------------------------------------------------------------------------------------------------------------


def _feature_starts(state: _Progressing) -> Iterator[Array]:
    problem, chosen = state.problem, state.chosen
    uneven, worst = not alike(chosen), np.inf if problem.thorough else COST_CUTOFF
    return starts_of(chosen, problem.unknowns, problem.sources, problem.seed, uneven, worst)


def _pieces_first(state: _Progressing, strategy: Strategy, _starts: Iterator[Array]) -> Iterator[Attempt | None]:
    problem = state.problem
    pieces = [piece for log in state.chosen for piece in (log.pieces or (log,))]
    known, _ = search(replace(problem, prepared=pieces, progress=to_nobody))
    if known is not None:
        yield _solved_and_repaired(state, strategy, known.solved.theta)


def _first(state: _Progressing, strategy: Strategy, starts: Iterator[Array]) -> Iterator[Attempt | None]:
    yield from _next_starts(state, strategy, starts, 1)


def _further(state: _Progressing, strategy: Strategy, starts: Iterator[Array]) -> Iterator[Attempt | None]:
    yield from _next_starts(state, strategy, starts, 1 + FURTHER)


def _next_starts(
    state: _Progressing, strategy: Strategy, starts: Iterator[Array], most: int
) -> Iterator[Attempt | None]:
    """Feature starts in their order until so many were placed and solved."""
    while state.solved < most and may_run(strategy):
        theta = next(starts, None)
        if theta is None:
            return
        state.problem.progress(f"solving from start {state.solved + 1}", 0.3 + 0.1 * state.solved)
        yield _solved_and_repaired(state, strategy, theta)


def _prior_continuation(state: _Progressing, strategy: Strategy, _starts: Iterator[Array]) -> Iterator[Attempt | None]:
    problem = state.problem
    problem.progress("holding what the logs do not tell", 0.7)

    def solve(theta: Array) -> Attempt | None:
        return solve_by_continuation(problem.prepared, state.logs, state.at(theta))

    yield from _again_from(state, strategy, state.lost, solve)


def _again_from(
    state: _Progressing, strategy: Strategy, starts: Iterable[Array], solve: Callable[[Array], Attempt | None]
) -> Iterator[Attempt]:
    """From the first of these starts from which a way of solving finds an answer, which the other logs join."""
    for theta in starts:
        found = run_strategy(strategy, partial(solve, theta), logs=state.logs)
        if _fits(found):
            yield _with_the_others(state, state.problem.prepared, found)
            return


def _unanswered(state: _Progressing) -> bool:
    return not state.unequal and not _fits(state.best)


STARTS: tuple[
    tuple[
        Strategy,
        Callable[[_Progressing], bool],
        Callable[[_Progressing, Strategy, Iterator[Array]], Iterator[Attempt | None]],
    ],
    ...,
] = (
    (Strategy.PIECES_FIRST, lambda state: any(log.pieces for log in state.chosen), _pieces_first),
    (Strategy.FEATURE_START, lambda state: state.solved == 0 or not state.unequal, _first),
    (Strategy.FURTHER_STARTS, lambda state: not state.unequal, _further),
    (Strategy.PRIOR_CONTINUATION, lambda state: _unanswered(state) and bool(state.lost), _prior_continuation),
)
"""Where answers come from, in the order in which they are tried: row of the table, when it applies, what it tries."""


# ----------------------------------------------------------------------------------------------------------------------
# Rows that repair: from an attempt that does not fit to one that does.
# ----------------------------------------------------------------------------------------------------------------------


def _solved_and_repaired(state: _Progressing, strategy: Strategy, theta: Array) -> Attempt | None:
    """What comes of one start: solved as it is, then repaired; then with the other logs that are able. None where it
    can be placed on none."""
    problem, at = state.problem, state.at(theta)
    first = run_strategy(strategy, lambda: solve_from(problem.prepared, state.logs, at), logs=state.logs)
    if first is None:
        return None
    state.solved += 1
    prepared, attempt = _with_strengths(state, at, first)
    if not _fits(attempt) and not state.unequal:
        prepared, attempt = _events_corrected(state, at, attempt)
    if stalled(attempt):
        attempt = _held(state, prepared, at, attempt) or attempt
    if not attempt.solved.solution.success:
        state.lost.append(theta)
    return _with_the_others(state, prepared, attempt) if _fits(attempt) else attempt


def _with_strengths(state: _Progressing, at: Unknowns, attempt: Attempt) -> tuple[list[Prepared], Attempt]:
    """The logs and the answer with sticks that differ in strength, where they are told to."""
    problem = state.problem
    asked = loads_stand_in(attempt.solved) if _fits(attempt) else _better(state.best, attempt) is attempt
    if not (asked and problem.thorough):
        return problem.prepared, attempt
    problem.progress("solving with a strength of each stick", 0.55)
    own = run_strategy(
        Strategy.STICK_STRENGTHS,
        lambda: with_own_strengths(attempt, problem.prepared, at),
        attempt,
        attempt.log_numbers,
    )
    if not _fits(own):
        return problem.prepared, attempt
    return with_strengths(problem.prepared, own.fitted_logs[0].data.strength_sd), own


def _events_corrected(state: _Progressing, at: Unknowns, attempt: Attempt) -> tuple[list[Prepared], Attempt]:
    """The logs and the answer with slips that were missed put in and invented ones taken out, where that fits
    better."""
    problem = state.problem
    mended = _mended(problem.prepared, attempt, at) if may_run(Strategy.EVENTS_CORRECTED) else None
    if mended is None:
        return problem.prepared, attempt
    problem.progress("solving with other slips", 0.6)
    again = run_strategy(Strategy.EVENTS_CORRECTED, lambda: solve_from(mended, state.logs, at), attempt, state.logs)
    if again is not None and _better(attempt, again) is again:
        return mended, again
    return problem.prepared, attempt


def _held(state: _Progressing, prepared: list[Prepared], at: Unknowns, attempt: Attempt) -> Attempt | None:
    state.problem.progress("holding what the logs do not tell", 0.7)
    return run_strategy(
        Strategy.PRIOR_CONTINUATION,
        lambda: solve_by_continuation(prepared, state.logs, at, FIRST),
        attempt,
        state.logs,
    )


def _with_the_others(state: _Progressing, prepared: list[Prepared], attempt: Attempt) -> Attempt:
    problem = state.problem
    late = [i for i in state.able if i not in attempt.log_numbers]
    if not late:
        return attempt
    problem.progress("joining the other logs", 0.8)
    joined = run_strategy(
        Strategy.JOINED, lambda: join(attempt, prepared, late, problem.unknowns), attempt, attempt.log_numbers
    )
    return joined or attempt


def _mended(prepared: list[Prepared], attempt: Attempt, unknowns: Unknowns) -> list[Prepared] | None:
    """The logs with slips that were missed put in and invented ones taken out; None where there are none."""
    gate = attempt.gate
    wrong = {int(log) - 1 for log, z in zip(gate.log.tolist(), gate.z.tolist(), strict=True) if not z < PER_CYCLE}
    out = list(prepared)
    for position in wrong:
        number = attempt.log_numbers[position]
        out[number] = with_events_mended(prepared[number], unknowns)
    return out if any(new is not old for new, old in zip(out, prepared, strict=True)) else None


# ----------------------------------------------------------------------------------------------------------------------
# Which answer is one, and the better of two.
# ----------------------------------------------------------------------------------------------------------------------


def _fits(best: Attempt | None) -> TypeGuard[Attempt]:
    return best is not None and best.gate.status is Status.CONVERGED


def _better(best: Attempt | None, attempt: Attempt | None) -> Attempt | None:
    if attempt is None or best is None:
        return attempt if best is None else best

    def rank(a: Attempt) -> tuple[bool, int, float]:
        chi2 = a.gate.chi2_per_sample
        return (
            a.gate.status is not Status.CONVERGED,
            -len(a.log_numbers),
            abs(chi2 - 1.0) if np.isfinite(chi2) else np.inf,
        )

    return min(best, attempt, key=rank)


def alike(prepared: Sequence[Prepared]) -> bool:
    """Whether the cycles of these logs resemble each other, so that more starts than one are worth a try."""
    return not any(log.unlike for log in prepared)


def required_logs(prepared: Sequence[Prepared]) -> list[int]:
    """Numbers of the logs that an answer has to describe: they are not left out, and show enough cycles."""
    return [i for i in usable(prepared) if prepared[i].typical >= LEAST[1] and not prepared[i].fit_mode.low_snr]


def rejected_as_incomplete(best: Attempt, prepared: Sequence[Prepared], needed: Sequence[int]) -> Attempt:
    """An answer that leaves out a log with plenty of cycles does not describe the data, well as it fits the rest.

    Args:
        needed: numbers of these logs.
    """
    missing = [prepared[i].name for i in needed if i not in best.log_numbers]
    if not missing or best.gate.status is not Status.CONVERGED:
        return best
    message = (
        f"the answer of the other logs does not stick-slip as {', '.join(missing)} does: drive speed, stiffness or "
        "mass of that log are not as stated, or the others tell too little to lead to it: check these, or fit "
        "it alone"
    )
    return replace(best, gate=replace(best.gate, status=Status.MODEL_MISFIT, message=message))


def _missing(best: Attempt | None, prepared: list[Prepared], able: list[int]) -> dict[int, str]:
    """Why logs that could have taken part did not."""
    taken = best.log_numbers if best is not None else ()
    why = "does not stick-slip, or not like this, at the answer of the other logs"
    if best is None:
        why = "is not reproduced by any start: the model slides steadily where it sticks"
    return {i: f"{prepared[i].name} {why}; it was left out" for i in able if i not in taken}
