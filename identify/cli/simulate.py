"""`stickslip simulate`: run the model forward and write a log that the loaders read back."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from identify.cli.common import Answer, CommandLineError, Terminal, quantity

NAME = "simulate"
HELP = "run the model of a scene forward and write a log"


def add_arguments(parser: ArgumentParser) -> None:
    """The arguments of this command."""
    parser.add_argument("--scene", required=True, metavar="SCENE.toml", help="the scene to simulate")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help='such as rig.mass="0.3 kg"')
    parser.add_argument("--duration", required=True, metavar="T", help="how long [s]")
    parser.add_argument("--rate", required=True, metavar="HZ", help="samples per second [Hz]")
    parser.add_argument("--noise", default="0", metavar="SD", help="standard deviation of white force noise [N]")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the noise (default 0)")
    parser.add_argument("--out", required=True, metavar="LOG.csv|LOG.h5", help="the log to write")


def run(arguments: Namespace, terminal: Terminal) -> Answer:
    """Simulate and write.

    Raises:
        CommandLineError, SceneError, SimulationError, OSError: one sentence each.
    """
    out = Path(arguments.out)
    if out.suffix not in (".csv", ".h5", ".hdf5"):
        raise CommandLineError(f"--out {out} ends in {out.suffix!r}; expected .csv or .h5: rename it")
    duration = _positive(quantity(arguments.duration, "s", "--duration"), "--duration", "s")
    rate = _positive(quantity(arguments.rate, "1/s", "--rate"), "--rate", "Hz")
    noise = quantity(arguments.noise, "N", "--noise")
    if noise < 0:
        raise CommandLineError(f"--noise is {noise:g} N; expected zero or a positive number")

    import numpy as np

    from data_io import Record, write_csv, write_hdf5
    from identify.scene import Scene
    from identify.simulate import simulate

    scene = Scene.from_toml(arguments.scene, arguments.set)
    motion = simulate(scene, duration)
    time = np.arange(int(duration * rate * (1 + 1e-12)) + 1) / rate
    if time.size < 2:
        raise CommandLineError(f"{duration:g} s at {rate:g} Hz give {time.size} sample; expected more: raise --rate")
    samples = motion.sample(time)
    force = samples["force"] + np.random.default_rng(arguments.seed).normal(0.0, noise, time.size)
    speed = scene.rig.drive_speed
    record = Record(
        time=time,
        normal_force=np.broadcast_to(samples["normal_force"], time.shape).copy(),
        friction_force=force,
        drive_speed=speed if isinstance(speed, float) else None,
        metadata={"simulated": True, "scene": scene.name, "noise_N": noise, "seed": arguments.seed},
    )
    (write_csv if out.suffix == ".csv" else write_hdf5)(record, out)
    terminal.say(
        f"{out}: {time.size} samples, {motion.onsets.size} slips, noise {noise:g} N (seed {arguments.seed}), simulated"
    )
    document = {"status": "done", "out": str(out), "rows": time.size, "slips": motion.onsets.size}
    return Answer(document=document)


def _positive(value: float, option: str, unit: str) -> float:
    if not value > 0:
        raise CommandLineError(f"{option} is {value:g} {unit}; expected a positive number")
    return value
