"""The first screen of a fit as a piece of HTML that a notebook shows: the banner, the parameters, the notes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from identify.report.quantity_text import finite
from identify.report.report_tables import classical_tables, definitions
from identify.report.report_views import banner, last_iterate_rows, parameter_views
from identify.report.stored_result import plain
from identify.report.summary import accuracy_text, tolerances_text

SCOPED = "stickslip"  # class of the element that the styles of the fragment are bound to


def templates() -> Environment:
    """The templates of the report."""
    return Environment(
        loader=PackageLoader("identify.report", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )


def first_screen_views(result: Mapping[str, Any]) -> dict[str, Any]:
    """What the template of the first screen shows, of a document as `plain` gives it."""
    parameters = result.get("parameters", {})
    return {
        "banner": banner(result),
        "converged": result["status"] == "converged",
        "parameters": parameter_views(parameters),
        "level": _level(parameters),
        "accuracy_line": accuracy_text(result.get("accuracy") or {}),
        "tolerances": tolerances_text(result.get("tolerances") or {}),
        "notes": result.get("notes") or [],
        "classical": classical_tables(result.get("logs", ())),
        "definitions": definitions(result.get("logs", ())),
        "last_iterate": last_iterate_rows(result.get("last_iterate")),
    }


def first_screen(result: Mapping[str, Any]) -> str:
    """The fragment; it brings its styles, which hold for nothing outside it."""
    environment = templates()
    style = Markup(environment.get_template("style.css").render())
    text = environment.get_template("fragment.html.j2").render(
        style=style, scope=SCOPED, **first_screen_views(plain(result))
    )
    return str(text)


def _level(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    levels = {finite(entry.get("level")) for entry in parameters.values()} - {None}
    return f"{100 * next(iter(levels)):g} %" if len(levels) == 1 else "stated"  # type: ignore[operator]
