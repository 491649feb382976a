"""Closed forms against reference values, and in 60 digits over the whole of their ranges, with their derivatives."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from identify import ageing, amplitude, stability
from identify.prediction.closed_forms import closed_forms
from tests.support import closed_form_case as plain
from tests.support.maps_case import DEMO

REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "reference.json").read_text())
FEW = settings(max_examples=40, deadline=None, derandomize=True)
LARGEST = mp.mpf("1e308")
PAIR = DEMO | {"a": 3.0, "drive_speed": 1e-3, "normal_force": 1.0}
STEP = mp.mpf(10) ** -18
NUMBERS = [field.name for field in fields(amplitude.Slip)][1:]


def agree(value: float, reference: float | None, tolerance: float = 1e-11) -> None:
    if reference is None:
        assert not np.isfinite(value)
    elif reference == 0:
        assert abs(value) <= 1e-14
    else:
        assert value == pytest.approx(reference, rel=tolerance, abs=0)


def rows(kind: str) -> Any:
    return pytest.mark.parametrize("row", REFERENCE[kind], ids=lambda r: str(list(r.values())[:2])[:60])


def scene(row: dict[str, Any]) -> tuple[Any, Any, float, float]:
    i = row["input"]
    rig = SimpleNamespace(mass=i["m"], stiffness=i["k"], damping=i["h"])
    friction = SimpleNamespace(mu_s=i["mus"], mu_k0=i["muk0"], delta_mu_k=i["dmuk"], a=i["a"], D=i["D"], t_cr=i["tcr"])
    return rig, friction, i["v0"], i["Fn"]


SAME = "omega_n zeta w tau_cr v_cr v_acr alpha xi_p_printed Pi".split()
GROUPS = dict(zip(SAME, SAME, strict=True)) | dict(
    pair.split(":") for pair in "va:v_a N:xi_o xi_p_exact:xi_p A_exact:overshoot gamma0:gamma_0 z_eff:z".split()
)


@rows("eigen")
def test_eigenvalues_and_groups(row: dict[str, Any]) -> None:
    arguments = scene(row)
    values = stability.eigenvalues(*arguments)
    expected = np.array(row["rates_re_per_s"]) + 1j * np.array(row["rates_im_rad_per_s"])
    assert values.shape == (3,) and np.isnan(values[2]) == (row["v_acr"] > 1)
    assert np.all(np.abs(values[: expected.size] / expected - 1) < 1e-11)
    assert bool(np.all(values[: expected.size].real < 0)) is row["stable"]
    rig, friction, speed, load = arguments
    g = SimpleNamespace(
        **closed_forms({**vars(rig), **vars(friction), "drive_speed": speed, "normal_force": load}).groups
    )
    for theirs, ours in GROUPS.items():
        agree(getattr(g, ours), row[theirs])
    agree(stability.critical_friction(g.z / 2, g.tau_cr), row["Pi_fc_derived"])
    agree(stability.critical_friction(g.zeta, g.tau_cr, form="printed"), row["Pi_fc_printed"])


@rows("gamma")
def test_saturation(row: dict[str, Any]) -> None:
    value = ageing.saturation(row["t"], row["gamma0"], row["v"], row["tcr"], row["D"])
    assert abs(value - row["gamma_clamped"]) <= 1e-14


# ---- over the whole of their ranges


def signed(least: float, most: float) -> st.SearchStrategy[float]:
    """Either sign, even in the exponent."""
    powers = st.floats(least, most).map(lambda e: 10.0**e)
    return st.one_of(powers, powers.map(lambda x: -x), st.just(0.0))


NEAR_ONE = st.builds(lambda side, x: side * (1 + x), st.sampled_from([-1.0, 1.0]), signed(-16, -1))
ALPHA = st.one_of(st.floats(-5, 50), NEAR_ONE, signed(-18, 0))
OVERSHOOT = st.one_of(signed(-6, 6), st.floats(-10, 10), st.floats(-1e6, 1e6))


def relative(value: Any, exact: Any) -> float:
    if abs(exact) > LARGEST:
        return 0.0 if np.isinf(value) else np.inf
    return float(abs(mp.mpf(float(value)) / exact - 1)) if exact else abs(float(value))


def edge(alpha: float, nearness: float) -> float:
    """An overshoot that close to where the maximum of an aperiodic slip is lost."""
    root = np.sqrt(abs(alpha - 1)) * np.sqrt(abs(alpha + 1))
    return float((-1 / (alpha + root) if alpha > 0 else abs(alpha) + root) * (1 + nearness))


ALMOST_LOST = st.tuples(st.one_of(st.floats(1.0001, 50), st.floats(-5, -1.0001)), signed(-13, -1))


@settings(FEW, max_examples=80)
@given(st.one_of(st.tuples(ALPHA, OVERSHOOT), ALMOST_LOST.map(lambda pair: (pair[0], edge(*pair)))))
@example((50.0, -0.01))
@example((1 - 1e-12, -1.5))
@example((-1.0, 1.0))
@example((1.0, -1.0))
def test_maximum(pair: tuple[float, float]) -> None:
    time, height = amplitude.slip_maximum(*pair)
    exact = plain.maximum(*pair)
    if exact is None:
        assert np.isnan(time) and np.isnan(height)
        return
    assert relative(time, exact[0]) < 2e-13
    if exact[1] > -690:
        assert relative(height, mp.exp(exact[1])) < 2e-13 * (1 + abs(float(pair[0] * exact[0])))
    else:
        assert 0 <= height < 1e-299


@FEW
@given(ALPHA, OVERSHOOT)
@example(-1 + 1e-13, 4.0)
@example(0.0, 0.0)
def test_slip(alpha: float, overshoot: float) -> None:
    found, expected = amplitude.slip(alpha, overshoot), plain.status(alpha, overshoot)
    assert found.status == expected
    if expected != "restick":
        assert all(np.isnan(getattr(found, name)) for name in NUMBERS)
        return
    exact = plain.slip(alpha, overshoot)
    near_fold = 1e-6 * (2 * alpha + overshoot) > float(exact["acceleration"])
    for name in NUMBERS:
        value = float(getattr(found, name))
        if name in ("elongation", "drop", "period") and abs(exact[name]) < 1e-14:
            assert abs(value) < 1e-14
        else:
            assert near_fold or relative(value, exact[name]) < 1e-11, name


@FEW
@given(st.floats(0.001, 0.999), signed(-11, -1))
def test_sticks_again_exactly_above_the_critical_loading(alpha: float, away: float) -> None:
    """Two roads to one boundary: the tangent point and the sign of the velocity at its maximum."""
    with np.errstate(over="ignore"):
        loading = stability.critical_loading(alpha) * (1 + away)
    if np.isfinite(loading) and abs(away) > 1e-10:
        overshoot = loading - 2 * alpha
        assert amplitude.slip(alpha, overshoot).status == ("restick" if away > 0 else "steady")


def phi_cr(alpha: Any, n: int) -> Any:
    """Phi of the slip whose n-th velocity maximum just touches the drive speed: one monotone equation, halved."""
    w = mp.sqrt((1 - alpha) * (1 + alpha))
    b, low, high = alpha / w, (2 * n - 1) * mp.pi, 2 * n * mp.pi
    for _ in range(plain.HALVINGS):
        psi = (low + high) / 2
        inside = mp.exp(b * psi) * (mp.cos(psi) - b * mp.sin(psi)) < 1
        low, high = (psi, high) if inside else (low, psi)
    return -mp.exp(b * low) * mp.sin(low) / w


@FEW
@given(st.floats(1e-300, 0.99999), st.integers(1, 4))
def test_critical_loading_over_its_range(alpha: float, n: int) -> None:
    if alpha > 1e-20:
        exact = mp.log(phi_cr(mp.mpf(alpha), n))
        assert abs(stability.log_critical_loading(alpha, n) - exact) < 1e-13 * (1 + abs(exact))
    assert np.isnan(stability.critical_loading(-1 - alpha)) and stability.critical_loading(1 + alpha) == np.inf
    assert stability.critical_loading(-alpha) == 0


@FEW
@given(st.floats(0, 10), st.floats(-6, 6).map(lambda e: 10.0**e))
def test_critical_friction_and_frequency_over_their_range(zeta: float, tau_cr: float) -> None:
    z, T = 2 * mp.mpf(zeta), mp.mpf(tau_cr)
    printed = (mp.mpf(zeta) ** 2 * T + mp.mpf(zeta) * (1 + T**2)) / (1 + mp.mpf(zeta) * T)  # eq. (25) as it stands
    assert relative(stability.critical_friction(zeta, tau_cr), z * (1 + T * T / (1 + z * T))) < 1e-14
    assert relative(stability.critical_friction(zeta, tau_cr, form="printed"), printed) < 1e-14
    assert relative(stability.critical_frequency(zeta, tau_cr), 1 / mp.sqrt(1 + z * T)) < 1e-14


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_has_no_answer(bad: float) -> None:
    for pair in ((bad, 1.0), (0.1, bad)):
        slip = amplitude.slip(*pair)
        assert slip.status == "undefined" and np.isnan(slip.drop)
        assert np.isnan(amplitude.slip_end(*pair)[0])
    assert np.isnan(amplitude.slip_maximum(np.nan, 1.0)[0])


def test_without_the_exact_difference_digits_are_lost() -> None:
    """Negative control: the distance to the edge as it is written, A - (|alpha| + kap), is wrong in the sixth digit."""
    alpha = 6.529205694998598
    overshoot = edge(alpha, -1e-10)
    root = np.sqrt(alpha**2 - 1)
    distance = overshoot + 1 / (alpha + root)
    naive = np.log1p(2 * root / distance) / (2 * root)
    exact = plain.maximum(alpha, overshoot)
    assert exact is not None
    assert relative(naive, exact[0]) > 1e-9
    assert relative(amplitude.slip_maximum(alpha, overshoot)[0], exact[0]) < 1e-13


# ---- derivatives against differences in 60 digits


def difference(function: Callable[[dict[str, Any]], Any], point: Mapping[str, float], name: str) -> Any:
    """d function/d name in 60 digits; function gives a number or a mapping of numbers."""
    size = max(abs(mp.mpf(point[name])), mp.mpf("1e-6"))
    ends = []
    for side in (1, -1):
        moved = {key: mp.mpf(value) for key, value in point.items()}
        moved[name] += side * size * STEP
        ends.append(function(moved))
    width = 2 * size * STEP
    if isinstance(ends[0], dict):
        return {key: (ends[0][key] - ends[1][key]) / width for key in ends[0]}
    return (ends[0] - ends[1]) / width


def close(value: float, exact: Any, scale: float = 0.0) -> bool:
    return abs(mp.mpf(float(value)) - exact) <= mp.mpf("1e-9") * max(abs(exact), mp.mpf(scale))


@FEW
@given(st.one_of(st.floats(-0.99, 0.9), signed(-12, -1).filter(lambda x: x > 0)), st.floats(-2, 6))
def test_derivatives_of_the_end_of_slip(alpha: float, power: float) -> None:
    overshoot = 1.05 * float(stability.critical_loading(alpha)) + 10**power - 2 * alpha
    table = amplitude.slip_end(alpha, overshoot, derivatives=True)[1]
    near, point = plain.slip(alpha, overshoot)["eps"], {"alpha": alpha, "overshoot": overshoot}
    for name, by in table.items():
        exact = difference(lambda q: plain.slip(q["alpha"], q["overshoot"], near), point, name)
        assert close(by[0], exact["duration"]) and close(by[1], exact["elongation"])


@pytest.mark.parametrize("alpha", [-1.7, -1.0, -0.6, -1e-9, 0.0, 0.3, 1 - 1e-9, 1.0, 1 + 1e-9, 1.4, 20.0])
@pytest.mark.parametrize("overshoot", [4.3, 1e3])
def test_derivatives_of_the_maximum(alpha: float, overshoot: float) -> None:
    (_, height), table = amplitude.slip_maximum(alpha, overshoot, derivatives=True)
    for name, by in table.items():
        point = {"alpha": alpha, "overshoot": overshoot}
        exact = difference(lambda q: dict(enumerate(plain.maximum(q["alpha"], q["overshoot"]))), point, name)
        assert close(by[0], exact[0]) and close(by[1] / height, exact[1])


@pytest.mark.parametrize("alpha", [1e-6, 0.3, 0.59999, 0.6, 0.97])
@pytest.mark.parametrize("n", [1, 3])
def test_derivative_of_the_critical_loading(alpha: float, n: int) -> None:
    value, table = stability.critical_loading(alpha, n, derivatives=True)
    slope = difference(lambda q: phi_cr(q["alpha"], n), {"alpha": alpha}, "alpha")
    assert relative(value, phi_cr(mp.mpf(alpha), n)) < 1e-12 and close(table["alpha"], slope)
    assert close(stability.log_critical_loading(alpha, n, derivatives=True)[1]["alpha"], slope / mp.mpf(value))
    # Negative control: a slope off by a part in 1e8 does not pass.
    assert not close(table["alpha"] * (1 + 1e-8), slope)


@pytest.mark.parametrize(("zeta", "tau_cr"), [(0.1, 3.0), (2.0, 1e-3), (1e-3, 1e3)])
def test_derivatives_of_the_critical_friction_and_frequency(zeta: float, tau_cr: float) -> None:
    def exact(q: Mapping[str, Any]) -> dict[str, Any]:
        z, T = 2 * q["zeta"], q["tau_cr"]
        return {"Pi": z * (1 + T * T / (1 + z * T)), "Omega": 1 / mp.sqrt(1 + z * T)}

    tables = [f(zeta, tau_cr, derivatives=True)[1] for f in (stability.critical_friction, stability.critical_frequency)]
    for name in ("zeta", "tau_cr"):
        slopes = difference(exact, {"zeta": zeta, "tau_cr": tau_cr}, name)
        assert close(tables[0][name], slopes["Pi"]) and close(tables[1][name], slopes["Omega"])


@pytest.mark.parametrize("row", REFERENCE["eigen"][::8] + REFERENCE["eigen"][-3:])
def test_derivatives_of_the_eigenvalues(row: dict[str, Any]) -> None:
    """Of the characteristic polynomial P(x; q) = 0: dx/dq = -P_q / P_x, both by differences in 60 digits."""
    names = ["m", "k", "h", "mus", "muk0", "dmuk", "a", "D", "tcr", "v0", "Fn"]
    values, table = stability.eigenvalues(*scene(row), derivatives=True)

    def characteristic(q: Mapping[str, Any], x: Any) -> Any:
        renewed = q["v0"] * q["tcr"] / q["D"] if row["v_acr"] <= 1 else mp.mpf(1)
        weakening = q["dmuk"] * mp.exp(-q["a"] * q["v0"])
        Z = q["h"] * mp.sqrt(q["m"] / q["k"]) + q["Fn"] * q["a"] * weakening * renewed
        step = q["mus"] - q["muk0"] - q["dmuk"] + weakening
        mechanical = q["m"] * x**2 + Z * x + q["k"]
        return mechanical if row["v_acr"] > 1 else (x + 1 / q["tcr"]) * mechanical - q["Fn"] * step / q["D"] * x

    point = {name: row["input"][name] for name in names}
    exact_point = {name: mp.mpf(value) for name, value in point.items()}
    for j, value in enumerate(values[np.isfinite(values)]):
        root = mp.findroot(lambda x: characteristic(exact_point, x), mp.mpc(complex(value)), tol=1e-60, verify=False)
        by_root = mp.diff(lambda x: characteristic(exact_point, x), root)
        for name, entry in zip(names, table.values(), strict=True):
            slope = -difference(lambda q, x=root: characteristic(q, x), point, name) / by_root
            assert abs(entry[j] - complex(slope)) <= 1e-9 * abs(complex(slope)) + 1e-14


def test_derivatives_of_the_saturation() -> None:
    def gamma(q: Mapping[str, Any]) -> Any:
        free = 1 - q["speed"] * q["t_cr"] / q["D"]
        return free + (q["gamma_0"] - free) * mp.exp(-q["t"] / q["t_cr"])

    names = ("t", "gamma_0", "speed", "t_cr", "D")
    for values in ([0.2, 0.3, 2e-5, 0.5, 3.74e-5], [1e-9, 0.0, 1e-6, 0.5, 4e-5], [0.01, 1.0, 1e-3, 0.5, 4e-5]):
        point = dict(zip(names, values, strict=True))
        table = ageing.saturation(*values, derivatives=True)[1]
        assert all(close(table[name], difference(gamma, point, name)) for name in names)
    assert ageing.saturation(1.0, 0.5, 1.0, 0.5, 1e-5, derivatives=True)[1]["t"] == 0.0
    assert np.isnan(ageing.saturation(-1.0, 0.5, 0.0, 0.5, 1e-5))


# ---- a cycle in SI


def integrated(values: Mapping[str, float]) -> dict[str, float]:
    """A cycle of the linearised model by brute force in SI, from a saturated stick until the next one."""
    q = SimpleNamespace(**values)
    c, k, v = q.damping * np.sqrt(q.mass / q.stiffness), q.stiffness, q.drive_speed

    def rate(_: float, y: Any) -> list[float]:
        elongation, speed = y
        friction = q.normal_force * (q.mu_k0 + q.delta_mu_k * q.a * speed)
        return [v - speed, (k * elongation + c * (v - speed) - friction) / q.mass]

    def rests(t: float, y: Any) -> float:
        return float(y[1]) if t > 1e-9 else 1.0

    rests.terminal, rests.direction = True, -1.0  # type: ignore[attr-defined]
    onset = (q.mu_s * q.normal_force - c * v) / k
    # A hair of speed: from rest at the balance of forces a step would stay there.
    run = solve_ivp(rate, (0.0, 10.0), [onset, 0.0], events=rests, rtol=1e-11, atol=1e-15, max_step=2e-3)
    fall = onset - run.y[0, -1]
    return {
        "drop": k * fall,
        "period": fall / v + run.t[-1],
        "slip_duration": run.t[-1],
        "peak_speed": float(np.max(run.y[1])),
    }


@pytest.mark.parametrize("change", [{"t_cr": 0.05}, {"drive_speed": 4e-3}, {"a": 30.0}, {"drive_speed": 1e-6}])
def test_the_cycle_is_that_of_the_equations(change: dict[str, float]) -> None:
    found = closed_forms(PAIR | change)
    assert found.status == "restick"
    for name, value in integrated(PAIR | change).items():
        tolerance = 1e-4 if name == "peak_speed" else 1e-6  # the largest of the steps is not the top
        assert found.numbers[name] == pytest.approx(value, rel=tolerance), name


def test_shapes_broadcast_and_scalars_stay_scalars() -> None:
    alpha, overshoot = np.linspace(-0.5, 0.5, 3)[:, None], np.linspace(1, 30, 4)
    time, height = amplitude.slip_maximum(alpha, overshoot)
    assert time.shape == height.shape == (3, 4)
    assert time[2, 1] == amplitude.slip_maximum(alpha[2, 0], overshoot[1])[0]
    assert amplitude.slip_end(alpha, overshoot, derivatives=True)[1]["alpha"][0].shape == (3, 4)
    assert np.ndim(stability.critical_loading(0.1)) == 0 and stability.critical_loading(alpha).shape == (3, 1)
    rig, friction, _, force = scene(REFERENCE["eigen"][0])
    assert stability.eigenvalues(rig, friction, np.geomspace(1e-6, 1e-3, 7), force).shape == (7, 3)
