"""Records of every regime, drawn at random: what sticks and slips, and what only looks as if it did.

Stick-slip of equal cycles and near-harmonic oscillation come from the model, whose rests say which of the two it is;
everything else is drawn by hand, so that no code of the detection takes part in its own test.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from data_io import Record
from identify.base.errors import SimulationError
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run

Array = NDArray[np.float64]

RESTS, HARDLY = 0.35, 0.12  # share of the time at rest from which on it is stick-slip, and up to which near-harmonic
FEWEST_SAMPLES = 8  # of a cycle: with fewer no stick is told from a slip
MOST_ROWS = 12_000
RATES = (10.0, 5000.0)  # Hz


@dataclass(frozen=True)
class Drawn:
    """A record with its truth.

    kind; regime: the value of the true `Regime`; claims: whether it holds stick-slip or an oscillation of the mass;
    rig: mass, stiffness, damping, drive_speed as a user states them (SI).
    """

    kind: str
    regime: str
    record: Record
    rig: Mapping[str, float]
    strokes: int = 1

    @property
    def slips(self) -> bool:
        """Whether there is any stick-slip to be claimed."""
        return self.regime in ("stick_slip", "uneven_stick_slip", "near_harmonic")


def _log_uniform(draw: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(draw.uniform(np.log(low), np.log(high))))


def _record(draw: np.random.Generator, time: Array, force: Array, load: float, **columns: Array) -> Record:
    force = force * (1.0 if draw.random() < 0.7 else -1.0)
    units = {"position": "m", "speed": "m/s", "Rotary.Velocity": "rpm"}
    about = {"channel_units": {name: units[name] for name in columns}}
    normal = np.full(time.size, load)
    return Record.from_columns(
        {"time": time, "normal_force": normal, "friction_force": force, **columns},
        about | {"steps": (), "findings": (), "metadata": {}},
    )


def coloured(draw: np.random.Generator, time: Array, memory: float) -> Array:
    """Noise of unit variance that forgets within `memory` [s], shape (n,)."""
    keeps = float(np.exp(-np.median(np.diff(time)) / memory))
    out = lfilter([np.sqrt(1.0 - keeps**2)], [1.0, -keeps], draw.standard_normal(time.size))
    return np.asarray(out + keeps ** np.arange(time.size) * draw.standard_normal())


def _clock(draw: np.random.Generator, shortest: float, longest: float, rates: tuple[float, float] = RATES) -> Array:
    rate = _log_uniform(draw, *rates)
    duration = _log_uniform(draw, shortest, longest)
    rows = int(np.clip(duration * rate, 150, MOST_ROWS))
    return np.arange(rows) / rate


def _rig(draw: np.random.Generator) -> dict[str, float]:
    mass, stiffness = _log_uniform(draw, 0.05, 1.0), _log_uniform(draw, 300.0, 20_000.0)
    damping = 2.0 * draw.uniform(0.01, 0.1) * np.sqrt(mass * stiffness)
    return {"mass": mass, "stiffness": stiffness, "damping": damping}


def _modelled(draw: np.random.Generator, near_harmonic: bool) -> Drawn:
    """Cycles of the model that rest for long, or hardly."""
    while True:
        rig, load = _rig(draw), _log_uniform(draw, 0.3, 20.0)
        mu_k0 = draw.uniform(0.15, 0.6)
        pair = {"mu_s": mu_k0 * draw.uniform(1.15, 1.8), "mu_k0": mu_k0, "delta_mu_k": -mu_k0 * draw.uniform(0.1, 0.4)}
        pair |= {"a": _log_uniform(draw, 20.0, 500.0), "D": _log_uniform(draw, 5e-6, 1e-4)}
        pair["t_cr"] = _log_uniform(draw, 0.02, 3.0)
        natural = np.sqrt(rig["stiffness"] / rig["mass"])
        drop = load * (pair["mu_s"] - pair["mu_k0"])
        # At this speed a stick lasts about as long as a slip; near-harmonic motion is faster.
        speed = drop * natural / rig["stiffness"] * _log_uniform(draw, *((0.2, 3.0) if near_harmonic else (1e-3, 0.3)))
        period = 2.0 * np.pi / natural + 2.0 * drop / rig["stiffness"] / speed
        samples = _log_uniform(draw, 12.0, 300.0) if near_harmonic else _log_uniform(draw, 25.0, 400.0)
        rate = samples / period
        if not RATES[0] <= rate <= RATES[1]:
            continue
        cycles = draw.integers(8, 30)
        time = np.arange(int(min((cycles + 3) * samples, MOST_ROWS))) / rate
        try:
            motion = run(assemble(MAIN), pair | rig, speed, load, float(time[-1]) + 4 * period)
        except SimulationError:  # a draw that the model refuses is no record
            continue
        late = np.linspace(0.5, 1.0, 4000) * float(time[-1])
        rests = 1.0 - float(np.mean(motion.sample(late)["sliding"]))
        force = motion.sample(time + (4 * period if near_harmonic else 0.0))["force"]
        swing = float(np.ptp(force[force.size // 2 :]))
        if swing < 0.02 * load * mu_k0 or (not rests <= HARDLY if near_harmonic else not rests >= RESTS):
            continue
        noise = swing * _log_uniform(draw, 0.002, 0.06)
        record = _record(draw, time, force + noise * draw.standard_normal(time.size), load)
        kind = "near_harmonic" if near_harmonic else "stick_slip"
        late_force = force[force.size // 2 :]
        crossings = int(np.count_nonzero(np.diff(np.sign(late_force - np.mean(late_force)))))
        if not 4 <= crossings <= late_force.size / FEWEST_SAMPLES * 2:
            continue
        return Drawn(kind, kind, record, rig | {"drive_speed": speed})


def uneven_stick_slip(draw: np.random.Generator) -> Drawn:
    """Sticks of one slope that break at peaks of their own and fall by drops of their own, on a level that wanders."""
    rig, load = _rig(draw), _log_uniform(draw, 0.3, 20.0)
    half = float(np.pi * np.sqrt(rig["mass"] / rig["stiffness"]))
    cycles = int(draw.integers(12, 60))
    level, drop = load * draw.uniform(0.2, 0.6), load * draw.uniform(0.04, 0.2)
    stick = half * _log_uniform(draw, 2.0, 50.0)
    speed = drop / stick / rig["stiffness"]
    rate = float(np.clip(_log_uniform(draw, 20.0, 400.0) / (stick + half), 1.5 / half, RATES[1]))
    scatter = draw.uniform(0.15, 0.45)
    wander = np.cumsum(draw.standard_normal(cycles)) * drop * draw.uniform(0.05, 0.3)
    peaks = level + wander + 0.3 * scatter * drop * draw.standard_normal(cycles)
    drops = drop * np.exp(scatter * draw.standard_normal(cycles) - 0.5 * scatter**2)
    knots_t, knots_f, t, low = [0.0], [peaks[0] - drop], 0.0, peaks[0] - drop
    slope = rig["stiffness"] * speed * draw.uniform(0.92, 1.1)
    for peak, own in zip(peaks, drops, strict=True):
        top = max(peak, low + 0.2 * drop)
        t += (top - low) / slope
        knots_t.append(t)
        knots_f.append(top)
        low = top - own
        fall = np.linspace(0.0, 1.0, 9)[1:]
        knots_t += (t + half * fall).tolist()
        knots_f += (top - own * 0.5 * (1.0 - np.cos(np.pi * fall))).tolist()
        t += half
    time = np.arange(min(int(t * rate), 4 * MOST_ROWS)) / rate
    force = np.interp(time, knots_t, knots_f) + drop * _log_uniform(draw, 0.003, 0.05) * draw.standard_normal(time.size)
    record = _record(draw, time, force, load)
    return Drawn("uneven_stick_slip", "uneven_stick_slip", record, rig | {"drive_speed": speed})


def _sliding_rig(draw: np.random.Generator) -> dict[str, float]:
    """A rig and a speed at which contacts slide."""
    return _rig(draw) | {"drive_speed": _log_uniform(draw, 1e-3, 0.3)}


def _smooth(draw: np.random.Generator, slow: bool, rates: tuple[float, float] = RATES) -> Drawn:
    time = _clock(draw, 5.0, 300.0, rates)
    load = _log_uniform(draw, 0.3, 50.0)
    level = load * draw.uniform(0.05, 0.8)
    force = level * (1.0 + _log_uniform(draw, 0.003, 0.05) * draw.standard_normal(time.size))
    if slow:
        interval = float(time[1])
        memory = _log_uniform(draw, 2.0 * interval, max(40.0 * interval, 0.05 * time[-1]))
        force += level * _log_uniform(draw, 0.01, 0.08) * coloured(draw, time, memory)
    kind = "slow_noise" if slow else "white_noise"
    return Drawn(kind, "sliding", _record(draw, time, force, load), _sliding_rig(draw))


def slow_noise(draw: np.random.Generator) -> Drawn:
    """Smooth sliding with noise that remembers."""
    return _smooth(draw, slow=True, rates=(10.0, 10.001) if draw.random() < 0.4 else RATES)


def wobble(draw: np.random.Generator) -> Drawn:
    """A swing once a turn, with a second harmonic, of a disc whose turns a column of rpm tells in half of the cases."""
    turn = _log_uniform(draw, 0.2, 5.0)
    time = _clock(draw, 10.0 / turn, 60.0 / turn, (max(10.0, 6.0 * turn), 2000.0))
    load = _log_uniform(draw, 0.5, 50.0)
    level = load * draw.uniform(0.1, 0.7)
    swing = draw.uniform(0.006, 0.03)
    phase = 2.0 * np.pi * turn * time
    wave = np.sin(phase) + draw.uniform(0.0, 0.4) * np.sin(2.0 * phase + draw.uniform(0.0, 6.0))
    noise = _log_uniform(draw, 0.03, 0.3) * draw.standard_normal(time.size)
    columns = {}
    if draw.random() < 0.5:
        columns["Rotary.Velocity"] = 60.0 * turn * (1.0 + 2e-3 * draw.standard_normal(time.size))
    record = _record(draw, time, level * (1.0 + swing * (wave + noise)), load, **columns)
    rig = _rig(draw) | {"drive_speed": 2.0 * np.pi * turn * draw.uniform(2e-3, 2e-2)}
    return Drawn("wobble", "sliding", record, rig)


def strokes(draw: np.random.Generator) -> Drawn:
    """To and fro, 1 to 1,000 times, with a rise, a bump of the track, standstill at the ends or not."""
    number = round(_log_uniform(draw, 1.0, 1000.0))
    rate = _log_uniform(draw, *RATES)
    samples = int(np.clip(_log_uniform(draw, 10.0, 400.0), 10, max(60_000 // number, 10)))
    samples = max(samples, 150 // number)
    lasts = samples / rate
    load = _log_uniform(draw, 0.5, 50.0)
    level = load * draw.uniform(0.05, 0.7)
    time = np.arange(number * samples) / rate
    which, inside = np.divmod(np.arange(time.size), samples)
    place = inside / samples
    sign = np.where(which % 2 == 0, 1.0, -1.0)
    rests = draw.uniform(0.05, 0.3) if draw.random() < 0.4 else 0.0
    moved = np.clip(place / (1.0 - rests), 0.0, 1.0)
    rise = draw.uniform(0.01, 0.2)
    profile = 1.0 - 2.0 * np.exp(-moved / rise) + draw.uniform(0.0, 0.15) * np.exp(-(((moved - 0.6) / 0.05) ** 2))
    force = sign * level * profile * (1.0 + draw.uniform(0.0, 3.0) * np.exp(-which / max(0.2 * number, 1.0)))
    force[which == 0] = np.abs(force[which == 0])
    force += level * _log_uniform(draw, 0.003, 0.05) * draw.standard_normal(time.size)
    length, columns = _log_uniform(draw, 1e-3, 0.02), {}
    told = draw.random() < 0.5
    if told:
        columns["position"] = length * np.where(sign > 0, moved, 1.0 - moved)
    rig = _rig(draw) | {"drive_speed": length / (lasts * (1.0 - rests))}
    return Drawn("strokes", "sliding", _record(draw, time, force, load, **columns), rig, number)


def running_in(draw: np.random.Generator) -> Drawn:
    """A level that falls by up to a factor of four, or rises, with noise that remembers."""
    time = _clock(draw, 20.0, 600.0)
    load = _log_uniform(draw, 0.5, 50.0)
    level = load * draw.uniform(0.05, 0.4)
    course = 1.0 + draw.uniform(-0.4, 3.0) * np.exp(-time / (time[-1] * draw.uniform(0.03, 0.3)))
    memory = _log_uniform(draw, 2.0 * float(time[1]), 0.03 * float(time[-1]))
    noise = _log_uniform(draw, 0.003, 0.04) * coloured(draw, time, memory) + 0.005 * draw.standard_normal(time.size)
    return Drawn("running_in", "sliding", _record(draw, time, level * course * (1.0 + noise), load), _sliding_rig(draw))


def _programme(draw: np.random.Generator, standstill: bool) -> Drawn:
    time = _clock(draw, 20.0, 200.0)
    pieces = int(draw.integers(3, 8))
    edges = np.sort(draw.uniform(0.1, 0.95, pieces - 1))
    edges = np.concatenate([[0.0], edges[np.append(True, np.diff(edges) > 0.05)], [1.0]]) * time[-1]
    load = _log_uniform(draw, 0.5, 50.0)
    mu, weaker = draw.uniform(0.1, 0.6), draw.uniform(-0.03, 0.03)
    rig = _sliding_rig(draw)
    speeds = rig["drive_speed"] * 10.0 ** draw.uniform(-1.0, 1.0, edges.size - 1)
    if standstill:
        speeds = np.where(np.arange(speeds.size) % 2 == 1, 0.0, rig["drive_speed"])
    piece = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, speeds.size - 1)
    speed = speeds[piece]
    level = load * (mu + weaker * np.log10(np.maximum(speeds, 1e-9) / rig["drive_speed"]) * (speeds > 0))
    force = np.empty(time.size)
    for number in range(speeds.size):
        mine = piece == number
        since = time[mine] - edges[number]
        if speeds[number] == 0.0:
            kept = level[max(number - 1, 0)] * draw.uniform(0.5, 0.95)
            force[mine] = kept * (1.0 - draw.uniform(0.0, 0.05) * np.log1p(since))
        else:
            force[mine] = level[number] * (1.0 + draw.uniform(0.0, 0.2) * np.exp(-since / (0.02 * time[-1])))
    force += load * mu * _log_uniform(draw, 0.003, 0.03) * draw.standard_normal(time.size)
    told = draw.random() < 0.5
    columns = {"speed": speed} if told else {}
    inner = np.trim_zeros(speeds)  # what a drive stands before and after is no change
    regime = "programme" if told and np.unique(inner).size > 1 else "sliding"
    kind = "standstill" if standstill else "speed_steps"
    return Drawn(kind, regime, _record(draw, time, force, load, **columns), rig)


KINDS: Mapping[str, Callable[[np.random.Generator], Drawn]] = {
    "stick_slip": partial(_modelled, near_harmonic=False),
    "uneven_stick_slip": uneven_stick_slip,
    "near_harmonic": partial(_modelled, near_harmonic=True),
    "white_noise": partial(_smooth, slow=False),
    "slow_noise": slow_noise,
    "wobble": wobble,
    "strokes": strokes,
    "running_in": running_in,
    "speed_steps": partial(_programme, standstill=False),
    "standstill": partial(_programme, standstill=True),
}


def drawn(kind: str, seed: int) -> Drawn:
    """One record of a kind."""
    return KINDS[kind](np.random.default_rng([list(KINDS).index(kind), seed]))
