"""From parameters to a trajectory of a motion that is no train of equal cycles: simulated stretch by stretch along the
data.

Drive programmes, holds, sticks that end in sliding. Each onset is moved onto the peak of the measured force before the
slide goes on from there, so that what is wrong with the parameters does not add up; what does not join up is left to
the shooting. A slide whose oscillation has faded goes on as steady sliding, which has no steps to take.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import pairwise
from math import ceil
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.logs.log_data import LogData
from identify.logs.slips import line_slope, slope_error
from identify.model.model import SPEED, Model
from identify.shooting import batch as lanes
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

# ----------------------------------------------------------------------------------------------------------------------
# Where on the data a rest ends: at the peak of the measured force, at its steepest fall, or where it is expected.
# ----------------------------------------------------------------------------------------------------------------------

REACH = 4.0  # half periods by which an onset is moved at most around what the data or the simulation say
PER_HALF_PERIOD = 12  # places per half period that are tried
PEAK = 0.5  # of a rest: how far from its simulated end the peak is looked for
COMPARED = 400  # samples that vote on a place
BY_CHANCE = 12.0  # squared deviations by which noise makes one of some hundred places the best
FEWEST = 3  # samples that have a highest one
BINS, RISEN = 50, 0.8  # means up to the first peak, and share of its height that is reached on the way for sure
LEVEL, SURE_RISE = 0.25, 3.0  # of the slope of a stick, and standard errors: a force that rises less is no stick


@dataclass(frozen=True)
class SlipWaveform:
    """The simulated force (k,) [N] at times (k,) [s] after an onset, and its slope before it [N/s]."""

    time: Array
    force: Array
    slope: float

    def at(self, after: Array) -> Array:
        """The force (n,) at times (n,) after the onset, negative ones before it."""
        return np.where(after < 0.0, self.force[0] + self.slope * after, np.interp(after, self.time, self.force))

    @property
    def length(self) -> float:
        """How long it is known after the onset [s]."""
        return float(self.time[-1])

    @property
    def peak(self) -> float:
        """When after the onset it is highest [s]."""
        return float(self.time[int(np.argmax(self.force))])


@dataclass(frozen=True)
class DataSide:
    """A log as rests are looked for in it. half: half period of the rig [s]; changes of the drive in the window [s]."""

    log: LogData
    half: float
    changes: tuple[float, ...]

    def change_after(self, t: float) -> float:
        """The next change of the drive, or the end of the window [s]."""
        return next((c for c in self.changes if c > t), self.log.end)

    def placed(self, since: float, onset: float, wave: SlipWaveform, spread: float = np.inf) -> float:
        """Where on the data the wave of a slide that is expected from `onset` on fits best; after `since` [s]. Where
        nothing fits better than by chance it stays where it is expected.

        Args:
            spread: how far off the expected onset may be, one standard deviation [s]; infinite: the data alone say;
                nought: it is where it is expected, as after a rest of no length.
        """
        if spread == 0.0:
            return onset
        log, by_chance = self.log, BY_CHANCE if np.isinf(spread) else 0.0
        reach = max(REACH * self.half, 2.0 * log.interval)
        step = max(self.half / PER_HALF_PERIOD, 0.25 * log.interval)
        centres = self.centres(since, onset, wave, reach)
        around = np.arange(-reach, reach, step)
        latest = self.change_after(since) - 1e-3 * self.half
        best, lowest, least = onset, np.inf, np.inf
        for centre in centres:
            first, last = np.searchsorted(log.time, [centre - reach - self.half, centre + reach + wave.length])
            index = np.arange(first, last, max((last - first) // COMPARED, 1))
            # The simulated wave knows nothing of another speed of the drive.
            index = index[(log.weight[index] > 0) & (log.time[index] > since) & (log.time[index] < latest)]
            if index.size < 2:
                continue
            if centre == onset:
                least = float(self._misfits(index, np.array([onset]), wave)[0]) - by_chance / index.size
            places = centre + around
            places = places[(places > since + 1e-3 * self.half) & (places < latest)]
            misfits = self._misfits(index, places, wave) + ((places - onset) / spread) ** 2 / index.size
            if misfits.size and (smallest := float(misfits.min())) < lowest:
                best, lowest = float(places[int(misfits.argmin())]), smallest
        return best if lowest < least else onset

    def _misfits(self, index: NDArray[np.intp], places: Array, wave: SlipWaveform) -> Array:
        """Mean squares of what some samples lie off the wave of a slide from each place (m,) [s] on, over the noise;
        infinite where none lies under the wave."""
        after = self.log.time[index] - places[:, None]
        counted = after < wave.length
        off = np.where(counted, self.log.weight[index] * (self.log.force[index] - wave.at(after)) ** 2, 0.0)
        count = np.count_nonzero(counted, axis=1)
        return np.where(count > 0, off.sum(axis=1) / np.maximum(count, 1), np.inf)

    def centres(self, since: float, onset: float, wave: SlipWaveform, reach: float) -> list[float]:
        """What an onset is looked for around [s]."""
        used = self._used(since, min(onset + PEAK * (onset - since) + 2 * self.half, self.change_after(since)))
        found = [onset, (onset if used.size < FEWEST else self._highest(used)) - wave.peak]
        # Where a rest rises by less than the noise from sample to sample, its highest one lies anywhere near its end.
        fall = self._steepest_fall(used)
        if fall is not None and min(abs(fall - centre) for centre in found) > reach:
            found.append(fall)
        return [c for c in found if all(self._may_rest(other, c, wave.slope) for other in found if other < c)]

    def _may_rest(self, begin: float, end: float, slope: float) -> bool:
        """Whether the force between two times [s] may belong to a stick that loads at `slope` [N/s]: of a level force
        the highest sample lies anywhere."""
        used = self._used(begin, end)
        if used.size < FEWEST or any(begin < change < end for change in self.changes):
            return True
        t = self.log.time[used]
        least = LEVEL * slope - SURE_RISE * slope_error(t, self.log.noise)
        return line_slope(t, self.log.force[used], self.log.noise) > least

    def first_peak(self, moving: float) -> float:
        """When the smoothed force is highest from where the drive moves until its speed changes [s]."""
        used = self._used(moving, self.change_after(moving))
        return self.log.begin if used.size < FEWEST else self._highest(used)

    def first_rise(self, peak: float) -> float:
        """Until when the force rises without doubt towards its first peak [s]: not on a level that ends there."""
        used = self._used(self.log.begin, peak)
        if used.size < 2 * BINS:
            return self.log.begin + RISEN * (peak - self.log.begin)
        per = used.size // BINS
        means = self.log.force[used[: per * BINS]].reshape(BINS, per).mean(axis=1)
        high = means >= means[0] + RISEN * (means.max() - means[0])
        return float(self.log.time[used[per * max(int(np.argmax(high)), 1)]])

    def _highest(self, used: NDArray[np.intp]) -> float:
        width = max(min(int(0.2 * self.half / self.log.interval), used.size // 3), 1)
        smooth = np.convolve(self.log.force[used], np.ones(width) / width, mode="same")
        return float(self.log.time[used[int(np.argmax(smooth))]])

    def _steepest_fall(self, used: NDArray[np.intp]) -> float | None:
        """Where the force falls most from one half period to the next [s]; None where there are not two."""
        width = max(round(self.half / self.log.interval), 1)
        if used.size < 2 * width:
            return None
        sums = np.concatenate([[0.0], np.cumsum(self.log.force[used])])
        means = sums[width:] - sums[:-width]
        return float(self.log.time[used[width - 1 + int(np.argmax(means[:-width] - means[width:]))]])

    def _used(self, begin: float, end: float) -> NDArray[np.intp]:
        """Samples between two times [s] that count."""
        first, last = np.searchsorted(self.log.time, [begin, end])
        return np.flatnonzero(self.log.weight[first:last] > 0) + first


# ----------------------------------------------------------------------------------------------------------------------
# What a model does along the window of a log: its forces, steady states, rests and slides, where the log has them.
# ----------------------------------------------------------------------------------------------------------------------

TOLERANCE = 1e-7  # of a simulation step
BLOCK = 64  # knots of the load under the least of which a rest is looked at first


@lru_cache(maxsize=32)
def _moved_by_load(model: Model) -> bool:
    """Whether the load says how a rest goes on, not only when it ends."""
    x, p, u, t = (
        ca.SX.sym(n, k) for n, k in (("x", len(model.states)), ("p", len(model.parameters)), ("u", 4), ("t", 1))
    )
    return bool(ca.depends_on(model.rest(x, p, u, t), u[1]))


class Along:
    """A model with its parameters (n_p,), under the drive and the load of a log; `half` is half a period [s], `data`
    the places of its samples where a slide may begin."""

    def __init__(self, model: Model, log: LogData, p: Array) -> None:
        self.model, self.log, self.p = model, log, p
        self.values = dict(zip(model.parameter_names, p.tolist(), strict=True))
        self.half = float(np.pi * np.sqrt(self.values["mass"] / self.values["stiffness"]))
        changes = [] if log.programme is None else log.programme.changes(log.begin, log.end)
        self.data = DataSide(log, self.half, tuple(changes))

    @cached_property
    def rests(self) -> Resting:
        """Rests of the model: steady sliding has none."""
        return Resting(self.model)

    def inputs(self, t: float, just_before: bool = False) -> Array:
        """Inputs (4,) of the model at a time [s]."""
        speed = self.log.speed_at(np.nextafter(t, -np.inf) if just_before else t)
        return np.array([speed, float(self.log.normal_force.at(t)), 1.0, t])

    def forces(self, t: float, x: Array, just_before: bool = False) -> Array:
        """The friction forces (n,) that the load cell shows in some states (n, n_x) at a time [N]."""
        return np.array(self.model.load_cell(x.T, self.p, self.inputs(t, just_before))).ravel()

    def steady(self, t: float, just_before: bool = False) -> Sliding | None:
        """The state of steady sliding at a time [s]."""
        u = self.inputs(t, just_before)
        return lasting(self.model, self.p, u) if u[0] > 0.0 else None

    def drive_motion(self, t: float) -> float:
        """How far the drive has gone since the begin of the window [m]."""
        edges = [self.log.begin, *(c for c in self.data.changes if c < t), t]
        return sum((b - a) * self.log.speed_at(0.5 * (a + b)) for a, b in pairwise(edges))

    def moving_from(self, t: float) -> float:
        """When the drive next moves, from t on [s]."""
        return next((c for c in (t, *self.data.changes) if c >= t and self.log.speed_at(c) > 0.0), self.log.end)

    def onset(self, t: float, x: Array) -> tuple[float, Array, list[tuple[float, Array]]]:
        """When a rest from x at t ends [s] (NaN: not within the window), the state there, and time and state at each
        change of the drive before it."""
        legs: list[tuple[float, Array]] = []
        while t < self.log.end:
            change = self.data.change_after(t)
            made, until = self._quiet(t, x, change) or self._rest(t, x, change)
            t, x = made.start + made.duration, made.end
            if made.ended_by is not None:
                if made.drive_force < 0.0:
                    raise SimulationError("the mass is pulled back")
                return t, x, legs
            t = until
            if t == change:
                legs.append((t, x))
        return np.nan, x, legs

    def _rest(self, t: float, x: Array, change: float) -> tuple[Stick, float]:
        """A rest from x at t [s] until the slope of the load changes, or the drive does; and when that is [s]."""
        force, slope = self.log.normal_force.line(t)
        knot = bisect_right(self.log.normal_force.times, t)
        until = min([change, *self.log.normal_force.times[knot : knot + 1]])
        return rest(self.rests, x, Situated(self.p, self.log.speed_at(t), 1.0, force, slope, t), t, until - t), until

    def _quiet(self, t: float, x: Array, change: float) -> tuple[Stick, float] | None:
        """As `_rest`, over BLOCK knots of a load of many at once, where not even the least of them would end it."""
        load = self.log.normal_force
        last = bisect_right(load.times, t) + BLOCK
        if last >= len(load.times) or not load.times[last] < change or _moved_by_load(self.model):
            return None
        until = load.times[last]
        least = float(np.min([load.at(t), *load.knots[1][last - BLOCK : last + 1]]))
        made = rest(self.rests, x, Situated(self.p, self.log.speed_at(t), 1.0, least, 0.0, t), t, until - t)
        return (made, until) if made.ended_by is None else None

    def motion(self, t: float, x: Array, duration: float) -> Trajectory:
        """The simulated motion from state x at t [s]."""
        names = [s.name for s in self.model.states]
        load = self.log.normal_force
        times = np.array([t, *load.between(t, t + duration)[0], t + duration])
        course = NormalForce.of((times - t, load.at(times)))
        start = dict(zip(names, x.tolist(), strict=True))
        return run(
            self.model, self.values, self.log.speed_at(t), course, duration, start=start, accuracy=Stepping(TOLERANCE)
        )

    def placed(self, since: float, onset: float, x: Array, spread: float = np.inf) -> float:
        """Where on the data a slide that starts at `onset` from x fits best; after `since` [s]. spread: of the
        onset as it is expected [s]; infinite: the data alone say."""
        local = np.linspace(0.0, 2.0 * self.half, 200)
        wave = self.motion(onset, x, float(local[-1])).sample(local)["force"]
        slope = self.values["stiffness"] * self.log.speed_at(onset)
        return self.data.placed(since, onset, SlipWaveform(local, wave, slope), spread)


# ----------------------------------------------------------------------------------------------------------------------
# One simulated slide as stretches of a trajectory: which phases it has, and the states at their shooting nodes.
# ----------------------------------------------------------------------------------------------------------------------

INTERVAL = 1 / 4  # of half a period: shooting intervals of a slide
FIRST_INTERVALS = 8  # of the part of a slip in which the contact fades
BRIEF = 0.05  # of half a period: a contact that re-ages for so short before it rests does so in closed form,
CLEAR = 1.0  # where without that it would come to rest too: times the speed at which it begins to, below nothing
LOOK = 0.005  # of half a period: how far apart the speeds lie that say so


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
            self._note(phase.mode, t + phase.start + phase.duration, phase.ended_by)
            if phase.ended_by == "speed":
                self._merge()
                return phase
        return None

    def stretches(self, last: Literal["arrest", "time"], *, after_rest: bool) -> list[Stretch]:
        """The stretches with their nodes; last: what ends the last one; after_rest: the slide begins with an onset."""
        since, at, out = self.begun, _sampler(self.model, self._pieces), list[Stretch]()
        for i, (mode, end, ended) in enumerate(self._parts):
            first = i == 0 and mode == "slip" and after_rest
            count = max(ceil((end - since) / (INTERVAL * self.half)), FIRST_INTERVALS if first else 2)
            nodes = at(np.linspace(since, end, count + 1)[1:])
            if i + 1 == len(self._parts):
                ended = last
            if ended == "arrest":
                nodes[-1, SPEED] = 0.0
            kept = "wear" if ended == "clearance" else ended
            out.append(Stretch(mode, end, kept, nodes))  # type: ignore[arg-type]
            since = end
        return out

    def _note(self, mode: str, end: float, ended: str | None) -> None:
        """One more phase, joined to the one before where only the simulation was cut."""
        if self._parts and self._parts[-1][0] == mode and self._parts[-1][2] == "time":
            self._parts.pop()
        self._parts.append((mode, end, "time" if ended is None else ended))

    def _merge(self) -> None:
        """Leave out the brief re-ageing of a worn contact before it rests."""
        if len(self._parts) < 2 or self._parts[-2][2] != "release":
            return
        (mode, released, _), (_, end, ended) = self._parts[-2:]
        if end - released <= BRIEF * self.half and self._rests_anyway(released):
            self._parts[-2:] = [(mode, end, ended)]

    def _rests_anyway(self, released: float) -> bool:
        """Whether the mass would clearly come to rest with its contact worn all the way: the closed form starts
        from there. A mass that comes to rest by a hair does so because its contact ages."""
        h = LOOK * self.half
        moments = released - h * np.array([2.0, 1.0, 0.0])
        first, second, last = _sampler(self.model, self._pieces)(moments)[:, SPEED].tolist()
        pace, bend = (3.0 * last - 4.0 * second + first) / (2.0 * h), (last - 2.0 * second + first) / h**2
        return pace < 0.0 and pace**2 >= 2.0 * bend * (1.0 + CLEAR) * last


def _sampler(model: Model, pieces: list[tuple[float, Trajectory]]) -> Callable[[Array], Array]:
    """States (n, n_x) of joined motions at times (n,) [s]."""
    starts = np.array([t for t, _ in pieces])
    names = [s.name for s in model.states]

    def at(times: Array) -> Array:
        which = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
        out = np.empty((times.size, len(names)))
        for i in np.unique(which).tolist():
            rows, (begin, motion) = which == i, pieces[i]
            sampled = motion.sample(np.clip(times[rows] - begin, 0.0, motion.duration))
            out[rows] = np.stack([sampled[name] for name in names], axis=1)
        return out

    return at


# ----------------------------------------------------------------------------------------------------------------------
# How it begins: the elongation from the first samples, and a contact half aged, or so that the first slips fit.
# ----------------------------------------------------------------------------------------------------------------------

BRIEF_LOADING = 4.0  # half periods: a first stick that is shorter has no peak of its own
FIRST_SWINGS = 8.0  # half periods
ABOUT, PLACES = 2.0, 33  # half periods about the place of a first slide, and onsets in them that are tried


def first_state(along: Along) -> Array:
    """State at the begin of the window: the elongation from the first samples, the contact half aged or such that
    the first peak comes when it is seen."""
    log, model = along.log, along.model
    peak = along.data.first_peak(along.moving_from(log.begin))
    until = along.data.first_rise(peak)
    mine = (log.time >= log.begin) & (log.time <= until) & (log.weight > 0)
    if not np.any(mine):
        mine = np.arange(log.time.size) == np.searchsorted(log.time, log.begin)
    moved = np.array([along.drive_motion(t) for t in log.time[mine]])
    level = float(np.median(log.force[mine] - along.values["stiffness"] * moved))
    x = lanes.at_force(model, np.array([level]), along.p[None], along.inputs(log.begin)[None])[0]
    if model.clamped is None:
        return x
    candidates = np.linspace(0.0, 1.0, 41)
    onsets = np.full(candidates.size, np.nan)
    for i, value in enumerate(candidates):
        x[model.clamped] = value
        onsets[i] = along.onset(log.begin, x)[0]
    x[model.clamped] = 0.5
    if np.nanmin(onsets, initial=np.inf) - log.begin < BRIEF_LOADING * along.half:
        # Its peak is one swing among others: the first slide as a whole tells how aged the contact was.
        until = min(log.begin + FIRST_SWINGS * along.half, along.data.change_after(log.begin))
        misfits = [misfit_of_first(along, x, g, log.begin, until) for g in candidates[::2].tolist()]
        x[model.clamped] = candidates[int(np.argmin(misfits)) * 2]
    elif np.any(np.isfinite(onsets)) and np.ptp(onsets[np.isfinite(onsets)]) > 1e-3 * (peak - log.begin):
        x[model.clamped] = candidates[int(np.nanargmin(np.abs(onsets - peak)))]
        x[model.clamped] = aged_until_seen(along, x, candidates, onsets)
    return x


def aged_until_seen(along: Along, x: Array, candidates: Array, onsets: Array) -> float:
    """The ageing (a candidate, or between two) of the contact at the begin with which the first slips lie on the
    data: of a slow slip the force is highest long after the mass began to move, and how the mass comes to rest
    after it hangs on when it began. Looked for about the place where the slide from x does.

    Args:
        candidates, onsets: ageings (k,) and the onset of each (k,) [s], NaN where there is none.
    """
    log, found, aged = along.log, np.isfinite(onsets), float(x[along.model.clamped])
    onset, at_onset, _ = along.onset(log.begin, x)
    try:
        seen = along.placed(log.begin, onset, at_onset)
    except SimulationError:
        return aged
    order = np.argsort(onsets[found])
    places = seen + along.half * np.linspace(-ABOUT, ABOUT, PLACES)
    ages = np.unique(np.interp([seen, *places], onsets[found][order], candidates[found][order]))
    since, until = float(places[0]), min(seen + FIRST_SWINGS * along.half, along.data.change_after(log.begin))
    misfits = [misfit_of_first(along, x, age, since, until) for age in ages.tolist()]
    return float(ages[int(np.argmin(misfits))]) if np.any(np.isfinite(misfits)) else aged


def misfit_of_first(along: Along, x: Array, gamma: float, since: float, until: float) -> float:
    """Mean square of the residuals in noise variances between two times [s], from a contact this aged."""
    log, model = along.log, along.model
    x = x.copy()
    x[model.clamped] = gamma
    mine = np.flatnonzero((log.time >= max(since, log.begin)) & (log.time < until) & (log.weight > 0))
    if mine.size == 0:
        return np.inf
    try:
        shown = along.motion(log.begin, x, until - log.begin).sample(log.time[mine] - log.begin)["force"]
    except SimulationError:
        return np.inf
    return float(np.mean(log.weight[mine] * (log.force[mine] - shown) ** 2))


# ----------------------------------------------------------------------------------------------------------------------
# The motion, stretch by stretch.
# ----------------------------------------------------------------------------------------------------------------------

CHUNK = 6.0  # half periods that are simulated at a time
FADED = 0.2  # of the noise: an oscillation that is smaller is not followed
LONGEST = 120  # half periods of one slide that are followed
AFTER = 0.1  # of a slide: how much of the rest after it is taken where the motion is not followed further
MOST_STRETCHES = 1200
UNSURE = 0.05  # of a cycle: how far off an onset is expected by parameters that are not the answer yet
PIECES = 200  # of steady sliding, at most
# Squared deviations of a slip from a level course, in noise variances: of one that shows, of one that does for sure;
SHOWN, SURE = 1.0, 9.0
TRAIN, HIDDEN = 50.0, 3  # of a train that shows for sure together; slips in a row that do not, before all are given up


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
    course = _Course(model, log, p)
    try:
        return course.run(begins_sliding)
    except SimulationError:
        return course.so_far()


def glide(model: Model, log: LogData, p: Array) -> ShootingTrajectory | None:
    """The motion of a log that slides steadily from begin to end; None where the model has no such motion."""
    course = _Course(model, log, p)
    end = course.along.steady(log.begin)
    if end is None:
        return None
    course.glide(log.begin, log.end)
    return course.trajectory(end.state)


class _Course:
    """A motion as it is put together."""

    def __init__(self, model: Model, log: LogData, p: Array) -> None:
        self.model, self.log, self.along = model, log, Along(model, log, p)
        self.stretches: list[Stretch] = []
        self.sure = 0  # of these, up to the last slip that shows for sure
        self.start = np.array([s.start for s in model.states])

    def trajectory(self, start: Array) -> ShootingTrajectory:
        """The motion so far, from a state at the begin of the window."""
        return ShootingTrajectory.of(start, self.stretches, self.log.own)

    def run(self, begins_sliding: bool) -> Followed | None:
        """Follow the motion to the end of the window."""
        t = self.log.begin
        if begins_sliding:
            steady = self.along.steady(t)
            if steady is None:
                return None
            self.start = x = steady.state
            t = self.along.data.change_after(t)
            self.glide(self.log.begin, t)
            self.sure = len(self.stretches)
            sliding = True
        else:
            self.start = x = first_state(self.along)
            sliding = False
        hidden, train, shown = 0, 0.0, np.inf
        while t < self.log.end and len(self.stretches) < MOST_STRETCHES:
            if sliding:
                t, x, sliding = self.slide(t, x)
                if np.isnan(t):
                    return Followed(self.trajectory(self.start), self.stretches[-1].until) if self.stretches else None
                shown = self.shown()
                hidden, train = (hidden + 1, 0.0) if shown < SHOWN else (0, train + shown)
                self.sure = len(self.stretches) if shown >= SURE or train >= TRAIN else self.sure
                if hidden == HIDDEN:  # to go on would make up how often it slips until the window ends
                    return self.so_far()
            else:
                t, x, sliding = self.rest(t, x, shown)
        return Followed(self.trajectory(self.start), t) if t >= self.log.end else self.so_far()

    def shown(self) -> float:
        """How far the last slip, a slide without a change of the drive from a rest to an arrest, stands out of the
        noise: squared deviations of a sawtooth from a level course; infinite where the last stretch is no such slip."""
        made = self.stretches
        rest = self.last_rest()
        if rest is None or made[-1].ended_by != "arrest" or made[rest].ended_by != "onset":
            return np.inf
        begun = made[rest].until
        sliding = made[-1].until - begun
        again = rest > 0 and made[rest - 1].ended_by == "arrest"
        length = made[-1].until - made[rest - 1].until if again else 2.0 * sliding  # a first slip has no cycle
        nodes = np.concatenate([made[rest].nodes[-1:], *(s.nodes for s in made[rest + 1 :])])
        height = float(np.ptp(self.along.forces(0.5 * (begun + made[-1].until), nodes)))
        return length / self.log.interval * (height / self.log.noise) ** 2 / 12.0

    def last_rest(self) -> int | None:
        """The place of the last rest; None where there is none."""
        return next((i for i in range(len(self.stretches) - 1, -1, -1) if self.stretches[i].kind == "rest"), None)

    def so_far(self) -> Followed | None:
        """The motion up to where it cannot be followed further: the end of a slide that was steady, or the rest after
        the last slip that shows for sure."""
        made = self.stretches
        del made[self.sure :]
        while made and not (made[-1].steady or made[-1].ended_by == "arrest"):
            made.pop()
        if not made:
            return None
        end = made[-1].until
        if made[-1].ended_by == "arrest":
            end = min(end + AFTER * (end - made[self.last_rest() or 0].until), self.along.data.change_after(end))
        return Followed(self.trajectory(self.start), end)

    def rest(self, t: float, x: Array, shown: float) -> tuple[float, Array, bool]:
        """A rest and the onset that ends it, moved onto the data: its end, the state there, whether it then slides.

        Args:
            shown: how far the slip before it stands out of the noise.
        """
        onset, at_onset, legs = self.along.onset(t, x)
        for until, after in legs:
            if np.isfinite(onset) or until < self.log.end:
                self.stretches.append(Stretch("rest", until, "time", after[None]))
                t = until
        if not np.isfinite(onset):
            return self.log.end, x, False
        found = self.along.placed(t, onset, at_onset, self.spread(onset, shown))
        self.stretches.append(Stretch("rest", found, "onset", at_onset[None]))
        return found, at_onset, True

    def spread(self, onset: float, shown: float) -> float:
        """How far off an expected onset may be [s]; infinite where the last slip shows so well that the data alone say
        where the next one is. Slips that hardly show are each moved by the noise; what the train of them has in common
        is when the model lets them follow each other."""
        last = self.last_rest()
        return UNSURE * (onset - self.stretches[last].until) if last is not None and shown < SURE else np.inf

    def slide(self, t: float, x: Array) -> tuple[float, Array, bool]:
        """A slide until the mass rests, the drive changes, or the window ends; NaN where it is not followed further."""
        until, begun = self.along.data.change_after(t), t
        slide = SlideParts(self.model, begun, self.along.half)
        arrest: Phase | None = None
        faded = False
        while t < until and t < begun + LONGEST * self.along.half:
            motion = self.along.motion(t, x, min(CHUNK * self.along.half, until - t))
            arrest = slide.take(t, motion)
            if arrest is not None:
                t, x = t + arrest.start + arrest.duration, arrest.end
                break
            t, x = t + motion.duration, motion.phases[-1].end
            faded = t < until and self.faded(t, motion)
            if faded:
                break
        after_rest = bool(self.stretches) and self.stretches[-1].kind == "rest"
        self.stretches += slide.stretches("time" if arrest is None else "arrest", after_rest=after_rest)
        if arrest is not None:
            return t, x, False
        if faded:
            self.glide(t, until)
            steady = self.along.steady(until, just_before=True)
            assert steady is not None
            return until, steady.state, True
        return (until, x, True) if t >= until else (np.nan, x, True)

    def faded(self, t: float, motion: Trajectory) -> bool:
        """Whether the last period of a motion that ends at t is steady sliding but for a part of the noise."""
        steady = self.along.steady(t, just_before=True)
        if steady is None or motion.duration < 2.0 * self.along.half:
            return False
        local = np.linspace(motion.duration - 2.0 * self.along.half, motion.duration, 60)
        shown = motion.sample(local)["force"]
        level = self.along.forces(t, steady.state[None], just_before=True)
        drift = self.log.normal_force.at(t - motion.duration + local) / float(self.log.normal_force.at(t))
        return bool(np.max(np.abs(shown - level * drift)) < FADED * self.log.noise)

    def glide(self, since: float, until: float) -> None:
        """Steady sliding between two times, in as many pieces as the course of the normal force has."""
        count = min(max(2 * self.log.normal_force.between(since, until)[0].size, 1), PIECES)
        edges = np.linspace(since, until, count + 1)
        found = [self.along.steady(t, just_before=i == count) for i, t in enumerate(edges.tolist())]
        if any(s is None for s in found):
            raise SimulationError("there is no steady sliding")
        states = [s for s in found if s is not None]
        worn = all(s.worn for s in states)
        rows = [s.state for s in states]
        nodes = np.stack([state for i in range(count) for state in (rows[i], rows[i + 1])])
        self.stretches.append(Stretch("steady_worn" if worn else "steady", until, "time", nodes))
