"""`stickslip rig` and `plan`: mass, stiffness and damping of a rig from short records; which logs to record next."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from data_io import LogError, read_log
from data_io.atomic import atomic_write
from identify.base.wording import wrapped
from identify.bench.plan import Choices, plan_document, plan_text, step_table
from identify.bench.plan import plan as planned
from identify.bench.rig import NAMED, REMEDIES, Measured, calibrated, disagreement, rig_toml, rings, shown, sticks
from identify.cli.arguments import file_to_write, listed, log_options, new_file, positive, positives
from identify.cli.common import Answer, CommandLineError, Terminal
from identify.logs.scene_records import prepare_scene, with_records
from identify.prediction.sources import existing_result
from identify.report.stored_result import read_result, scene_of
from identify.scene import Scene
from identify.scene.tables import NOT_NEGATIVE, Key, check, quantity

KNOWN = {"mass": "kg", "stiffness": "N/m"}
SPEED_TOLERANCE, MASS_TOLERANCE = 0.01, 0.005  # of drive speeds and of added masses, relative


def rig(arguments: Namespace, terminal: Terminal) -> Answer:
    """Measure, combine and write."""
    out = new_file(arguments.out, "your edits")
    measured = [*_measured(arguments), *(_known(text) for text in arguments.known)]
    result = calibrated(measured, SPEED_TOLERANCE, MASS_TOLERANCE)
    for words in dict.fromkeys(m.source for m in measured):
        terminal.say(wrapped(words))
    values = {name: value for name in NAMED if (value := getattr(result, name)) is not None}
    for name, value in values.items():
        terminal.say(f"  {NAMED[name]:15s} {shown(name, value)}")
    if disagreement(result):
        terminal.say(wrapped(disagreement(result)))
    for name in result.missing:
        terminal.say(wrapped(f"{NAMED[name]}: not identifiable from these records; give {REMEDIES[name]}"))
    if values:
        with atomic_write(out) as handle:
            handle.write(rig_toml(result, measured))
        terminal.say(f'{out}: written; in a scene, in place of [rig]: rig = "{out.name}"')
    known = {name: getattr(result, name) for name in ("mass", "stiffness", "zeta", "skin_stiffness")}
    document = {
        **{
            name: v and {"value": v.value, "tolerance": v.tolerance, "interval": list(v.interval)}
            for name, v in known.items()
        },
        "to_fill_in": list(result.missing),
        "agreement": asdict(result.agreement),
        "measured": [
            {"kind": m.kind, "value": m.value, "relative_error": m.error, "added_mass": m.added, "source": m.source}
            for m in measured
        ],
        **({"status": "done", "out": str(out)} if values else {"status": "nothing_told"}),
    }
    return Answer.of(bool(values), document)


def _measured(arguments: Namespace) -> list[Measured]:
    """What each log gives, by its kind: it rings down, or it rises at stiffness times drive speed."""
    logs = [Path(log) for log in arguments.logs]
    logs += [Path(skin) for skin in arguments.skin if Path(skin).name not in {log.name for log in logs}]
    speeds = _by_log([text if "=" in text else f"*={text}" for text in arguments.drive_speed], "--drive-speed", logs)
    added = _by_log(arguments.added_mass, "--added-mass", logs)
    skins = _by_log([f"{log}=" for log in arguments.skin], "--skin", logs)
    out: list[Measured] = []
    for log in logs:
        options = log_options(arguments)
        try:
            record = read_log(log, **options)
        except LogError:  # a record without a normal force does as well, the rig is known without it
            if "normal_force" in options:
                raise
            record = read_log(log, **options, normal_force=1.0)
            if any(finding.code == "friction_from_coefficient" for finding in record.findings):
                raise  # then the force is not known without the load
        mass = quantity(added[log], "kg", f"--added-mass {log}") if log in added else 0.0
        check(f"--added-mass {log}", Key("kg", sign=NOT_NEGATIVE), mass)
        speed = abs(quantity(speeds[log], "m/s", f"--drive-speed {log}")) if log in speeds else None
        taps = [] if log in skins else rings(record, log.name, mass)
        if log in added and not taps:
            raise CommandLineError(f"{log} has an added mass and no tap that rings down; expected one: record it again")
        out += taps or sticks(record, log, speed, log in skins)
    return out


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
    name, _, stated = text.partition("=")
    value, sign, error = stated.replace("+-", "±").replace("+/-", "±").partition("±")
    kind = name.strip()
    if kind not in KNOWN or not sign:
        raise CommandLineError(f'--known is {text!r}; expected mass or stiffness with its error: mass="180 g ± 2 g"')
    known = quantity(value.strip(), KNOWN[kind], "--known")
    unit, size = ("", 1.0) if "%" in error else (KNOWN[kind], known)
    relative = quantity(error.strip(), unit, "--known") / (size or 1.0)
    if not (known > 0.0 and 0.0 < relative < 1.0):
        raise CommandLineError(f"--known is {text!r}; expected a positive value and a smaller error: correct it")
    return Measured(kind, known, relative, f"{kind} known as {stated.strip()}")


def plan(arguments: Namespace, terminal: Terminal) -> Answer:
    """Simulate designs for a fit, or for a scene with what its logs are expected to identify; choose and say."""
    out = None if arguments.out is None else file_to_write(arguments.out, "--out")
    choices = Choices(
        speeds=positives(arguments.speed, "m/s", "--speed"),
        loads=positives(arguments.load, "N", "--load"),
        stiffnesses=positives(arguments.stiffness, "N/m", "--stiffness"),
        fastest=positive(arguments.fastest, "Hz", "--fastest") or float("inf"),
        targets=listed(getattr(arguments, "for")),
        budget=positive(arguments.budget, "s", "--budget") or Choices.budget,
        holds=not arguments.no_holds,
    )
    source, existing = "", None
    given = Path(arguments.source)
    if given.suffix.lower() == ".json" or given.is_dir():
        result = read_result(given)
        if not result.converged:
            raise CommandLineError(
                f"{arguments.source} has no identified pair ({result.message}); plan from the scene instead"
            )
        design = planned(scene_of(result, arguments.source), (), choices, result)
    else:
        scene = Scene.from_toml(arguments.source, arguments.set)
        existing = existing_result(scene)
        if existing is not None:
            source = f"A fit of this scene stands beside it: plan {existing} starts from its estimates."
        elif scene.logs:
            source = "The logs of this scene are not fitted yet: fit them first, and plan from the result."
        logs = []
        if scene.logs:
            prepared = prepare_scene(*with_records(scene, None))
            scene, logs = prepared.scene, [log for log in prepared.logs if log.left_out is None]
        design = planned(scene, logs, choices)
    terminal.say(plan_text(design, source))
    document = plan_document(design) | {"source": source} | ({"existing_result": str(existing)} if existing else {})
    if out is not None and design.logs:
        with atomic_write(out) as handle:
            handle.write(step_table(design))
        terminal.say(
            f"{out}: the step programme, {len(design.logs)} log(s), one [[logs]] each in the scene of their fit"
        )
        document["out"] = str(out)
    enough = bool(design.logs) or all(v == "identified" for v in document["verdicts"].values())
    status = {"status": "done" if enough else "nothing_to_add"}
    return Answer.of(enough, status | document)
