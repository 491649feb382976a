"""`stickslip demo`: the main job on the example logs that ship inside the package."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from identify.cli.common import DONE, NOT_SUCCEEDED, Answer, Terminal

if TYPE_CHECKING:
    from identify.report.finished import Fit

NAME = "demo"
HELP = "the main job on example logs: fit, summary, report"
# Beside the joint fit: folder and key of each further part, and what is said of it before its summary, and after.
PARTS = {
    "at_50_Hz": ("The same pair, one speed, sampled at 50 Hz: about four samples in each slip", ""),
    "uneven": (
        "The same pair on a surface that differs from place to place, as skin does",
        "Simulated: a moving mass of 200 g, and friction that falls with sliding speed as well, which counts as "
        "strength here and moves the mass by more than its interval says",
    ),
}


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("--out", metavar="DIR", help="folder of the result (default: stickslip-example-pair)")


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Fit the four example logs together, then the one at 50 Hz and the uneven one; all reports go into one folder.

    Raises:
        CommandLineError, OSError: the folder cannot be written.
    """
    from identify import examples
    from identify.base.wording import wrapped
    from identify.cli.folder import check_replaceable, result_folder
    from identify.cli.progress import Progress
    from identify.identification import fit
    from identify.report import write_report
    from identify.report.summary import summary
    from identify.scene import Scene

    scene = Scene.from_toml(examples.SCENE)
    out = Path(arguments.out or f"stickslip-{scene.name}")
    check_replaceable(out)
    with Progress(terminal.notes, terminal.progress) as progress, result_folder(out) as folder:
        joint = fit(scene, progress=progress)
        further = {}
        for part, path in zip(PARTS, (examples.SCENE_AT_50_HZ, examples.SCENE_UNEVEN), strict=True):
            progress(f"the log {part.replace('_', ' ')}")
            further[part] = fit(Scene.from_toml(path), progress=progress)
        progress("writing the reports")
        write_report(joint, folder)
        for part, found in further.items():
            write_report(found, folder / part)
    terminal.say("Four simulated example logs, 0.1 mm/min to 5 mm/s, fitted together")
    terminal.say(summary(joint.typed))
    _say_truth(joint, json.loads(examples.TRUTH.read_text(encoding="utf-8"))["parameters"], terminal)
    terminal.say(f"report: {out / 'report.html'}")
    for part, found in further.items():
        before, after = PARTS[part]
        terminal.say()
        terminal.say(before)
        terminal.say(summary(found.typed))
        if after:
            terminal.say(wrapped(after))
        terminal.say(f"report: {out / part / 'report.html'}")
    converged = joint.converged and all(found.converged for found in further.values())
    documents = {part: found.result for part, found in further.items()}
    return Answer(DONE if converged else NOT_SUCCEEDED, {**joint.result, **documents})


def _say_truth(fit: Fit, truth: Mapping[str, float], terminal: Terminal) -> None:
    """How far the estimates are from what was simulated."""
    if not fit.converged:
        return
    from identify.base.wording import columns, quantity

    rows = [["", "truth", "estimate off by", ""]]
    for name, true in truth.items():
        entry = fit.typed.parameters[name]
        value, error = entry.value, entry.standard_error
        if value is not None and error:
            off = f"{100 * (value - true) / abs(true):+.2f} %"  # of the size: as the standard errors have it
            rows.append([name, quantity(true, entry.unit), off, f"{(value - true) / error:+.1f} standard errors"])
    terminal.say(columns(rows))
