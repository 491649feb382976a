"""A second look at what a fit found: the cause of a misfit, and whether an answer that fits only looks right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from data_io import Record
from identify.base.budget import time_is_up
from identify.base.outcome import Status
from identify.base.progress import Progress
from identify.diagnosis.diagnosis import Doubt, diagnose, doubt, wrong_unit
from identify.diagnosis.findings import Findings
from identify.diagnosis.hum import hum
from identify.diagnosis.left_unsaid import left_unsaid
from identify.diagnosis.restraints import restraints, sitting
from identify.diagnosis.seen_before import look_swapped, seen_before
from identify.estimation.allowed import slowness
from identify.estimation.attempt import Attempt
from identify.estimation.certainty import unexamined
from identify.estimation.status_words import EXCHANGE
from identify.logs.prepare import Prepared
from identify.scene import Scene

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
        unit = wrong_unit(prepared, placed=findings.attempt is not None)
        if unit:
            return replace(findings, status=Status.MODEL_MISFIT, message=unit), None
        if any(log.unlike for log in prepared):
            return findings, None
        progress("looking for what is wrong", 0.95)
        cause = diagnose(scene, read, prepared, findings.unknowns, findings.attempt)
        if cause is not None:
            message = _caused(cause.sentence, findings.attempt)
            return replace(findings, status=Status.MODEL_MISFIT, message=message), cause.better
        also = f"{_unexplained(findings, scene)}{seen_before(prepared)}"
        findings = replace(findings, message=f"{findings.message}{also}")
    refused = findings.status is Status.MODEL_MISFIT and findings.attempt is not None  # well as its curve may fit
    doubtful = refused or _doubtful(findings)
    if not doubtful and not (_placed(findings) and restraints(scene, sitting(findings.unknowns, findings.attempt))):
        return findings, None
    progress("looking for what is wrong", 0.95)
    assert findings.attempt is not None
    told = [e.name for e in findings.estimates if e.verdict in ("identified", "weak")]
    memory = 1.0 if findings.sure is None else slowness(findings.attempt, findings.sure.colours)
    where = scene, read, prepared, findings.unknowns, findings.attempt
    found = doubt(*where, findings.held, told, memory, beyond=doubtful, anew=refused or _rises(findings))
    if found is None:
        return (_unexamined(findings) if doubtful and time_is_up() else findings), None
    return _doubted(findings, found), found.better


def _unexamined(findings: Findings) -> Findings:
    """An answer that the rig as stated speaks against, and that there was no time to look into."""
    if findings.status is not Status.CONVERGED or findings.attempt is None:
        return findings
    attempt = unexamined(findings.attempt)
    return replace(findings, attempt=attempt, status=attempt.gate.status, message=attempt.gate.message)


def _unexplained(findings: Findings, scene: Scene) -> str:
    """What else a misfit may come of that nothing explains; of a search that found no end nothing is said."""
    return "" if findings.status is Status.SOLVER_FAILED else f"{left_unsaid(scene)}{hum(findings.attempt)}"


def _placed(findings: Findings) -> bool:
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
