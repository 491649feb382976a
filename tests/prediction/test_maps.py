"""Maps over rig and pair: against closed forms, single answers and plain simulation."""

from __future__ import annotations

import numpy as np
import pytest

from experiments import brute_force
from identify.base.errors import SimulationError
from identify.model.model import assemble
from identify.prediction.axes import Site, admissible, axis, check_axes, moved
from identify.prediction.maps import line_map, plane, stability_map
from identify.prediction.predict import predict
from tests.support.maps_case import ALL, DEMO, SITE, SPANS


@pytest.fixture(scope="module")
def speed_and_stiffness():
    return stability_map(SITE, "drive_speed", "stiffness", *SPANS, (9, 7))


def entry(w, name):
    return float(w[(*SITE.model.parameter_names, "normal_force", "drive_speed").index(name)])


def sticks_inside_only(settings):
    """Plain simulation at settings just inside an end of stick-slip, and at last just outside it; each goes on from the
    one before."""
    state = None
    for i, w in enumerate(settings):
        pair = brute_force.Pair(dict(zip(SITE.model.parameter_names, w[:-2].tolist(), strict=True)), float(w[-2]))
        found = brute_force.settled(pair, float(w[-1]), *([] if state is None else [state]))
        if (found is not None) is (i == len(settings) - 1):
            return False
        state = None if found is None else found.end
    return True


def test_a_quantity_moves_what_is_tied_to_it():
    w = moved(SITE, {"mu_k0": 0.5, "zeta": 0.1, "stiffness": 1000.0})
    assert [entry(w, n) for n in ("mu_k0", "mu_s", "damping")] == pytest.approx([0.5, 0.69, 200.0])
    w = moved(SITE, {"mu_k0": 0.5, "mu_step": 0.1})
    assert entry(w, "mu_s") == pytest.approx(0.6)
    assert entry(moved(SITE, {"pressure": 1e4, "area": 2e-4}), "normal_force") == pytest.approx(2.0)
    assert entry(moved(SITE, {"area": 1.6e-4}), "normal_force") == pytest.approx(2.0)  # pressure stays
    law = Site(SITE.model, DEMO, 5e-3, 3.0, area=2.262e-4 * 3.0**0.2395, area_exponent=0.2395)
    load = entry(moved(law, {"pressure": 2 * axis(law, "pressure").value}), "normal_force")
    assert load / (2.262e-4 * load**0.2395) == pytest.approx(2 * 3.0 / law.area)


def test_under_pressure_dependence_the_nominal_area_moves_too():
    model = assemble((*ALL, "pressure_dependence"))
    values = {p.name: DEMO.get(p.name, p.default) for p in model.parameters}
    site = Site(model, values, 5e-3, 1.0, area=2.262e-4, area_exponent=values["area_exponent"])
    w = dict(zip(model.parameter_names, moved(site, {"pressure": 1e4, "normal_force": 2.0})[:-2], strict=True))
    assert 2.0 / (w["contact_area"] * (2.0 / w["area_force"]) ** w["area_exponent"]) == pytest.approx(1e4)


def test_what_makes_no_map_is_refused_in_a_sentence():
    for names in (("mass", "mass"), ("zeta", "damping"), ("normal_force", "area")):
        with pytest.raises(SimulationError):
            check_axes(SITE, names)
    for ranges, points in (((None, None), (1, 5)), (((1.0, 0.5), None), (5, 5)), (((-1.0, 1.0), None), (5, 5))):
        with pytest.raises(SimulationError, match="expected"):
            plane(SITE, ("stiffness", "drive_speed"), ranges, points)
    grid = plane(SITE, ("mu_step", "delta_mu_k"), ((0.01, 0.5), (-0.5, -0.1)), (5, 5))
    assert not np.all(grid.admitted) and admissible(SITE.model, SITE.setting)


def test_nodes_of_a_map_are_the_single_answers(speed_and_stiffness):
    made = speed_and_stiffness
    assert set(made.shares) == {"always sticks", "never sticks", "bistable"}
    for j, i in ((0, 0), (3, 2), (3, 5), (1, 8)):
        grid = made.plane
        answer = predict(Site(SITE.model, DEMO | {"stiffness": grid.y_values[j]}, grid.x_values[i], 1.0))
        assert made.outcomes[j, i] == answer.stability.outcome
        period = answer.amplitude.numbers["period"].value
        assert made.figures["period"][j, i] == pytest.approx(
            np.nan if period is None else period, rel=1e-4, nan_ok=True
        )


def test_the_end_on_a_map_is_where_simulation_stops_sticking(speed_and_stiffness):
    """Of a crossing along either quantity, 1 % inside and 1 % outside."""
    made = speed_and_stiffness
    grid, shares = made.plane, np.array([0.05, 0.01, -0.01])[:, None]
    (line,) = made.sticking.lines()
    for along in (0, 1):
        on_grid = [p for p in line if not np.any(np.isclose(p[along], (grid.x_places, grid.y_places)[along]))]
        place = on_grid[len(on_grid) // 2]
        j, i = np.argmin(np.abs(grid.y_places - place[1])), np.argmin(np.abs(grid.x_places - place[0]))
        node = np.array([grid.x_places[i], grid.y_places[j]])
        sticks = np.isfinite(made.figures["drop"][j, i])
        inward = np.eye(2)[along] * np.sign(node - place)[along] * (1.0 if sticks else -1.0)
        values = place + shares * inward
        settings = moved(SITE, {"drive_speed": np.exp(values[:, 0]), "stiffness": np.exp(values[:, 1])})
        assert sticks_inside_only(settings)


def test_sliding_loses_stability_where_its_damping_vanishes(speed_and_stiffness):
    """Above v_cr that is c = -dmu_k a F_n exp(-a v), at every stiffness."""
    made = speed_and_stiffness
    (line,) = made.values_of(made.unstable)
    damper = DEMO["damping"] * np.sqrt(DEMO["mass"] / line[:, 1])
    np.testing.assert_allclose(line[:, 0], np.log(-DEMO["delta_mu_k"] * DEMO["a"] / damper) / DEMO["a"], rtol=1e-6)
    assert len(line) >= 7


def test_sliding_that_jumps_to_stability_does_so_where_the_contact_wears_out():
    """Without weakening and with damping: unstable below v_cr = D/t_cr, stable above it."""
    site = Site(SITE.model, {**DEMO, "delta_mu_k": -1e-9}, 1e-4, 1.0)
    made = stability_map(site, "drive_speed", "t_cr", (1e-5, 1e-3), (0.1, 1.0), (6, 3))
    (line,) = made.values_of(made.unstable)
    np.testing.assert_allclose(line[:, 0], DEMO["D"] / line[:, 1], rtol=1e-3)


@pytest.mark.parametrize(("name", "below"), [("drive_speed", True), ("normal_force", False), ("damping", True)])
def test_a_line_ends_where_simulation_does(name, below):
    answer = line_map(SITE, name, points=16)
    ((end, lies_below),) = answer.changes(answer.sticking)
    assert lies_below is below
    sign = 1.0 if below else -1.0
    assert sticks_inside_only(moved(SITE, {name: end * (1.0 - sign * np.array([0.05, 0.01, -0.01]))}))


def test_jumps_that_fade_away_end_where_sliding_becomes_stable():
    """Slow drive: no fold; the jumps get smaller than any resolution just before the boundary of eq. 25."""
    site = Site(SITE.model, DEMO, 1e-4 / 60, 1.0)
    answer = line_map(site, "D", (1e-4, 3e-4), 6)
    ((end, below),), ((loss, _),) = answer.changes(answer.sticking), answer.changes(answer.unstable)
    assert below and end == pytest.approx(loss, rel=2e-3)
    assert np.nanmin(answer.figures["drop"]) < 1e-3
    for share, sticks in ((0.98, True), (1.02, False)):
        pair = brute_force.Pair({**DEMO, "D": share * end})
        assert (brute_force.settled(pair, site.drive_speed) is not None) is sticks
