"""From parameters to a trajectory of a motion that is no train of equal cycles: simulated stretch by stretch along the
data.

Drive programmes, holds, sticks that end in sliding. Each onset is moved onto the peak of the measured force before the
slide goes on from there, so that what is wrong with the parameters does not add up; what does not join up is left to
the shooting. A slide whose oscillation has faded goes on as steady sliding, which has no steps to take.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.logs.log_data import LogData
from identify.model.model import Model
from identify.shooting.onset_places import Along
from identify.shooting.parts import SlideParts
from identify.shooting.placing import first_state
from identify.shooting.shooting_trajectory import ShootingTrajectory, Stretch
from identify.simulation.phases import Phase
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

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
