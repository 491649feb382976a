"""Standard errors that were widened are said to be."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify.report.depth_document import ridge_note

UNKNOWNS: Any = SimpleNamespace(names=("mu_s", "mass", "D"), free=np.array([True, False, True]))
WHITE = np.diag([1e-8, 4e-6])


@pytest.mark.parametrize("memory", [1.0, 3.0])
def test_what_is_widened_for_a_bent_likelihood_is_named(memory: float) -> None:
    """The memory of the noise, which has a note of its own, is not counted."""

    def said(factor: float) -> str:
        sure: Any = SimpleNamespace(
            memory=np.full(2, memory), white=WHITE, covariance=memory * WHITE * np.array([1.0, factor**2])
        )
        return ridge_note(sure, UNKNOWNS)

    assert "standard errors of D are up to 1.5 times" in said(1.5)
    assert said(1.1) == ""
