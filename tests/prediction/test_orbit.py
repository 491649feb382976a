"""The periodic orbit, its end and steady sliding, against independent integrators and the closed forms."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from identify import stability
from identify.base.document import to_dict
from identify.base.errors import SimulationError
from identify.effects import ALL, MAIN
from identify.model.model import assemble
from identify.prediction.axes import Site
from identify.prediction.closed_forms import closed_forms
from identify.prediction.cycles import CLOSELY, QUANTITIES, CycleBatch, check_calculable
from identify.prediction.predict import predict, predictions, solution_sets
from identify.prediction.windows import Outcome
from identify.simulation.simulate import run
from identify.simulation.sliding import slidings
from tests.support import oracle
from tests.support.maps_case import DEMO, settled_orbit

LOAD = 1.0
UNWEAKENED = ("inertia", "hysteresis_damping", "contact_ageing")
CASES = {
    "skin": ((*MAIN, "skin_compliance"), {}),
    "gain": ((*MAIN, "force_sensor", "sensor_lag", "sensor_second_lag"), {"lag_time": 5e-3, "sensor_gain": 1.2}),
    "direct effect": ((*MAIN, "direct_effect"), {}),
    "load dependence": ((*MAIN, "load_dependence"), {"reference_force": 3.0}),
    "linear weakening": ((*UNWEAKENED, "linear_weakening"), {"slope": -2.0}),
    "power law": ((*UNWEAKENED, "power_law"), {}),
    "driven damping": (("inertia", "driven_damping", "contact_ageing", "velocity_weakening"), {}),
}
REFUSED = ("excitation", "finger_motion", "occlusion", "friction_heterogeneity")


def values_of(effects=MAIN, /, **changes):
    model = assemble(effects)
    known = {name: value for name, value in DEMO.items() if name in model.parameter_names}
    return {q.name: q.default for q in model.parameters} | known | changes


def setting_of(speed, effects=MAIN, /, **changes):
    """Model and setting (n_w,) at a drive speed."""
    model, values = assemble(effects), values_of(effects, **changes)
    return model, np.array([*(values[name] for name in model.parameter_names), LOAD, speed])


def figures(model, w):
    """Of the orbit that a rested contact settles on, by name."""
    batch, y = settled_orbit(model, w)
    return dict(zip(QUANTITIES, batch.figures(y, CLOSELY)[0].tolist(), strict=True))


def solution_of(model, w):
    return solution_sets(model, w[None])[0]


def asked(speed, effects=MAIN, /, **changes):
    return to_dict(predict(Site(assemble(effects), values_of(effects, **changes), speed, LOAD)))


def test_bistable_is_both():
    """At 15 mm/s the same pair goes on sticking and goes on sliding; at 5 mm/s sliding does not last."""
    assert solution_of(*setting_of(15e-3)).outcome is Outcome.BISTABLE
    for speed, sticks in ((15e-3, False), (5e-3, True)):
        x, v, gamma = slidings(*setting_of(speed))[0].state
        seen = oracle.simulate(DEMO, speed, LOAD, 2.0, (float(x), 1.02 * float(v), float(gamma)))
        assert (seen.arrests.size > 0) is sticks
    y = settled_orbit(*setting_of(15e-3))[1][0]
    assert oracle.simulate(DEMO, 15e-3, LOAD, 2.0, (float(y[0]), 0.0, float(y[1]))).arrests.size > 20


@pytest.mark.parametrize("speed", [1e-6, 8e-5, 2e-2])
@pytest.mark.parametrize("delta", [-0.13, 0.05])
def test_sliding_has_the_eigenvalues_of_the_closed_form(speed, delta):
    pair = SimpleNamespace(**{**DEMO, "delta_mu_k": delta})
    ours = slidings(*setting_of(speed, delta_mu_k=delta))[0].eigenvalues
    theirs = stability.eigenvalues(pair, pair, speed, LOAD)
    assert np.allclose(ours, theirs[: ours.size], rtol=1e-9) and np.isnan(theirs[ours.size :]).all()


def test_without_weakening_and_ageing_the_closed_forms_are_exact():
    effects = ("inertia", "hysteresis_damping")
    model, w = setting_of(1e-3, effects)
    found = figures(model, w)
    forms = closed_forms({n: DEMO[n] for n in model.parameter_names} | {"drive_speed": 1e-3, "normal_force": LOAD})
    for name in ("drop", "period", "slip_duration", "peak_speed"):
        assert found[name] == pytest.approx(float(forms.numbers[name]), rel=1e-6)
    assert solution_of(model, w).windows.end == pytest.approx(float(forms.numbers["critical_speed"]), rel=5e-4)
    # Negative control: with ageing and weakening they are far off, or have no answer, and give no number.
    off = asked(1e-3, a=200.0)["closed_forms"]
    assert off["drop"]["validity"].startswith("not valid here: off by") and "drop" not in off["text"]
    document = asked(1e-3)
    assert document["closed_forms"]["drop"]["value"] is None and "runs away" in document["closed_forms"]["text"]
    assert abs(document["amplitude"]["drop"]["value"] / found["drop"] - 1) > 0.04


@pytest.mark.parametrize("speed", [1e-4, 1e-3, 20e-3])
def test_peak_to_valley_is_what_a_load_cell_would_see(speed):
    model, w = setting_of(speed)
    found, y = figures(model, w), settled_orbit(model, w)[1][0]
    seen = oracle.simulate(DEMO, speed, LOAD, 1.2 * found["period"], (float(y[0]), 0.0, float(y[1])))
    force = seen.force(np.linspace(seen.onsets[0], seen.arrests[0], 400_001))
    assert found["peak_to_valley"] == pytest.approx(np.ptp(force), rel=1e-6)
    assert (found["peak_to_valley"] > 4.0 * found["drop"]) is (speed == 20e-3)  # near the end the drop fades


@pytest.mark.parametrize("case", CASES)
def test_orbits_are_what_a_long_simulation_settles_on(case):
    effects, more = CASES[case]
    model, w = setting_of(1e-3, effects, **more)
    found = figures(model, w)
    motion = run(model, values_of(effects, **more), 1e-3, LOAD, 40 * found["period"])
    onset = motion.onsets[-3]
    arrest = motion.arrests[motion.arrests > onset][0]
    force = motion.sample([onset, arrest])["force"]
    assert found["drop"] == pytest.approx(force[0] - force[1], rel=1e-5)
    assert found["period"] == pytest.approx(motion.onsets[-2] - onset, rel=1e-5)
    # the effect is felt: the paper's pair has another drop, but where the damper only has another frequency
    plain = figures(*setting_of(1e-3))
    assert (abs(found["drop"] / plain["drop"] - 1) > 0.01) == (case != "driven damping")


def test_a_stick_with_transients_ends_at_its_first_chance():
    """The skin relaxes faster than the contact ages, and the drive is slow: the contact may break loose at once, or
    only after it has outgrown the pull for a while."""
    speed = 1e-4
    model, w = setting_of(speed, (*MAIN, "skin_compliance"))
    times = np.concatenate([np.linspace(0.0, 0.05, 5001), np.linspace(0.05, 8.0, 5001)[1:]])
    ones, crossings = np.ones(times.size), set()
    u = np.stack([speed * ones, LOAD * ones, ones, 0.0 * ones])
    for elongation in np.linspace(3.4e-4, 4.3e-4, 7):
        for skin in np.linspace(0.9e-4, 1.4e-4, 6):
            start = np.array([elongation, 0.0, 0.0, skin])
            x = np.array(model.rest(start, w[:-2, None], u, times[None, :]))
            pull, grip = (np.array(f(x, w[:-2, None], u)).ravel() for f in (model.driving_force, model.grip))
            if grip[0] <= pull[0]:
                continue
            first = int(np.argmax(grip < pull))
            found = CycleBatch(model, w[None]).run(np.delete(start, 1)[None]).stick[0]
            assert found == pytest.approx(times[first], abs=times[first] - times[first - 1])
            crossings.add(int(np.sum(np.diff(np.sign(grip - pull)) != 0)))
    assert {1, 3} <= crossings, "sticks with one and with several chances were looked at"


@pytest.mark.parametrize("effect", [e.name for e in ALL if e.name != "inertia"])
def test_every_effect_settles_on_an_answer_or_is_refused_by_name(effect):
    of = next(e for e in ALL if e.name == effect)
    rivals = [e.name for e in ALL if e.role and e.role == of.role]
    effects = (*(n for n in (*MAIN, *of.needs) if n not in rivals), effect)
    if effect in REFUSED:
        with pytest.raises(SimulationError, match=f"effect {effect}"):
            check_calculable(assemble(effects))
        return
    model, w = setting_of(2e-3, effects)
    batch = CycleBatch(model, w[None])
    motions = batch.settle(batch.rested())
    assert motions.periodic[0] or (not motions.sticks[0] and batch.growth[0] < 0.0)


def test_what_has_no_meaning_is_refused_in_one_sentence_and_holds_up_no_other_point():
    points = [Site(assemble(MAIN), DEMO, speed, LOAD) for speed in (0.0, 1e-3)]
    documents = [to_dict(answer) for answer in predictions(points)]
    assert "not zero" in documents[0]["text"] and documents[1]["stability"]["outcome"] == "always sticks"
    assert predictions([]) == []
    with pytest.raises(SimulationError, match="'mass_of_moon'"):
        predict(Site(assemble(MAIN), DEMO, 1e-3, LOAD, covariance=np.eye(1), names=("mass_of_moon",)))
    two = (*MAIN, "occlusion", "excitation")
    with pytest.raises(SimulationError, match="--without occlusion --without excitation"):
        predict(Site(assemble(two), values_of(two), 1e-3, LOAD))
