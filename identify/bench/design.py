"""Experiment design: what a log is expected to identify before it is recorded, and the few logs that identify most.

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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.errors import SimulationError
from identify.base.quantiles import NORMAL
from identify.estimation.covariance import IDENTIFIED, inverse, sizes
from identify.estimation.fit_wording import WANTED, round_up
from identify.logs.unknowns import Unknowns
from identify.model.model import ELONGATION
from identify.shooting.transcription import BOUNDED_START_SD
from identify.simulation.plan import scales
from identify.simulation.simulate import run
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

CYCLES = 4  # that are simulated of a steady drive; later ones repeat the last
REPEATED = 40  # of the later cycles, one by one: of more, each informs as much as these do on average, at least
DOUBLINGS = 6  # of the simulated duration until it has its cycles
SETTLED, STEADY = 60.0, 15.0  # times sqrt(m/k): a slide so long goes on; the end of it in which it is steady
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(6)  # of a phase, at which sensitivities are taken,
PIECE, MOST_PIECES = 2.0, 400  # and of each piece of a slide, in times sqrt(m/k)
INSET = 5e-3  # of half a piece: over which the rate of the force is taken
LOAD_CHANGE = 0.02  # of a stick: when the normal force of its cycle begins, which the force does not feel there
STEP = 1e-5  # of a logarithm, and of a spread, for the differences

SETUP = 60.0  # [s] that a log costs beside its duration
SAFE = 0.9  # of what `identified` allows
TRIED = 4  # designs that are simulated at all places, each time one is chosen
LEAST_GAIN = 0.1  # of the sum of the logarithms of the variances, for a log to be worth its time
MOST_SLIPS = 300  # of one log: of thousands a fit does not know what they promise
ROUNDS = 8  # of the choice
REACHED = 0.75  # of the places: what is promised is reached at so many
UNKNOWN = 50.0  # standard deviation of a logarithm that is as good as infinite


@dataclass(frozen=True)
class LogDesign:
    """How a log is recorded: drive speed [m/s], normal force [N], stiffness of the spring [N/m], None for that of the
    rig."""

    speed: float
    normal_force: float
    stiffness: float | None = None

    def base(self, unknowns: Unknowns, base: Array) -> Array:
        """Base values (n_p,) of the rig with the spring of this design; its damping ratio stays."""
        out, names = base.copy(), unknowns.names
        if self.stiffness is not None:
            scaled = [names.index(name) for name in ("stiffness", "damping") if name in names]
            out[scaled] *= self.stiffness / base[names.index("stiffness")]
        return out


# ----------------------------------------------------------------------------------------------------------------------
# A simulated log and the sensitivities of its force.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SimulatedLog:
    """A log of a design at one place of the parameters.

    duration, slips, slip: duration [s], slips that end in it, how long one takes [s]. sensitivity (t, f + s + c): of
    the force, to the f free theta, the s unknowns of the start (how far the spring is loaded, how fresh the contact is)
    and the normal force [N] in each of c cycles. weights (t,): seconds that each row counts for. start_sd (s,): what a
    fit takes the unknowns of the start to be within. It goes on with its last cycle, from row `since` on, of `period`
    [s], 0 where it does not repeat; later (l, f + s): what one more cycle adds to the sensitivities of these rows, as a
    longer one delays all after it.
    """

    duration: float
    slips: int
    slip: float
    sensitivity: Array
    weights: Array
    start_sd: Array
    since: int
    period: float
    later: Array

    @property
    def shared(self) -> int:
        """Columns that are no normal force of a cycle: f + s."""
        return self.later.shape[1]

    def information(self, rate: float, variance: float, load_sd: float, times: float = 1.0) -> Array:
        """Fisher information (f, f) of the free theta.

        Args:
            rate: independent samples per second; variance: of each [N^2]. load_sd: error of the normal force [N],
                another one in each cycle (0: none). times: as long a log as so many of these.
        """
        rows, weights, duration = self.sensitivity, self.weights, self.duration
        if self.period and times > 1.0:
            count = min(round((times - 1.0) * duration / self.period), REPEATED)
            rows, weights = self._extended(count)
            duration += count * self.period
        rows = rows if load_sd > 0.0 else rows[:, : self.shared]
        total = rows.T @ (rows * (weights * rate / variance)[:, None])
        f = self.shared - self.start_sd.size
        own = np.arange(f, len(total))
        total[own, own] += np.append(self.start_sd, np.full(own.size - self.start_sd.size, load_sd)) ** -2.0
        scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
        scaled = total * np.outer(scale, scale)
        across = scaled[:f, f:]
        left = scaled[:f, :f] - across @ np.linalg.pinv(scaled[f:, f:], 1e-13, hermitian=True) @ across.T
        return np.asarray(times * self.duration / duration * left / np.outer(scale[:f], scale[:f]))

    def _extended(self, count: int) -> tuple[Array, Array]:
        """Sensitivities and weights with `count` more cycles. The load of a cycle acts on those after it as that of an
        earlier one does on the last that was simulated."""
        n, rows, shared = len(self.sensitivity), self.sensitivity[self.since :], self.shared
        loads = self.sensitivity.shape[1] - shared
        out = np.zeros((n + count * len(rows), shared + loads + count))
        out[:n, : shared + loads] = self.sensitivity
        for i in range(1, count + 1):
            cycle = slice(n + (i - 1) * len(rows), n + i * len(rows))
            columns = np.maximum(np.arange(loads + i) - i, 1)
            columns[0] = 0  # the first cycle, from a fresh contact, is unlike the others
            out[cycle, :shared] = rows[:, :shared] + i * self.later
            out[cycle, shared : shared + loads + i] = rows[:, shared + columns]
        return out, np.concatenate([self.weights, np.tile(self.weights[self.since :], count)])


def simulated_log(
    unknowns: Unknowns, theta: Array, base: Array, design: LogDesign, longest: float, cycles: int = CYCLES
) -> SimulatedLog | None:
    """The log of a design, from rest with a fresh contact, at theta (n_p,) and base values (n_p,) of the rig: so many
    cycles, which repeat.

    None where nothing slips within `longest` [s], the spring pulls the mass back after a slip (no fit follows that),
    the model refuses, or the time is up.
    """
    if time_is_up():
        return None
    model, own = unknowns.model, design.base(unknowns, base)

    def named(theta: Array) -> dict[str, float]:
        return dict(zip(unknowns.names, unknowns.values(theta, own).tolist(), strict=True))

    values, force = named(theta), design.normal_force
    typical = scales(model, unknowns.values(theta, own), force)
    # What a fit does not know of the start: the spring can be loaded already, and the contact be older.
    starts = [i for i, state in enumerate(model.states) if i == ELONGATION or state.lower is not None]
    try:
        nominal = _nominal(unknowns, values, design, longest, typical.time, cycles)
        onsets = nominal.onsets
        if not onsets.size or not _in_turn(nominal):
            return None
        repeats = onsets.size > cycles
        until = float(onsets[cycles]) if repeats else nominal.duration
        period = float(onsets[cycles] - onsets[cycles - 1]) if repeats else 0.0
        times, weights, beside = _moments(nominal, until, typical.time)
        around = np.column_stack([times - beside, times, times + beside])
        before, here, after = nominal.sample(around.ravel())["force"].reshape(-1, 3).T
        rate, seconds = (after - before) / (2.0 * beside), until + 0.5 * period
        columns, longer = list[Array](), list[float]()

        def differ(other: Trajectory, step: float, changes: Sequence[float] = ()) -> None:
            at = _same_moments(nominal, other, times, until, changes)
            columns.append((other.sample(at)["force"] - here - rate * (at - times)) / step)
            if repeats and not changes:
                longer.append((float(other.onsets[cycles] - other.onsets[cycles - 1]) - period) / step)

        for index in np.flatnonzero(unknowns.free).tolist():
            step = STEP * (1.0 if unknowns.logarithmic[index] else float(unknowns.spread[index]))
            moved = theta + step * np.eye(theta.size)[index]
            differ(run(model, named(moved), design.speed, force, seconds), step)
        for i in starts:
            step = STEP * (float(typical.state[i]) if i == ELONGATION else 1.0)
            start = {model.states[i].name: model.states[i].start + step}
            differ(run(model, values, design.speed, force, seconds, start=start), step)
        for changes, on in _cycle_loads(nominal, until):
            load = (changes, force * (1.0 + STEP * on))
            differ(run(model, values, design.speed, load, seconds), STEP * force, changes.tolist())
    except SimulationError:
        return None
    sensitivity, shared = np.column_stack(columns), int(np.count_nonzero(unknowns.free)) + len(starts)
    if not np.all(np.isfinite(sensitivity)):
        return None
    arrests = nominal.arrests[nominal.arrests <= until]
    if not arrests.size:  # of a log that slides a fit may take the level only
        weights[times < until - STEADY * typical.time] = 0.0
    since = int(np.searchsorted(times, onsets[cycles - 1])) if repeats else times.size
    return SimulatedLog(
        duration=until,
        slips=int(arrests.size),
        slip=float(np.median(arrests - onsets[: arrests.size])) if arrests.size else 2.0 * np.pi * typical.time,
        sensitivity=sensitivity,
        weights=weights,
        start_sd=np.array([np.inf if i == ELONGATION else BOUNDED_START_SD for i in starts]),
        since=since,
        period=period,
        later=-np.outer(rate[since:], longer) if repeats else np.zeros((0, shared)),
    )


def _nominal(
    unknowns: Unknowns, values: dict[str, float], design: LogDesign, longest: float, time: float, cycles: int
) -> Trajectory:
    """The motion until its cycles are there, the mass slides on, or for `longest` [s]."""
    # In a cycle the spring relaxes by twice the step of friction, roughly.
    travel = 2.0 * abs(values["mu_s"] - values["mu_k0"]) * design.normal_force / values["stiffness"]
    duration = min(cycles * travel / design.speed + SETTLED * time, longest)
    for _ in range(DOUBLINGS):
        seen = run(unknowns.model, values, design.speed, design.normal_force, duration)
        sliding = seen.onsets.size > seen.arrests.size and seen.duration - seen.onsets[-1] > SETTLED * time
        if seen.onsets.size > cycles or sliding or duration == longest:
            break
        duration = min(2.0 * duration, longest)
    return seen


def _cycle_loads(seen: Trajectory, until: float) -> list[tuple[Array, Array]]:
    """For every cycle, times [s] and what is added to the normal force there: 1 within it, 0 outside."""
    arrests = seen.arrests[seen.arrests < until]
    early = LOAD_CHANGE * (np.append(seen.onsets, seen.duration)[1 : arrests.size + 1] - arrests)
    changes, out = np.stack([arrests + early, arrests + 2.0 * early], axis=1), []
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


def _moments(seen: Trajectory, until: float, time: float) -> tuple[Array, Array, Array]:
    """Nodes [s] and weights [s] of Gauss's rule between switches; and for how long about each
    node the motion is smooth [s], at least."""
    starts = np.array([phase.start for phase in seen.phases])
    ends = np.unique([0.0, until, *starts[starts < until]])
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
    count, fixed = sum(at < until for at, _ in ours) + 1, [(at, None) for at in {0.0, seen.duration, *changes}]
    knots = [sorted([*each[: len(ours[:count])], *fixed], key=lambda knot: knot[0]) for each in (ours[:count], theirs)]
    (at, what), (there, alike) = (zip(*knot, strict=True) for knot in knots)
    if what != alike:
        raise SimulationError("a motion that is a little off has other switches")
    return np.interp(times, at, there)


# ----------------------------------------------------------------------------------------------------------------------
# The choice: what is known, what each log adds.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Knowledge:
    """What is known before a log is chosen, and logs of designs, each simulated when it is first looked at.

    kept (k,): places among the free parameters of those that another log shares. targets: names of what is to be
    identified. places (d, n_p): theta, the likeliest and draws of what is uncertain. precision (d, k, k) at each;
    systematic (k,): variances that no log lowers (tolerances). base (n_p,): of the rig; variance: of a sample [N^2];
    load_error: of the normal force in a cycle, relative. rate, fastest: lowest and highest sampling rate [Hz]; apart:
    seconds between independent samples, at least. longest: [s] of a log at one speed.
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
    _logs: dict[tuple[LogDesign, int], SimulatedLog | None] = field(default_factory=dict, repr=False, compare=False)
    _informed: dict[tuple[LogDesign, int, int], Array] = field(default_factory=dict, repr=False, compare=False)

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

    def log(self, design: LogDesign, place: int = 0) -> SimulatedLog | None:
        """The log of a design at one of the places."""
        if (design, place) not in self._logs:
            made = simulated_log(self.unknowns, self.places[place], self.base, design, self.longest)
            self._logs[design, place] = made
        return self._logs[design, place]

    def seconds(self, design: LogDesign, times: int) -> float:
        """The duration of a log with its setting up [s]."""
        log = self.log(design)
        return SETUP + (0.0 if log is None else times * log.duration)

    def sampling(self, design: LogDesign) -> float:
        """The sampling rate to ask for [Hz]."""
        log = self.log(design)
        return self.rate if log is None else min(round_up(max(self.rate, WANTED / log.slip)), self.fastest)

    def information(self, design: LogDesign, times: int, place: int) -> Array:
        """Information (k, k) of a log at a place, of the duration it has at the likeliest one."""
        first, log = self.log(design), self.log(design, place)
        if first is None or log is None:
            return np.zeros((self.kept.size, self.kept.size))
        if (design, times, place) not in self._informed:
            rate, load_sd = 1.0 / max(1.0 / self.sampling(design), self.apart), self.load_error * design.normal_force
            matrix = log.information(rate, self.variance, load_sd, times * first.duration / log.duration)
            self._informed[design, times, place] = matrix[np.ix_(self.kept, self.kept)]
        return self._informed[design, times, place]

    def with_logs(self, chosen: Mapping[LogDesign, int]) -> Array:
        """Precision (d, k, k) with the chosen logs."""
        out = self.precision.copy()
        for design, times in chosen.items():
            out += [self.information(design, times, place) for place in range(len(out))]
        return out


def promised(halves: Array) -> Array:
    """Half lengths (k,) that three of four places reach."""
    return np.asarray(np.quantile(halves, REACHED, axis=0, method="lower"))


@dataclass(frozen=True)
class PlannedLog:
    """A log to record: `times` the simulated one, for a duration [s] with so many slips (at the likeliest place);
    sampling rate [Hz]; halves (d, k): half lengths of the intervals with this log and those before it; identifies: half
    lengths with all logs, of what would not be known well enough without this one; repeats: whether it repeats the
    speed of a log at hand."""

    design: LogDesign
    times: int
    rate: float
    duration: float
    slips: int
    halves: Array
    identifies: Mapping[str, float]
    repeats: bool = False


def choose(
    knowledge: Knowledge,
    designs: Sequence[LogDesign],
    budget: float,
    repeat: tuple[LogDesign, int] | None = None,
) -> list[PlannedLog]:
    """The logs that identify the targets, in the order they were chosen; a `repeat` that is asked for stands first.

    Args:
        designs: among which is chosen; one that is chosen again becomes longer.
        budget: time for all logs together [s], setting each up included.
    """
    chosen = {} if repeat is None else {repeat[0]: repeat[1]}

    def known(logs: Mapping[LogDesign, int]) -> dict[str, float]:
        return knowledge.identified(knowledge.with_logs(logs))

    for _ in range(ROUNDS):
        if len(known(chosen)) == len(knowledge.targeted):
            break
        best = _best(knowledge, designs, chosen, budget - sum(knowledge.seconds(*log) for log in chosen.items()))
        if best is None:
            break
        chosen[best[0]] = chosen.get(best[0], 0) + best[1]
    if len(known(chosen)) == len(knowledge.targeted):  # later logs may have made earlier ones superfluous
        for design in sorted(chosen, key=lambda design: -knowledge.seconds(design, chosen[design])):
            rest = {other: times for other, times in chosen.items() if other != design}
            if len(known(rest)) == len(knowledge.targeted) and (repeat is None or design != repeat[0]):
                chosen = rest
    together, out = known(chosen), []
    for number, (design, times) in enumerate(chosen.items()):
        log, without = knowledge.log(design), known({d: n for d, n in chosen.items() if d != design})
        assert log is not None
        out.append(
            PlannedLog(
                design,
                times,
                knowledge.sampling(design),
                times * log.duration,
                times * log.slips,
                knowledge.halves(knowledge.with_logs(dict(list(chosen.items())[: number + 1]))),
                {name: half for name, half in together.items() if name not in without},
                repeat is not None and design == repeat[0],
            )
        )
    return out


def _best(
    knowledge: Knowledge, designs: Sequence[LogDesign], chosen: Mapping[LogDesign, int], left: float
) -> tuple[LogDesign, int] | None:
    """The log that lowers the variances most for its time; None where none is worth it."""
    precision, targeted = knowledge.with_logs(chosen), knowledge.targeted
    enough = (0.5 * SAFE * IDENTIFIED / NORMAL) ** 2  # the score is level where a parameter is known well enough

    def score(matrices: Array) -> Array:
        return np.sum(np.log(knowledge.variances(matrices)[:, targeted] + enough), axis=1)

    before = score(precision)

    def gain(log: tuple[LogDesign, int], count: int) -> float:
        after = precision.copy()
        after[:count] += np.array([knowledge.information(*log, place) for place in range(count)])
        return float(np.mean((before - score(after))[:count]))

    possible = []
    for design in designs:
        log = knowledge.log(design)
        if log is None:
            continue
        most = 1
        if log.slips:
            room = min(knowledge.longest / log.duration, MOST_SLIPS / log.slips) - chosen.get(design, 0)
            most = int(max(min((left - SETUP) / log.duration, room), 0.0))
        possible += [(design, 2**i) for i in range(most.bit_length())]
    ranked = sorted(possible, key=lambda log: -gain(log, 1) / knowledge.seconds(*log))
    first = list(dict.fromkeys(design for design, _ in ranked))[:TRIED]
    judged = [(gain(log, len(precision)), log) for log in ranked if log[0] in first]
    worth = [(value / knowledge.seconds(*log), log) for value, log in judged if value > LEAST_GAIN]
    return max(worth, key=lambda option: option[0])[1] if worth else None
