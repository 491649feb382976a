"""report.html: one file that opens from disk, with figures inside and nothing from the network; its first screen."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from identify.base.result import LogResult, Result, Status
from identify.base.table import Cell, OutputTable
from identify.base.wording import DASH, decimals, number, quantity
from identify.prediction.wording import listed
from identify.report import report_tables as tables
from identify.report import report_wording as wording
from identify.report.style import REPORTED

if TYPE_CHECKING:
    from identify.report.finished import Fit
    from identify.report.style import Drawing

LARGEST = 3_000_000  # bytes of report.html
FOR_FIGURES = 2_300_000  # of which figures may take
LONGEST_SCENE = 60_000  # characters
FONTS = "system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif"
SCOPED = "stickslip"  # class of the element that the styles of the fragment are bound to


def templates(*packages: str) -> Environment:
    """The templates of these packages (default: of the report); of two with one name that of the first."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package, "templates") for package in packages or ("identify.report",)]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters["symbols"] = wording.with_symbols
    return environment


def first_screen(result: Result) -> str:
    """The fragment; it brings its styles, which hold for nothing outside it."""
    environment = templates()
    style = Markup(environment.get_template("style.css").render())
    return environment.get_template("fragment.html.j2").render(style=style, scope=SCOPED, **first_screen_views(result))


def first_screen_views(result: Result) -> dict[str, object]:
    """What the template of the first screen shows."""
    last = (result.last_iterate or {}).items()
    open_ = {name: e for name, e in result.parameters.items() if e.value is None and not any(e.ends)}
    reasons: dict[str, list[str]] = {}
    for name, entry in open_.items():
        reasons.setdefault(entry.reason, []).append(wording.plain_symbol(name))
    return {
        "banner": banner(result),
        "converged": result.converged,
        "parameters": tables.parameter_table({n: e for n, e in result.parameters.items() if n not in open_}),
        "not_identifiable": [(", ".join(names), wording.with_symbols(reason)) for reason, names in reasons.items()],
        "tolerances": wording.tolerances_text(result.tolerances or {}),
        "notes": result.notes,
        "classical": tables.classical_pages(result.logs),
        "definitions": tables.definitions(result.logs),
        "last_iterate": [(wording.plain_symbol(name), quantity(entry.value, entry.unit)) for name, entry in last],
    }


def banner(result: Result) -> dict[str, object]:
    """The answer to "can it be trusted?" in plain words: class, badge, headline, sentence, and the figures behind it,
    each with its label and what it should be."""
    badge, head = wording.STATUS[Status(result.status)]
    kind, message = "good" if result.converged else "bad", f"{result.message[:1].upper()}{result.message[1:]}"
    doubtful = [name for name, entry in result.parameters.items() if entry.verdict in ("not identifiable", "at bound")]
    if wording.is_uneven(result):
        rests_on = message.split("; ")[0]
        kind, badge, head = "fair", "described cycle by cycle", wording.headline(result)
        message = f"{rests_on}. {wording.NOT_FOR}"
    elif result.converged and doubtful:
        kind = "fair"
        head += f" Not identifiable from these logs: {listed([wording.plain_symbol(n) for n in doubtful])}."
    tiles = [
        (name, value, f"{spread} in nine of ten cycles") for name, value, spread in wording.distribution_lines(result)
    ]
    gate, fit = result.gate, result.fit
    if gate is not None:
        misfit = DASH if gate.chi2_per_sample is None else decimals(gate.chi2_per_sample, 3)
        tiles.append(("misfit", misfit, "χ² per sample; 1 is pure noise"))
        if (worst := gate.worst_cycle) is not None:
            where = f"log {worst.log}, cycle {worst.cycle}; a few is usual, above 6 is refused"
            tiles.append(("worst cycle", f"z = {number(worst.z, 3)}", where))
    if fit is not None:
        samples = f"{_thousands(fit.samples)} samples; residual {quantity(fit.rms_N, 'N', 3)} (rms)"
        tiles.append(("data", f"{DASH if fit.cycles is None else fit.cycles} cycles", samples))
    return {"kind": kind, "badge": badge, "headline": head, "message": message, "tiles": tiles}


def _thousands(count: int | None) -> str:
    return f"{count:,}".replace(",", "\N{NARROW NO-BREAK SPACE}") if count else DASH


def render_page(fit: Fit, drawn: Sequence[Drawing]) -> str:
    """The text of report.html for the fit and its rendered figures; at most 3 MB."""
    environment = templates()
    result, figures = fit.typed, inlined(drawn)
    logs = [_log(place, log, result.converged) for place, log in enumerate(result.logs, start=1)]
    columns = [(f"log {i}, {quantity(log.drive_speed_m_per_s, 'm/s')}", log) for i, log in enumerate(result.logs, 1)]
    scene = result.provenance.get("scene")
    text = scene if isinstance(scene, str) else json.dumps(scene, ensure_ascii=False, indent=2) if scene else ""
    sizes = result.effects.chosen == "listed" and any(log.derived for log in result.logs)
    return environment.get_template("page.html.j2").render(
        style=Markup(environment.get_template("style.css").render()),
        title=str(result.scene.get("name") or f"{len(logs)} log{'s' * (len(logs) != 1)}"),
        **first_screen_views(result),
        logs=logs,
        shared_labels=[item for item in (result.logs[0].labels.items() if logs else ())
                       if all(item in log.labels.items() for log in result.logs)],
        figures_of={place: [f for f in figures if f.log == place] for place in range(1, len(logs) + 1)},
        law_figures=[f for f in figures if f.name in REPORTED],
        overall_figures=[f for f in figures if f.log is None and f.name not in (*REPORTED, "profile")],
        depth_figures=[f for f in figures if f.name == "profile"],
        intervals=tables.method_table(result),
        accuracy=tables.accuracy_table(result.accuracy),
        answers=tables.answer_table(columns),
        effects=tables.effects_table(result.effects.reasons),
        chosen=wording.EFFECTS_CHOSEN.get(result.effects.chosen, "") + f" {wording.EFFECT_SIZES}" * sizes,
        causes=tables.causes_table(result.causes) if result.causes else None,
        held=tables.held_table(result.rig_against_data) if result.rig_against_data else None,
        sensitivity=tables.sensitivity_table(result) if result.rig_sensitivity else None,
        provenance=_provenance(result),
        files=OutputTable("Files", ("log", "file", "SHA-256"),
                          tuple((Cell(f"{i}"), log.path, log.sha256 or "") for i, log in enumerate(result.logs, 1))),
        scene=text if len(text) <= LONGEST_SCENE else f"{text[:LONGEST_SCENE]}\n… (whole in result.json)",
    )  # fmt: skip


def inlined(drawn: Sequence[Drawing]) -> list[Drawing]:
    """Every figure with its markup while there is room; the largest are left to the figures folder."""
    markup = {drawing.name: svg_element(drawing.svg, drawing.name) for drawing in drawn}
    free = FOR_FIGURES - sum(len(text.encode()) for text in markup.values())
    for name in sorted(markup, key=lambda name: len(markup[name]), reverse=True):
        if free >= 0:
            break
        free += len(markup[name].encode())
        markup[name] = ""
    return [replace(drawing, markup=Markup(markup[drawing.name])) for drawing in drawn]


def svg_element(text: str, prefix: str) -> str:
    """The <svg> element of an SVG file of matplotlib's for use inside HTML.

    Prolog, metadata and name-space addresses go (HTML implies them); `prefix` keeps the ids of several figures in one
    page apart; coordinates are cut to a hundredth of a point; width and height become the page's business.
    """
    body = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text[text.index("<svg") :], flags=re.DOTALL)
    head, rest = body.split(">", 1)
    (box,) = re.findall(r'viewBox="([^"]*)"', head)

    def tidy(tag: re.Match[str]) -> str:
        kept = re.sub(r"(-?\d+\.\d\d)\d+", r"\1", re.sub(r'(\bid="|href="#|url\(#)', rf"\1{prefix}-", tag[0]))
        return re.sub(r"\s*\n\s*", " ", re.sub(r"'DejaVu Sans'(?:, *sans-serif)?", FONTS, kept))

    rest = re.sub(r">\s*\n\s*<", ">\n<", re.sub(r"<[^>]*>", tidy, rest))
    return f'<svg viewBox="{box}" aria-hidden="true" focusable="false">{rest.rstrip()}'


def _log(place: int, log: LogResult, converged: bool) -> dict[str, object]:
    """What the section of a log shows."""
    words, kind = wording.QUALITY.get(log.quality.verdict, (log.quality.verdict, "plain"))
    facts = (
        ("drive speed", quantity(log.drive_speed_m_per_s, "m/s")),
        ("normal force", quantity(log.normal_force_N, "N", 3)),
        ("step", DASH if log.step is None else str(log.step)),
        ("samples", _thousands(log.rows)),
        ("slips", DASH if log.slip_count is None else str(log.slip_count)),
        ("noise", quantity(log.noise_N, "N", 2)),
        ("sign", "friction force turned over" if log.friction_sign == -1 else DASH),
    )
    return {
        "number": place,
        "name": log.name or f"log {place}",
        "facts": [(name, text) for name, text in facts if text != DASH],
        "labels": list(log.labels.items()),
        "quality": words,
        # green beside a fit that was refused would contradict the banner
        "quality_class": kind if converged or log.quality.verdict != "accept" else "plain",
        "findings": [(finding.severity, finding.message) for finding in log.quality.findings],
        "left_out": log.reason_left_out or "",
        "corrections": [
            ("info", c.text + f" (standard error {quantity(c.standard_error, c.unit, 2)})" * bool(c.standard_error))
            for c in log.corrections
        ],
    }


def _provenance(result: Result) -> list[tuple[str, str]]:
    """What was tried and how long it took, and with what the result was made."""
    tried = ", ".join(dict.fromkeys(f"{trial.strategy} ({trial.status.replace('_', ' ')})" for trial in result.search))
    seconds = ", ".join(f"{stage} {quantity(value, 's', 3)}" for stage, value in result.timing_s.items())
    rows = {"search": tried, "no time for": ", ".join(result.not_tried), "time": seconds}
    for key, value in result.provenance.items():
        if isinstance(value, Mapping):
            # what was asked of the fit beyond its values: "accuracy default, profile, bootstrap 200"
            pairs = [(n.replace("_", " "), "" if v is True else v) for n, v in value.items() if v or key != "asked"]
            value = ", ".join(f"{name} {item}".strip() for name, item in pairs)
        elif isinstance(value, list):
            value = " ".join(str(item) for item in value)
        rows |= {} if key == "scene" else {key.replace("_", " "): "" if value is None else str(value)}
    return [(name, text) for name, text in rows.items() if text]
