"""How finely a fit integrates and what that costs; and what a user asks of a fit beyond its values (`FitOptions`)."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_io.spelling import Spelled
from identify.base.errors import FitError, SceneError
from identify.model.model import Model, assemble
from identify.shooting.blocks import SlideBlock, block
from identify.shooting.passes import ORDER, Solved

Array = NDArray[np.float64]

FINEST = 1e-4
FEWEST_STEPS = 4  # of the fine passes
HALVING = 4.0  # times the Newton step that gives their error: what an answer with half the steps costs


@dataclass(frozen=True)
class Accuracy:
    """share: error of the steps that is allowed, in standard errors; refinements: how often the steps are halved for
    that; most: steps per interval, at most."""

    name: str
    share: float
    refinements: int
    most: int


COARSE = Accuracy("coarse", np.inf, 0, 96)
DEFAULT = Accuracy("default", 0.1, 2, 96)
TIGHT = Accuracy("tight", 0.01, 5, 384)
LEVELS = (COARSE, DEFAULT, TIGHT)


def accuracy_of(text: str) -> Accuracy:
    """A level by name, or a number: the error of the steps that is allowed, in standard errors.

    Raises:
        FitError: neither.
    """
    known = {level.name: level for level in LEVELS}
    if text in known:
        return known[text]
    try:
        share = float(text)
    except ValueError:
        share = np.nan
    if not FINEST <= share <= 10.0:
        raise FitError(
            f"the accuracy is {text!r}; expected {', '.join(known)}, or a number from {FINEST:g} to 10 (the error of "
            "the integration steps that is allowed, in standard errors): choose one"
        )
    return Accuracy(text, share, TIGHT.refinements, TIGHT.most)


@dataclass(frozen=True)
class AccuracyCost:
    """What a level takes and leaves: steps per interval, processor seconds more (or less) than the fit that was made,
    errors of the steps (f,) in standard errors of the free parameters."""

    level: str
    steps: int
    seconds: float
    errors: Array


def accuracy_costs(solved: Solved, size: Array, taken: Accuracy, first: int) -> list[AccuracyCost]:
    """What each level would take and leave, from the blocks of a fit that was made: no level is solved.

    A level is the first solve of a fit, and halvings of its steps until their error suits it. What a halving costs is
    measured: the Newton step to half the steps that gives their error is one part in HALVING of it.

    Args:
        size: standard errors (f,) of the free parameters; taken: the level of the fit; first: steps of its first solve.
    """
    steps, since = solved.grid.steps, time.process_time()
    left = -solved.moved_by_steps(solved.problem.with_steps(2 * steps)) * 2**ORDER / (2**ORDER - 1)
    per_step = HALVING * (time.process_time() - since) / (2 * steps)

    def errors_with(count: int) -> Array:
        if count < steps and steps % count == 0:
            return (left + solved.moved_by_steps(solved.problem.with_steps(count))) / size
        return left / size * (steps / count) ** ORDER

    def seconds_to(count: int) -> float:
        return per_step * sum(count // 2**n for n in range(TIGHT.refinements) if count // 2**n > first)

    costs, count = list[AccuracyCost](), first
    for level in sorted({*LEVELS, taken}, key=lambda level: -level.share):
        for _ in range(level.refinements):
            if np.max(np.abs(errors_with(count))) <= level.share or 2 * count > level.most:
                break
            count *= 2
        at = steps if level == taken else count
        costs.append(AccuracyCost(level.name, at, seconds_to(at) - seconds_to(steps), errors_with(at)))
    return costs


def effect_shares(model: Model) -> dict[str, float]:
    """By effect, the share of the time of a model's functions that it takes: of the instructions of a slip with its
    derivatives, those that are not there without the effect. An effect that others need is left out, and inertia:
    without it there is no slip to integrate."""

    def instructions(of: Model) -> int:
        return block(of, SlideBlock(1)).derivatives.instructions

    whole, shares = instructions(model), {}
    for name in model.effects:
        with suppress(SceneError):
            less = assemble(tuple(other for other in model.effects if other != name), model.force_sensor)
            if less.inertial:
                shares[name] = max(1.0 - instructions(less) / whole, 0.0)
    return shares


@dataclass(frozen=True)
class FitOptions(Spelled):
    """accuracy: of the integration; profile: every parameter by its profile likelihood; bootstrap: replicates, 0 for
    none; accuracy_table: what each level costs, with the errors of every parameter."""

    accuracy: Accuracy = DEFAULT
    profile: bool = False
    bootstrap: int = 0
    accuracy_table: bool = False

    def document(self) -> dict[str, Any]:
        """All of it, for provenance; only accuracy and profile decide the numbers, and `again` reads no more."""
        return asdict(self) | {"accuracy": self.accuracy.name}

    @staticmethod
    def again(document: Any) -> FitOptions:
        """What a stored result asked for; the default where it says nothing that can be read.

        Args:
            document: "asked" of its provenance, or whatever stands there.
        """
        stored, accuracy = document if isinstance(document, Mapping) else {}, DEFAULT
        with suppress(FitError):
            accuracy = accuracy_of(str(stored.get("accuracy", DEFAULT.name)))
        return FitOptions(accuracy=accuracy, profile=stored.get("profile") is True)


DEFAULT_OPTIONS = FitOptions()
Asked = FitOptions
"""The name of before, kept for one release."""
