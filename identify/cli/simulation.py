"""`stickslip simulate`: the model of a scene run forward, written as a log."""

from __future__ import annotations

import json
from argparse import Namespace
from contextlib import suppress
from dataclasses import asdict
from importlib.metadata import version
from time import process_time

import numpy as np

from data_io import LogError, Record, read_log, write_csv, write_hdf5
from identify.base.document import to_dict
from identify.base.wording import quantity as shown
from identify.base.wording import wrapped
from identify.cli.arguments import MEASURED, file_to_write, new_file, positive
from identify.cli.common import Answer, CommandLineError, Terminal
from identify.diagnosis.effect_choice import choose_from_numbers, effects_result
from identify.scene import Scene
from identify.scene.tables import NOT_NEGATIVE, POSITIVE, Course, Key, check, quantity
from identify.simulation.drive import Drive
from identify.simulation.simulate import cost
from identify.simulation.simulate import simulate as simulated

MOST_SAMPLES = 2e7  # half a gigabyte of columns
ENDINGS = (".csv", ".h5", ".hdf5")


def simulate(arguments: Namespace, terminal: Terminal) -> Answer:
    """Simulate and write; with --verbose also what accuracy and effects cost."""
    out = file_to_write(arguments.out, "--out", ENDINGS)
    simulated_before = False  # a log that was simulated can be made again, and is written over
    if out.exists():
        with suppress(LogError, OSError):
            simulated_before = read_log(out).metadata.get("simulated") is True
    if not simulated_before:
        new_file(arguments.out, MEASURED)
    duration = positive(arguments.duration, "s", "--duration") or 0.0
    rate = positive(arguments.rate, "Hz", "--rate") or 0.0
    noise, seed = quantity(arguments.noise or "0", "N", "--noise"), arguments.seed or 0
    accuracy = None if arguments.accuracy is None else quantity(arguments.accuracy, "", "--accuracy")
    samples = duration * rate + 1
    if not 2 <= samples <= MOST_SAMPLES:
        count = f"{samples:.3g} samples" if samples >= 2 else "1 sample"
        raise CommandLineError(
            f"{duration:g} s at {rate:g} Hz give {count}; expected 2 to {MOST_SAMPLES:g}: change --rate or --duration"
        )
    check("--noise", Key("N", sign=NOT_NEGATIVE), noise)
    check("--seed", Key(sign=NOT_NEGATIVE), seed)
    check("--accuracy", Key(sign=POSITIVE, limit=1.0), accuracy)
    scene = Scene.from_toml(arguments.scene, arguments.set)
    choice = choose_from_numbers(scene) if scene.effects == "auto" else None
    if choice is not None:
        scene = scene.with_effects(choice.effects)
        terminal.say(f"effects by the numbers of the scene: {', '.join(choice.effects)}")
    values, since = scene.values(), process_time()
    motion = simulated(scene, duration, accuracy=accuracy, noise=noise or None).refined()
    took = process_time() - since
    time = np.arange(int(duration * rate * (1 + 1e-12)) + 1) / rate
    forces, speed = motion.sample(time), scene.rig.drive_speed
    course = Drive.of(speed, duration).motion(time)[1] if isinstance(speed, Course) else None
    record = Record(
        time=time,
        normal_force=np.broadcast_to(forces["normal_force"], time.shape).copy(),
        friction_force=forces["force"] + np.random.default_rng(seed).normal(0.0, noise, time.size),
        drive_speed=speed if isinstance(speed, float) else course,
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
    slips, units = motion.onsets.size, {p.name: p.unit for p in scene.declared}
    silent = [name for name, s in scene.parameters.items() if (s.fixed, s.start) == (None, None)]
    defaults = ", ".join(f"{name} {shown(values[name], units[name])}" for name in silent)
    if defaults:
        defaults = f"the scene gives no value of these, so documented defaults are taken: {defaults}"
    terminal.say(wrapped(defaults or "the friction is that of the scene"))
    terminal.say(f"{out}: {time.size} samples, {slips} slips, noise {noise:g} N (seed {seed}), simulated")
    document: dict[str, object] = {"status": "done", "out": str(out), "rows": time.size, "slips": slips}
    document["parameters"] = dict(sorted(values.items()))
    if motion.achieved is not None:
        errors, wanted = asdict(motion.achieved), motion.accuracy or 0.0
        document["accuracy"] = {"asked": motion.accuracy, **errors, "methods": list(motion.methods)}
        text = "unknown, with another tolerance the slips come differently"
        if np.all(np.isfinite(list(errors.values()))):
            text = f"switch times {errors['switches']:.1g} of a cycle, forces {errors['forces']:.1g}"
            text += ": as near as numbers get" if max(errors.values()) > wanted else ""
        methods = ", ".join(motion.methods) or "no slip"
        terminal.say(wrapped(f"accuracy {wanted:.2g}; estimated errors: {text}; {methods}"))
        if arguments.verbose:
            spent = cost(scene, motion, took)
            terminal.say(wrapped(spent.text, ""))
            levels = [{"accuracy": level, "seconds": seconds} for level, seconds in spent.seconds.items()]
            document["price"] = {"levels": levels, "effects_s": spent.effects}
    if choice is not None:
        document["effects"] = to_dict(effects_result(choice, auto=True))
    return Answer(document=document)
