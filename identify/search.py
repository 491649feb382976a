"""The search: from prepared logs to a solution that passes the gate, or the best reason why none does.

Features give starts, starts are placed on the data, placed starts are solved; the gate decides. Logs with
few cycles, and logs that slide at the first answer, join after it. No start of the user is needed; one that is
given is one more start, never the only one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identify.events import with_events_mended
from identify.features import Features, extract
from identify.following import glide
from identify.gate import PER_CYCLE, Gate, pass_gate
from identify.guess import Guess
from identify.levels import level_starts
from identify.outcome import Status
from identify.passes import COARSE, Solved, solve_in_passes
from identify.placing import place
from identify.prepare import Prepared, cut_in_last_stick, settled_part
from identify.sequence import TRIES, followed, resequenced
from identify.shooting import transcribe
from identify.start import GOOD, Start, candidates, fit_features, random_starts
from identify.unknowns import Unknowns
from identify.vibration import quieted

Array = NDArray[np.float64]
Sources = Literal["data", "user", "both"]
Progress = Callable[[str, float | None], None]

LEAST = (1, 3)  # cycles a log must show to take part in the start; where the short logs mislead it, they come after
ATTEMPTS = 4  # starts that are solved before giving up
RANDOM = (48, 96)  # random starts, where the data's own do not fit the features
HOPELESS = 8.0  # cost per residual of a start that no solve will save
WORTH = 0.7  # of the cost before: what random starts must gain for more of them to be tried
UNEQUAL = 0.06  # scatter of the drop from cycle to cycle above which cycles are not alike
CREEPING = 0.2  # of the noise variance: a misfit that is no reason to look for another start
FIRM = (8.0, 3.0, 1.0)  # firmness of the priors that hold what the data do not tell
SAME = 0.02  # of the spread: starts closer than that are one


@dataclass(frozen=True)
class Attempt:
    """A solved start: which logs took part (indices), prepared and cut, the solution and its gate."""

    logs: tuple[int, ...]
    prepared: tuple[Prepared, ...]
    solved: Solved
    gate: Gate


@dataclass
class Clock:
    """Seconds spent per stage."""

    seconds: dict[str, float] = field(default_factory=dict)

    def add(self, stage: str, since: float) -> float:
        """Count the time since `since` to a stage; returns now."""
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - since
        return now


def search(
    prepared: list[Prepared],
    unknowns: Unknowns,
    *,
    sources: Sources = "data",
    seed: int = 0,
    clock: Clock | None = None,
    progress: Progress | None = None,
    thorough: bool = True,
) -> tuple[Attempt | None, dict[int, str]]:
    """Find the solution of all logs together.

    Args:
        thorough: False takes the data's own start alone, and none where that does not fit one cycle.
        sources: starts from the data, from the user's values (unknowns.start), or both.

    Returns:
        the accepted attempt, else the one that came closest, None where nothing could be tried; and per index of a
        log that took no part, why.
    """
    clock = clock or Clock()
    told: Progress = progress or (lambda _stage, _share: None)
    left_out = {i: log.left_out for i, log in enumerate(prepared) if log.left_out is not None}
    able = [i for i in range(len(prepared)) if i not in left_out]
    if not able:
        return None, left_out
    choices = [*([i for i in able if prepared[i].typical >= least] for least in LEAST), able]
    way = _Way(sources, seed, thorough, clock, told)
    best: Attempt | None = None
    for first in [some for n, some in enumerate(choices) if some and some not in choices[:n]]:
        best = _better(best, _from_logs(prepared, first, able, unknowns, way))
        if best is not None and best.gate.status is Status.CONVERGED:
            break
    if best is None or best.gate.status is not Status.CONVERGED:
        best = _levels_only(prepared, able, unknowns, clock) or best
    return best, left_out | _missing(best, prepared, able)


def solve_from(prepared: list[Prepared], unknowns: Unknowns) -> Attempt | None:
    """Place the start alone on the logs and solve from there, without a search; None where no log can be placed."""
    able = [i for i, log in enumerate(prepared) if log.left_out is None]
    return _solve(prepared, able, unknowns, Clock()) if able else None


def placed_from(prepared: list[Prepared], unknowns: Unknowns) -> list[Guess]:
    """The start alone placed on the logs, of those on which it can be."""
    able = [i for i, log in enumerate(prepared) if log.left_out is None]
    return [guess for *_, guess in _place(prepared, able, unknowns)]


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
    found = _solve(having, able, replace(unknowns, start=theta), clock)
    return found if found is not None and found.gate.status is Status.CONVERGED else None


@dataclass(frozen=True)
class _Way:
    """How to search, as `search` was asked."""

    sources: Sources
    seed: int
    thorough: bool
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
    unequal = not way.thorough or max(prepared[i].scatter for i in first) > UNEQUAL
    solved = 0
    worst = np.inf if way.thorough else HOPELESS
    starts = _starts([prepared[i] for i in first], unknowns, way.sources, way.seed, unequal, worst, clock)
    for theta in chain(ahead, starts):
        if solved == (1 if unequal else ATTEMPTS):
            break
        told(f"solving from start {solved + 1}", 0.3 + 0.1 * solved)
        attempt = _solve(prepared, first, replace(unknowns, start=theta), clock)
        solved += attempt is not None
        if attempt is not None and attempt.gate.status is not Status.CONVERGED and not unequal:
            mended = _mended(prepared, attempt, replace(unknowns, start=theta))
            if mended is not None:
                told("solving with other slips", 0.6)
                again = _solve(mended, first, replace(unknowns, start=theta), clock)
                if _better(attempt, again) is again and again is not None:
                    prepared, attempt = mended, again
        if attempt is not None and _crept(attempt):
            told("holding what the logs do not tell", 0.7)
            attempt = _held(prepared, first, replace(unknowns, start=theta), clock) or attempt
        if attempt is not None and attempt.gate.status is Status.CONVERGED:
            told("joining the other logs", 0.8)
            attempt = _join(attempt, prepared, [i for i in able if i not in attempt.logs], unknowns, clock)
        best = _better(best, attempt)
        if best is not None and best.gate.status is Status.CONVERGED and set(first) <= set(best.logs):
            break
    return None if best is None else _disowned(best, prepared, first)


def _disowned(best: Attempt, prepared: list[Prepared], first: list[int]) -> Attempt:
    """An answer that leaves out a log with plenty of cycles does not describe the data, well as it fits the rest."""
    missing = [prepared[i].name for i in first if i not in best.logs]
    if not missing or best.gate.status is not Status.CONVERGED:
        return best
    message = (
        f"the answer of the other logs does not stick-slip as {', '.join(missing)} does: check drive speed, "
        "stiffness and mass of that log, or fit it alone"
    )
    return replace(best, gate=replace(best.gate, status=Status.MODEL_MISFIT, message=message))


def _missing(best: Attempt | None, prepared: list[Prepared], able: list[int]) -> dict[int, str]:
    """Why logs that could have taken part did not."""
    taken = best.logs if best is not None else ()
    why = "does not stick-slip, or not like this, at the answer of the other logs"
    if best is None:
        why = "is not reproduced by any start: the model slides steadily where it sticks"
    return {i: f"{prepared[i].name} {why}; it was left out" for i in able if i not in taken}


def _starts(
    prepared: list[Prepared],
    unknowns: Unknowns,
    sources: Sources,
    seed: int,
    unequal: bool,
    worst: float,
    clock: Clock,
) -> Iterator[Array]:
    """Starts (n_p,) in the order in which they deserve a try, up to a `worst` cost per residual."""
    since = time.perf_counter()
    features: list[Features] = []
    bases: list[Array] = []
    for i, log in enumerate(prepared):
        found = extract(i, log.data, log.falls, log.rig.half_period) if log.manner.name == "cycles" else None
        if found is not None:
            features.append(found)
            bases.append(log.data.base)
    if not features:
        made = [level_starts(prepared, unknowns)] if sources != "user" else []
        tried = np.concatenate([unknowns.start[None, :], *made]) if sources != "data" else made[0]
        ranked = _ranked(prepared, unknowns, tried)
        clock.add("start", since)
        yield from _distinct(ranked, unknowns)
        return
    own = [unknowns.start[None, :]] if sources != "data" else []
    made = [candidates(unknowns, features, bases)] if sources != "user" else []
    tried = np.concatenate(own + made)
    settled = quieted(unknowns)
    starts = fit_features(settled, features, bases, tried)
    before = np.inf
    for count in RANDOM:
        if starts[0].cost < GOOD or unequal or starts[0].cost > WORTH * before:
            break
        before = starts[0].cost
        more = random_starts(unknowns, starts[0].theta, count, seed)
        if sources != "user":
            more = np.concatenate([more[: count // 2], random_starts(unknowns, tried[0], count // 2, seed + 1)])
        starts = sorted(starts + fit_features(settled, features, bases, more), key=lambda s: s.cost)
    clock.add("start", since)
    # What is explicit in time was held still; it starts where the sticks say.
    timed = settled.free != unknowns.free
    starts = [replace(s, theta=np.where(timed, unknowns.start, s.theta)) for s in starts if s.cost <= worst]
    yield from _distinct(starts, unknowns)


def _ranked(prepared: list[Prepared], unknowns: Unknowns, tried: Array) -> list[Start]:
    """Starts of logs without repeating cycles in the order of how well the motions that follow from them fit before any
    is solved; those that can be placed on fewer logs last."""
    out = []
    for theta in tried:
        at = replace(unknowns, start=theta)
        placed = _place(prepared, list(range(len(prepared))), at)
        if placed:
            logs = [log.data for _, log, _ in placed]
            problem = transcribe(logs, [guess for _, _, guess in placed], at, COARSE)
            cost = problem.evaluate(problem.start, derivatives=False).cost / max(problem.samples, 1)
            out.append(Start(theta, float(cost) + 1e6 * (len(prepared) - len(placed))))
    return sorted(out, key=lambda start: start.cost)


def _distinct(starts: list[Start], unknowns: Unknowns) -> Iterator[Array]:
    seen: list[Array] = []
    free = unknowns.free
    for start in starts:
        if all(np.max(np.abs(start.theta[free] - s[free]) / unknowns.spread[free], initial=0.0) > SAME for s in seen):
            seen.append(start.theta)
            yield start.theta


def _mended(prepared: list[Prepared], attempt: Attempt, unknowns: Unknowns) -> list[Prepared] | None:
    """The logs with slips that were missed put in and invented ones taken out; None where there are none."""
    gate = attempt.gate
    wrong = {int(log) - 1 for log, z in zip(gate.log.tolist(), gate.z.tolist(), strict=True) if not z < PER_CYCLE}
    out = list(prepared)
    for place_ in wrong:
        number = attempt.logs[place_]
        out[number] = with_events_mended(prepared[number], unknowns)
    return out if any(new is not old for new, old in zip(out, prepared, strict=True)) else None


def _crept(attempt: Attempt) -> bool:
    """Whether the curve fits, and the solver found no end to a ridge along which the data tell nothing."""
    gate = attempt.gate
    return gate.status is Status.SOLVER_FAILED and abs(gate.chi2_per_sample - 1.0) < CREEPING


def _held(prepared: list[Prepared], chosen: list[int], unknowns: Unknowns, clock: Clock) -> Attempt | None:
    """Solve from a start with priors around it that hold what the data do not tell, then let go of them as far as the
    solver follows; None where it follows nowhere. The information matrix never sees these priors."""
    best: Attempt | None = None
    for firmness in FIRM:
        if best is None:
            tried = _solve(prepared, chosen, unknowns, clock, firmness)
        else:
            tried = resolve(best, replace(unknowns.softened(firmness), start=best.solved.theta))
        if tried is None or tried.gate.status is not Status.CONVERGED:
            break
        best = tried
    return best


def _solve(
    prepared: list[Prepared], chosen: list[int], unknowns: Unknowns, clock: Clock, firmness: float = 1.0
) -> Attempt | None:
    """Place the start on the chosen logs and solve; None where no log can be placed."""
    since = time.perf_counter()
    placed = _place(prepared, chosen, unknowns)
    since = clock.add("place", since)
    if not placed:
        return None
    numbers, logs, guesses = (list(column) for column in zip(*placed, strict=True))
    # What every log has for itself, the first log has in the shared theta.
    unknowns = replace(unknowns, start=guesses[0].theta(unknowns.start))
    guesses[0] = replace(guesses[0], own=np.empty(0))
    solved = solve_in_passes([log.data for log in logs], guesses, unknowns.softened(firmness))
    for _ in range(TRIES):
        at_answer = replace(unknowns, start=solved.theta)
        again = resequenced([prepared[i] for i in numbers], logs, solved.guesses, at_answer)
        if again is None:
            break
        logs, guesses = again
        solved = solve_in_passes([log.data for log in logs], guesses, at_answer.softened(firmness))
    clock.add("solve", since + solved.forming)
    clock.seconds["build"] = clock.seconds.get("build", 0.0) + solved.forming
    gate = pass_gate(solved, [log.name for log in logs], [log.noise_estimated for log in logs])
    return Attempt(tuple(numbers), tuple(logs), solved, gate)


def resolve(attempt: Attempt, unknowns: Unknowns, *, steps: int = 0, most: int = 1000) -> Attempt:
    """Solve the logs of an attempt again from another theta (unknowns.start) and the motion found before, with at least
    and at most so many steps per interval."""
    logs, soft = attempt.prepared, unknowns.softened()
    solved = solve_in_passes([log.data for log in logs], attempt.solved.guesses, soft, steps=steps, most=most)
    gate = pass_gate(solved, [log.name for log in logs], [log.noise_estimated for log in logs])
    return replace(attempt, solved=solved, gate=gate)


def resolve_firmly(attempt: Attempt, unknowns: Unknowns, theta: Array, motion: list[Guess]) -> Attempt:
    """Solve again from theta (n_p,) and the motion there; where the solver finds no end to a ridge, with priors around
    theta that hold what the data do not tell, as loose as they can be."""
    attempt = replace(attempt, solved=replace(attempt.solved, guesses=motion))
    moved = resolve(attempt, replace(unknowns, start=theta))
    for firmness in FIRM[::-1]:
        if not _crept(moved):
            break
        tried = resolve(attempt, replace(unknowns, start=theta).softened(firmness))
        moved = tried if tried.gate.status is Status.CONVERGED else moved
    return moved


def _place(prepared: list[Prepared], chosen: list[int], unknowns: Unknowns) -> list[tuple[int, Prepared, Guess]]:
    """Number, cut log and guess of every chosen log that the start can be placed on."""
    out: list[tuple[int, Prepared, Guess]] = []
    for number in chosen:
        if prepared[number].manner.name != "cycles":
            out += [(number, *found) for found in _followed(prepared[number], unknowns)]
    chosen = [i for i in chosen if prepared[i].manner.name == "cycles"]
    logs = [prepared[i] for i in chosen]
    p = [unknowns.values(log.data.theta(unknowns.start), log.data.base) for log in logs]
    placement = place(unknowns.model, [log.data for log in logs], p, [log.falls for log in logs], COARSE)
    for number, log, guess in zip(chosen, logs, placement.guesses, strict=True):
        if guess is None or not _joins_up(guess, log):
            continue
        sticks = guess.onset - np.concatenate([[log.data.begin], guess.arrest[:-1]])
        typical = float(np.median(sticks[1:])) if sticks.size > 1 else float(sticks[0])
        cut = cut_in_last_stick(log, float(guess.arrest[-1]), typical)
        out.append((number, cut, guess))
    return sorted(out, key=lambda entry: entry[0])


def _followed(log: Prepared, unknowns: Unknowns) -> list[tuple[Prepared, Guess]]:
    """The log of a course of its own, or of sliding, cut to what the start follows of it; empty where it does not."""
    p = unknowns.values(log.data.theta(unknowns.start), log.data.base)
    if log.manner.name == "sliding":
        gliding = glide(unknowns.model, log.data, p)
        return [] if gliding is None else [(log, gliding)]
    found = followed(log, unknowns)
    return [] if found is None else [found]


def _joins_up(guess: Guess, log: Prepared) -> bool:
    """Whether every stick has a length, the last one too."""
    ends = np.append(guess.onset[1:], log.data.end)
    return bool(guess.onset[0] > log.data.begin and np.all(ends > guess.arrest))


def _better(best: Attempt | None, attempt: Attempt | None) -> Attempt | None:
    if attempt is None or best is None:
        return attempt if best is None else best

    def rank(a: Attempt) -> tuple[bool, int, float]:
        chi2 = a.gate.chi2_per_sample
        return a.gate.status is not Status.CONVERGED, -len(a.logs), abs(chi2 - 1.0) if np.isfinite(chi2) else np.inf

    return min(best, attempt, key=rank)


def _join(best: Attempt, prepared: list[Prepared], late: list[int], unknowns: Unknowns, clock: Clock) -> Attempt:
    """Solve again with the logs that took no part so far, where the answer can be placed on them."""
    at_answer = replace(unknowns, start=best.solved.theta)
    late = [i for i in late if _place(prepared, [i], at_answer)]
    if not late:
        return best
    joined = _solve(prepared, sorted([*best.logs, *late]), at_answer, clock)
    if joined is not None and joined.gate.status is Status.CONVERGED:
        return joined
    # One log that does not fit must not keep out the others; of a course that does not, its steady end may.
    for i in late:
        settled = settled_part(prepared[i])
        for log in (prepared[i], settled):
            if log is None or (len(late) == 1 and log is prepared[i]):
                continue
            having = [log if j == i else other for j, other in enumerate(prepared)]
            joined = _solve(having, sorted([*best.logs, i]), replace(unknowns, start=best.solved.theta), clock)
            if joined is not None and joined.gate.status is Status.CONVERGED:
                best, prepared = joined, having
                break
    return best
