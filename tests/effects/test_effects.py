"""What every effect keeps to by standing in the table: declarations, units, bounds, onset, document."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

import identify.model.model
from identify.effects import ALL
from identify.effects.quantities import Effect, Parameter, Situation, Terms
from identify.model.model import BASE_PARAMETERS, SPEED, TIME, Model, assemble
from tests.support import effects_case as case

EVERY = pytest.mark.parametrize("effect", ALL, ids=lambda effect: effect.name)
MASS, LENGTH, TIMES = 3.7, 0.21, 1.9  # how much smaller the units of kg, m and s become
ALL_TOGETHER = case.together()


# ---- declarations


@EVERY
def test_declaration_is_complete(effect):
    assert effect.name.isidentifier() and effect.says and effect.source and type(effect).__doc__
    assert not effect.says.endswith("."), "a phrase for tables"
    names = [p.name for p in effect.parameters]
    for p in effect.parameters:
        assert p.lower <= p.default <= p.upper, p
        assert p.symbol and p.meaning and p.spread > 0, p
        assert p.scale == "linear" or (p.lower >= 0.0 and p.default > 0.0), p
        assert case.factor(p.unit, 1.0, 1.0, 1.0) == 1.0, p
    for s in effect.states:
        assert (s.lower is None or s.start >= s.lower) and (s.upper is None or s.start <= s.upper), s
        assert case.factor(s.unit, 1.0, 1.0, 1.0) == 1.0, s
    assert set(effect.null) <= set(names)
    assert effect.null or not names, "say at which values it is as good as absent"
    for name, value in effect.null.items():
        p = effect.parameters[names.index(name)]
        limit = p.scale == "log" and (value in (0.0, math.inf))
        assert limit or p.lower <= value <= p.upper, p
    assert set(effect.needs) <= set(case.BY_NAME)


def test_names_are_unique_but_for_laws_of_the_same_thing():
    assert len({e.name for e in ALL}) == len(ALL)
    owners: dict[str, Effect] = {}
    for effect in ALL:
        for name in [p.name for p in effect.parameters] + [s.name for s in effect.states]:
            first = owners.setdefault(name, effect)
            assert first is effect or (effect.role and first.role == effect.role), (name, first.name, effect.name)
    assert not set(owners) & {p.name for p in BASE_PARAMETERS}


# ---- units


def _unit_of(result: str, model: Model) -> list[str]:
    if result == "state":
        return [s.unit for s in model.states]
    if result == "rate":
        return [f"({s.unit or 'dimensionless'})/s" for s in model.states]
    return [result]


def _factors(units: list[str]) -> np.ndarray:
    return np.array([case.factor(unit, MASS, LENGTH, TIMES) for unit in units])


def unscaled(model: Model, seed: int) -> dict[str, float]:
    """Largest relative departure of each function from what the units of its arguments ask for."""
    random = np.random.default_rng(seed)
    x, p, u = case.state(model, random), case.values(model, random), case.inputs(random)
    by_state, by_p = _factors([s.unit for s in model.states]), _factors([q.unit for q in model.parameters])
    by_u, per_s = _factors(["m/s", "N", "", "s"]), case.factor("1/s", MASS, LENGTH, TIMES)
    before, after = (x, p, u), (x * by_state, p * by_p, u * by_u)
    calls = {name: ((*before,), (*after,), _unit_of(unit, model)) for name, unit in case.OF_STATE.items()}
    t, force = 0.37, 0.8
    calls["rest"] = ((*before, t), (*after, t * _factors(["s"])[0]), _unit_of("state", model))
    forced = force * _factors(["N"])[0]
    calls["at_force"] = ((force, p, u), (forced, p * by_p, u * by_u), _unit_of("state", model))
    found = {}
    for name, (old, new, units) in calls.items():
        expected, got = case.result(model, name, *old) * _factors(units), case.result(model, name, *new)
        found[name] = float(np.max(np.abs(got - expected) / (np.abs(expected) + 1e-12 * _factors(units))))
    for name in ("decays", "waves"):
        expected, got = case.result(model, name, p) * per_s, case.result(model, name, p * by_p)
        found[name] = float(np.max(np.abs(got / expected - 1), initial=0.0))
    return found


@EVERY
def test_units_are_consistent(effect):
    for seed in range(3):
        departures = unscaled(assemble(case.company(effect)), seed)
        assert max(departures.values()) < 1e-8, departures


class HiddenUnit(Effect):
    """A law with a newton hidden in it."""

    name = "hidden_unit"
    says = "friction falls with the number of newtons"
    source = "control"
    parameters = (Parameter("steepness", "", 0.0, 1.0, 0.4, "n", "exponent"),)

    def terms(self, s: Situation) -> Terms:
        return Terms(level=-s.p.steepness * ca.log(s.normal_force))


def test_a_hidden_unit_is_seen(monkeypatch):
    monkeypatch.setattr(identify.model.model, "ALL", (*ALL, HiddenUnit()))
    monkeypatch.setattr(identify.model.model, "NAMES", (*(e.name for e in ALL), "hidden_unit"))
    departures = unscaled(assemble(case.company(HiddenUnit())), 0)
    assert departures["grip"] > 0.1 and departures["slip"] > 0.01


# ---- bounds


def _finite(model: Model, p: np.ndarray, random: np.random.Generator) -> bool:
    x, u = case.state(model, random), case.inputs(random, random.choice([-1.0, 1.0]))
    out = [case.result(model, name, x, p, u) for name in case.OF_STATE]
    for t in (0.0, 1e-9, 1e-3, 10.0, 1e6):
        out.append(case.result(model, "rest", x, p, u + t * np.eye(4)[TIME], t))
    out.append(case.result(model, "at_force", 0.9, p, u))
    return all(np.all(np.isfinite(values)) for values in out)


@EVERY
def test_parameters_at_their_bounds_give_finite_numbers(effect):
    model, random = assemble(case.company(effect)), np.random.default_rng(0)
    for i, q in enumerate(model.parameters):
        for bound in (q.lower, q.upper):
            p = case.values(model)
            p[i] = bound
            assert _finite(model, p, random), (q.name, bound)


def test_corners_of_the_box_give_finite_numbers():
    model, random = assemble(ALL_TOGETHER), np.random.default_rng(1)
    box = np.array([[q.lower, q.upper] for q in model.parameters])
    for _ in range(100):
        assert _finite(model, box[np.arange(len(box)), random.integers(0, 2, len(box))], random)


# ---- where a stick meets a slip


@EVERY
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_no_force_jumps_where_a_slip_begins(effect, direction):
    model, random = assemble(case.company(effect)), np.random.default_rng(3)
    x, p, u = case.state(model, random), case.values(model, random), case.inputs(random, direction)
    x[SPEED] = 0.0
    pull, grip = (case.result(model, name, x, p, u)[0] for name in ("driving_force", "grip"))
    assert case.result(model, "load", x, p, u)[0] == pytest.approx(pull, rel=1e-14)
    mass = p[model.parameter_names.index("mass")] if "mass" in model.parameter_names else 1.0
    acceleration = case.result(model, "slip", x, p, u)[SPEED]
    fall = direction * mass * acceleration - (direction * pull - grip)  # grip at rest less friction at no speed
    if "gamma" in [s.name for s in model.states]:
        assert fall == pytest.approx(0.0, abs=1e-12)
    else:
        assert fall > 0.0


@EVERY
def test_load_cell_settles_at_the_force_asked_for(effect):
    model, random = assemble(case.company(effect)), np.random.default_rng(4)
    p, u = case.values(model, random), case.inputs(random)
    x = case.result(model, "at_force", 0.83, p, u)
    assert case.result(model, "load_cell", x, p, u)[0] == pytest.approx(0.83, rel=1e-12)
    rates = dict(zip([s.name for s in model.states], case.result(model, "slip", x, p, u), strict=True))
    assert all(abs(rates[name]) < 1e-9 for name in rates if "lagged" in name or "deformation" in name)


# ---- numbers of a scene


# ---- save and load
