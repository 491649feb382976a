"""Where the residuals of neighbouring samples lean to one side.

A wrong answer can keep the sum of squares of a long cycle within its noise and still miss a slip altogether, by a few
standard deviations of many neighbouring samples. Sums over windows of all lengths show that: noise cancels in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_io.thinned import thinned
from identify.base.quantiles import normal
from identify.logs.log_data import LogData
from identify.logs.zigzag import running_means

Array = NDArray[np.float64]

LONGEST = 512  # samples of a window
CHANCE = 1e-7  # that noise leans so far somewhere in a log
QUARTILE = normal(0.75)
ENOUGH = 1 << 12  # sums that tell their spread: to 3 %
OVERLAP = 8  # windows of one length that share a sample; about the one that leans most all are asked


@dataclass(frozen=True)
class Lean:
    """The window of a log that leans most: its mean time [s] and length [s], the mean residual [N], by how many
    standard deviations, and the number of them that noise reaches by chance."""

    log: int
    time: float
    length: float
    residual: float
    deviations: float
    limit: float

    @property
    def share(self) -> float:
        """Deviations over the limit."""
        return self.deviations / self.limit


def most_leaning(logs: Sequence[LogData], fitted: Sequence[Array]) -> Lean | None:
    """The window of all logs that stands out most; None where nothing is fitted.

    The spread of the sums themselves counts as noise where it is larger than white noise allows: noise with a memory
    does not lean.

    Args:
        fitted: (n,) force at the samples of each log [N], NaN where none is fitted.
    """
    found = [lean for i, (log, curve) in enumerate(zip(logs, fitted, strict=True)) for lean in _of_log(i, log, curve)]
    return max(found, key=lambda lean: lean.share, default=None)


def _of_log(number: int, log: LogData, fitted: Array) -> list[Lean]:
    """The most leaning window of each length."""
    good = (log.weight > 0) & np.isfinite(fitted)
    first, stop = int(np.argmax(good)), good.size - int(np.argmax(good[::-1]))
    told = slice(first, stop) if good[first:stop].all() else good  # a slice copies nothing
    time, residual = log.time[told], log.force[told] - fitted[told]
    weight = log.weight[told]
    even = residual.size and weight.min() == weight.max()  # as a rule: a million roots take their time
    scaled = residual * np.sqrt(weight[0] if even else weight)
    lengths = [2**i for i in range(1, int(np.log2(LONGEST)) + 1) if 8 * 2**i <= residual.size]
    out, sums, step = [], scaled, 1
    for width in lengths:
        half = width // 2 // step
        sums = sums[:-half] + sums[half:]
        if width > OVERLAP * step:
            sums, step = sums[::2], 2 * step
        few = thinned(sums, ENOUGH)
        quarter = few.size // 4
        ordered = np.partition(few, (quarter, few.size - 1 - quarter))
        span = float(ordered[few.size - 1 - quarter] - ordered[quarter])  # np.quantile takes four times as long
        spread = max(1.0, 0.5 * span / np.sqrt(width) / QUARTILE)
        ends = (int(np.argmin(sums)), int(np.argmax(sums)))
        about = step * max(ends, key=lambda end: abs(float(sums[end])))
        begin = max(about - step + 1, 0)
        around = np.abs(running_means(scaled[begin : about + step - 1 + width], width)) * np.sqrt(width)
        first = begin + int(np.argmax(around))
        limit = -normal(0.5 * CHANCE / (residual.size * len(lengths)))
        window = slice(first, first + width)
        length = float(time[first + width - 1] - time[first])
        mean = float(np.mean(residual[window]))
        out.append(Lean(number, float(np.mean(time[window])), length, mean, float(np.max(around)) / spread, limit))
    return out
