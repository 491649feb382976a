"""Maps over rig and pair: against closed forms, single answers and plain simulation."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from identify.base.errors import SimulationError
from identify.model.model import assemble
from identify.prediction.axes import Site, admissible, axis, check_axes, moved, quantity_of
from identify.prediction.batch import settle
from identify.prediction.draws import Draws
from identify.prediction.maps import chart, closed_plane, line_map, outline, plane
from identify.prediction.orbit import CycleMap
from identify.prediction.predict import solution_set
from identify.prediction.quantities import quantities
from tests.support.maps_case import ALL, DEMO, SITE, SPANS

sys.path.insert(0, str(Path(__file__).parents[2] / "experiments"))
import brute_force


@pytest.fixture(scope="module")
def speed_and_stiffness():
    return chart(SITE, ("drive_speed", "stiffness"), SPANS, (9, 7))


def entry(w, name):
    return float(w[(*SITE.model.parameter_names, "normal_force", "drive_speed").index(name)])


def test_a_quantity_moves_what_is_tied_to_it():
    w = moved(SITE, {"mu_k0": 0.5, "zeta": 0.1, "stiffness": 1000.0})
    assert [entry(w, n) for n in ("mu_k0", "mu_s", "damping")] == pytest.approx([0.5, 0.69, 200.0])
    w = moved(SITE, {"mu_k0": 0.5, "mu_step": 0.1})
    assert entry(w, "mu_s") == pytest.approx(0.6)
    assert entry(moved(SITE, {"pressure": 1e4, "area": 2e-4}), "normal_force") == pytest.approx(2.0)
    assert entry(moved(SITE, {"area": 1.6e-4}), "normal_force") == pytest.approx(2.0)  # pressure stays
    assert entry(moved(SITE, {}), "mu_s") == 0.62


def test_pressure_follows_the_area_law():
    law = Site(SITE.model, DEMO, 5e-3, 3.0, area=2.262e-4 * 3.0**0.2395, area_exponent=0.2395)
    load = entry(moved(law, {"pressure": 2 * axis(law, "pressure").value}), "normal_force")
    assert load / (2.262e-4 * load**0.2395) == pytest.approx(2 * 3.0 / law.area)


def test_under_pressure_dependence_the_nominal_area_moves_too():
    model = assemble((*ALL, "pressure_dependence"))
    values = {p.name: DEMO.get(p.name, p.default) for p in model.parameters}
    site = Site(model, values, 5e-3, 1.0, area=2.262e-4, area_exponent=values["area_exponent"])
    w = dict(zip(model.parameter_names, moved(site, {"pressure": 1e4, "normal_force": 2.0})[:-2], strict=True))
    area = w["contact_area"] * (2.0 / w["area_force"]) ** w["area_exponent"]
    assert 2.0 / area == pytest.approx(1e4)


def test_rows_of_settings_move_like_the_point_and_tell_their_quantities():
    rows = np.tile(SITE.setting, (2, 1))
    rows[1, SITE.model.parameter_names.index("mass")] *= 2.0
    for name, value in (("zeta", 0.1), ("mu_step", 0.1), ("pressure", 1e4), ("stiffness_at_zeta", 1e3)):
        together = moved(SITE, {name: np.array([value, value])}, rows)
        alone = moved(SITE, {name: value})
        np.testing.assert_allclose(together[0], alone, rtol=1e-12)
        assert quantity_of(SITE, name, together)[1] == pytest.approx(value)
        assert entry(together[1], "mass") == 2.0 * entry(alone, "mass")


def test_what_makes_no_map_is_refused_in_a_sentence():
    for names in (("mass", "mass"), ("zeta", "damping"), ("normal_force", "area")):
        with pytest.raises(SimulationError):
            check_axes(SITE, names)
    with pytest.raises(SimulationError, match="not known here"):
        axis(Site(SITE.model, DEMO, 5e-3, 1.0), "pressure")
    for span, points in (((2.0, 1.0), 5), ((-1.0, 1.0), 5), (None, 1)):
        with pytest.raises(SimulationError):
            plane(SITE, ("mass", "stiffness"), (span, None), (points, 5))
    assert not admissible(SITE.model, moved(SITE, {"mu_k0": 0.1}))
    assert admissible(SITE.model, SITE.setting)


def test_an_outline_encloses_the_area_of_its_region():
    """A ring, its crossings exact: the polygon misses it by the square of the mesh, half-way crossings by far more."""
    x = np.linspace(-1.0, 1.0, 41)
    grid_x, grid_y = np.meshgrid(x, x)
    radius = np.hypot(grid_x, grid_y)
    inside = (radius < 0.83) & (radius > 0.41)
    across = {}
    for name, fixed in (("x", x[:, None]), ("y", x[None, :])):
        along = 0.5 * (x[1:] + x[:-1])
        middle = along[None, :] if name == "x" else along[:, None]
        ends = [np.sign(middle) * np.sqrt(np.maximum(r * r - fixed**2, 0.0)) for r in (0.83, 0.41)]
        across[name] = np.where(np.abs(middle - ends[0]) < np.abs(middle - ends[1]), ends[0], ends[1])
    half = {name: np.full_like(values, np.nan) for name, values in across.items()}
    errors = []
    for crossings in (across, half):
        loops = [points for points, _ in outline(inside, x, x, crossings["x"], crossings["y"]).loops]
        areas = [0.5 * float(p[:, 0] @ np.roll(p[:, 1], -1) - p[:, 1] @ np.roll(p[:, 0], -1)) for p in loops]
        assert len(areas) == 2 and min(areas) < 0.0 < max(areas)  # the hole runs the other way round
        errors.append(abs(sum(areas) / (np.pi * (0.83**2 - 0.41**2)) - 1))
    assert errors[0] < 2e-3 < errors[1]
    assert all(
        line[0].tolist() == line[-1].tolist() for line in outline(inside, x, x, across["x"], across["y"]).lines()
    )


def test_nodes_of_a_map_are_the_single_answers(speed_and_stiffness):
    made = speed_and_stiffness
    assert set(made.shares) == {"always sticks", "never sticks", "bistable"}
    for j, i in ((0, 0), (3, 2), (6, 4), (3, 5), (1, 8)):
        w = made.plane.settings[j, i]
        map_ = CycleMap(SITE.model, w[-2], w[:-2])
        answer = solution_set(map_, w[-1])
        assert made.outcomes[j, i] == answer.outcome.value
        if answer.orbit is None:
            assert np.isnan(made.figures["drop"][j, i])
        else:
            drop, period, *_ = quantities(map_, answer.orbit.cycle, w[-1])
            assert made.figures["drop"][j, i] == pytest.approx(drop, rel=1e-4)
            assert made.figures["period"][j, i] == pytest.approx(period, rel=1e-4)


def test_the_end_on_a_map_is_where_simulation_stops_sticking(speed_and_stiffness):
    """One crossing of a row and one of a column, from the last rest state just inside."""
    made = speed_and_stiffness
    grid = made.plane
    j, i = np.argwhere(np.isfinite(made.sticking.across_x))[0]
    k, m = np.argwhere(np.isfinite(made.sticking.across_y))[0]
    crossings = (
        (made.sticking.across_x[j, i], grid.y_places[j], 1.0, 0.0),
        (grid.x_places[m], made.sticking.across_y[k, m], 0.0, 1.0),
    )
    for x, y, by_x, by_y in crossings:
        inward, state = 1.0 if by_x or np.isfinite(made.multiplier[k, m]) else -1.0, None
        for share, sticks in ((0.05, True), (0.01, True), (-0.01, False)):
            w = grid.at(np.array([x - by_x * inward * share]), np.array([y - by_y * inward * share]))[0]
            values = dict(zip(SITE.model.parameter_names, w[:-2].tolist(), strict=True))
            pair = brute_force.Pair.of(values, float(w[-2]))
            found = brute_force.settled(pair, float(w[-1]), *([] if state is None else [state]))
            assert (found is not None) is sticks
            state = None if found is None else found.end


def test_sliding_loses_stability_where_its_damping_vanishes(speed_and_stiffness):
    """Above v_cr that is c = -dmu_k a F_n exp(-a v), at every stiffness."""
    made = speed_and_stiffness
    found = np.argwhere(np.isfinite(made.unstable.across_x))
    assert len(found) == 7
    for j, i in found:
        damper = DEMO["damping"] * np.sqrt(DEMO["mass"] / made.plane.y_values[j])
        v = np.log(-DEMO["delta_mu_k"] * DEMO["a"] / damper) / DEMO["a"]
        assert made.unstable.across_x[j, i] == pytest.approx(np.log(v), abs=1e-7)


def test_sliding_that_jumps_to_stability_does_so_where_the_contact_wears_out():
    """Without weakening and with damping: unstable below v_cr = D/t_cr, stable above it."""
    site = Site(SITE.model, {**DEMO, "delta_mu_k": -1e-9}, 1e-4, 1.0)
    made = chart(site, ("drive_speed", "t_cr"), ((1e-5, 1e-3), (0.1, 1.0)), (6, 3))
    found = np.argwhere(np.isfinite(made.unstable.across_x))
    assert len(found) == 3
    for j, i in found:
        assert np.exp(made.unstable.across_x[j, i]) == pytest.approx(DEMO["D"] / made.plane.y_values[j], rel=1e-3)


@pytest.mark.parametrize(("name", "below"), [("drive_speed", True), ("normal_force", False), ("damping", True)])
def test_a_line_ends_where_simulation_does(name, below):
    answer = line_map(SITE, name, points=16)
    (end,) = answer.ends
    assert end.below is below
    sign, state = (1.0 if below else -1.0), None
    for share in (0.05, 0.01, -0.01):
        w = moved(SITE, {name: end.value * (1.0 - sign * share)})
        values = dict(zip(SITE.model.parameter_names, w[:-2].tolist(), strict=True))
        found = brute_force.settled(
            brute_force.Pair.of(values, float(w[-2])), float(w[-1]), *([] if state is None else [state])
        )
        assert (found is not None) is (share > 0.0)
        state = None if found is None else found.end
    if name == "drive_speed":
        single = solution_set(CycleMap(SITE.model, 1.0, SITE.setting[:-2]), 5e-3)
        assert end.value == pytest.approx(single.end, rel=1e-3)
        i = int(np.argmin(np.abs(answer.values - 5e-3)))
        orbit = settle(CycleMap(SITE.model, 1.0, SITE.setting[:-2]), float(answer.values[i])).orbit
        assert orbit is not None
        np.testing.assert_allclose(np.abs(answer.multipliers[i]), np.abs(orbit.multipliers), atol=1e-3)


def test_multipliers_are_how_a_disturbance_shrinks_in_simulation():
    """The arrest force, pushed off its cycle, comes back by the largest multiplier in each cycle."""
    answer = line_map(SITE, "drive_speed", (1e-3, 1.1e-3), 2)
    multiplier = answer.multipliers[0, 0].real
    pair, speed = brute_force.Pair.of(DEMO), float(answer.values[0])
    closed = brute_force.settled(pair, speed)
    assert closed is not None and 0.1 < multiplier < 0.3
    away = closed.end[0] + 1e-4 / DEMO["stiffness"]
    gaps = []
    for x in (away, closed.end[0]):
        found = brute_force.jump(pair, (x, closed.end[1]), speed)
        assert found is not None
        gaps.append(found.end[0])
    assert (gaps[0] - gaps[1]) * DEMO["stiffness"] / 1e-4 == pytest.approx(multiplier, rel=1e-2)


def test_an_interval_of_an_end_is_how_far_it_moves_with_what_is_known():
    """The end over drive speed where a alone is uncertain: between the ends of the outer values of a."""
    sd = 3.0
    values = DEMO | {"drive_speed": 5e-3, "normal_force": 1.0}
    draws = Draws.of(SITE.model, values, ("a",), np.array([[sd**2]]))
    (end,) = line_map(SITE, "drive_speed", (1e-2, 5e-2), 8, draws).ends
    assert end.interval is not None
    for side, found in ((1.0, end.interval.low), (-1.0, end.interval.high)):
        outer = Site(SITE.model, {**DEMO, "a": DEMO["a"] * np.exp(side * 1.959964 * sd / DEMO["a"])}, 5e-3, 1.0)
        exact = solution_set(CycleMap(SITE.model, 1.0, outer.setting[:-2]), 5e-3).end
        assert found == pytest.approx(exact, rel=1e-3)
        assert abs(exact / end.value - 1.0) > 5e-3


def test_closed_forms_lie_on_the_map_where_they_are_exact():
    """Without ageing and weakening eq. 18 is where the map of the nonlinear model ends; with them it is not valid."""
    model = assemble(("inertia", "hysteresis_damping"))
    site = Site(model, {name: DEMO[name] for name in model.parameter_names}, 2e-2, 1.0)
    made = chart(site, ("drive_speed", "damping"), ((2e-3, 0.2), (60.0, 600.0)), (8, 4))
    closed = closed_plane(made.plane)
    assert closed is not None and np.all(closed.valid)
    rows = np.nanmax(made.sticking.across_x, axis=1)
    assert rows.size == 4 and np.all(np.isfinite(rows))
    for j, place in enumerate(rows):
        assert np.interp(made.plane.y_places[j], closed.y, _zeros(closed)) == pytest.approx(place, abs=6e-3)
    assert not np.any(closed_plane(plane(SITE, ("drive_speed", "stiffness"), SPANS)).valid)
    assert closed_plane(plane(Site(*_with_pressure()), ("drive_speed", "stiffness"), SPANS, (3, 3))) is None


def _zeros(closed):
    """Where the margin of the slip rises through zero, row by row."""
    return [float(np.interp(0.0, row, closed.x)) for row in closed.slip]


def _with_pressure():
    model = assemble((*ALL, "pressure_dependence"))
    return model, {p.name: DEMO.get(p.name, p.default) for p in model.parameters}, 5e-3, 1.0


def test_jumps_that_fade_away_end_where_sliding_becomes_stable():
    """Slow drive: no fold; the jumps get smaller than any resolution just before the boundary of eq. 25."""
    site = Site(SITE.model, DEMO, 1e-4 / 60, 1.0)
    answer = line_map(site, "D", (1e-4, 3e-4), 6)
    (end,), (loss,) = answer.ends, answer.losses
    assert end.below and end.value == pytest.approx(loss.value, rel=2e-3)
    assert np.nanmin(answer.figures["drop"]) < 1e-3
    for share, sticks in ((0.98, True), (1.02, False)):
        pair = brute_force.Pair.of({**DEMO, "D": share * end.value})
        assert (brute_force.settled(pair, site.drive_speed) is not None) is sticks
