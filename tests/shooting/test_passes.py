"""How one pass is solved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support import shooting_case as case


def test_a_trust_region_is_a_prior_that_adds_its_information():
    """Of two Gaussians: precisions add, and the mean is that of both, weighted by them."""
    unknowns = case.search_space(case.PAIR, case.FRICTION)
    sd = np.where(np.arange(unknowns.free.size) == 0, 0.02, np.inf)
    unknowns = replace(unknowns, prior_mean=unknowns.start - 0.1, prior_sd=sd)
    held = unknowns.within_region(100.0)
    wide = unknowns.weakest / 10.0
    np.testing.assert_allclose(held.prior_sd[1:], wide[1:])
    np.testing.assert_allclose(held.prior_mean[1:], unknowns.start[1:])
    both = np.array([0.02, wide[0]]) ** -2.0
    assert held.prior_sd[0] == pytest.approx(both.sum() ** -0.5)
    assert held.prior_mean[0] == pytest.approx(both @ [unknowns.start[0] - 0.1, unknowns.start[0]] / both.sum())
    np.testing.assert_allclose(unknowns.within_region(0.0).prior_sd, sd)
