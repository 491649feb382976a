"""effects = "auto" with logs: forward by what an effect promises to gain, backward by the Schwarz criterion.

What the logs plainly show is fitted first. The effect whose addition promises the largest fall of the cost is fitted
and stays if it pays for its parameters; then every effect that stays is left out in turn, or exchanged for one that it
may stand in for, as long as the criterion falls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.base.budget import time_is_up
from identify.base.progress import Notice, Progress, to_nobody
from identify.diagnosis.choice import Choice, EffectReason, Screen, price, screen
from identify.diagnosis.compared_models import ALWAYS, ComparedModels
from identify.diagnosis.fitted import Fitted, fits
from identify.diagnosis.nested import fit_larger, fit_model, fit_smaller, promise
from identify.diagnosis.quantities import EFFECTS, held_quantities
from identify.diagnosis.score_test import score_table
from identify.diagnosis.selection_numbers import better, penalty, statistic
from identify.effects import ALL
from identify.estimation.known_early import prefit_warnings, wrong_unit
from identify.estimation.search import alike
from identify.logs.prepare import Prepared
from identify.logs.prepared_scene import prepare_scene
from identify.logs.rhythms import SpectralLine, rhythms
from identify.scene import Scene
from identify.scene.variant import scene_with

Array = NDArray[np.float64]

# What slips and sticks look alike under: each may stand where the other is true.
MIMICS = (
    ("contact_ageing", "velocity_weakening"),
    ("velocity_weakening", "direct_effect"),
    ("velocity_weakening", "sensor_lag"),
    ("velocity_weakening", "linear_weakening"),
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
CLEARER = 1.0  # by which another model must be better, if it has not fewer parameters
PLAIN = 200.0  # a statistic that no mimic has
ROUNDS = 4  # of adding, exchanging and leaving out
LOOKED_AT = (*ALWAYS, "hysteresis_damping", "contact_ageing", "velocity_weakening", "varying_normal_force")
NO_TIME = "the time limit ended the comparison before it was asked whether the data need it: a longer --time-limit"
NOT_COMPARED = "not compared: cycles differ so among themselves, or from the rig, that no sum of squares tells which"
UNASKED = {
    "driven_damping": "a damping at a given frequency acts like the one at the natural frequency: list it by name",
    "power_law": "a law measured on wet smooth glass: list it by name",
    "pressure_dependence": "the same as load_dependence where only the load varies: list it by name",
    "force_sensor": "gain and offset of the load cell cannot be told from friction: calibrate, then list it by name",
    "sensor_second_lag": "a second stage of the load cell: list it by name",
    "friction_heterogeneity": "cycles that differ are described by the simulation, not by the fit",
}


def choose_from_data(scene: Scene, records: Sequence[Record], progress: Progress | None = None) -> Choice:
    """The effects that the logs of a scene call for, each with its reason.

    Args:
        scene: its effects are to be chosen ("auto"); records: its logs, in their order.

    Raises:
        FitError: a log of which nothing is left.
        SceneError: what the scene says does not go together.
    """
    report = progress or to_nobody
    report("looking at the logs", 0.0)
    prepared = prepare_scene(scene_with(scene, LOOKED_AT, {}), records).logs
    for sentence in prefit_warnings(prepared):
        report(Notice(sentence), 0.0)
    if wrong_unit(prepared) or not alike([log for log in prepared if log.left_out is None]):
        notes = {effect.name: NOT_COMPARED for effect in ALL if effect.name not in ALWAYS}
        return _choice([e for e in LOOKED_AT if e not in ALWAYS], (), {}, notes)
    lines, left = rhythms(prepared)
    looks = screen(prepared, lines)
    asked = tuple(look.effect for look in looks if look.asked)
    starts = {name: value for look in looks if look.asked for name, value in look.starts}
    scene = with_one_noise(scene, prepared, lines, left)
    walk = _Walk(ComparedModels(scene, tuple(records), asked, starts), report)
    finished = walk.run([look.effect for look in looks if look.asked and look.sure])
    notes = {} if finished else {e: NO_TIME for e in asked if e not in walk.gains}
    return replace(_choice(walk.kept, looks, walk.gains, notes), unfinished=not finished)


class _Walk:
    """From what the logs plainly show to the effects that pay: those kept, their fit, and per effect what it gains and
    what its parameters ask for."""

    def __init__(self, models: ComparedModels, report: Progress) -> None:
        self._models, self._report = models, report
        self.kept: list[str] = []
        self.gains: dict[str, tuple[float, float]] = {}

    def run(self, sure: Sequence[str]) -> bool:
        """Whether the time sufficed."""
        self._report("fitting all that plainly matters", 0.1)
        self.kept, self.best = list(sure), fit_model(self._models.of(sure), self._models.records)
        self._begin_elsewhere()
        for _ in range(ROUNDS):
            before = set(self.kept)
            self._add()
            self._leave_out()
            self._exchange()
            if time_is_up():
                return False
            if set(self.kept) == before:
                return True
        return True

    def _begin_elsewhere(self) -> None:
        """Where what is plain misfits, one effect less or more: one that is not there takes the others with it."""
        sure, asked = list(self.kept), self._models.asked
        others = [[e for e in sure if e != less] for less in sure]
        others += [[*sure, more] for more in asked if more not in sure]
        for kept in others:
            if fits(self.best) or time_is_up():
                return
            self._report(f"fitting {', '.join(kept)}", 0.2)
            other = fit_model(self._models.of(kept), self._models.records, thorough=False)
            if other.excess / max(other.samples, 1) < self.best.excess / max(self.best.samples, 1):
                self.kept, self.best = kept, other

    def _add(self) -> None:
        """Fit the effects in the order of what they promise; the first that pays is taken in, and the rest asked
        anew."""
        rest = [e for e in self._models.asked if e not in self.kept]
        while rest and not time_is_up():
            self._report(f"with {', '.join(rest)}", 0.3)
            models = {e: self._models.of([*self.kept, e]) for e in rest}
            scored = _scores(self.best)
            hopes = {e: scored.get(e) or promise(self.best, models[e], self._models.records) for e in rest}
            # What no few iterations tell comes last.
            for effect in sorted(rest, key=lambda e: -hopes[e] if np.isfinite(hopes[e]) else 0.0):
                least = float(np.log(max(self.best.samples, 2)))
                self.gains[effect] = (max(hopes[effect], 0.0), least)
                if not hopes[effect] > least or time_is_up():
                    return
                other = fit_larger(self.best, models[effect], self._models.records)
                self.gains[effect] = (statistic(other, self.best), penalty(other, self.best))
                if better(other, self.best) > 0.0:
                    self.kept, self.best = [*self.kept, effect], other
                    rest.remove(effect)
                    break
            else:
                return

    def _exchange(self) -> None:
        """Put an effect in the place of one that it may stand in for, where that makes a better model."""
        for out, into in (pair for both in MIMICS for pair in (both, both[::-1])):
            if out not in self.kept or into in self.kept or time_is_up():
                continue
            if self.gains.get(out, (0.0, 0.0))[0] > PLAIN:
                continue
            if into not in self._models.asked and into != "linear_weakening":
                continue
            kept = [into if e == out else e for e in self.kept]
            self._report(f"{into} in the place of {out}", 0.5)
            other = fit_larger(self.best, self._models.of(kept), self._models.records)
            least = CLEARER if other.searched >= self.best.searched else 0.0
            if better(other, self.best) > least:
                self.gains[out] = (0.0, penalty(self.best, other))
                self.kept, self.best = kept, other

    def _leave_out(self) -> None:
        """Leave out what does not pay, the one that pays least first, until all that stays does."""
        while not time_is_up():
            smaller: dict[str, Fitted] = {}
            for effect in self.kept:
                self._report(f"without {effect}", 0.6)
                rest = [e for e in self.kept if e != effect]
                models = self._models.of(rest)
                smaller[effect] = fit_smaller(self.best, models, self._models.records, thorough=False)
                self.gains[effect] = (statistic(self.best, smaller[effect]), penalty(self.best, smaller[effect]))
                if time_is_up():
                    return
            losers = [e for e in self.kept if self.gains[e][0] < self.gains[e][1]]
            if not losers:
                return
            worst = max(losers, key=lambda e: better(smaller[e], self.best))
            self.kept, self.best = [e for e in self.kept if e != worst], smaller[worst]


def _scores(fitted: Fitted) -> dict[str, float]:
    """The scores of the effects that are a column of the score test, at a fit that lacks them."""
    if fitted.attempt is None:
        return {}
    try:
        table = score_table(fitted.attempt.solved, held_quantities(fitted.attempt, fitted.unknowns))
    except np.linalg.LinAlgError:
        return {}
    of_all = {one.column.name: one for one in table.scores if one.log is None}
    out = {effect: of_all[name].score for name, (effect, _) in EFFECTS.items() if name in of_all}
    softer = of_all.get("stiffness")
    if softer is not None and softer.step < 0.0:
        out["skin_compliance"] = softer.score
    return out


def with_one_noise(scene: Scene, prepared: Sequence[Prepared], lines: Sequence[SpectralLine], left: Array) -> Scene:
    """The scene with the noise of logs whose sticks swing said once for all models: what is estimated from the sticks
    counts the swings in where a model lacks them, and no two sums could be compared.

    Args:
        lines, left: the rhythms of the sticks, and per log the share of that variance that they leave.
    """
    if not lines or len(prepared) != len(scene.logs):
        return scene
    logs = [
        replace(entry, noise=float(log.data.noise * np.sqrt(share))) if log.noise_estimated and share < 1.0 else entry
        for entry, log, share in zip(scene.logs, prepared, left, strict=True)
    ]
    return replace(scene, logs=tuple(logs))


# ----------------------------------------------------------------------------------------------------------------------
# One reason per effect, in the order of their table.
# ----------------------------------------------------------------------------------------------------------------------


def _choice(
    kept: Sequence[str],
    looks: Sequence[Screen],
    gains: dict[str, tuple[float, float]],
    notes: dict[str, str],
) -> Choice:
    effects = tuple(e.name for e in ALL if e.name in (*ALWAYS, *kept))
    by_name = {look.effect: look for look in looks}
    out = []
    for name in (effect.name for effect in ALL):
        stays, cost, look = name in effects, price(name, effects), by_name.get(name)
        gain = gains.get(name)
        if name in ALWAYS:
            sentence = "the equation of motion of a stick-slip record needs it"
        elif name in notes:
            sentence = notes[name]
        elif look is not None and look.asked:
            sentence = f"{look.sentence}; {_said(gain, stays=stays)}"
        elif gain is not None:
            sentence = _said(gain, stays=stays)
        elif look is not None:
            sentence = look.sentence
        else:
            sentence = UNASKED.get(name, "a law that nothing calls for")
        number = None if gain is None or not np.isfinite(gain[0]) else gain[0]
        out.append(EffectReason(name, stays, sentence, cost=cost, statistic=number))
    return Choice(effects, tuple(out))


def _said(gain: tuple[float, float] | None, *, stays: bool) -> str:
    if gain is None:
        return "it was tried"
    if not np.isfinite(gain[0]):
        return "without it no start describes the data" if stays else "it gains nothing"
    verdict = "worth" if stays else "not worth"
    return f"the fit gains {max(gain[0], 0.0):.3g} where its parameters ask for {gain[1]:.3g}: {verdict} them"
