"""Derivatives of the closed forms by every argument against differences in 60 digits, to 1e-9."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from identify import amplitude, stability
from identify.prediction.closed_forms import UNITS, closed_forms, jump
from identify.prediction.groups import NAMES, QUANTITIES, groups
from tests.support import closed_form_case as plain

FEW = settings(max_examples=20, deadline=None, derandomize=True)
PAIR = {
    "mass": 0.2,
    "stiffness": 1470.0,
    "damping": 147.0,
    "mu_s": 0.62,
    "mu_k0": 0.43,
    "delta_mu_k": -0.13,
    "a": 3.0,
    "D": 37.4e-6,
    "t_cr": 0.5,
    "drive_speed": 1e-3,
    "normal_force": 1.0,
}
STEP = mp.mpf(10) ** -18


def arguments(values: Mapping[str, Any]) -> tuple[Any, Any, Any, Any]:
    rig, friction = (SimpleNamespace(**{n: values[n] for n in part}) for part in (QUANTITIES[:3], QUANTITIES[3:9]))
    return rig, friction, values["drive_speed"], values["normal_force"]


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
@given(st.one_of(st.floats(-0.99, 0.9), st.floats(-12, -1).map(lambda e: 10.0**e)), st.floats(-2, 6))
def test_the_whole_slip(alpha: float, power: float) -> None:
    overshoot = 1.05 * float(stability.critical_loading(alpha)) + 10**power - 2 * alpha
    slip, table = amplitude.slip(alpha, overshoot, derivatives=True)
    near = plain.slip(alpha, overshoot)["eps"]
    for name, by in table.items():
        point = {"alpha": alpha, "overshoot": overshoot}
        exact = difference(lambda q: plain.slip(q["alpha"], q["overshoot"], near), point, name)
        for column, value in by.items():
            # The period is a sum; where its parts cancel, their size is the measure.
            scale = abs(by["duration"]) if column == "period" else 0.0
            assert close(value, exact[column], scale), (column, name)
    assert slip.status == "restick"


@pytest.mark.parametrize("change", [{}, {"drive_speed": 1e-6}, {"delta_mu_k": 0.1, "a": 40.0}, {"mass": 5.0}])
def test_groups(change: dict[str, float]) -> None:
    point = PAIR | change
    if point["drive_speed"] * point["t_cr"] > point["D"]:
        point["drive_speed"] = 0.3 * point["D"] / point["t_cr"]
    values = groups(*arguments(point))
    exact = plain.groups({key: mp.mpf(value) for key, value in point.items()})
    for name in NAMES:
        assert abs(getattr(values, name) / exact[name] - 1) < 1e-13


JUMPS = [{"t_cr": 0.05}, {"drive_speed": 1e-6}, {"drive_speed": 4e-3, "t_cr": 0.02}, {"a": 30.0, "t_cr": 0.1}]


@pytest.mark.parametrize("change", JUMPS)
def test_the_cycle_of_a_rig(change: dict[str, float]) -> None:
    """Every column, the saturation of the stick among them (0.89 to 1 here)."""
    point = PAIR | change
    values = jump(*arguments(point))
    assert values.status == "restick" == closed_forms(point).status
    numbers = {key: mp.mpf(value) for key, value in point.items()}
    g = plain.groups(numbers)
    near = plain.slip(g["alpha"], mp.mpf(values.saturation) * g["loading"] - 2 * g["alpha"])["eps"]
    share = mp.mpf(values.saturation)
    exact = plain.jump(numbers, share, near)
    for name in UNITS:
        assert abs(getattr(values, name) / exact[name] - 1) < 1e-11, name


def integrated(values: Mapping[str, float], cycles: int) -> dict[str, float]:
    """The linearised model by brute force in SI: sticks that age, slips of fresh contact, until they repeat."""
    q = SimpleNamespace(**values)
    c, k, v = q.damping * np.sqrt(q.mass / q.stiffness), q.stiffness, q.drive_speed

    def rate(_: float, y: Any) -> list[float]:
        elongation, speed = y
        friction = q.normal_force * (q.mu_k0 + q.delta_mu_k * q.a * speed)
        return [v - speed, (k * elongation + c * (v - speed) - friction) / q.mass]

    def rests(t: float, y: Any) -> float:
        return float(y[1]) if t > 1e-9 else 1.0

    rests.terminal, rests.direction = True, -1.0  # type: ignore[attr-defined]
    left, out = 0.0, {}
    for _ in range(cycles):
        stick = brent(q, c, left)
        onset = left + v * stick
        # A hair of speed: from rest at the balance of forces a step would stay there.
        run = solve_ivp(rate, (0.0, 10.0), [onset, 0.0], events=rests, rtol=1e-11, atol=1e-15, max_step=2e-3)
        left = run.y[0, -1]
        out = {
            "drop": k * (onset - left),
            "period": stick + run.t[-1],
            "slip_duration": run.t[-1],
            "slip_distance": v * run.t[-1] + onset - left,
            "peak_speed": float(np.max(run.y[1])),
            "onset_force": k * onset + c * v,
        }
    return out


def brent(q: SimpleNamespace, c: float, left: float) -> float:
    """When the pull of the spring overcomes a grip that ages."""
    low, high = 0.0, 10.0 * q.mu_s * q.normal_force / (q.stiffness * q.drive_speed)
    for _ in range(200):
        t = 0.5 * (low + high)
        grip = q.normal_force * (q.mu_k0 + (q.mu_s - q.mu_k0) * -np.expm1(-t / q.t_cr))
        low, high = (t, high) if q.stiffness * (left + q.drive_speed * t) + c * q.drive_speed < grip else (low, t)
    return 0.5 * (low + high)


@pytest.mark.parametrize("change", [{"t_cr": 0.05}, {"drive_speed": 4e-3, "t_cr": 0.02}, {"a": 30.0, "t_cr": 0.1}])
def test_the_cycle_is_that_of_the_equations(change: dict[str, float]) -> None:
    point = PAIR | change
    found, brute = jump(*arguments(point)), integrated(point, 12)
    assert found.saturation < 0.9999
    for name, value in brute.items():
        tolerance = 1e-4 if name == "peak_speed" else 1e-6  # the largest of the steps is not the top
        assert getattr(found, name) == pytest.approx(value, rel=tolerance), name


def test_a_cycle_that_only_a_saturated_contact_can_begin_dies_out() -> None:
    """The first slip sticks again, each later one from a fresher contact; the closed form says that none repeats."""
    found = jump(*arguments(PAIR))
    alpha = groups(*arguments(PAIR))
    assert amplitude.slip_status(alpha.alpha, alpha.overshoot) == "restick" and found.status == "steady"
    share, steps = mp.mpf(1), 0
    while share > 0.05:
        drop = plain.slip(alpha.alpha, share * alpha.loading - 2 * alpha.alpha)["drop"]
        new, steps = 1 - mp.exp(-drop / alpha.tau_cr), steps + 1
        assert new < 0.9 * share
        share = new
        if plain.status(alpha.alpha, share * alpha.loading - 2 * alpha.alpha) == "steady":
            break
    assert steps >= 2


def test_a_wrong_derivative_is_seen() -> None:
    """Negative control: a slope off by a part in 1e8 does not pass."""
    (_, table), point = stability.critical_friction(0.1, 3.0, derivatives=True), {"zeta": 0.1, "tau_cr": 3.0}

    def limit(q: Mapping[str, Any]) -> Any:
        z = 2 * q["zeta"]
        return z * (1 + q["tau_cr"] ** 2 / (1 + z * q["tau_cr"]))

    exact = difference(limit, point, "zeta")
    assert close(table["zeta"], exact) and not close(table["zeta"] * (1 + 1e-8), exact)
