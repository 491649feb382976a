"""Experiment design: what a log is expected to tell before it is recorded, and the few logs that tell most.

The expected information of a log is the Fisher information of white noise: the integral over time of the outer product
of the sensitivities of its force, times samples per second, over the variance of a sample. What a fit does not know
either, the start of the log and the load in each cycle, is eliminated. Logs are chosen one after the other by what
each adds to what is known already (greedy D-optimal design; Pukelsheim, Optimal Design of Experiments, 1993).

Sensitivities are differences of the simulator, which locates every switch. Two motions are compared at the same share
of the way from switch to switch, where nothing kinks; the sensitivity at a fixed time follows from how far that moment
has moved. Compared at fixed times, a switch that passes one would bend the difference.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from data_io.speed_steps import Programme
from identify.base.budget import time_is_up
from identify.base.errors import SimulationError
from identify.base.quantiles import NORMAL
from identify.estimation.covariance import IDENTIFIED, inverse, sizes
from identify.estimation.hints import WANTED, round_up
from identify.logs.unknowns import Unknowns
from identify.model.model import ELONGATION
from identify.shooting.transcription import BOUNDED_START_SD
from identify.simulation.drive import Drive
from identify.simulation.plan import Scales, scales
from identify.simulation.simulate import run
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

CYCLES = 4  # that are simulated of a steady drive; later ones repeat the last
REPEATED = 40  # of the later cycles, one by one: of more, each tells as much as these do on average, at least
MOST_CYCLES = 30  # of a programme, each of which has a normal force of its own
DOUBLINGS = 6  # of the simulated duration until it has its cycles
SETTLED, STEADY = 60.0, 15.0  # times sqrt(m/k): a slide so long goes on; the end of it in which it is steady
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(6)  # of a phase, at which sensitivities are taken,
PIECE, MOST_PIECES = 2.0, 400  # and of each piece of a slide, in times sqrt(m/k)
INSET = 5e-3  # of half a piece: over which the rate of the force is taken
LOAD_CHANGE = 0.02  # of a stick: when the normal force of its cycle begins, which the force does not feel there
STEP = 1e-5  # of a logarithm, and of a spread, for the differences

SAFE = 0.9  # of what `identified` allows
TRIED = 4  # designs that are simulated at all places, each time one is chosen
LEAST_GAIN = 0.1  # of the sum of the logarithms of the variances, for a log to be worth its time
MOST_SLIPS = 300  # of one log: of thousands a fit does not know what they promise
ROUNDS = 8  # of the choice
REACHED = 0.75  # of the places: what is promised is reached at so many
UNKNOWN = 50.0  # standard deviation of a logarithm that is as good as infinite


@dataclass(frozen=True)
class LogDesign:
    """How a log is recorded.

    Attributes
    ----------
    drive : drive speed [m/s], or a programme of (start [s], speed [m/s]).
    normal_force : [N].
    stiffness : of the spring [N/m]; None: that of the rig.
    duration : of a programme [s]; 0: as long as its cycles take.
    """

    drive: float | Programme
    normal_force: float
    stiffness: float | None = None
    duration: float = 0.0

    @property
    def speed(self) -> float:
        """The fastest drive speed [m/s]."""
        return max(speed for _, speed in self.drive) if isinstance(self.drive, tuple) else self.drive

    @property
    def steps(self) -> list[tuple[float, float]]:
        """Speed [m/s] and duration [s] of each step of the drive."""
        if not isinstance(self.drive, tuple):
            return [(self.drive, self.duration)]
        ends = [*(start for start, _ in self.drive[1:]), self.duration]
        return [(speed, end - start) for (start, speed), end in zip(self.drive, ends, strict=True)]

    @property
    def holds(self) -> tuple[float, ...]:
        """How long the drive stands in between [s]."""
        return tuple(seconds for speed, seconds in self.steps if speed == 0.0)

    def base(self, unknowns: Unknowns, base: Array) -> Array:
        """Base values (n_p,) of the rig with the spring of this design; its damping ratio stays."""
        out, names = base.copy(), unknowns.names
        if self.stiffness is not None:
            ratio = self.stiffness / base[names.index("stiffness")]
            for name in ("stiffness", "damping"):
                if name in names:
                    out[names.index(name)] *= ratio
        return out


# ----------------------------------------------------------------------------------------------------------------------
# A simulated log and the sensitivities of its force.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Repetition:
    """How a log of a steady drive goes on: with its last cycle, from row `since` on, of `period` [s].

    later (l, f + s): what one more cycle adds to the sensitivities of these rows: a longer one delays all after it.
    """

    since: int
    period: float
    later: Array

    def extended(self, sensitivity: Array, weights: Array, shared: int, count: int) -> tuple[Array, Array]:
        """Sensitivities and weights with `count` more cycles; the first `shared` columns are no load of a cycle.

        The load of a cycle acts on those after it as that of an earlier one does on the last that was simulated.
        """
        rows, loads = sensitivity[self.since :], sensitivity.shape[1] - shared
        out = np.zeros((len(sensitivity) + count * len(rows), sensitivity.shape[1] + count))
        out[: len(sensitivity), : sensitivity.shape[1]] = sensitivity
        for i in range(1, count + 1):
            here = slice(len(sensitivity) + (i - 1) * len(rows), len(sensitivity) + i * len(rows))
            out[here, :shared] = rows[:, :shared] + i * self.later
            columns = np.maximum(np.arange(loads + i) - i, 1)
            columns[0] = 0  # the first cycle, from a fresh contact, is unlike the others
            out[here, shared : shared + loads + i] = rows[:, shared + columns]
        return out, np.concatenate([weights, np.tile(weights[self.since :], count)])


@dataclass(frozen=True)
class SimulatedLog:
    """A log of a design at one place of the parameters.

    Attributes
    ----------
    duration, slips, slip : duration [s], slips that end in it, and how long one takes [s].
    sensitivity : (t, f + s + c) of the force, to the f free theta, the s unknowns of the start (how far the spring is
        loaded, how fresh the contact is) and the normal force [N] in each of c cycles.
    weights : (t,) seconds that each row counts for.
    start_sd : (s,) what a fit takes the unknowns of the start to be within; free : f.
    repetition : how it goes on; None where it does not repeat.
    """

    duration: float
    slips: int
    slip: float
    sensitivity: Array
    weights: Array
    start_sd: Array
    free: int
    repetition: Repetition | None

    @property
    def shared(self) -> int:
        """Columns that are no normal force of a cycle: f + s."""
        return self.free + self.start_sd.size

    def information(self, rate: float, variance: float, load_sd: float, times: float = 1.0) -> Array:
        """Fisher information (f, f) of the free theta.

        Parameters
        ----------
        rate : independent samples per second; variance : of each [N^2].
        load_sd : error of the normal force [N], another one in each cycle (0: none).
        times : as long a log as so many of these.
        """
        rows, weights, duration = self.sensitivity, self.weights, self.duration
        if self.repetition is not None and times > 1.0:
            count = min(round((times - 1.0) * duration / self.repetition.period), REPEATED)
            rows, weights = self.repetition.extended(rows, weights, self.shared, count)
            duration += count * self.repetition.period
        rows = rows if load_sd > 0.0 else rows[:, : self.shared]
        total = rows.T @ (rows * (weights * rate / variance)[:, None])
        own = np.arange(self.free, len(total))
        total[own, own] += np.append(self.start_sd, np.full(own.size - self.start_sd.size, load_sd)) ** -2.0
        scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
        scaled, f = total * np.outer(scale, scale), self.free
        across = scaled[:f, f:]
        left = scaled[:f, :f] - across @ np.linalg.pinv(scaled[f:, f:], 1e-13, hermitian=True) @ across.T
        return np.asarray(times * self.duration / duration * left / np.outer(scale[:f], scale[:f]))


@dataclass(frozen=True)
class _Designed:
    """What the motions of a design are simulated with, SI: theta (n_p,) and base (n_p,) with its spring."""

    unknowns: Unknowns
    theta: Array
    base: Array
    design: LogDesign

    @property
    def scales(self) -> Scales:
        """Typical time and sizes of the states."""
        values = self.unknowns.values(self.theta, self.base)
        return scales(self.unknowns.model, values, self.design.normal_force)

    @property
    def starts(self) -> list[int]:
        """States at the start that a fit does not know: the spring can be loaded already, and the contact be older."""
        states = self.unknowns.model.states
        return [i for i, state in enumerate(states) if i == ELONGATION or state.lower is not None]

    def values(self, theta: Array) -> dict[str, float]:
        """Every parameter by name."""
        return dict(zip(self.unknowns.names, self.unknowns.values(theta, self.base).tolist(), strict=True))

    def run(
        self,
        duration: float,
        theta: Array | None = None,
        load: tuple[Array, Array] | None = None,
        start: dict[str, float] | None = None,
    ) -> Trajectory:
        """The motion, or one with another theta, course of the load or start."""
        values = self.values(self.theta if theta is None else theta)
        force = self.design.normal_force if load is None else load
        return run(self.unknowns.model, values, self.design.drive, force, duration, start=start)

    def nominal(self, longest: float) -> Trajectory:
        """The motion until its cycles are there, the mass slides on, or for `longest` [s]."""
        if self.design.duration:
            return self.run(self.design.duration)
        values, time = self.values(self.theta), self.scales.time
        # In a cycle the spring relaxes by twice the step of friction, roughly.
        travel = 2.0 * abs(values["mu_s"] - values["mu_k0"]) * self.design.normal_force / values["stiffness"]
        duration = min(CYCLES * travel / self.design.speed + SETTLED * time, longest)
        for _ in range(DOUBLINGS):
            seen = self.run(duration)
            if seen.onsets.size > CYCLES or _slides_on(seen, time) or duration == longest:
                break
            duration = min(2.0 * duration, longest)
        return seen

    def perturbed(
        self, duration: float, nominal: Trajectory, until: float
    ) -> Iterator[tuple[Trajectory, float, Array]]:
        """A motion for each column of the sensitivities, the step it is off by, and when its load changes [s]."""
        unknowns, force = self.unknowns, self.design.normal_force
        for index in np.flatnonzero(unknowns.free).tolist():
            step = STEP * (1.0 if unknowns.logarithmic[index] else float(unknowns.spread[index]))
            yield self.run(duration, theta=self.theta + step * np.eye(self.theta.size)[index]), step, np.empty(0)
        for i in self.starts:
            state = unknowns.model.states[i]
            step = STEP * (float(self.scales.state[i]) if i == ELONGATION else 1.0)
            yield self.run(duration, start={state.name: state.start + step}), step, np.empty(0)
        for changes, on in _cycle_loads(nominal, until):
            yield self.run(duration, load=(changes, force * (1.0 + STEP * on))), STEP * force, changes


def simulated_log(
    unknowns: Unknowns, theta: Array, base: Array, design: LogDesign, longest: float
) -> SimulatedLog | None:
    """The log of a design, from rest with a fresh contact.

    None where nothing slips within `longest` [s], the spring pulls the mass back after a slip (no fit follows that),
    the model refuses, or the time is up.

    Parameters
    ----------
    theta, base : (n_p,) the values it is simulated with, of the rig of the scene.
    """
    if time_is_up():
        return None
    motions = _Designed(unknowns, theta, design.base(unknowns, base), design)
    shared, time = int(np.count_nonzero(unknowns.free)) + len(motions.starts), motions.scales.time
    try:
        nominal = motions.nominal(longest)
        onsets = nominal.onsets
        if not onsets.size or not _in_turn(nominal) or (design.duration and onsets.size > MOST_CYCLES):
            return None
        repeats = not design.duration and onsets.size > CYCLES
        until = float(onsets[CYCLES]) if repeats else nominal.duration
        period = float(onsets[CYCLES] - onsets[CYCLES - 1]) if repeats else 0.0
        drive = Drive.of(design.drive).changes(0.0, until)
        times, weights, beside = _moments(nominal, until, time, drive)
        around = np.column_stack([times - beside, times, times + beside])
        before, force, after = nominal.sample(around.ravel())["force"].reshape(-1, 3).T
        rate = (after - before) / (2.0 * beside)
        columns, longer = list[Array](), list[float]()
        for other, step, changes in motions.perturbed(until + 0.5 * period, nominal, until):
            at = _same_moments(nominal, other, times, until, (*drive, *changes.tolist()))
            columns.append((other.sample(at)["force"] - force - rate * (at - times)) / step)
            if repeats and len(longer) < shared:
                longer.append((float(other.onsets[CYCLES] - other.onsets[CYCLES - 1]) - period) / step)
    except SimulationError:
        return None
    sensitivity = np.column_stack(columns)
    if not np.all(np.isfinite(sensitivity)):
        return None
    arrests = nominal.arrests[nominal.arrests <= until]
    if not arrests.size:  # of a log that slides a fit may take the level only
        weights[times < until - STEADY * time] = 0.0
    repetition = None
    if repeats:
        since = int(np.searchsorted(times, onsets[CYCLES - 1]))
        repetition = Repetition(since, period, -np.outer(rate[since:], longer))
    return SimulatedLog(
        duration=until,
        slips=int(arrests.size),
        slip=float(np.median(arrests - onsets[: arrests.size])) if arrests.size else 2.0 * np.pi * time,
        sensitivity=sensitivity,
        weights=weights,
        start_sd=np.array([np.inf if i == ELONGATION else BOUNDED_START_SD for i in motions.starts]),
        free=shared - len(motions.starts),
        repetition=repetition,
    )


def _cycle_loads(seen: Trajectory, until: float) -> list[tuple[Array, Array]]:
    """For every cycle, times [s] and what is added to the normal force there: 1 within it, 0 outside."""
    arrests = seen.arrests[seen.arrests < until]
    ends = np.append(seen.onsets, seen.duration)[1 : arrests.size + 1]
    early = LOAD_CHANGE * (ends - arrests)
    changes = list(zip((arrests + early).tolist(), (arrests + 2.0 * early).tolist(), strict=True))
    out = []
    for i in range(len(changes) + 1):
        at, on = ([0.0], [1.0]) if i == 0 else ([0.0, *changes[i - 1]], [0.0, 0.0, 1.0])
        if i < len(changes):
            at, on = [*at, *changes[i]], [*on, 1.0, 0.0]
        out.append((np.array(at), np.array(on)))
    return out


def _in_turn(seen: Trajectory) -> bool:
    """Whether every slip ends in the stick after it; a mass that is pulled back comes to rest more than once."""
    onsets, arrests = seen.onsets, seen.arrests
    late = onsets[1 : arrests.size + 1]
    return bool(
        arrests.size in (onsets.size, onsets.size - 1)
        and np.all(arrests > onsets[: arrests.size])
        and np.all(arrests[: late.size] < late)
    )


def _slides_on(seen: Trajectory, time: float) -> bool:
    """Whether the mass has been sliding for so long that it will not come to rest."""
    slides = seen.onsets.size > seen.arrests.size
    return bool(slides and seen.duration - seen.onsets[-1] > SETTLED * time)


def _moments(seen: Trajectory, until: float, time: float, changes: Sequence[float]) -> tuple[Array, Array, Array]:
    """Nodes [s] and weights [s] of Gauss's rule between switches and changes of the drive; and for how long about each
    node the motion is smooth [s], at least."""
    starts = np.array([phase.start for phase in seen.phases])
    ends = np.unique([0.0, until, *changes, *starts[starts < until]])
    pieces = []
    for begin, end in itertools.pairwise(ends.tolist()):
        stick = seen.phases[int(np.searchsorted(starts, begin, side="right")) - 1].mode == "stick"
        count = 1 if stick else min(math.ceil((end - begin) / (PIECE * time)), MOST_PIECES)
        pieces.append(np.linspace(begin, end, count + 1))
    edges = np.unique(np.concatenate(pieces))
    half = 0.5 * np.diff(edges)[:, None]
    times, weights = edges[:-1, None] + half * (1.0 + POINTS), half * WEIGHTS
    return times.ravel(), weights.ravel(), np.broadcast_to(INSET * half, times.shape).ravel()


def _same_moments(seen: Trajectory, other: Trajectory, times: Array, until: float, changes: Sequence[float]) -> Array:
    """The moments of another motion [s] that correspond to times of this one: as far on the way from switch to switch,
    and to what changes at a set time.

    Raises:
        SimulationError: the other one does not switch alike.
    """
    ours, theirs = ([(p.start + p.duration, p.ended_by) for p in m.phases if p.ended_by] for m in (seen, other))
    count = sum(at < until for at, _ in ours) + 1
    knots = []
    for switches in (ours[:count], theirs[: len(ours[:count])]):
        fixed = [(at, None) for at in {0.0, seen.duration, *changes}]
        knots.append(sorted([*switches, *fixed], key=lambda knot: knot[0]))
    (at, what), (there, alike) = (zip(*knot, strict=True) for knot in knots)
    if what != alike:
        raise SimulationError("a motion that is a little off has other switches")
    return np.interp(times, at, there)


# ----------------------------------------------------------------------------------------------------------------------
# The choice: what is known, what each log adds.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Knowledge:
    """What is known before a log is chosen.

    Attributes
    ----------
    kept : (k,) places among the free parameters of those that another log shares.
    targets : names of what is to be identified.
    places : (d, n_p) theta, the likeliest and draws of what is uncertain.
    precision : (d, k, k) at each place; systematic : (k,) variances that no log lowers (tolerances).
    base : (n_p,) of the rig; variance : of a sample [N^2]; load_error : of the normal force in a cycle, relative.
    rate, fastest : lowest and highest sampling rate [Hz]; apart : seconds between independent samples, at least.
    longest : [s] of a log at one speed.
    """

    unknowns: Unknowns
    kept: NDArray[np.int64]
    targets: tuple[str, ...]
    places: Array
    precision: Array
    systematic: Array
    base: Array
    variance: float
    load_error: float
    rate: float
    longest: float
    apart: float = 0.0
    fastest: float = np.inf

    @property
    def index(self) -> NDArray[np.int64]:
        """Of the k parameters among all (k,)."""
        return np.flatnonzero(self.unknowns.free)[self.kept]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the k parameters."""
        return tuple(self.unknowns.names[i] for i in self.index.tolist())

    @property
    def targeted(self) -> list[int]:
        """Places of the targets among the k parameters."""
        return [i for i, name in enumerate(self.names) if name in self.targets]

    def variances(self, precision: Array) -> Array:
        """Relative variances (d, k): of a logarithm, or over what the parameter is judged by."""
        logarithmic, out = self.unknowns.logarithmic[self.index], np.empty(precision.shape[:2])
        for place, (matrix, theta) in enumerate(zip(precision, self.places, strict=True)):
            judged_by = sizes(self.unknowns, self.unknowns.values(theta, self.base))[self.index]
            size = np.where(logarithmic, 1.0, np.maximum(judged_by, 1e-300))
            out[place] = (np.diag(inverse(matrix)) + self.systematic) / size**2
        return np.minimum(out, UNKNOWN**2)

    def halves(self, precision: Array) -> Array:
        """Half lengths (d, k) of the 95 % intervals, relative."""
        half = NORMAL * np.sqrt(self.variances(precision))
        return np.where(self.unknowns.logarithmic[self.index], np.expm1(np.minimum(half, UNKNOWN)), half)

    def identified(self, precision: Array) -> dict[str, float]:
        """The targets that are known well enough: half lengths by name."""
        halves = promised(self.halves(precision))
        return {self.names[i]: float(halves[i]) for i in self.targeted if halves[i] <= SAFE * IDENTIFIED}


def promised(halves: Array) -> Array:
    """Half lengths (k,) that three of four places reach."""
    return np.asarray(np.quantile(halves, REACHED, axis=0, method="lower"))


@dataclass(frozen=True)
class PlannedLog:
    """A log to record.

    Attributes
    ----------
    times : how many of the simulated log, for a duration [s] with so many slips (at the likeliest place).
    rate : sampling rate [Hz].
    halves : (d, k) half lengths of the intervals with this log and those before it.
    identifies : half lengths with all logs, of what would not be known well enough without this one.
    repeats : whether it repeats the speed of a log at hand.
    """

    design: LogDesign
    times: int
    rate: float
    duration: float
    slips: int
    halves: Array
    identifies: Mapping[str, float]
    repeats: bool = False


@dataclass
class Candidates:
    """Simulated logs of designs, each simulated when it is first looked at."""

    knowledge: Knowledge
    logs: dict[tuple[LogDesign, int], SimulatedLog | None] = field(default_factory=dict)
    informed: dict[tuple[LogDesign, int, int], Array] = field(default_factory=dict)

    def at(self, design: LogDesign, place: int = 0) -> SimulatedLog | None:
        """The log of a design at one of the places."""
        if (design, place) not in self.logs:
            k = self.knowledge
            self.logs[design, place] = simulated_log(k.unknowns, k.places[place], k.base, design, k.longest)
        return self.logs[design, place]

    def seconds(self, design: LogDesign, times: int) -> float:
        """The duration of a log [s]."""
        log = self.at(design)
        return 0.0 if log is None else times * log.duration

    def rate(self, design: LogDesign) -> float:
        """The sampling rate to ask for [Hz]."""
        log = self.at(design)
        assert log is not None
        return min(round_up(max(self.knowledge.rate, WANTED / log.slip)), self.knowledge.fastest)

    def information(self, design: LogDesign, times: int, place: int) -> Array:
        """Information (k, k) of a log at a place, of the duration it has at the likeliest one."""
        k, first, log = self.knowledge, self.at(design), self.at(design, place)
        if first is None or log is None:
            return np.zeros((k.kept.size, k.kept.size))
        if (design, times, place) not in self.informed:
            independent = 1.0 / max(1.0 / self.rate(design), k.apart)
            load_sd = k.load_error * design.normal_force
            matrix = log.information(independent, k.variance, load_sd, times * first.duration / log.duration)
            self.informed[design, times, place] = matrix[np.ix_(k.kept, k.kept)]
        return self.informed[design, times, place]

    def precision(self, chosen: Mapping[LogDesign, int]) -> Array:
        """Precision (d, k, k) with the chosen logs."""
        out = self.knowledge.precision.copy()
        for design, times in chosen.items():
            out += [self.information(design, times, place) for place in range(len(out))]
        return out


def choose(
    candidates: Candidates,
    designs: Sequence[LogDesign],
    budget: float,
    setup: float,
    repeat: tuple[LogDesign, int] | None = None,
) -> list[PlannedLog]:
    """The logs that identify the targets, in the order they were chosen; a `repeat` that is asked for stands first.

    Parameters
    ----------
    designs : among which is chosen; one that is chosen again becomes longer.
    budget : time for all logs together [s], of which setting each up takes `setup` [s].
    """
    knowledge = candidates.knowledge
    chosen = {} if repeat is None else {repeat[0]: repeat[1]}
    for _ in range(ROUNDS):
        if len(knowledge.identified(candidates.precision(chosen))) == len(knowledge.targeted):
            break
        left = budget - sum(candidates.seconds(*log) + setup for log in chosen.items())
        best = _best(candidates, designs, chosen, left, setup)
        if best is None:
            break
        chosen[best[0]] = chosen.get(best[0], 0) + best[1]
    count = len(knowledge.identified(candidates.precision(chosen)))
    if count == len(knowledge.targeted):  # later logs may have made earlier ones superfluous
        for design in sorted(chosen, key=lambda design: -candidates.seconds(design, chosen[design])):
            rest = {other: times for other, times in chosen.items() if other != design}
            superfluous = len(knowledge.identified(candidates.precision(rest))) == count
            if superfluous and (repeat is None or design != repeat[0]):
                chosen = rest
    return [_planned(candidates, chosen, number, repeat) for number in range(len(chosen))]


def _planned(
    candidates: Candidates, chosen: Mapping[LogDesign, int], number: int, repeat: tuple[LogDesign, int] | None
) -> PlannedLog:
    design, times = list(chosen.items())[number]
    log, knowledge = candidates.at(design), candidates.knowledge
    assert log is not None
    together = knowledge.identified(candidates.precision(chosen))
    without = knowledge.identified(candidates.precision({d: n for d, n in chosen.items() if d != design}))
    return PlannedLog(
        design,
        times,
        candidates.rate(design),
        times * log.duration,
        times * log.slips,
        knowledge.halves(candidates.precision(dict(list(chosen.items())[: number + 1]))),
        {name: half for name, half in together.items() if name not in without},
        repeat is not None and design == repeat[0],
    )


def _best(
    candidates: Candidates, designs: Sequence[LogDesign], chosen: Mapping[LogDesign, int], left: float, setup: float
) -> tuple[LogDesign, int] | None:
    """The log that lowers the variances most for its time; None where none is worth it."""
    k, precision = candidates.knowledge, candidates.precision(chosen)
    enough = (0.5 * SAFE * IDENTIFIED / NORMAL) ** 2  # the score is level where a parameter is known well enough

    def score(matrices: Array) -> Array:
        return np.sum(np.log(k.variances(matrices)[:, k.targeted] + enough), axis=1)

    before = score(precision)

    def gain(log: tuple[LogDesign, int], count: int) -> float:
        more = np.array([candidates.information(*log, place) for place in range(count)])
        after = precision.copy()
        after[:count] += more
        return float(np.mean((before - score(after))[:count]))

    def per_second(value: float, log: tuple[LogDesign, int]) -> float:
        return value / (candidates.seconds(*log) + setup)

    possible = []
    for design in designs:
        log = candidates.at(design)
        if log is None:
            continue
        most = 1
        if log.slips:
            room = min(k.longest / log.duration, MOST_SLIPS / log.slips) - chosen.get(design, 0)
            most = int(max(min((left - setup) / log.duration, np.inf if design.holds else room), 0.0))
        possible += [(design, 2**i) for i in range(most.bit_length())]
    ranked = sorted(possible, key=lambda log: -per_second(gain(log, 1), log))
    first = list(dict.fromkeys(design for design, _ in ranked))[:TRIED]
    judged = [(gain(log, len(precision)), log) for log in ranked if log[0] in first]
    worth = [(per_second(value, log), log) for value, log in judged if value > LEAST_GAIN]
    return max(worth, key=lambda option: option[0])[1] if worth else None


def with_holds(knowledge: Knowledge, steady: LogDesign, holds: Sequence[float]) -> LogDesign:
    """A drive that stands for so long each [s] between runs.

    Each run ends half-way through the stick after its first slip, at the likeliest place: a slip in which the drive
    stops tells little, and is another one where the pair is a little different. Where the mass slides on, runs reach
    past the peak.
    """
    base = steady.base(knowledge.unknowns, knowledge.base)
    values = _Designed(knowledge.unknowns, knowledge.places[0], base, steady).values(knowledge.places[0])
    run_time = 3.0 * values["mu_s"] * steady.normal_force / (values["stiffness"] * steady.speed)  # past a first peak
    programme, at = list[tuple[float, float]](), 0.0
    for hold in (*holds, 0.0):
        programme.append((at, steady.speed))
        stop = at + run_time
        seen = run(knowledge.unknowns.model, values, tuple(programme), steady.normal_force, at + 2.0 * run_time)
        arrests = seen.arrests[seen.arrests > at]
        if arrests.size:
            onsets = np.append(seen.onsets[seen.onsets > arrests[0]], seen.duration)
            stop = 0.5 * float(arrests[0] + onsets[0])
        at = stop
        programme += [(at, 0.0)] if hold else []
        at += hold
    return LogDesign(tuple(programme), steady.normal_force, steady.stiffness, at)
