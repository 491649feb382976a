"""What a scene cuts and corrects of one log, and the account of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_io import LogError, Record
from data_io.correct import Change, Corrected, Corrections, Cut, correct
from data_io.record import zero_of_times
from identify.base.errors import FitError
from identify.scene.values import LogEntry

FEWEST = 8  # samples of a log that can be looked at at all


@dataclass(frozen=True)
class Account:
    """What was cut and corrected, line by line, and the stretches of the record that this left out; raw: the record as
    it was read."""

    changes: tuple[Change, ...]
    cuts: tuple[Cut, ...]
    raw: Record

    def document(self) -> Mapping[str, Any]:
        """As plain values, SI."""
        return {
            "corrections": [asdict(change) for change in self.changes],
            "cuts": [asdict(cut) for cut in self.cuts],
        }


def cut_and_correct(entry: LogEntry, record: Record) -> Corrected:
    """The record as the scene wants it.

    Raises:
        FitError: an interval without samples, or strokes that the record does not have.
    """
    wanted = Corrections(entry.tare, entry.normal_tare, entry.crosstalk, entry.tilt, entry.window, entry.exclude)
    try:
        return correct(record, wanted)
    except LogError as error:
        raise FitError(str(error)) from None


def refuse_too_few(entry: LogEntry, record: Record, used: NDArray[np.bool_], name: str) -> None:
    """Refuse a log of which hardly a sample is left; what took them away decides the remedy.

    Args:
        used: (n,) the samples that may count. name: of the log, in sentences.

    Raises:
        FitError: a window outside the log or too narrow, too much excluded, or a log that is that short.
    """
    left = int(np.count_nonzero(used))
    if left >= FEWEST:
        return
    time, end = record.time, float(record.time[-1])
    start, stop = entry.window or (0.0, end)
    inside = int(np.count_nonzero((time >= start) & (time <= stop)))
    if inside < FEWEST <= time.size:
        remedy = "widen it" if start >= 0.0 and stop <= end else "move the window inside"
        raise FitError(
            f"{name}: the window {start:g} to {stop:g} s holds {inside} row(s); the log runs from 0 to {end:.6g} s"
            f"{zero_of_times(record)}; {remedy}"
        )
    if entry.exclude and inside >= FEWEST:
        raise FitError(f"{name}: exclude leaves {left} of {inside} samples; expected hundreds: exclude less")
    raise FitError(f"{name} has {left} usable samples; expected hundreds: record longer, or sample faster")


def account(entry: LogEntry, raw: Record, corrected: Corrected, sign: int, first: float, begin: float) -> Account:
    """The account of a log, with what `prepare` found itself.

    Args:
        sign: applied to the friction force.
        first: time of the first sample that counts; begin: where the fit begins [s].
    """
    changes, cuts = list(corrected.changes), list(corrected.cuts)
    if sign < 0:
        why = "as given" if entry.flip_sign is not None else "it slides with a negative force"
        changes.append(Change("flip_sign", f"the friction force was turned over: {why}"))
    if begin > first:
        cycles = "cycle" if entry.skip_cycles == 1 else f"{entry.skip_cycles} cycles"
        text = f"the first {cycles} left out as given: the fit begins at {begin:.4g} s"
        if not entry.skip_cycles:
            text = f"the fit begins at {begin:.4g} s, where the first straight line of a stick does"
        changes.append(Change("skip_cycles" if entry.skip_cycles else "lead", text, begin, "s"))
        cuts.append(Cut("skip_cycles" if entry.skip_cycles else "lead", first, begin))
    return Account(tuple(changes), tuple(cuts), raw)
