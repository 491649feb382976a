"""`stickslip plan`: what logs at hand can tell, and which to record next, before they are recorded."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from identify.base.errors import IdentifyError
from identify.cli.common import NOT_SUCCEEDED, Answer, CommandLineError, Terminal, file_to_write, positives

if TYPE_CHECKING:
    from identify.base.result import Result
    from identify.bench.plan import Choices, RecordingPlan
    from identify.scene import Scene

NAME = "plan"
HELP = "which few logs to record next, and what they will tell (docs/planning.md)"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("source", metavar="SCENE.toml|result.json", help="a scene, or a fit")
    parser.add_argument("--budget", default="15 min", metavar="T", help='for all logs together (default: "15 min")')
    parser.add_argument(
        "--for", dest="targets", metavar="NAME,…", help="parameters to be told (default: all of friction)"
    )
    parser.add_argument("--out", metavar="STEPS.csv", help="the step programme as a table, to type into a script")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help='such as rig.mass="0.3 kg"')
    group = parser.add_argument_group("what can be set at the rig; lists with commas")
    group.add_argument("--speed", metavar="SPEEDS", help='"0.1 mm/s,1 mm/s" (default: dials around that of the scene)')
    group.add_argument("--hold", metavar="TIMES", help='of one log, "3 s,10 s,30 s" (default: two series are tried)')
    group.add_argument("--load", metavar="FORCES", help='"1 N,2 N" (default: that of the scene)')
    group.add_argument("--stiffness", metavar="SPRINGS", help='"500 N/m,1.5 N/mm" (default: that of the scene)')
    group.add_argument("--fastest", metavar="HZ", help='highest sampling rate there is, "100 Hz" (default: any)')


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Simulate designs, choose and say.

    Raises:
        CommandLineError, IdentifyError, LogError, OSError: one sentence each.
    """
    out = None if arguments.out is None else file_to_write(arguments.out, "--out")
    choices = _choices(arguments)

    from data_io.atomic import atomic_write
    from identify.bench.plan_words import plan_document, plan_text, stated_drives, step_table

    made, source, existing = _planned(arguments, choices)
    terminal.say(plan_text(made, source))
    document = plan_document(made) | {"source": source} | ({"existing_result": str(existing)} if existing else {})
    if out is not None and made.logs:
        with atomic_write(out) as handle:
            handle.write(step_table(made))
        terminal.say(
            f"{out}: the step programme, {len(made.logs)} log(s); in the scene of their fit, one [[logs]] each:"
        )
        terminal.say(stated_drives(made))
        document["out"] = str(out)
    enough = bool(made.logs) or all(v == "identified" for v in document["verdicts"].values())
    return Answer(0 if enough else NOT_SUCCEEDED, {"status": "done" if enough else "nothing_to_add", **document})


def _planned(arguments: Namespace, choices: Choices) -> tuple[RecordingPlan, str, Path | None]:
    """The plan of a fit, or of a scene with what its logs are expected to tell; what it is of, in a sentence; and the
    result that stands beside the scene.

    A fit of the scene as it stands takes the place of its values.

    Raises:
        CommandLineError: a fit that did not converge.
    """
    from identify.bench.plan import plan
    from identify.logs.prepared_scene import prepare_scene
    from identify.logs.scene_records import with_records
    from identify.prediction.sources import existing_result
    from identify.report.stored_result import read_result, scene_of
    from identify.scene import Scene

    if arguments.source.lower().endswith(".json"):
        result = read_result(Path(arguments.source))
        if not result.converged:
            raise CommandLineError(f"{arguments.source} tells no pair ({result.message}); plan from the scene instead")
        return plan(scene_of(result, arguments.source), (), choices, result), "", None
    scene, source = Scene.from_toml(arguments.source, arguments.set), ""
    path = existing_result(scene)
    if path is not None:
        try:
            result = read_result(path)
            fitted = scene_of(result, path)
            why = _why_unused(result, fitted, scene)
        except IdentifyError as error:  # no result, or one of another version
            why = str(error)
        if not why:
            if scene.rig.normal_force and not choices.loads:
                choices = replace(choices, loads=(scene.rig.normal_force,))
            made = plan(replace(fitted, rig=scene.rig), (), choices, result)
            return made, f"From the fit of this scene in {path}.", path
        source = f"The fit in {path} is not used: {why}."
    if not scene.logs:
        return plan(scene, (), choices), source, path
    prepared = prepare_scene(*with_records(scene, None))
    logs = [log for log in prepared.logs if log.left_out is None]
    source = (
        source or "The logs of this scene are not fitted yet: fit them first, and the plan starts from their result."
    )
    return plan(prepared.scene, logs, choices), source, path


def _why_unused(result: Result, fitted: Scene, scene: Scene) -> str:
    """Why a fit does not stand for a scene, "" where it does; speed and load of [rig] may be those of the next log."""
    from identify.prediction.sources import pair_of

    if not result.converged:
        return f"it did not converge ({result.status})"
    if untold := pair_of(result, fitted, 0).untold:
        return untold
    stated, known = scene.as_document(), fitted.as_document()
    for key in ("drive_speed", "normal_force"):
        stated["rig"].pop(key, None)
        known["rig"].pop(key, None)
    if scene.effects == "auto":  # the fit has chosen them, and names every parameter of theirs
        named = {name: said for name, said in known["parameters"].items() if name in stated["parameters"]}
        known |= {"effects": "auto", "parameters": named}
    same = {**stated, "fit": None} == {**known, "fit": None}
    return "" if same else "it is of another state of this scene; plan that file to use it"


def _choices(arguments: Namespace) -> Choices:
    from identify.bench.plan import Choices

    def one(text: str | None, unit: str, option: str) -> float | None:
        return next(iter(positives(text, unit, option)), None)

    return Choices(
        speeds=positives(arguments.speed, "m/s", "--speed"),
        holds=positives(arguments.hold, "s", "--hold"),
        loads=positives(arguments.load, "N", "--load"),
        stiffnesses=positives(arguments.stiffness, "N/m", "--stiffness"),
        fastest=one(arguments.fastest, "Hz", "--fastest") or float("inf"),
        targets=tuple(name.strip() for name in (arguments.targets or "").split(",") if name.strip()),
        budget=one(arguments.budget, "s", "--budget") or 0.0,
    )
