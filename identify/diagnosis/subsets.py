"""A walk through the subsets of effects, to the one that describes the logs best for its price.

What the logs plainly show is fitted at once. Then effects are added, left out, and exchanged for those that mimic them,
as long as the misfit with the price of the parameters (Schwarz) falls.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.progress import Progress
from identify.diagnosis.compared_models import ComparedModels
from identify.diagnosis.fitted import Fitted, fits, foretold
from identify.diagnosis.nested import fit_joined, fit_larger, fit_model, fit_shaken, fit_smaller, promise
from identify.diagnosis.selection_numbers import CONFUSED, ENOUGH, better, penalty, searched, statistic
from identify.diagnosis.selection_words import Gain
from identify.logs.prepare import Prepared
from identify.shooting.shooting_trajectory import ShootingTrajectory

# ----------------------------------------------------------------------------------------------------------------------
# Cycles kept back from a fit, and how well it predicts them.
# ----------------------------------------------------------------------------------------------------------------------

KEPT_BACK = 3  # every such cycle is kept back to be predicted
FEWEST = 4  # cycles of a log of which one can be kept back


def held_out_error(fitted: Fitted) -> float:
    """Mean square of the force residuals, in noise variances, of cycles kept back from a second solve; NaN without any.

    The dynamics and the cycles around carry the motion through a kept-back cycle; its samples do not count.
    """
    attempt = fitted.attempt
    if attempt is None or not np.isfinite(fitted.excess):
        return float("nan")
    masks = [_kept_back(log, g) for log, g in zip(attempt.fitted_logs, attempt.solved.trajectories, strict=True)]
    if not any(np.any(mask) for mask in masks):
        return float("nan")
    total, count = foretold(fitted, masks)
    return total / count if count else float("nan")


def _kept_back(log: Prepared, trajectory: ShootingTrajectory) -> NDArray[np.bool_]:
    """The samples of the cycles of a log that are kept back."""
    mask = np.zeros(log.data.time.size, bool)
    if trajectory.cycles < FEWEST:
        return mask
    for cycle in range(KEPT_BACK - 1, trajectory.cycles, KEPT_BACK):
        mask |= (log.data.time > trajectory.arrest[cycle - 1]) & (log.data.time <= trajectory.arrest[cycle])
    return mask


# What slips and sticks look alike under: each may stand where the other is true.
MIMICS = (
    ("contact_ageing", "velocity_weakening"),
    ("velocity_weakening", "direct_effect"),
    ("velocity_weakening", "sensor_lag"),
    ("direct_effect", "sensor_lag"),
    ("contact_ageing", "load_dependence"),
    ("contact_ageing", "direct_effect"),
    ("hysteresis_damping", "sensor_lag"),
    ("hysteresis_damping", "direct_effect"),
    ("hysteresis_damping", "load_dependence"),
    ("skin_compliance", "sensor_lag"),
    ("occlusion", "load_dependence"),
    ("velocity_weakening", "load_dependence"),
)
LAWS = {"velocity_weakening": "linear_weakening"}  # the simpler law in place of the other
PLAIN = 200.0  # a statistic so large that smaller company cannot make it small
PLAUSIBLE = 2.0  # statistic below which a smaller model is as good as it can be
PROMISING = 5.0  # statistic that one linear step must promise
TELLING = (2.0, 1000.0)  # statistics between which kept-back cycles are asked as well
CLEARER = 1.0  # by which another model must be better, if it has not fewer parameters
ROUNDS = 3  # of adding, exchanging and leaving out
LAST = ("contact_ageing",)  # what the start needs is asked once the others are settled


NO_TIME = "the time limit ended the comparison before it was asked whether the data need it: a longer --time-limit"


class _OutOfTimeError(Exception):
    """No other model is fitted."""


def _in_time() -> None:
    if time_is_up():
        raise _OutOfTimeError


class Selection:
    """A walk through the subsets of effects: `kept` is the best one so far, `best` its fit."""

    def __init__(self, models: ComparedModels, told: Progress) -> None:
        self._models, self._told = models, told
        self.kept: list[str] = []
        self.gains: dict[str, Gain] = {}
        self.notes: dict[str, str] = {}
        self._statistics: dict[str, float] = {}  # of the effects kept, at the last model that had them
        self._firm = False  # whether other starts are tried
        self.unfinished = False  # whether the time was up before
        self._found: dict[tuple[frozenset[str], tuple[int, ...]], Fitted] = {}  # what they led to, by effects and logs
        self._nearby: dict[frozenset[str], Fitted] = {}  # fitted from the best one, by effects
        self._alone: dict[frozenset[str], Fitted] = {}  # fitted from the data alone

    def run(self, sure: Sequence[str]) -> None:
        """Walk from what the logs plainly show to the best subset, or as far as the time suffices."""
        try:
            self._walk(sure)
        except _OutOfTimeError:
            self.unfinished = True
            for effect in (e for e in self._models.asked if e not in self.gains):
                self.notes.setdefault(effect, NO_TIME)

    def _walk(self, sure: Sequence[str]) -> None:
        self._begin(list(sure))
        self._toggle()
        self._rounds()
        for _ in range(ROUNDS if self.best.model.vibrates else 0):
            before = set(self.kept)
            self._shake()
            self._rounds()
            if set(self.kept) == before:
                break
        self._held_out()
        self._simpler_laws()

    def _rounds(self) -> None:
        for _ in range(ROUNDS):
            before = set(self.kept), self.best.logs
            self._add()
            self._exchange()
            self._leave_out()
            self._join()
            if (set(self.kept), self.best.logs) == before:
                break

    def _shake(self) -> None:
        """Look for the best answer of the model: the walk went by the motion of the models before it. From here on
        those that lack an effect are looked for as well as this one."""
        self._told("from other starts", 0.7)
        self._firm = True
        other = self._shaken(self.kept, self.best)
        if other.excess < self.best.excess:
            self._statistics = {}
            self._move(self.kept, other)
        self._nearby = {}
        self._bend()

    def _bend(self) -> None:
        """Take in what has no parameters of its own, beside the others or in the place of one that mimics it, if other
        starts show that it describes the data better: it bends all the others, so that the motion of the model without
        it tells nothing of what it gains."""
        for effect in (e for e in self._models.asked if e not in self.kept):
            kept = [*self.kept, effect]
            if self._models.searched(kept) > self._models.searched(self.kept):
                continue
            mimics = {e for pair in MIMICS if effect in pair for e in pair} - {effect}
            for some in (kept, *([e for e in kept if e != mimic] for mimic in self.kept if mimic in mimics)):
                other = self._shaken(some, self._from_best(some))
                if better(other, self.best) > self._least(other):
                    self._move(some, other)

    def _shaken(self, kept: Sequence[str], fitted: Fitted) -> Fitted:
        """The best answer that other starts lead to; looked for once per model, as long as the same logs take part."""
        _in_time()
        key = frozenset(kept), fitted.logs
        known = self._found.get(key)
        if known is None or fitted.excess < known.excess:
            known = self._found[key] = fit_shaken(fitted, self.best) if known is None else fitted
        return known

    def _begin(self, sure: list[str]) -> None:
        self._told("fitting all that plainly matters", 0.1)
        self.kept, self.best = sure, fit_model(self._models.of(sure), self._models.records)
        for kept in self._beside(sure):
            if fits(self.best):
                return
            self._told(f"fitting {', '.join(kept)}", 0.2)
            other = self._from_data(kept)
            if _says_more(other, self.best):
                self.kept, self.best = kept, other

    def _beside(self, sure: list[str]) -> Iterator[list[str]]:
        """Where else to begin if what is plain misfits: an effect that is not there, or one that is missed, takes the
        others with it; an ageing that is not there has its best values nowhere."""
        for effect in (*LAST, *CONFUSED):
            if effect in sure:
                yield [e for e in sure if e != effect]
        for effect in self._models.asked:
            if effect not in sure:
                yield [*sure, effect]

    def _toggle(self) -> None:
        """Leave out what has no parameters of its own and does harm: it would bend all that is tried after it."""
        for effect in list(self.kept):
            if searched(self.best, effect):
                continue
            _in_time()
            other = fit_larger(self.best, self._models.of([e for e in self.kept if e != effect]), self._models.records)
            if other.searched == self.best.searched and better(other, self.best) > CLEARER:
                self.gains[effect] = Gain(statistic(self.best, other), 0.0, float("nan"))
                self._move([e for e in self.kept if e != effect], other)

    def _add(self) -> None:
        """Add the effect that gains most beyond its price, again and again."""
        rest = [e for e in self._models.asked if e not in self.kept]
        while rest:
            self._told(f"with {', '.join(rest)}", 0.3)
            fitted = {}
            for effect in rest:
                _in_time()
                kept = [*self.kept, effect]
                hope = promise(self.best, self._models.of(kept), self._models.records)
                self.gains[effect] = Gain(max(hope, 0.0), ENOUGH, float("nan"))
                if not hope < PROMISING:
                    fitted[effect] = self._from_best(kept)
            for effect, found in fitted.items():
                self.gains[effect] = Gain(statistic(found, self.best), penalty(found, self.best), float("nan"))
            worth = {e: self.gains[e].statistic - self.gains[e].penalty for e in fitted}
            strongest = max(worth, key=lambda e: worth[e], default="")
            if not worth.get(strongest, 0.0) > 0.0:
                return
            self._move([*self.kept, strongest], fitted[strongest])
            rest.remove(strongest)
            self._join()

    def _join(self) -> None:
        """Let logs join that took no part: their motion may not be that of a model which lacks an effect, or has one
        too many."""
        _in_time()
        joined = fit_joined(self.best)
        if joined is not self.best:
            self._told("with all logs", 0.4)
            self._statistics = {}
            self._move(self.kept, joined)

    def _exchange(self) -> None:
        """Put an effect in the place of one that mimics it, while that makes a better model."""
        tried: set[tuple[str, str]] = set()
        for pair in MIMICS:
            for out, into in (pair, pair[::-1]):
                if out not in self.kept or into in self.kept or into not in self._models.asked or (out, into) in tried:
                    continue
                tried.add((out, into))
                self._told(f"{into} in the place of {out}", 0.5)
                kept = [e for e in self.kept if e != out] + [into]
                other = self._from_best(kept)
                if other.attempt is None:  # the motion of the one is none of the other
                    other = self._from_data(kept)
                if self._firm and not better(other, self.best) > CLEARER and statistic(self.best, other) < PLAIN:
                    other = self._shaken(kept, other)
                if better(other, self.best) > self._least(other):
                    self.gains[out] = Gain(0.0, ENOUGH, float("nan"))
                    self._move(kept, other)

    def _least(self, other: Fitted) -> float:
        """By how much another model must be better than the best one to stand in its place."""
        return CLEARER if other.searched >= self.best.searched else 0.0

    def _leave_out(self) -> None:
        """Leave out what is not worth its parameters, until all that stays is."""
        last = False
        while True:
            doubtful = [e for e in self.kept if self._statistics.get(e, 0.0) < PLAIN and (e not in LAST or last)]
            smaller = {e: self._without([e]) for e in doubtful}
            self._statistics |= {e: statistic(self.best, f) for e, f in smaller.items()}
            prices = {e: penalty(self.best, f) for e, f in smaller.items()}
            self.gains |= {e: Gain(self._statistics[e], prices[e], float("nan")) for e in doubtful}
            losers = [e for e in doubtful if self._statistics[e] < prices[e]]
            if not losers and last:
                return
            if not losers:
                last = True
                continue
            together = self._without(losers) if len(losers) > 1 else smaller[losers[0]]
            if statistic(self.best, together) >= sum(prices[e] for e in losers):
                losers = [max(losers, key=lambda e: better(smaller[e], self.best))]
                together = smaller[losers[0]]
            self._ask_held_out(losers, together)
            self._move([e for e in self.kept if e not in losers], together)

    def _without(self, losers: Sequence[str]) -> Fitted:
        """The best model without some of its effects; fitted once."""
        kept = [e for e in self.kept if e not in losers]
        if (key := frozenset(kept)) not in self._nearby:
            _in_time()
            self._told(f"without {', '.join(losers)}", 0.6)
            fitted = fit_smaller(self.best, self._models.of(kept), self._models.records)
            if self._firm and fitted.attempt is not None and PLAUSIBLE < statistic(self.best, fitted) < PLAIN:
                fitted = self._shaken(kept, fitted)
            self._nearby[key] = fitted
        return self._nearby[key]

    def _from_best(self, kept: Sequence[str]) -> Fitted:
        """Another model from the motion of the best one; fitted once."""
        if (key := frozenset(kept)) not in self._nearby:
            _in_time()
            self._nearby[key] = fit_larger(self.best, self._models.of(kept), self._models.records)
        return self._nearby[key]

    def _from_data(self, kept: Sequence[str]) -> Fitted:
        """Another model from the data alone; fitted once."""
        if (key := frozenset(kept)) not in self._alone:
            _in_time()
            self._alone[key] = self._models.simulated(kept)
        return self._alone[key]

    def _move(self, kept: list[str], fitted: Fitted) -> None:
        """Go on from another subset; what was plain there and has a mimic may not be here."""
        changed, mimics = set(kept) ^ set(self.kept), {effect for pair in MIMICS for effect in pair}
        if changed & mimics:
            self._statistics = {e: s for e, s in self._statistics.items() if e not in mimics}
        self.kept, self.best, self._nearby = kept, fitted, {}

    def _ask_held_out(self, effects: Sequence[str], smaller: Fitted) -> None:
        if not any(self._statistics[e] > TELLING[0] for e in effects):
            return
        growth = _growth(self.best, smaller)
        self.gains |= {e: replace(self.gains[e], held_out=growth) for e in effects}

    def _held_out(self) -> None:
        """Of what stays: by how much worse kept-back cycles are predicted without it."""
        for effect in self.kept:
            if self._statistics.get(effect, np.inf) < TELLING[1]:
                self._ask_held_out([effect], self._without([effect]))

    def _simpler_laws(self) -> None:
        """Interchangeable laws: the one that describes the data best, with its parameters paid for."""
        for law, simpler in LAWS.items():
            if law not in self.kept:
                continue
            kept = [simpler if e == law else e for e in self.kept]
            other = self._from_best(kept)
            if not np.isfinite(other.excess):  # the motion under the one is none under the other
                other = self._from_data(kept)
            loss = statistic(self.best, other)
            if better(other, self.best) > 0.0:
                self.notes[law] = f"{simpler} says the same with fewer parameters (it loses {loss:.3g})"
                self.notes[simpler] = f"it says the same as {law} with fewer parameters (it loses {loss:.3g})"
                self.kept, self.best = kept, other
            else:
                self.notes[simpler] = f"{law} describes the data better, by {loss:.3g}"


def _says_more(other: Fitted, than: Fitted) -> bool:
    """Whether another first model is the better one to go on from, that of the smaller misfit per sample: not all of
    them have the same logs."""
    return other.excess / max(other.samples, 1) < than.excess / max(than.samples, 1)


def _growth(larger: Fitted, smaller: Fitted) -> float:
    """By which factor the error on kept-back cycles grows in the smaller model; NaN where that is not known."""
    without = held_out_error(smaller)
    if not np.isfinite(without):
        return without
    held = held_out_error(larger)
    return without / held if held > 0.0 else float("nan")
