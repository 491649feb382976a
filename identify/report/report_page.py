"""report.html: one file that opens from disk, with figures inside and nothing from the network."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from markupsafe import Markup

from identify.base.document import Json, to_dict
from identify.base.result import CombinationsResult, Result
from identify.base.wording import quantity
from identify.report.answers import answer_table, of_record, said_once, sentences
from identify.report.depth import (
    accuracy_rows,
    advice_table,
    combination_table,
    comparison_table,
    direction_lines,
    interval_table,
)
from identify.report.first_screen import first_screen_views, templates
from identify.report.report_figures import Picture
from identify.report.report_tables import ReportCell, effects_table, held_table, sensitivity_table
from identify.report.report_views import log_views
from identify.report.report_wording import EFFECT_SIZES, EFFECTS_CHOSEN, TIMING_WORDS, with_group
from identify.report.style import inline_svg

if TYPE_CHECKING:
    from identify.report.finished import Fit


LARGEST = 3_000_000  # bytes of report.html
FOR_FIGURES = 2_300_000  # of which figures may take


def render_page(fit: Fit, drawn: Sequence[Picture]) -> str:
    """The text of report.html for the fit and its rendered figures; at most 3 MB."""
    environment = templates()
    result = fit.typed
    logs = log_views(result)
    heads = [
        (ReportCell(f"log {view.number}", dict(view.facts).get("drive speed", "")), log)
        for view, log in zip(logs, result.logs, strict=True)
    ]
    figures = inlined(drawn)
    told_of_pair = {
        key: {**({"label": with_group(key, entry.group)} if entry.group else {}), **to_dict(entry)}
        for key, entry in result.derived.items()
    }
    combinations = result.combinations or CombinationsResult()
    scene = result.scene
    return environment.get_template("page.html.j2").render(
        style=Markup(environment.get_template("style.css").render()),
        title=str(scene.get("name") or f"{len(logs)} log{'s' * (len(logs) != 1)}"),
        **first_screen_views(result),
        logs=logs,
        shared_labels=[label for label in logs[0].labels if all(label in log.labels for log in logs)] if logs else [],
        figures_of={view.number: [f for f in figures if f.log == view.number] for view in logs},
        overall_figures=[f for f in figures if f.log is None and f.name not in ("profile", "measured")],
        measured_figures=[f for f in figures if f.name == "measured"],
        depth_figures=[f for f in figures if f.name == "profile"],
        intervals=interval_table(result),
        combinations=combination_table(combinations),
        directions=direction_lines(combinations),
        accuracy=accuracy_rows(result.accuracy_table or ()),
        compared=comparison_table(result.effects_table or ()),
        derived=[
            table
            for table in (
                answer_table([(ReportCell("value"), told_of_pair)], "friction pair"),
                answer_table([(head, said_once(log.derived, told_of_pair)) for head, log in heads], "each log"),
                *(advice_table(head, log.derived) for head, log in heads),
            )
            if table is not None
        ],
        told=[
            (view, lines)
            for view, (_, log) in zip(logs, heads, strict=True)
            if (lines := sentences(log.derived, several=len(logs) > 1))
        ],
        effects=effects_table(result.effects.reasons),
        chosen=_chosen(result),
        quality=answer_table([(head, of_record(log.quality.figures)) for head, log in heads], ""),
        held=held_table(result.rig_against_data) if result.rig_against_data else None,
        sensitivity=sensitivity_table(result.rig_sensitivity) if result.rig_sensitivity else None,
        search=_search(result),
        timings=[
            (TIMING_WORDS.get(key, key.replace("_", " ")), quantity(seconds, "s", 3))
            for key, seconds in result.timing_s.items()
        ],
        provenance=_provenance(result.provenance),
        scene=_scene(result.provenance),
    )


def inlined(drawn: Sequence[Picture]) -> list[Picture]:
    """Every figure with its markup: SVG while there is room for all, the largest as PNG where there is not.

    Where even that is too much, the largest figures are left to the figures folder.
    """
    png = '<img alt="" src="data:image/png;base64,{}">'
    choices = [
        (inline_svg(picture.svg, picture.name), png.format(base64.b64encode(picture.png).decode("ascii")), "")
        for picture in drawn
    ]
    chosen = [0] * len(drawn)
    sizes = [[len(markup.encode()) for markup in choice] for choice in choices]
    while sum(sizes[i][chosen[i]] for i in range(len(drawn))) > FOR_FIGURES:
        step = min(chosen)
        largest = max((i for i in range(len(drawn)) if chosen[i] == step), key=lambda i: sizes[i][step])
        chosen[largest] += 1
    return [replace(picture, markup=Markup(choices[i][chosen[i]])) for i, picture in enumerate(drawn)]


def _chosen(result: Result) -> str:
    """Who chose the effects, and what their numbers are where there are any."""
    sizes = result.effects.chosen == "listed" and any(log.derived for log in result.logs)
    return f"{EFFECTS_CHOSEN.get(result.effects.chosen, '')}{f' {EFFECT_SIZES}' if sizes else ''}"


def _search(result: Result) -> str:
    """What led to the answer, and what else was tried, in one sentence; "" where nothing was searched."""
    led = list(dict.fromkeys(result.found_by))
    tried = list(dict.fromkeys(trial.strategy for trial in result.search))
    if not tried:
        return ""
    others = [name for name in tried if name not in led]
    found = f"Found by {', then '.join(led)}" if led else "No answer was found"
    rest = f"tried besides: {', '.join(others)}" if others else "nothing else was tried"
    late = ", ".join(result.not_tried)
    return f"{found}; {rest}{f'; there was no time for {late}' if late else ''}."


def _provenance(provenance: Mapping[str, Json]) -> list[tuple[str, str]]:
    rows = []
    for key, value in provenance.items():
        if key == "scene" or value is None or value == {}:
            continue
        if isinstance(value, Mapping):
            pairs = list(value.items())
            if key == "asked":  # of the fit beyond its values: "accuracy default, profile, bootstrap 200"
                pairs = [(name.replace("_", " "), "" if item is True else item) for name, item in pairs if item]
            value = ", ".join(f"{name} {item}".strip() for name, item in pairs)
        elif isinstance(value, list):
            value = " ".join(str(item) for item in value)
        rows.append((key.replace("_", " "), str(value)))
    return rows


def _scene(provenance: Mapping[str, Json]) -> str:
    scene = provenance.get("scene")
    if not scene:
        return ""
    text = scene if isinstance(scene, str) else json.dumps(scene, ensure_ascii=False, indent=2)
    return text if len(text) <= 60_000 else text[:60_000] + "\n… (whole in result.json)"
