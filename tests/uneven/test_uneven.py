"""Uneven records: what the estimator says of simulated tracks whose truth is known, and of the measured ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp

from experiments import run_uneven_prediction
from experiments.uneven_records import STIFF, prepared, scene_of, simulated, truth_of
from identify import fit
from identify.base.errors import FitError
from identify.logs.unknowns import from_scene
from identify.report import write_report
from identify.report.stored_result import plain
from identify.scene import Scene
from identify.studies.fits import FitEntry, values
from identify.uneven import transfer
from identify.uneven.answer import UnevenEstimator, creep_interval, stated_rig
from identify.uneven.estimator import maximise
from identify.uneven.events import RigConstants, of_one_body, sticks_of
from identify.uneven.likelihood import Likelihood, Nodes
from identify.uneven.slip_functions import MET, PARAMETERS, THETA, slip_functions
from identify.uneven.transfer import APART, LAW_ERROR, agreement, mass_of, pooled_mass
from identify.uneven.wording import of_effects
from tests.support.document_check import validator

pytestmark = pytest.mark.usefixtures("shared_machine_code", "no_further_logs")

TOLD = [PARAMETERS.index(name) for name in ("strength", "weakening_rate", "mass")]
LAW = len(PARAMETERS)
ROWS = dict(zip(THETA, np.eye(len(THETA)), strict=True))


def lies_within(value, ends):
    return ends[0] <= value <= ends[1]


@pytest.fixture(scope="module")
def tracks():
    """Tracks of the stiff rig without fine roughness."""
    return simulated(STIFF, 36, [1, 2, 3])


@pytest.fixture(scope="module")
def maxima(tracks):
    """Sticks of each, and the maximum of its likelihood."""
    sticks = [sticks_of(prepared(STIFF, track.record)) for track in tracks]
    return [(record, maximise([record])) for record in sticks]


def test_strength_weakening_and_mass_are_recovered(maxima):
    truths = np.array([truth_of(STIFF, sticks.usual_rest) for sticks, _ in maxima])
    found = np.array([maximum.theta for _, maximum in maxima])
    sd = np.sqrt([np.diag(maximum.covariance) for _, maximum in maxima])
    assert all(maximum.converged for _, maximum in maxima)
    assert all(sd[:, PARAMETERS.index("mass")] < 0.1) and sd[:, TOLD].max() < 0.5
    for (_, maximum), truth in zip(maxima, truths, strict=True):
        assert all(lies_within(truth[PARAMETERS.index(n)], maximum.interval(ROWS[n])) for n in ("strength", "mass"))
    assert np.abs((found[:, :LAW] - truths)[:, TOLD].mean(axis=0)).max() < 0.25


def test_onsets_and_cycles_are_those_of_the_track(tracks, maxima):
    for track, (sticks, _) in zip(tracks, maxima, strict=True):
        arrest = track.arrest[np.searchsorted(track.arrest, sticks.last)]
        assert sticks.count >= 0.9 * track.onset.size
        assert np.median(arrest - sticks.last) < 6e-3  # a slip takes about 20 ms


def at_rate(record, rate):
    """Every so many samples of a record [Hz]."""
    rows = slice(None, None, round(1.0 / (rate * float(np.median(np.diff(record.time))))))
    fewer = {name: getattr(record, name)[rows] for name in ("time", "normal_force", "friction_force")}
    return replace(record, **fewer, steps=())


def test_slips_that_are_not_followed_tell_strength_and_wander_alone(tracks, maxima):
    """At 50 Hz there is one sample or two of a slip of 23 ms."""
    coarse = [sticks_of(prepared(STIFF, at_rate(track.record, 50.0))) for track in tracks]
    assert not any(sticks.resolved for sticks in coarse) and all(sticks.resolved for sticks, _ in maxima)
    found = [maximise([sticks]) for sticks in coarse]
    told = [PARAMETERS.index(name) for name in ("strength", "level_wander", "strength_scatter")]
    truths = np.array([truth_of(STIFF, sticks.usual_rest) for sticks in coarse])
    sd = np.sqrt([np.diag(maximum.covariance) for maximum in found])
    assert all(maximum.converged for maximum in found)
    theta = np.array([m.theta[:LAW] for m in found])
    assert np.abs(theta - truths)[:, told[0]].max() < 0.25 and sd[:, told[0]].max() < 0.6
    assert np.abs((theta - truths) / sd[:, :LAW])[:, told].max() < 3.5


def test_the_work_of_a_slip_is_that_of_its_course():
    """From rest to rest by the equation of motion: the level after it is the one that friction had."""
    rig, weakening, strength, level = RigConstants(558.0, 558.0 * 42e-6), 2000.0, 0.026, 0.3
    damping, mass = 0.2, 0.06

    def motion(t, state):
        u, v = state
        left = max(strength - weakening * u, 0.0)
        pull = level + strength + rig.rate * t - rig.stiffness * u - damping * v
        return v, (pull - level - left) / mass

    stops = lambda t, state: state[1] - 1e-7 + (1.0 if state[0] < 3e-5 else 0.0)  # noqa: E731
    stops.terminal = True
    end = solve_ivp(motion, (0.0, 1.0), (0.0, 0.0), events=stops, rtol=1e-9, atol=1e-14, max_step=1e-4)
    way = float(end.y[0, -1])
    line = level + strength + rig.rate * end.t[-1] - rig.stiffness * way
    functions, over_load = slip_functions(), np.array([rig.over_load(1e-6)])
    zeta = damping / (2.0 * np.sqrt(rig.stiffness * mass))

    def change(rate):
        theta = np.append(np.log([strength, rate, 1.0, mass, 0.3, 0.2, 1e-4, zeta]), [0.0, 0.0])[None, :]
        fallen = rig.stiffness * way
        met = functions.met([theta, over_load, np.array([[1e-5 * fallen, level + strength, 2.0, 2.0, 1.0]])])[0]
        place = np.array([[np.log(strength), 1.0, 1e-5 * fallen]])
        begun = functions.begin([theta, met, over_load, place])[0]
        state, kept = begun[:, : functions.state_size], begun[:, functions.state_size :]
        return functions.whole([state, kept, over_load, np.array([[fallen, line]])])[0][0, 1]

    by_weakening = 0.5 * strength**2 / weakening / way  # of the mean friction
    # The drive pulls on while a slip begins, which is neglected: 0.02 /s for 30 ms, 2 % of the strength.
    assert abs(change(weakening)) < rig.rate * 0.03
    assert change(100.0 * weakening) > by_weakening  # negative controls: a weakening that takes no work, and too much
    assert change(0.7 * weakening) < -2.0 * rig.rate * 0.03


def test_a_mass_that_is_stated_wrong_is_found(maxima):
    heavier = replace(STIFF, mass=1.5 * STIFF.mass)
    sticks = sticks_of(prepared(STIFF, simulated(heavier, 24, [4])[0].record))
    other = maximise([sticks])
    place = PARAMETERS.index("mass")
    assert other.theta[place] == pytest.approx(np.log(heavier.mass), abs=0.15)
    for _, maximum in maxima:
        gap = other.theta[place] - maximum.theta[place]
        assert gap > 3.0 * np.sqrt(other.covariance[place, place] + maximum.covariance[place, place])


def test_nominal_values_of_the_scene_move_nothing(tracks, maxima):
    (sticks, maximum), heavier = maxima[0], replace(STIFF, mass=1.7 * STIFF.mass, damping=10.0 * STIFF.damping)
    elsewhere = sticks_of(prepared(heavier, tracks[0].record))
    assert elsewhere.count == sticks.count and elsewhere.rig.pace == pytest.approx(sticks.rig.pace, rel=0.05)
    moved = maximise([elsewhere]).theta - maximum.theta  # the segmentation alone asks for the period of the rig
    for name in ("strength", "weakening_rate", "mass"):
        low, high = maximum.interval(ROWS[name])
        assert abs(ROWS[name] @ moved) < 0.15 * (high - low), name
    assert abs(ROWS["mass"] @ moved) < 0.03


def test_every_start_is_kept_with_what_it_reached(maxima):
    _, maximum = maxima[0]
    assert len(maximum.starts) == 3 and max(maximum.starts) - min(maximum.starts) < 20.0


def test_what_a_scene_states_with_a_tolerance_is_a_prior_and_a_nominal_value_is_none():
    document = scene_of(STIFF).as_document()
    loose = Scene.from_document(document)
    assert stated_rig(loose, from_scene(loose)) == {}
    tight = Scene.from_document(document | {"rig": document["rig"] | {"mass": {"value": "20 g", "tolerance": "5 %"}}})
    assert stated_rig(tight, from_scene(tight))["mass"] == pytest.approx((np.log(0.020), 0.05))


def test_the_interval_holds_the_answers_with_nuisances_free_and_at_the_means_of_their_priors(maxima):
    _, maximum = maxima[0]
    low, high = maximum.interval(ROWS["strength"])
    for theta in (maximum.theta, maximum.held):
        assert low < theta[0] < high
    assert maximum.held[LAW:] == pytest.approx(maximum.prior.mean[LAW:])
    farther = replace(maximum, held=maximum.held + ROWS["strength"])
    assert farther.interval(ROWS["strength"])[1] == pytest.approx(max(high, high + 1.0), abs=0.7)


def test_masses_of_records_are_pooled_with_their_scatter(maxima):
    """Against the closed form of a weighted mean of two equal masses, and a third one off by a factor of four."""
    sticks, maximum = maxima[0]
    alike = pooled_mass([sticks, sticks], [maximum, maximum])
    one = mass_of(maximum, sticks.rig.error)
    assert alike.scatter[0] == pytest.approx((0.0, 1, 1.0), abs=1e-9) and alike.shared
    assert one.lower < alike.lower < alike.upper < one.upper
    off = replace(
        maximum, theta=maximum.theta + np.log(4.0) * ROWS["mass"], held=maximum.held + np.log(4.0) * ROWS["mass"]
    )
    apart = pooled_mass([sticks, sticks], [maximum, off])
    sd = np.log(one.upper / one.lower) / (2.0 * maximum.quantile)
    assert sd > LAW_ERROR and apart.scatter[0][0] == pytest.approx(np.log(4.0) ** 2 / (2.0 * sd**2), rel=0.2)
    assert not apart.shared


def test_effects_that_are_not_followed_are_said():
    velocity, other = of_effects(["velocity_weakening", "sensor_lag"], {"velocity_weakening"})
    assert "in proportion to sliding speed" in velocity and other.startswith("Not used: sensor_lag")
    assert of_effects([], {"velocity_weakening"}) == []


def test_a_creep_time_beyond_all_rests_is_no_bound(maxima):
    sticks, maximum = maxima[0]
    _, upper = creep_interval([sticks], maximum)
    assert upper is not None and upper < 100.0 * sticks.usual_rest
    place, unknown = PARAMETERS.index("t_cr"), maximum.covariance.copy()
    unknown[place, place] = 50.0**2  # of its logarithm
    assert creep_interval([sticks], replace(maximum, covariance=unknown)) == (None, None)


def test_late_anchors_lose_the_strength(maxima):
    """The negative control: with slips that are seen only when a quarter of them is over, the answer is wrong."""
    sticks, maximum = maxima[0]
    rows = np.arange(sticks.count)
    fallen = (sticks.line[:, None] + sticks.rig.rate * sticks.time - sticks.force) > 0.25 * sticks.drop[:, None]
    first = np.minimum(np.argmax(fallen & sticks.counts, axis=1), sticks.samples - 2)
    late = np.minimum(first[:, None] + np.arange(sticks.time.shape[1]), sticks.samples[:, None] - 1)
    since = sticks.time[rows, first]
    moved = replace(
        sticks,
        anchor=sticks.anchor + since,
        line=sticks.line + sticks.rig.rate * since,
        time=sticks.time[rows[:, None], late] - since[:, None],
        force=sticks.force[rows[:, None], late],
        samples=sticks.samples - first,
    )
    wrong = maximise([moved])
    assert np.abs((wrong.theta - maximum.theta)[TOLD]).max() > 0.3


def test_the_onset_grows_as_the_equation_of_motion_says():
    rig, slid, zeta = RigConstants(stiffness=3300.0, rate=0.14), 2e-6, 0.018
    for weakening, mass, speed_term in ((7000.0, 0.06, 0.0), (4500.0, 0.05, 0.0), (7000.0, 0.06, 0.2)):
        theta = np.append(np.log([0.05, weakening, 0.1, mass, 1.0, 0.2, 0.01, zeta]), [speed_term, 0.0])
        stick = np.array([[rig.stiffness * slid, 0.3, 1.0, 1.0, 1.0]])
        met = slip_functions().met([theta[None, :], np.array([rig.over_load(0.0)]), stick])[0][0]
        time, speed = met[MET.index("earlier")], met[MET.index("speed")]
        damping = 2.0 * (zeta + speed_term) * np.sqrt(rig.stiffness * mass)

        def motion(t, state, weakening=weakening, mass=mass, damping=damping):
            u, v = state
            return v, (rig.rate * t + (weakening - rig.stiffness) * u - damping * v) / mass

        end = solve_ivp(motion, (0.0, time), (0.0, 0.0), rtol=1e-10, atol=1e-16).y[:, -1]
        assert end == pytest.approx([slid, speed], rel=2e-3)  # the end of the weakening is rounded


def test_scores_add_up_to_the_gradient(maxima):
    sticks, maximum = maxima[0]
    likelihood = Likelihood(sticks, maximum.nodes[0])
    theta = maximum.theta + 0.1
    gradient = likelihood.with_scores(theta)[1].sum(axis=0)
    for i, step in enumerate(1e-5 * np.eye(theta.size)):
        above, below = (likelihood(theta + side * step).log_likelihood.sum() for side in (1.0, -1.0))
        assert gradient[i] == pytest.approx((above - below) / 2e-5, rel=1e-4, abs=1e-4)


def test_nodes_do_not_change_the_likelihood(maxima):
    sticks, maximum = maxima[0]
    cycles = Likelihood(sticks, maximum.nodes[0])(maximum.theta)
    finer = Nodes.about(cycles.log_strength, np.maximum(cycles.log_strength_sd, 0.03), 41)
    again = Likelihood(sticks, finer)(maximum.theta)
    assert again.log_likelihood.sum() == pytest.approx(cycles.log_likelihood.sum(), abs=0.05)


@pytest.fixture(scope="module")
def answer(tracks):
    """What the estimator says of the first track."""
    return fit(scene_of(STIFF), [tracks[0].record], estimator=UnevenEstimator())


def test_a_fit_tells_quantities_with_verdicts(answer):
    result = answer.result
    assert (result["status"], result["estimator"]) == ("converged", "uneven")
    assert not result["not_tried"], "there was time for all"
    assert validator().is_valid(plain(result))
    told = result["parameters"]
    assert all(told[name]["value"] is None and told[name]["reason"] for name in ("mu_s", "mu_k0", "a", "D"))
    for name in ("strength", "weakening_length", "mass"):
        low, high = told[name]["interval"]
        assert low < told[name]["value"] < high and told[name]["verdict"] in ("identified", "weak")
        # Student's t: as many degrees of freedom as there are cycles beyond the parameters.
        freedom = len(result["uneven_cycles"][0]["cycle"]) - len(PARAMETERS)
        wide = 2.0 * stats.t(freedom).ppf(0.975) * told[name]["standard_error"] / told[name]["value"]
        assert freedom < 30 and np.log(high / low) == pytest.approx(wide)
    assert told["mass"]["value"] == pytest.approx(STIFF.mass, rel=0.2) and told["mass"]["verdict"] == "weak"
    assert told["stiffness"]["value"] == pytest.approx(STIFF.stiffness, rel=0.03)
    assert told["damping"]["verdict"] in ("weak", "bounded") and len(result["starts"]) == 3
    assert any("velocity_weakening" in note for note in result["notes"])
    drop = result["distributions"]["drop"]["quantiles"]
    assert drop["5"]["value"] < drop["50"]["value"] < drop["95"]["value"]
    assert any("Extrapolated" in note for note in result["notes"])


def test_the_creep_time_is_bounded_from_above_only_where_friction_cannot_fall_with_speed(tracks, answer):
    scene = scene_of(STIFF)
    known = scene.with_effects([name for name in scene.effects if name != "velocity_weakening"])
    other = fit(known, [tracks[0].record], estimator=UnevenEstimator())
    free, told = (found.result["parameters"]["t_cr"] for found in (answer, other))
    assert told["verdict"] == "bounded" and told["interval"][1] > STIFF.creep_time
    assert free["interval"][1] is None and "friction may fall with sliding speed" in free["reason"]


def test_something_soft_in_series_is_in_the_stiffness_that_slips_feel():
    softer = replace(STIFF, stiffness=STIFF.stiffness * 0.7)  # rig and skin in series; the scene states the rig alone
    log = prepared(STIFF, simulated(softer, 24, [5])[0].record)
    stated, shown = (sticks_of(log, in_series=series).rig for series in (False, True))
    for rig in (stated, shown):
        assert rig.stiffness == pytest.approx(softer.stiffness / STIFF.load, rel=0.03)
    assert shown.error < 0.03 and stated.error == pytest.approx(-np.log(0.7), abs=0.03)
    assert shown.drive_speed == pytest.approx(STIFF.drive_speed)


def test_a_law_that_cannot_be_followed_ends_without_a_maximum(maxima):
    sticks, maximum = maxima[0]
    lost = maximum.theta.copy()
    lost[PARAMETERS.index("mass")] = -400.0
    assert not maximise([sticks], start=lost).converged


def test_what_only_the_course_of_a_slip_tells_is_withheld_without_it(tracks):
    result = fit(scene_of(STIFF), [at_rate(tracks[0].record, 50.0)], estimator=UnevenEstimator()).result
    told = result["parameters"]
    assert result["status"] == "converged" and told["strength"]["verdict"] in ("identified", "weak")
    for name in ("weakening_length", "mass"):
        assert told[name]["value"] is None and "sampling rate" in told[name]["reason"]


def test_a_short_record_is_refused_with_a_sentence(tracks):
    record = tracks[0].record
    rows = record.time < record.time[-1] / 5.0
    short = replace(
        record,
        time=record.time[rows],
        normal_force=record.normal_force[rows],
        friction_force=record.friction_force[rows],
        steps=(),
    )
    result = fit(scene_of(STIFF), [short], estimator=UnevenEstimator()).result
    assert result["status"] == "no_cycles" and "at least 12" in result["message"]


def test_a_plain_fit_that_fails_on_cycles_that_differ_is_followed_by_the_uneven_one(tracks, tmp_path):
    outcome = fit(scene_of(STIFF), [tracks[1].record])
    result = outcome.result
    assert (result["status"], result["estimator"]) == ("converged", "uneven")
    tried = [trial["strategy"] for trial in result["search"]]
    assert tried[0] == "feature start" and tried[-1] == "uneven estimator"
    assert "differs from cycle to cycle" in result["message"]
    assert result["logs"][0]["reason_left_out"] is None
    said = repr(outcome)
    assert "extrapolated" in said and "static peak" in said and "1/√mm" in said
    with pytest.raises(FitError, match=r"drop .* of the load .*extrapolated"):
        outcome.predict(drive_speed="1 mm/s")
    write_report(outcome, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "described cycle by cycle" in page and "a stick holds" in page and "log_1_uneven" in page
    assert "cycle to cycle as measured" in page and "motion as fitted" not in page
    assert "From all of track.csv" in page and "nine of ten drawn cycles" in page
    assert "Found by uneven estimator" in page and "No answer was found" not in page
    assert "interval with tolerances" not in page and "stands under" not in page
    assert f"after the typical rest ({np.median(result['uneven_cycles'][0]['rest_s'][1:]):.3g} s)" in page


def test_the_effect_asks_for_the_uneven_estimator_at_once(tracks):
    scene = scene_of(STIFF)
    asked = scene.with_effects((*scene.effects, "friction_heterogeneity"))
    result = fit(asked, [tracks[1].record]).result
    assert (result["status"], result["estimator"], result["search"]) == ("converged", "uneven", [])
    assert "friction_heterogeneity" in result["provenance"]["scene"]["effects"]


def test_records_that_share_nothing_are_told_apart(maxima):
    records, found = [sticks for sticks, _ in maxima[:2]], [maximum for _, maximum in maxima[:2]]
    assert agreement(maximise(records), found) > APART
    stronger = replace(records[1], line=1.3 * records[1].line, arrest=1.3 * records[1].arrest)
    other = [records[0], replace(stronger, force=1.3 * records[1].force, above=1.3 * records[1].above)]
    assert agreement(maximise(other), [found[0], maximise(other[1:])]) < APART


def test_records_of_two_speeds_and_loads_share_strength_and_mass(tracks, maxima):
    """Twice as fast, rests are a third as long and sticks half as strong; twice the load, the mass is the same."""
    fast = replace(STIFF, drive_speed=2.0 * STIFF.drive_speed, load=2.0 * STIFF.load, stiffness=2.0 * STIFF.stiffness)
    other = sticks_of(prepared(fast, simulated(fast, 36, [11])[0].record))
    slow, found = maxima[0]
    assert other.usual_rest < 0.5 * slow.usual_rest
    alone = [found, maximise([other])]  # the likelihood by itself does not hang on the rest for which strength is told
    joint = maximise(of_one_body([slow, other]))
    assert joint.converged and agreement(joint, alone) > APART
    assert agreement(maximise([slow, other]), alone) < APART, "each with the strength after its own rests"
    error, sd = (
        joint.theta[:LAW] - truth_of(STIFF, of_one_body([slow, other])[0].usual_rest),
        np.sqrt(np.diag(joint.covariance))[:LAW],
    )
    told = [*TOLD, PARAMETERS.index("t_cr")]
    assert np.abs(error / sd)[told].max() < 3.0
    creep = PARAMETERS.index("t_cr")
    assert sd[creep] < 0.25 < np.sqrt(found.covariance[creep, creep]), "two speeds tell the creep time, one does not"


def test_a_record_is_not_predicted_by_others_without_a_maximum(maxima, monkeypatch):
    """As where the time is up while records are left out in turn."""
    records, found = [sticks for sticks, _ in maxima], [maximum for _, maximum in maxima]
    elsewhere = [replace(s, rig=replace(s.rig, rate=s.rig.rate * (i + 1))) for i, s in enumerate(records)]
    unknown = np.full_like(found[0].covariance, np.nan)
    cut = replace(found[0], converged=False, in_time=False, covariance=unknown)
    monkeypatch.setattr(transfer, "maximise", lambda *_: cut)
    assert transfer.left_out([0, 1, 2], elsewhere, found, {}, 0) == []


def test_compare_pools_what_uneven_pairs_have(answer):
    told = values([FitEntry(name, Path(), "converged", "", result=answer.typed) for name in ("first", "second")])
    pooled = {q.name: q for q in told.quantities}
    assert pooled["strength"].logarithmic and "weakening_length" in pooled and "mu_s" not in pooled


def test_the_study_of_other_cycles_foretells_drop_and_period():
    """Control: cycles whose mean is off by a third do not agree."""
    found = run_uneven_prediction.main(fast=True)
    assert [q.agrees for q in found] == [(True, True)] * 2
    assert not any(replace(q, ratio=4.0 / 3.0).agrees[0] for q in found)
