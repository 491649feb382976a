"""What explains a misfit."""

from __future__ import annotations

from dataclasses import dataclass

from identify.estimation.attempt import Attempt

ANOTHER_ANSWER = "another answer of the same model"


@dataclass(frozen=True)
class Cause:
    """What alone explains a misfit: a sentence; better: an answer of the model as it is stated that lies nearer to the
    data, met on the way: the misfit was at least in part the search's own."""

    sentence: str
    better: Attempt | None = None
