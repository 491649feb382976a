"""What became of one random scene: its tolerance met, refused by name, or a violation."""

from __future__ import annotations

import re
import sys
import time
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.append(str(Path(__file__).resolve().parent.parent))
from experiments.draws import Draw
from experiments.energy import balance
from identify.base.errors import SceneError, SimulationError
from identify.effects import MAIN
from identify.simulation.drive import Drive, NormalForce
from identify.simulation.phases import Machine, phases
from identify.simulation.plan import SAFETY, Stepping, admit, plan, scales
from identify.simulation.steppers import STIFF
from identify.simulation.trajectory import Trajectory, inside
from tests.support import oracle

Array = NDArray[np.float64]

TIGHTER = 100.0  # accuracy of the run that ours is compared with
SHARE = 10.0  # times what disturbances as large as the accuracy make
ENERGY = 10.0  # times the accuracy, of the energy turned over
MOST_PHASES = 60
MOST_BREAKS = 120  # of the slides of a scene, where a disturbed run is disturbed
ALMOST = 0.999  # of the time that is compared: a switch at its very end may lie on either side
OUTSIDE = 5  # every so many draws
LABOUR = 2000  # steps of ours, beyond which the integrator of the tests would take too long
SECONDS = 10.0  # of processor time, per run


@dataclass(frozen=True)
class Verdict:
    """`outcome`: "met", "met as far as the scene allows", "refused: ..." or "VIOLATION: ..."; seconds of one run."""

    seed: int
    outcome: str
    error: float  # over the accuracy that was asked for
    energy: float  # the same
    seconds: float
    onsets: int
    phases: int
    outside: float = np.nan  # error against the independent integrator, over the accuracy


def motion(draw: Draw, accuracy: float) -> Trajectory:
    """The first MOST_PHASES phases of a draw.

    Raises:
        SimulationError, SceneError: refused, by name.
    """
    return _motion(draw, draw.drive, accuracy, 0, MOST_PHASES)


def disturbed(draw: Draw, truth: Trajectory, change: int) -> Trajectory:
    """The motion again with every parameter and, at every switch and now and then in every slide, the state changed by
    the accuracy asked for (relative, up or down; of the largest in the phase). `change` is a seed.

    Raises:
        SimulationError, SceneError: refused, by name.
    """
    programme = Drive.of(draw.drive)
    slides = [p for p in truth.phases if p.mode != "stick"]
    often = max(1, MOST_BREAKS // max(len(slides), 1))
    inner = {p.start + share * p.duration for p in slides for share in np.linspace(0.0, 1.0, often + 2)[1:-1]}
    starts = sorted({*programme.starts, *(t for t in inner if 0.0 < t < truth.duration)})
    drive = tuple((t, programme.at(t)) for t in starts)
    return _motion(replace(draw, duration=truth.duration), drive, draw.accuracy, change, 20 * MOST_PHASES)


def _motion(draw: Draw, drive: tuple[tuple[float, float], ...], accuracy: float, change: int, most: int) -> Trajectory:
    model, share = draw.model, accuracy
    admit(model, draw.values, draw.duration, draw.start)
    p = np.array([draw.values[name] for name in model.parameter_names])
    random = np.random.default_rng(change)
    if change:
        p = p * (1.0 + share * random.choice([-1.0, 1.0], p.size))
    x = np.array([draw.start.get(s.name, s.start) for s in model.states], float)
    load = NormalForce.of(draw.normal_force)
    scale = scales(model, p, float(load.at(0.0)))
    asked = accuracy / TIGHTER if change else accuracy
    steps = plan(scale, Stepping(asked / SAFETY))
    kept, machine = [], Machine(model, p, scale, steps)
    with closing(machine):
        for phase in islice(phases(machine, Drive.of(drive), load, draw.duration, x), most):
            kept.append(phase)
            if change:
                end, size = phase.states[-1], np.max(np.abs(np.asarray(phase.states, float)), axis=0)
                for i in np.flatnonzero(end):
                    end[i] += share * size[i] * random.choice([-1.0, 1.0])
    return Trajectory(model, tuple(kept), kept[-1].start + kept[-1].duration)


def difference(one: Trajectory, other: Trajectory, unseen: float = 0.0) -> float:
    """Largest difference of switch times over the mean time between onsets, and of forces over the largest, in the time
    that both cover; infinite where the switches are not the same.

    unseen: share of that time; a contact that ages for less than that where the sliding turns round, and is worn off
    again, is no switch.
    """
    common = min(one.duration, other.duration)
    switches = [[getattr(t, kind) for t in (one, other)] for kind in ("onsets", "arrests")]
    switches.append([_worn(t, unseen * common) for t in (one, other)])
    switches = [[times[times < ALMOST * common] for times in pair] for pair in switches]
    if any(a.size != b.size for a, b in switches):
        return float("inf")
    apart = max((float(np.max(np.abs(a - b))) for a, b in switches if a.size), default=0.0)
    late = apart / common * max(switches[0][0].size, 1)
    # A slip that comes late is wrong at the same time, a rest that begins late at the same share of it: neither is more
    # than the switches have said.
    forces = _at_times(one, other, common, apart)
    return max(late, min(forces, _phase_by_phase(one, other)) if _alike(one, other) else forces)


def _worn(motion: Trajectory, least: float) -> Array:
    """Times at which the contact is worn off, but those that come sooner than `least` [s] after an arrest."""
    since = np.searchsorted(motion.arrests, motion.wear_times, side="right") - 1
    before = np.where(since >= 0, motion.arrests[np.maximum(since, 0)], -np.inf) if motion.arrests.size else -np.inf
    return np.asarray(motion.wear_times[motion.wear_times - before >= least])


def _alike(one: Trajectory, other: Trajectory) -> bool:
    return [p.mode for p in one.phases] == [p.mode for p in other.phases]


def _phase_by_phase(one: Trajectory, other: Trajectory) -> float:
    """Forces at the same shares of the same phases: a slip that comes late is no error of its forces."""
    shares = np.array([0.05, 0.2, 0.4, 0.6, 0.8, 0.95])
    which = np.repeat(np.arange(len(one.phases)), shares.size)
    force, truth = (
        inside(t.model, t.phases, which, np.outer([p.duration for p in t.phases], shares).ravel())["force"]
        for t in (one, other)
    )
    return float(np.max(np.abs(force - truth))) / max(float(np.max(np.abs(truth))), 1e-300)


def _at_times(one: Trajectory, other: Trajectory, common: float, apart: float) -> float:
    """Forces at the same times, away from the switches, around which a shift in time is no error of the force."""
    edges = np.sort([p.start for t in (one, other) for p in t.phases] + [common])
    inner = [p.start + share * p.duration for p in other.phases for share in (0.05, 0.3, 0.5, 0.7, 0.95)]
    times = np.unique(np.clip(np.concatenate([inner, np.linspace(0.0, common, 400)]), 0.0, common))
    at = np.clip(np.searchsorted(edges, times), 1, edges.size - 1)
    times = times[np.minimum(times - edges[at - 1], edges[at] - times) > 2.0 * apart]
    if times.size == 0:
        return 0.0
    force, truth = (t.sample(times)["force"] for t in (one, other))
    return float(np.max(np.abs(force - truth))) / max(float(np.max(np.abs(truth))), 1e-300)


def _finite(trajectory: Trajectory) -> bool:
    return all(np.isfinite(p.x).all() and np.isfinite(p.t).all() for p in trajectory.phases)


def sentence(error: Exception) -> str:
    """The message of a refusal without its numbers, to count by."""
    return re.sub(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?", "#", str(error))


def judge(draw: Draw) -> Verdict:
    """Simulate, compare with tighter runs, add up the energy."""
    began = time.process_time()
    try:
        ours = motion(draw, draw.accuracy)
    except (SimulationError, SceneError) as error:
        took = time.process_time() - began
        outcome = f"refused: {sentence(error)}" if took < SECONDS else f"VIOLATION: refused after {took:.0f} s"
        return Verdict(draw.seed, outcome, np.nan, np.nan, took, 0, 0)
    took = time.process_time() - began
    verdict = Verdict(draw.seed, "met", 0.0, np.nan, took, ours.onsets.size, len(ours.phases))
    if took > SECONDS:
        return replace(verdict, outcome="VIOLATION: slower than allowed")
    if not _finite(ours):
        return replace(verdict, outcome="VIOLATION: not finite")
    if not draw.values.get("loading_sd", 0.0) > 0.0:
        # The loading factor of a stick is work that no drive does: with it no balance is asked for.
        energy = balance(ours, draw.values)
        verdict = replace(verdict, energy=np.nan if energy is None else energy.error / draw.accuracy)
        if verdict.energy > ENERGY:
            return replace(verdict, outcome="VIOLATION: energy")
    return _against_tighter(draw, ours, verdict)


def _against_tighter(draw: Draw, ours: Trajectory, verdict: Verdict) -> Verdict:
    try:
        truth = motion(draw, draw.accuracy / TIGHTER)
        error = difference(ours, truth, draw.accuracy)
        verdict = replace(verdict, error=error / draw.accuracy)
        if error <= draw.accuracy:
            return _against_integrator(draw, ours, verdict)
        own = max(difference(disturbed(draw, truth, change), truth, draw.accuracy) for change in (1, 2, 3))
    except (SimulationError, SceneError) as refusal:
        return replace(verdict, outcome=f"met, reference refused: {sentence(refusal)}")
    if error <= SHARE * own:
        return replace(verdict, outcome="met as far as the scene allows")
    return replace(verdict, outcome=f"VIOLATION: error {error:.1e}, the scene's own {own:.1e}")


def _against_integrator(draw: Draw, ours: Trajectory, verdict: Verdict) -> Verdict:
    """The same against the integrator of the tests, for a share of the draws that it knows and that are quickly done.

    What it is asked is a truth only where the scene does not amplify: there our tighter run agreed already.
    """
    simple = set(draw.effects) <= set(MAIN) and "contact_ageing" in draw.effects
    if not simple or draw.seed % OUTSIDE or not 1 <= ours.onsets.size <= 10:
        return verdict
    if STIFF.name in ours.methods or sum(len(p.times) for p in ours.phases) > LABOUR:
        return verdict
    values = {name: draw.values.get(name, 0.0) for name in oracle.Law.__annotations__}
    values["a"] = values["a"] or 1.0
    state = tuple(draw.start.get(name, 0.0) for name in ("elongation", "sliding_speed", "gamma"))
    load = tuple(zip(*draw.normal_force, strict=True))
    truth = oracle.simulate(values, draw.drive, load, ours.duration, state, rtol=1e-11)  # type: ignore[arg-type]
    common = ALMOST * ours.duration
    # Where a slip begins or turns round without a rest before it, the integrator counts an onset; ours does not.
    pairs = [(ours.onsets, np.setdiff1d(truth.onsets, [0.0, *truth.arrests])), (ours.arrests, truth.arrests)]
    pairs = [(a[a < common], b[b < common]) for a, b in pairs]
    if any(a.size != b.size for a, b in pairs):
        return replace(verdict, outcome="VIOLATION: other switches than the independent integrator", outside=np.inf)
    period = ours.duration / ours.onsets.size
    error = max(float(np.max(np.abs(a - b))) / period for a, b in pairs if a.size) / draw.accuracy
    outcome = "met" if error <= 1.0 else f"VIOLATION: error {error:.1e} accuracies against the independent integrator"
    return replace(verdict, outcome=outcome, outside=error)
