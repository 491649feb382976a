"""From parameters to a trajectory on the data.

A train of cycles is simulated cycle by cycle, each from the arrest of the one before, and shifted rigidly in time onto
its fall (`place`). Any other motion (drive programmes, holds, sticks that end in sliding) is simulated along the data
(`follow`): each onset is moved onto the measured force before the slide goes on from there, so that what is wrong with
the parameters does not add up. What does not join up is left to the shooting.
"""

from __future__ import annotations

from bisect import bisect_right
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from math import ceil

import casadi as ca
import numpy as np
import scipy
from numpy.typing import NDArray

from data_io.arrays import thinned
from identify.base.errors import SimulationError
from identify.logs.log_data import LogData
from identify.logs.noise import line_slope, slope_error
from identify.model.model import ELONGATION, SPEED, Model, on_course
from identify.shooting import batch
from identify.shooting.batch import Slips, Waves
from identify.shooting.layout import Grid
from identify.shooting.shooting_trajectory import End, ShootingTrajectory, Stretch
from identify.simulation.drive import NormalForce
from identify.simulation.phases import Phase, Resting, Stick, sticks
from identify.simulation.plan import Stepping
from identify.simulation.simulate import run
from identify.simulation.sliding import Sliding, slidings
from identify.simulation.stepper import Situated
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

# A model under the drive and the load of a log: its forces, steady states, rests and motions.


@lru_cache(maxsize=32)
def _moved_by_load(model: Model) -> bool:
    """Whether the load determines how a rest goes on, not only when it ends."""
    sizes = {"x": len(model.states), "p": len(model.parameters), "u": 4, "t": 1}
    x, p, u, t = (ca.SX.sym(name, size) for name, size in sizes.items())
    return bool(ca.depends_on(model.rest(x, p, u, t), u[1]))


class LogContext:
    """A model with its parameters p (n_p,), under the drive and the load of a log; `half` is half a period [s]."""

    def __init__(self, model: Model, log: LogData, p: Array) -> None:
        self.model, self.log, self.p = model, log, p
        self.values = dict(zip(model.parameter_names, p.tolist(), strict=True))
        self.half = float(np.pi * np.sqrt(self.values["mass"] / self.values["stiffness"]))
        changes = [] if log.programme is None else log.programme.changes(log.begin, log.end)
        # steps of the drive, or of its acceleration
        self.changes, self.bends = ([], changes) if log.on_course else (changes, list[float]())

    @cached_property
    def rests(self) -> Resting:
        """Rests of the model: steady sliding has none."""
        return Resting(on_course(self.model) if self.log.on_course else self.model)

    def change_after(self, t: float) -> float:
        """The next change of the drive, or the end of the window [s]."""
        return next((c for c in self.changes if c > t), self.log.end)

    def inputs(self, t: float, just_before: bool = False) -> Array:
        """Inputs (4,) of the model at a time [s]."""
        speed = self.log.speed_at(np.nextafter(t, -np.inf) if just_before else t)
        return np.array([speed, float(self.log.normal_force.at(t)), 1.0, t])

    def steady(self, t: float, just_before: bool = False) -> Sliding | None:
        """Steady sliding at a time [s]; None where there is none (something goes on changing)."""
        u = self.inputs(t, just_before)
        with suppress(SimulationError):
            if u[0] > 0.0 and not (self.log.on_course or self.model.clocked):
                (steady,) = slidings(self.model, np.append(self.p, [u[1], u[0]]))
                return steady if np.all(np.isfinite(steady.state)) else None
        return None

    def rest(self, t: float, x: Array, end: float) -> tuple[bool, float, Array, list[tuple[float, Array]]]:
        """A rest from x at t until the static limit is overcome, at most until `end` [s]: whether it is, when, the
        state then, and time and state at each change of the drive before that.

        Raises:
            SimulationError: the drive pulls the mass back.
        """
        changes, load = list[tuple[float, Array]](), self.log.normal_force

        def until(time: float, force: tuple[float, float]) -> Stick:
            speed, rising = self.log.speed_at(t), self.log.acceleration_at(t)
            return self.rests.rest(x, Situated(self.p, speed, 1.0, *force, t, rising), time - t)

        while t < end:
            change, knot = min(self.change_after(t), end), bisect_right(load.times, t)
            bend = self.bends[bisect_right(self.bends, t) :][:1]
            stick, last = None, knot + 64  # under the least of so many knots a rest is looked at first
            if last < len(load.times) and load.times[last] < min([change, *bend]) and not _moved_by_load(self.model):
                # Over many knots of the load at once, where not even the least load of them would end the rest.
                least = float(np.min([load.at(t), *load.knots[1][knot : last + 1]]))
                stick = until(load.times[last], (least, 0.0))
            if stick is None or stick.ended_by is not None:
                last = knot
                stick = until(min([change, *bend, *load.times[knot : knot + 1]]), load.line(t))
            t, x = stick.start + stick.duration, stick.end
            if stick.ended_by is not None:
                if stick.drive_force < 0.0 and not self.log.on_course:
                    raise SimulationError("the mass is pulled back")
                return True, t, x, changes
            t = min([change, *bend, *load.times[last : last + 1]])
            if t == change:
                changes.append((t, x))
        return False, t, x, changes

    def motion(self, t: float, x: Array, duration: float) -> Trajectory:
        """The simulated motion from state x at t [s]."""
        load = self.log.normal_force
        times = np.array([t, *load.between(t, t + duration)[0], t + duration])
        start = dict(zip((s.name for s in self.model.states), x.tolist(), strict=True))
        force, stepping = NormalForce.of((times - t, load.at(times))), Stepping(1e-7)  # of a simulation step
        along = self.log.programme if self.log.on_course else None
        drive = self.log.speed_at(t) if along is None else along.between(t, t + duration, zero=t)
        return run(self.model, self.values, drive, force, duration, start=start, accuracy=stepping)

    def samples(self, begin: float, end: float) -> NDArray[np.intp]:
        """Samples between two times [s] that count."""
        first, last = np.searchsorted(self.log.time, [begin, end])
        return np.flatnonzero(self.log.weight[first:last] > 0) + first


# How a record begins: the elongation from its first samples, the contact aged so that the first slip lies on the data.

FIRST_SWINGS = 8.0  # half periods about the first peak that are compared
BY_NOISE = 6.0  # standard deviations of a mean: a smaller drop is noise


def begin_state(context: LogContext, until: float) -> Array:
    """State at the begin of the window with the elongation of the samples up to a time [s] until which the mass rests;
    the contact half aged."""
    log, model, stiffness = context.log, context.model, context.values["stiffness"]
    index = context.samples(log.begin, np.nextafter(until, np.inf))
    if index.size == 0:
        index = np.array([min(int(np.searchsorted(log.time, log.begin)), log.time.size - 1)])
    moved = log.moved(log.time[index]) - log.moved(np.array([log.begin]))
    level = np.median(thinned(log.force[index] - stiffness * moved))
    x = batch.at_force(model, np.array([level]), context.p[None], context.inputs(log.begin)[None])[0]
    if model.clamped is not None:
        x[model.clamped] = 0.5
    return x


def aged(x: Array, clamped: int) -> Array:
    """A state with contacts of all ages (41, n_x)."""
    states = np.tile(x, (41, 1))
    states[:, clamped] = np.linspace(0.0, 1.0, len(states))
    return states


def first_state(context: LogContext) -> Array:
    """State at the begin of the window, the contact half aged or such that the first slip lies on the data about the
    first peak."""
    log, model = context.log, context.model
    changes = () if log.on_course else (log.begin, *context.changes)
    moving = next((c for c in changes if log.speed_at(c) > 0.0), log.end)
    index = context.samples(moving, context.change_after(moving))
    peak = until = log.begin
    if index.size > 2:  # the highest mean over a fifth of half a period; at rest until half way up
        width = max(min(int(0.2 * context.half / log.interval), index.size // 3), 1)
        smooth = scipy.ndimage.uniform_filter1d(log.force[index], width, mode="nearest")
        # Of a train of slips any may be the highest: the first one from which it falls half as far as from any.
        drop = np.maximum.accumulate(smooth) - smooth
        dropped = drop >= max(0.5 * float(np.max(drop)), BY_NOISE * log.noise / width**0.5)
        peak = float(log.time[index[int(np.argmax(smooth[: int(np.argmax(dropped)) or smooth.size]))]])
        until = float(log.time[index[int(np.argmax(smooth >= smooth[0] + 0.5 * np.ptp(smooth)))]])
    x = begin_state(context, until)
    if model.clamped is None:
        return x
    states = aged(x, model.clamped)
    rests = [context.rest(log.begin, state, log.end) for state in states]
    onsets = np.array([t if begun else np.inf for begun, t, _, _ in rests])
    finite = onsets[np.isfinite(onsets)]
    begin = max(peak - FIRST_SWINGS * context.half, log.begin)
    if log.on_course:  # the highest force may be that of a later stroke
        peak = float(np.max(finite, initial=log.begin))
    end = min(peak + FIRST_SWINGS * context.half, context.change_after(peak))
    index = context.samples(begin, end)

    def misfit(state: Array) -> float:
        try:
            begun, _t, state, _ = context.rest(log.begin, state, begin)
            if begun or index.size == 0:
                return np.inf
            shown = context.motion(begin, state, end - begin).sample(log.time[index] - begin)["force"]
        except SimulationError:
            return np.inf
        return float(np.mean(log.weight[index] * (log.force[index] - shown) ** 2))

    if not finite.size or np.ptp(finite) <= 1e-3 * (peak - log.begin):
        return x
    near = states[(onsets >= begin) & (onsets < end)]
    misfits = np.array([misfit(state) for state in near])
    if np.isfinite(misfits).any():
        return near[int(np.argmin(misfits))]
    return states[int(np.argmin(np.abs(onsets - peak)))]


# A train of cycles: every cycle simulated, and shifted onto its fall.

SWEEPS = (4, 30)  # how often arrests are handed on, at least and at most: the return map contracts
PER_HALF_PERIOD = 60  # RK4 steps of a placed slip per half natural period
WINDOW = 48  # samples of a slip that vote on its shift
SHIFTS = 61  # places that are tried for each slip


@dataclass(frozen=True)
class _Cycles:
    """All cycles of all logs side by side (n,): which log, whether first of its log, fall times [s]; parameters
    (n, n_p), inputs (n, 4), noise (n,) of the log [N]."""

    model: Model
    log: NDArray[np.int64]
    first: NDArray[np.bool_]
    fall: Array
    p: Array
    u: Array
    noise: Array

    @staticmethod
    def of(model: Model, logs: list[LogData], p: list[Array], slip_times: list[Array]) -> _Cycles:
        log, fall = np.repeat(np.arange(len(logs)), [f.size for f in slip_times]), np.concatenate(slip_times)
        first = np.diff(log, prepend=-1) > 0
        force = np.concatenate([one.normal_force.at(f) for one, f in zip(logs, slip_times, strict=True)])
        begin, noise, speed = (np.array([getattr(d, n) for d in logs])[log] for n in ("begin", "noise", "drive_speed"))
        # Each cycle begins about where the fall before it is.
        u = np.stack([speed, force, np.ones_like(force), np.where(first, begin, np.roll(fall, 1))], axis=1)
        return _Cycles(model, log, first, fall, np.stack(p)[log], u, noise)

    def slips(self, x: Array, per_half_period: int = PER_HALF_PERIOD) -> Slips:
        """The slip of every cycle from its arrest x (n, n_x)."""
        at_onset = sticks(self.model, x, self.p, self.u, forward=True)[1]
        return batch.slip(self.model, at_onset, self.p, self.u, per_half_period)


def place(
    model: Model, logs: list[LogData], p: list[Array], slip_times: list[Array], grid: Grid
) -> list[ShootingTrajectory | None]:
    """Place a cycle of the model on every fall: a trajectory per log, None where the model does not come to rest in one
    of its cycles (it slides).

    Args:
        p: parameter values of each log (n_p,).
        slip_times: per log, the mid-fall times of its cycles (c,) [s].
    """
    if not logs or not sum(f.size for f in slip_times):
        return [None for _ in logs]
    p = [q.copy() for q in p]
    for name, value in model.quiet:
        if np.isfinite(value):  # what vibrates is left to the shooting
            for q in p:
                q[model.parameter_names.index(name)] = value
    cycles = _Cycles.of(model, logs, p, slip_times)
    contexts, firsts = [LogContext(model, log, q) for log, q in zip(logs, p, strict=True)], [f[:1] for f in slip_times]
    # A fall is half way down after a quarter of a period, or more where it begins slowly, which its slip then shows.
    onsets = [first - 0.5 * context.half for context, first in zip(contexts, firsts, strict=True)]
    for _ in range(3):
        starts = [_begin_state(*each) for each in zip(contexts, firsts, onsets, strict=True)]
        slips, onset = _placed(logs, cycles, _arrests(cycles, starts))
        onsets = [onset[cycles.first & (cycles.log == number)] for number in range(len(logs))]
    trajectories: list[ShootingTrajectory | None] = []
    for number, log in enumerate(logs):
        mine = np.flatnonzero(cycles.log == number)
        rests = mine.size and np.all(slips.rested[mine])
        trajectories.append(_trajectory(log, starts[number], slips, mine, onset[mine], grid) if rests else None)
    return trajectories


def _arrests(cycles: _Cycles, starts: list[Array]) -> Array:
    """States (n, n_x) from which cycles start, each the arrest of the one before: handed on until it stays."""
    names = cycles.model.parameter_names
    mu_s, mu_k0, stiffness = (cycles.p[:, names.index(n)] for n in ("mu_s", "mu_k0", "stiffness"))
    level = np.maximum(2 * mu_k0 - mu_s, 0.05 * mu_k0) * cycles.u[:, 1]
    x = batch.at_force(cycles.model, level, cycles.p, cycles.u)
    x[cycles.first] = np.stack([starts[i] for i in cycles.log[cycles.first]])
    for sweep in range(1, SWEEPS[1] + 1):
        slips = cycles.slips(x, PER_HALF_PERIOD // 2)
        handed = np.where(np.isfinite(slips.at_arrest), slips.at_arrest, x)
        handed = np.where(cycles.first[:, None], x, np.roll(handed, 1, axis=0))
        moved = stiffness * np.abs(handed - x)[:, ELONGATION]
        drop = stiffness * np.abs(slips.states[0] - slips.at_arrest)[:, ELONGATION]
        x = handed
        if sweep >= SWEEPS[0] and np.all(moved <= np.maximum(0.3 * cycles.noise, 0.01 * np.nan_to_num(drop))):
            break
    return x


def _placed(logs: list[LogData], cycles: _Cycles, x: Array) -> tuple[Slips, Array]:
    """Simulate every cycle from its arrest x (n, n_x): the slips, and their onsets (n,) [s] with which they lie on
    their samples best: the best of many shifts, for a slip of two samples has several places that look right and no
    gradient leads from one to the next; then two Gauss-Newton steps."""
    slips = cycles.slips(x)
    waves, middle = Waves.of_slips(cycles.model, slips, cycles.p, cycles.u, slips.rested)
    onset = cycles.fall - middle
    time, force, weight = np.zeros((3, onset.size, WINDOW))
    interval = np.array([log.interval for log in logs])[cycles.log]
    for number, log in enumerate(logs):  # from one interval before each onset to one after the arrest, thinned
        mine = np.flatnonzero(cycles.log == number)
        margin = 1.5 * interval[mine]
        first = np.searchsorted(log.time, onset[mine] - margin)
        last = np.searchsorted(log.time, onset[mine] + waves.duration[mine] + margin)
        stride = np.maximum((last - first - 1) // WINDOW + 1, 1)
        index = first[:, None] + stride[:, None] * np.arange(WINDOW)[None, :]
        inside = (index < last[:, None]) & (index < log.time.size)
        index = np.minimum(index, log.time.size - 1)
        time[mine], force[mine] = log.time[index], log.force[index]
        weight[mine] = np.where(inside, log.weight[index], 0.0)
    force = np.where(weight > 0, force, 0.0)
    reach = np.maximum(interval, 0.1 * waves.duration)
    best, cost = onset, np.full(onset.size, np.inf)
    for fraction in np.linspace(-1.0, 1.0, SHIFTS):
        at = onset + fraction * reach
        square = np.sum(weight * (force - waves.values(time - at[:, None])) ** 2, axis=1)
        best = np.where(square < cost, at, best)
        cost = np.minimum(square, cost)
    limit = 0.5 * reach / SHIFTS
    for _ in range(2):
        value, slope = waves.with_rates(time - best[:, None])
        with np.errstate(all="ignore"):
            move = -np.sum(weight * (force - value) * slope, axis=1) / np.sum(weight * slope**2, axis=1)
        best = best + np.clip(np.where(np.isfinite(move), move, 0.0), -limit, limit)
    return slips, best


def _begin_state(context: LogContext, first: Array, onset: Array) -> Array:
    """State at the begin of the window: elongation from its first samples, age of the contact from the first onset.

    Args:
        first: mid-fall time of the first cycle [s] (1,), empty where there is none; onset: of that [s] (1,).
    """
    model, log, clamped = context.model, context.log, context.model.clamped
    fall = float(first[0]) if first.size else log.begin
    x = begin_state(context, max(log.begin + 0.8 * max(fall - log.begin, 0.0), log.time[0]))
    if clamped is None or not first.size:
        return x
    states = aged(x, clamped)
    u = np.tile([log.drive_speed, float(log.normal_force.at(onset[0])), 1.0, log.begin], (len(states), 1))
    times = sticks(model, states, np.tile(context.p, (len(states), 1)), u, forward=True)[0]
    # Where the first stick is so long that its start is forgotten, half way is as good as any.
    known = np.ptp(times) > 1e-3 * (onset[0] - log.begin)
    return states[int(np.argmin(np.abs(times - (onset[0] - log.begin))))] if known else x


def _trajectory(
    log: LogData, start: Array, slips: Slips, mine: NDArray[np.int64], onset: Array, grid: Grid
) -> ShootingTrajectory:
    """The trajectory of a log from a state at the begin (n_x,) and its slips `mine` (c,) with onsets (c,) [s]."""
    ends = {name: getattr(slips, name)[mine] for name in ("h", "wear", "arrest", "at_wear", "at_arrest")}
    own = replace(slips, states=slips.states[:, mine], rates=slips.rates[:, mine], **ends)
    renewed = np.isfinite(own.wear)
    middle = np.where(renewed, own.wear, own.arrest)[:, None]
    slip = own.at(np.linspace(0.0, 1.0, grid.slip + 1) * middle)
    wear = own.at(middle + np.linspace(0.0, 1.0, grid.renewed + 1) * (own.arrest[:, None] - middle))
    slip[:, -1], wear[:, -1] = np.where(renewed[:, None], own.at_wear, own.at_arrest), own.at_arrest
    stretches = list[Stretch]()
    for i, begun in enumerate(onset.tolist()):
        arrest = begun + float(own.arrest[i])
        stretches.append(Stretch("rest", begun, "onset", slip[i, :1]))
        if renewed[i]:
            stretches.append(Stretch("slip", begun + float(own.wear[i]), "wear", slip[i, 1:]))
            stretches.append(Stretch("renewed", arrest, "arrest", wear[i, 1:]))
        else:
            stretches.append(Stretch("slip", arrest, "arrest", slip[i, 1:]))
    return ShootingTrajectory.of(start, stretches, log.own)


# Where on the data a rest ends.

REACH = 4.0  # half periods by which an onset is moved around where it is expected, or the force falls
BY_CHANCE = 12.0  # squared deviations by which noise makes one of some hundred places the best
UNSURE = 0.05  # of a cycle: how far off its end is expected by parameters that are not the answer yet


def onset_on_data(context: LogContext, since: float, onset: float, x: Array, spread: float = np.inf) -> float:
    """Where on the data a slide that is expected from `onset` on, from state x, fits best; after `since` [s]. Where
    nothing fits better than by chance it stays where it is expected.

    Args:
        spread: how far off the expected onset may be, one standard deviation [s]; infinite: the data alone decide.
    """
    if spread == 0.0:
        return onset
    log, half, latest = context.log, context.half, context.change_after(since)
    local = np.linspace(0.0, 2.0 * half, 200)
    wave = context.motion(onset, x, float(local[-1])).sample(local)["force"]
    way = np.sign(wave[0])
    stiffness = context.values["stiffness"]
    slope = stiffness * log.speed_at(onset)
    reach, step = max(REACH * half, 2.0 * log.interval), max(half / 12, 0.25 * log.interval)
    index = context.samples(since, min(onset + 0.5 * (onset - since) + 2 * half, latest))
    width, centres = max(round(half / log.interval), 1), [onset]
    if index.size >= 2 * width:  # the steepest fall, where the force before it may be that of a stick
        sums = np.concatenate([[0.0], np.cumsum(way * log.force[index])])
        means = sums[width:] - sums[:-width]
        fall = float(log.time[index[width - 1 + int(np.argmax(means[:-width] - means[width:]))]])
        between = context.samples(onset, fall)
        rises = between.size < 3 or any(onset < change < fall for change in context.changes)
        if not rises:
            line, noise = (log.time[between], way * log.force[between]), log.noise
            rises = line_slope(*line, noise) > 0.25 * way * slope - 3.0 * slope_error(line[0], noise)
        if abs(fall - onset) > reach and (fall < onset or rises):
            centres.append(fall)

    def misfits(index: NDArray[np.intp], places: Array) -> Array:
        """Mean squares by place of the samples before the end of the wave, in noise variances."""
        after = log.time[index] - places[:, None]
        moved = log.moved(log.time[index]) - log.moved(places)[:, None]
        expected = np.where(after < 0.0, wave[0] + stiffness * moved, np.interp(after, local, wave))
        counted = after < local[-1]
        squares = np.sum(counted * log.weight[index] * (log.force[index] - expected) ** 2, axis=1)
        count = np.count_nonzero(counted, axis=1)
        return np.where(count > 0, squares / np.maximum(count, 1), np.inf)

    best, lowest, least = onset, np.inf, np.inf
    for centre in centres:
        index = context.samples(max(centre - reach - half, np.nextafter(since, np.inf)), centre + reach + local[-1])
        index = index[:: max(index.size // 400, 1)]  # samples that vote on a place
        index = index[log.time[index] < latest]  # the simulated wave does not know another speed of the drive
        if index.size < 2:
            continue
        if centre == onset:
            least = float(misfits(index, np.array([onset]))[0]) - (BY_CHANCE if np.isinf(spread) else 0.0) / index.size
        places = centre + np.arange(-reach, reach, step)
        places = places[(places > since + 1e-3 * half) & (places < latest - 1e-3 * half)]
        misfit = misfits(index, places) + ((places - onset) / spread) ** 2 / index.size
        if misfit.size and (smallest := float(misfit.min())) < lowest:
            best, lowest = float(places[int(misfit.argmin())]), smallest
    return best if lowest < least else onset


# The motion, stretch by stretch.

BRIEF = 0.05  # of half a period: a contact that re-ages for so short before it rests does so in closed form
CHUNK = 6.0  # half periods that are simulated at a time
FADED = 0.2  # of the noise: an oscillation that is smaller is not followed
LONGEST = 120  # half periods of one slide that are followed
AFTER = 0.1  # of a slide: how much of the rest after it is taken where the motion is not followed further


Followed = tuple[ShootingTrajectory, float]  # a motion from the begin of the window, and where it ends [s]


def follow(model: Model, log: LogData, p: Array, *, begins_sliding: bool) -> Followed | None:
    """The motion of a log by simulating it, and where that ends [s]: earlier than the window where an oscillation never
    fades; None where the model does not move like this at all.

    Args:
        p: parameter values of the log (n_p,); begins_sliding: it starts in steady sliding, else at rest.
    """
    motion = _Motion(model, log, p)
    try:
        return motion.run(begins_sliding)
    except SimulationError:
        return motion.so_far()


def glide(model: Model, log: LogData, p: Array) -> Followed | None:
    """The motion of a log that slides steadily from begin to end; None where the model has no such motion."""
    motion = _Motion(model, log, p)
    steady = motion.context.steady(log.begin)
    if steady is None:
        return None
    motion.glide(log.begin, log.end)
    return ShootingTrajectory.of(steady.state, motion.stretches, log.own), log.end


class _Motion:
    """A motion as it is put together."""

    def __init__(self, model: Model, log: LogData, p: Array) -> None:
        self.model, self.log, self.context = model, log, LogContext(model, log, p)
        self.stretches: list[Stretch] = []
        self.start = np.array([s.start for s in model.states])

    def run(self, begins_sliding: bool) -> Followed | None:
        """Follow the motion to the end of the window."""
        t, sliding = self.log.begin, begins_sliding
        if begins_sliding:
            steady = self.context.steady(t)
            if steady is None:
                return None
            self.start, t = steady.state, self.context.change_after(t)
            self.glide(self.log.begin, t)
        else:
            self.start = first_state(self.context)
        x = self.start
        while t < self.log.end and len(self.stretches) < 1200:
            t, x, sliding = self.slide(t, x) if sliding else self.rest(t, x)
            if np.isnan(t):
                return self._followed(self.stretches[-1].until) if self.stretches else None
        return self._followed(t) if t >= self.log.end else self.so_far()

    def _followed(self, end: float) -> Followed:
        return ShootingTrajectory.of(self.start, self.stretches, self.log.own), end

    def _last_rest(self) -> float:
        """When the last rest ended [s]."""
        return next((s.until for s in reversed(self.stretches) if s.kind == "rest"), -np.inf)

    def so_far(self) -> Followed | None:
        """The motion up to where it cannot be followed further: the end of a slide that was steady, or the rest after
        the last slip."""
        stretches = self.stretches
        while stretches and not (stretches[-1].kind.startswith("steady") or stretches[-1].ended_by == "arrest"):
            stretches.pop()
        if not stretches:
            return None
        end = stretches[-1].until
        if stretches[-1].ended_by == "arrest":
            end = min(end + AFTER * (end - max(self._last_rest(), self.log.begin)), self.context.change_after(end))
        return self._followed(end)

    def rest(self, t: float, x: Array) -> tuple[float, Array, bool]:
        """A rest and the onset that ends it, moved onto the data: its end, the state there, whether it then slides."""
        before = self._last_rest()
        begun, onset, x, changes = self.context.rest(t, x, self.log.end)
        for until, after in changes:
            if begun or until < self.log.end:
                self.stretches.append(Stretch("rest", until, "time", after[None]))
                t = until
        if not begun:
            return self.log.end, x, False
        placed = onset_on_data(self.context, t, onset, x, UNSURE * (onset - before))
        self.stretches.append(Stretch("rest", placed, "onset", x[None]))
        return placed, x, True

    def slide(self, t: float, x: Array) -> tuple[float, Array, bool]:
        """A slide until the mass rests, the drive changes, or the window ends; NaN where it is not followed further."""
        until, begun, half = self.context.change_after(t), t, self.context.half
        pieces, parts = list[tuple[float, Trajectory]](), list[tuple[str, float, str]]()  # mode, end [s], what ended it
        arrest: Phase | None = None
        faded = False
        while arrest is None and t < until and t < begun + LONGEST * half and not faded:
            motion = self.context.motion(t, x, min(CHUNK * half, until - t))
            pieces.append((t, motion))
            for phase, after in zip(motion.phases, [*(p.mode for p in motion.phases[1:]), "stick"], strict=True):
                if parts and parts[-1][0] == phase.mode and parts[-1][2] == "time":
                    parts.pop()  # only the simulation was cut there
                turns = phase.ended_by == "speed" and after != "stick"
                if phase.mode != "stick":
                    ended_by = "turn" if turns else phase.ended_by or "time"
                    parts.append((phase.mode, t + phase.start + phase.duration, ended_by))
                    brief = len(parts) > 1 and parts[-1][1] - parts[-2][1] <= BRIEF * half
                    if brief and parts[-2][2] == "turn" and ended_by == "clearance":
                        del parts[-1]  # what a contact ages where it turns is neglected
                    elif brief and parts[-2][2] == "release" and turns:
                        parts[-2:] = [(parts[-2][0], *parts[-1][1:])]
                if phase.ended_by == "speed" and phase.mode != "stick" and not turns:
                    arrest = phase
                    break
            if arrest is None:
                t, x = t + motion.duration, motion.phases[-1].end
                faded = t < until and self.faded(t, motion)
            else:
                t, x = t + arrest.start + arrest.duration, arrest.end
        # The blocks of the rest that follows do the brief re-ageing of a renewed contact.
        if arrest is not None and len(parts) > 1 and parts[-2][2] == "release" and t - parts[-2][1] <= BRIEF * half:
            parts[-2:] = [(parts[-2][0], t, "speed")]
        if parts:
            parts[-1] = (*parts[-1][:2], "time" if arrest is None else "arrest")
        after_rest = bool(self.stretches) and self.stretches[-1].kind == "rest"
        starts, since = [begin for begin, _ in pieces], begun
        for i, (mode, stop, ended) in enumerate(parts):  # nodes from the simulated pieces
            first = i == 0 and mode == "slip" and after_rest
            count = max(
                ceil(4.0 * (stop - since) / half), 8 if first else 2
            )  # four a half period, or while a contact fades
            times = np.linspace(since, stop, count + 1)[1:]
            which = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
            nodes = np.empty((count, len(self.model.states)))
            for number in np.unique(which).tolist():
                rows, (begin, motion) = which == number, pieces[number]
                sampled = motion.sample(np.clip(times[rows] - begin, 0.0, motion.duration))
                nodes[rows] = np.stack([sampled[s.name] for s in self.model.states], axis=1)
            if ended in ("arrest", "turn"):
                nodes[-1, SPEED] = 0.0
            event: End = "wear" if ended == "clearance" else ended  # type: ignore[assignment]
            self.stretches.append(Stretch("renewed" if mode == "renewed" else "slip", stop, event, nodes))
            since = stop
        if arrest is not None:
            return t, x, False
        if faded:
            self.glide(t, until)
            steady = self.context.steady(until, just_before=True)
            assert steady is not None
            return until, steady.state, True
        return (until, x, True) if t >= until else (np.nan, x, True)

    def faded(self, t: float, motion: Trajectory) -> bool:
        """Whether the last period of a motion that ends at t is steady sliding but for a part of the noise."""
        steady, period = self.context.steady(t, just_before=True), 2.0 * self.context.half
        if steady is None or motion.duration < period:
            return False
        local = np.linspace(motion.duration - period, motion.duration, 60)
        drift = self.log.normal_force.at(t - motion.duration + local) / float(self.log.normal_force.at(t))
        return bool(np.max(np.abs(motion.sample(local)["force"] - steady.force * drift)) < FADED * self.log.noise)

    def glide(self, since: float, until: float) -> None:
        """Steady sliding between two times, in as many pieces as the normal force has."""
        count = min(max(2 * self.log.normal_force.between(since, until)[0].size, 1), 200)  # of steady sliding, at most
        edges = np.linspace(since, until, count + 1).tolist()
        steady = [self.context.steady(t, just_before=i == count) for i, t in enumerate(edges)]
        states = [s for s in steady if s is not None]
        if len(states) < len(steady):
            raise SimulationError("there is no steady sliding")
        nodes = np.stack([state.state for pair in pairwise(states) for state in pair])
        kind = "steady_renewed" if all(s.renewed for s in states) else "steady"
        self.stretches.append(Stretch(kind, until, "time", nodes))  # type: ignore[arg-type]
