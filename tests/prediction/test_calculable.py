"""Stability and amplitude under every effect: against brute force where a cycle repeats, refused by name elsewhere."""

import numpy as np
import pytest

from identify.base.document import to_dict
from identify.base.errors import SimulationError
from identify.effects import ALL, MAIN
from identify.model.model import assemble
from identify.prediction.closed_forms import beyond, known_settings
from identify.prediction.draws import OperatingPoint
from identify.prediction.orbit import CycleMap, close, rest_state
from identify.prediction.predict import predict, predictions, solution_set
from identify.prediction.quantities import orbit_slopes, quantities
from identify.simulation.simulate import run

PAIR = {
    "mu_s": 0.62,
    "mu_k0": 0.43,
    "delta_mu_k": -0.13,
    "a": 300.0,
    "D": 37.4e-6,
    "t_cr": 0.5,
    "mass": 0.2,
    "stiffness": 1470.0,
    "damping": 147.0,
}
SPEED, LOAD = 1e-3, 1.0
UNWEAKENED = ("inertia", "hysteresis_damping", "contact_ageing")
CASES = {
    "skin": ((*MAIN, "skin_compliance"), {}),
    "soft skin": ((*MAIN, "skin_compliance"), {"skin_stiffness": 60.0}),
    "lag": ((*MAIN, "sensor_lag"), {"lag_time": 5e-3}),
    "two lags and a gain": (
        (*MAIN, "force_sensor", "sensor_lag", "sensor_second_lag"),
        {"lag_time": 5e-3, "sensor_gain": 1.2},
    ),
    "direct effect": ((*MAIN, "direct_effect"), {}),
    "load dependence": ((*MAIN, "load_dependence"), {"reference_force": 3.0}),
    "linear weakening": ((*UNWEAKENED, "linear_weakening"), {"slope": -2.0}),
    "power law": ((*UNWEAKENED, "power_law"), {}),
    "driven damping": (("inertia", "driven_damping", "contact_ageing", "velocity_weakening"), {}),
}


def values_of(effects, more):
    model = assemble(effects)
    known = {name: value for name, value in PAIR.items() if name in model.parameter_names}
    return {q.name: q.default for q in model.parameters} | known | more


def map_of(effects, more, rtol=1e-6):
    model, values = assemble(effects), values_of(effects, more)
    return CycleMap(model, LOAD, np.array([values[name] for name in model.parameter_names]), rtol)


@pytest.mark.parametrize("case", CASES)
def test_orbits_are_what_a_long_simulation_settles_on(case):
    effects, more = CASES[case]
    map_ = map_of(effects, more)
    orbit = solution_set(map_, SPEED).orbit
    assert orbit is not None
    drop, period = quantities(map_, orbit.cycle, SPEED)[:2]
    motion = run(map_.model, values_of(effects, more), SPEED, LOAD, 40 * period)
    onset = motion.onsets[-3]
    arrest = motion.arrests[motion.arrests > onset][0]
    seen = motion.sample([onset, arrest])["force"]
    assert drop == pytest.approx(seen[0] - seen[1], rel=1e-5)
    assert period == pytest.approx(motion.onsets[-2] - onset, rel=1e-5)
    # the effect is felt: the paper's pair has another drop, but where the damper only has another frequency
    plain = map_of(MAIN, {})
    other = quantities(plain, solution_set(plain, SPEED).orbit.cycle, SPEED)[0]
    assert (abs(drop / other - 1) > 0.01) == (case != "driven damping")


@pytest.mark.parametrize("case", ["skin", "lag", "power law"])
def test_derivatives_of_an_orbit_against_differences(case):
    effects, more = CASES[case]
    names = [
        q.name for q in assemble(effects).parameters if q.name in ("mu_s", "skin_stiffness", "lag_time", "stiffness")
    ]
    names += ["speed_exponent"] * (case == "power law")
    base = values_of(effects, more)
    fine = map_of(effects, more, 1e-11)
    orbit = close(fine, solution_set(map_of(effects, more), SPEED).orbit.y, SPEED)
    slopes = orbit_slopes(fine, orbit, names)
    for i, name in enumerate(names):
        ends = []
        for sign in (1, -1):
            moved = map_of(effects, more | {name: base[name] * (1 + sign * 1e-4)}, 1e-11)
            ends.append(quantities(moved, close(moved, orbit.y, SPEED).cycle, SPEED))
        expected = (ends[0] - ends[1]) / (2e-4 * base[name])
        felt = np.abs(quantities(fine, orbit.cycle, SPEED)[:4]) / base[name]  # a lag moves no time
        assert np.all(np.abs(slopes[:4, i] - expected[:4]) < 2e-4 * np.abs(expected[:4]) + 1e-7 * felt)


def test_a_stick_with_transients_ends_at_its_first_chance():
    """The skin relaxes faster than the contact ages, and the drive is slow: the grip may give way at once, or only
    after it has outgrown the pull for a while."""
    map_, speed = map_of((*MAIN, "skin_compliance"), {}), 1e-4
    w, model = map_.setting(speed), map_.model
    times = np.concatenate([np.linspace(0.0, 0.05, 5001), np.linspace(0.05, 8.0, 5001)[1:]])
    ones = np.ones(times.size)
    u = np.stack([speed * ones, LOAD * ones, ones, 0.0 * ones])
    crossings = set()
    for elongation in np.linspace(3.4e-4, 4.3e-4, 7):
        for skin in np.linspace(0.9e-4, 1.4e-4, 6):
            start = np.array([elongation, 0.0, 0.0, skin])
            x = np.array(model.rest(start, w[:-2, None], u, times[None, :]))
            pull, grip = (np.array(f(x, w[:-2, None], u)).ravel() for f in (model.driving_force, model.grip))
            if grip[0] <= pull[0]:
                continue
            first = int(np.argmax(grip < pull))
            spacing = times[first] - times[first - 1]
            assert map_.run(rest_state(start), speed).stick == pytest.approx(times[first], abs=spacing)
            crossings.add(int(np.sum(np.diff(np.sign(grip - pull)) != 0)))
    assert {1, 3} <= crossings, "sticks with one and with several chances were looked at"


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("excitation",), ["the effect excitation changes with time", "--without excitation"]),
        (("finger_motion",), ["the effect finger_motion changes with time"]),
        (("occlusion",), ["the effect occlusion changes with time"]),
        (("occlusion", "excitation"), ["effects occlusion and excitation", "--without occlusion --without excitation"]),
        (("friction_heterogeneity",), ["friction_heterogeneity deals every stick its own friction"]),
    ],
)
def test_models_that_never_repeat_are_refused_by_name(names, words):
    effects = (*MAIN, *names)
    model, values = assemble(effects), values_of(effects, {})
    with pytest.raises(SimulationError) as caught:
        to_dict(predict(model, values, SPEED, LOAD))
    text = str(caught.value)
    assert all(word in text for word in words) and "\n" not in text
    several = [
        to_dict(answer)
        for answer in predictions(
            model, [OperatingPoint(values, SPEED, LOAD), OperatingPoint(values, 2 * SPEED, LOAD)], ()
        )
    ]
    assert [text in document["text"] for document in several] == [True, True]


def test_every_other_effect_has_an_answer():
    refused = {"inertia", "excitation", "finger_motion", "occlusion", "friction_heterogeneity"}
    for effect in ALL:
        rivals = [e.name for e in ALL if e.role and e.role == effect.role]
        effects = (*(n for n in (*MAIN, *effect.needs) if n not in rivals), effect.name)
        if effect.name not in refused:
            document = to_dict(predict(assemble(effects), values_of(effects, {}), 2e-3, LOAD))
            assert document["stability"]["outcome"] in ("always sticks", "never sticks", "bistable")


def test_closed_forms_know_four_effects():
    assert beyond((*MAIN, "varying_normal_force", "driven_damping", "linear_weakening")) == ()
    effects = (*MAIN, "skin_compliance")
    document = to_dict(predict(assemble(effects), values_of(effects, {}), SPEED, LOAD))
    forms = document["closed_forms"]
    assert forms["ignores"] == ["skin_compliance"]
    for name in ("drop", "period", "critical_speed", "Pi", "Pi_fc", "Omega_c"):
        assert forms[name]["validity"] == "not valid here: knows nothing of skin_compliance"
    assert forms["text"] == "The paper's closed forms are not valid here: they know nothing of skin_compliance."
    plain = to_dict(predict(assemble(MAIN), values_of(MAIN, {}), SPEED, LOAD))["closed_forms"]
    assert plain["ignores"] == [] and "know nothing" not in plain["text"]


def test_closed_forms_of_a_damper_at_the_natural_frequency_are_those_of_hysteresis():
    natural = np.sqrt(1470.0 / 0.2) / (2 * np.pi)
    effects = CASES["driven damping"][0]
    driven = to_dict(predict(assemble(effects), values_of(effects, {"damping_frequency": natural}), SPEED, LOAD))
    plain = to_dict(predict(assemble(MAIN), values_of(MAIN, {}), SPEED, LOAD))
    for part in ("drop", "period", "critical_speed", "Pi"):
        own, other = driven["closed_forms"][part], plain["closed_forms"][part]
        assert own["validity"] == other["validity"]
        assert own["value"] == (None if other["value"] is None else pytest.approx(other["value"], rel=1e-9))
    twice = known_settings({**PAIR, "damping_frequency": 2 * natural})
    assert twice["damping"] == pytest.approx(147.0 / 2, rel=1e-12), "the damper is h/omega"


def test_closed_forms_of_linear_weakening_hold_where_the_contact_is_saturated():
    """Without ageing they are the exact slip (eq. 13): no a V_max limits them, and the nonlinear model agrees."""
    effects = ("inertia", "hysteresis_damping", "linear_weakening")
    document = to_dict(predict(assemble(effects), values_of(effects, {"slope": -1.0}), 1e-4, LOAD))
    for part in ("drop", "period", "slip_duration", "peak_speed"):
        own, other = document["closed_forms"][part], document["amplitude"][part]
        assert own["value"] == pytest.approx(other["value"], rel=1e-3)
        assert own["validity"].startswith("valid here")


def test_a_closed_form_that_does_not_hold_gives_no_number():
    forms = to_dict(predict(assemble(MAIN), values_of(MAIN, {"a": 200.0}), SPEED, LOAD))["closed_forms"]
    assert forms["drop"]["validity"].startswith("not valid here: off by")
    assert f"drop: {forms['drop']['validity']}" in forms["text"]
