"""fit: from a scene and its logs to a finished identification."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.asked import NOTHING_MORE, Asked
from identify.diagnosis.findings import Findings
from identify.diagnosis.held import Held, against_data
from identify.diagnosis.second_look import looked_into
from identify.effect_choice.choice import Choice
from identify.effect_choice.fitted import as_it_ended, described
from identify.effect_choice.selection import choose_from_data
from identify.effect_choice.worth import worth, worth_document
from identify.effects import ALL
from identify.errors import FitError
from identify.examination.allowed import slowness
from identify.examination.certainty import Certainty, certainty
from identify.first_guess.vibration import tuned
from identify.next_log.choosing import next_logs
from identify.next_log.words import advised
from identify.next_log.words import document as next_log_document
from identify.numerics.heap import keep_freed_memory
from identify.outcome import Fit, LogCurves, Status
from identify.preparation.drives import with_drives
from identify.preparation.loads import calmed
from identify.preparation.parting import parted
from identify.preparation.prepare import Prepared, prepare
from identify.preparation.scene_records import with_records
from identify.preparation.unknowns import Unknowns, from_scene, stated_rig, user_start
from identify.result.reconstruct import detected_curves, fitted_curves, refused_curves
from identify.result.result import document
from identify.scene import Scene
from identify.search.attempt import Attempt, Clock, solve_from
from identify.search.grouped import search_grouped
from identify.search.search import disowned, plenty
from identify.search.shaken import shaken
from identify.search.starts import Sources
from identify.search.status_words import at_bounds, ended, underivable, untried
from identify.telling import Progress, to_nobody
from identify.uncertainty.hints import what_is_held

Array = NDArray[np.float64]
_Searched = tuple[list[Prepared], Attempt | None, dict[int, str]]  # logs, the answer, why logs were left out

ANSWERS = 3  # of one model, each better than the one before, that are looked into


def fit(
    scene: Scene,
    records: Sequence[Record] | None = None,
    *,
    progress: Progress | None = None,
    starts: Sources | None = None,
    seed: int = 0,
    asked: Asked = NOTHING_MORE,
) -> Fit:
    """Identify the parameters of a scene from all its logs together.

    Args:
        scene: rig, effects, parameters and logs.
        records: the scene's logs in their order; None reads them.
        progress: called as progress(stage, share of the whole).
        starts: where the search starts: "data", "user" (the scene's `start` values), "both"; default both where the
            scene gives a start, else the data.
        seed: of the random starts, where the data's own do not fit or the data hardly tell some parameter, and of the
            bootstrap.
        asked: how finely, and which further looks at how sure the answer is.

    Raises:
        FitError, SceneError, LogError: what cannot be set up, one sentence. A fit that does not succeed is no error:
            its status says so.
    """
    clock, began = Clock(), time.perf_counter()
    told = progress or to_nobody
    choice: Choice | None = None
    scene, drives = with_drives(scene, records)
    if scene.effects == "auto":
        scene, records = with_records(scene, records)
        since = time.perf_counter()
        choice = choose_from_data(scene, records, told)
        scene = scene.with_effects(choice.effects)
        clock.add("choose", since)
    starts = starts or _default_starts(scene)
    prepared, findings = find(scene, records, clock=clock, progress=told, starts=starts, seed=seed, asked=asked)
    advice = None
    if findings.status is Status.CONVERGED:
        told("the log that would tell more", 0.95)
        advice = next_logs(findings)
        findings = findings if advice is None else advised(findings, advice)
    told("stability and amplitude", 0.95)
    curves = _curves(prepared, findings.unknowns, findings.attempt)
    result = document(scene, prepared, findings, clock, began, seed, choice)
    if asked.effects_table and findings.status is Status.CONVERGED and findings.attempt is not None:
        told("effects compared", 0.95)
        whole = len(prepared) == len(scene.logs)
        read = records or ([log.record for log in prepared] if whole else with_records(scene, None)[1])
        result["effects_table"] = worth_document(
            worth(scene, read, prepared, findings.unknowns, findings.attempt, told)
        )
    result["next_logs"] = next_log_document(advice)
    if drives:
        result["notes"] = [*drives, *result["notes"]]
    result["provenance"] |= {"starts": starts, "asked": asked.document()}
    return Fit(result, curves)


def find(
    scene: Scene,
    records: Sequence[Record] | None = None,
    *,
    clock: Clock,
    progress: Progress,
    starts: Sources | None = None,
    seed: int = 0,
    asked: Asked = NOTHING_MORE,
) -> tuple[list[Prepared], Findings]:
    """The identification without report and outlook; arguments and errors as `fit`."""
    began = time.perf_counter()
    keep_freed_memory()
    if scene.model.balance is not None:
        raise FitError(
            "the effect inertia is off: a fit follows slips, which have no duration without a mass; "
            "add inertia to effects and give the mass under [rig]"
        )
    values = scene.values()
    for effect in ALL:
        if effect.name in scene.effects and (refusal := effect.unfit(values)) is not None:
            raise FitError(refusal)
    unknowns = from_scene(scene)
    if not np.any(unknowns.free):
        raise FitError(
            "[parameters] fixes or ties every parameter, so that nothing is left to fit; expected one that is free: "
            "give one of them a start instead of fixed, or look at what these values do: stickslip fit --preview"
        )
    progress("reading the logs", 0.0)
    scene, read = parted(*with_records(scene, records))
    since = clock.add("read", began)
    progress("detecting cycles", 0.05)
    prepared = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, read, strict=True)]
    prepared, unknowns = tuned(prepared, unknowns)
    clock.add("detect", since)
    sources = starts or _default_starts(scene)

    def searched(logs: list[Prepared], last: bool) -> _Searched:
        found = search_grouped(logs, unknowns, sources=sources, seed=seed, clock=clock, progress=progress, last=last)
        return logs, *found

    prepared, attempt, left_out = _by_way_of_calm(prepared, unknowns, searched, clock)
    if attempt is not None and unknowns.model.vibrates:
        progress("solving from other starts", 0.85)
        since = time.perf_counter()
        attempt = shaken(attempt, prepared, unknowns, seed)
        clock.add("solve", since)
    since = time.perf_counter()
    progress("intervals", 0.9)
    for _ in range(ANSWERS):
        findings = _findings(scene, prepared, unknowns, attempt, left_out, progress, asked, seed)
        findings, better = looked_into(findings, scene, read, prepared, progress)
        if better is None:
            break
        attempt = disowned(better, prepared, plenty(prepared))
        left_out = {i: why for i, why in left_out.items() if i not in attempt.logs}
    clock.add("intervals", since)
    return prepared, findings


def _default_starts(scene: Scene) -> Sources:
    """Where a search starts if nobody says."""
    return "both" if user_start(scene) else "data"


def _by_way_of_calm(
    prepared: list[Prepared], unknowns: Unknowns, searched: Callable[[list[Prepared], bool], _Searched], clock: Clock
) -> _Searched:
    """What a search finds; where loads tremble it goes by way of calm ones, whose answer is easily found, and follows
    the tremor from there. What no motion follows counts as unknown."""
    calm = [replace(log, data=calmed(log.data)) for log in prepared]
    if all(quiet.data is log.data for quiet, log in zip(calm, prepared, strict=True)):
        return searched(prepared, True)
    logs, known, left_out = searched(calm, False)
    if known is None or known.gate.status is not Status.CONVERGED:
        found = searched(prepared, True)
        converged = found[1] is not None and found[1].gate.status is Status.CONVERGED
        return found if converged or known is None else (logs, known, left_out)
    followed = solve_from(prepared, list(known.logs), replace(unknowns, start=known.solved.theta), clock)
    if followed is None or followed.gate.status is not Status.CONVERGED:
        return logs, known, left_out
    return prepared, followed, left_out


def _findings(
    scene: Scene,
    prepared: list[Prepared],
    unknowns: Unknowns,
    attempt: Attempt | None,
    left_out: dict[int, str],
    progress: Progress,
    asked: Asked,
    seed: int,
) -> Findings:
    """Status, estimates and what else the result document is made of."""
    if attempt is None:
        status, message = untried(prepared, left_out)
        return Findings(status, message, unknowns, None, None, None, [], left_out, {})
    if not np.all(np.isfinite(attempt.solved.theta)):
        status, message = ended(attempt, {})
        return Findings(status, message, unknowns, attempt, None, None, [], left_out, {})
    base = unknowns.base(stated_rig(scene))
    sure = certainty(
        attempt,
        unknowns,
        base,
        asked,
        lambda theta: at_bounds(unknowns, theta),
        speed_tolerance=scene.rig.tolerances.get("drive_speed", 0.0),
        seed=seed,
        progress=progress,
    )
    if sure is None:
        return Findings(
            Status.SOLVER_FAILED,
            underivable(attempt),
            unknowns,
            attempt,
            None,
            None,
            [],
            left_out,
            {},
        )
    attempt = sure.attempt
    theta = attempt.solved.theta
    bounds: dict[str, str] = {}
    for at in (theta, *(guess.theta(theta) for guess in attempt.solved.guesses)):
        bounds = at_bounds(unknowns, at) | bounds
    status, message = ended(attempt, bounds)
    if status is Status.CONVERGED:
        message = what_is_held(attempt.prepared, attempt.solved.guesses, sure.colours) or message
    return Findings(
        status,
        message,
        unknowns,
        attempt,
        sure.information,
        sure.covariance,
        sure.estimates,
        left_out,
        {} if sure.profiles is None else dict(sure.profiles.ends),
        sure.discretisation,
        sure,
        _held(scene, sure) if described(as_it_ended(scene, unknowns, prepared, attempt)) else [],
    )


def _held(scene: Scene, sure: Certainty) -> list[Held]:
    """The rig as stated, against the data."""
    memory = slowness(sure.attempt, sure.colours)
    theta = sure.attempt.solved.theta
    return against_data(sure.information, theta, stated_rig(scene), memory, tolerances=scene.rig.tolerances)


def _curves(prepared: list[Prepared], unknowns: Unknowns, attempt: Attempt | None) -> tuple[LogCurves, ...]:
    curves = [detected_curves(log) for log in prepared]
    if attempt is None:
        return tuple(curves)
    solved = attempt.solved
    fitted = solved.fitted
    for place, number in enumerate(attempt.logs):
        z = attempt.gate.z[attempt.gate.log == place + 1]
        curves[number] = fitted_curves(
            attempt.prepared[place], unknowns, solved.theta, solved.guesses[place], fitted[place], z
        )
        if attempt.gate.status is not Status.CONVERGED:
            curves[number] = refused_curves(prepared[number], curves[number])
    return tuple(curves)
