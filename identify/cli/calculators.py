"""`stickslip stability` and `stickslip amplitude`: what the pair does at an operating point.

The options stand apart from the work, so that help needs nothing heavy.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from identify.cli.common import Answer, Command, Terminal, add_options


def _command(name: str, help_: str) -> Command:
    """The command for one part of the answer."""

    def run(arguments: Namespace, terminal: Terminal) -> Answer:
        from identify.cli.operating import answers

        return answers(arguments, terminal, name)

    return Command(name, help_, _add_arguments, run)


def _add_arguments(parser: ArgumentParser) -> None:
    source = parser.add_mutually_exclusive_group(required=True)
    sources = {
        "--scene SCENE.toml": "the values of a scene: fixed, else start, else default",
        "--result result.json": "the estimates of a fit, with their uncertainty",
    }
    add_options(source, sources)
    point = 'operating point, repeatable: drive_speed="1 mm/s", normal_force, or any parameter (default: each log)'
    parser.add_argument("--at", nargs="+", action="extend", default=[], metavar="KEY=VALUE", help=point)
    advice = (
        "the nearest change of speed, stiffness, damping, mass or load that makes sliding steady, with a margin "
        "(default: 20 %%)"
    )
    parser.add_argument("--advice", nargs="?", const="20 %", metavar="MARGIN", help=advice)
    options = {
        "--group GROUP+": "of a fit whose parameters differ between groups: this one alone, as V08 or volunteer=V08, "
        "repeatable (default: each)",
        "--without EFFECT+": "leave out an effect of the scene, repeatable: one with which no cycle is like the one "
        "before",
        "--plot FILE": "draw it over drive speed, or the map (png, svg or pdf)",
    }
    add_options(parser, options)
    group = parser.add_argument_group("maps")
    quantities = (
        "over one or two of drive_speed, stiffness, normal_force, pressure, area, damping, zeta, mass, t_cr, D, mu_k0, "
        "mu_step (μs - μk0), a, or any other parameter"
    )
    group.add_argument("--map", nargs="+", metavar="NAME", help=quantities)
    maps = {
        "--range NAME=LOW:HIGH+": 'of a quantity of the map, repeatable: drive_speed="0.1 mm/s:10 mm/s" (default: '
        "around the point)",
        "--points N": "along each quantity (default: 60, of one alone 120)",
        "--data FILE": "the numbers of the map (csv)",
    }
    add_options(group, maps)


COMMANDS = (
    _command("stability", "does the pair stick and slip at an operating point, and up to which drive speed"),
    _command("amplitude", "how large, how fast and how often the jumps of stick-slip are at an operating point"),
)
