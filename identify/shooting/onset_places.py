"""Where on the data a rest ends: at the peak of the measured force, at its steepest fall, or where it is expected."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.logs.log_data import LogData
from identify.logs.slips import line_slope, slope_error
from identify.model.model import Model
from identify.simulation.drive import NormalForce
from identify.simulation.phases import Stick, rest
from identify.simulation.plan import Stepping
from identify.simulation.resting import Resting
from identify.simulation.simulate import run
from identify.simulation.sliding import Sliding, lasting
from identify.simulation.stepper import Situated
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

REACH = 4.0  # half periods by which an onset is moved at most around what the data or the simulation say
PER_HALF_PERIOD = 12  # places per half period that are tried
PEAK = 0.5  # of a rest: how far from its simulated end the peak is looked for
COMPARED = 400  # samples that vote on a place
BY_CHANCE = 12.0  # squared deviations by which noise makes one of some hundred places the best
FEWEST = 3  # samples that have a highest one
BINS, RISEN = 50, 0.8  # means up to the first peak, and share of its height that is reached on the way for sure
LEVEL, SURE = 0.25, 3.0  # of the slope of a stick, and standard errors: a force that rises less is no stick


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
        least = LEVEL * slope - SURE * slope_error(t, self.log.noise)
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
