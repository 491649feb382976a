"""`stickslip simulate`, `stability` and `amplitude`: the model run forward, and what the pair does at a point.

The options stand apart from the work, so that help needs nothing heavy.
"""

from __future__ import annotations

import json
from argparse import Namespace
from contextlib import suppress

from identify.cli.common import (
    MEASURED,
    SET,
    Answer,
    Command,
    CommandLineError,
    Options,
    Terminal,
    file_to_write,
    new_file,
    positive,
    quantity,
)

MOST_SAMPLES = 2e7  # half a gigabyte of columns
ENDINGS = (".csv", ".h5", ".hdf5")


POINT: Options = {
    "--scene SCENE.toml": "the values of a scene: fixed, else start, else default; or",
    "--result result.json": "the estimates of a fit, with their uncertainty",
    "--at KEY=VALUE*": 'operating point, repeatable: drive_speed="1 mm/s", normal_force, or any parameter (default: '
    "each log)",
    "--advice MARGIN?": "the nearest change of speed, stiffness, damping, mass or load that makes sliding steady, with "
    "a margin (default: 20 %)",
    "--group GROUP+": "of a fit whose parameters differ between groups: this one alone, as V08 or volunteer=V08, "
    "repeatable (default: each)",
    "--without EFFECT+": "leave out an effect of the scene, repeatable: one with which no cycle is like the one before",
    "--plot FILE": "draw it over drive speed, or the map (png, svg or pdf)",
    "maps": {
        "--map NAME*": "over one or two of drive_speed, stiffness, normal_force, pressure, area, damping, zeta, mass, "
        "t_cr, D, mu_k0, mu_step (μs - μk0), a, or any other parameter",
        "--range NAME=LOW:HIGH+": 'of a quantity of the map, repeatable: drive_speed="0.1 mm/s:10 mm/s" (default: '
        "around the point)",
        "--points N": "along each quantity (default: 60, of one alone 120)",
        "--data FILE": "the numbers of the map (csv)",
    },
}
SIMULATE: Options = {
    "--scene SCENE.toml!": "the scene to simulate: fixed, else start, else default",
    **SET,
    "--duration T!": "how long [s]",
    "--rate HZ!": "samples per second [Hz]",
    "--noise SD": "standard deviation of white force noise [N]",
    "--seed N": "seed of the noise (default 0)",
    "--accuracy X": "relative error of switch times and forces that is tolerated (default: an order below the noise)",
    "--out LOG.csv|LOG.h5!": "the log to write, over a simulated one at most",
}


def calculated(arguments: Namespace, terminal: Terminal) -> Answer:
    """What the pair does at operating points, or over a map."""
    from identify.cli.operating import answers

    return answers(arguments, terminal, arguments.command)


def simulate(arguments: Namespace, terminal: Terminal) -> Answer:
    """Simulate and write."""
    out = file_to_write(arguments.out, "--out", ENDINGS)
    simulated_before = False  # a log that was simulated can be made again, and is written over
    if out.exists():
        from data_io import LogError, read_log

        with suppress(LogError, OSError):
            simulated_before = read_log(out).metadata.get("simulated") is True
    if not simulated_before:
        new_file(arguments.out, "--out", MEASURED)
    duration, rate = positive(arguments.duration, "s", "--duration"), positive(arguments.rate, "Hz", "--rate")
    samples = duration * rate + 1
    if not 2 <= samples <= MOST_SAMPLES:
        count = f"{samples:.3g} samples" if samples >= 2 else "1 sample"
        raise CommandLineError(
            f"{duration:g} s at {rate:g} Hz give {count}; expected 2 to {MOST_SAMPLES:g}: change --rate or --duration"
        )
    noise = quantity(arguments.noise or "0", "N", "--noise")
    if noise < 0:
        raise CommandLineError(f"--noise is {noise:g} N; expected zero or a positive number: correct it")
    seed = arguments.seed or 0
    if seed < 0:
        raise CommandLineError(f"--seed is {seed}; expected zero or a positive whole number: correct it")
    accuracy = None if arguments.accuracy is None else quantity(arguments.accuracy, "", "--accuracy")
    if accuracy is not None and not 0.0 < accuracy < 1.0:
        raise CommandLineError(f"--accuracy is {accuracy:g}; expected a relative error such as 1e-6: correct it")

    from dataclasses import asdict
    from importlib.metadata import version
    from time import process_time

    import numpy as np

    from data_io import Record, write_csv, write_hdf5
    from identify.base.document import to_dict
    from identify.base.wording import quantity as shown
    from identify.base.wording import wrapped
    from identify.diagnosis.effect_choice import choose_from_numbers, effects_result
    from identify.scene import Scene
    from identify.simulation.cost import cost
    from identify.simulation.simulate import simulate as simulated

    scene = Scene.from_toml(arguments.scene, arguments.set)
    choice = choose_from_numbers(scene) if scene.effects == "auto" else None
    if choice is not None:
        scene = scene.with_effects(choice.effects)
        terminal.say(f"effects by the numbers of the scene: {', '.join(choice.effects)}")
    values, since = scene.values(), process_time()
    motion = simulated(scene, duration, accuracy=accuracy, noise=noise or None).refined()
    spent = cost(scene, motion, process_time() - since)
    time = np.arange(int(duration * rate * (1 + 1e-12)) + 1) / rate
    forces, speed = motion.sample(time), scene.rig.drive_speed
    record = Record(
        time=time,
        normal_force=np.broadcast_to(forces["normal_force"], time.shape).copy(),
        friction_force=forces["force"] + np.random.default_rng(seed).normal(0.0, noise, time.size),
        drive_speed=speed if isinstance(speed, float) else None,
        metadata={  # so that it can be made again
            "simulated": True,
            "scene": scene.name,
            "effects": ", ".join(scene.model.effects),
            "parameters_SI": json.dumps(values),
            "scene_SI": json.dumps(scene.as_document() | {"logs": []}, ensure_ascii=False),
            "duration_s": duration,
            "rate_Hz": rate,
            "version": version("stick-slip-workbench"),
            "noise_N": noise,
            "seed": seed,
        },
    )
    (write_csv if out.suffix.lower() == ".csv" else write_hdf5)(record, out)
    slips = motion.onsets.size
    units = {p.name: p.unit for p in scene.declared}
    silent = [name for name, s in scene.parameters.items() if (s.fixed, s.start, s.tie) == (None, None, None)]
    defaults = ", ".join(f"{name} {shown(values[name], units[name])}" for name in silent)
    if defaults:
        defaults = f"the scene gives no value of these, so documented defaults are taken: {defaults}"
    terminal.say(wrapped(defaults or "the friction is that of the scene"))
    terminal.say(f"{out}: {time.size} samples, {slips} slips, noise {noise:g} N (seed {seed}), simulated")
    document: dict[str, object] = {"status": "done", "out": str(out), "rows": time.size, "slips": slips}
    document["parameters"] = dict(sorted(values.items()))
    if motion.achieved is not None:
        errors, wanted = asdict(motion.achieved), motion.accuracy or 0.0
        text = "unknown, with another tolerance the slips come differently"
        if np.all(np.isfinite(list(errors.values()))):
            text = f"switch times {errors['switches']:.1g} of a cycle, forces {errors['forces']:.1g}"
            text += ": as near as numbers get" if max(errors.values()) > wanted else ""
        methods = ", ".join(motion.methods) or "no slip"
        terminal.say(f"asked for {wanted:.2g}; estimated errors: {text}; {methods}")
        terminal.say(wrapped(spent.text, ""))
        document["accuracy"] = {"asked": motion.accuracy, **errors, "methods": list(motion.methods)}
        levels = [{"accuracy": level, "seconds": seconds} for level, seconds in spent.seconds.items()]
        document["price"] = {"levels": levels, "effects_s": spent.effects}
    if choice is not None:
        document["effects"] = to_dict(effects_result(choice, auto=True))
    return Answer(document=document)


COMMANDS = (
    Command("simulate", "run the model of a scene forward and write a log", SIMULATE, simulate),
    Command("stability", "does the pair stick and slip at an operating point, up to which speed", POINT, calculated),
    Command("amplitude", "how large, fast and frequent the jumps are at an operating point", POINT, calculated),
)
