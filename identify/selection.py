"""effects = "auto" with logs: which effects the data call for, and what each one gains.

From the general to the particular: everything the logs give reason to try is fitted at once; then the effect whose
loss costs least is left out, again and again, until every one that stays is worth its parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from data_io import Record
from identify.choice import Choice, Reason
from identify.effects import ALL
from identify.nested import Fitted, fit_larger, fit_model, fit_smaller, held_out_error, promise, scene_with
from identify.prepare import prepare
from identify.price import price
from identify.scene import Scene
from identify.screening import Screen, screen
from identify.unknowns import from_scene

Progress = Callable[[str, float | None], None]

ALWAYS = ("inertia",)
LOOKED_AT = (*ALWAYS, "hysteresis_damping", "contact_ageing", "velocity_weakening", "varying_normal_force")
ENOUGH = 25.0  # an effect that gains more than this is never dropped
PLAIN = 200.0  # a statistic so large that smaller company cannot make it small
PROMISING = 5.0  # statistic that one linear step must promise
TELLING = (2.0, 1000.0)  # statistics between which kept-back cycles are asked as well
MISFIT = 3.0  # standard deviations of the sum of squares that are still noise
LAST = ("contact_ageing",)  # what the start needs is asked once the others are settled
RIVALS = {"velocity_weakening": ("linear_weakening",)}
UNASKED = {
    "driven_damping": "a damping at a given frequency acts like the one at the natural frequency: list it by name",
    "power_law": "a law measured on wet smooth glass: list it by name",
    "pressure_dependence": "the same as load_dependence where only the load varies: list it by name",
    "force_sensor": "gain and offset of the load cell cannot be told from friction: calibrate, then list it by name",
    "sensor_second_lag": "a second stage of the load cell: list it by name",
    "friction_heterogeneity": "cycles that differ are described by the simulation, not by the fit",
}


@dataclass(frozen=True)
class Gain:
    """What an effect gains on the data: likelihood-ratio statistic, penalty of its parameters, growth of the error on
    kept-back cycles without it."""

    statistic: float
    penalty: float
    held_out: float


def choose_from_data(scene: Scene, records: Sequence[Record], progress: Progress | None = None) -> Choice:
    """The effects that the logs of a scene call for, each with its reason.

    Args:
        scene: its effects are to be chosen ("auto"); records: its logs, in their order.

    Raises:
        FitError: a log of which nothing is left.
        SceneError: what the scene says does not go together.
    """
    told: Progress = progress or (lambda _stage, _share: None)
    told("looking at the logs", 0.0)
    first = scene_with(scene, LOOKED_AT, {})
    unknowns = from_scene(first)
    looks = screen([prepare(first, e, r, unknowns) for e, r in zip(first.logs, records, strict=True)])
    starts = {name: value for look in looks if look.asked for name, value in look.starts}
    asked = [look.effect for look in looks if look.asked]
    vague = [look.effect for look in looks if look.asked and not look.sure]

    def scene_of(effects: Sequence[str]) -> Scene:
        return scene_with(scene, [e.name for e in ALL if e.name in (*ALWAYS, *effects)], starts)

    told("fitting all that may matter", 0.1)
    kept = [e for e in asked if e not in vague]
    best = fit_model(scene_of(kept), records)
    if not _fits(best):
        # An ageing that is not there has its best values nowhere, and takes the others with it.
        settled = [e for e in kept if e not in LAST]
        plain_friction = fit_model(scene_of(settled), records, thorough=False)
        if plain_friction.excess < best.excess:
            kept, best = settled, plain_friction
    gains: dict[str, Gain] = {}
    while vague:
        told(f"with {', '.join(vague)}", 0.2)
        hopes = {e: promise(best, scene_of([*kept, e]), records) for e in vague}
        gains |= {e: Gain(max(hope, 0.0), ENOUGH, float("nan")) for e, hope in hopes.items()}
        larger = {e: fit_larger(best, scene_of([*kept, e]), records) for e in vague if not hopes[e] < PROMISING}
        worth = {e: _statistic(f, best) - _penalty(f, best) for e, f in larger.items()}
        gains |= {e: Gain(_statistic(f, best), _penalty(f, best), float("nan")) for e, f in larger.items()}
        strongest = max(worth, key=lambda e: worth[e], default="")
        if not worth.get(strongest, 0.0) > 0.0:
            break
        kept, best = [*kept, strongest], larger[strongest]
        vague.remove(strongest)

    def without(larger: Fitted, kept: Sequence[str], losers: Sequence[str]) -> Fitted:
        told(f"without {', '.join(losers)}", 0.2 + 0.6 * (1 - len(kept) / max(len(asked), 1)))
        return fit_smaller(larger, scene_of([e for e in kept if e not in losers]), records)

    asked_last = False
    known: dict[str, Fitted] = {}  # those of the same larger model
    plain: dict[str, float] = {}  # statistics so far: what was plain once is not asked again
    while True:
        doubtful = [e for e in kept if plain.get(e, 0.0) < PLAIN and (e not in LAST or asked_last)]
        smaller = {e: known.get(e) or without(best, kept, [e]) for e in doubtful}
        known = smaller
        plain |= {e: _statistic(best, f) for e, f in smaller.items()}
        losers = [e for e in doubtful if plain[e] < _penalty(best, smaller[e])]
        if not losers and asked_last:
            break
        if not losers:
            asked_last = True
            continue
        together = without(best, kept, losers) if len(losers) > 1 else smaller[losers[0]]
        if _statistic(best, together) >= sum(_penalty(best, smaller[e]) for e in losers):
            losers = [min(losers, key=lambda e: plain[e] - _penalty(best, smaller[e]))]
            together = smaller[losers[0]]
        doubt = any(plain[e] > TELLING[0] for e in losers)
        held = _growth(best, together) if doubt else float("nan")
        gains |= {e: Gain(plain[e], _penalty(best, smaller[e]), held) for e in losers}
        kept, best, known = [e for e in kept if e not in losers], together, {}
    for effect in kept:
        last = smaller.get(effect) if effect in smaller else None
        if last is None and plain.get(effect, 0.0) < PLAIN:
            last = without(best, kept, [effect])
            plain[effect] = _statistic(best, last)
        asked_back = last is not None and plain[effect] < TELLING[1]
        held = _growth(best, last) if asked_back and last is not None else float("nan")
        penalty = ENOUGH if last is None else _penalty(best, last)
        gains[effect] = Gain(plain[effect], penalty, held)
    kept, best, notes = _law(best, kept, scene_of, records)
    effects = tuple(e.name for e in ALL if e.name in (*ALWAYS, *kept))
    return Choice(effects, tuple(_reasons(best, looks, kept, gains, notes)))


def _fits(fitted: Fitted) -> bool:
    """Whether the misfit is about noise."""
    if fitted.attempt is None:
        return False
    return bool(fitted.excess < MISFIT * np.sqrt(2.0 * fitted.attempt.solved.problem.samples))


def _statistic(larger: Fitted, smaller: Fitted) -> float:
    """Likelihood-ratio statistic of the larger model; an estimated or wrong noise level is taken out."""
    if larger.attempt is None:
        return 0.0 if smaller.attempt is None else -np.inf
    samples = larger.attempt.solved.problem.samples
    noise = max(1.0, 1.0 + larger.excess / samples) if np.isfinite(larger.excess) else 1.0
    return float((smaller.excess - larger.excess) / noise) if np.isfinite(larger.excess) else -np.inf


def _penalty(larger: Fitted, smaller: Fitted) -> float:
    """What the parameters of an effect must gain at least (Schwarz); never more than ENOUGH."""
    if larger.attempt is None:
        return ENOUGH
    more = max(larger.searched - smaller.searched, 1)
    return float(min(more * np.log(larger.attempt.solved.problem.samples), ENOUGH))


def _growth(larger: Fitted, smaller: Fitted) -> float:
    """By which factor the error on kept-back cycles grows in the smaller model; NaN where that is not known."""
    without = held_out_error(smaller)
    if not np.isfinite(without):
        return without
    held = held_out_error(larger)
    return without / held if held > 0.0 else float("nan")


def _law(
    best: Fitted, kept: list[str], scene_of: Callable[[Sequence[str]], Scene], records: Sequence[Record]
) -> tuple[list[str], Fitted, dict[str, str]]:
    """Interchangeable laws: the one that describes the data best, with its parameters paid for."""
    notes: dict[str, str] = {}
    for law, rivals in RIVALS.items():
        for rival in rivals if law in kept else ():
            other = fit_model(scene_of([rival if e == law else e for e in kept]), records, thorough=False)
            loss = _statistic(best, other)
            saved = (
                (best.searched - other.searched) * np.log(max(best.attempt.solved.problem.samples, 2))
                if best.attempt
                else 0.0
            )
            if loss < saved:
                notes[law] = f"{rival} says the same with fewer parameters (it loses {loss:.3g})"
                notes[rival] = f"it says the same as {law} with fewer parameters (it loses {loss:.3g})"
                kept, best = [rival if e == law else e for e in kept], other
            else:
                notes[rival] = f"{law} describes the data better, by {loss:.3g}"
    return kept, best, notes


def _reasons(
    best: Fitted, looks: Sequence[Screen], kept: Sequence[str], gains: dict[str, Gain], notes: dict[str, str]
) -> list[Reason]:
    by_name = {look.effect: look for look in looks}
    out = []
    for effect in ALL:
        name = effect.name
        stays = name in (*ALWAYS, *kept)
        cost = price(name, best.model.effects)
        if name in ALWAYS:
            out.append(Reason(name, True, "the equation of motion of a stick-slip record needs it", cost=cost))
        elif name in notes:
            out.append(Reason(name, stays, notes[name], cost=cost))
        elif name in by_name and by_name[name].asked:
            gain = gains.get(name)
            said = f"{by_name[name].sentence}; {_said(gain, stays)}"
            statistic = None if gain is None or not np.isfinite(gain.statistic) else gain.statistic
            held = None if gain is None or not np.isfinite(gain.held_out) else gain.held_out
            out.append(Reason(name, stays, said, cost=cost, statistic=statistic, held_out=held))
        elif name in by_name:
            out.append(Reason(name, stays, by_name[name].sentence, cost=cost))
        else:
            out.append(Reason(name, stays, UNASKED.get(name, "a law that nothing calls for"), cost=cost))
    return out


def _said(gain: Gain | None, stays: bool) -> str:
    if gain is None:
        return "it was tried"
    if not np.isfinite(gain.statistic):
        return "without it no start describes the data" if stays else "it gains nothing"
    verdict = "worth" if stays else "not worth"
    said = (
        f"the fit gains {max(gain.statistic, 0.0):.3g} where its parameters ask for {gain.penalty:.3g}: {verdict} them"
    )
    if np.isfinite(gain.held_out):
        said += f"; without it cycles kept back are predicted with {gain.held_out:.3g} times the error"
    return said
