"""From parameters to a trajectory of a motion that is no train of equal cycles: simulated along the data.

Drive programmes, holds, sticks that end in sliding. Each onset is moved onto the measured force before the slide goes
on from there, so that what is wrong with the parameters does not add up; what does not join up is left to the shooting.
A slide whose oscillation has faded goes on as steady sliding, which has no steps to take.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise
from math import ceil
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from identify.base.errors import SimulationError
from identify.logs.log_data import LogData
from identify.logs.noise import line_slope, slope_error
from identify.model.model import SPEED, Model
from identify.shooting import batch
from identify.shooting.shooting_trajectory import ShootingTrajectory, Stretch
from identify.simulation.drive import NormalForce
from identify.simulation.phases import Phase, Stick, rest
from identify.simulation.plan import Stepping
from identify.simulation.resting import Resting
from identify.simulation.simulate import run
from identify.simulation.sliding import Sliding, lasting
from identify.simulation.stepper import Situated
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

TOLERANCE = 1e-7  # of a simulation step
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

    def drive_motion(self, t: float) -> float:
        """How far the drive has gone since the begin of the window [m]."""
        edges = [self.log.begin, *(c for c in self.changes if c < t), t]
        return sum((b - a) * self.log.speed_at(0.5 * (a + b)) for a, b in pairwise(edges))

    def rest(self, t: float, x: Array, end: float) -> tuple[bool, float, Array, list[tuple[float, Array]]]:
        """A rest from x at t until the static limit is overcome, at most until `end` [s]: whether it is, when, the
        state then, and time and state at each change of the drive before that.

        Raises:
            SimulationError: the drive pulls the mass back.
        """
        changes: list[tuple[float, Array]] = []
        while t < end:
            change = min(self.change_after(t), end)
            stick, until = self._under_least_load(t, x, change) or self._until_knot(t, x, change)
            t, x = stick.start + stick.duration, stick.end
            if stick.ended_by is not None:
                if stick.drive_force < 0.0:
                    raise SimulationError("the mass is pulled back")
                return True, t, x, changes
            t = until
            if t == change:
                changes.append((t, x))
        return False, t, x, changes

    def _until_knot(self, t: float, x: Array, change: float) -> tuple[Stick, float]:
        """A rest until the slope of the load or the drive changes, and when that is [s]."""
        load = self.log.normal_force
        knot = bisect_right(load.times, t)
        until = min([change, *load.times[knot : knot + 1]])
        return rest(self.rests, x, Situated(self.p, self.log.speed_at(t), 1.0, *load.line(t), t), t, until - t), until

    def _under_least_load(self, t: float, x: Array, change: float) -> tuple[Stick, float] | None:
        """A rest over BLOCK knots of the load at once, where not even the least load of them would end it."""
        load = self.log.normal_force
        last = bisect_right(load.times, t) + BLOCK
        if last >= len(load.times) or not load.times[last] < change or _moved_by_load(self.model):
            return None
        until = load.times[last]
        least = float(np.min([load.at(t), *load.knots[1][last - BLOCK : last + 1]]))
        stick = rest(self.rests, x, Situated(self.p, self.log.speed_at(t), 1.0, least, 0.0, t), t, until - t)
        return (stick, until) if stick.ended_by is None else None

    def motion(self, t: float, x: Array, duration: float) -> Trajectory:
        """The simulated motion from state x at t [s]."""
        load = self.log.normal_force
        times = np.array([t, *load.between(t, t + duration)[0], t + duration])
        start = dict(zip((s.name for s in self.model.states), x.tolist(), strict=True))
        force, stepping = NormalForce.of((times - t, load.at(times))), Stepping(TOLERANCE)
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
COMPARED = 400  # samples that vote on a place
BY_CHANCE = 12.0  # squared deviations by which noise makes one of some hundred places the best
UNSURE = 0.05  # of a cycle: how far off its end is expected by parameters that are not the answer yet
SEARCHED = 0.5  # of a rest: how far beyond its expected end the steepest fall is looked for
LEVEL, SURE_RISE = 0.25, 3.0  # of the slope of a stick, and standard errors: a force that rises less is no stick
PEAK_WINDOW = 0.2  # of half a period: width of the mean whose highest value is the first peak


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
    centres = [onset]
    fall = _steepest_fall(context, context.samples(since, min(onset + SEARCHED * (onset - since) + 2 * half, latest)))
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
        index = index[:: max(index.size // COMPARED, 1)]
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


def _steepest_fall(context: LogContext, index: NDArray[np.intp]) -> float | None:
    """Where the force falls most from one half period to the next [s]; None where there are not two."""
    width = max(round(context.half / context.log.interval), 1)
    if index.size < 2 * width:
        return None
    sums = np.concatenate([[0.0], np.cumsum(context.log.force[index])])
    means = sums[width:] - sums[:-width]
    return float(context.log.time[index[width - 1 + int(np.argmax(means[:-width] - means[width:]))]])


# ----------------------------------------------------------------------------------------------------------------------
# How it begins: the elongation from the first samples, and the contact aged so that the first slip lies on the data.
# ----------------------------------------------------------------------------------------------------------------------

RISEN = 0.5  # share of the rise to the first peak on which the mass rests for sure
FIRST_SWINGS = 8.0  # half periods about the first peak that are compared
AGES = 41  # states of the contact that are tried


def first_state(context: LogContext) -> Array:
    """State at the begin of the window: the elongation from the first samples, the contact half aged or such that
    the first slip lies on the data."""
    log, model = context.log, context.model
    moving = next((c for c in (log.begin, *context.changes) if log.speed_at(c) > 0.0), log.end)
    index = context.samples(moving, context.change_after(moving))
    peak = until = log.begin
    if index.size > 2:
        width = max(min(int(PEAK_WINDOW * context.half / log.interval), index.size // 3), 1)
        smooth = uniform_filter1d(log.force[index], width, mode="nearest")
        peak = float(log.time[index[int(np.argmax(smooth))]])
        until = float(log.time[index[int(np.argmax(smooth >= smooth[0] + RISEN * (smooth.max() - smooth[0])))]])
    index = context.samples(log.begin, np.nextafter(until, np.inf))
    if index.size == 0:
        index = np.array([min(int(np.searchsorted(log.time, log.begin)), log.time.size - 1)])
    moved = np.array([context.drive_motion(t) for t in log.time[index]])
    level = float(np.median(log.force[index] - context.values["stiffness"] * moved))
    x = batch.at_force(model, np.array([level]), context.p[None], context.inputs(log.begin)[None])[0]
    if model.clamped is not None:
        x[model.clamped] = _aged_at_begin(context, x, peak)
    return x


def _aged_at_begin(context: LogContext, x: Array, peak: float) -> float:
    """The bounded state with which the first slip lies on the data about the first peak [s]; half way where that does
    not depend on it."""
    log, clamped = context.log, context.model.clamped
    assert clamped is not None
    begin = max(peak - FIRST_SWINGS * context.half, log.begin)
    end = min(peak + FIRST_SWINGS * context.half, context.change_after(peak))

    def aged(value: float) -> Array:
        state = x.copy()
        state[clamped] = value
        return state

    index = context.samples(begin, end)

    def misfit(value: float) -> float:
        try:
            begun, _t, state, _ = context.rest(log.begin, aged(value), begin)
            if begun or index.size == 0:
                return np.inf
            shown = context.motion(begin, state, end - begin).sample(log.time[index] - begin)["force"]
        except SimulationError:
            return np.inf
        return float(np.mean(log.weight[index] * (log.force[index] - shown) ** 2))

    ages = np.linspace(0.0, 1.0, AGES)
    rests = [context.rest(log.begin, aged(value), log.end) for value in ages]
    onsets = np.array([t if begun else np.inf for begun, t, _, _ in rests])
    finite = onsets[np.isfinite(onsets)]
    if not finite.size or np.ptp(finite) <= 1e-3 * (peak - log.begin):
        return 0.5
    near = ages[(onsets >= begin) & (onsets < end)]
    if near.size:
        values = np.concatenate([near, (near[:-1] + near[1:]) / 2 if near.size < AGES // 4 else []])
        misfits = [misfit(value) for value in values.tolist()]
        if np.isfinite(np.min(misfits)):
            return float(values[int(np.argmin(misfits))])
    return float(ages[int(np.argmin(np.abs(onsets - peak)))])


# ----------------------------------------------------------------------------------------------------------------------
# One simulated slide as stretches of a trajectory: which phases it has, and the states at their shooting nodes.
# ----------------------------------------------------------------------------------------------------------------------

INTERVAL = 1 / 4  # of half a period: shooting intervals of a slide
FIRST_INTERVALS = 8  # of the part of a slip in which the contact fades
BRIEF = 0.05  # of half a period: a contact that re-ages for so short before it rests does so in closed form


@dataclass
class SlideParts:
    """A slide as it is simulated, a piece at a time. begun: its onset [s]; half: half period of the rig [s]."""

    model: Model
    begun: float
    half: float
    _pieces: list[tuple[float, Trajectory]] = field(default_factory=list)
    _parts: list[tuple[str, float, str]] = field(default_factory=list)  # mode, end [s], what ended it

    def take(self, t: float, motion: Trajectory) -> Phase | None:
        """The motion from t [s] on; the phase at whose end the mass comes to rest, None where it does not."""
        self._pieces.append((t, motion))
        for phase in motion.phases:
            if phase.mode == "stick":
                continue
            end, parts = t + phase.start + phase.duration, self._parts
            if parts and parts[-1][0] == phase.mode and parts[-1][2] == "time":
                parts.pop()  # only the simulation was cut there
            parts.append((phase.mode, end, phase.ended_by or "time"))
            if phase.ended_by == "speed":
                # The blocks of the rest that follows do the brief re-ageing of a worn contact.
                if len(parts) > 1 and parts[-2][2] == "release" and end - parts[-2][1] <= BRIEF * self.half:
                    parts[-2:] = [(parts[-2][0], end, "speed")]
                return phase
        return None

    def stretches(self, last: Literal["arrest", "time"], *, after_rest: bool) -> list[Stretch]:
        """The stretches with their nodes; last: what ends the last one; after_rest: the slide begins with an onset."""
        since, out = self.begun, list[Stretch]()
        for i, (mode, end, ended) in enumerate(self._parts):
            first = i == 0 and mode == "slip" and after_rest
            count = max(ceil((end - since) / (INTERVAL * self.half)), FIRST_INTERVALS if first else 2)
            nodes = self._states(np.linspace(since, end, count + 1)[1:])
            if i + 1 == len(self._parts):
                ended = last
            if ended == "arrest":
                nodes[-1, SPEED] = 0.0
            kept = "wear" if ended == "clearance" else ended
            out.append(Stretch(mode, end, kept, nodes))  # type: ignore[arg-type]
            since = end
        return out

    def _states(self, times: Array) -> Array:
        """States (n, n_x) of the joined pieces at times (n,) [s]."""
        starts = np.array([t for t, _ in self._pieces])
        which = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
        out = np.empty((times.size, len(self.model.states)))
        for i in np.unique(which).tolist():
            rows, (begin, motion) = which == i, self._pieces[i]
            sampled = motion.sample(np.clip(times[rows] - begin, 0.0, motion.duration))
            out[rows] = np.stack([sampled[s.name] for s in self.model.states], axis=1)
        return out


# ----------------------------------------------------------------------------------------------------------------------
# The motion, stretch by stretch.
# ----------------------------------------------------------------------------------------------------------------------

CHUNK = 6.0  # half periods that are simulated at a time
FADED = 0.2  # of the noise: an oscillation that is smaller is not followed
LONGEST = 120  # half periods of one slide that are followed
AFTER = 0.1  # of a slide: how much of the rest after it is taken where the motion is not followed further
MOST_STRETCHES = 1200
PIECES = 200  # of steady sliding, at most
SHOWN, HIDDEN = 1.0, 3  # squared deviations of a slip that stands out of the noise; slips in a row that do not


@dataclass(frozen=True)
class Followed:
    """A motion from the begin of the window: the trajectory, and where it ends [s]: earlier than the window where an
    oscillation never fades, or the noise hides slips."""

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
        self.seen = 0  # of these, up to the last slip that stands out of the noise
        self.start = np.array([s.start for s in model.states])

    def run(self, begins_sliding: bool) -> Followed | None:
        """Follow the motion to the end of the window."""
        t, sliding, hidden = self.log.begin, begins_sliding, 0
        if begins_sliding:
            steady = self.context.steady(t)
            if steady is None:
                return None
            self.start, t = steady.state, self.context.change_after(t)
            self.glide(self.log.begin, t)
            self.seen = len(self.stretches)
        else:
            self.start = first_state(self.context)
        x = self.start
        while t < self.log.end and len(self.stretches) < MOST_STRETCHES:
            if not sliding:
                t, x, sliding = self.rest(t, x)
                continue
            t, x, sliding = self.slide(t, x)
            if np.isnan(t):
                return self._followed(self.stretches[-1].until) if self.stretches else None
            hidden = 0 if self.shows() else hidden + 1
            self.seen = len(self.stretches) if hidden == 0 else self.seen
            if hidden == HIDDEN:  # to go on would make up how often it slips until the window ends
                return self.so_far()
        return self._followed(t) if t >= self.log.end else self.so_far()

    def _followed(self, end: float) -> Followed:
        return Followed(ShootingTrajectory.of(self.start, self.stretches, self.log.own), end)

    def last_rest(self) -> int | None:
        """The place of the last rest; None where there is none."""
        return next((i for i in range(len(self.stretches) - 1, -1, -1) if self.stretches[i].kind == "rest"), None)

    def shows(self) -> bool:
        """Whether the last slip stands out of the noise: by the squared deviations of a sawtooth from a level force.
        A slide without a rest before or after it does."""
        rest, last = self.last_rest(), self.stretches[-1]
        if rest is None or last.ended_by != "arrest" or self.stretches[rest].ended_by != "onset":
            return True
        begun = self.stretches[rest].until
        again = rest > 0 and self.stretches[rest - 1].ended_by == "arrest"
        length = last.until - self.stretches[rest - 1].until if again else 2.0 * (last.until - begun)
        nodes = np.concatenate([self.stretches[rest].nodes[-1:], *(s.nodes for s in self.stretches[rest + 1 :])])
        height = float(np.ptp(self.context.forces(0.5 * (begun + last.until), nodes)))
        return length / self.log.interval * (height / self.log.noise) ** 2 / 12.0 >= SHOWN

    def so_far(self) -> Followed | None:
        """The motion up to where it cannot be followed further: the end of a slide that was steady, or the rest after
        the last slip that stands out of the noise."""
        stretches = self.stretches
        del stretches[self.seen :]
        while stretches and not (stretches[-1].steady or stretches[-1].ended_by == "arrest"):
            stretches.pop()
        if not stretches:
            return None
        end = stretches[-1].until
        if stretches[-1].ended_by == "arrest":
            end = min(end + AFTER * (end - stretches[self.last_rest() or 0].until), self.context.change_after(end))
        return self._followed(end)

    def rest(self, t: float, x: Array) -> tuple[float, Array, bool]:
        """A rest and the onset that ends it, moved onto the data: its end, the state there, whether it then slides."""
        last = self.last_rest()
        before = -np.inf if last is None else self.stretches[last].until
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
        until, begun = self.context.change_after(t), t
        slide = SlideParts(self.model, begun, self.context.half)
        arrest: Phase | None = None
        faded = False
        while t < until and t < begun + LONGEST * self.context.half and not faded:
            motion = self.context.motion(t, x, min(CHUNK * self.context.half, until - t))
            arrest = slide.take(t, motion)
            if arrest is not None:
                t, x = t + arrest.start + arrest.duration, arrest.end
                break
            t, x = t + motion.duration, motion.phases[-1].end
            faded = t < until and self.faded(t, motion)
        after_rest = bool(self.stretches) and self.stretches[-1].kind == "rest"
        self.stretches += slide.stretches("time" if arrest is None else "arrest", after_rest=after_rest)
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
        steady = self.context.steady(t, just_before=True)
        if steady is None or motion.duration < 2.0 * self.context.half:
            return False
        local = np.linspace(motion.duration - 2.0 * self.context.half, motion.duration, 60)
        shown = motion.sample(local)["force"]
        level = self.context.forces(t, steady.state[None], just_before=True)
        drift = self.log.normal_force.at(t - motion.duration + local) / float(self.log.normal_force.at(t))
        return bool(np.max(np.abs(shown - level * drift)) < FADED * self.log.noise)

    def glide(self, since: float, until: float) -> None:
        """Steady sliding between two times, in as many pieces as the normal force has."""
        count = min(max(2 * self.log.normal_force.between(since, until)[0].size, 1), PIECES)
        edges = np.linspace(since, until, count + 1)
        steady = [self.context.steady(t, just_before=i == count) for i, t in enumerate(edges.tolist())]
        states = [s for s in steady if s is not None]
        if len(states) < len(steady):
            raise SimulationError("there is no steady sliding")
        nodes = np.stack([state.state for pair in pairwise(states) for state in pair])
        kind: Literal["steady", "steady_worn"] = "steady_worn" if all(s.worn for s in states) else "steady"
        self.stretches.append(Stretch(kind, until, "time", nodes))
