"""Uneven records: what the estimator says of simulated tracks whose truth is known, and of the measured ones."""

import time
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp

from experiments.uneven_records import STIFF, prepared, scene_of, simulated, truth_of
from identify import fit
from identify.base.budget import time_limit
from identify.base.document import to_dict
from identify.base.errors import FitError
from identify.logs.unknowns import from_scene
from identify.report import write_report
from identify.scene import Scene
from identify.uneven.answer import UnevenEstimator, creep_estimate, creep_interval, observed_distributions, stated_rig
from identify.uneven.estimator import APART, LAW_ERROR, agreement, mass_of, maximise, pooled_mass
from identify.uneven.events import RigConstants, of_one_body, sticks_of
from identify.uneven.likelihood import Likelihood, Nodes
from identify.uneven.slip_functions import ONSET, PARAMETERS, THETA, slip_functions
from tests.support.document_check import validator

pytestmark = pytest.mark.usefixtures("shared_machine_code")

WANTED = [PARAMETERS.index(name) for name in ("strength", "weakening_rate", "mass")]
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
    assert all(sd[:, PARAMETERS.index("mass")] < 0.1) and sd[:, WANTED].max() < 0.5
    for (_, maximum), truth in zip(maxima, truths, strict=True):
        assert all(lies_within(truth[PARAMETERS.index(n)], maximum.interval(ROWS[n])) for n in ("strength", "mass"))
    assert np.abs((found[:, :LAW] - truths)[:, WANTED].mean(axis=0)).max() < 0.25


def test_onsets_and_cycles_are_those_of_the_track(tracks, maxima):
    for track, (sticks, _) in zip(tracks, maxima, strict=True):
        last = sticks.anchor + sticks.time[:, -1]
        arrest = track.arrest[np.searchsorted(track.arrest, last)]
        assert sticks.count >= 0.9 * track.onset.size
        assert np.median(arrest - last) < 6e-3  # a slip takes about 20 ms


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


def test_what_a_scene_states_with_a_tolerance_is_a_prior_and_a_nominal_value_is_none():
    document = scene_of(STIFF).as_document()
    loose = Scene.from_document(document)
    assert stated_rig(loose, from_scene(loose)) == {}
    tight = Scene.from_document(document | {"rig": document["rig"] | {"mass": {"value": "20 g", "tolerance": "5 %"}}})
    assert stated_rig(tight, from_scene(tight))["mass"] == pytest.approx((np.log(0.020), 0.05))


def test_masses_of_records_are_pooled_with_their_scatter(maxima):
    """Against the closed form of a weighted mean of two equal masses, and a third one off by a factor of four."""
    sticks, maximum = maxima[0]
    alike = pooled_mass([sticks, sticks], [maximum, maximum])
    one = mass_of(maximum, sticks.rig.error)
    assert alike.scatter == pytest.approx((0.0, 1, 1.0), abs=1e-9) and alike.scatter[2] > APART
    assert one.lower < alike.lower < alike.upper < one.upper
    heavier = {name: getattr(maximum, name) + np.log(4.0) * ROWS["mass"] for name in ("theta", "fixed")}
    off = replace(maximum, **heavier)
    apart = pooled_mass([sticks, sticks], [maximum, off])
    sd = np.log(one.upper / one.lower) / (2.0 * maximum.quantile)
    assert sd > LAW_ERROR and apart.scatter[0] == pytest.approx(np.log(4.0) ** 2 / (2.0 * sd**2), rel=0.2)
    assert apart.scatter[2] < APART


def test_the_creep_time_is_bounded_from_above_only_where_friction_cannot_fall_with_speed(maxima):
    sticks, maximum = maxima[0]
    creep = creep_interval([sticks], maximum)
    free, known = (creep_estimate(creep, sticks.usual_rest, by_speed) for by_speed in (True, False))
    assert known.verdict == "bounded" and STIFF.creep_time < known.upper < 100.0 * sticks.usual_rest
    assert free.upper is None and "does not fall with sliding speed" in free.reason
    place, unknown = PARAMETERS.index("t_cr"), maximum.covariance.copy()
    unknown[place, place] = 50.0**2  # of its logarithm: beyond all rests
    assert creep_interval([sticks], replace(maximum, covariance=unknown)) == (None, None)


def test_late_anchors_lose_the_strength(maxima):
    """The negative control: with slips that are seen only when a quarter of them is over, the answer is wrong."""
    sticks, maximum = maxima[0]
    rows = np.arange(sticks.count)
    fallen = (sticks.line[:, None] + sticks.rig.rate * sticks.time - sticks.force) > 0.25 * sticks.drop[:, None]
    first = np.minimum(np.argmax(fallen, axis=1), sticks.samples - 2)
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
    assert np.abs((wrong.theta - maximum.theta)[WANTED]).max() > 0.3


def test_the_onset_grows_as_the_equation_of_motion_says():
    rig, slid, zeta = RigConstants(stiffness=3300.0, rate=0.14), 2e-6, 0.018
    for weakening, mass, speed_term in ((7000.0, 0.06, 0.0), (4500.0, 0.05, 0.0), (7000.0, 0.06, 0.2)):
        theta = np.append(np.log([0.05, weakening, 0.1, mass, 1.0, 0.2, 0.01, zeta]), [speed_term, 0.0])
        stick = np.array([[rig.stiffness * slid, 0.3, 1.0, 1.0, 1.0]])
        onset = slip_functions().onset([theta[None, :], np.array([rig.over_load(0.0)]), stick])[0][0]
        time, speed = onset[ONSET.index("earlier")], onset[ONSET.index("speed")]
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
    spread = np.maximum(cycles.log_strength_sd, 0.03)[:, None] * np.linspace(-4.0, 4.0, 41)
    finer = Nodes(cycles.log_strength[:, None] + spread)
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
    assert validator().is_valid(to_dict(result))
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


def test_intervals_of_quantiles_hold_where_neighbours_are_alike(maxima):
    """Peaks of a known median, each half like the one before; intervals for independent ones miss it too often."""
    (sticks, _), random, held, apart = maxima[0], np.random.default_rng(6), [], []
    for _ in range(150):
        peak = random.standard_normal(100)
        for i in range(1, peak.size):
            peak[i] = 0.5 * peak[i - 1] + np.sqrt(0.75) * peak[i]
        drawn = replace(sticks, line=10.0 + peak, arrest=0.0 * peak)
        entry = observed_distributions(drawn, 1)["static_peak"]["quantiles"]["50"]
        held.append(lies_within(10.0, entry["interval"]))
        half = 1.96 * 1.2533 * np.std(peak) / np.sqrt(peak.size)  # of the median of independent ones
        apart.append(lies_within(10.0, (entry["value"] - half, entry["value"] + half)))
    assert np.mean(held) > 0.85 > np.mean(apart)


def test_a_law_that_cannot_be_followed_ends_without_a_maximum(maxima):
    sticks, maximum = maxima[0]
    lost = maximum.theta.copy()
    lost[PARAMETERS.index("mass")] = -400.0
    assert not maximise([sticks], start=lost).converged


def test_the_effect_asks_for_the_uneven_estimator_at_once_and_its_report_says_so(tracks, tmp_path):
    """That it also follows a plain fit that fails: tests/cli/test_worked_example.py."""
    scene = scene_of(STIFF)
    outcome = fit(scene.with_effects((*scene.effects, "friction_heterogeneity")), [tracks[1].record])
    result, shown = outcome.result, repr(outcome)
    assert (result["status"], result["estimator"], result["search"]) == ("converged", "uneven", [])
    assert "differs from cycle to cycle" in result["message"] and result["logs"][0]["reason_left_out"] is None
    assert "friction_heterogeneity" in result["provenance"]["scene"]["effects"]
    assert "extrapolated" in shown and "static peak" in shown and "1/√mm" in shown
    with pytest.raises(FitError, match="of the record alone"):
        outcome.predict(drive_speed="1 mm/s")
    write_report(outcome, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for words in ("described cycle by cycle", "log_1_uneven", "cycle to cycle as measured", "nine of ten cycles"):
        assert words in page
    assert not any(words in page for words in ("motion as fitted", "No answer was found", "interval with tolerances"))
    assert f"after the typical rest ({np.median(result['uneven_cycles'][0]['rest_s'][1:]):.3g} s)" in page


@pytest.mark.slow
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
    told = [*WANTED, PARAMETERS.index("t_cr")]
    assert np.abs(error / sd)[told].max() < 3.0
    creep = PARAMETERS.index("t_cr")
    assert sd[creep] < 0.25 < np.sqrt(found.covariance[creep, creep]), "two speeds tell the creep time, one does not"


@pytest.mark.parametrize(
    ("rate", "share", "sentence"), [(50.0, 1.0, "higher sampling rate"), (2000.0, 0.2, "at least 12")]
)
def test_records_without_resolved_slips_or_with_too_few_are_refused(tracks, rate, share, sentence):
    """At 50 Hz a slip of 23 ms has one sample or two."""
    record = tracks[0].record
    rows = slice(0, int(share * record.time.size), round(2000.0 / rate))
    fewer = {name: getattr(record, name)[rows] for name in ("time", "normal_force", "friction_force")}
    result = fit(scene_of(STIFF), [replace(record, **fewer, steps=())], estimator=UnevenEstimator()).result
    assert result["status"] == "no_cycles" and sentence in result["message"]


# Time limits.


def test_a_limit_is_kept_and_what_it_left_out_is_named(tracks):
    limit, began = 0.3, time.process_time()
    scene = Scene.from_document({**scene_of(STIFF).as_document(), "fit": {"time_limit": limit}})
    result = fit(scene, [tracks[0].record], estimator=UnevenEstimator()).result
    assert time.process_time() - began < limit + 3.0  # reading and detecting cycles come before it
    assert result["not_tried"] and f"the time limit of {limit:g} s left no time for" in result["message"]


def test_a_search_that_was_cut_is_no_answer(maxima):
    sticks, whole = maxima[0]
    with time_limit(0.01):
        cut = maximise([sticks])
    assert whole.in_time and not cut.in_time and not cut.converged
    assert not np.any(np.isfinite(cut.covariance))  # nor is time spent on its uncertainty
