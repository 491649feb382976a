"""What follows from the parameters alone: the creep velocity, and the static coefficient after a stated rest."""

from __future__ import annotations

import numpy as np
import pytest

from identify.base.result import Correlation, ParameterResult
from identify.report.result import STATED_REST, derived_quantities
from tests.support import oracle

NAMES = ("mu_s", "mu_k0", "D", "t_cr")
VALUES = {"mu_s": 0.62, "mu_k0": 0.43, "D": 40e-6, "t_cr": 9.0}
COVARIANCE = np.array(
    [[4e-6, 1e-6, 0.0, 3e-4], [1e-6, 9e-6, 0.0, 0.0], [0.0, 0.0, 4e-12, 1e-7], [3e-4, 0.0, 1e-7, 0.04]]
)


def _derived(covariance=COVARIANCE, unknown=()):
    errors = np.sqrt(np.diag(covariance))
    parameters = {
        name: ParameterResult(VALUES[name], standard_error=None if name in unknown else error, verdict="identified")
        for name, error in zip(NAMES, errors.tolist(), strict=True)
    }
    matrix = tuple(map(tuple, (covariance / np.outer(errors, errors)).tolist()))
    return derived_quantities(parameters, Correlation(NAMES, matrix))


def test_the_static_coefficient_after_a_rest_is_that_of_a_simulation():
    """A mass that rests so long with a contact that was fresh, then is pulled fast: what it breaks loose at."""
    rig = {"delta_mu_k": -0.1, "a": 300.0, "mass": 0.2, "stiffness": 1470.0, "damping": 0.0}
    motion = oracle.simulate(VALUES | rig, ((0.0, 0.0), (STATED_REST, 1.0)), 1.0, STATED_REST + 0.1)
    pulled = rig["stiffness"] * motion.onset_states[0][0]
    later = motion.onsets[0] - STATED_REST  # it ages on while it is pulled
    assert _derived()["static_15s"].value == pytest.approx(pulled, abs=0.19 * later / VALUES["t_cr"])
    assert _derived()["static_15s"].value < 0.62 - 0.03  # control: nine seconds are not nought


def test_the_intervals_hold_19_of_20_draws():
    draws = dict(
        zip(
            NAMES,
            np.random.default_rng(15).multivariate_normal(list(VALUES.values()), COVARIANCE, 20_000).T,
            strict=True,
        )
    )
    derived = _derived()
    after = draws["mu_s"] - (draws["mu_s"] - draws["mu_k0"]) * np.exp(-STATED_REST / draws["t_cr"])
    for name, drawn in (("static_15s", after), ("v_cr", draws["D"] / draws["t_cr"])):
        low, high = derived[name].interval
        assert np.mean((drawn > low) & (drawn < high)) == pytest.approx(0.95, abs=0.01)
    alone = _derived(np.diag(np.diag(COVARIANCE)))["static_15s"].interval  # control: correlations count
    assert np.ptp(alone) > 1.1 * np.ptp(derived["static_15s"].interval)


def test_what_is_not_known_leaves_them_open():
    open_end = _derived(unknown=("t_cr",))
    assert open_end["static_15s"].interval == (None, None) and "do not determine" in open_end["static_15s"].reason
    assert open_end["v_cr"].interval == (None, None)
