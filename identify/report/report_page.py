"""report.html: one file that opens from disk, with figures inside and nothing from the network."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

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
from identify.report.quantity_text import finite, quantity
from identify.report.report_figures import Picture
from identify.report.report_tables import Cell, effects_table, held_table, sensitivity_table
from identify.report.report_views import log_views
from identify.report.report_wording import EFFECTS_CHOSEN, TIMING_WORDS, with_group
from identify.report.stored_result import plain
from identify.report.style import inline_svg

if TYPE_CHECKING:
    from identify.report.finished import Fit


LARGEST = 3_000_000  # bytes of report.html
FOR_FIGURES = 2_300_000  # of which figures may take


@dataclass(frozen=True)
class FigureView:
    """A figure in the page: its inlined markup, or "" where only the file in the figures folder has room."""

    name: str
    alt: str
    caption: str
    wide: bool
    markup: Markup


def render_page(fit: Fit, drawn: Sequence[Picture]) -> str:
    """The text of report.html for the fit and its rendered figures; at most 3 MB."""
    environment = templates()
    result = plain(fit.result)
    logs = log_views(result)
    heads = [
        (Cell(f"log {view.number}", dict(view.facts).get("drive speed", "")), log)
        for view, log in zip(logs, result.get("logs", ()), strict=True)
    ]
    figures = inlined(drawn)
    told_of_pair = {
        key: {"label": with_group(key, entry), **entry} if isinstance(entry, Mapping) and entry.get("group") else entry
        for key, entry in (result.get("derived") or {}).items()
    }
    return environment.get_template("page.html.j2").render(
        style=Markup(environment.get_template("style.css").render()),
        title=_title(result, logs),
        **first_screen_views(result),
        logs=logs,
        shared_labels=[label for label in logs[0].labels if all(label in log.labels for log in logs)] if logs else [],
        figures_of={view.number: [f for p, f in figures if p.log == view.number] for view in logs},
        overall_figures=[f for p, f in figures if p.log is None and p.name not in ("profile", "measured")],
        measured_figures=[f for p, f in figures if p.name == "measured"],
        depth_figures=[f for p, f in figures if p.name == "profile"],
        intervals=interval_table(result),
        combinations=combination_table(result),
        directions=direction_lines(result),
        accuracy=accuracy_rows(result),
        compared=comparison_table(result),
        derived=[
            table
            for table in (
                answer_table([(Cell("value"), told_of_pair)], "friction pair"),
                answer_table(
                    [(head, said_once(log.get("derived") or {}, told_of_pair)) for head, log in heads], "each log"
                ),
                *(advice_table(head, log.get("derived") or {}) for head, log in heads),
            )
            if table is not None
        ],
        told=[
            (view, lines)
            for view, (_, log) in zip(logs, heads, strict=True)
            if (lines := sentences(log.get("derived") or {}, several=len(logs) > 1))
        ],
        effects=effects_table(result.get("effects") or {}),
        chosen=EFFECTS_CHOSEN.get(str((result.get("effects") or {}).get("chosen")), ""),
        quality=answer_table(
            [(head, of_record((log.get("quality") or {}).get("figures") or {})) for head, log in heads], ""
        ),
        held=held_table(result["rig_against_data"]) if result.get("rig_against_data") else None,
        sensitivity=sensitivity_table(result["rig_sensitivity"]) if result.get("rig_sensitivity") else None,
        search=_search(result),
        timings=_timings(result.get("timing_s") or {}),
        provenance=_provenance(result.get("provenance") or {}),
        scene=_scene(result.get("provenance") or {}),
    )


def inlined(drawn: Sequence[Picture]) -> list[tuple[Picture, FigureView]]:
    """Every figure with its markup: SVG while there is room for all, the largest as PNG where there is not.

    Where even that is too much, the largest figures are left to the figures folder.
    """
    choices = [(inline_svg(picture.svg, picture.name), _png(picture), "") for picture in drawn]
    chosen = [0] * len(drawn)
    sizes = [[len(markup.encode()) for markup in choice] for choice in choices]
    while sum(sizes[i][chosen[i]] for i in range(len(drawn))) > FOR_FIGURES:
        step = min(chosen)
        largest = max((i for i in range(len(drawn)) if chosen[i] == step), key=lambda i: sizes[i][step])
        chosen[largest] += 1
    return [
        (picture, FigureView(picture.name, picture.alt, picture.caption, picture.wide, Markup(choices[i][chosen[i]])))
        for i, picture in enumerate(drawn)
    ]


def _png(picture: Picture) -> str:
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(picture.png).decode("ascii")}">'


def _title(result: Mapping[str, Any], logs: Sequence[Any]) -> str:
    scene = (result.get("provenance") or {}).get("scene") or {}
    name = scene.get("name") if isinstance(scene, Mapping) else None
    return str(name) if name else f"{len(logs)} log{'s' * (len(logs) != 1)}"


def _search(result: Mapping[str, Any]) -> str:
    """What led to the answer, and what else was tried, in one sentence; "" where nothing was searched."""
    led = list(dict.fromkeys(result.get("found_by") or ()))
    tried = list(dict.fromkeys(trial["strategy"] for trial in result.get("search") or ()))
    if not tried:
        return ""
    others = [name for name in tried if name not in led]
    found = f"Found by {', then '.join(led)}" if led else "No answer was found"
    rest = f"tried besides: {', '.join(others)}" if others else "nothing else was tried"
    late = ", ".join(result.get("not_tried") or ())
    return f"{found}; {rest}{f'; there was no time for {late}' if late else ''}."


def _timings(timings: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [
        (TIMING_WORDS.get(key, key.replace("_", " ")), quantity(finite(value), "s", 3))
        for key, value in timings.items()
    ]


def _provenance(provenance: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows = []
    for key, value in provenance.items():
        if key == "scene" or value is None or value == {}:
            continue
        if key == "asked" and isinstance(value, Mapping):
            value = _asked(value)
        elif isinstance(value, Mapping):
            value = ", ".join(f"{name} {item}" for name, item in value.items())
        elif isinstance(value, list):
            value = " ".join(str(item) for item in value)
        rows.append((key.replace("_", " "), str(value)))
    return rows


def _asked(asked: Mapping[str, Any]) -> str:
    """What was asked of the fit beyond its values: "accuracy default, profile, bootstrap 200"."""
    said = []
    for name, value in asked.items():
        if value is True:
            said.append(name.replace("_", " "))
        elif value:
            said.append(f"{name.replace('_', ' ')} {value}")
    return ", ".join(said)


def _scene(provenance: Mapping[str, Any]) -> str:
    scene = provenance.get("scene")
    if not scene:
        return ""
    text = scene if isinstance(scene, str) else json.dumps(scene, ensure_ascii=False, indent=2)
    return text if len(text) <= 60_000 else text[:60_000] + "\n… (whole in result.json)"
