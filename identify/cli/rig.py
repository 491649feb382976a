"""`stickslip rig`: mass, stiffness and damping of a rig, with intervals, from short records of it."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identify.cli.common import (
    NOT_SUCCEEDED,
    Answer,
    CommandLineError,
    Terminal,
    add_log_options,
    log_options,
    new_file,
    quantity,
    share,
)

if TYPE_CHECKING:
    from data_io import Record
    from identify.bench.calibration import RigCalibration
    from identify.bench.records import Measured

NAME = "rig"
HELP = "mass, stiffness and damping of a rig, from taps and slow pulls (docs/measuring.md)"
KNOWN = {"mass": "kg", "stiffness": "N/m"}
SPEED_TOLERANCE, MASS_TOLERANCE = "1 %", "0.5 %"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("logs", nargs="*", metavar="LOG", help="taps that ring down, pulls or stick-slip on a block")
    parser.add_argument("--out", required=True, metavar="RIG.toml", help="the file to write; never overwritten")
    parser.add_argument(
        "--drive-speed",
        action="append",
        default=[],
        metavar="[LOG=]SPEED",
        help='where a log does not tell it: "1 mm/s"',
    )
    parser.add_argument(
        "--added-mass", action="append", default=[], metavar="LOG=MASS", help='fixed to the holder: "tap2.csv=50 g"'
    )
    parser.add_argument(
        "--skin", action="append", default=[], metavar="LOG", help="one more log: a stick on skin, not on the block"
    )
    parser.add_argument(
        "--known", action="append", default=[], metavar="NAME=VALUE±ERROR", help='such as mass="180 g ± 2 g"'
    )
    parser.add_argument(
        "--speed-tolerance", default=SPEED_TOLERANCE, metavar="SHARE", help="of the drive speed (default: 1 %%)"
    )
    parser.add_argument(
        "--mass-tolerance", default=MASS_TOLERANCE, metavar="SHARE", help="of added masses (default: 0.5 %%)"
    )
    add_log_options(parser)


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Measure, combine and write.

    Raises:
        CommandLineError, IdentifyError, LogError, OSError: one sentence each.
    """
    out = new_file(arguments.out, "--out", "your edits")

    from data_io.atomic import atomic_write
    from identify.base.wording import wrapped
    from identify.bench.calibration import calibrated
    from identify.bench.rig_file import NAMED, REMEDIES, disagreement, rig_toml, shown

    measured = [*_measured(arguments), *(_known(text) for text in arguments.known)]
    tolerances = [share(arguments.speed_tolerance, "--speed-tolerance", 1.0)]
    tolerances.append(share(arguments.mass_tolerance, "--mass-tolerance", 1.0))
    rig = calibrated(measured, *tolerances)
    for words in dict.fromkeys(m.source for m in measured):
        terminal.say(wrapped(words))
    told = {name: getattr(rig, name) for name in NAMED if getattr(rig, name) is not None}
    for name, found in told.items():
        terminal.say(f"  {NAMED[name]:15s} {shown(name, found)}")
    if disagreement(rig):
        terminal.say(wrapped(disagreement(rig)))
    for name in rig.missing:
        terminal.say(wrapped(f"{NAMED[name]}: these records do not tell it; give {REMEDIES[name]}"))
    if not told:
        return Answer(NOT_SUCCEEDED, _document(rig, measured) | {"status": "nothing_told"})
    with atomic_write(out) as handle:
        handle.write(rig_toml(rig, measured))
    terminal.say(f'{out}: written; in a scene, in place of [rig]: rig = "{out.name}"')
    return Answer(document=_document(rig, measured) | {"status": "done", "out": str(out)})


def _measured(arguments: Namespace) -> list[Measured]:
    """What each log tells, told by its kind: it rings down, or it rises at stiffness times drive speed."""
    from identify.bench.records import rings, sticks

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
        speed = quantity(speeds[log], "m/s", f"--drive-speed {log}") if log in speeds else None
        found = [] if log in skins else rings(record, log.name, mass)
        if log in added and not found:
            raise CommandLineError(f"{log} has an added mass and no tap that rings down; expected one: record it again")
        out += found or sticks(record, log, None if speed is None else abs(speed), log in skins)
    return out


def _read(log: Path, arguments: Namespace) -> Record:
    """The log; a record without a normal force does as well, the rig is known without it.

    Raises:
        LogError: one sentence.
    """
    from data_io import LogError, read_log

    options = log_options(arguments)
    try:
        return read_log(log, **options)
    except LogError:
        if options["normal_force"] is not None:
            raise
        with_load = read_log(log, **{**options, "normal_force": 1.0})
        if any(finding.code == "friction_from_coefficient" for finding in with_load.findings):
            raise  # then the force is not known without the load
        return with_load


def _by_log(items: Sequence[str], option: str, logs: Sequence[Path]) -> Mapping[Path, str]:
    """ "LOG=VALUE" by log, named by its path or its file name; "*" is every log that is not named.

    Raises:
        CommandLineError: no such log.
    """
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
    """A quantity that was measured otherwise, "mass=180 g ± 2 g".

    Raises:
        CommandLineError: no such quantity, or no error.
    """
    from identify.bench.records import Measured

    name, _, said = text.partition("=")
    value, sign, error = said.replace("+-", "±").replace("+/-", "±").partition("±")
    if name.strip() not in KNOWN or not sign:
        raise CommandLineError(f'--known is {text!r}; expected mass or stiffness with its error: mass="180 g ± 2 g"')
    kind = name.strip()
    known = quantity(value.strip(), KNOWN[kind], "--known")
    relative = share(error, "--known", 1.0) if "%" in error else quantity(error.strip(), KNOWN[kind], "--known") / known
    if not (known > 0.0 and relative > 0.0):
        raise CommandLineError(f"--known is {text!r}; expected a positive value and error: correct it")
    return Measured(kind, known, relative, f"{kind} known as {said.strip()}")


def _document(rig: RigCalibration, measured: Sequence[Measured]) -> dict[str, Any]:
    """What --json prints, SI."""
    values = {name: getattr(rig, name) for name in ("mass", "stiffness", "zeta", "skin_stiffness")}
    return {
        **{
            name: None
            if found is None
            else {"value": found.value, "tolerance": found.tolerance, "interval": list(found.interval)}
            for name, found in values.items()
        },
        "to_fill_in": list(rig.missing),
        "agreement": asdict(rig.agreement),
        "measured": [
            {"kind": m.kind, "value": m.value, "relative_error": m.error, "added_mass": m.added, "source": m.source}
            for m in measured
        ],
    }
