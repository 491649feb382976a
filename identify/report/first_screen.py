"""The first screen of a fit as a piece of HTML that a notebook shows: the banner, the parameters, the notes."""

from __future__ import annotations

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from identify.base.result import Result
from identify.base.wording import quantity
from identify.report.report_tables import classical_tables, definitions
from identify.report.report_views import banner, parameter_views
from identify.report.summary import accuracy_text, tolerances_text

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
        "parameters": parameter_views(result.parameters),
        "level": f"{100 * (levels.pop() or 0.0):g} %" if len(levels) == 1 else "stated",
        "accuracy_line": accuracy_text(result.accuracy),
        "tolerances": tolerances_text(result.tolerances or {}),
        "notes": result.notes,
        "classical": classical_tables(result.logs),
        "definitions": definitions(result.logs),
        "last_iterate": [(name, quantity(entry.value, entry.unit)) for name, entry in last],
    }


def first_screen(result: Result) -> str:
    """The fragment; it brings its styles, which hold for nothing outside it."""
    environment = templates()
    style = Markup(environment.get_template("style.css").render())
    template = environment.get_template("fragment.html.j2")
    return str(template.render(style=style, scope=SCOPED, **first_screen_views(result)))
