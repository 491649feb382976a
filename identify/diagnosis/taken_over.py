"""Logs, motion and start of a model as another model left them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.diagnosis.fitted import Fitted
from identify.logs.log_data import Guess
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.model.model import Model

Array = NDArray[np.float64]


def values_of(other: Fitted, unknowns: Unknowns) -> Array:
    """The start of a model (n_p,) with what another one searched where that ended."""
    assert other.attempt is not None
    names = other.model.parameter_names
    theta = dict(zip(names, other.attempt.solved.theta.tolist(), strict=True))
    searched = dict(zip(names, other.unknowns.free.tolist(), strict=True))
    for index, to, base in other.unknowns.ties:  # what followed another parameter goes on from there
        theta[names[index]] = theta[names[to]] + (np.log(base) if other.unknowns.logarithmic[index] else base)
        searched[names[index]] = True
    start = np.array([theta[n] if searched.get(n) else unknowns.start[i] for i, n in enumerate(unknowns.names)])
    return np.clip(np.where(unknowns.free, start, unknowns.start), unknowns.lower, unknowns.upper)


def taken_over(
    other: Fitted, prepared: Sequence[Prepared], unknowns: Unknowns
) -> tuple[list[Prepared], list[Guess], Unknowns]:
    """Logs, motion and start of a model as another one left them."""
    known, small, large = other.attempt, unknowns.model, other.model
    assert known is not None
    start = values_of(other, unknowns)
    logs = [
        replace(prepared[i], manner=cut.manner, data=replace(prepared[i].data, begin=cut.data.begin, end=cut.data.end))
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
