"""A second look at what a fit found: the cause of a misfit, and whether an answer that fits only looks right."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from data_io import Record
from identify.base.budget import time_is_up
from identify.base.outcome import Status
from identify.base.progress import Progress
from identify.diagnosis.diagnosis import Doubt, diagnose, doubt
from identify.diagnosis.findings import Findings
from identify.diagnosis.hypotheses import restraints, sitting
from identify.effects import MAIN
from identify.estimation.attempt import Attempt
from identify.estimation.known_early import wrong_unit
from identify.estimation.status_words import EXCHANGE
from identify.estimation.strategies import cut_short, no_time_for
from identify.logs.prepare import Prepared
from identify.logs.spectrum import Spectrum
from identify.model.model import RIG_PARAMETERS
from identify.prediction.wording import listed
from identify.scene import Scene

# ----------------------------------------------------------------------------------------------------------------------
# What a misfit that nothing explains may come of, of what the scene leaves unsaid: groups that share what differs
# between them, and effects that are left out.
# ----------------------------------------------------------------------------------------------------------------------

NAMED = 3  # values of a label that are listed


def left_unsaid(scene: Scene) -> str:
    """What to try, to go behind a sentence on a misfit; "" where the scene leaves nothing unsaid."""
    return "".join(f"; or {each}" for each in (*_shared(scene), *_left_out(scene)))


def _shared(scene: Scene) -> Iterator[str]:
    """A sentence for each label by which logs differ, and parameters could."""
    shared = [
        name
        for name, spec in scene.parameters.items()
        if name not in RIG_PARAMETERS and (spec.per, spec.fixed, spec.tie) == (None, None, None)
    ]
    labels = dict.fromkeys(label for log in scene.logs for label in log.labels)
    for label in labels if shared else ():
        values = list(dict.fromkeys(log.labels.get(label, "") for log in scene.logs))
        if len(values) < 2 or "" in values:
            continue
        of = listed(values) if len(values) <= NAMED else f"{len(values)} values"
        yield (
            f"{listed(shared, 'or')} differs by {label} ({of}) and is shared: give it "
            f'one value each, [parameters] {shared[0]} = {{ per = "{label}" }}'
        )


def _left_out(scene: Scene) -> Iterator[str]:
    """A sentence where the scene leaves out effects that most contacts have."""
    missing = [name for name in MAIN if scene.effects != "auto" and name not in scene.effects]
    if missing:
        yield (
            f"the scene leaves out an effect that matters ({', '.join(missing)}): add it to effects, or see which the "
            'data ask for with effects = "auto"'
        )


# ----------------------------------------------------------------------------------------------------------------------
# What the look at the logs, before a fit, found wrong with them that may be why it misfits.
# ----------------------------------------------------------------------------------------------------------------------

# What spoils samples, or is no part of the model, by what it explains best first; codes of the quality gate.
SPOILS = (
    "friction_clipped",
    "sensor_lag",
    "spikes",
    "dropouts",
    "jitter",
    "repeated_time",
    "normal_clipped",
    "unloaded_rows",
    "load_ripple",
    "friction_drift",
)
TOLD = 2  # of them


def seen_before(prepared: Sequence[Prepared]) -> str:
    """What the quality gate warns of in logs that take part, to go behind a sentence on a misfit; "" where nothing
    that could explain it."""
    found: dict[str, str] = {}
    for log in prepared:
        for finding in log.judgement.findings if log.left_out is None else ():
            if finding.code in SPOILS and finding.severity != "info":
                found.setdefault(finding.code, f"{log.entry.path.name}: {finding.message}")
    told = [found[code] for code in SPOILS if code in found][:TOLD]
    return f"; before the fit this was seen: {'; '.join(told)}" if told else ""


def look_swapped(prepared: Sequence[Prepared]) -> str:
    """The names of the logs in which the forces look exchanged, where no other takes part; "" where one does."""
    others = [log for log in prepared if log.left_out is None and not log.judgement.swapped]
    names = dict.fromkeys(log.entry.path.name for log in prepared if log.judgement.swapped)
    return "" if others else ", ".join(names)


# ----------------------------------------------------------------------------------------------------------------------
# Whether what a misfit leaves of a log hums with the mains.
# ----------------------------------------------------------------------------------------------------------------------

MAINS = (50.0, 60.0, 100.0, 120.0, 150.0, 180.0)  # Hz, with what a rectifier makes of it
NEAR = 0.01  # relative distance from them, or one step of the spectrum
BY_CHANCE = 1e-9
SHARE = 0.1  # of the power of what is left


def hum(attempt: Attempt | None) -> str:
    """What of the logs hums, to go behind a sentence on a misfit; "" where nothing does."""
    if attempt is None:
        return ""
    solved = attempt.solved
    for log, prepared, curve in zip(solved.problem.logs, attempt.fitted_logs, solved.fitted, strict=True):
        swing = Spectrum.of(log.time, np.where(log.weight > 0.0, log.force - curve, np.nan))
        if swing is None or swing.chance > BY_CHANCE or swing.share(swing.peak) < SHARE:
            continue
        step = float(swing.frequency[1])
        if any(abs(swing.peak - mains) <= max(NEAR * mains, step) for mains in MAINS):
            height = 1e3 * swing.amplitude(swing.peak)
            return (
                f"; what is left of {prepared.name} swings {swing.peak:.3g} times a second by {height:.2g} mN, as hum "
                "of the mains does: shield or ground the sensor, or state a noise that holds it"
            )
    return ""


MISFITS = (Status.MODEL_MISFIT, Status.WRONG_EVENT_COUNT, Status.SOLVER_FAILED)  # of which the cause is looked for


def looked_into(
    findings: Findings, scene: Scene, read: Sequence[Record], prepared: Sequence[Prepared], progress: Progress
) -> tuple[Findings, Attempt | None]:
    """What a fit found, with the cause of a misfit where one is known, and refused where it only looks right; and a
    better answer of the same model that was met."""
    if findings.status in MISFITS:
        if swapped := look_swapped(prepared):
            message = f"normal force and friction force look swapped in {swapped}; {EXCHANGE}"
            return replace(findings, status=Status.MODEL_MISFIT, message=message), None
        if findings.attempt is None and (unit := wrong_unit(prepared, placed=False)):
            return replace(findings, status=Status.MODEL_MISFIT, message=unit), None
        if any(log.unlike for log in prepared):
            return replace(findings, message=f"{findings.message}{_possible_causes(findings)}"), None
        progress("looking for what is wrong", 0.95)
        cause = diagnose(scene, read, prepared, findings.unknowns, findings.attempt)
        if cause is not None:
            message = _caused(cause.sentence, findings.attempt)
            return replace(findings, status=Status.MODEL_MISFIT, message=message), cause.better
        also = f"{_unexplained(findings, scene)}{seen_before(prepared)}"
        findings = replace(findings, message=f"{findings.message}{also}")
    refused = findings.status is Status.MODEL_MISFIT and findings.attempt is not None  # well as its curve may fit
    doubtful = refused or _doubtful(findings)
    if not doubtful and not (_is_answer(findings) and restraints(scene, sitting(findings.unknowns, findings.attempt))):
        return findings, None
    progress("looking for what is wrong", 0.95)
    found = doubt(scene, read, prepared, findings, beyond=doubtful, anew=refused or _rises(findings))
    if found is None:
        if doubtful and time_is_up():
            no_time_for("whether another cause describes the logs as well")
        return findings, None
    return _doubted(findings, found), found.better


def _unexplained(findings: Findings, scene: Scene) -> str:
    """What a misfit may come of that nothing explains; of a search that found no end, or had no time for it, nothing is
    said: better values may leave no misfit."""
    if findings.status is Status.SOLVER_FAILED or cut_short():
        return hum(findings.attempt)
    return f"{_possible_causes(findings)}{left_unsaid(scene)}{hum(findings.attempt)}"


def _possible_causes(findings: Findings) -> str:
    """What the gate takes for possible causes of a misfit, to go behind its sentence; "" where the search was cut
    short."""
    gate = None if findings.attempt is None else findings.attempt.gate
    return "" if gate is None or not gate.possible_causes or cut_short() else f"; {gate.possible_causes}"


def _is_answer(findings: Findings) -> bool:
    """Whether the logs are described, with a parameter at a bound or none."""
    return findings.status in (Status.CONVERGED, Status.AT_BOUND) and findings.attempt is not None


def _doubtful(findings: Findings) -> bool:
    """Whether what fits is looked at again: the data contradict the rig as it was stated, or friction rises with the
    sliding speed, which is rare, and what a lagging sensor makes of friction that falls."""
    return any(held.contradicted for held in findings.held) or _rises(findings)


def _rises(findings: Findings) -> bool:
    change = next((e.value for e in findings.estimates if e.name == "delta_mu_k" and e.verdict != "fixed"), None)
    return change is not None and change > 0.0


def _doubted(findings: Findings, found: Doubt) -> Findings:
    """What else would describe data that fit already, in the sentence; an answer that it moves far is refused."""
    moves = f", the parameter {found.worst} moves by {100 * found.moved:.2g} %" if found.worst else ""
    more = f"the data ask for {found.sentence}: chi^2 falls by {found.gain:.3g}{moves}"
    if found.matters and findings.status is Status.CONVERGED:  # else logs contradict each other, say
        return replace(findings, status=Status.MODEL_MISFIT, message=f"the misfit is noise, and yet {more}")
    if found.whole and findings.status is Status.MODEL_MISFIT:  # then it is no log that is wrong
        return replace(findings, message=f"the misfit is noise, and yet {more}")
    return replace(findings, message=f"{findings.message}; {more}")


def _caused(cause: str, attempt: Attempt | None) -> str:
    """The sentence of a misfit whose cause is known."""
    by = "" if attempt is None else f" (misfit {attempt.gate.chi2_per_sample:.3g} times the noise variance)"
    return f"with the rig and the effects as stated the model does not describe these data{by}; {cause}"
