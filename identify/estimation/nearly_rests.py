"""Answers of another sequence of modes that the data hardly tell from that of an answer.

Where the mass slides on by a hair, or just comes to rest, a motion with the one rest more or less may describe the data
as well, at other parameters. No walk leads across, and the curvature at the answer does not know of it: it tells what
the one sequence leaves open, which can be a tenth of what both together do.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from identify.base.outcome import Status
from identify.estimation.attempt import Attempt, solve_moved
from identify.estimation.other_optima import within
from identify.estimation.residual_autocorrelation import Remembering
from identify.estimation.sequence import by_a_hair
from identify.estimation.strategies import Strategy, attempted
from identify.logs.unknowns import Unknowns


def neighbours(attempt: Attempt, unknowns: Unknowns, noise: Remembering) -> list[Attempt]:
    """Answers of the very samples of an answer, with the motion next to its own, that lie in its joint region.

    Args:
        noise: of all logs: its memory widens that region.
    """
    at_answer = replace(unknowns, start=attempt.solved.theta)
    logs = attempt.prepared
    found: list[Attempt] = []
    for cut, guesses in by_a_hair(logs, logs, attempt.solved.guesses, at_answer):
        solve = partial(solve_moved, attempt, cut, guesses, at_answer)
        other = attempted(Strategy.NEIGHBOURING_MODES, solve, attempt, attempt.logs)
        if other is not None and other.gate.status is Status.CONVERGED and within(attempt, other, unknowns, noise):
            found.append(other)
    return found
