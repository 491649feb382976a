"""`stickslip plan`: what logs at hand can tell, and which to record next, before they are recorded."""

from __future__ import annotations

import math
from argparse import ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from identify.cli.common import NOT_SUCCEEDED, Answer, CommandLineError, Terminal, file_to_write, positives, share

if TYPE_CHECKING:
    from identify.bench.plan import Choices, RecordingPlan

NAME = "plan"
HELP = "which few logs to record next, what they will tell, and what a wrong rig would do (docs/planning.md)"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("source", nargs="?", metavar="SCENE.toml|result.json", help="a scene, or a fit")
    parser.add_argument("--budget", default="15 min", metavar="T", help='for all logs together (default: "15 min")')
    parser.add_argument(
        "--for", dest="asked", metavar="NAME,…", help="parameters to be told (default: all of friction)"
    )
    parser.add_argument("--out", metavar="STEPS.csv", help="the step programme as a table, to type into a script")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help='such as rig.mass="0.3 kg"')
    people = parser.add_argument_group("two materials on people: how many cycles and volunteers (needs no scene)")
    people.add_argument("--difference", metavar="SHARE", help='of their strength, that is to be seen: "15 %%"')
    people.add_argument("--scatter", default="20 %", metavar="SHARE", help="from stick to stick (default: 20 %%)")
    people.add_argument("--between", default="20 %", metavar="SHARE", help="from person to person (default: 20 %%)")
    people.add_argument("--response", default="10 %", metavar="SHARE", help="of a person's difference (default: 10 %%)")
    group = parser.add_argument_group("what can be set at the rig; lists with commas")
    group.add_argument("--speed", metavar="SPEEDS", help='"0.1 mm/s,1 mm/s" (default: dials around that of the scene)')
    group.add_argument("--hold", metavar="TIMES", help='of one log, "3 s,10 s,30 s" (default: two series are tried)')
    group.add_argument("--load", metavar="FORCES", help='"1 N,2 N" (default: that of the scene)')
    group.add_argument("--stiffness", metavar="SPRINGS", help='"500 N/m,1.5 N/mm" (default: that of the scene)')
    group.add_argument("--fastest", metavar="HZ", help='highest sampling rate there is, "100 Hz" (default: any)')
    group.add_argument("--noise", metavar="SD", help="of a sample (default: of the scene or its logs, else 0.5 %%)")
    group.add_argument("--load-error", metavar="SHARE", help="of the normal force in a cycle (default: 0.1 %%)")


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Rehearse, choose and say.

    Raises:
        CommandLineError, IdentifyError, LogError, OSError: one sentence each.
    """
    if arguments.difference is not None:
        return _people(arguments, terminal)
    if arguments.source is None:
        raise CommandLineError('plan needs a scene or a result.json, or --difference "15 %" for volunteers; give one')
    out = None if arguments.out is None else file_to_write(arguments.out, "--out")
    choices = _choices(arguments)

    from data_io.atomic import atomic_write
    from identify.bench.plan_words import plan_document, said, stated_drives, step_table

    made = _planned(arguments, choices)
    terminal.say(said(made))
    document = plan_document(made)
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


def _people(arguments: Namespace, terminal: Terminal) -> Answer:
    """How many cycles and volunteers tell two materials apart.

    Raises:
        CommandLineError, IdentifyError: one sentence each.
    """
    from identify.base.wording import wrapped
    from identify.bench.power import CHANCE, TwoMaterials, cycles_needed

    names = ("difference", "scatter", "between", "response")
    difference, scatter, between, response = (share(getattr(arguments, name), f"--{name}") for name in names)
    cycles = cycles_needed(scatter, 0.1)
    paired, groups = (
        TwoMaterials(math.log1p(difference), scatter, between, response, cycles, way).volunteers()
        for way in (True, False)
    )
    few = cycles_needed(scatter, 0.05)
    terminal.say(
        wrapped(
            f"sticks that scatter by {100 * scatter:.3g} %: {cycles} cycles tell the mean strength to ± 10 %, "
            f"{few} to ± 5 %, in two logs or more, so that one bad log is seen"
        )
    )
    told = [f"{n} volunteers" if n else "more than 1000 volunteers" for n in (paired, groups)]
    terminal.say(
        wrapped(
            f"two materials that differ by {100 * difference:.3g} %, {cycles} cycles each: {told[0]} who try both, or "
            f"{told[1]} for each material, tell them apart in {100 * CHANCE:.0f} of 100 studies"
        )
    )
    return Answer(document={"status": "done", "cycles": cycles, "volunteers": {"paired": paired, "groups": groups}})


def _planned(arguments: Namespace, choices: Choices) -> RecordingPlan:
    """The plan of a scene, with what its logs are expected to tell, or of a fit.

    Raises:
        CommandLineError: a fit that did not converge.
    """
    import numpy as np

    from identify.bench.plan import plan
    from identify.logs.prepared_scene import prepare_scene
    from identify.logs.scene_records import with_records
    from identify.prediction.sources import pair_of
    from identify.report.stored_result import read_result, scene_of
    from identify.scene import Scene

    if not arguments.source.lower().endswith(".json"):
        scene = Scene.from_toml(arguments.source, arguments.set)
        if not scene.logs:
            return plan(scene, (), choices)
        made = prepare_scene(*with_records(scene, None))
        return plan(made.scene, [log for log in made.logs if log.left_out is None], choices)
    result = read_result(Path(arguments.source))
    scene = scene_of(result, arguments.source)
    if not result.converged:
        raise CommandLineError(f"{arguments.source} tells no pair ({result.message}); plan from the scene instead")
    pair = pair_of(result, scene, 0)
    if pair.untold:
        raise CommandLineError(f"{arguments.source}: {pair.untold}; plan from a scene instead")
    loads = [log.normal_force_N for log in result.logs if log.normal_force_N]
    if loads and not choices.loads:
        choices = replace(choices, loads=(float(np.median(loads)),))
    return plan(scene, (), choices, pair)


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
        noise=one(arguments.noise, "N", "--noise"),
        load_error=None if arguments.load_error is None else share(arguments.load_error, "--load-error"),
        asked=tuple(name.strip() for name in (arguments.asked or "").split(",") if name.strip()),
        budget=one(arguments.budget, "s", "--budget") or 0.0,
    )
