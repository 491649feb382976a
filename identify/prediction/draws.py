"""Intervals of answers under a covariance: draws of operating points, and the quantiles of their answers.

Directions that the covariance leaves open are not drawn along. The point is moved along each of them instead, as far
as it may well be off: what moves with it is open, and what does not keeps its interval.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from identify.base.result import Number
from identify.model.model import Model
from identify.prediction.axes import Site, admissible
from identify.prediction.windows import QUANTILES
from identify.prediction.wording import OPEN, listed

Array = NDArray[np.float64]

DRAWS = 400
LEAST_DRAWS = 40  # that have an answer, for an interval
WIDEST = 3.0  # standard deviation of a direction, in sizes of its parameters, beyond which it is open
HALVINGS = 12  # of a move by that much along an open direction, until it is one that a pair can have
NOTICED = 1e-2  # share of an answer that such a move may change without opening its interval
NAMED = 0.3  # component of a direction, of the largest, from which a parameter is named
POINT = ("drive_speed", "normal_force")  # what a covariance may name beside the parameters; positive


@dataclass(frozen=True)
class Draws:
    """An operating point, draws of it, and the point moved both ways along every open direction.

    settings (1 + n + 2 d, n_w): parameters in the model's order, normal force [N], drive speed [m/s], of the point, of
    n draws, and for each of the d open directions of the point moved forwards and back. refused: draws that no pair can
    have (kinetic friction lost, or above the static). open: parameters of each open direction.
    """

    model: Model
    settings: Array
    count: int
    refused: int
    open: tuple[tuple[str, ...], ...]

    @property
    def uncertain(self) -> bool:
        """Whether there are any."""
        return len(self.settings) > 1

    @staticmethod
    def of(site: Site, count: int = DRAWS, seed: int = 0) -> Draws:
        """So many draws of an operating point with a covariance, none of one without.

        What is searched by its logarithm (speed and load too) is drawn in it, the rest in its value.
        """
        model, names = site.model, site.names
        if site.covariance is None or not names:
            return Draws(model, site.setting[None], 0, 0, ())
        places = [(*model.parameter_names, *reversed(POINT)).index(name) for name in names]
        centre = site.setting[places]
        by_log = np.array([name in POINT or model.parameter(name).scale == "log" for name in names]) & (centre > 0.0)
        spreads = [0.0 if name in POINT else model.parameter(name).spread for name in names]
        sizes = np.where(by_log, np.abs(centre), np.maximum(np.abs(centre), spreads))
        sizes = np.where(sizes > 0.0, sizes, 1.0)
        scaled = np.asarray(site.covariance, float) / np.outer(sizes, sizes)
        known = np.isfinite(np.diag(scaled)) & (np.diag(scaled) >= 0.0)
        known &= np.all(np.isfinite(scaled) | ~(known[:, None] & known), axis=0)
        scaled = np.where(np.outer(known, known), scaled, 0.0)
        variances, directions = np.linalg.eigh(0.5 * (scaled + scaled.T))
        sd = np.sqrt(np.maximum(variances, 0.0))
        open_ = [*directions.T[sd >= WIDEST], *np.eye(len(names))[~known]]

        def settings_of(steps: Array) -> Array:
            settings = np.tile(site.setting, (len(steps), 1))
            settings[:, places] = np.where(
                by_log, centre * np.exp(np.where(by_log, steps, 0.0)), centre + sizes * steps
            )
            return settings

        # A shifted additive recurrence with the generalised golden ratio (Roberts 2018): quantiles settle on far fewer
        # of its points than of independent ones.
        ratio, shift = 1.5, np.random.default_rng(seed).uniform(size=len(names))
        for _ in range(60):
            ratio = (1.0 + ratio) ** (1.0 / (len(names) + 1))
        uniform = (shift + np.arange(1.0, count + 1.0)[:, None] * ratio ** -np.arange(1.0, len(names) + 1.0)) % 1.0
        steps = ndtri(np.clip(uniform, 1e-12, 1.0 - 1e-12)) @ (directions * np.where(sd < WIDEST, sd, 0.0)).T
        drawn = settings_of(steps)
        drawn = drawn[admissible(model, drawn)]
        probes = WIDEST * np.array([sign * each for each in open_ for sign in (1.0, -1.0)]).reshape(-1, len(names))
        for _ in range(HALVINGS):
            probes = np.where(admissible(model, settings_of(probes))[:, None], probes, 0.5 * probes)
        blamed = tuple(
            tuple(n for n, part in zip(names, np.abs(each), strict=True) if part > NAMED * np.max(np.abs(each)))
            for each in open_
        )
        settings = np.concatenate([site.setting[None], drawn, settings_of(probes)])
        return Draws(model, settings, len(drawn), count - len(drawn), blamed)

    def column(self, name: str) -> Array:
        """Values (1 + n + 2 d,) of a parameter, "normal_force" or "drive_speed"."""
        return self.settings[:, (*self.model.parameter_names, *reversed(POINT)).index(name)]

    def number(self, answers: Array, unit: str, validity: str, size: float = 0.0) -> Number:
        """The answer at the point itself, the first of those of all rows (1 + n + 2 d,), NaN where one has none; with
        the interval between the outer quantiles of the draws. size: what an answer near zero is measured by."""
        value, drawn, moved = float(answers[0]), *np.split(answers[1:], [self.count])
        if not np.isfinite(value) or np.all(answers[1:] == answers[-1]):
            return Number(value if np.isfinite(value) else None, unit, None, validity)
        moves = np.any(~(np.abs(moved.reshape(-1, 2) - value) <= NOTICED * max(abs(value), size)), axis=1)
        named = dict.fromkeys(name for each, moving in zip(self.open, moves, strict=True) if moving for name in each)
        finite, total = drawn[np.isfinite(drawn)], self.count + self.refused
        reason = f"{listed([*named])}, on which it depends, is not identifiable here" if named else ""
        if not named and finite.size < min(LEAST_DRAWS, total):
            reason = f"only {finite.size} of {total} draws have an answer"
        if reason:
            return Number(value, unit, (None, None), validity, f"{OPEN}{reason}")
        low, high = np.quantile(finite, QUANTILES).tolist()
        return Number(value, unit, (low, high), validity)
