"""`stickslip demo`: the main job on the example logs that ship inside the package."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from pathlib import Path

from identify.cli.common import DONE, NOT_SUCCEEDED, Answer, Terminal

NAME = "demo"
HELP = "the main job on example logs: fit, summary, report"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("--out", metavar="DIR", help="folder of the result (default: stickslip-example-pair)")


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Fit the four example logs together, and say how far the estimates are from what was simulated.

    Raises:
        CommandLineError, OSError: the folder cannot be written.
    """
    from identify import examples
    from identify.base.wording import columns, quantity
    from identify.cli.fit import fit_and_report
    from identify.cli.folder import check_replaceable
    from identify.scene import Scene

    scene = Scene.from_toml(examples.SCENE)
    out = Path(arguments.out or f"stickslip-{scene.name}")
    check_replaceable(out)
    terminal.say("Four simulated example logs, 0.1 mm/min to 5 mm/s, fitted together")
    fit = fit_and_report(scene, out, terminal)
    truth = json.loads(examples.TRUTH.read_text(encoding="utf-8"))["parameters"]
    rows = [["", "truth", "estimate off by", ""]]
    for name, true in truth.items() if fit.converged else ():
        entry = fit.typed.parameters[name]
        if entry.value is not None and entry.standard_error:
            off = entry.value - true
            errors = f"{off / entry.standard_error:+.1f} standard errors"
            rows.append([name, quantity(true, entry.unit), f"{100 * off / abs(true):+.2f} %", errors])
    if len(rows) > 1:
        terminal.say(columns(rows))
    return Answer(DONE if fit.converged else NOT_SUCCEEDED, fit.result)
