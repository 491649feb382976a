"""Closed forms against reference values, and against mpmath integrals of nothing but the equations."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from identify import ageing, amplitude, stability
from identify.prediction.groups import groups

REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "reference.json").read_text())
FEW = settings(max_examples=25, deadline=None, derandomize=True)
mp.mp.dps = 60


def agree(value: float, reference: float | None, tolerance: float = 1e-11) -> None:
    if reference is None:
        assert not np.isfinite(value)
    elif reference == 0:
        assert abs(value) <= 1e-14
    else:
        assert value == pytest.approx(reference, rel=tolerance, abs=0)


def rows(kind: str) -> Any:
    return pytest.mark.parametrize("row", REFERENCE[kind], ids=lambda r: str(list(r.values())[:2])[:60])


@rows("amplitude")
def test_slip_maximum(row: dict[str, Any]) -> None:
    time, height = amplitude.slip_maximum(row["alpha"], row["A"])
    agree(time, row["tau_max"])
    agree(height, row["amplitude"])
    agree(amplitude.log_amplitude(row["alpha"], row["A"]), row["ln_amplitude"])


SLIP_COLUMNS = {
    "tau_end": "duration",
    "xi_end": "elongation",
    "acc_end": "acceleration",
    "drop": "drop",
    "period": "period",
    "peak_to_peak": "peak_to_peak",
    "tau_vmin": "time_of_peak_speed",
    "v_rel_max": "peak_speed",
}


@rows("slip")
def test_slip_until_it_sticks_again(row: dict[str, Any]) -> None:
    slip = amplitude.slip(row["alpha"], row["A"])
    assert slip.status == row["status"]
    for theirs, ours in SLIP_COLUMNS.items():
        agree(float(getattr(slip, ours)), row[theirs])
    time, elongation = amplitude.slip_end(row["alpha"], row["A"])
    agree(time, row["tau_end"])
    agree(elongation, row["xi_end"])


@rows("phi_cr")
def test_critical_loading(row: dict[str, Any]) -> None:
    value = stability.critical_loading(row["alpha"], row["n"])
    agree(value, row["Phi_cr"])
    agree(stability.log_critical_loading(row["alpha"], row["n"]), row["ln_Phi_cr"])
    if row["Phi_cr"] is None:
        assert value == np.inf


@rows("pi_fc")
def test_critical_friction_and_frequency(row: dict[str, Any]) -> None:
    agree(stability.critical_friction(row["zeta"], row["tau_cr"]), row["Pi_fc_derived"])
    agree(stability.critical_friction(row["zeta"], row["tau_cr"], form="printed"), row["Pi_fc_printed"])
    agree(stability.critical_frequency(row["zeta"], row["tau_cr"]), row["Omega_c"])


def test_the_printed_form_is_too_low() -> None:
    shares = [r["Pi_fc_printed"] / r["Pi_fc_derived"] for r in REFERENCE["pi_fc"] if r["Pi_fc_derived"]]
    ours = [
        stability.critical_friction(r["zeta"], r["tau_cr"], form="printed")
        / stability.critical_friction(r["zeta"], r["tau_cr"])
        for r in REFERENCE["pi_fc"]
        if r["Pi_fc_derived"]
    ]
    assert np.allclose(shares, ours) and min(ours) < 0.55 and max(ours) < 1.0
    with pytest.raises(ValueError, match="'derived' or 'printed'"):
        stability.critical_friction(0.1, 1.0, form="as printed")  # type: ignore[arg-type]


def scene(row: dict[str, Any]) -> tuple[Any, Any, float, float]:
    i = row["input"]
    rig = SimpleNamespace(mass=i["m"], stiffness=i["k"], damping=i["h"])
    friction = SimpleNamespace(mu_s=i["mus"], mu_k0=i["muk0"], delta_mu_k=i["dmuk"], a=i["a"], D=i["D"], t_cr=i["tcr"])
    return rig, friction, i["v0"], i["Fn"]


GROUPS = {
    "omega_n": "omega_n",
    "zeta": "zeta",
    "w": "w",
    "tau_cr": "tau_cr",
    "v_cr": "v_cr",
    "v_acr": "v_acr",
    "va": "v_a",
    "alpha": "alpha",
    "N": "xi_o",
    "xi_p_printed": "xi_p_printed",
    "xi_p_exact": "xi_p",
    "A_exact": "overshoot",
    "gamma0": "gamma_0",
    "z_eff": "z",
    "Pi": "Pi",
}


@rows("eigen")
def test_eigenvalues_and_groups(row: dict[str, Any]) -> None:
    arguments = scene(row)
    values = stability.eigenvalues(*arguments)
    expected = np.array(row["rates_re_per_s"]) + 1j * np.array(row["rates_im_rad_per_s"])
    assert values.shape == (3,) and np.isnan(values[2]) == (row["v_acr"] > 1)
    assert np.all(np.abs(values[: expected.size] / expected - 1) < 1e-11)
    assert bool(np.all(values[: expected.size].real < 0)) is row["stable"]
    g = groups(*arguments)
    for theirs, ours in GROUPS.items():
        agree(getattr(g, ours), row[theirs])
    agree(stability.critical_friction(g.z / 2, g.tau_cr), row["Pi_fc_derived"])
    agree(stability.critical_friction(g.zeta, g.tau_cr, form="printed"), row["Pi_fc_printed"])
    assert len(g.sentences()) == len(GROUPS) + 1 and "v_cr = " in " ".join(g.sentences())


@rows("gamma")
def test_saturation(row: dict[str, Any]) -> None:
    value = ageing.saturation(row["t"], row["gamma0"], row["v"], row["tcr"], row["D"])
    assert abs(value - row["gamma_clamped"]) <= 1e-14


# ---- against the equations themselves, in 40 digits


def oscillation(alpha: Any, overshoot: Any, tau: Any) -> Any:
    """xi - xi_o of xi'' + 2 alpha xi' + xi = xi_o, from xi_p at unit velocity."""
    root = mp.sqrt(mp.mpc(alpha * alpha - 1))
    if root == 0:
        return mp.exp(-alpha * tau) * (overshoot + (1 + alpha * overshoot) * tau)
    S = mp.sinh(root * tau) / root
    return mp.re(mp.exp(-alpha * tau) * (overshoot * mp.cosh(root * tau) + (1 + alpha * overshoot) * S))


def velocity(alpha: Any, overshoot: Any, tau: Any) -> Any:
    root = mp.sqrt(mp.mpc(alpha * alpha - 1))
    S = tau if root == 0 else mp.sinh(root * tau) / root
    return mp.re(mp.exp(-alpha * tau) * (mp.cosh(root * tau) - (alpha + overshoot) * S))


def root_of(function: Any, guess: Any) -> Any:
    """A root in 40 digits; its residual is judged by the size of the function beside it, not by a fixed number."""
    x, before = guess * (1 + mp.mpf("1e-12")), guess * (1 - mp.mpf("1e-12"))
    left = function(before)
    for _ in range(40):
        here = function(x)
        if here == left or abs(x - before) < mp.mpf("1e-36") * abs(x):
            break
        before, x, left = x, x - here * (x - before) / (here - left), here
    assert abs(x - guess) < mp.mpf("1e-3") * abs(guess)
    assert abs(function(x)) <= mp.mpf("1e-25") * (1 + abs(function(x * (1 + mp.mpf("1e-3")))))
    return x


def relative(value: float, exact: Any) -> float:
    return float(abs(value / exact - 1))


@FEW
@given(st.floats(-5, 50), st.floats(-1e6, 1e6))
def test_maximum_is_where_the_velocity_vanishes_first(alpha: float, overshoot: float) -> None:
    time, height = amplitude.slip_maximum(alpha, overshoot)
    a, A = mp.mpf(alpha), mp.mpf(overshoot)
    if np.isnan(time):
        assert abs(alpha) >= 1 and overshoot + alpha - np.copysign(np.sqrt(alpha**2 - 1), 1) <= 1e-9
        return
    exact = root_of(lambda t: velocity(a, A, t), mp.mpf(time))
    condition = 1 + abs(alpha * overshoot) / max(float(abs(1 + 2 * a * A + A * A)), 1e-300)
    assert relative(time, exact) < 1e-13 * condition
    assert all(velocity(a, A, exact * share) > 0 for share in (0.01, 0.5, 0.99))
    peak = oscillation(a, A, exact)
    if 1e-290 < peak < 1e290:
        assert relative(height, peak) < 1e-13 * (condition + float(abs(a * exact)))


@FEW
@given(st.floats(-0.99, 0.9), st.floats(-2, 8))
def test_slip_ends_where_the_velocity_is_one_again(alpha: float, exponent: float) -> None:
    overshoot = max(float(stability.critical_loading(alpha)) * 1.01, 1e-6) + 10**exponent - 2 * alpha
    time, elongation = amplitude.slip_end(alpha, overshoot)
    a, A = mp.mpf(alpha), mp.mpf(overshoot)
    exact = root_of(lambda t: velocity(a, A, t) - 1, mp.mpf(time))
    assert relative(time, exact) < 1e-11
    assert relative(elongation, oscillation(a, A, exact)) < 1e-11
    assert all(velocity(a, A, exact * s / 40) < 1 for s in range(1, 40))


def differences(function: Any, point: list[float], index: int) -> Any:
    """Derivative of an mpmath function by one argument, from central differences in 40 digits."""
    step = mp.mpf(10) ** -13
    up, down = [mp.mpf(q) for q in point], [mp.mpf(q) for q in point]
    up[index] += step
    down[index] -= step
    return (function(*up) - function(*down)) / (2 * step)


@pytest.mark.parametrize("alpha", [-1.7, -1.0, -0.6, -1e-9, 0.0, 0.3, 0.97, 1 - 1e-9, 1.0, 1 + 1e-9, 1.4, 20.0])
@pytest.mark.parametrize("overshoot", [4.3, 60.0, 1e4])
def test_derivatives_of_the_maximum(alpha: float, overshoot: float) -> None:
    if alpha == 20.0 and overshoot == 1e4:
        overshoot = 1e3
    (time, height), table = amplitude.slip_maximum(alpha, overshoot, derivatives=True)

    def first(a: Any, A: Any) -> Any:
        return root_of(lambda t: velocity(a, A, t), mp.mpf(time))

    def peak(a: Any, A: Any) -> Any:
        return oscillation(a, A, first(a, A))

    for i, name in enumerate(("alpha", "overshoot")):
        assert relative(table[name][0], differences(first, [alpha, overshoot], i)) < 1e-9
        assert relative(table[name][1], differences(peak, [alpha, overshoot], i)) < 1e-9
    assert height > 0


@pytest.mark.parametrize(("alpha", "overshoot"), [(-0.95, 5.0), (-0.3, 2.0), (-1e-9, 0.3), (0.0, 1.0), (0.4, 9.0)])
def test_derivatives_of_the_end_of_slip(alpha: float, overshoot: float) -> None:
    (time, _), table = amplitude.slip_end(alpha, overshoot, derivatives=True)

    def end(a: Any, A: Any) -> Any:
        return root_of(lambda t: velocity(a, A, t) - 1, mp.mpf(time))

    def there(a: Any, A: Any) -> Any:
        return oscillation(a, A, end(a, A))

    for i, name in enumerate(("alpha", "overshoot")):
        assert relative(table[name][0], differences(end, [alpha, overshoot], i)) < 1e-9
        assert table[name][1] == pytest.approx(float(differences(there, [alpha, overshoot], i)), rel=1e-9, abs=1e-12)


def tangent(alpha: Any, n: int, psi: Any) -> tuple[Any, Any]:
    """(psi, Phi) of the slip whose n-th velocity maximum just touches the drive speed, in 40 digits."""
    w = mp.sqrt((1 - alpha) * (1 + alpha))
    b = alpha / w
    psi = root_of(lambda y: mp.exp(b * y) * (mp.cos(y) - b * mp.sin(y)) - 1, psi)
    return psi, -mp.exp(b * psi) * mp.sin(psi) / w


@pytest.mark.parametrize("alpha", [1e-6, 0.01, 0.3, 0.59999, 0.6, 0.8, 0.97])
@pytest.mark.parametrize("n", [1, 2, 3])
def test_critical_loading_and_its_derivative(alpha: float, n: int) -> None:
    value, table = stability.critical_loading(alpha, n, derivatives=True)
    w = np.sqrt(1 - alpha**2)
    bracket = ((2 * n - 1) * mp.pi, 2 * n * mp.pi)
    b = mp.mpf(alpha) / mp.mpf(w)
    guess = mp.findroot(lambda y: mp.cos(y) - b * mp.sin(y) - mp.exp(-b * y), bracket, solver="anderson", tol=1e-20)
    assert bracket[0] < guess < bracket[1]
    exact = tangent(mp.mpf(alpha), n, guess)
    assert relative(value, exact[1]) < 1e-12
    slope = differences(lambda a: tangent(a, n, exact[0])[1], [alpha], 0)
    assert relative(table["alpha"], slope) < 1e-9
    assert relative(stability.log_critical_loading(alpha, n, derivatives=True)[1]["alpha"], slope / exact[1]) < 1e-9


def test_critical_loading_rises_and_is_continuous() -> None:
    alpha = np.concatenate([np.geomspace(1e-300, 9e-4, 500), np.linspace(1e-3, 0.999999, 4000)])
    assert np.all(np.diff(stability.log_critical_loading(alpha)) > 0)
    assert stability.critical_loading(0.6 - 1e-12) == pytest.approx(stability.critical_loading(0.6), rel=1e-11)
    assert np.isnan(stability.critical_loading(-1.0)) and stability.critical_loading(-0.5) == 0
    with pytest.raises(ValueError, match="whole numbers"):
        stability.critical_loading(0.1, 1.5)


def test_the_principal_arctangent_fails() -> None:
    """Negative control: eq. (15) with atan gives a time before the start of the slip."""
    alpha, overshoot = 0.2, -3.0
    w = np.sqrt(1 - alpha**2)
    time = amplitude.slip_maximum(alpha, overshoot)[0]
    assert np.arctan(w / (alpha + overshoot)) / w < 0 < time
    assert velocity(mp.mpf(alpha), mp.mpf(overshoot), mp.mpf(time)) < 1e-14


def test_velocity_never_vanishes_at_the_boundary() -> None:
    """Negative control: eq. (18) as printed, xi' = 0 at a velocity maximum, has no solution."""
    for alpha, guess in ((0.1, 5.24), (0.5, 4.263), (0.9, 3.593)):
        psi, phi = tangent(mp.mpf(alpha), 1, mp.mpf(guess))
        tau = psi / mp.sqrt(1 - mp.mpf(alpha) ** 2)
        assert abs(velocity(mp.mpf(alpha), phi - 2 * mp.mpf(alpha), tau) - 1) < 1e-30


@FEW
@given(st.floats(0, 10), st.floats(-6, 6))
def test_critical_friction_is_the_boundary_of_the_cubic(zeta: float, exponent: float) -> None:
    T, z = mp.mpf(10**exponent), 2 * mp.mpf(zeta)
    value, table = stability.critical_friction(zeta, float(T), derivatives=True)
    frequency = stability.critical_frequency(zeta, float(T))
    on_axis = mp.mpc(0, 1) / mp.sqrt(1 + z * T)
    exact = z * (1 + T * T / (1 + z * T))
    cubic = on_axis**3 + (z + 1 / T) * on_axis**2 + (1 + z / T - exact / T) * on_axis + 1 / T
    assert abs(cubic) < mp.mpf("1e-25") * (1 + 1 / T)
    assert float(abs(value - exact)) <= 1e-14 * float(exact) and relative(frequency, abs(on_axis)) < 1e-14
    assert table["zeta"] == pytest.approx(float(2 * (1 + T**2 / (1 + z * T) ** 2)), rel=1e-12)


@pytest.mark.parametrize("row", REFERENCE["eigen"][::5] + REFERENCE["eigen"][-3:])
def test_derivatives_of_the_eigenvalues(row: dict[str, Any]) -> None:
    rig, friction, speed, force = scene(row)
    names = ["m", "k", "h", "mus", "muk0", "dmuk", "a", "D", "tcr", "v0", "Fn"]
    values, table = stability.eigenvalues(rig, friction, speed, force, derivatives=True)
    point = [row["input"][n] for n in names]

    def characteristic(
        m: Any, k: Any, h: Any, us: Any, u0: Any, du: Any, a: Any, D: Any, t: Any, v: Any, N: Any
    ) -> Any:
        worn = v * t / D if row["v_acr"] <= 1 else mp.mpf(1)
        Z = h * mp.sqrt(m / k) + N * du * a * mp.exp(-a * v) * worn
        step = us - u0 - du * (1 - mp.exp(-a * v))
        if row["v_acr"] > 1:
            return [m, Z, k]
        return [m, Z + m / t, k + Z / t - N * step / D, k / t]

    for i, name in enumerate(table):
        for j, value in enumerate(values):
            if np.isnan(value):
                continue

            def root(*q: Any, guess: complex = value) -> Any:
                scale = abs(guess)
                c = characteristic(*q)
                return scale * root_of(
                    lambda x: (
                        sum(q * (x * scale) ** (len(c) - 1 - i) for i, q in enumerate(c))
                        / (abs(c[0]) * scale ** (len(c) - 1))
                    ),
                    mp.mpc(guess) / scale,
                )

            up, down = [mp.mpf(q) for q in point], [mp.mpf(q) for q in point]
            step = max(abs(mp.mpf(point[i])), mp.mpf("1e-3")) * mp.mpf("1e-12")
            up[i], down[i] = up[i] + step, down[i] - step
            exact = (root(*up) - root(*down)) / (2 * step)
            assert abs(table[name][j] - complex(exact)) <= 1e-9 * abs(complex(exact)) + 1e-14


def test_derivatives_of_the_saturation() -> None:
    for point in ([0.2, 0.3, 2e-5, 0.5, 3.74e-5], [1e-9, 0.0, 1e-6, 0.5, 4e-5], [0.01, 1.0, 1e-3, 0.5, 4e-5]):

        def gamma(t: Any, g: Any, v: Any, T: Any, D: Any) -> Any:
            return g + (1 - v * T / D - g) * (1 - mp.exp(-t / T))

        value, table = ageing.saturation(*point, derivatives=True)
        assert value == pytest.approx(float(gamma(*map(mp.mpf, point))), abs=1e-15)
        for i, name in enumerate(("t", "gamma_0", "speed", "t_cr", "D")):
            step = mp.mpf(point[i] or 1e-3) * mp.mpf("1e-12")
            up, down = [mp.mpf(q) for q in point], [mp.mpf(q) for q in point]
            up[i], down[i] = up[i] + step, down[i] - step
            assert table[name] == pytest.approx(float((gamma(*up) - gamma(*down)) / (2 * step)), rel=1e-10)
    assert ageing.saturation(1.0, 0.5, 1.0, 0.5, 1e-5, derivatives=True)[1]["t"] == 0.0
    assert np.isnan(ageing.saturation(-1.0, 0.5, 0.0, 0.5, 1e-5))


def test_shapes_broadcast_and_scalars_stay_scalars() -> None:
    alpha, overshoot = np.linspace(-0.5, 0.5, 3)[:, None], np.linspace(1, 30, 4)
    time, height = amplitude.slip_maximum(alpha, overshoot)
    assert time.shape == height.shape == (3, 4)
    assert time[2, 1] == amplitude.slip_maximum(alpha[2, 0], overshoot[1])[0]
    assert amplitude.slip_end(alpha, overshoot, derivatives=True)[1]["alpha"][0].shape == (3, 4)
    assert np.ndim(stability.critical_loading(0.1)) == 0 and stability.critical_loading(alpha).shape == (3, 1)
    rig, friction, _, force = scene(REFERENCE["eigen"][0])
    assert stability.eigenvalues(rig, friction, np.geomspace(1e-6, 1e-3, 7), force).shape == (7, 3)
