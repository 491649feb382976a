"""What logs would tell before they are recorded, and the few that tell most in the time there is.

One core for the plan before a first test and for the next log after a fit. What is not known may be anywhere among
places of the parameters (draws of what is known beforehand): each log is rehearsed at them, and what counts as known is
what is known at most places. Logs are chosen one after the other, by what each lowers the variances of what is
asked for, relative and over the time it takes to set up and record; what turns out not to be needed is dropped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identify.base.quantiles import NORMAL
from identify.bench.rehearsal import LogDesign, Rehearsal, rehearse
from identify.estimation.covariance import IDENTIFIED, inverse, sizes
from identify.estimation.hints import WANTED, round_up
from identify.logs.log_data import LogData
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns

Array = NDArray[np.float64]

SAFE = 0.9  # of what `identified` allows
TRIED = 6  # designs that are rehearsed at all places, each time one is chosen
LEAST = 0.1  # by which the logarithms of the variances have to fall for a log to be worth its time
MOST_SLIPS = 300  # of one log: a fit follows them in seconds; of thousands it does not know what they promise
HUGE = 50.0  # standard deviation of a logarithm that is as good as infinite
DECADES = range(-8, 1)  # of drive speeds [m/s]


@dataclass(frozen=True)
class Knowledge:
    """What is known before a log is chosen.

    unknowns; kept (k,): places among the free parameters of those that another log shares; asked: names to be told;
    places (d, n_p): theta, the first the likeliest; known (d, k, k): precision at each; base (n_p,): of the rig;
    variance of a sample [N^2]; load_error: of the normal force from cycle to cycle, relative; apart: seconds that count
    as one sample at least, for the memory of the noise; rate: to sample at least [Hz]; fastest: at most [Hz]; distance
    per cycle [m]; longest log [s]; most: the share of the places at which what is promised is to be reached.
    """

    unknowns: Unknowns
    kept: NDArray[np.int64]
    asked: tuple[str, ...]
    places: Array
    known: Array
    base: Array
    variance: float
    load_error: float
    rate: float
    distance: float
    longest: float
    apart: float = 0.0
    fastest: float = np.inf
    most: float = 0.5

    @property
    def names(self) -> tuple[str, ...]:
        """Of the k parameters."""
        free = np.flatnonzero(self.unknowns.free)
        return tuple(self.unknowns.names[i] for i in free[self.kept].tolist())

    @property
    def wanted(self) -> list[int]:
        """Places of what is asked for among the k parameters."""
        return [i for i, name in enumerate(self.names) if name in self.asked]

    def sizes(self, theta: Array) -> Array:
        """What a deviation of theta (k,) is judged by: 1 of a logarithm, else the value, or the step of friction."""
        index = np.flatnonzero(self.unknowns.free)[self.kept]
        judged_by = sizes(self.unknowns, self.unknowns.values(theta, self.base))[index]
        return np.where(self.unknowns.logarithmic[index], 1.0, np.maximum(judged_by, 1e-300))

    def deviations(self, precision: Array, theta: Array) -> Array:
        """Standard deviations (k,) of theta, as shares of that."""
        return np.minimum(np.sqrt(np.diag(inverse(precision))) / self.sizes(theta), HUGE)

    def halves(self, precisions: Array) -> Array:
        """Half lengths (k,) of the 95 % intervals, as those shares, that `most` of the places keep to, at which the
        precisions (d, k, k) hold."""
        logarithmic = self.unknowns.logarithmic[np.flatnonzero(self.unknowns.free)[self.kept]]
        half = NORMAL * np.array([self.deviations(p, at) for p, at in zip(precisions, self.places, strict=True)])
        shares = np.where(logarithmic, np.expm1(np.minimum(half, HUGE)), half)
        return np.asarray(np.quantile(shares, self.most, axis=0))

    def score(self, precision: Array, theta: Array) -> float:
        """Sum of the logarithms of the variances of what is asked for, which a log is to lower; level where a parameter
        is known well enough."""
        enough = SAFE * IDENTIFIED / NORMAL
        return float(np.sum(np.log(self.deviations(precision, theta)[self.wanted] ** 2 + (0.5 * enough) ** 2)))

    def told(self, precisions: Array) -> dict[str, float]:
        """What of it is asked for and known well enough at most places: half lengths by name."""
        halves = self.halves(precisions)
        return {self.names[i]: float(halves[i]) for i in self.wanted if halves[i] <= SAFE * IDENTIFIED}


@dataclass(frozen=True)
class PlannedLog:
    """A log to record: its design, how many times over, sampling rate [Hz], duration [s], slips in it (at the first
    place); halves (k,): half lengths of the intervals, at most places, with this log and those before it; tells: those
    of all logs together, by name, of what is asked for and would not be known well enough without this one."""

    design: LogDesign
    times: int
    rate: float
    duration: float
    slips: int
    halves: Array
    tells: Mapping[str, float]


@dataclass
class Rehearsals:
    """Rehearsed logs, each made when it is first asked for."""

    knowledge: Knowledge
    made: dict[tuple[LogDesign, int], Rehearsal | None] = field(default_factory=dict)
    informed: dict[tuple[LogDesign, int, int], Array] = field(default_factory=dict)

    def at(self, design: LogDesign, place: int) -> Rehearsal | None:
        """A log of this design at one of the places."""
        if (design, place) not in self.made:
            k = self.knowledge
            base = base_of(k.unknowns, k.base, design)
            self.made[design, place] = rehearse(k.unknowns, k.places[place], base, design, k.distance, k.longest)
        return self.made[design, place]

    def rate(self, design: LogDesign) -> float:
        """The sampling rate to ask for [Hz]."""
        made = self.at(design, 0)
        assert made is not None
        return min(round_up(max(self.knowledge.rate, WANTED / made.slip)), self.knowledge.fastest)

    def information(self, design: LogDesign, times: int, place: int) -> Array:
        """Information (k, k) of the log, recorded so many times over; of as long a log where it takes longer there."""
        k, first, made = self.knowledge, self.at(design, 0), self.at(design, place)
        if made is None or first is None:
            return np.zeros((k.kept.size, k.kept.size))
        if (design, times, place) not in self.informed:
            seconds = max(1.0 / self.rate(design), k.apart)
            load_sd, long = k.load_error * design.normal_force, times * first.duration / made.duration
            every = made.information(1.0 / seconds, k.variance, load_sd, long)
            self.informed[design, times, place] = every[np.ix_(k.kept, k.kept)]
        return self.informed[design, times, place]

    def all(self, design: LogDesign, times: int) -> Array:
        """Information (d, k, k) of the log at every place."""
        return np.array([self.information(design, times, place) for place in range(len(self.knowledge.places))])


def told_by(unknowns: Unknowns, theta: Array, log: Prepared, load_sd: float, distance: float) -> Array:
    """Information (f, f) of the free theta that a recorded log is expected to hold: rehearsed at every speed it was
    driven at, for as long as that.

    Args:
        theta (n_p,); load_sd: by how much its normal force may be off in a cycle [N]; distance: per cycle [m].
    """
    count, data = int(np.count_nonzero(unknowns.free)), log.data
    total = np.zeros((count, count))
    for speed, seconds in driven(data):
        made = rehearse(unknowns, theta, data.base, LogDesign(speed, log.mean_load), distance, seconds)
        if made is not None:
            long = seconds / made.duration if made.slips else 1.0
            total += made.information(1.0 / data.interval, data.noise**2, load_sd, long)
    return total


def driven(data: LogData) -> list[tuple[float, float]]:
    """At which speeds [m/s] a log was driven, and for how long each [s]; rests of the drive left out."""
    if data.programme is None:
        return [(data.drive_speed, data.end - data.begin)]
    starts = np.clip([*data.programme.starts, data.end], data.begin, data.end)
    pieces = zip(data.programme.speeds, np.diff(starts).tolist(), strict=True)
    return [(abs(speed), seconds) for speed, seconds in pieces if speed != 0.0 and seconds > 0.0]


def base_of(unknowns: Unknowns, base: Array, design: LogDesign) -> Array:
    """Base values of the rig with the spring of a design; its damping ratio stays."""
    if design.stiffness is None:
        return base
    out, names = base.copy(), unknowns.names
    out[names.index("stiffness")] = design.stiffness
    if "damping" in names:
        out[names.index("damping")] *= design.stiffness / base[names.index("stiffness")]
    return out


def dials(low: float, high: float, of_a_decade: Sequence[float]) -> list[float]:
    """Drive speeds that one would set between two [m/s], rising."""
    speeds = [float(f"{dial}e{decade}") for decade in DECADES for dial in of_a_decade]
    return [speed for speed in speeds if low <= speed <= high]


def choose(tried: Rehearsals, designs: Sequence[LogDesign], budget: float, setup: float, most: int) -> list[PlannedLog]:
    """The logs that tell what is asked for, in the order they were chosen.

    Args:
        tried: rehearsals at all that is known.
        designs: among which is chosen.
        budget: time for all logs together [s], setting each up takes `setup` [s] of it.
        most: logs.
    """
    chosen: list[tuple[LogDesign, int]] = []
    left = budget
    while len(chosen) < most and len(tried.knowledge.told(_known(tried, chosen))) < len(tried.knowledge.wanted):
        best = _best(tried, designs, chosen, left, setup)
        if best is None:
            break
        chosen.append(best)
        left -= _seconds(tried, best) + setup
    return _described(tried, _needed(tried, chosen))


def _known(tried: Rehearsals, chosen: Sequence[tuple[LogDesign, int]]) -> Array:
    return np.asarray(tried.knowledge.known + sum((tried.all(*log) for log in chosen), start=np.zeros(())))


def _seconds(tried: Rehearsals, log: tuple[LogDesign, int]) -> float:
    made = tried.at(log[0], 0)
    return 0.0 if made is None else made.duration * log[1]


def _best(
    tried: Rehearsals, designs: Sequence[LogDesign], chosen: Sequence[tuple[LogDesign, int]], left: float, setup: float
) -> tuple[LogDesign, int] | None:
    """The log that lowers the variances most for its time; None where none is worth it. One that was chosen before
    becomes longer, up to what a log may be."""
    k, known = tried.knowledge, _known(tried, chosen)
    before = {design: sum(times for other, times in chosen if other == design) for design, _ in chosen}

    def gain(log: tuple[LogDesign, int], place: int) -> float:
        theta = k.places[place]
        return k.score(known[place], theta) - k.score(known[place] + tried.information(*log, place), theta)

    def rate(gain: float, log: tuple[LogDesign, int]) -> float:
        return gain / (_seconds(tried, log) + setup)

    possible: list[tuple[float, tuple[LogDesign, int]]] = []
    for design in designs:
        made = tried.at(design, 0)
        most = 0 if made is None else 1
        if made is not None and made.slips:
            used = before.get(design, 0)
            room = np.inf if design.holds else min(k.longest / made.duration, MOST_SLIPS / made.slips) - used
            most = int(max(min((left - setup) / made.duration, room), 0.0))
        logs = [(design, 2**i) for i in range(most.bit_length())]
        possible += [(rate(g, log), log) for log in logs if (g := gain(log, 0)) > LEAST]
    possible.sort(key=lambda option: -option[0])
    first = list(dict.fromkeys(design for _, (design, _) in possible))[:TRIED]
    judged = []
    for _, log in possible:
        if log[0] in first:
            mean = float(np.mean([gain(log, place) for place in range(len(k.places))]))
            judged.append((rate(mean, log), mean, log))
    worth = [(value, log) for value, mean, log in judged if mean > LEAST]
    return max(worth, key=lambda option: option[0])[1] if worth else None


def _needed(tried: Rehearsals, chosen: list[tuple[LogDesign, int]]) -> list[tuple[LogDesign, int]]:
    """The logs without those that the later ones made superfluous; the same design twice is one longer log."""
    k = tried.knowledge
    merged = {design: 0 for design, _ in chosen}
    for design, times in chosen:
        merged[design] += times
    logs = list(merged.items())
    told = len(k.told(_known(tried, logs)))
    for log in sorted(logs, key=lambda log: -_seconds(tried, log)):
        rest = [other for other in logs if other != log]
        if told and len(k.told(_known(tried, rest))) == told:
            logs = rest
    return logs


def _described(tried: Rehearsals, logs: Sequence[tuple[LogDesign, int]]) -> list[PlannedLog]:
    out, k = list[PlannedLog](), tried.knowledge
    told = k.told(_known(tried, logs))
    for number, (design, times) in enumerate(logs, 1):
        made = tried.at(design, 0)
        assert made is not None
        without = k.told(_known(tried, [log for log in logs if log[0] != design]))
        tells = {name: half for name, half in told.items() if name not in without}
        halves = k.halves(_known(tried, logs[:number]))
        seconds, slips = made.duration * times, made.slips * times
        out.append(PlannedLog(design, times, tried.rate(design), seconds, slips, halves, tells))
    return out
