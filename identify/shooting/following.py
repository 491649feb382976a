"""From parameters to a trajectory of a motion that is no train of equal cycles: simulated along the data.

Drive programmes, holds, sticks that end in sliding. Each onset is moved onto the measured force before the slide goes
on from there, so that what is wrong with the parameters does not add up; what does not join up is left to the shooting.
A slide whose oscillation has faded goes on as steady sliding, which has no steps to take.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from math import ceil

import casadi as ca
import numpy as np
import scipy
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.logs.log_data import LogData
from identify.logs.noise import line_slope, slope_error
from identify.model.model import SPEED, Model
from identify.shooting import batch
from identify.shooting.shooting_trajectory import End, ShootingTrajectory, Stretch
from identify.simulation.drive import NormalForce
from identify.simulation.phases import Phase, Stick, rest
from identify.simulation.plan import Stepping
from identify.simulation.resting import Resting
from identify.simulation.simulate import run
from identify.simulation.sliding import Sliding, lasting
from identify.simulation.stepper import Situated
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

BLOCK = 64  # knots of the load under the least of which a rest is looked at first

# ----------------------------------------------------------------------------------------------------------------------
# A model under the drive and the load of a log: its forces, steady states, rests and motions.
# ----------------------------------------------------------------------------------------------------------------------


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
        self.changes = [] if log.programme is None else log.programme.changes(log.begin, log.end)

    @cached_property
    def rests(self) -> Resting:
        """Rests of the model: steady sliding has none."""
        return Resting(self.model)

    def change_after(self, t: float) -> float:
        """The next change of the drive, or the end of the window [s]."""
        return next((c for c in self.changes if c > t), self.log.end)

    def inputs(self, t: float, just_before: bool = False) -> Array:
        """Inputs (4,) of the model at a time [s]."""
        speed = self.log.speed_at(np.nextafter(t, -np.inf) if just_before else t)
        return np.array([speed, float(self.log.normal_force.at(t)), 1.0, t])

    def forces(self, t: float, x: Array, just_before: bool = False) -> Array:
        """Friction forces (n,) that the load cell shows in states x (n, n_x) at a time [N]."""
        return np.array(self.model.load_cell(x.T, self.p, self.inputs(t, just_before))).ravel()

    def steady(self, t: float, just_before: bool = False) -> Sliding | None:
        """The state of steady sliding at a time [s]."""
        u = self.inputs(t, just_before)
        return lasting(self.model, self.p, u) if u[0] > 0.0 else None

    def rest(self, t: float, x: Array, end: float) -> tuple[bool, float, Array, list[tuple[float, Array]]]:
        """A rest from x at t until the static limit is overcome, at most until `end` [s]: whether it is, when, the
        state then, and time and state at each change of the drive before that.

        Raises:
            SimulationError: the drive pulls the mass back.
        """
        changes, load = list[tuple[float, Array]](), self.log.normal_force

        def until(time: float, force: tuple[float, float]) -> Stick:
            return rest(self.rests, x, Situated(self.p, self.log.speed_at(t), 1.0, *force, t), t, time - t)

        while t < end:
            change, knot = min(self.change_after(t), end), bisect_right(load.times, t)
            stick, last = None, knot + BLOCK
            if last < len(load.times) and load.times[last] < change and not _moved_by_load(self.model):
                # Over many knots of the load at once, where not even the least load of them would end the rest.
                least = float(np.min([load.at(t), *load.knots[1][knot : last + 1]]))
                stick = until(load.times[last], (least, 0.0))
            if stick is None or stick.ended_by is not None:
                last = knot
                stick = until(min([change, *load.times[knot : knot + 1]]), load.line(t))
            t, x = stick.start + stick.duration, stick.end
            if stick.ended_by is not None:
                if stick.drive_force < 0.0:
                    raise SimulationError("the mass is pulled back")
                return True, t, x, changes
            t = min([change, *load.times[last : last + 1]])
            if t == change:
                changes.append((t, x))
        return False, t, x, changes

    def motion(self, t: float, x: Array, duration: float) -> Trajectory:
        """The simulated motion from state x at t [s]."""
        load = self.log.normal_force
        times = np.array([t, *load.between(t, t + duration)[0], t + duration])
        start = dict(zip((s.name for s in self.model.states), x.tolist(), strict=True))
        force, stepping = NormalForce.of((times - t, load.at(times))), Stepping(1e-7)  # of a simulation step
        return run(self.model, self.values, self.log.speed_at(t), force, duration, start=start, accuracy=stepping)

    def samples(self, begin: float, end: float) -> NDArray[np.intp]:
        """Samples between two times [s] that count."""
        first, last = np.searchsorted(self.log.time, [begin, end])
        return np.flatnonzero(self.log.weight[first:last] > 0) + first


# ----------------------------------------------------------------------------------------------------------------------
# Where on the data a rest ends.
# ----------------------------------------------------------------------------------------------------------------------

REACH = 4.0  # half periods by which an onset is moved around where it is expected, or the force falls
PER_HALF_PERIOD = 12  # places per half period that are tried
BY_CHANCE = 12.0  # squared deviations by which noise makes one of some hundred places the best
UNSURE = 0.05  # of a cycle: how far off its end is expected by parameters that are not the answer yet
SEARCHED = 0.5  # of a rest: how far beyond its expected end the steepest fall is looked for
LEVEL, SURE_RISE = 0.25, 3.0  # of the slope of a stick, and standard errors: a force that rises less is no stick


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
    slope = context.values["stiffness"] * log.speed_at(onset)
    reach, step = max(REACH * half, 2.0 * log.interval), max(half / PER_HALF_PERIOD, 0.25 * log.interval)
    index = context.samples(since, min(onset + SEARCHED * (onset - since) + 2 * half, latest))
    fall = _steepest_fall(log, index, max(round(half / log.interval), 1))
    centres = [onset]
    if fall is not None and abs(fall - onset) > reach and (fall < onset or _may_stick(context, onset, fall, slope)):
        centres.append(fall)

    def misfits(index: NDArray[np.intp], places: Array) -> Array:
        """Mean squares by place of the samples before the end of the wave, in noise variances."""
        after = log.time[index] - places[:, None]
        expected = np.where(after < 0.0, wave[0] + slope * after, np.interp(after, local, wave))
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


def _may_stick(context: LogContext, begin: float, end: float, slope: float) -> bool:
    """Whether the force between two times [s] may be that of a stick that loads at `slope` [N/s]."""
    index = context.samples(begin, end)
    if index.size < 3 or any(begin < change < end for change in context.changes):
        return True
    time, noise = context.log.time[index], context.log.noise
    return line_slope(time, context.log.force[index], noise) > LEVEL * slope - SURE_RISE * slope_error(time, noise)


def _steepest_fall(log: LogData, index: NDArray[np.intp], width: int) -> float | None:
    """Where the force falls most from so many samples to the next [s]; None where there are not two of them."""
    if index.size < 2 * width:
        return None
    sums = np.concatenate([[0.0], np.cumsum(log.force[index])])
    means = sums[width:] - sums[:-width]
    return float(log.time[index[width - 1 + int(np.argmax(means[:-width] - means[width:]))]])


# ----------------------------------------------------------------------------------------------------------------------
# How it begins: the elongation from the first samples, and the contact aged so that the first slip lies on the data.
# ----------------------------------------------------------------------------------------------------------------------

PEAK_WINDOW = 0.2  # of half a period: width of the mean whose highest value is the first peak
FIRST_SWINGS = 8.0  # half periods about the first peak that are compared
AGES = np.linspace(0.0, 1.0, 41)  # states of the contact that are tried


def first_state(context: LogContext) -> Array:
    """State at the begin of the window: the elongation from the first samples, the contact half aged or such that
    the first slip lies on the data."""
    log, model, stiffness = context.log, context.model, context.values["stiffness"]
    moving = next((c for c in (log.begin, *context.changes) if log.speed_at(c) > 0.0), log.end)
    index = context.samples(moving, context.change_after(moving))
    peak = until = log.begin
    if index.size > 2:
        width = max(min(int(PEAK_WINDOW * context.half / log.interval), index.size // 3), 1)
        smooth = scipy.ndimage.uniform_filter1d(log.force[index], width, mode="nearest")
        peak = float(log.time[index[int(np.argmax(smooth))]])
        until = float(log.time[index[int(np.argmax(smooth >= smooth[0] + 0.5 * np.ptp(smooth)))]])  # rests until there
    index = context.samples(log.begin, np.nextafter(until, np.inf))
    if index.size == 0:
        index = np.array([min(int(np.searchsorted(log.time, log.begin)), log.time.size - 1)])
    edges = np.array([log.begin, *(c for c in context.changes if c < until), max(until, log.time[index[-1]])])
    moved = np.concatenate([[0.0], np.cumsum([(b - a) * log.speed_at(0.5 * (a + b)) for a, b in pairwise(edges)])])
    level = float(np.median(log.force[index] - stiffness * np.interp(log.time[index], edges, moved)))
    x = batch.at_force(model, np.array([level]), context.p[None], context.inputs(log.begin)[None])[0]
    if model.clamped is not None:
        x[model.clamped] = _aged_at_begin(context, x, model.clamped, peak)
    return x


def _aged_at_begin(context: LogContext, x: Array, clamped: int, peak: float) -> float:
    """The bounded state with which the first slip lies on the data about the first peak [s]; half way without any."""
    log = context.log
    begin = max(peak - FIRST_SWINGS * context.half, log.begin)
    end = min(peak + FIRST_SWINGS * context.half, context.change_after(peak))
    index = context.samples(begin, end)

    def aged(value: float) -> Array:
        return np.where(np.arange(x.size) == clamped, value, x)

    def misfit(value: float) -> float:
        try:
            begun, _t, state, _ = context.rest(log.begin, aged(value), begin)
            if begun or index.size == 0:
                return np.inf
            shown = context.motion(begin, state, end - begin).sample(log.time[index] - begin)["force"]
        except SimulationError:
            return np.inf
        return float(np.mean(log.weight[index] * (log.force[index] - shown) ** 2))

    rests = [context.rest(log.begin, aged(value), log.end) for value in AGES]
    onsets = np.array([t if begun else np.inf for begun, t, _, _ in rests])
    finite = onsets[np.isfinite(onsets)]
    if not finite.size or np.ptp(finite) <= 1e-3 * (peak - log.begin):
        return 0.5
    near = AGES[(onsets >= begin) & (onsets < end)]
    if 0 < near.size < AGES.size // 4:
        near = np.linspace(near[0], near[-1], 2 * near.size - 1)
    misfits = np.array([misfit(value) for value in near.tolist()])
    if np.isfinite(misfits).any():
        return float(near[int(np.argmin(misfits))])
    return float(AGES[int(np.argmin(np.abs(onsets - peak)))])


# ----------------------------------------------------------------------------------------------------------------------
# The motion, stretch by stretch.
# ----------------------------------------------------------------------------------------------------------------------

INTERVAL = 1 / 4  # of half a period: shooting intervals of a slide
FIRST_INTERVALS = 8  # of the part of a slip in which the contact fades
BRIEF = 0.05  # of half a period: a contact that re-ages for so short before it rests does so in closed form
CHUNK = 6.0  # half periods that are simulated at a time
FADED = 0.2  # of the noise: an oscillation that is smaller is not followed
LONGEST = 120  # half periods of one slide that are followed
AFTER = 0.1  # of a slide: how much of the rest after it is taken where the motion is not followed further


@dataclass(frozen=True)
class Followed:
    """A motion from the begin of the window: the trajectory, and where it ends [s]: earlier than the window where an
    oscillation never fades."""

    trajectory: ShootingTrajectory
    end: float


def follow(model: Model, log: LogData, p: Array, *, begins_sliding: bool) -> Followed | None:
    """The motion of a log by simulating it; None where the model does not move like this at all.

    Args:
        p: parameter values of the log (n_p,); begins_sliding: it starts in steady sliding, else at rest.
    """
    motion = _Motion(model, log, p)
    try:
        return motion.run(begins_sliding)
    except SimulationError:
        return motion.so_far()


def glide(model: Model, log: LogData, p: Array) -> ShootingTrajectory | None:
    """The motion of a log that slides steadily from begin to end; None where the model has no such motion."""
    motion = _Motion(model, log, p)
    steady = motion.context.steady(log.begin)
    if steady is None:
        return None
    motion.glide(log.begin, log.end)
    return ShootingTrajectory.of(steady.state, motion.stretches, log.own)


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
        return Followed(ShootingTrajectory.of(self.start, self.stretches, self.log.own), end)

    def _last_rest(self) -> float:
        """When the last rest ended [s]."""
        return next((s.until for s in reversed(self.stretches) if s.kind == "rest"), -np.inf)

    def so_far(self) -> Followed | None:
        """The motion up to where it cannot be followed further: the end of a slide that was steady, or the rest after
        the last slip."""
        stretches = self.stretches
        while stretches and not (stretches[-1].steady or stretches[-1].ended_by == "arrest"):
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
            for phase in motion.phases:
                if parts and parts[-1][0] == phase.mode and parts[-1][2] == "time":
                    parts.pop()  # only the simulation was cut there
                if phase.mode != "stick":
                    parts.append((phase.mode, t + phase.start + phase.duration, phase.ended_by or "time"))
                if phase.ended_by == "speed" and phase.mode != "stick":
                    arrest = phase
                    break
            if arrest is None:
                t, x = t + motion.duration, motion.phases[-1].end
                faded = t < until and self.faded(t, motion)
            else:
                t, x = t + arrest.start + arrest.duration, arrest.end
        # The blocks of the rest that follows do the brief re-ageing of a worn contact.
        if arrest is not None and len(parts) > 1 and parts[-2][2] == "release" and t - parts[-2][1] <= BRIEF * half:
            parts[-2:] = [(parts[-2][0], t, "speed")]
        if parts:
            parts[-1] = (*parts[-1][:2], "time" if arrest is None else "arrest")
        self._add(begun, parts, pieces)
        if arrest is not None:
            return t, x, False
        if faded:
            self.glide(t, until)
            steady = self.context.steady(until, just_before=True)
            assert steady is not None
            return until, steady.state, True
        return (until, x, True) if t >= until else (np.nan, x, True)

    def _add(self, since: float, parts: list[tuple[str, float, str]], pieces: list[tuple[float, Trajectory]]) -> None:
        """The stretches of a slide from its parts, with nodes from the simulated pieces."""
        after_rest, starts = bool(self.stretches) and self.stretches[-1].kind == "rest", [t for t, _ in pieces]
        ends: dict[str, End] = {"clearance": "wear", "release": "release", "arrest": "arrest", "time": "time"}
        for i, (mode, end, ended) in enumerate(parts):
            first = i == 0 and mode == "slip" and after_rest
            count = max(ceil((end - since) / (INTERVAL * self.context.half)), FIRST_INTERVALS if first else 2)
            times = np.linspace(since, end, count + 1)[1:]
            which = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
            nodes = np.empty((count, len(self.model.states)))
            for number in np.unique(which).tolist():
                rows, (begin, motion) = which == number, pieces[number]
                sampled = motion.sample(np.clip(times[rows] - begin, 0.0, motion.duration))
                nodes[rows] = np.stack([sampled[s.name] for s in self.model.states], axis=1)
            if ended == "arrest":
                nodes[-1, SPEED] = 0.0
            self.stretches.append(Stretch("worn" if mode == "worn" else "slip", end, ends[ended], nodes))
            since = end

    def faded(self, t: float, motion: Trajectory) -> bool:
        """Whether the last period of a motion that ends at t is steady sliding but for a part of the noise."""
        steady, period = self.context.steady(t, just_before=True), 2.0 * self.context.half
        if steady is None or motion.duration < period:
            return False
        local = np.linspace(motion.duration - period, motion.duration, 60)
        level = self.context.forces(t, steady.state[None], just_before=True)
        drift = self.log.normal_force.at(t - motion.duration + local) / float(self.log.normal_force.at(t))
        return bool(np.max(np.abs(motion.sample(local)["force"] - level * drift)) < FADED * self.log.noise)

    def glide(self, since: float, until: float) -> None:
        """Steady sliding between two times, in as many pieces as the normal force has."""
        count = min(max(2 * self.log.normal_force.between(since, until)[0].size, 1), 200)  # of steady sliding, at most
        edges = np.linspace(since, until, count + 1).tolist()
        steady = [self.context.steady(t, just_before=i == count) for i, t in enumerate(edges)]
        states = [s for s in steady if s is not None]
        if len(states) < len(steady):
            raise SimulationError("there is no steady sliding")
        nodes = np.stack([state.state for pair in pairwise(states) for state in pair])
        kind = "steady_worn" if all(s.worn for s in states) else "steady"
        self.stretches.append(Stretch(kind, until, "time", nodes))  # type: ignore[arg-type]
