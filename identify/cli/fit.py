"""`stickslip fit`, `demo` and `verify`: identify the parameters from all the logs together, and run a fit again."""

from __future__ import annotations

import json
import math
from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import get_args

from data_io.atomic import atomic_path
from data_io.contents import digest_of, log_is_at
from identify import examples
from identify.base.compiled import keep
from identify.base.result import Result
from identify.base.wording import columns, wrapped
from identify.base.wording import quantity as shown
from identify.cli.arguments import file_to_write, log_options, positive, result_folder
from identify.cli.common import Answer, CommandLineError, Terminal
from identify.diagnosis.selection import LOOKED_AT
from identify.estimation.influence import FEWEST
from identify.estimation.preview import preview
from identify.estimation.starts import Sources
from identify.identification import fit
from identify.logs.scene_records import with_drives, with_records
from identify.report import write_report
from identify.report.figures import draw_preview
from identify.report.finished import Fit
from identify.report.report_tables import summary
from identify.report.stored_result import read_result, scene_of
from identify.report.style import drawing_style
from identify.scene import LogEntry, Scene
from identify.scene.tables import quantity
from identify.shooting.accuracy import DEFAULT, DEFAULT_OPTIONS, FitOptions, accuracy_of

ALLOWED = 0.01  # difference in standard errors that other library versions may make
FIXED = 1e-9  # relative difference of what was not estimated


def demo(arguments: Namespace, terminal: Terminal) -> Answer:
    """Fit the four example logs together, and say how far the estimates are from what was simulated."""
    terminal.say("Four simulated example logs, 0.1 mm/min to 5 mm/s, fitted together")
    found = _fit_and_report(Scene.from_toml(examples.SCENE), arguments.out, terminal)
    truth = json.loads(examples.TRUTH.read_text(encoding="utf-8"))["parameters"]
    rows = [["", "truth", "estimate off by", ""]]
    for name, true in truth.items() if found.converged else ():
        entry = found.typed.parameters[name]
        if entry.value is not None and entry.standard_error:
            off = entry.value - true
            row = f"{100 * off / abs(true):+z.2f} %", f"{off / entry.standard_error:+z.1f} standard errors"
            rows.append([name, shown(true, entry.unit), *(text.replace("-", "−") for text in row)])
    if len(rows) > 1:
        terminal.say(columns(rows))
    return Answer.of(found.converged, found.result)


def fit_logs(arguments: Namespace, terminal: Terminal) -> Answer:
    """Fit and write the report; exit code 3 unless the fit converged."""
    scene = _scene_of(arguments)
    if arguments.bootstrap is not None and arguments.bootstrap < FEWEST:
        raise CommandLineError(
            f"--bootstrap {arguments.bootstrap} is too few for an interval; expected {FEWEST} replicates or more: "
            "200 is usual"
        )
    options = FitOptions(
        accuracy=DEFAULT if arguments.accuracy is None else accuracy_of(arguments.accuracy),
        profile=arguments.profile,
        bootstrap=arguments.bootstrap or 0,
        accuracy_table=arguments.accuracy_table,
    )
    if arguments.preview:
        return _preview(scene, Path(arguments.out or f"stickslip-{scene.name}"), terminal)
    costs = arguments.verbose or arguments.accuracy_table
    found = _fit_and_report(scene, arguments.out, terminal, options, arguments.starts, costs)
    return Answer.of(found.converged, found.result)


def _scene_of(arguments: Namespace) -> Scene:
    """The scene with the logs and the reading options of the command line; every log is there."""
    options = log_options(arguments)
    for name, unit in (("normal_force", "N"), ("rate", "Hz"), ("arm", "m"), ("area", "m^2")):
        if name in options:
            options[name] = quantity(options[name], unit, f"--{name.replace('_', '-')}")
    limit = positive(arguments.time_limit, "s", "--time-limit")
    scene = Scene.from_toml(arguments.scene, [*arguments.set, *([f"fit.time_limit={limit}"] if limit else [])])
    logs = tuple(replace(entry, **options) for entry in scene.choose(arguments.logs, LogEntry(Path())).logs)
    if not logs:
        raise CommandLineError(f"{scene.source} lists no log and none was given; name a LOG, or add [[logs]] to it")
    for path in (entry.path for entry in logs):
        if not log_is_at(path):
            what = "this is a folder that holds no log" if path.is_dir() else "there is no such log"
            quoted = path.name.endswith(("'", '"'))
            remedy = "leave out its own quotes" if quoted else "check its path in the scene, or put it there"
            raise CommandLineError(f"{path}: {what}; {remedy}")
    return replace(scene, logs=logs)


def _fit_and_report(
    scene: Scene,
    out: str | None,
    terminal: Terminal,
    options: FitOptions = DEFAULT_OPTIONS,
    starts: Sources | None = None,
    costs: bool = False,
) -> Fit:
    """Fit a scene with progress, write its folder whole, say the summary, with what accuracy costs where wanted."""
    place = Path(out or f"stickslip-{scene.name}")
    with result_folder(place) as folder, terminal.bar() as progress:
        outcome = fit(scene, progress=progress, starts=starts, options=options)
        progress("writing the report")
        write_report(outcome, folder)
    keep()  # the next fit of this kind finds its functions compiled
    terminal.say(summary(outcome.typed, costs))
    terminal.say(f"report: {place / 'report.html'}")
    if outcome.converged and outcome.typed.estimator != "uneven":
        terminal.say(f"next: stickslip stability --result {place / 'result.json'}")
    return outcome


def _preview(scene: Scene, out: Path, terminal: Terminal) -> Answer:
    """Draw and say what a fit would start from; the picture stands beside the folder of the result."""
    file = file_to_write(str(out.parent / f"{out.name}-preview.png"), "--preview")
    with terminal.bar() as progress:
        progress("reading the logs", 0.0)
        scene, drives = with_drives(scene)
        scene, records = with_records(scene, None)
        if scene.effects == "auto":
            scene = scene.with_effects(LOOKED_AT)
        progress("finding a start", 0.3)
        start = preview(scene, records)
        progress("drawing", 0.8)
        with drawing_style(), atomic_path(file) as temporary:
            draw_preview(start).savefig(temporary, format="png", dpi=130)
    for sentence in (*start.notices, *drives, *(f"{log.curves.name}: {log.text}" for log in start.logs)):
        terminal.say(wrapped(sentence))
    terminal.say(f"the start: {start.source}")
    rows = [["", "value"], *([name, shown(value, start.units[name])] for name, value in start.parameters.items())]
    terminal.say(columns(rows))
    terminal.say(f"picture: {file}")
    return Answer(
        document={
            "status": "preview",
            "message": "nothing was fitted; the picture shows the cycles detected and the start over the data",
            "picture": str(file),
            "source": start.source,
            "start": {name: {"value": v, "unit": start.units[name]} for name, v in start.parameters.items()},
            "logs": [
                {"name": log.curves.name, "cycles": len(log.curves.cycles), "text": log.text} for log in start.logs
            ],
        }
    )


def figures(arguments: Namespace, terminal: Terminal) -> Answer:
    """Write the figures of a finished fit at the widths of a paper."""
    given = Path(arguments.result)
    if not given.is_dir() and given.name != "result.json":
        raise CommandLineError(f"{given}: expected the folder of a fit, or its result.json; give one of them")
    place = given if given.is_dir() else given.parent
    out = Path(arguments.out or f"{place.resolve()}-figures")
    if out.exists() and not out.is_dir():
        raise CommandLineError(f"--out {out} is a file; expected a folder: choose another name")
    with terminal.bar() as progress:
        progress("drawing")
        files = [str(path) for path in Fit.load(place).save_figures(out)]
    terminal.say(f"{len(files) - 1} figures, and their captions: {files[-1]}")
    return Answer(document={"status": "written", "message": f"{len(files)} files in {out}", "files": files})


def verify(arguments: Namespace, terminal: Terminal) -> Answer:
    """Fit again and compare status and values; exit code 3 where they differ."""
    stored = read_result(Path(arguments.result))
    scene = scene_of(stored, Path(arguments.result))
    for log in arguments.logs:
        if not log_is_at(Path(log)):
            raise CommandLineError(f"{log}: there is no log; give a file, a folder of them, or a pattern in quotes")
    moved = {digest_of(Path(log)): Path(log) for log in arguments.logs}
    logs = []
    for number, entry in enumerate(scene.logs):  # the very logs that were fitted
        sha256 = stored.logs[stored.places(number)[0]].sha256 or ""
        path = moved.get(sha256, entry.path)
        if not log_is_at(path):
            raise CommandLineError(f"{path}: the log of this result is no longer there; put it back, or name it as LOG")
        if path == entry.path and digest_of(path) != sha256:
            raise CommandLineError(f"{path}: the log has changed since that fit (other SHA-256); put the old one back")
        logs.append(replace(entry, path=path))
    provenance = stored.provenance
    seed, starts = provenance.get("seed"), provenance.get("starts")
    with terminal.bar() as progress:
        again = fit(
            replace(scene, logs=tuple(logs)),
            progress=progress,
            starts=next((known for known in get_args(Sources) if known == starts), None),
            seed=seed if isinstance(seed, int) else 0,
            options=FitOptions.again(provenance.get("asked")),
        ).typed
    differences = compare(stored, again)
    within = f"every value that has a standard error within {ALLOWED} of it, and the same verdicts"
    for words in differences or [f"reproduced: {stored.status}; {within}"]:
        terminal.say(wrapped(words))
    status = "differs" if differences else "reproduced"
    return Answer.of(not differences, {"status": status, "differences": differences})


def compare(stored: Result, again: Result) -> list[str]:
    """What differs, one sentence each: verdicts, and values that have a standard error or are fixed."""
    if stored.status != again.status:
        return [f"the status was {stored.status} and is {again.status} now: {again.message}"]
    sentences = [f"{name} is new" for name in again.parameters if name not in stored.parameters]
    for name, before in stored.parameters.items():
        now = again.parameters.get(name)
        if now is None or before.verdict != now.verdict:
            sentences.append(f"{name} was called {before.verdict} and is called {now.verdict if now else None} now")
        elif before.value is not None and (before.standard_error or before.verdict == "fixed"):
            allowed = ALLOWED * before.standard_error if before.standard_error else FIXED * abs(before.value)
            if now.value is None or abs(now.value - before.value) > allowed:
                sentences.append(f"{name} was {before.value:.9g} and is {now.value or math.nan:.9g} now")
    return sentences
