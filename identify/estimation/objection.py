"""How much data object to another place when their noise has a memory.

Least squares weigh every sample alike. Where neighbours err alike, slow noise takes after a curve that is off by the
same for a while, and the squares of a place that is as good may be larger, or smaller, by far more than they would be
for white noise: by how much depends on how slowly the curves of the two places part. A misspecified likelihood ratio
is judged by the variance that it has (Chandler and Bate, Biometrika 94, 2007: its adjustment along a direction).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identify.estimation.coloured import Colour

Array = NDArray[np.float64]

LEAST = 1e-9  # of a memory: noise that undoes itself at once is still noise


@dataclass(frozen=True)
class Change:
    """How far the curves of two places are apart in standard deviations: the sum of squares of it (moved), and the
    variance of the noise along it, times that (remembered)."""

    moved: float = 0.0
    remembered: float = 0.0

    def memory(self, loss: float) -> float:
        """By how much the memory of the noise widens what `loss` = 2 (cost there - cost here) may be by chance: 1 for
        white noise. What the loss has beyond the change of the curves is of priors, which remember nothing."""
        total = max(abs(loss), self.moved)
        return max(1.0 + (self.remembered - self.moved) / total, LEAST) if total > 0.0 else 1.0

    def objection(self, loss: float) -> float:
        """What the data object, as a loss in white noise."""
        return loss / self.memory(loss)


UNCHANGED = Change()


@dataclass(frozen=True)
class Remembering:
    """The noise of all logs: per log the weights of its samples (n,) 1/variance [1/N^2], its colour, and its variance
    over that of the weights."""

    weights: tuple[Array, ...]
    colours: tuple[Colour, ...]
    levels: tuple[float, ...]

    @property
    def white(self) -> bool:
        """Whether no noise has a memory."""
        return all(colour.white for colour in self.colours)

    def change(self, here: Sequence[Array], there: Sequence[Array]) -> Change:
        """How far the curves of two places are apart: per log (n,) [N], NaN where there is none."""
        if self.white:
            return UNCHANGED
        moved = remembered = 0.0
        for log, (before, after) in enumerate(zip(here, there, strict=True)):
            apart = (after - before) * self._roots[log]
            apart = np.where(np.isfinite(apart), apart, 0.0)
            squares = float(apart @ apart)
            moved += squares
            remembered += self.levels[log] * (squares if self.colours[log].white else self._along(log, apart))
        return Change(moved, remembered)

    def objection(self, here: Sequence[Array], there: Sequence[Array], loss: float) -> float:
        """What the data object to the curves of another place that costs them `loss` more, as a loss in white noise."""
        return self.change(here, there).objection(loss)

    def _along(self, log: int, apart: Array) -> float:
        seen = np.fft.rfft(apart, 2 * apart.size)  # padded: the end knows nothing of the beginning
        power = np.square(seen.real) + np.square(seen.imag)
        power[1:-1] *= 2.0
        return float(power @ self._spectra[log]) / (2 * apart.size)

    @cached_property
    def _roots(self) -> list[Array]:
        return [np.sqrt(weight) for weight in self.weights]

    @cached_property
    def _spectra(self) -> list[Array]:
        return [colour.spectrum(2 * weight.size) for weight, colour in zip(self.weights, self.colours, strict=True)]
