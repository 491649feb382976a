"""One model and smaller ones inside it, fitted to the same logs: what each effect gains on the data.

A smaller model starts from the motion of the larger one, and where that fails from the data alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.attempt import Attempt, Clock, judged, solve_from, solve_slowly, usable
from identify.guess import Guess
from identify.joining import join
from identify.model import Model
from identify.outcome import Status
from identify.parting import parted
from identify.passes import Solved, solve_in_passes
from identify.prepare import Prepared, prepare
from identify.scene import Scene
from identify.scene.parameters import default_spec
from identify.search import Sources, alike, search
from identify.shaken import shaken
from identify.shooting import transcribe
from identify.solve import solve
from identify.unknowns import Unknowns, from_scene
from identify.vibration import tuned

Array = NDArray[np.float64]

MISFIT = 3.0  # standard deviations of the sum of squares that are still noise
FAR = 0.5  # sum of squares per sample (in noise variances) above that of the larger model: look for a better start
DOUBT = 5.0  # sum of squares above that of the larger model: under a vibrating drive it may be another course of slips
HOPELESS = 1000.0  # half statistic beyond which a smaller model is not followed further
GLANCE = 8  # iterations that show whether an effect is worth a fit
CLOSED = 1e-2  # largest row of a trajectory that hangs together well enough for that
KEPT_BACK = 3  # every such cycle is kept back to be predicted
FEWEST = 4  # cycles of a log of which one can be kept back


@dataclass(frozen=True)
class Fitted:
    """One model on the data: its scene, search space and prepared logs; the attempt (None where nothing could be
    tried); excess: the sum of squares in noise variances less the number of samples (infinite without an answer)."""

    scene: Scene
    unknowns: Unknowns
    prepared: tuple[Prepared, ...]
    attempt: Attempt | None
    excess: float

    @property
    def model(self) -> Model:
        """The composed model."""
        return self.unknowns.model

    @property
    def samples(self) -> int:
        """Number of samples that count in the attempt; 0 without one."""
        return 0 if self.attempt is None else self.attempt.solved.problem.samples

    @property
    def logs(self) -> tuple[int, ...]:
        """Which logs took part."""
        return () if self.attempt is None else self.attempt.logs

    @property
    def complete(self) -> bool:
        """Whether all logs that can be used took part."""
        return set(self.logs) >= set(usable(list(self.prepared)))

    @property
    def searched(self) -> int:
        """Number of free parameters, with those every log has for itself."""
        logs = len(self.attempt.logs) if self.attempt is not None else len(self.prepared)
        return int(np.count_nonzero(self.unknowns.free)) + (logs - 1) * int(np.count_nonzero(self.unknowns.own))


def as_it_ended(scene: Scene, unknowns: Unknowns, prepared: Sequence[Prepared], attempt: Attempt | None) -> Fitted:
    """A fit as it ended, whether the solver succeeded or not."""
    excess = np.inf if attempt is None else 2.0 * attempt.solved.solution.cost - attempt.solved.problem.samples
    return Fitted(scene, unknowns, tuple(prepared), attempt, float(excess))


def fit_model(scene: Scene, records: Sequence[Record], *, thorough: bool = True, sources: Sources = "data") -> Fitted:
    """Fit one scene to its records.

    Args:
        thorough: where the first start fails, try many.
        sources: starts from the data, from the values of the scene, or both.
    """
    prepared, unknowns = _prepared(scene, records)
    attempt, _ = search(prepared, unknowns, thorough=False, sources=sources)
    failed = attempt is not None and not attempt.solved.solution.success
    # Unlike cycles leave no other start to try.
    more = attempt is None or (failed and alike([prepared[i] for i in usable(prepared)]))
    if thorough and more:
        attempt, _ = search(prepared, unknowns, sources=sources)
    return Fitted(scene, unknowns, tuple(prepared), attempt, _excess(attempt))


def fit_larger(smaller: Fitted, scene: Scene, records: Sequence[Record]) -> Fitted:
    """Fit a model with one effect more, or another one in its place, from the motion of the smaller one; where that
    misfits, also from its parameters alone: the motion of a misfit can hold back what would describe the data."""
    prepared, unknowns = _prepared(scene, records)
    hopeless = np.inf if smaller.attempt is None else smaller.attempt.solved.solution.cost + HOPELESS
    warm = _warm(smaller, prepared, unknowns, hopeless)
    best = Fitted(scene, unknowns, tuple(prepared), warm, _excess(warm))
    if smaller.attempt is None or fits(smaller) or fits(best):
        return best
    return _better(best, _placed_anew(smaller, scene, prepared, unknowns), smaller)


def fit_joined(fitted: Fitted) -> Fitted:
    """The same model with the logs that took no part so far, where they can join at its answer."""
    attempt, able = fitted.attempt, usable(list(fitted.prepared))
    if attempt is None or fitted.complete:
        return fitted
    late = [i for i in able if i not in attempt.logs]
    joined = join(attempt, list(fitted.prepared), late, fitted.unknowns, Clock())
    return fitted if joined is attempt else replace(fitted, attempt=joined, excess=_excess(joined))


def fit_shaken(fitted: Fitted, around: Fitted | None = None) -> Fitted:
    """The same model at the best answer that other starts lead to; around: a model whose values are a start where
    there is no answer yet."""
    if fitted.attempt is None:
        return fitted
    theta = None if around is None or around.attempt is None else _values_of(around, fitted.unknowns)
    best = shaken(fitted.attempt, fitted.prepared, fitted.unknowns, around=theta)
    return fitted if best is fitted.attempt else replace(fitted, attempt=best, excess=_excess(best))


def _prepared(scene: Scene, records: Sequence[Record]) -> tuple[list[Prepared], Unknowns]:
    scene, records = parted(scene, records)
    unknowns = from_scene(scene)
    logs = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, records, strict=True)]
    return tuned(logs, unknowns)


def _excess(attempt: Attempt | None) -> float:
    return np.inf if attempt is None else attempt.excess


def fits(fitted: Fitted) -> bool:
    """Whether the misfit is about noise."""
    if fitted.attempt is None:
        return False
    return bool(fitted.excess < MISFIT * np.sqrt(2.0 * fitted.samples))


def described(fitted: Fitted) -> bool:
    """Whether the misfit is about noise, one with a memory too."""
    accepted = fitted.attempt is not None and fitted.attempt.gate.status is Status.CONVERGED
    return accepted or fits(fitted)


def fit_smaller(larger: Fitted, scene: Scene, records: Sequence[Record]) -> Fitted:
    """Fit a model that lacks an effect of a larger one: from the larger one's motion, else from the data."""
    prepared, unknowns = _prepared(scene, records)
    hopeless = np.inf if larger.attempt is None else larger.attempt.solved.solution.cost + HOPELESS
    warm = _warm(larger, prepared, unknowns, hopeless)
    best = Fitted(scene, unknowns, tuple(prepared), warm, _excess(warm))
    if larger.attempt is not None and unknowns.model.vibrates and best.excess > larger.excess + DOUBT:
        best = _better(best, _placed_anew(larger, scene, prepared, unknowns), larger)
    samples = larger.attempt.solved.problem.samples if larger.attempt is not None else 1
    if best.excess - larger.excess < FAR * samples:
        return best
    attempt, _ = search(prepared, unknowns, thorough=False)
    return _better(best, Fitted(scene, unknowns, tuple(prepared), attempt, _excess(attempt)), larger)


def _better(best: Fitted, other: Fitted, beside: Fitted) -> Fitted:
    """The other fit where its misfit is smaller and it has all the logs of the model it is compared with."""
    complete = other.attempt is not None and (beside.attempt is None or other.attempt.logs == beside.attempt.logs)
    return other if complete and other.excess < best.excess else best


def _warm(other: Fitted, prepared: list[Prepared], unknowns: Unknowns, hopeless: float = np.inf) -> Attempt | None:
    """A model solved from the motion of another one; None where its states do not allow that."""
    known, small, large = other.attempt, unknowns.model, other.model
    if known is None or (small.clamped is None and large.clamped is not None):
        return None
    logs, guesses, unknowns = _taken_over(other, prepared, unknowns)
    try:
        solved = solve_in_passes([log.data for log in logs], guesses, unknowns.softened(), hopeless=hopeless)
    except (ValueError, FloatingPointError):
        return None
    return replace(known, prepared=tuple(logs), solved=solved)


def fit_beside(other: Fitted, scene: Scene, records: Sequence[Record]) -> Fitted:
    """Fit a model from the motion of another one, and from its parameters alone; the better one, judged by itself."""
    prepared, unknowns = _prepared(scene, records)
    best = _placed_anew(other, scene, prepared, unknowns)
    warm = _warm(other, prepared, unknowns)
    if warm is not None and (best.attempt is None or warm.excess < best.excess):
        return Fitted(scene, unknowns, tuple(prepared), judged(warm), warm.excess)
    return best


def fit_from_values(other: Fitted, scene: Scene, records: Sequence[Record], *, slowly: bool = False) -> Fitted:
    """Fit a model from the parameters of another one, its motion placed anew on the data.

    Args:
        slowly: with priors around these parameters that are let go of in small steps.
    """
    return _placed_anew(other, scene, *_prepared(scene, records), slowly=slowly)


def _placed_anew(
    other: Fitted, scene: Scene, prepared: list[Prepared], unknowns: Unknowns, *, slowly: bool = False
) -> Fitted:
    at_values = replace(unknowns, start=_values_of(other, unknowns))
    attempt = (solve_slowly if slowly else solve_from)(prepared, usable(prepared), at_values, Clock())
    return Fitted(scene, unknowns, tuple(prepared), attempt, _excess(attempt))


def _values_of(other: Fitted, unknowns: Unknowns) -> Array:
    """The start of a model (n_p,) with what another one searched where that ended."""
    assert other.attempt is not None
    names = other.model.parameter_names
    theta = dict(zip(names, other.attempt.solved.theta.tolist(), strict=True))
    searched = dict(zip(names, other.unknowns.free.tolist(), strict=True))
    start = np.array([theta[n] if searched.get(n) else unknowns.start[i] for i, n in enumerate(unknowns.names)])
    return np.clip(np.where(unknowns.free, start, unknowns.start), unknowns.lower, unknowns.upper)


def _taken_over(
    other: Fitted, prepared: Sequence[Prepared], unknowns: Unknowns
) -> tuple[list[Prepared], list[Guess], Unknowns]:
    """Logs, motion and start of a model as another one left them."""
    known, small, large = other.attempt, unknowns.model, other.model
    assert known is not None
    start = _values_of(other, unknowns)
    logs = [
        replace(prepared[i], data=replace(prepared[i].data, begin=cut.data.begin, end=cut.data.end))
        for i, cut in zip(known.logs, known.prepared, strict=True)
    ]
    guesses = [
        _translated(g, large, small, large_p)
        for g, large_p in zip(
            known.solved.guesses,
            (
                other.unknowns.values(g.theta(known.solved.theta), log.data.base)
                for g, log in zip(known.solved.guesses, known.prepared, strict=True)
            ),
            strict=True,
        )
    ]
    return logs, guesses, replace(unknowns, start=start)


def promise(smaller: Fitted, scene: Scene, records: Sequence[Record]) -> float:
    """About the statistic that one more effect would gain on the data: a few iterations, on the solution's grid."""
    if smaller.attempt is None:
        return np.inf
    prepared, unknowns = _prepared(scene, records)
    solved = smaller.attempt.solved
    logs, guesses, unknowns = _taken_over(smaller, prepared, unknowns)
    problem = transcribe([log.data for log in logs], guesses, unknowns.softened(), solved.grid)
    tried = solve(problem, tolerance=1e-3, barrier=1e-6, iterations=GLANCE)
    return 2.0 * (solved.solution.cost - tried.cost) if tried.infeasibility < CLOSED else np.inf


def _translated(guess: Guess, large: Model, small: Model, p: Array) -> Guess:
    """The motion in the states of another model; a load cell that did not lag shows what its lag would.

    Args:
        p: parameters (n_p,) of the model the motion is from.
    """
    names = [s.name for s in large.states]
    lags = [i for i, s in enumerate(small.states) if s.unit == "N" and s.name not in names]

    def states(x: Array) -> Array:
        out = np.stack(
            [x[..., names.index(s.name)] if s.name in names else 0.0 * x[..., 0] + s.start for s in small.states],
            axis=-1,
        )
        if lags and x.size:
            flat = x.reshape(-1, x.shape[-1])
            u = np.tile([0.0, 1.0, 1.0, 0.0], (flat.shape[0], 1))
            shown = np.array(large.load(flat.T, np.repeat(p[:, None], flat.shape[0], axis=1), u.T)).reshape(
                x.shape[:-1]
            )
            out[..., lags] = shown[..., None]
        for name in set(names) - {s.name for s in small.states}:
            if name == large.series_state:
                out[..., 0] -= x[..., names.index(name)]
        return out

    own = guess.own
    if own.size:
        at = [large.parameter_names.index(n) if n in large.parameter_names else -1 for n in small.parameter_names]
        own = np.where(np.array(at) >= 0, own[at], np.nan)
    return replace(
        guess,
        start=states(guess.start),
        slip=states(guess.slip),
        saturated=states(guess.saturated),
        own=own,
        tail=tuple(replace(stretch, nodes=states(stretch.nodes)) for stretch in guess.tail),
    )


def held_out_error(fitted: Fitted) -> float:
    """Mean square of the force residuals, in noise variances, of cycles kept back from a second solve; NaN without any.

    The dynamics and the cycles around carry the motion through a kept-back cycle; its samples do not count.
    """
    attempt = fitted.attempt
    if attempt is None or not np.isfinite(fitted.excess):
        return float("nan")
    masks = [_kept_back(log, g) for log, g in zip(attempt.prepared, attempt.solved.guesses, strict=True)]
    if not any(np.any(mask) for mask in masks):
        return float("nan")
    data = [
        replace(log.data, weight=np.where(mask, 0.0, log.data.weight))
        for log, mask in zip(attempt.prepared, masks, strict=True)
    ]
    start = replace(fitted.unknowns, start=attempt.solved.theta).softened()
    solved: Solved = solve_in_passes(data, attempt.solved.guesses, start)
    if not solved.solution.success:
        return float("inf")
    total, count = 0.0, 0
    for log, mask, force in zip(attempt.prepared, masks, solved.fitted, strict=True):
        inside = mask & np.isfinite(force) & (log.data.weight > 0)
        total += float(np.sum(log.data.weight[inside] * (log.data.force[inside] - force[inside]) ** 2))
        count += int(np.count_nonzero(inside))
    return total / count if count else float("nan")


def _kept_back(log: Prepared, guess: Guess) -> NDArray[np.bool_]:
    """The samples of the cycles of a log that are kept back."""
    mask = np.zeros(log.data.time.size, bool)
    if guess.cycles < FEWEST:
        return mask
    for cycle in range(KEPT_BACK - 1, guess.cycles, KEPT_BACK):
        mask |= (log.data.time > guess.arrest[cycle - 1]) & (log.data.time <= guess.arrest[cycle])
    return mask


def scene_with(scene: Scene, effects: Sequence[str], starts: Mapping[str, float]) -> Scene:
    """The scene with these effects, its parameters started where something is known of them.

    What the scene itself says of a parameter stands.

    Raises:
        SceneError: effects that do not go together.
    """
    made = scene.with_effects(tuple(effects))
    parameters = dict(made.parameters)
    silent = {p.name: default_spec(p) for p in made.declared}
    for name, value in starts.items():
        spec = parameters.get(name)
        if spec is None or (spec.start, spec.fixed) != (silent[name].start, silent[name].fixed):
            continue
        if spec.fixed is not None:
            parameters[name] = replace(spec, fixed=value)
        else:
            parameters[name] = replace(spec, start=float(np.clip(value, spec.lower, spec.upper)))
    return replace(made, parameters=parameters)
