"""What a log is expected to tell: against longer simulations, closed forms and what a rig can do."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.study_problem import DEMO, RIG
from identify import Scene
from identify.bench.design import LogDesign, choose, promised, simulated_log, with_holds
from identify.bench.plan import Choices, plan
from identify.effects import MAIN
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.shooting.transcription import BOUNDED_START_SD
from identify.simulation.simulate import run

ALL = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")


def scene(free=("mu_s", "t_cr"), **rig):
    """All but some parameters are known."""
    parameters = {name: {"start": v} if name in free else {"fixed": v} for name, v in DEMO.items()}
    stated = {**RIG, "drive_speed": 1e-3, "normal_force": 1.0, "noise": 5e-3, **rig}
    effects = [*MAIN, "varying_normal_force"]
    return Scene.from_document({"effects": effects, "rig": stated, "parameters": parameters})


def simulated(design, free=("mu_s", "t_cr"), values=DEMO | RIG, longest=60.0):
    unknowns = from_scene(scene(free))
    base = unknowns.base({name: values[name] for name in RIG})
    theta = unknowns.theta(np.array([values[name] for name in unknowns.names]), base)
    return simulated_log(unknowns, theta, base, design, longest)


@pytest.fixture(scope="module")
def planned():
    """At 20 mm/s and this load the mass slides on: without holds a log shows one peak."""
    return plan(scene(), (), Choices(speeds=(2e-2,), holds=(0.2, 1.0, 5.0)))


def test_a_long_log_tells_what_its_simulation_to_the_end_does():
    """A shared period makes many slips tell more than as many logs of few; a part of a log tells that part."""
    made, load = simulated(LogDesign(1e-3, 1.0), ALL), 1.0
    assert made.period > 0.0 and made.slips == 4
    seconds = made.duration + 20.0 * made.period
    whole = simulated(LogDesign(((0.0, 1e-3),), load, None, seconds), ALL)  # a programme is simulated to its end
    assert whole.slips == 24
    errors = []
    for load_sd in (0.0, 1e-4, 1e-2):
        times = seconds / made.duration
        matrices = (
            made.information(1000.0, 25e-6, load_sd, times),
            whole.information(1000.0, 25e-6, load_sd),
            times * made.information(1000.0, 25e-6, load_sd),
        )
        sd, true, as_often = (np.sqrt(np.diag(np.linalg.inv(matrix))) for matrix in matrices)
        np.testing.assert_allclose(sd, true, rtol=0.03)
        assert np.max(np.abs(as_often / true - 1.0)) > 0.05
        errors.append(true)
    # Slips whose loads repeat exactly would time every onset: a promise that no record keeps.
    assert np.max(errors[2] / errors[0]) > 1.7
    np.testing.assert_allclose(made.information(1000.0, 25e-6, 1e-4, 0.5), 0.5 * made.information(1000.0, 25e-6, 1e-4))


def test_the_load_acts_as_all_coefficients_together():
    """Friction is load times a coefficient that is linear in these three: Euler's theorem on homogeneous functions."""
    made = simulated(LogDesign(1e-4, 1.0), ALL)
    gram = made.sensitivity.T @ (made.sensitivity * made.weights[:, None])
    unknowns = from_scene(scene(ALL))
    names = [unknowns.names[i] for i in np.flatnonzero(unknowns.free)]
    three = [names.index(name) for name in ("mu_s", "mu_k0", "delta_mu_k")]
    share = np.array([DEMO["mu_s"], DEMO["mu_k0"], DEMO["delta_mu_k"]])
    together = share @ gram[np.ix_(three, three)] @ share
    assert gram[made.shared :, made.shared :].sum() == pytest.approx(together, rel=1e-3)
    assert gram[three[0], three[0]] != pytest.approx(together, rel=0.1)


def test_the_contact_at_the_start_is_as_open_as_a_fit_takes_it_to_be():
    """What the first stick tells hangs on how fresh the contact was, of which a fit knows a little."""
    made = simulated(LogDesign(1e-3, 1.0))
    assert made.start_sd.tolist() == [np.inf, BOUNDED_START_SD]
    open_, known = (replace(made, start_sd=np.array([np.inf, sd])) for sd in (np.inf, 1e-9))
    told = [np.linalg.inv(log.information(50.0, 1.0, 0.0))[1, 1] for log in (known, made, open_)]
    assert 1.1 * told[0] < told[1] < told[2] / 1.1


def test_a_log_in_which_the_spring_pulls_the_mass_back_is_none_to_ask_for():
    pair = {"mu_s": 0.4053, "mu_k0": 0.1612, "delta_mu_k": -0.07649, "a": 606.2, "D": 39.93e-6, "t_cr": 0.4138}
    rig = {"mass": 0.2006, "stiffness": 1901.0, "damping": 158.9}
    made = []
    for damping in (rig["damping"], 3 * rig["damping"]):  # with more of it the mass stops before the spring is loose
        values = pair | rig | {"damping": damping}
        motion = run(assemble(MAIN), values, 1e-4, 1.0, 20.0)
        made.append((motion.arrests.size - motion.onsets.size, simulated(LogDesign(1e-4, 1.0), ALL, values, 20.0)))
    assert made[0][0] > 0 and made[0][1] is None
    assert made[1][0] <= 0 and made[1][1] is not None


def test_the_drive_stops_where_no_slip_is_near(planned):
    """A slip in which the drive stops tells little, and is another one where the pair is a little different."""
    known = planned.knowledge
    design = with_holds(known.unknowns, known.places[0], known.base, LogDesign(3e-3, 1.0), (1.0, 3.0, 10.0))
    assert design.holds == pytest.approx((1.0, 3.0, 10.0))
    drive = [*design.drive, (design.duration, 0.0)]
    for number in range(1, len(drive), 2):
        stop, restart = drive[number][0], drive[number - 1][0]
        seen = run(assemble(MAIN), DEMO | RIG, tuple(drive[:number]), 1.0, stop + 1.0)  # as if it ran on
        arrest = float(seen.arrests[seen.arrests < stop][-1])
        onset = float(seen.onsets[seen.onsets > arrest][0])
        assert arrest > restart and min(stop - arrest, onset - stop) > 0.2 * (onset - arrest)


def test_holds_tell_the_ageing_that_one_peak_leaves_open(planned):
    (log,) = (log for log in planned.logs if log.design.holds)
    assert log.design.holds == pytest.approx((0.2, 1.0, 5.0)) and "t_cr" in log.identifies
    assert all(promised(planned.then)[i] < 0.2 for i in planned.knowledge.targeted)
    assert promised(planned.now)[planned.knowledge.names.index("t_cr")] > 10.0


def test_no_log_is_planned_that_a_fit_cannot_follow(planned):
    """Chosen again, a log becomes longer: of thousands of slips, in eight minutes, a fit at its limit knew nothing."""
    before = planned.knowledge
    fresh = {"_logs": {}, "_informed": {}}
    known = replace(before, variance=1.0, places=before.places[:1], precision=before.precision[:1], **fresh)
    for design in (LogDesign(3e-3, 1.0), LogDesign(1e-4, 1.0)):
        (log,) = choose(known, [design], 3600.0)
        assert log.times > 6 and log.slips <= 300 and log.duration <= known.longest


def test_a_promise_holds_at_three_of_four_places(planned):
    """Before any test the pair may be another one: what is told at half of the places only is not told."""
    known, places = planned.knowledge, len(planned.knowledge.places)
    assert places == 4
    precisions = np.array([np.diag([1e6, 1e6]) if place < 2 else np.diag([1e6, 1.0]) for place in range(places)])
    assert set(known.identified(precisions)) == {"mu_s"}
    precisions[2] = precisions[0]
    assert set(known.identified(precisions)) == {"mu_s", "t_cr"}


def test_errors_of_rig_and_sensors_are_lowered_by_no_log(planned):
    known = replace(planned.knowledge, systematic=np.array([0.0, 0.05**2]))
    exact, more = (k.halves(1e9 * np.array([np.eye(2)] * 4)) for k in (planned.knowledge, known))
    assert np.all(exact < 1e-3) and np.allclose(more[:, 1], np.expm1(1.96 * 0.05), rtol=1e-3)


def test_a_softer_spring_is_simulated_with_the_damping_ratio_kept():
    unknowns = from_scene(scene())
    base = LogDesign(1e-3, 1.0, 735.0).base(unknowns, unknowns.base(RIG))
    softer = dict(zip(unknowns.names, base.tolist(), strict=True))
    assert softer["stiffness"] == 735.0 and softer["damping"] == pytest.approx(73.5) and softer["mass"] == 0.2
    soft, stiff = simulated(LogDesign(1e-3, 1.0, 735.0)), simulated(LogDesign(1e-3, 1.0))
    assert soft.duration / soft.slips > 1.5 * stiff.duration / stiff.slips
