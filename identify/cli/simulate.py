"""`stickslip simulate`: run the model forward and write a log that the loaders read back."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from dataclasses import asdict
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Any

from identify.base.wording import speed_text
from identify.cli.common import (
    MEASURED,
    Answer,
    CommandLineError,
    Terminal,
    file_to_write,
    new_file,
    positive,
    quantity,
)

if TYPE_CHECKING:
    from identify.scene import Scene

NAME = "simulate"
HELP = "run the model of a scene or of a fit forward and write a log"
MOST_SAMPLES = 2e7  # half a gigabyte of columns


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--scene", metavar="SCENE.toml", help="the scene to simulate: fixed, else start, else default")
    source.add_argument(
        "--result",
        metavar="result.json",
        help="the estimates of a fit, with rig, speed and mean load of one of its logs",
    )
    parser.add_argument("--log", type=int, default=1, metavar="N", help="which log of the fit, from 1 (default: 1)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help='such as rig.mass="0.3 kg"')
    parser.add_argument("--duration", required=True, metavar="T", help="how long [s]")
    parser.add_argument("--rate", required=True, metavar="HZ", help="samples per second [Hz]")
    parser.add_argument("--noise", default="0", metavar="SD", help="standard deviation of white force noise [N]")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the noise (default 0)")
    parser.add_argument(
        "--accuracy",
        metavar="X",
        help="relative error of switch times and forces that is tolerated (default: an order below the noise)",
    )
    parser.add_argument(
        "--out", required=True, metavar="LOG.csv|LOG.h5", help="the log to write, over a simulated one at most"
    )


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Simulate and write.

    Raises:
        CommandLineError, SceneError, SimulationError, OSError: one sentence each.
    """
    out = file_to_write(arguments.out, "--out")
    if not _simulated(out):
        new_file(arguments.out, "--out", MEASURED)
    if out.suffix.lower() not in (".csv", ".h5", ".hdf5"):
        raise CommandLineError(f"--out {out} ends in {out.suffix!r}; expected .csv or .h5: rename it")
    duration, rate, noise, seed = _asked(arguments)
    accuracy = _accuracy(arguments.accuracy)

    import numpy as np

    from data_io import Record, write_csv, write_hdf5
    from identify.base.document import to_dict
    from identify.base.wording import wrapped
    from identify.diagnosis.effect_choice import choose_from_numbers, effects_result
    from identify.simulation.cost import cost
    from identify.simulation.simulate import simulate

    scene, words = _scene_of(arguments)
    choice = choose_from_numbers(scene) if scene.effects == "auto" else None
    if choice is not None:
        scene = scene.with_effects(choice.effects)
        terminal.say(f"effects by the numbers of the scene: {', '.join(choice.effects)}")
    since = process_time()
    motion = simulate(scene, duration, accuracy=accuracy, noise=noise or None).refined()
    spent = cost(scene, motion, process_time() - since)
    time = np.arange(int(duration * rate * (1 + 1e-12)) + 1) / rate
    samples = motion.sample(time)
    speed = scene.rig.drive_speed
    record = Record(
        time=time,
        normal_force=np.broadcast_to(samples["normal_force"], time.shape).copy(),
        friction_force=samples["force"] + np.random.default_rng(seed).normal(0.0, noise, time.size),
        drive_speed=speed if isinstance(speed, float) else None,
        metadata=_provenance(scene, duration, rate) | {"noise_N": noise, "seed": seed},
    )
    (write_csv if out.suffix.lower() == ".csv" else write_hdf5)(record, out)
    slips = motion.onsets.size
    terminal.say(wrapped(words or taken_by_default(scene)))
    terminal.say(f"{out}: {time.size} samples, {slips} slips, noise {noise:g} N (seed {seed}), simulated")
    document: dict[str, Any] = {"status": "done", "out": str(out), "rows": time.size, "slips": slips}
    document["parameters"] = dict(sorted(scene.values().items()))
    if motion.achieved is not None:
        found = {name: error if np.isfinite(error) else None for name, error in asdict(motion.achieved).items()}
        asked = motion.accuracy or 0.0
        terminal.say(f"asked for {asked:.2g}; {_words(found, asked)}; {', '.join(motion.methods) or 'no slip'}")
        terminal.say(wrapped(spent.text, ""))
        document["accuracy"] = {"asked": motion.accuracy, **found, "methods": list(motion.methods)}
        document["price"] = {
            "levels": [{"accuracy": level, "seconds": seconds} for level, seconds in spent.seconds.items()],
            "effects_s": spent.effects,
        }
    if choice is not None:
        document["effects"] = to_dict(effects_result(choice, auto=True))
    return Answer(document=document)


def _scene_of(arguments: Namespace) -> tuple[Scene, str]:
    """The scene to simulate, and what was taken of a fit, in words ("" of a scene file).

    Raises:
        SceneError, FitError, CommandLineError: one sentence each.
    """
    from identify.report.finished import Fit
    from identify.scene import Scene
    from identify.scene.toml import put

    if arguments.result is None:
        return Scene.from_toml(arguments.scene, arguments.set), ""
    fit = Fit.from_json(arguments.result)
    scene = fit.scene(arguments.log)
    document = scene.as_document()
    for override in arguments.set:
        put(document, override)
    scene = Scene.from_document(document)
    name, speed = fit.typed.logs[arguments.log - 1].name, scene.rig.drive_speed
    drive = speed_text(speed) if isinstance(speed, float) else "the programme of the log"
    return (
        scene,
        f"the estimates of the fit, at {drive} and {scene.rig.normal_force:.3g} N (log {arguments.log}, {name})",
    )


def taken_by_default(scene: Scene) -> str:
    """Which friction is simulated: what the scene says, and of which parameters it takes the documented default."""
    from identify.base.wording import quantity as shown

    values, units = scene.values(), {p.name: p.unit for p in scene.declared}
    silent = [
        name for name, spec in scene.parameters.items() if (spec.fixed, spec.start, spec.tie) == (None, None, None)
    ]
    if not silent:
        return "the friction is that of the scene"
    listed = ", ".join(f"{name} {shown(values[name], units[name])}" for name in silent)
    return f"the scene gives no value of these, so documented defaults are taken: {listed}"


def _simulated(path: Path) -> bool:
    """Whether a file that is there is a log that was simulated: it can be made again, and is written over."""
    from data_io import LogError, read_log

    try:
        return read_log(path).metadata.get("simulated") is True
    except (LogError, OSError):
        return False


def _provenance(scene: Scene, duration: float, rate: float) -> dict[str, str | float | bool]:
    """What the log is made of, so that it can be made again: effects, every value [SI], scene (JSON), version."""
    from importlib.metadata import version

    return {
        "simulated": True,
        "scene": scene.name,
        "effects": ", ".join(scene.model.effects),
        "parameters_SI": json.dumps(scene.values()),
        "scene_SI": json.dumps(scene.as_document() | {"logs": []}, ensure_ascii=False),
        "duration_s": duration,
        "rate_Hz": rate,
        "version": version("stick-slip-workbench"),
    }


def _accuracy(given: str | None) -> float | None:
    """The accuracy asked for.

    Raises:
        CommandLineError: no relative error.
    """
    if given is None:
        return None
    accuracy = quantity(given, "", "--accuracy")
    if not 0.0 < accuracy < 1.0:
        raise CommandLineError(f"--accuracy is {accuracy:g}; expected a relative error such as 1e-6: correct it")
    return accuracy


def _words(achieved: dict[str, float | None], asked: float) -> str:
    """What the second run says of the first, `asked` being the accuracy."""
    if None in achieved.values():
        return "estimated errors: unknown, with another tolerance the slips come differently"
    words = f"estimated errors: switch times {achieved['switches']:.1g} of a cycle, forces {achieved['forces']:.1g}"
    return words if max(e for e in achieved.values() if e is not None) <= asked else f"{words}: as near as numbers get"


def _asked(arguments: Namespace) -> tuple[float, float, float, int]:
    """Duration [s], rate [Hz], noise [N] and seed; what cannot be is refused before the work.

    Raises:
        CommandLineError: one sentence.
    """
    duration, rate = positive(arguments.duration, "s", "--duration"), positive(arguments.rate, "Hz", "--rate")
    samples = duration * rate + 1
    if not 2 <= samples <= MOST_SAMPLES:
        count = f"{samples:.3g} samples" if samples >= 2 else "1 sample"
        raise CommandLineError(
            f"{duration:g} s at {rate:g} Hz give {count}; expected 2 to {MOST_SAMPLES:g}: change --rate or --duration"
        )
    noise = quantity(arguments.noise, "N", "--noise")
    if noise < 0:
        raise CommandLineError(f"--noise is {noise:g} N; expected zero or a positive number: correct it")
    if arguments.seed < 0:
        raise CommandLineError(f"--seed is {arguments.seed}; expected zero or a positive whole number: correct it")
    return duration, rate, noise, arguments.seed
