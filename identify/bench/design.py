"""Experiment design: what a log is expected to identify before it is recorded, and the few logs that identify most.

The expected information of a log is the Fisher information of white noise: the integral over time of the outer product
of the sensitivities of its force, times samples per second, over the variance of a sample. What a fit does not know
either, the start of the log and the load in each cycle, is eliminated. Logs are chosen one after the other by what
each adds to what is known already (greedy D-optimal design; Pukelsheim, Optimal Design of Experiments, 1993).

Sensitivities are central differences of cycles, all of a log in one batch: by the rest state before it, the free
parameters and the load. They are chained from cycle to cycle; at a fixed time they also hold how far the beginnings of
the stick and of the slip have moved.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.base.quantiles import NORMAL
from identify.estimation.covariance import IDENTIFIED, inverse, sizes
from identify.estimation.fit_wording import WANTED, round_up
from identify.logs.unknowns import Unknowns
from identify.model.model import ELONGATION, SPEED, Model
from identify.prediction.cycles import CLOSELY, CycleBatch, check_calculable
from identify.shooting.layout import BOUNDED_START_SD

Array = NDArray[np.float64]

CYCLES = 8  # that are simulated of a steady drive at most; later ones repeat the last
REPEATS = 1e-3  # of normal force / stiffness: a cycle that begins like the one before repeats it
DISTINCT = 40  # cycles with a load of their own each: of more, each informs as much as these do on average, at least
LEAST = 4  # cycles of a log
STICK, SLIP = (np.polynomial.legendre.leggauss(n) for n in (6, 64))  # at which sensitivities are taken: points, weights
STEP = 1e-3  # of a logarithm, a spread, a typical rest state and the load: differences

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


# A simulated log and the sensitivities of its force.


@dataclass(frozen=True)
class SimulatedLog:
    """A log of a design at one place of the parameters, from rest with a fresh contact.

    sticks, slips (c,): durations [s] of the first cycles, the last of which repeats. All slopes are by the rest state
    before a cycle, the f free theta and the load, m = n_y + f + 1 columns: stick_slopes, slip_slopes (c, m); end
    (c, n_y, m) of the rest state after it; slopes (c, r, m) of the force [N] at moments of a cycle, at fixed times
    since the beginning of the stick or of the slip; rates (c, r) of the force [N/s]; seconds (c, r) that each counts
    for. starts: places in a rest state of what a fit does not know of the start: how far the spring is loaded, how
    fresh the contact is.
    """

    sticks: Array
    slips: Array
    stick_slopes: Array
    slip_slopes: Array
    end: Array
    slopes: Array
    rates: Array
    seconds: Array
    starts: tuple[int, ...]

    @staticmethod
    def of(model: Model, given: Array, moves: Array, across: Array, starts: tuple[int, ...]) -> SimulatedLog | None:
        """The cycles from rest states and settings `given` (c, n_y + n_w); None where one of them, or of those beside
        it, is no cycle, or the spring pulls the mass back.

        Args:
            moves (2, m, n_y + n_w): what each column adds up and down, which lie `across` (m,) from each other.
        """
        count, n_y = len(given), len(model.states) - 1
        every = given[:, None] + np.vstack([np.zeros_like(moves[0, :1]), *moves])
        batch = CycleBatch(model, every[..., n_y:].reshape(-1, every.shape[2] - n_y))
        rows = batch.run(every[..., :n_y].reshape(-1, n_y), CLOSELY)
        if not np.all(rows.rests) or any(np.any(node.direction < 0.0) for node in rows.nodes):
            return None
        stick, slip = (duration.reshape(count, -1) for duration in (rows.stick, rows.slip))
        times = [0.5 * own[:, :1] * (1.0 + points) for own, (points, _) in ((stick, STICK), (slip, SLIP))]
        force, rates = batch.forces(rows, *(np.repeat(each, every.shape[1], axis=0) for each in times))
        # A state at its bound moves to one side only.
        begun = np.delete(rows.start, SPEED, 1).reshape(count, -1, n_y)
        apart = np.tile(across, (count, 1))
        apart[:, :n_y] = [np.diag(each) for each in begun[:, 1 : 1 + n_y] - begun[:, 1 + len(across) :][:, :n_y]]

        def slopes(values: Array) -> Array:
            """By the columns, of what has a value for each row."""
            up, down = np.split(values.reshape(count, len(every[0]), -1)[:, 1:], 2, axis=1)
            return np.moveaxis((up - down) / apart[..., None], 1, 2)

        return SimulatedLog(
            sticks=stick[:, 0],
            slips=slip[:, 0],
            stick_slopes=slopes(stick)[:, 0],
            slip_slopes=slopes(slip)[:, 0],
            end=slopes(rows.y),
            slopes=slopes(force),
            rates=rates.reshape(count, -1, rates.shape[1])[:, 0],
            seconds=0.5 * np.hstack([stick[:, :1] * STICK[1], slip[:, :1] * SLIP[1]]),
            starts=starts,
        )

    @cached_property
    def ends(self) -> Array:
        """When the cycles begin and end [s]."""
        return np.cumsum([0.0, *(self.sticks + self.slips)])

    @property
    def period(self) -> float:
        """Of the cycle that repeats [s]."""
        return float(self.ends[-1] - self.ends[-2])

    @property
    def slip(self) -> float:
        """How long a slip takes [s]."""
        return float(np.median(self.slips))

    def duration(self, cycles: float) -> float:
        """Seconds that so many cycles take."""
        known = len(self.sticks)
        return float(np.interp(cycles, np.arange(known + 1), self.ends) + max(cycles - known, 0.0) * self.period)

    def count(self, seconds: float) -> float:
        """Cycles in so many seconds."""
        more = max(seconds - float(self.ends[-1]), 0.0) / self.period
        return float(np.interp(seconds, self.ends, np.arange(len(self.ends)))) + more

    def information(self, rate: float, variance: float, load_sd: float, cycles: float) -> Array:
        """Fisher information (f, f) of the free theta.

        Args:
            rate: independent samples per second; variance: of each [N^2]. load_sd: error of the normal force [N],
                another one in each cycle (0: none). cycles: a part of one informs in proportion.
        """
        n_y, m = self.end.shape[1:]
        f, s = m - n_y - 1, len(self.starts)
        whole = min(max(math.ceil(cycles), 1), DISTINCT)
        size, slipping = f + s + whole, np.arange(self.rates.shape[1]) >= STICK[0].size
        state, mine, shift = np.zeros((n_y, size)), np.eye(f + 1, size), np.zeros(size)
        state[self.starts, np.arange(f, f + s)] = 1.0
        total = np.zeros((size, size))
        for number in range(whole):
            at = min(number, len(self.sticks) - 1)
            mine[f], mine[f, f + s + number] = 0.0, 1.0
            given, rates = np.vstack([state, mine]), self.rates[at]
            stick = self.stick_slopes[at] @ given
            slopes = self.slopes[at] @ given - rates[:, None] * (shift + slipping[:, None] * stick)
            total += slopes.T @ (slopes * self.seconds[at, :, None])
            state, shift = self.end[at] @ given, shift + stick + self.slip_slopes[at] @ given
        total *= rate / variance
        total = total if load_sd > 0.0 else total[: f + s, : f + s]
        own, start_sd = np.arange(f, len(total)), [np.inf if i == ELONGATION else BOUNDED_START_SD for i in self.starts]
        total[own, own] += np.append(start_sd, np.full(own.size - s, load_sd)) ** -2.0
        scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
        scaled = total * np.outer(scale, scale)
        across = scaled[:f, f:]
        left = scaled[:f, :f] - across @ np.linalg.pinv(scaled[f:, f:], 1e-13, hermitian=True) @ across.T
        return np.asarray(cycles / whole * left / np.outer(scale[:f], scale[:f]))


def simulated_log(
    unknowns: Unknowns, theta: Array, base: Array, design: LogDesign, longest: float
) -> SimulatedLog | None:
    """The log of a design at theta (n_p,) and base values (n_p,) of the rig, whose damping ratio stays with its spring.

    None where nothing slips within `longest` [s], the mass slides on after a slip or is pulled back by the spring (no
    fit follows that), or the model refuses.
    """
    model, own = unknowns.model, base.copy()
    if design.stiffness is not None:
        scaled = [unknowns.names.index(name) for name in ("stiffness", "damping") if name in unknowns.names]
        own[scaled] *= design.stiffness / base[unknowns.names.index("stiffness")]

    def setting(theta: Array) -> Array:
        return np.append(unknowns.values(theta, own), [design.normal_force, design.speed])

    w, free = setting(theta), np.flatnonzero(unknowns.free).tolist()
    # What a fit does not know of the start: the spring can be loaded already, and the contact be older.
    starts = [i for i, state in enumerate(model.states) if i == ELONGATION or state.lower is not None]
    try:
        check_calculable(model)
        batch, y = CycleBatch(model, w[None]), np.delete([[state.start for state in model.states]], SPEED, 1)
        given, seconds = list[Array](), 0.0
        while len(given) < CYCLES:
            cycle = batch.run(y)
            seconds += float(cycle.stick[0] + cycle.slip[0])
            if not cycle.rests[0] or (seconds > longest and not given):
                return None
            given.append(np.append(y, w))
            before, y = y, cycle.y
            if seconds > longest or np.max(np.abs(y - before) / batch.scale) < REPEATS:
                break
        steps = [STEP * (1.0 if unknowns.logarithmic[i] else unknowns.spread[i]) for i in free]
        n_y, sizes = y.size, STEP * batch.scale[0]
        moves = np.zeros((2, n_y + len(free) + 1, n_y + w.size))  # up and down, what each column moves
        for side, sign in enumerate((1.0, -1.0)):
            moves[side, range(n_y), range(n_y)] = sign * sizes
            theta_moves = zip(steps, np.eye(theta.size)[free], strict=True)
            moves[side, n_y:-1, n_y:] = [setting(theta + sign * step * unit) - w for step, unit in theta_moves]
            moves[side, -1, -2] = sign * STEP * design.normal_force
        across = 2.0 * np.array([*sizes, *steps, STEP * design.normal_force])
        return SimulatedLog.of(model, np.array(given), moves, across, tuple(i - (i > SPEED) for i in starts))
    except SimulationError:
        return None


# The choice: what is known, what each log adds.


@dataclass(frozen=True)
class Knowledge:
    """What is known before a log is chosen, and logs of designs, each simulated when it is first needed.

    kept (k,): places among the free parameters of those that another log shares. targets: names of what is to be
    identified. places (d, n_p): theta, the likeliest and draws of what is uncertain. precision (d, k, k) at each;
    systematic (k,): variances that no log lowers (tolerances). base (n_p,): of the rig; noise: of a sample [N];
    load_error: of the normal force in a cycle, relative. rate, fastest: lowest and highest sampling rate [Hz].
    longest: [s] of a log at one speed.
    """

    unknowns: Unknowns
    kept: NDArray[np.int64]
    targets: tuple[str, ...]
    places: Array
    precision: Array
    systematic: Array
    base: Array
    noise: float
    load_error: float
    rate: float
    fastest: float
    longest: float
    _logs: dict[tuple[LogDesign, int], SimulatedLog | None] = field(default_factory=dict, repr=False, compare=False)
    _information: dict[tuple[LogDesign, int, int], Array] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def index(self) -> NDArray[np.int64]:
        """Of the k parameters among all (k,)."""
        return np.flatnonzero(self.unknowns.free)[self.kept]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the k parameters."""
        return tuple(self.unknowns.names[i] for i in self.index.tolist())

    @cached_property
    def targeted(self) -> list[int]:
        """Places of the targets among the k parameters."""
        return [i for i, name in enumerate(self.names) if name in self.targets]

    def variances(self, precision: Array) -> Array:
        """Relative variances (d, k): of a logarithm, or over what the parameter is judged by."""
        logarithmic, out = self.unknowns.logarithmic[self.index], np.empty(precision.shape[:2])
        for place, (matrix, theta) in enumerate(zip(precision, self.places, strict=False)):
            judged_by = sizes(self.unknowns, self.unknowns.values(theta, self.base))[self.index]
            size = np.where(logarithmic, 1.0, np.maximum(judged_by, 1e-300))
            out[place] = (np.diag(inverse(matrix)) + self.systematic) / size**2
        return np.minimum(out, UNKNOWN**2)

    def halves(self, precision: Array) -> Array:
        """Half lengths (d, k) of the 95 % intervals, relative."""
        half = NORMAL * np.sqrt(self.variances(precision))
        return np.where(self.unknowns.logarithmic[self.index], np.expm1(np.minimum(half, UNKNOWN)), half)

    def identifies(self, logs: Mapping[LogDesign, int]) -> bool:
        """Whether all targets are known well enough with logs of so many cycles."""
        halves = promised(self.halves(self.with_logs(logs)))[self.targeted]
        return bool(np.all(halves <= SAFE * IDENTIFIED))

    def log(self, design: LogDesign, place: int = 0) -> SimulatedLog | None:
        """The log of a design at one of the places."""
        if (design, place) not in self._logs:
            simulated = simulated_log(self.unknowns, self.places[place], self.base, design, self.longest)
            self._logs[design, place] = simulated
        return self._logs[design, place]

    def seconds(self, design: LogDesign, cycles: int) -> float:
        """The duration of a log with its setting up [s]."""
        log = self.log(design)
        return SETUP + (0.0 if log is None else log.duration(cycles))

    def sampling(self, design: LogDesign) -> float:
        """The sampling rate to ask for [Hz]."""
        log = self.log(design)
        return self.rate if log is None else min(round_up(max(self.rate, WANTED / log.slip)), self.fastest)

    def information(self, design: LogDesign, cycles: int, place: int) -> Array:
        """Information (k, k) of a log at a place, of the duration it has at the likeliest one."""
        if (design, cycles, place) not in self._information:
            first, log = self.log(design), self.log(design, place)
            shared = np.zeros((self.kept.size, self.kept.size))
            if first is not None and log is not None:
                count, load_sd = log.count(first.duration(cycles)), self.load_error * design.normal_force
                matrix = log.information(self.sampling(design), self.noise**2, load_sd, count)
                shared = matrix[np.ix_(self.kept, self.kept)]
            self._information[design, cycles, place] = shared
        return self._information[design, cycles, place]

    def with_logs(self, chosen: Mapping[LogDesign, int]) -> Array:
        """Precision (d, k, k) with the chosen logs, each of so many cycles."""
        added = [[self.information(*log, place) for log in chosen.items()] for place in range(len(self.places))]
        return self.precision + (np.sum(added, axis=1) if chosen else 0.0)


def promised(halves: Array) -> Array:
    """Half lengths (k,) that three of four places reach."""
    return np.asarray(np.quantile(halves, REACHED, axis=0, method="lower"))


@dataclass(frozen=True)
class PlannedLog:
    """A log to record, for a duration [s] with so many slips (at the likeliest place); sampling rate [Hz]; halves
    (d, k): half lengths of the intervals with this log and those before it; repeats: whether it repeats the speed of a
    log at hand."""

    design: LogDesign
    rate: float
    duration: float
    slips: int
    halves: Array
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
    for _ in range(ROUNDS):
        left = budget - sum(knowledge.seconds(*log) for log in chosen.items())
        best = None if knowledge.identifies(chosen) else _best(knowledge, designs, chosen, left)
        if best is None:
            break
        chosen[best[0]] = chosen.get(best[0], 0) + best[1]
    if knowledge.identifies(chosen):  # later logs may have made earlier ones superfluous
        for design in sorted(chosen, key=lambda design: -knowledge.seconds(design, chosen[design])):
            rest = {other: n for other, n in chosen.items() if other != design}
            if knowledge.identifies(rest) and (repeat is None or design != repeat[0]):
                chosen = rest
    out, so_far = list[PlannedLog](), dict[LogDesign, int]()
    for design, cycles in chosen.items():
        log, so_far[design] = knowledge.log(design), cycles
        assert log is not None
        halves, repeats = knowledge.halves(knowledge.with_logs(so_far)), repeat is not None and design == repeat[0]
        out.append(PlannedLog(design, knowledge.sampling(design), log.duration(cycles), cycles, halves, repeats))
    return out


def _best(
    knowledge: Knowledge, designs: Sequence[LogDesign], chosen: Mapping[LogDesign, int], left: float
) -> tuple[LogDesign, int] | None:
    """The log that lowers the variances most for its time; None where none is worth it."""
    precision, targeted = knowledge.with_logs(chosen), knowledge.targeted
    enough = (0.5 * SAFE * IDENTIFIED / NORMAL) ** 2  # the score is level where a parameter is known well enough

    def worth(log: tuple[LogDesign, int], count: int) -> float:
        """What a log gains at the first so many places per second of its time."""
        after = precision[:count] + [knowledge.information(*log, place) for place in range(count)]
        before, now = (knowledge.variances(each)[:, targeted] for each in (precision[:count], after))
        gain = float(np.mean(np.sum(np.log((before + enough) / (now + enough)), axis=1)))
        return gain / knowledge.seconds(*log) if gain > LEAST_GAIN else 0.0

    possible = []
    for design in designs:
        log = knowledge.log(design)
        if log is None:
            continue
        most = min(log.count(knowledge.longest), MOST_SLIPS) - chosen.get(design, 0)
        most = int(max(min(log.count(left - SETUP), most), 0.0))
        counts = [LEAST * 2**i for i in range((most // LEAST).bit_length())] or [most] * (most > 0)
        possible += [(design, count) for count in counts]
    ranked = sorted(possible, key=lambda log: -worth(log, 1))  # at the likeliest place, the first of them at all
    first = list(dict.fromkeys(design for design, _ in ranked))[:TRIED]
    judged = {log: worth(log, len(precision)) for log in ranked if log[0] in first}
    best = max(judged, key=lambda log: judged[log], default=None)
    return best if best is not None and judged[best] > 0.0 else None
