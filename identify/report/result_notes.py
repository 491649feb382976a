"""The notes of a result: what was assumed, what was left out, what the search changed, each in a sentence."""

from __future__ import annotations

from identify.base.outcome import Status
from identify.diagnosis.findings import Findings
from identify.logs.drive_doubts import DISAGREES
from identify.logs.prepare import Prepared
from identify.model.model import RIG_PARAMETERS
from identify.report.depth_document import noise_note, ridge_note
from identify.report.log_document import load_varies
from identify.scene import Scene

UNFOLLOWED = 0.02  # of a course: an end that is left out and worth a note


def notes_of(scene: Scene, prepared: list[Prepared], found: Findings) -> list[str]:
    """All notes on how the result came about, in the order a reader needs them."""
    notes = []
    guessed = [log.name for log in prepared if log.noise_estimated]
    if guessed:
        notes.append("The noise was estimated from straight lines through the stick phases, not given.")
    if found.sure is not None and found.status is Status.CONVERGED:
        said = (noise_note(found.sure), ridge_note(found.sure, found.unknowns))
        notes += [sentence for sentence in said if sentence]
    rig = (*RIG_PARAMETERS, "drive_speed")
    told = {e.name for e in found.estimates} if found.estimated is not None else set()
    exact = [name for name in rig if name not in {*scene.parameters, *scene.rig.tolerances, *told}]
    if exact and found.status is Status.CONVERGED:
        named = ", ".join(name.replace("_", " ") for name in exact)
        shown = "; the table of rig errors shows what 1 % would do" if found.estimated is None else ""
        notes.append(f"Taken as exact: {named}{shown}.")
    if found.status is Status.CONVERGED and "force_sensor" not in scene.effects:
        notes.append(
            "Zero and gain of both force sensors are taken as they are: what is off there moves the coefficients by as "
            "much (1 % of the force by 1 %), which a fit hardly sees; the interval with tolerances holds the gains. "
            "Check them with a known weight, or let the effect force_sensor estimate zero and gain of the friction "
            "force within priors."
        )
    doubts = [(log.entry.path.name, f.message) for log in prepared for f in log.record.findings if f.code == DISAGREES]
    notes += [f"{name}: {message}." for name, message in dict.fromkeys(doubts)]
    notes += [f"{log.name}: {load_varies(log)}." for log in prepared if log.hidden_swing]
    notes += _events(prepared, found)
    notes += [] if found.estimated is None else found.estimated.notes
    for index, reason in sorted(found.left_out.items()):
        notes.append(f"Log {index + 1} took no part in the fit: {reason}.")
    return notes


def _events(prepared: list[Prepared], found: Findings) -> list[str]:
    """Slips that the search put in or took out, and courses it could not follow to their end."""
    notes = []
    for number, log in zip(found.attempt.logs, found.attempt.prepared, strict=True) if found.attempt else ():
        before, after = prepared[number].falls, log.falls
        put = [f"{t:.4g} s" for t in after.tolist() if t not in before]
        out = [f"{t:.4g} s" for t in before.tolist() if t not in after]
        for word, times in (("that was missed put in", put), ("that is none taken out", out)):
            if times:
                notes.append(f"{log.name}: a slip {word} at {', '.join(times)}.")
        left = prepared[number].data.end - log.data.end
        if log.manner.name == "course" and left > UNFOLLOWED * (log.data.end - log.data.begin):
            notes.append(
                f"{log.name}: fitted up to {log.data.end:.4g} s; from there on the motion of the answer is none that a "
                "fit follows (a swing that never fades, or a mass that is pulled back)."
            )
        if log.manner.name == "sliding" and prepared[number].manner.name == "course":
            notes.append(
                f"{log.name}: only what slides steadily is fitted, from {log.data.begin:.4g} s on: the way there is "
                "not described."
            )
    return notes
