"""Where on the data a rest ends: at the peak of the measured force, at its steepest fall, or where it is expected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.logs.local_fits import line_slope, slope_error
from identify.logs.log_data import LogData

Array = NDArray[np.float64]

REACH = 4.0  # half periods by which an onset is moved at most around what the data or the simulation say
PER_HALF_PERIOD = 12  # places per half period that are tried
PEAK = 0.5  # of a rest: how far from its simulated end the peak is looked for
COMPARED = 400  # samples that vote on a place
BY_CHANCE = 12.0  # squared deviations by which noise makes one of some hundred places the best
FEWEST = 3  # samples that have a highest one
BINS, RISEN = 50, 0.8  # means up to the first peak, and share of its height that is reached on the way for sure
LEVEL, SURE = 0.25, 3.0  # of the slope of a stick, and standard errors: a force that rises less is no stick


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

    def placed(self, since: float, onset: float, wave: Wave, spread: float = np.inf) -> float:
        """Where on the data the wave of a slide that is expected from `onset` on fits best; after `since` [s]. Where
        nothing fits better than by chance it stays where it is expected.

        Args:
            spread: how far off the expected onset may be, one standard deviation [s]; infinite: the data alone say.
        """
        log, by_chance = self.log, BY_CHANCE if np.isinf(spread) else 0.0
        reach = max(REACH * self.half, 2.0 * log.interval)
        step = max(self.half / PER_HALF_PERIOD, 0.25 * log.interval)
        centres = self.centres(since, onset, wave, reach)
        around = np.arange(-reach, reach, step)
        latest = self.change_after(since) - 1e-3 * self.half
        best, lowest, least = onset, np.inf, np.inf
        for centre in centres:
            first, last = np.searchsorted(log.time, [centre - reach - self.half, centre + reach + wave.length])
            index = np.arange(first, last, max((last - first) // COMPARED, 1))
            # The simulated wave knows nothing of another speed of the drive.
            index = index[(log.weight[index] > 0) & (log.time[index] > since) & (log.time[index] < latest)]
            if index.size < 2:
                continue
            if centre == onset:
                least = self._misfit(index, onset, wave) - by_chance / index.size
            places = centre + around
            for place in places[(places > since + 1e-3 * self.half) & (places < latest)].tolist():
                misfit = self._misfit(index, place, wave) + ((place - onset) / spread) ** 2 / index.size
                if misfit < lowest:
                    best, lowest = place, misfit
        return best if lowest < least else onset

    def _misfit(self, index: NDArray[np.intp], place: float, wave: Wave) -> float:
        """Mean square of what some samples lie off the wave of a slide from `place` [s] on, over the noise."""
        after = self.log.time[index] - place
        counted = after < wave.length
        if not counted.any():
            return np.inf
        chosen = index[counted]
        return float(np.mean(self.log.weight[chosen] * (self.log.force[chosen] - wave.at(after[counted])) ** 2))

    def centres(self, since: float, onset: float, wave: Wave, reach: float) -> list[float]:
        """What an onset is looked for around [s]."""
        used = self._used(since, min(onset + PEAK * (onset - since) + 2 * self.half, self.change_after(since)))
        found = [onset, (onset if used.size < FEWEST else self._highest(used)) - wave.peak]
        # Where a rest rises by less than the noise from sample to sample, its highest one lies anywhere near its end.
        fall = self._steepest_fall(used)
        if fall is not None and min(abs(fall - centre) for centre in found) > reach:
            found.append(fall)
        return [c for c in found if all(self._may_rest(other, c, wave.slope) for other in found if other < c)]

    def _may_rest(self, begin: float, end: float, slope: float) -> bool:
        """Whether the force between two times [s] may belong to a stick that loads at `slope` [N/s]: of a level force
        the highest sample lies anywhere."""
        used = self._used(begin, end)
        if used.size < FEWEST or any(begin < change < end for change in self.changes):
            return True
        t = self.log.time[used]
        least = LEVEL * slope - SURE * slope_error(t, self.log.noise)
        return line_slope(t, self.log.force[used], self.log.noise) > least

    def first_peak(self, moving: float) -> float:
        """When the smoothed force is highest from where the drive moves until its speed changes [s]."""
        used = self._used(moving, self.change_after(moving))
        return self.log.begin if used.size < FEWEST else self._highest(used)

    def first_rise(self, peak: float) -> float:
        """Until when the force rises without doubt towards its first peak [s]: not on a level that ends there."""
        used = self._used(self.log.begin, peak)
        if used.size < 2 * BINS:
            return self.log.begin + RISEN * (peak - self.log.begin)
        per = used.size // BINS
        means = self.log.force[used[: per * BINS]].reshape(BINS, per).mean(axis=1)
        high = means >= means[0] + RISEN * (means.max() - means[0])
        return float(self.log.time[used[per * max(int(np.argmax(high)), 1)]])

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
