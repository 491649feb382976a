"""The periodic orbit, its end and steady sliding, against an independent integrator and the closed forms."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments import run_pair_study
from identify import stability
from identify.base.document import to_dict
from identify.base.errors import SimulationError
from identify.model.model import assemble
from identify.prediction.batch import settle
from identify.prediction.closed_forms import closed_forms
from identify.prediction.draws import Draws, OperatingPoint
from identify.prediction.orbit import CycleMap
from identify.prediction.predict import predict, predictions, solution_set
from identify.prediction.quantities import QUANTITIES, orbit_slopes, quantities
from identify.prediction.windows import Outcome, unstable_speeds
from identify.simulation.sliding import sliding
from tests.support import oracle

ALL = ("inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening")
DEMO = {
    "mass": 0.2,
    "stiffness": 1470.0,
    "damping": 147.0,
    "mu_s": 0.62,
    "mu_k0": 0.43,
    "delta_mu_k": -0.13,
    "a": 300.0,
    "D": 37.4e-6,
    "t_cr": 0.5,
}


def map_of(effects: tuple[str, ...] = ALL, /, **changes: float) -> CycleMap:
    model = assemble(effects)
    values = {**DEMO, **changes}
    return CycleMap(model, 1.0, np.array([values[n] for n in model.parameter_names]), rtol=1e-8)


def test_drop_period_and_end_agree_with_brute_force() -> None:
    assert run_pair_study.main(fast=True) < 0.01


def test_bistable_is_both() -> None:
    """At 15 mm/s the same pair goes on sticking and goes on sliding; at 5 mm/s sliding does not last."""
    map_ = map_of()
    assert solution_set(map_, 15e-3).outcome is Outcome.BISTABLE
    for speed, sticks in ((15e-3, False), (5e-3, True)):
        steady = sliding(map_.model, map_.p, speed, 1.0)
        x, v, gamma = steady.state
        run = oracle.simulate(DEMO, speed, 1.0, 2.0, (float(x), 1.02 * float(v), float(gamma)))
        assert (run.arrests.size > 0) is sticks
    y = settle(map_, 15e-3).orbit.y  # type: ignore[union-attr]
    assert oracle.simulate(DEMO, 15e-3, 1.0, 2.0, (float(y[0]), 0.0, float(y[1]))).arrests.size > 20


@pytest.mark.parametrize("speed", [1e-6, 3e-5, 8e-5, 1e-3, 2e-2])
@pytest.mark.parametrize("delta", [-0.13, 0.05])
def test_sliding_has_the_eigenvalues_of_the_closed_form(speed: float, delta: float) -> None:
    map_ = map_of(delta_mu_k=delta)
    pair = SimpleNamespace(**{**DEMO, "delta_mu_k": delta})
    ours, theirs = sliding(map_.model, map_.p, speed, 1.0).eigenvalues, stability.eigenvalues(pair, pair, speed, 1.0)
    assert np.allclose(ours, theirs[: ours.size], rtol=1e-9)
    assert np.isnan(theirs[ours.size :]).all()


def test_unstable_speeds_end_where_the_damping_of_sliding_vanishes() -> None:
    """Above v_cr: c = -dmu_k a exp(-a v) F_n."""
    map_ = map_of()
    c = DEMO["damping"] * np.sqrt(DEMO["mass"] / DEMO["stiffness"])
    exact = np.log(-DEMO["delta_mu_k"] * DEMO["a"] / c) / DEMO["a"]
    ((low, high),) = unstable_speeds(map_.model, map_.setting(1.0), 1e-6, 1.0)
    assert low == 1e-6 and high == pytest.approx(exact, rel=1e-8)


def test_without_weakening_and_ageing_the_closed_forms_are_exact() -> None:
    map_ = map_of(("inertia", "hysteresis_damping"))
    values = {n: DEMO[n] for n in map_.model.parameter_names}
    orbit = settle(map_, 1e-3).orbit
    assert orbit is not None
    drop, period, _, slip, _, peak, *_ = quantities(map_, orbit.cycle, 1e-3)
    forms = closed_forms(values | {"drive_speed": 1e-3, "normal_force": 1.0}).numbers
    assert [drop, period, slip] == pytest.approx([forms["drop"], forms["period"], forms["slip_duration"]], rel=1e-6)
    assert peak == pytest.approx(forms["peak_speed"], rel=1e-3)
    end = solution_set(map_, 1e-3).end
    assert end == pytest.approx(forms["critical_speed"], rel=5e-4)


def test_ageing_and_weakening_matter() -> None:
    """Negative control: the same closed forms are far off, or have no answer, for the full model."""
    document = to_dict(predict(assemble(ALL), {**DEMO, "delta_mu_k": -0.08}, 1e-3, 1.0))
    assert document["closed_forms"]["drop"]["validity"].startswith("not valid here")
    document = to_dict(predict(assemble(ALL), DEMO, 1e-3, 1.0))
    assert document["closed_forms"]["drop"]["value"] is None
    assert "runs away" in document["closed_forms"]["text"]
    plain = map_of(("inertia", "hysteresis_damping"))
    orbit = settle(plain, 1e-3).orbit
    assert orbit is not None
    assert abs(document["amplitude"]["drop"]["value"] / quantities(plain, orbit.cycle, 1e-3)[0] - 1) > 0.04


def test_slopes_agree_with_orbits_solved_again() -> None:
    map_, speed = map_of(), 1e-3
    answer = solution_set(map_, speed)
    assert answer.orbit is not None
    names = ["mu_s", "delta_mu_k", "a", "t_cr", "mass"]
    slopes = orbit_slopes(map_, answer.orbit, names)
    for j, name in enumerate(names):
        moved: list[Any] = []
        for sign in (1, -1):
            other = map_of(**{name: DEMO[name] * (1 + 1e-3 * sign)})
            orbit = settle(other, speed).orbit
            assert orbit is not None
            moved.append(quantities(other, orbit.cycle, speed))
        assert np.allclose(slopes[:, j], (moved[0] - moved[1]) / (2e-3 * DEMO[name]), rtol=1e-2, atol=1e-6)


def test_outlook_is_a_document_with_intervals() -> None:
    names = ["mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr"]
    sd = np.array([0.002, 0.002, 0.002, 5.0, 1e-6, 0.02])
    document = to_dict(predict(assemble(ALL), DEMO, -1e-4, 1.0, np.diag(sd**2), names))
    assert json.loads(json.dumps(document)) == document
    assert document["stability"]["outcome"] == "always sticks"
    for entry in (
        document["amplitude"]["drop"],
        document["amplitude"]["period"],
        document["stability"]["critical_speed"],
    ):
        low, high = entry["interval"]
        assert low < entry["value"] < high < 1.2 * entry["value"]
    # Dominated here by mu_s and mu_k0: the drop is about 2 (mu_s - mu_k) F_n.
    low, high = document["amplitude"]["drop"]["interval"]
    assert 0.015 < high - low < 0.03
    assert (
        "it sticks and slips, however the motion starts" in document["text"]
        and "By drive speed: stick-slip up to 10.4 mm/s; " in document["text"]
    )
    assert to_dict(predict(assemble(ALL), DEMO, 1e-4, 1.0))["amplitude"]["drop"]["interval"] is None


NAMES = ["mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr"]
KNOWN = np.diag(np.array([0.002, 0.002, 0.002, 5.0, 1e-6, 0.02]) ** 2)
LOGS = ((0.1e-3 / 60, 0.930), (0.1e-3, 0.9345), (1e-3, 0.937), (5e-3, 0.940))


def intervals(document: dict[str, Any]) -> list[dict[str, Any]]:
    numbers = [document["stability"]["critical_speed"], document["stability"]["sliding"]["growth_rate"]]
    return numbers + [entry for name, entry in document["amplitude"].items() if name in [*QUANTITIES, "frequency"]]


def test_logs_that_share_a_branch_get_the_answers_they_get_alone() -> None:
    model = assemble(ALL)
    together = [
        to_dict(answer)
        for answer in predictions(model, [OperatingPoint(DEMO, v, load, KNOWN) for v, load in LOGS], NAMES)
    ]
    for (speed, load), document in zip(LOGS, together, strict=True):
        alone = to_dict(predict(model, DEMO, speed, load, KNOWN, NAMES))
        for ours, theirs in zip(intervals(document), intervals(alone), strict=True):
            assert ours["value"] == pytest.approx(theirs["value"], rel=1e-4)
            assert ours["interval"] == pytest.approx(theirs["interval"], rel=1e-3)
    # Not the end of the shared branch itself: that lies 0.7 % off for the lightest load.
    ends = [d["stability"]["critical_speed"]["value"] for d in together]
    assert ends[3] / ends[0] == pytest.approx((0.940 / 0.930) ** 0.696, abs=3e-4)


def test_a_log_without_an_answer_does_not_hold_up_the_others() -> None:
    bad, good = OperatingPoint(DEMO, 0.0, 1.0), OperatingPoint(DEMO, 1e-3, 1.0)
    documents = [to_dict(answer) for answer in predictions(assemble(ALL), [bad, good], [])]
    assert "not zero" in documents[0]["text"]
    assert documents[1]["stability"]["outcome"] == "always sticks"


@pytest.mark.parametrize("variance", [1e6, np.inf, np.nan])
def test_what_follows_from_an_unknown_parameter_is_open_and_says_why(variance: float) -> None:
    unknown = KNOWN.copy()
    unknown[4, 4] = variance
    # A D twenty times as large moves the end of stick-slip by 0.9 %: that keeps its interval.
    document = to_dict(predict(assemble(ALL), DEMO, 1e-3, 1.0, unknown, NAMES))
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    end, growth, *amplitude = intervals(document)
    far = solution_set(map_of(D=20.0 * DEMO["D"]), 1e-3).end
    assert far is not None and end["interval"][0] < far < min(end["interval"][1], 1.01 * end["value"])
    # So does the force at the onset of a saturated contact; all else of the jumps is open.
    moved = settle(map_of(D=20.0 * DEMO["D"]), 1e-3).orbit
    onset = document["amplitude"]["onset_force"]
    assert moved is not None
    for entry in amplitude:
        assert entry["value"] is not None
        if entry is onset and entry["interval"] != [None, None]:
            force = quantities(map_of(D=20.0 * DEMO["D"]), moved.cycle, 1e-3)[list(QUANTITIES).index("onset_force")]
            assert force == pytest.approx(entry["value"], rel=1e-2)
        else:
            assert entry["interval"] == [None, None] and "D" in entry["reason"]
    # Sliding at 1 mm/s is worn at the estimate, but not with such a D: then it ages, and grows otherwise.
    assert growth["interval"] == [None, None] and "D" in growth["reason"]
    assert "do not tell D" in document["amplitude"]["text"]


def test_a_ridge_between_parameters_opens_what_lies_along_it_only() -> None:
    """Two parameters unknown, their sum known: what needs the sum alone keeps its interval."""
    ridge = np.diag([0.0, 1e6, 1e6]) + 1e-6 * np.eye(3)
    ridge[1, 2] = ridge[2, 1] = -1e6
    values = DEMO | {"drive_speed": 1e-3, "normal_force": 1.0}
    draws = Draws.of(assemble(ALL), values, ["mu_s", "mu_k0", "delta_mu_k"], ridge)
    static, slow, fall = (draws.column(name) for name in ("mu_s", "mu_k0", "delta_mu_k"))
    assert "mu_k0 and delta_mu_k" in draws.interval(slow + 0.5 * fall, DEMO["mu_k0"] - 0.065).reason
    assert not draws.interval(slow + fall, 0.3).reason
    closed = draws.interval(static, DEMO["mu_s"])
    assert closed.low == pytest.approx(DEMO["mu_s"] - 1.96e-3, rel=2e-4) and not closed.reason


def test_outcomes_along_the_drive_speed() -> None:
    answers = [to_dict(predict(assemble(ALL), DEMO, v, 1.0))["stability"] for v in (5e-3, 15e-3, 25e-3)]
    assert [a["outcome"] for a in answers] == ["always sticks", "bistable", "never sticks"]
    ends = [a["critical_speed"]["value"] for a in answers]
    assert max(ends) / min(ends) < 1.001


def test_what_has_no_meaning_is_refused_in_one_sentence() -> None:
    with pytest.raises(SimulationError, match="not zero"):
        to_dict(predict(assemble(ALL), DEMO, 0.0, 1.0))
    with pytest.raises(SimulationError, match="'mass_of_moon'"):
        to_dict(predict(assemble(ALL), DEMO, 1e-3, 1.0, np.eye(1), ["mass_of_moon"]))


def test_a_contact_without_static_excess_never_sticks() -> None:
    document = to_dict(predict(assemble(ALL), {**DEMO, "mu_s": 0.43, "delta_mu_k": 0.05}, 1e-3, 1.0))
    assert document["stability"]["outcome"] == "never sticks"
    assert document["amplitude"]["drop"]["value"] is None and document["stability"]["critical_speed"]["value"] is None
