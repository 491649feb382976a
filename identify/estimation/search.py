"""The search: from prepared logs to a solution that passes the gate, or the best reason why none does.

Features give starts, starts are placed on the data, placed starts are solved; the gate decides. Logs with
few cycles, and logs that slide at the first answer, join after it. No start of the user is needed; one that is
given is one more start, never the only one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.base.progress import Progress, to_nobody
from identify.estimation.attempt import FIRST, Attempt, Clock, crept, solve_from, solve_held, solve_or_hold
from identify.estimation.events import with_events_mended
from identify.estimation.gate import PER_CYCLE
from identify.estimation.joining import from_some, join
from identify.estimation.ranking import ranked
from identify.estimation.starts import Sources, drawn_starts, starts_of, suggested_starts
from identify.logs.prepare import Prepared, settled_part
from identify.logs.unknowns import Unknowns
from identify.shooting.levels import level_starts
from identify.shooting.trust import Trust

Array = NDArray[np.float64]
_Stage = Callable[[list[Prepared], list[int], Unknowns, Clock], Attempt | None]

LEAST = (1, 3)  # cycles a log must show to take part in the start; where the short logs mislead it, they come after
SLIPS = 2  # of a log that is not left out before it was looked at together with all others
ATTEMPTS = 4  # starts that are solved before giving up
DRAWN = 2  # starts by lot that are solved where all others were lost
SHORT = 2  # of these that were lost, and are solved again in short passes
FEW = 0.1  # of all cycles: so few that misfit have something of their own
HOPELESS = 8.0  # cost per residual of a start that no solve will save


def search(
    prepared: list[Prepared],
    unknowns: Unknowns,
    *,
    sources: Sources = "data",
    seed: int = 0,
    clock: Clock | None = None,
    progress: Progress | None = None,
    thorough: bool = True,
    last: bool = False,
) -> tuple[Attempt | None, dict[int, str]]:
    """Find the solution of all logs together.

    Args:
        thorough: False takes the data's own start alone, and none where that does not fit one cycle. last: no other
            search comes after this one, so that what nothing else fits is tried from whatever the data suggest.
        sources: starts from the data, from the user's values (unknowns.start), or both.

    Returns:
        the accepted attempt, else the one that came closest, None where nothing could be tried; and per index of a
        log that took no part, why.
    """
    clock = clock or Clock()
    told = progress or to_nobody
    left_out = {i: log.left_out for i, log in enumerate(prepared) if log.left_out is not None}
    able = [i for i in range(len(prepared)) if i not in left_out]
    if not able:
        return None, left_out
    cycling = [[i for i in able if prepared[i].typical >= least] for least in LEAST]
    faint = {i for i in able if prepared[i].manner.faint}
    choices = [[i for i in cycling[0] if i not in faint], *cycling, able]
    slips = {i for i in able if prepared[i].falls.size >= SLIPS}
    way = _Way(sources, seed, thorough, last, clock, told)
    best: Attempt | None = None
    for first in [some for n, some in enumerate(choices) if some and some not in choices[:n]]:
        best = _better(best, _from_logs(prepared, first, able, unknowns, way))
        if _fits(best) and faint | slips <= set(best.logs):
            break
    if not _fits(best):
        best = _levels_only(prepared, able, unknowns, clock) or best
    return best, left_out | _missing(best, prepared, able)


def _levels_only(prepared: list[Prepared], able: list[int], unknowns: Unknowns, clock: Clock) -> Attempt | None:
    """What logs hold that slide in the end, where the way there is not described: their level; None where that does not
    fit either, or some log is more than one course to sliding."""
    parts = [settled_part(prepared[i]) for i in able]
    if any(part is None or len(prepared[i].pieces) > 1 for part, i in zip(parts, able, strict=True)):
        return None
    having = list(prepared)
    for i, part in zip(able, parts, strict=True):
        having[i] = part or prepared[i]
    theta = level_starts([having[i] for i in able], unknowns)[0]
    found = solve_from(having, able, replace(unknowns, start=theta), clock)
    return found if _fits(found) else None


@dataclass(frozen=True)
class _Way:
    """How to search, as `search` was asked."""

    sources: Sources
    seed: int
    thorough: bool
    last: bool
    clock: Clock
    told: Progress


def _from_logs(
    prepared: list[Prepared], first: list[int], able: list[int], unknowns: Unknowns, way: _Way
) -> Attempt | None:
    """The search that starts from the features of these logs; the others that are able join at its answer."""
    clock, told = way.clock, way.told
    best: Attempt | None = None
    told("finding a start", 0.1)
    ahead: list[Array] = []
    if any(prepared[i].pieces for i in first):
        # What repeats within a course is solved piece by piece first; the course is followed from there.
        pieces = [piece for i in first for piece in (prepared[i].pieces or (prepared[i],))]
        known, _ = search(pieces, unknowns, sources=way.sources, seed=way.seed, clock=clock, thorough=way.thorough)
        ahead = [] if known is None else [known.solved.theta]
    # Where cycles differ among themselves no start of a model of equal cycles will fit: one try shows how badly.
    uneven = not alike([prepared[i] for i in first])
    unequal = not way.thorough or uneven
    solved, wandered = 0, list[Array]()
    worst = np.inf if way.thorough else HOPELESS
    starts = starts_of([prepared[i] for i in first], unknowns, way.sources, way.seed, uneven, worst, clock)
    for theta in chain(ahead, starts):
        if solved == (1 if unequal else ATTEMPTS):
            break
        told(f"solving from start {solved + 1}", 0.3 + 0.1 * solved)
        attempt = _attempted(prepared, first, able, replace(unknowns, start=theta), unequal, way)
        solved += attempt is not None
        best = _better(best, attempt)
        if attempt is not None and not attempt.solved.solution.success:
            wandered.append(theta)
        # What passes as noise with a memory may yet be a misfit that another start has not.
        if _fits(best) and best.gate.level == 1.0 and set(first) <= set(best.logs):
            break
    if not unequal and not _fits(best):
        all_lost = len(wandered) == solved > 0
        best = _by_other_means(best, wandered, prepared, first, able, unknowns, way, all_lost)
    return None if best is None else disowned(best, prepared, first)


def _fits(best: Attempt | None) -> TypeGuard[Attempt]:
    return best is not None and best.gate.status is Status.CONVERGED


def _by_other_means(
    best: Attempt | None,
    wandered: list[Array],
    prepared: list[Prepared],
    first: list[int],
    able: list[int],
    unknowns: Unknowns,
    way: _Way,
    all_lost: bool,
) -> Attempt | None:
    """What is found where no start of the features leads to an answer; the best of before where nothing is.

    Args:
        wandered: the starts from which the solver did not come back; all_lost: there were no others.
    """
    clock, told = way.clock, way.told
    logs = [prepared[i] for i in first]
    if all_lost and way.sources != "user":
        # Features can be described where no motion is, and all the starts lie there.
        for theta in islice(drawn_starts(logs, unknowns, way.seed, wandered, clock), DRAWN):
            told("solving from a start by lot", 0.65)
            best = _better(best, _attempted(prepared, first, able, replace(unknowns, start=theta), False, way))
            if _fits(best):
                return best
    stages: list[tuple[_Stage, str, Iterable[Array]]] = [
        (_in_short_passes, "going in short passes", wandered[:SHORT]),
        (solve_held, "holding what the logs do not tell", wandered[:ATTEMPTS]),
    ]
    if way.last and way.sources != "user":
        stages.append((solve_or_hold, "solving from what the levels suggest", _suggested(logs, unknowns)))
    for stage, say, starts in stages:
        told(say, 0.7)
        best = _better(best, _again_from(stage, starts, prepared, first, able, unknowns, clock))
        if _fits(best):
            break
    return best


def _suggested(logs: list[Prepared], unknowns: Unknowns) -> Iterator[Array]:
    """What the levels of the data suggest, as it stands: where friction drifts, or ages on and on, a settled cycle,
    which is what the features are, leads astray."""
    yield from (start.theta for start in ranked(logs, unknowns, suggested_starts(logs, unknowns)))


def _attempted(
    prepared: list[Prepared], first: list[int], able: list[int], unknowns: Unknowns, unequal: bool, way: _Way
) -> Attempt | None:
    """What comes of one start (unknowns.start): solved as it is, with other slips, by way of the logs it fits, with
    what the logs do not tell held; then with the other logs that are able. None where it can be placed on none.

    Args:
        unequal: cycles differ, or one quick try is all: as it is, or not at all.
    """
    clock, told = way.clock, way.told
    attempt = solve_from(prepared, first, unknowns, clock)
    if attempt is None:
        return None
    having = prepared
    if attempt.gate.status is not Status.CONVERGED and not unequal:
        mended = _mended(prepared, attempt, unknowns)
        if mended is not None:
            told("solving with other slips", 0.6)
            again = solve_from(mended, first, unknowns, clock)
            if again is not None and _better(attempt, again) is again:
                having, attempt = mended, again
        if attempt.gate.status is not Status.CONVERGED:
            told("following what misfits", 0.63)
            attempt = _followed(having, attempt, unknowns, clock)
        if attempt.gate.status is not Status.CONVERGED:
            told("solving the logs that fit first", 0.65)
            attempt = from_some(prepared, first, able, unknowns, clock) or attempt
    if crept(attempt):
        told("holding what the logs do not tell", 0.7)
        attempt = solve_held(having, first, unknowns, clock, FIRST) or attempt
    if attempt.gate.status is Status.CONVERGED:
        told("joining the other logs", 0.8)
        attempt = join(attempt, having, [i for i in able if i not in attempt.logs], unknowns, clock)
    return attempt


def _followed(prepared: list[Prepared], attempt: Attempt, unknowns: Unknowns, clock: Clock) -> Attempt:
    """The attempt; or what is solved from it where logs in which a few of many cycles misfit are followed as courses,
    if that fits: how often those come to rest may be another than was seen, the first slips above all, which find an
    older contact than all others."""
    gate = attempt.gate
    misfit = np.abs(gate.z) > PER_CYCLE
    if not 0 < np.count_nonzero(misfit) <= FEW * misfit.size:
        return attempt
    doubted = {attempt.logs[place] for place in (gate.log[misfit] - 1).tolist()}
    doubted = {i for i in doubted if prepared[i].manner.name == "cycles"}
    if not doubted:
        return attempt
    having = [log.as_course if i in doubted else log for i, log in enumerate(prepared)]
    found = solve_from(having, list(attempt.logs), replace(unknowns, start=attempt.solved.theta), clock)
    return found if _fits(found) and set(found.logs) == set(attempt.logs) else attempt


def _again_from(
    stage: _Stage,
    starts: Iterable[Array],
    prepared: list[Prepared],
    first: list[int],
    able: list[int],
    unknowns: Unknowns,
    clock: Clock,
) -> Attempt | None:
    """From the first of these starts from which another way of solving finds an answer, which the other logs join."""
    for theta in starts:
        found = stage(prepared, first, replace(unknowns, start=theta), clock)
        if _fits(found):
            return join(found, prepared, [i for i in able if i not in found.logs], unknowns, clock)
    return None


def _in_short_passes(prepared: list[Prepared], chosen: list[int], unknowns: Unknowns, clock: Clock) -> Attempt | None:
    """Solve from a start that may be far off in passes that go no farther than each is trusted."""
    return solve_from(prepared, chosen, unknowns, clock, trust=Trust())


def alike(prepared: Sequence[Prepared]) -> bool:
    """Whether the cycles of these logs resemble each other, so that more starts than one are worth a try."""
    return not any(log.unlike for log in prepared)


def plenty(prepared: Sequence[Prepared]) -> list[int]:
    """Numbers of the logs that an answer has to describe: they are not left out, and show enough cycles."""
    return [
        i for i, log in enumerate(prepared) if log.left_out is None and log.typical >= LEAST[1] and not log.manner.faint
    ]


def disowned(best: Attempt, prepared: Sequence[Prepared], needed: Sequence[int]) -> Attempt:
    """An answer that leaves out a log with plenty of cycles does not describe the data, well as it fits the rest.

    Args:
        needed: numbers of these logs.
    """
    missing = [prepared[i].name for i in needed if i not in best.logs]
    if not missing or best.gate.status is not Status.CONVERGED:
        return best
    message = (
        f"the answer of the other logs does not stick-slip as {', '.join(missing)} does: drive speed, stiffness or "
        "mass of that log are not as stated, or the others tell too little to lead to it: check these, give start "
        "values, or fit it alone"
    )
    return replace(best, gate=replace(best.gate, status=Status.MODEL_MISFIT, message=message))


def _missing(best: Attempt | None, prepared: list[Prepared], able: list[int]) -> dict[int, str]:
    """Why logs that could have taken part did not."""
    taken = best.logs if best is not None else ()
    why = "does not stick-slip, or not like this, at the answer of the other logs"
    if best is None:
        why = "is not reproduced by any start: the model slides steadily where it sticks"
    return {i: f"{prepared[i].name} {why}; it was left out" for i in able if i not in taken}


def _mended(prepared: list[Prepared], attempt: Attempt, unknowns: Unknowns) -> list[Prepared] | None:
    """The logs with slips that were missed put in and invented ones taken out; None where there are none."""
    gate = attempt.gate
    wrong = {int(log) - 1 for log, z in zip(gate.log.tolist(), gate.z.tolist(), strict=True) if not z < PER_CYCLE}
    out = list(prepared)
    for place_ in wrong:
        number = attempt.logs[place_]
        out[number] = with_events_mended(prepared[number], unknowns)
    return out if any(new is not old for new, old in zip(out, prepared, strict=True)) else None


def _better(best: Attempt | None, attempt: Attempt | None) -> Attempt | None:
    if attempt is None or best is None:
        return attempt if best is None else best

    def rank(a: Attempt) -> tuple[bool, int, float]:
        chi2 = a.gate.chi2_per_sample
        return a.gate.status is not Status.CONVERGED, -len(a.logs), abs(chi2 - 1.0) if np.isfinite(chi2) else np.inf

    return min(best, attempt, key=rank)
