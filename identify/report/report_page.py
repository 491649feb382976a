"""report.html: one file that opens from disk, with figures inside and nothing from the network; its first screen."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from data_io.correct import Change
from identify.base.document import Json, to_dict
from identify.base.outcome import Status
from identify.base.result import LogResult, Result
from identify.base.wording import DASH, number, quantity, speed
from identify.prediction.wording import listed
from identify.report.report_tables import (
    accuracy_rows,
    answer_table,
    causes_table,
    classical_pages,
    definitions,
    effects_table,
    held_table,
    method_table,
    of_record,
    outlook_of,
    parameter_table,
    sensitivity_table,
    sentences,
    shown_error,
    spread_of,
    without_groups_of,
)
from identify.report.report_wording import (
    DRAWN,
    EFFECT_SIZES,
    EFFECTS_CHOSEN,
    NOT_FOR,
    QUALITY,
    QUALITY_CLASS,
    STATUS,
    TIMING_WORDS,
    distribution_lines,
    is_uneven,
    plain_symbol,
    solver_words,
    with_group,
)
from identify.report.report_wording import (
    headline as headline_of,
)
from identify.report.style import Drawing, svg_element
from identify.report.summary import accuracy_text, tolerances_text

if TYPE_CHECKING:
    from identify.report.finished import Fit

# ----------------------------------------------------------------------------------------------------------------------
# What the templates show, as plain values: banner, logs.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Tile:
    """One figure of the gate with what it should be."""

    label: str
    value: str
    meaning: str


@dataclass(frozen=True)
class Banner:
    """Can it be trusted: badge, headline, sentence, and the figures behind the answer."""

    kind: str
    badge: str
    headline: str
    message: str
    tiles: tuple[Tile, ...]


@dataclass(frozen=True)
class LogView:
    """One log as its section shows it."""

    number: int
    name: str
    path: str
    sha256: str
    facts: tuple[tuple[str, str], ...]
    labels: tuple[tuple[str, str], ...]
    quality: str
    quality_class: str
    findings: tuple[tuple[str, str], ...]
    left_out: str
    corrections: tuple[str, ...] = ()


def banner(result: Result) -> Banner:
    """The answer to "can it be trusted?" in plain words."""
    words = STATUS[Status(result.status)]
    if is_uneven(result):
        rests_on = result.message.split("; ")[0]
        message = f"{rests_on[0].upper()}{rests_on[1:]}. {NOT_FOR} {DRAWN}"
        return Banner("fair", "described cycle by cycle", headline_of(result), message, _tiles(result))
    kind, headline = ("good", words.headline) if result.converged else ("bad", words.headline)
    doubtful = [name for name, entry in result.parameters.items() if entry.verdict in ("not identifiable", "at bound")]
    if result.converged and doubtful:
        kind = "fair"
        headline += f" These logs do not tell {listed([plain_symbol(n) for n in doubtful])}."
    return Banner(kind, words.badge, headline, result.message, _tiles(result))


def log_views(result: Result) -> tuple[LogView, ...]:
    """One view per log of the result."""
    return tuple(_log(number_, log, result.converged) for number_, log in enumerate(result.logs, start=1))


def _tiles(result: Result) -> tuple[Tile, ...]:
    gate, fit = result.gate, result.fit
    tiles = [
        Tile(name, value, f"{spread} in nine of ten drawn cycles") for name, value, spread in distribution_lines(result)
    ]
    if gate is not None:
        tiles.append(Tile("misfit", number(gate.chi2_per_sample, 4), "χ² per sample; 1 is pure noise"))
        if gate.worst_cycle is not None:
            worst = gate.worst_cycle
            where = f"log {worst.log}, cycle {worst.cycle}; a few is usual, above 6 is refused"
            tiles.append(Tile("worst cycle", f"z = {number(worst.z, 3)}", where))
        if gate.solver is not None:
            tiles.append(Tile("solver", solver_words(gate.solver), "how the optimiser ended"))
        shift = number(gate.event_shift_samples, 2)
        tiles.append(Tile("switch times", f"{shift} samples", "last movement; settled below 0.5"))
    if fit is not None:
        rms = quantity(fit.rms_N, "N", 3)
        cycles = DASH if fit.cycles is None else fit.cycles
        tiles.append(Tile("data", f"{cycles} cycles", f"{_thousands(fit.samples)} samples; residual {rms} (rms)"))
    return tuple(tiles)


def _thousands(count: int | None) -> str:
    return f"{count:,}".replace(",", "\N{NARROW NO-BREAK SPACE}") if count else DASH


def _log(number_: int, log: LogResult, converged: bool) -> LogView:
    verdict = log.quality.verdict
    return LogView(
        number=number_,
        name=log.name or f"log {number_}",
        path=log.path,
        sha256=log.sha256 or "",
        facts=_facts(log),
        labels=tuple(log.labels.items()),
        quality=QUALITY.get(verdict, verdict),
        # green beside a fit that was refused would say the opposite of the banner
        quality_class=QUALITY_CLASS.get(verdict, "plain") if converged or verdict != "accept" else "plain",
        findings=tuple((finding.severity, finding.message) for finding in log.quality.findings),
        left_out=log.reason_left_out or "",
        corrections=tuple(_correction(change) for change in log.corrections),
    )


def _correction(change: Change) -> str:
    error = change.standard_error
    return f"{change.text} (standard error {quantity(error, change.unit, 2)})" if error else change.text


def _facts(log: LogResult) -> tuple[tuple[str, str], ...]:
    facts = [
        ("drive speed", speed(log.drive_speed_m_per_s)),
        ("normal force", quantity(log.normal_force_N, "N", 3)),
        ("step", DASH if log.step is None else str(log.step)),
        ("samples", _thousands(log.rows)),
        ("slips", DASH if log.slip_count is None else str(log.slip_count)),
        ("noise", quantity(log.noise_N, "N", 2)),
    ]
    if log.friction_sign == -1:
        facts.append(("sign", "friction force turned over"))
    return tuple(fact for fact in facts if fact[1] != DASH)


# ----------------------------------------------------------------------------------------------------------------------
# The first screen: in the page, and as a piece of HTML that a notebook shows.
# ----------------------------------------------------------------------------------------------------------------------

SCOPED = "stickslip"  # class of the element that the styles of the fragment are bound to


def templates(*packages: str) -> Environment:
    """The templates of these packages (default: of the report); of two with one name that of the first."""
    return Environment(
        loader=ChoiceLoader([PackageLoader(package, "templates") for package in packages or ("identify.report",)]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )


def first_screen_views(result: Result) -> dict[str, object]:
    """What the template of the first screen shows."""
    levels = {entry.level for entry in result.parameters.values()} - {None}
    last = (result.last_iterate or {}).items()
    return {
        "banner": banner(result),
        "converged": result.converged,
        "parameters": parameter_table(result.parameters),
        "level": f"{100 * (levels.pop() or 0.0):g} %" if len(levels) == 1 else "stated",
        "accuracy_line": accuracy_text(result.accuracy),
        "tolerances": tolerances_text(result.tolerances or {}),
        "notes": result.notes,
        "bare": any(shown_error(e) is None and spread_of(e) is not None for e in result.parameters.values()),
        "classical": classical_pages(result.logs),
        "definitions": definitions(result.logs),
        "last_iterate": [(name, quantity(entry.value, entry.unit)) for name, entry in last],
    }


def first_screen(result: Result) -> str:
    """The fragment; it brings its styles, which hold for nothing outside it."""
    environment = templates()
    style = Markup(environment.get_template("style.css").render())
    template = environment.get_template("fragment.html.j2")
    return str(template.render(style=style, scope=SCOPED, **first_screen_views(result)))


# ----------------------------------------------------------------------------------------------------------------------
# The page.
# ----------------------------------------------------------------------------------------------------------------------

LARGEST = 3_000_000  # bytes of report.html
FOR_FIGURES = 2_300_000  # of which figures may take


def render_page(fit: Fit, drawn: Sequence[Drawing]) -> str:
    """The text of report.html for the fit and its rendered figures; at most 3 MB."""
    environment = templates()
    result = fit.typed
    logs = log_views(result)
    heads = [
        (", ".join(filter(None, (f"log {view.number}", dict(view.facts).get("drive speed")))), log)
        for view, log in zip(logs, result.logs, strict=True)
    ]
    figures = inlined(drawn)
    told_of_pair = {
        key: {**({"label": with_group(key, entry.group)} if entry.group else {}), **to_dict(entry)}
        for key, entry in result.derived.items()
    }
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
        intervals=method_table(result),
        accuracy=accuracy_rows(result.accuracy_table or ()),
        derived=[
            table
            for table in (
                answer_table([("value", told_of_pair)], "friction pair"),
                answer_table([(head, without_groups_of(log.derived, told_of_pair)) for head, log in heads], "each log"),
            )
            if table
        ],
        outlook=answer_table([(head, outlook_of(log.derived)) for head, log in heads]),
        told=[
            (view, lines)
            for view, (_, log) in zip(logs, heads, strict=True)
            if (lines := sentences(log.derived, several=len(logs) > 1))
        ],
        effects=effects_table(result.effects.reasons),
        chosen=_chosen(result),
        quality=answer_table([(head, of_record(log.quality.figures)) for head, log in heads]),
        causes=causes_table(result.causes) if result.causes else None,
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


def inlined(drawn: Sequence[Drawing]) -> list[Drawing]:
    """Every figure with its markup while there is room; the largest are left to the figures folder."""
    markup = {picture.name: svg_element(picture.svg, picture.name) for picture in drawn}
    free = FOR_FIGURES - sum(len(text.encode()) for text in markup.values())
    for name in sorted(markup, key=lambda name: len(markup[name]), reverse=True):
        if free >= 0:
            break
        free += len(markup[name].encode())
        markup[name] = ""
    return [replace(picture, markup=Markup(markup[picture.name])) for picture in drawn]


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
