"""`stickslip fit`: identify the parameters from all the logs together, and write the report."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from identify.cli.common import (
    DONE,
    NOT_SUCCEEDED,
    Answer,
    CommandLineError,
    Terminal,
    add_log_options,
    file_to_write,
    log_options,
    quantity,
)

if TYPE_CHECKING:
    from identify.estimation.starts import Sources
    from identify.report.finished import Fit
    from identify.scene import Scene
    from identify.shooting.accuracy import FitOptions

NAME = "fit"
HELP = "identify the friction parameters from all the logs together, and write a report"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("logs", nargs="*", metavar="LOG", help="choose among the scene's logs, or add one to them")
    parser.add_argument("--scene", required=True, metavar="SCENE.toml", help="rig, parameters and logs")
    parser.add_argument("--out", metavar="DIR", help="folder of the result (default: stickslip-<scene name>)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help='such as rig.mass="0.3 kg"')
    add_depth_options(parser)
    add_log_options(parser)


def add_depth_options(parser: ArgumentParser) -> None:
    """The options that ask for more than values and intervals, or for less."""
    group = parser.add_argument_group("how finely, and how sure")
    group.add_argument("--preview", action="store_true", help="draw the cycles and the start over the data, and stop")
    group.add_argument(
        "--accuracy", metavar="X", help="coarse, default, tight, or the error of the steps in standard errors"
    )
    group.add_argument(
        "--time-limit", metavar="T", help="of the search and its examination (default: [fit] time_limit, or 60 s)"
    )
    group.add_argument(
        "--starts",
        choices=("data", "user", "both"),
        help="where the search starts: from the data, from the scene's start values, or both (default: both where the "
        "scene gives a start, else data)",
    )
    group.add_argument("--profile", action="store_true", help="profile likelihood of every parameter")
    group.add_argument("--bootstrap", type=int, metavar="N", help="cycle-block bootstrap with N replicates")
    group.add_argument("--accuracy-table", action="store_true", help="what each level of accuracy costs and changes")


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Fit and write the report; exit code 3 unless the fit converged.

    Raises:
        CommandLineError, SceneError, FitError, LogError, OSError: one sentence each.
    """
    from identify.cli.folder import check_replaceable

    scene = scene_of(arguments)
    check_logs(scene)
    out = Path(arguments.out or f"stickslip-{scene.name}")
    asked = asked_of(arguments)
    if arguments.preview:
        return run_preview(scene, out, terminal)
    check_replaceable(out)
    fit = fit_and_report(scene, out, terminal, asked, arguments.starts)
    return Answer(DONE if fit.converged else NOT_SUCCEEDED, fit.result)


def asked_of(arguments: Namespace) -> FitOptions:
    """What the command line asks of a fit beyond its values.

    Raises:
        CommandLineError, FitError: an accuracy or a number of replicates that cannot be.
    """
    from identify.estimation.bootstrap import FEWEST
    from identify.shooting.accuracy import DEFAULT, FitOptions, accuracy_of

    replicates = arguments.bootstrap or 0
    if arguments.bootstrap is not None and replicates < FEWEST:
        raise CommandLineError(
            f"--bootstrap {arguments.bootstrap} is too few for an interval; expected {FEWEST} replicates or more: "
            "200 is usual"
        )
    return FitOptions(
        accuracy=DEFAULT if arguments.accuracy is None else accuracy_of(arguments.accuracy),
        profile=arguments.profile,
        bootstrap=replicates,
        accuracy_table=arguments.accuracy_table,
    )


def scene_of(arguments: Namespace) -> Scene:
    """The scene with the logs and the reading options of the command line.

    Raises:
        SceneError, CommandLineError: one sentence each.
    """
    from identify.scene import LogEntry, Scene

    options = {key: value for key, value in log_options(arguments).items() if value is not None}
    if "normal_force" in options:
        options["normal_force"] = quantity(options["normal_force"], "N", "--normal-force")
    if "rate" in options:
        options["rate"] = quantity(options["rate"], "Hz", "--rate")
    limit = [f"fit.time_limit={arguments.time_limit!r}"] if arguments.time_limit else []
    scene = Scene.from_toml(arguments.scene, [*arguments.set, *limit])
    for log in arguments.logs:
        if Path(log).is_dir():
            check_there(Path(log))
    scene = scene.choose([Path(log) for log in arguments.logs], LogEntry(Path()))
    return replace(scene, logs=tuple(replace(entry, **options) for entry in scene.logs))


def check_logs(scene: Scene) -> None:
    """Refuse no log at all, or one that is not there, before the first one is read.

    Raises:
        CommandLineError: no log, or no such file.
    """
    if not scene.logs:
        raise CommandLineError(f"{scene.source} lists no log and none was given; name a LOG, or add [[logs]] to it")
    for entry in scene.logs:
        check_there(entry.path)


def check_there(path: Path) -> None:
    """Refuse a log that is not there.

    Raises:
        CommandLineError: no such file, or a folder without logs.
    """
    from data_io.contents import log_is_at

    if log_is_at(path):
        return
    if path.is_dir():
        raise CommandLineError(f"{path} is a folder that holds no log; expected a log or a folder of them: name a file")
    raise CommandLineError(f"{path}: there is no such log; check its path in the scene, or put it there")


def fit_and_report(
    scene: Scene, out: Path, terminal: Terminal, asked: FitOptions | None = None, starts: Sources | None = None
) -> Fit:
    """Fit a scene with progress, write its folder whole, say the summary."""
    from identify.base.compiled import keep
    from identify.cli.folder import result_folder, stamp
    from identify.cli.progress import Progress
    from identify.identification import fit
    from identify.report import write_report
    from identify.report.summary import summary
    from identify.shooting.accuracy import DEFAULT_OPTIONS

    before = stamp(out)
    with Progress(terminal.notes, terminal.progress) as progress:
        outcome = fit(scene, progress=progress, starts=starts, asked=asked or DEFAULT_OPTIONS)
        with result_folder(out, since=before) as folder:
            progress("writing the report")
            write_report(outcome, folder)
    keep()  # the next fit of this kind finds its functions compiled
    terminal.say(summary(outcome.typed))
    terminal.say(f"report: {out / 'report.html'}")
    return outcome


# ----------------------------------------------------------------------------------------------------------------------
# fit --preview: the detected cycles and the start trajectory over the data, before anything is fitted.
# ----------------------------------------------------------------------------------------------------------------------


def preview_file(out: Path) -> Path:
    """The picture stands beside the folder of the result: "DIR-preview.png".

    Raises:
        CommandLineError: it cannot be written there.
    """
    return file_to_write(str(out.parent / f"{out.name}-preview.png"), "--preview")


def run_preview(scene: Scene, out: Path, terminal: Terminal) -> Answer:
    """Draw and say what a fit would start from.

    Raises:
        SceneError, FitError, LogError, CommandLineError, OSError: one sentence each.
    """
    from data_io.atomic import atomic_path
    from identify.base.wording import columns, quantity, wrapped
    from identify.cli.progress import Progress
    from identify.diagnosis.selection import LOOKED_AT
    from identify.estimation.preview import preview
    from identify.logs.scene_records import with_drives, with_records
    from identify.report.figures import draw_preview
    from identify.report.style import drawing_style
    from identify.scene.variant import scene_with

    file = preview_file(out)
    with Progress(terminal.notes, terminal.progress) as progress:
        progress("reading the logs", 0.0)
        scene, drives = with_drives(scene)
        scene, records = with_records(scene, None)
        if scene.effects == "auto":
            scene = scene_with(scene, LOOKED_AT, {})
        progress("finding a start", 0.3)
        seen = preview(scene, records)
        progress("drawing", 0.8)
        with drawing_style(), atomic_path(file) as temporary:
            draw_preview(seen).savefig(temporary, format="png", dpi=130)
    for sentence in (*seen.notices, *drives):
        terminal.say(wrapped(sentence))
    for log in seen.logs:
        terminal.say(wrapped(f"{log.name}: {log.told}"))
    terminal.say(f"the start: {seen.source}")
    rows = [["", "value"], *([name, quantity(value, seen.units[name])] for name, value in seen.parameters.items())]
    terminal.say(columns(rows))
    terminal.say(f"picture: {file}")
    return Answer(
        document={
            "status": "preview",
            "message": "nothing was fitted; the picture shows the cycles detected and the start over the data",
            "picture": str(file),
            "source": seen.source,
            "start": {name: {"value": v, "unit": seen.units[name]} for name, v in seen.parameters.items()},
            "logs": [{"name": log.name, "cycles": int(log.onset.size), "text": log.told} for log in seen.logs],
        }
    )
