"""A fit in plain text of 79 columns: what the terminal prints, and what a fit shows of itself in Python."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from identify.base.result import AccuracyResult, LevelCost, Result, ToleranceResult
from identify.base.wording import columns, wrapped
from identify.estimation.covariance import TOLERANCE_WORDS
from identify.report.report_tables import parameter_table
from identify.report.report_wording import NOT_FOR, distribution_lines, is_uneven


def summary(result: Result) -> str:
    """Status, parameters with intervals and verdicts, and the reasons of what is not identified."""
    return "\n".join(_lines(result))


def _lines(result: Result) -> Iterator[str]:
    yield wrapped(f"{result.status.replace('_', ' ')}: {result.message}")
    if not result.converged:
        return
    for number, log in enumerate(result.logs, 1):
        if log.reason_left_out:
            yield wrapped(f"log {number} took no part: {log.reason_left_out}", "  ")
    yield ""
    table = parameter_table(result.parameters, errors=not any(e.interval_rig_exact for e in result.parameters.values()))
    yield table.to_text()
    if meaning := tolerances_text(result.tolerances or {}):
        yield wrapped(meaning, "  ")
    yield ""
    if is_uneven(result):
        if spreads := [list(line) for line in distribution_lines(result)]:
            yield columns([["", "median (95 % interval)", "nine of ten drawn cycles"], *spreads])
            yield ""
        yield wrapped(NOT_FOR, "  ")
        yield ""
    if result.effects.chosen == "auto":
        yield wrapped(f"effects chosen: {', '.join(result.effects.names)}", "  ")
        gone = [reason.effect for reason in result.effects.reasons if not reason.kept]
        yield wrapped(f"left out: {', '.join(gone) or 'none'}; why: see the report", "  ")
        yield ""
    if cost := accuracy_text(result.accuracy):
        yield wrapped(cost, "  ")
    if result.accuracy_table:
        yield wrapped("what accuracy costs: see the report", "  ")
    for name, *_, verdict in table.cells:
        if verdict.value not in ("identified", "fixed") and verdict.note:
            yield wrapped(f"{name.value}: {verdict.note}", "  ")


def accuracy_text(accuracy: AccuracyResult | None) -> str:
    """What the accuracy of the fit cost and gives, what the other levels would, and what each effect took of it; ""
    where that is not known."""
    if accuracy is None:
        return ""
    levels = {level.accuracy: level for level in accuracy.levels}

    def said(level: LevelCost, about: str) -> str:
        error = level.error_in_standard_errors
        left = "an unknown error" if error is None else f"{error:.2g} standard errors"
        return f"{about}{level.seconds:.2g} s{'' if about else ' of processor time'}, steps leave {left}"

    taken = levels.pop(accuracy.taken)
    others = "; ".join(f"{name}: {said(level, 'about ')}" for name, level in levels.items())
    dearest = sorted(accuracy.effects_s.items(), key=lambda item: -item[1])
    effects = f": {', '.join(f'{name} {seconds:.2g} s' for name, seconds in dearest)}" if dearest else ""
    equations = f". The equations of the model took {accuracy.equations_s:.2g} s of it{effects}" if dearest else ""
    return f"accuracy {accuracy.taken}: {said(taken, '')}. Estimated, {others}{equations}"


def tolerances_text(tolerances: Mapping[str, ToleranceResult]) -> str:
    """What the two intervals mean: "" where there is one only."""
    if not tolerances:
        return ""
    listed = [f"{TOLERANCE_WORDS.get(n, n).removeprefix('the ')} {100 * t.relative:g} %" for n, t in tolerances.items()]
    usual = "" if all(t.source == "scene" for t in tolerances.values()) else "usual "
    return (
        "The 95 % interval is the one to publish: it holds errors of rig and sensors "
        f"({usual}standard deviations: {', '.join(listed)}; [tolerances] in the scene changes them). "
        "Rig exact: noise alone, to compare runs on this rig"
    )
