"""Where on the data a rest ends: at the peak of the measured force, at its steepest fall, or where it is expected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.guess import LogData

Array = NDArray[np.float64]

REACH = 4.0  # half periods by which an onset is moved at most around what the data or the simulation say
PER_HALF_PERIOD = 12  # places per half period that are tried
PEAK = 0.5  # of a rest: how far from its simulated end the peak is looked for
COMPARED = 400  # samples that vote on a place
FEWEST = 3  # samples that have a highest one


@dataclass(frozen=True)
class Wave:
    """The simulated force (k,) [N] at times (k,) [s] after an onset, and its slope before it [N/s]."""

    time: Array
    force: Array
    slope: float

    def at(self, after: Array) -> Array:
        """The force (n,) at times (n,) after the onset, negative ones before it."""
        return np.where(after < 0.0, self.force[0] + self.slope * after, np.interp(after, self.time, self.force))

    @property
    def length(self) -> float:
        """How long it is known after the onset [s]."""
        return float(self.time[-1])

    @property
    def peak(self) -> float:
        """When after the onset it is highest [s]."""
        return float(self.time[int(np.argmax(self.force))])


@dataclass(frozen=True)
class DataSide:
    """A log as rests are looked for in it. half: half period of the rig [s]; changes of the drive in the window [s]."""

    log: LogData
    half: float
    changes: tuple[float, ...]

    def change_after(self, t: float) -> float:
        """The next change of the drive, or the end of the window [s]."""
        return next((c for c in self.changes if c > t), self.log.end)

    def placed(self, since: float, onset: float, wave: Wave) -> float:
        """Where on the data the wave of a slide that is expected from `onset` on fits best; after `since` [s]."""
        log = self.log
        reach = max(REACH * self.half, 2.0 * log.interval)
        step = max(self.half / PER_HALF_PERIOD, 0.25 * log.interval)
        centres = self.centres(since, onset, wave, reach)
        around = np.arange(-reach, reach, step)
        places = np.unique(np.concatenate([centre + around for centre in centres]))
        latest = self.change_after(since) - 1e-3 * self.half
        places = places[(places > since + 1e-3 * self.half) & (places < latest)]
        if places.size == 0:
            return onset
        costs = np.full(places.size, np.inf)
        for centre in centres:
            inside = np.abs(places - centre) <= reach
            first, last = np.searchsorted(log.time, [centre - reach - self.half, centre + reach + wave.length])
            index = np.arange(first, last, max((last - first) // COMPARED, 1))
            # The simulated wave knows nothing of another speed of the drive.
            index = index[(log.weight[index] > 0) & (log.time[index] > since) & (log.time[index] < latest)]
            if index.size < 2:
                continue
            t, f, w = log.time[index], log.force[index], log.weight[index]
            for i in np.flatnonzero(inside):
                after = t - places[i]
                counted = after < wave.length
                misfit = float(np.sum(w[counted] * (f - wave.at(after))[counted] ** 2))
                costs[i] = min(costs[i], misfit / max(counted.sum(), 1))
        return float(places[int(np.argmin(costs))]) if np.any(np.isfinite(costs)) else onset

    def centres(self, since: float, onset: float, wave: Wave, reach: float) -> list[float]:
        """What an onset is looked for around [s]."""
        used = self._used(since, min(onset + PEAK * (onset - since) + 2 * self.half, self.change_after(since)))
        found = [onset, (onset if used.size < FEWEST else self._highest(used)) - wave.peak]
        # Where a rest rises by less than the noise from sample to sample, its highest one lies anywhere near its end.
        fall = self._steepest_fall(used)
        if fall is not None and min(abs(fall - centre) for centre in found) > reach:
            found.append(fall)
        return found

    def first_peak(self, moving: float) -> float:
        """When the smoothed force is highest from where the drive moves until its speed changes [s]."""
        used = self._used(moving, self.change_after(moving))
        return self.log.begin if used.size < FEWEST else self._highest(used)

    def _highest(self, used: NDArray[np.intp]) -> float:
        width = max(min(int(0.2 * self.half / self.log.interval), used.size // 3), 1)
        smooth = np.convolve(self.log.force[used], np.ones(width) / width, mode="same")
        return float(self.log.time[used[int(np.argmax(smooth))]])

    def _steepest_fall(self, used: NDArray[np.intp]) -> float | None:
        """Where the force falls most from one half period to the next [s]; None where there are not two."""
        width = max(round(self.half / self.log.interval), 1)
        if used.size < 2 * width:
            return None
        sums = np.concatenate([[0.0], np.cumsum(self.log.force[used])])
        means = sums[width:] - sums[:-width]
        return float(self.log.time[used[width - 1 + int(np.argmax(means[:-width] - means[width:]))]])

    def _used(self, begin: float, end: float) -> NDArray[np.intp]:
        """Samples between two times [s] that count."""
        first, last = np.searchsorted(self.log.time, [begin, end])
        return np.flatnonzero(self.log.weight[first:last] > 0) + first
