"""A log that does not agree with the others: without it they fit, it fits alone, and all together do not.

Logs that fit together are held against each other at their answer (`estimation/agreement.py`); where they do not fit
there is none. A log in which something else is wrong, a slip that was missed say, does not fit alone either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from data_io import Record
from identify.base.errors import FitError, SceneError
from identify.diagnosis.fitted import Fitted, described
from identify.diagnosis.nested import fit_from_values, fit_model
from identify.estimation.attempt import Attempt, usable
from identify.estimation.goodness_of_fit import PER_CYCLE
from identify.estimation.starts import ranked
from identify.estimation.strategies import Strategy, as_one_trial, may_run
from identify.logs.parting import name_of_recording, recordings
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.scene import Scene
from identify.simulation.drive import Drive

# ----------------------------------------------------------------------------------------------------------------------
# What explains a misfit.
# ----------------------------------------------------------------------------------------------------------------------

ANOTHER_ANSWER = "another answer of the same model"


@dataclass(frozen=True)
class Cause:
    """What alone explains a misfit: a sentence; better: an answer of the model as it is stated that lies nearer to the
    data, met on the way: the misfit was at least in part the search's own."""

    sentence: str
    better: Attempt | None = None


# ----------------------------------------------------------------------------------------------------------------------
# Which of its logs a fit describes worst.
# ----------------------------------------------------------------------------------------------------------------------


def misfits_of_logs(fitted: Fitted) -> list[float]:
    """By how many standard deviations the cycles of each log misfit in the middle of them; infinite where it took no
    part. One cycle with a slip that was missed does not count in it."""
    out = [np.inf] * len(fitted.prepared)
    if fitted.attempt is not None:
        gate = fitted.attempt.gate
        for place, number in enumerate(fitted.attempt.log_numbers, 1):
            told = gate.z[gate.log == place]
            out[number] = float(np.median(told)) if told.size else np.inf
    return out


OTHERS = 2  # logs that have to be left: one is described by many answers
TELLING = 5  # cycles of a log that mean something if they fit alone
TRIED = 4  # logs that are left out, each once
SAME_SPEED = 0.2  # relative difference of drive speeds at which friction is about the same
FAR = 2.0  # times the noise variance: nearer the answer of the others is for any log that took no part in it


def disagreement(scene: Scene, records: Sequence[Record], ended: Fitted) -> Cause | None:
    """Which log does not agree with the others; None where none does, or the logs do not say which.

    Args:
        ended: where the fit of all logs ended, which does not describe them.
    """
    able, misfits = set(usable(list(ended.prepared))), misfits_of_logs(ended)
    logs = [[i for i in some if i in able] for some in recordings(scene)]
    logs = sorted((some for some in logs if some), key=lambda some: -max(misfits[i] for i in some))
    if len(logs) <= OTHERS:
        return None
    asked = [some for some in logs if max(misfits[i] for i in some) > PER_CYCLE and _tells(ended, some)][:TRIED]
    named = list[tuple[Sequence[int], float]]()
    for some in asked:
        if not may_run(Strategy.ONE_LOG_OUT):
            break
        rest = sorted(i for other in logs if other is not some for i in other)
        with as_one_trial(Strategy.ONE_LOG_OUT, name_of_recording(scene, some)):
            others = _fit(scene, records, rest)
            if others is None or _fit(scene, records, some) is None:
                continue
            back = fit_from_values(others, scene, records)
        if back.complete and described(back):
            return Cause(ANOTHER_ANSWER, back.attempt)
        off = _off(back, others, some)
        if off > FAR:
            named.append((some, off))
    if not named or len(named) == len(logs):
        return None
    sentence = _sentence([(name_of_recording(scene, some), off) for some, off in named])
    return Cause(f"{sentence}{_law(scene, named, logs)}")


def _law(scene: Scene, named: Sequence[tuple[Sequence[int], float]], logs: Sequence[Sequence[int]]) -> str:
    """What else than a log may be wrong: what friction does at its speeds, where no other log has them; "" where one
    does."""
    apart = [i for some, _ in named for i in some]
    known = [v for some in logs for i in some if i not in apart for v in _speeds(scene, i)]
    if all(any(abs(v - u) <= SAME_SPEED * abs(u) for u in known) for i in apart for v in _speeds(scene, i)):
        return ""
    return (
        "; or friction follows another law than the effects say, which a second log of the same pair at its speed "
        "would tell"
    )


def _speeds(scene: Scene, number: int) -> tuple[float, ...]:
    """The drive speeds of a log [m/s]."""
    said = scene.logs[number].drive_speed
    return Drive.of(scene.rig.drive_speed or 0.0 if said is None else said).speeds


def _tells(ended: Fitted, log: Sequence[int]) -> bool:
    return max(ended.prepared[i].typical for i in log) >= TELLING


def _fit(scene: Scene, records: Sequence[Record], some: Sequence[int]) -> Fitted | None:
    """The model on some of the logs alone; None where it does not describe them all."""
    try:
        part = replace(scene, logs=tuple(scene.logs[i] for i in some))
        fitted = fit_model(part, [records[i] for i in some], thorough=False)
    except (FitError, SceneError):
        return None
    return fitted if fitted.complete and described(fitted) else None


def _off(all_logs: Fitted, others: Fitted, log: Sequence[int]) -> float:
    """How badly the answer of the others describes a log, in noise variances; infinite where it has no such slips."""
    assert others.attempt is not None
    at_answer = replace(all_logs.unknowns, start=others.attempt.solved.theta)
    return max(_misfit(all_logs.prepared[i], at_answer) for i in log)


def _sentence(named: Sequence[tuple[str, float]]) -> str:
    names = " or ".join(name for name, _ in named)
    off = named[0][1]
    miss = f"misses it by {off:.3g} times the noise variance" if np.isfinite(off) else "has no such slips"
    return (
        f"{names} does not agree with the others: without it they fit within the noise, and their answer {miss}, while "
        "it fits alone; check whether it is of the same pair, its normal force, its drive speed and what else differs "
        "in it, or fit it apart"
    )


def _misfit(log: Prepared, unknowns: Unknowns) -> float:
    """Per sample, in noise variances, of the motion that follows from unknowns.start; infinite where there is none."""
    return next((2.0 * start.cost for start in ranked([log], unknowns, [unknowns.start])), np.inf)
