"""What a log cannot tell, and what test would: in lab words, from its own figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from identify.base.wording import speed_text
from identify.estimation.covariance import Estimate
from identify.estimation.residual_autocorrelation import Colour
from identify.logs.log_data import LogData
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.prediction.wording import listed
from identify.shooting.shooting_trajectory import ShootingTrajectory

# ----------------------------------------------------------------------------------------------------------------------
# The friction of logs that slide: one coefficient for each stretch of steady sliding, at its own speed.
# ----------------------------------------------------------------------------------------------------------------------

FIGURES = 3  # of a speed in a sentence
FEWEST = 2  # samples from which on a level has a scatter
WHITE = Colour(np.empty(0), 1.0)


@dataclass(frozen=True)
class Level:
    """A mean friction coefficient, its standard error, and the speed of sliding [m/s]."""

    coefficient: float
    error: float
    speed: float

    @property
    def words(self) -> str:
        """As "0.6 ± 0.003 at 1 mm/s", with two standard errors."""
        return f"{self.coefficient:.4g} ± {2.0 * self.error:.1g} at {speed_text(self.speed, FIGURES)}"


def levels(data: LogData, trajectory: ShootingTrajectory, colour: Colour = WHITE) -> list[Level]:
    """The level of every stretch of steady sliding, in the order of the log.

    The error is the scatter about the level over the root of as many samples as its noise leaves independent, and how
    far the course of the normal force may be off; what that misses of fast rhythms is part of the scatter.

    Args:
        data, trajectory: one log and the motion behind it; colour: of its noise.
    """
    out = []
    for begin, end, speed in steady(data, trajectory):
        mine = (data.weight > 0) & (data.time >= begin) & (data.time < end)
        if np.count_nonzero(mine) < FEWEST:
            continue
        load, load_sd = data.normal_force.at(data.time[mine]), data.load_sd_at(data.time[mine])
        coefficient = data.force[mine] / load
        level, independent = float(np.mean(coefficient)), max(coefficient.size / colour.memory, 1.0)
        scatter = float(np.std(coefficient, ddof=1)) / np.sqrt(independent)
        course = level * float(np.mean(np.sqrt(np.maximum(load_sd**2 - data.tremor_sd**2, 0.0)) / load))
        out.append(Level(level, float(np.hypot(scatter, course)), speed))
    return out


def steady(data: LogData, trajectory: ShootingTrajectory) -> list[tuple[float, float, float]]:
    """Begin [s], end [s] and speed [m/s] of every stretch of steady sliding; neighbours of one speed are one."""
    begins = [data.begin, *trajectory.until.tolist()]
    slides = [
        (begin, stretch.until, data.speed_at(0.5 * (begin + stretch.until)) if stretch.steady else None)
        for begin, stretch in zip(begins, trajectory.stretches, strict=False)
    ]
    out = []
    for speed, group in groupby(slides, key=lambda slide: slide[2]):
        spans = list(group)
        if speed is not None:
            out.append((spans[0][0], spans[-1][1], speed))
    return out


def first_of(words: Sequence[str], most: int) -> str:
    """Several things in words, no more than `most` of them by name."""
    return listed([*words[:most], f"{len(words) - most} more"] if len(words) > most else words)


RESOLVED = 12  # samples of a slip from which on its shape can be read
WANTED = 25  # samples of a slip to ask for
MOST_LEVELS = 6  # that are told one by one
SLOWER = "slower, with a softer spring or at a higher load"


@dataclass(frozen=True)
class Hint:
    """What stands beside a verdict other than identified: what the logs show, and what to do ("": as it says)."""

    shown: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.shown}: {self.remedy}" if self.remedy else self.shown


def hints(
    logs: Sequence[Prepared], trajectories: Sequence[ShootingTrajectory], unknowns: Unknowns, theta: np.ndarray
) -> dict[str, Hint]:
    """Per parameter, what stands beside a verdict other than identified.

    Args:
        logs, trajectories: the fitted logs and the motion behind them; theta (n_p,) the answer.
    """
    slipping = [(log, g) for log, g in zip(logs, trajectories, strict=True) if g.cycles]
    if not slipping:
        return _without_cycles(logs, trajectories, unknowns)
    logs, trajectories = [log for log, _ in slipping], [g for _, g in slipping]
    slips = [float(np.median(g.arrest - g.onset)) for g in trajectories]
    intervals = [log.data.interval for log in logs]
    samples = [slip / interval for slip, interval in zip(slips, intervals, strict=True)]
    sticks = np.concatenate([g.sticks for g in trajectories])
    speeds = sorted({log.data.drive_speed for log in logs})
    shape = _shape(samples, slips, speeds)
    out = {"a": shape, "delta_mu_k": shape, "D": shape, "mu_k0": shape, "mass": shape, "damping": shape}
    if "t_cr" in unknowns.names:
        t_cr = float(np.exp(theta[unknowns.names.index("t_cr")]))
        out["t_cr"] = _holds(sticks, t_cr)
        out["mu_s"] = _holds(sticks, t_cr)
    return out


def onsets(trajectories: Sequence[ShootingTrajectory]) -> int:
    """How many sticks end within these motions."""
    return sum(trajectory.ending("onset").size for trajectory in trajectories)


def untold(
    found: list[Estimate], trajectories: Sequence[ShootingTrajectory], told: Mapping[str, str]
) -> list[Estimate]:
    """The estimates without numbers for what no single peak can tell: how strong a contact gets, and how soon."""
    if onsets(trajectories) > 1:
        return found
    out = []
    for estimate in found:
        open_ = estimate.name in ("mu_s", "t_cr") and estimate.verdict in ("identified", "weak")
        out.append(
            Estimate(
                estimate.name,
                estimate.unit,
                estimate.value,
                None,
                None,
                None,
                "not identifiable",
                told.get(estimate.name, estimate.reason),
            )
            if open_
            else estimate
        )
    return out


def what_is_held(
    logs: Sequence[Prepared], trajectories: Sequence[ShootingTrajectory], colours: Sequence[Colour]
) -> str:
    """What logs hold of which none sticks, in a sentence; "" where one does, or none slides steadily.

    Args:
        colours: of the noise of each log.
    """
    if onsets(trajectories):
        return ""
    held = [
        levels(log.data, trajectory, noise) for log, trajectory, noise in zip(logs, trajectories, colours, strict=True)
    ]
    found = [(log.name, level) for log, of_log in zip(logs, held, strict=True) for level in of_log]
    if not found:
        return ""
    told = first_of([f"{level.words} ({name})" for name, level in found], MOST_LEVELS)
    if len({level.speed for _, level in found}) == 1:
        held_words = f"what these logs hold is the friction coefficient, {told}, and nothing else"
    else:
        steps = ", and how it follows a step of the speed" if any(len(of_log) > 1 for of_log in held) else ""
        held_words = f"what these logs hold is the friction coefficient at each speed, {told}{steps}"
    rests = any(g.rests_at_end or any(kind == "rest" for kind, _, _ in g.modes) for g in trajectories)
    slides = "sliding, with no stick that ends" if rests else "sliding throughout"
    return f"{slides}: {held_words}; add a log that sticks and slips ({SLOWER})"


def _without_cycles(
    logs: Sequence[Prepared], trajectories: Sequence[ShootingTrajectory], unknowns: Unknowns
) -> dict[str, Hint]:
    """Of logs that slide, or stick once: what they hold, and what would tell more."""
    sticks = onsets(trajectories)
    slides = [
        speed
        for log, trajectory in zip(logs, trajectories, strict=True)
        for _, _, speed in steady(log.data, trajectory)
    ]
    speeds = sorted(set(slides or [log.data.speed_at(log.data.end) for log in logs]))
    told = first_of([speed_text(speed, FIGURES) for speed in speeds], MOST_LEVELS)
    level = (
        f"a log that slides holds the friction level at its speed ({told}) and no more"
        if len(speeds) == 1
        else f"logs that slide hold the friction level at their speeds ({told}) and little more"
    )
    slower = f"add a log that sticks and slips: {SLOWER}"
    out = dict.fromkeys(("mu_k0", "delta_mu_k", "a"), Hint(level, f"{slower}, and logs that slide at other speeds"))
    out |= dict.fromkeys(("mu_s", "t_cr", "D"), Hint(level, slower))
    if sticks:
        peaks = "one stick shows" if sticks == 1 else f"{sticks} sticks show"
        hold = Hint(f"{peaks} the strength after those rests", "add holds that last a tenth and ten times as long")
        out |= {"mu_s": hold, "t_cr": hold, "D": Hint("the peaks hold too few samples", f"sample faster, or {slower}")}
    return {name: reason for name, reason in out.items() if name in unknowns.names}


def _shape(samples: Sequence[float], slips: Sequence[float], speeds: Sequence[float]) -> Hint:
    best = int(np.argmax(samples))
    if samples[best] < RESOLVED:
        rate = WANTED / min(slips)
        # With some samples more it may be the speeds as well: which of both, only a profile of other designs would say.
        faster = ", and add a faster log" if samples[best] > RESOLVED / 2 else ""
        return Hint(
            f"slips hold at most {samples[best]:.0f} samples, so their shape is not seen",
            f"sample at {round_up(rate):.0f} Hz or more{faster}",
        )
    if len(speeds) == 1:
        return Hint(
            f"one drive speed ({1e3 * speeds[0]:.3g} mm/s) shows one kind of slip",
            f"add a log at {1e3 * 10 * speeds[0]:.2g} mm/s or more, with {WANTED} samples per slip",
        )
    return Hint(f"the slips of these {len(speeds)} speeds are too alike", "add a faster log, or more cycles")


def _holds(sticks: np.ndarray, t_cr: float) -> Hint:
    if sticks.size == 0:
        return Hint("no stick between two slips was seen", "record several cycles")
    longest, shortest = float(np.max(sticks)), float(np.min(sticks))
    if shortest > 3 * t_cr:
        return Hint(
            f"every stick lasts {shortest:.2g} s or more, long enough to saturate the contact",
            "add a faster log, with sticks of a few tenths of that",
        )
    if longest < t_cr:
        return Hint(f"the longest stick is {longest:.2g} s, too short to saturate the contact", "add a slower log")
    return Hint("sticks of different length tell it", "add a slower and a faster log")


def round_up(rate: float) -> float:
    """The next sampling rate [Hz] that one would set."""
    return float(next(r for r in (100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 1e9) if r >= min(rate, 1e9)))
