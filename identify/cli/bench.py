"""`stickslip rig` and `plan`: mass, stiffness and damping of a rig from short records; which logs to record next."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from identify.base.errors import IdentifyError
from identify.cli.common import (
    DONE,
    NOT_SUCCEEDED,
    SET,
    Answer,
    Command,
    CommandLineError,
    Terminal,
    add_log_options,
    add_options,
    file_to_write,
    listed,
    log_options,
    new_file,
    positives,
    quantity,
    share,
)

if TYPE_CHECKING:
    from data_io import Record
    from identify.base.result import Result
    from identify.bench.plan import Choices, RecordingPlan
    from identify.bench.rig import Measured
    from identify.scene import Scene

KNOWN = {"mass": "kg", "stiffness": "N/m"}
SPEED_TOLERANCE, MASS_TOLERANCE = 0.01, 0.005  # of drive speeds and of added masses, relative


def _rig_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("logs", nargs="*", metavar="LOG", help="taps that ring down, pulls or stick-slip on a block")
    options = {
        "--out RIG.toml": "the file to write; never overwritten",
        "--drive-speed [LOG=]SPEED+": 'where a log does not tell it: "1 mm/s"',
        "--added-mass LOG=MASS+": 'fixed to the holder: "tap2.csv=50 g"',
        "--skin LOG+": "one more log: a stick on skin, not on the block",
        "--known NAME=VALUE±ERROR+": 'such as mass="180 g ± 2 g"',
    }
    add_options(parser, options, ["--out"])
    add_log_options(parser)


def _rig(arguments: Namespace, terminal: Terminal) -> Answer:
    """Measure, combine and write."""
    out = new_file(arguments.out, "--out", "your edits")

    from data_io.atomic import atomic_write
    from identify.base.wording import wrapped
    from identify.bench.rig import NAMED, REMEDIES, calibrated, disagreement, rig_toml, shown

    measured = [*_measured(arguments), *(_known(text) for text in arguments.known)]
    rig = calibrated(measured, SPEED_TOLERANCE, MASS_TOLERANCE)
    for words in dict.fromkeys(m.source for m in measured):
        terminal.say(wrapped(words))
    values = {name: value for name in NAMED if (value := getattr(rig, name)) is not None}
    for name, value in values.items():
        terminal.say(f"  {NAMED[name]:15s} {shown(name, value)}")
    if disagreement(rig):
        terminal.say(wrapped(disagreement(rig)))
    for name in rig.missing:
        terminal.say(wrapped(f"{NAMED[name]}: these records do not tell it; give {REMEDIES[name]}"))
    if values:
        with atomic_write(out) as handle:
            handle.write(rig_toml(rig, measured))
        terminal.say(f'{out}: written; in a scene, in place of [rig]: rig = "{out.name}"')
    document: dict[str, object] = dict.fromkeys(("mass", "stiffness", "zeta", "skin_stiffness"))
    for name in document:
        if (value := getattr(rig, name)) is not None:
            document[name] = {"value": value.value, "tolerance": value.tolerance, "interval": list(value.interval)}
    document |= {
        "to_fill_in": list(rig.missing),
        "agreement": asdict(rig.agreement),
        "measured": [
            {"kind": m.kind, "value": m.value, "relative_error": m.error, "added_mass": m.added, "source": m.source}
            for m in measured
        ],
        **({"status": "done", "out": str(out)} if values else {"status": "nothing_told"}),
    }
    return Answer(DONE if values else NOT_SUCCEEDED, document)


def _measured(arguments: Namespace) -> list[Measured]:
    """What each log tells, by its kind: it rings down, or it rises at stiffness times drive speed."""
    from identify.bench.rig import rings, sticks

    logs = [Path(log) for log in arguments.logs]
    logs += [Path(skin) for skin in arguments.skin if Path(skin).name not in {log.name for log in logs}]
    speeds = _by_log([text if "=" in text else f"*={text}" for text in arguments.drive_speed], "--drive-speed", logs)
    added = _by_log(arguments.added_mass, "--added-mass", logs)
    skins = _by_log([f"{log}=" for log in arguments.skin], "--skin", logs)
    out: list[Measured] = []
    for log in logs:
        record = _read(log, arguments)
        mass = quantity(added[log], "kg", f"--added-mass {log}") if log in added else 0.0
        if not mass >= 0.0:
            raise CommandLineError(f"--added-mass {log} is {mass:g} kg; expected a positive mass: correct it")
        speed = abs(quantity(speeds[log], "m/s", f"--drive-speed {log}")) if log in speeds else None
        taps = [] if log in skins else rings(record, log.name, mass)
        if log in added and not taps:
            raise CommandLineError(f"{log} has an added mass and no tap that rings down; expected one: record it again")
        out += taps or sticks(record, log, speed, log in skins)
    return out


def _read(log: Path, arguments: Namespace) -> Record:
    """The log; a record without a normal force does as well, the rig is known without it."""
    from data_io import LogError, read_log

    options = log_options(arguments)
    try:
        return read_log(log, **options)
    except LogError:
        if "normal_force" in options:
            raise
        record = read_log(log, **options, normal_force=1.0)
        if any(finding.code == "friction_from_coefficient" for finding in record.findings):
            raise  # then the force is not known without the load
        return record


def _by_log(items: Sequence[str], option: str, logs: Sequence[Path]) -> Mapping[Path, str]:
    """ "LOG=VALUE" by log, named by its path or its file name; "*" is every log that is not named."""
    out: dict[Path, str] = {}
    for item in sorted(items, key=lambda item: not item.startswith("*=")):
        name, equals, value = item.rpartition("=")
        mine = [log for log in logs if name in ("*", str(log), log.name)]
        if not mine or not equals:
            raise CommandLineError(
                f"{option} {item!r} names none of the logs ({', '.join(map(str, logs))}); expected LOG=VALUE"
            )
        out |= dict.fromkeys(mine, value.strip())
    return out


def _known(text: str) -> Measured:
    """A quantity that was measured otherwise, "mass=180 g ± 2 g"."""
    from identify.bench.rig import Measured

    name, _, stated = text.partition("=")
    value, sign, error = stated.replace("+-", "±").replace("+/-", "±").partition("±")
    kind = name.strip()
    if kind not in KNOWN or not sign:
        raise CommandLineError(f'--known is {text!r}; expected mass or stiffness with its error: mass="180 g ± 2 g"')
    known = quantity(value.strip(), KNOWN[kind], "--known")
    relative = share(error, "--known", 1.0) if "%" in error else quantity(error.strip(), KNOWN[kind], "--known") / known
    if not (known > 0.0 and relative > 0.0):
        raise CommandLineError(f"--known is {text!r}; expected a positive value and error: correct it")
    return Measured(kind, known, relative, f"{kind} known as {stated.strip()}")


# ----------------------------------------------------------------------------------------------------------------------
# plan
# ----------------------------------------------------------------------------------------------------------------------


def _plan_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("source", metavar="SCENE.toml|result.json", help="a scene, or a fit")
    options = {
        "--budget T": 'for all logs together (default: "15 min")',
        "--for NAME,…": "parameters to be told (default: all of friction)",
        "--out STEPS.csv": "the step programme as a table, to type into a script",
        **SET,
    }
    add_options(parser, options, defaults={"--budget": "15 min"})
    choices = {
        "--speed SPEEDS": '"0.1 mm/s,1 mm/s" (default: dials around that of the scene)',
        "--load FORCES": '"1 N,2 N" (default: that of the scene)',
        "--stiffness SPRINGS": '"500 N/m,1.5 N/mm" (default: that of the scene)',
        "--fastest HZ": 'highest sampling rate there is, "100 Hz" (default: any)',
    }
    add_options(parser.add_argument_group("what can be set at the rig; lists with commas"), choices)


def _plan(arguments: Namespace, terminal: Terminal) -> Answer:
    """Simulate designs, choose and say."""
    out = None if arguments.out is None else file_to_write(arguments.out, "--out")

    from data_io.atomic import atomic_write
    from identify.bench.plan import Choices, plan_document, plan_text, step_table

    choices = Choices(
        speeds=positives(arguments.speed, "m/s", "--speed"),
        loads=positives(arguments.load, "N", "--load"),
        stiffnesses=positives(arguments.stiffness, "N/m", "--stiffness"),
        fastest=next(iter(positives(arguments.fastest, "Hz", "--fastest")), float("inf")),
        targets=listed(getattr(arguments, "for")),
        budget=next(iter(positives(arguments.budget, "s", "--budget")), 0.0),
    )
    made, source, existing = _planned(arguments, choices)
    terminal.say(plan_text(made, source))
    document = plan_document(made) | {"source": source} | ({"existing_result": str(existing)} if existing else {})
    if out is not None and made.logs:
        with atomic_write(out) as handle:
            handle.write(step_table(made))
        terminal.say(f"{out}: the step programme, {len(made.logs)} log(s), one [[logs]] each in the scene of their fit")
        document["out"] = str(out)
    enough = bool(made.logs) or all(v == "identified" for v in document["verdicts"].values())
    status = {"status": "done" if enough else "nothing_to_add"}
    return Answer(DONE if enough else NOT_SUCCEEDED, status | document)


def _planned(arguments: Namespace, choices: Choices) -> tuple[RecordingPlan, str, Path | None]:
    """The plan of a fit, or of a scene with what its logs are expected to tell; what it is of, in a sentence; and the
    result that stands beside the scene: a fit of the scene as it stands takes the place of its values."""
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
    unfitted = "The logs of this scene are not fitted yet: fit them first, and the plan starts from their result."
    return plan(prepared.scene, logs, choices), source or unfitted, path


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
        named = {name: table for name, table in known["parameters"].items() if name in stated["parameters"]}
        known |= {"effects": "auto", "parameters": named}
    same = {**stated, "fit": None} == {**known, "fit": None}
    return "" if same else "it is of another state of this scene; plan that file to use it"


RIG = "mass, stiffness and damping of a rig, from taps and slow pulls (docs/measuring.md)"
PLAN = "which few logs to record next, and what they will tell (docs/planning.md)"
COMMANDS = (Command("rig", RIG, _rig_arguments, _rig), Command("plan", PLAN, _plan_arguments, _plan))
