"""The interval with the tolerances of rig and sensors: from the information at the answer, checked against what is
known exactly."""

from dataclasses import replace

import numpy as np
import pytest

from identify import Scene, examples
from identify.estimation.covariance import added_by_tolerances, standard_deviations
from identify.estimation.search import SearchProblem, search
from identify.logs.scene_records import prepare_scene, with_drives, with_records
from identify.report.result import _farther, result_of
from tests.support.fake_fit import RIG
from tests.support.finding import find

pytestmark = pytest.mark.usefixtures("no_predictions")

NAMES = ("mu_s", "mu_k0", "D", "t_cr", "delta_mu_k", "a")


@pytest.fixture(scope="module")
def found():
    return find(of_logs(), progress=lambda *_: None)


@pytest.fixture(scope="module")
def answer(found):
    prepared, findings = found
    return findings.information, findings.unknowns.values(findings.attempt.solved.theta, prepared[0].data.base)


def theta_of(scene, records):
    """Where a search on these records ends (n_p,), and the base values."""
    made = prepare_scene(scene, records)
    attempt, _ = search(SearchProblem(made.logs, made.unknowns, thorough=False))
    return attempt.solved.theta, made.logs[0].data.base


def added(answer, **tolerances):
    information, values = answer
    sd = standard_deviations(added_by_tolerances(information, values, tolerances, 1.0))
    return dict(zip(np.array(information.unknowns.names)[information.free].tolist(), sd.tolist(), strict=True))


def of_logs(*overrides):
    return Scene.from_toml(examples.SCENE, overrides).choose(["5_mm_per_s.txt.gz", "0.1_mm_per_s.txt.gz"])


def test_an_error_of_the_speed_is_a_change_of_the_unit_of_length(answer):
    """Against a fit of the same logs with all drive speeds stated 0.1 % too high."""
    information, values = answer
    scene = of_logs()
    scene, records = with_records(with_drives(scene)[0], None)
    faster = [replace(entry, drive_speed=1.001 * entry.drive_speed) for entry in scene.logs]
    theta, base = theta_of(replace(scene, logs=tuple(faster)), records)
    theta = (theta - information.unknowns.theta(values, base))[information.free]
    expected = 1e-3 * information.drive_speed_shift(values)
    size = np.sqrt(np.diag(information.covariance()))
    assert theta / size == pytest.approx(expected / size, abs=0.05 * np.max(np.abs(expected / size)))


def test_a_gain_of_the_normal_force_goes_into_the_coefficients_alone(answer):
    information, values = answer
    found = added(answer, normal_force=0.01)
    value = dict(zip(information.unknowns.names, values.tolist(), strict=True))
    for name in ("mu_s", "mu_k0", "delta_mu_k"):  # none of them is searched by its logarithm
        assert found[name] == pytest.approx(0.01 * abs(value[name]), rel=1e-3)
    assert max(found["D"], found["t_cr"], found["a"]) < 1e-5


def test_a_zero_of_the_friction_force_shifts_both_coefficients_as_a_fit_of_shifted_logs_does(answer):
    """Against the fit itself: all friction forces raised by 1 % of the normal force."""
    _, values = answer
    scene = of_logs()
    scene, records = with_records(with_drives(scene)[0], None)
    signs = [np.sign(np.median(r.friction_force)) for r in records]  # a force is turned so that it slides forward
    raised = [
        replace(r, friction_force=r.friction_force + sign * 0.01 * float(np.median(r.normal_force)))
        for r, sign in zip(records, signs, strict=True)
    ]
    unknowns = answer[0].unknowns
    moved = unknowns.values(*theta_of(scene, raised)) - values
    shift, names = added(answer, friction_zero=0.01), unknowns.names
    # The loads vary by 2.6 %, and a zero is a level of the coefficients exactly where they are steady.
    for name, close in (("mu_s", 0.02), ("mu_k0", 0.2)):
        assert shift[name] == pytest.approx(0.01, rel=1e-3)
        assert moved[names.index(name)] == pytest.approx(shift[name], rel=close)
    assert max(shift[name] for name in ("D", "t_cr", "a")) < 1e-5


def test_the_verdict_is_of_the_interval_to_publish(found):
    """Strength is a difference: what both coefficients share is no error of it, and what only one gain tells is."""
    result = result_of(of_logs("tolerances.friction_zero=0.08"), *found, {}, 0)
    entry = result.parameters["mu_k0"]
    low, high = entry.ends
    exact = entry.interval_rig_exact
    assert entry.verdict == "weak" and "error of 8 % in the zero of the friction force" in entry.reason
    assert low < 0.8 * entry.value < 0.95 * entry.value < exact[0] < exact[1] < high
    assert entry.standard_error == pytest.approx((high - low) / (2.0 * 1.96), rel=0.02)
    assert result.correlation.standard_errors[result.correlation.names.index("mu_k0")] == pytest.approx(
        entry.standard_error, rel=0.02
    )
    assert result.parameters["D"].verdict == "identified"


@pytest.mark.slow
def test_an_error_of_the_speed_reaches_a_rig_whose_mass_and_stiffness_are_tied():
    """A tap knows sqrt(k/m) to a thousandth of a percent and neither alone: drive speeds 1 % off put both 1 % off."""
    tied = ["mass", "stiffness"]
    rig = [f'rig.{name}={{value="{RIG[name]}", tolerance="1 %"}}' for name in tied]
    scene = of_logs(*rig, 'rig.natural_frequency_tolerance="0.001 %"')
    prepared, found = find(scene, progress=lambda *_: None)
    assert found.information is not None and found.attempt is not None
    values = found.unknowns.values(found.attempt.solved.theta, prepared[0].data.base)
    free = added((found.information, values), drive_speed=0.01)
    for name in tied:  # the data tell k/v alone, so that the prior of 1 % and the speed's share the error
        assert free[name] == pytest.approx(0.01 / np.sqrt(2.0), rel=0.1)


def test_what_the_data_tell_better_than_the_tolerance_is_not_believed(answer):
    """The stick slope tells the stiffness: a tolerance of 20 % adds no more than what the data leave of it."""
    information, _ = answer
    exact, wide = (added(answer, stiffness=share) for share in (0.0, 0.2))
    assert max(exact.values()) == 0.0
    column = information.unknowns.names.index("stiffness")
    free = information.free
    left = information.total[column, column] + information.total[column, free] @ information.shift(column)
    believed = 1.0 / np.sqrt(left + 1.0 / 0.2**2)
    shifts = dict(zip(np.array(information.unknowns.names)[free].tolist(), information.shift(column), strict=True))
    assert believed < 0.01
    for name in NAMES:
        assert wide[name] == pytest.approx(abs(shifts[name]) * believed, rel=0.02, abs=1e-9)


def test_an_end_moves_out_and_an_open_one_stays_open():
    assert _farther(1.0, None, 0.1, True) is None
    assert _farther(2.0, 2.0 * np.exp(-0.3), 0.4, True) == pytest.approx(2.0 * np.exp(-0.5))
    assert _farther(-0.1, -0.07, 0.04, False) == pytest.approx(-0.05)
    assert _farther(1.0, 1.2, 0.0, True) == pytest.approx(1.2)
    assert _farther(1.0, 1.2, 1e3, True) is None  # an error of a thousand in the logarithm leaves nothing known
