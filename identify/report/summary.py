"""A fit in plain text of 79 columns: what the terminal prints, and what a fit shows of itself in Python."""

from __future__ import annotations

from collections.abc import Mapping

from identify.base.result import AccuracyResult, Result, ToleranceResult
from identify.base.wording import columns, wrapped
from identify.estimation.covariance import TOLERANCE_WORDS
from identify.report.report_tables import parameter_table
from identify.report.report_wording import NOT_FOR, distribution_lines, is_uneven


def summary(result: Result) -> str:
    """Status, parameters with intervals and verdicts, and the reasons of what is not identified."""
    head = wrapped(f"{result.status.replace('_', ' ')}: {result.message}")
    if not result.converged:
        return head
    left_out = [
        f"log {place} took no part: {log.reason_left_out}"
        for place, log in enumerate(result.logs, 1)
        if log.reason_left_out
    ]
    table = parameter_table(result.parameters, errors=not any(e.interval_rig_exact for e in result.parameters.values()))
    uneven, effects = [], []
    if is_uneven(result):
        lines = [list(line) for line in distribution_lines(result)]
        uneven = [columns([["", "median (95 % interval)", "nine of ten drawn cycles"], *lines]), ""] if lines else []
        uneven += [wrapped(NOT_FOR, "  "), ""]
    if result.effects.chosen == "auto":
        gone = [reason.effect for reason in result.effects.reasons if not reason.kept]
        effects = [
            wrapped(f"effects chosen: {', '.join(result.effects.names)}", "  "),
            wrapped(f"left out: {', '.join(gone) or 'none'}; why: see the report", "  "),
            "",
        ]
    last = [accuracy_text(result.accuracy), "what accuracy costs: see the report" if result.accuracy_table else ""]
    last += [
        f"{name.value}: {verdict.note}" if verdict.value not in ("identified", "fixed") and verdict.note else ""
        for name, *_, verdict in table.cells
    ]
    before = [wrapped(line, "  ") for line in left_out]
    meaning = [wrapped(line, "  ") for line in [tolerances_text(result.tolerances or {})] if line]
    after = [wrapped(line, "  ") for line in last if line]
    return "\n".join([head, *before, "", table.to_text(), *meaning, "", *uneven, *effects, *after])


def accuracy_text(accuracy: AccuracyResult | None) -> str:
    """What the accuracy of the fit cost and gives, what the other levels would, and what each effect took of it; ""
    where that is not known."""
    if accuracy is None:
        return ""
    texts = {}
    for level in accuracy.levels:
        error = level.error_in_standard_errors
        left = "an unknown error" if error is None else f"{error:.2g} standard errors"
        about, unit = ("", " of processor time") if level.accuracy == accuracy.taken else ("about ", "")
        texts[level.accuracy] = f"{about}{level.seconds:.2g} s{unit}, steps leave {left}"
    taken = texts.pop(accuracy.taken)
    others = "; ".join(f"{name}: {text}" for name, text in texts.items())
    dearest = sorted(accuracy.effects_s.items(), key=lambda item: -item[1])
    effects = ", ".join(f"{name} {seconds:.2g} s" for name, seconds in dearest)
    equations = f". The equations of the model took {accuracy.equations_s:.2g} s of it: {effects}" if dearest else ""
    return f"accuracy {accuracy.taken}: {taken}. Estimated, {others}{equations}"


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
