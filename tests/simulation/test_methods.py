"""Integration methods: stated orders, located switches, dense output, accuracy kept, and what they cost."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.integrate._ivp import dop853_coefficients

from experiments.reference_methods import ALL, BOGACKI_SHAMPINE, DORMAND_PRINCE, LOW, MIDDLE
from identify.base.errors import SimulationError
from identify.model.model import SPEED, assemble
from identify.simulation import steppers
from identify.simulation.plan import ACCURACY, Stepping, accuracy_for, scales
from identify.simulation.simulate import run
from identify.simulation.stepper import Situated, trial
from identify.simulation.steppers import HIGH, STIFF, Method
from identify.simulation.trajectory import distance
from tests.simulation.test_simulate import MODEL, PAIR, STEPS
from tests.support import oracle

P = np.array([PAIR[name] for name in MODEL.parameter_names])
START = np.array([4.2e-4, 0.02, 0.6])  # in the middle of a slip
SITUATED = Situated(P, 1e-3, 1.0, 1.0, 0.0)
LINEAR_NAMES = ("inertia", "hysteresis_damping", "linear_weakening")
PLAIN = {"mu_s": 0.62, "mu_k0": 0.43, "stiffness": 1470.0, "mass": 0.2, "damping": 147.0, "slope": -2.0}


def _slip_exactly(duration: float) -> np.ndarray:
    """The slip from START by scipy's DOP853 on equations (1), (2), (5), (6), written out here."""
    q = PAIR
    c = q["damping"] * np.sqrt(q["mass"] / q["stiffness"])

    def rates(_t: float, y: np.ndarray) -> list[float]:
        x, v, g = y
        kinetic = q["mu_k0"] + q["delta_mu_k"] * -np.expm1(-q["a"] * v)
        friction = kinetic + (q["mu_s"] - kinetic) * g
        pull = q["stiffness"] * x + c * (1e-3 - v)
        return [1e-3 - v, (pull - friction) / q["mass"], (1 - g) / q["t_cr"] - v / q["D"]]

    return solve_ivp(rates, (0.0, duration), START, "DOP853", rtol=1e-13, atol=1e-18).y[:, -1]


def _fixed_steps(method: Method, duration: float, count: int) -> np.ndarray:
    """The same with `count` equal steps of one of our methods."""
    function, x = trial(MODEL, method, "slip"), START
    for i in range(count):
        h = duration / count
        row = function(np.append(x, [i * h, h]), np.append(SITUATED.p, SITUATED.numbers(MODEL)), np.full(4, 1e-6))
        x = np.array(row).ravel()[:3]
    return x


def slope(counts: np.ndarray, errors: np.ndarray) -> float:
    """Order measured: minus the slope of log(error) over log(steps)."""
    return -float(np.polyfit(np.log(counts), np.log(errors), 1)[0])


@pytest.mark.parametrize(
    ("method", "counts"),
    [(LOW, (96, 192, 384)), (MIDDLE, (48, 64, 96)), (HIGH, (8, 10, 12)), (STIFF, (48, 64, 96))],
    ids=lambda value: getattr(value, "name", ""),
)
def test_measured_order_is_the_stated_one(method: Method, counts: tuple[int, ...]) -> None:
    duration = 0.012
    truth = _slip_exactly(duration)
    errors = [abs(_fixed_steps(method, duration, n)[SPEED] / truth[SPEED] - 1.0) for n in counts]
    assert slope(np.array(counts), np.array(errors)) == pytest.approx(method.order, abs=0.2)


def test_tableaus_are_consistent_and_the_high_one_is_scipys() -> None:
    for tableau in (steppers.RK4, steppers.DOP853, DORMAND_PRINCE, BOGACKI_SHAMPINE):
        assert sum(tableau.b) == pytest.approx(1.0, abs=1e-14)
        assert [sum(row) for row in tableau.a] == pytest.approx(list(tableau.c), abs=1e-14)
        for error in (tableau.error, tableau.coarse):
            assert sum(error) == pytest.approx(0.0, abs=1e-14)
    n = len(steppers.DOP853.c)
    assert n == dop853_coefficients.N_STAGES
    for i, row in enumerate(steppers.DOP853.a):
        assert list(row) == dop853_coefficients.A[i, :i].tolist()
    assert list(steppers.DOP853.error) == dop853_coefficients.E5[:n].tolist()
    assert list(steppers.DOP853.coarse) == dop853_coefficients.E3[:n].tolist()


@pytest.mark.parametrize("method", ALL, ids=lambda method: method.name)
def test_every_method_locates_switches_and_samples_densely(method: Method) -> None:
    rtol = 1e-7 if method is LOW else 1e-10
    truth = oracle.simulate(PAIR, 1e-3, 1.0, 1.0)
    found = run(MODEL, PAIR, 1e-3, 1.0, 1.0, accuracy=Stepping(rtol, method))
    for ours, theirs in zip(
        (found.onsets, found.arrests, found.wear_times), (truth.onsets, truth.arrests, truth.wear_times), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, atol=30 * rtol)
    times = np.linspace(0.0, 1.0, 3001)
    np.testing.assert_allclose(found.sample(times)["force"], truth.force(times), atol=100 * rtol)
    assert found.methods == (method.name,)


def _eq13_arrest() -> float:
    """Duration of the first slip of PLAIN at 1 mm/s, eq. (13): xi' = 1 again, by bisection on the closed form."""
    k, m, v0 = PLAIN["stiffness"], PLAIN["mass"], 1e-3
    omega = np.sqrt(k / m)
    alpha = PLAIN["damping"] / (2 * k) + PLAIN["slope"] / (2 * np.sqrt(m * k))
    w = 1.0 / (v0 * np.sqrt(m * k))
    overshoot = w * (PLAIN["mu_s"] - PLAIN["mu_k0"] - PLAIN["slope"] * v0) - PLAIN["damping"] / k
    damped = np.sqrt(1 - alpha**2)

    def speed(tau: float) -> float:
        """xi'(tau) of xi'' + 2 alpha xi' + xi = 0, xi(0) = overshoot, xi'(0) = 1."""
        swing = (alpha + overshoot) / damped
        return float(np.exp(-alpha * tau) * (np.cos(damped * tau) - swing * np.sin(damped * tau)))

    low, high = np.pi, 2 * np.pi
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if speed(middle) < 1.0 else (low, middle)
    return low / omega


@pytest.mark.parametrize("method", ALL, ids=lambda method: method.name)
def test_a_linear_slip_ends_where_eq_13_says(method: Method) -> None:
    model = assemble(LINEAR_NAMES)
    rtol = 1e-8 if method is LOW else 1e-12
    found = run(model, PLAIN, 1e-3, 1.0, 0.6, accuracy=Stepping(rtol, method))
    duration = found.arrests[0] - found.onsets[0]
    assert duration == pytest.approx(_eq13_arrest(), rel=30 * rtol)


def test_stiff_motion_is_left_to_the_implicit_method() -> None:
    """A load cell that follows within two microseconds: a decay four orders faster than the slip."""
    names = ("inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening", "sensor_lag")
    model, values = assemble(names), PAIR | {"lag_time": 2e-6}
    p = np.array([values[name] for name in model.parameter_names])
    assert Stepping(1e-7).methods(scales(model, p, 1.0).stiff)[0] == STIFF
    found = run(model, values, 1e-3, 1.0, 1.0, accuracy=1e-6)
    assert found.methods == (STIFF.name,)
    np.testing.assert_allclose(found.onsets, run(MODEL, PAIR, 1e-3, 1.0, 1.0).onsets, atol=1e-7)


def test_the_next_method_takes_over_where_one_is_held_back() -> None:
    """Sliding for 1e5 natural times: the explicit method is held to steps of the natural time, the implicit one not."""
    smooth = PAIR | {"delta_mu_k": 0.01}
    found = run(MODEL, smooth, 0.05, 1.0, 2000.0, accuracy=1e-6)
    assert set(found.methods) >= {STIFF.name}
    force = smooth["mu_k0"] + 0.01 * -np.expm1(-300.0 * 0.05)
    assert found.sample([2000.0])["force"] == pytest.approx(force, rel=1e-6)


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("scene", ["plain", "steps"])
def test_the_accuracy_asked_for_is_met_and_the_error_is_estimated(scene: str, accuracy: float) -> None:
    drive, duration = (1e-3, 2.0) if scene == "plain" else (STEPS, 3.5)
    truth = run(MODEL, PAIR, drive, 1.0, duration, accuracy=Stepping(1e-13, HIGH))
    found = run(MODEL, PAIR, drive, 1.0, duration, accuracy=accuracy)
    error = distance(found, truth)
    assert found.achieved is not None
    assert error.switches < accuracy
    assert error.forces < 10 * accuracy
    assert error.switches <= found.achieved.switches < 1e3 * max(error.switches, 1e-12)
    assert error.forces <= found.achieved.forces


@pytest.mark.parametrize(
    ("drive", "duration", "accuracy"),
    [(0.5 * PAIR["D"] / PAIR["t_cr"], 5.0, 1e-5), (20e-3, 2.0, 1e-2), (1e-3, 2.0, 1e-10)],
    ids=["forces too coarse", "other slips", "fine as it is"],
)
def test_a_motion_is_refined_until_its_estimated_errors_meet_the_accuracy(
    drive: float, duration: float, accuracy: float
) -> None:
    first = run(MODEL, PAIR, drive, 1.0, duration, accuracy=accuracy)
    truth = run(MODEL, PAIR, drive, 1.0, duration, accuracy=Stepping(1e-13, HIGH))
    assert first.achieved is not None
    before = max(distance(first, truth).switches, distance(first, truth).forces)
    missed = max(first.achieved.switches, first.achieved.forces) > accuracy
    found = first.refined()
    assert (found is first) == (not missed)
    assert found.achieved is not None and found.accuracy == accuracy
    after = distance(found, truth)
    assert max(after.switches, after.forces) <= max(found.achieved.switches, found.achieved.forces) <= accuracy
    assert not missed or before > accuracy  # what is refined was worth it


def test_an_estimate_that_sees_other_switches_is_infinite() -> None:
    ours, theirs = (run(MODEL, PAIR | {"mu_s": mu}, 1e-3, 1.0, 2.0) for mu in (0.62, 0.82))
    assert np.isinf(distance(ours, theirs).switches)


def test_the_default_follows_from_the_noise() -> None:
    assert accuracy_for(None, 0.6) == accuracy_for(0.0, 0.6) == ACCURACY
    assert accuracy_for(6e-6, 0.6) == pytest.approx(1e-6)
    assert accuracy_for(0.1, 0.6) <= 1e-4
    with pytest.raises(SimulationError, match="between 0 and 1"):
        run(MODEL, PAIR, 1e-3, 1.0, 1.0, accuracy=0.0)


def test_orders_hold_through_switches_and_are_lost_where_these_are_not_located() -> None:
    from experiments.run_work_precision import orders

    for found in orders():
        assert found.located == pytest.approx(found.method.order, abs=0.2), found.method.name
        assert found.not_located < 2.0, found.method.name


def test_a_record_sampled_in_one_go_is_what_its_parts_are() -> None:
    motion = run(MODEL, PAIR, 1e-3, 1.0, 1.0)
    times = np.linspace(0.0, 1.0, 700)
    whole = motion.sample(times)
    for name, values in whole.items():
        single = [float(motion.sample([t])[name][0]) for t in times[::23]]
        np.testing.assert_allclose(values[::23], single, rtol=1e-12, atol=1e-15, err_msg=name)
