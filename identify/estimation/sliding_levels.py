"""The friction of logs that slide: one coefficient for each stretch of steady sliding, at its own speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from identify.base.wording import speed_text
from identify.estimation.coloured import Colour
from identify.logs.log_data import Guess, LogData
from identify.prediction.wording import listed

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


def levels(data: LogData, guess: Guess, colour: Colour = WHITE) -> list[Level]:
    """The level of every stretch of steady sliding, in the order of the log.

    The error is the scatter about the level over the root of as many samples as its noise leaves independent, and how
    far the course of the normal force may be off; what that misses of fast rhythms is part of the scatter.

    Args:
        data, guess: one log and the motion behind it; colour: of its noise.
    """
    out = []
    for begin, end, speed in steady(data, guess):
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


def steady(data: LogData, guess: Guess) -> list[tuple[float, float, float]]:
    """Begin [s], end [s] and speed [m/s] of every stretch of steady sliding; neighbours of one speed are one."""
    begins = [float(guess.arrest[-1]) if guess.cycles else data.begin, *(stretch.until for stretch in guess.tail)]
    slides = [
        (begin, stretch.until, data.speed_at(0.5 * (begin + stretch.until)) if stretch.steady else None)
        for begin, stretch in zip(begins, guess.tail, strict=False)
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
