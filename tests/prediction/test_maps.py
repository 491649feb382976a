"""Maps and continuations over rig and pair: against closed forms, single answers and plain simulation."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from identify.base.errors import SimulationError
from identify.model.model import assemble
from identify.prediction import chart as chart_room
from identify.prediction import cycle as cycle_room
from identify.prediction import orbit_search
from identify.prediction.chart import chart, losses_of_stability
from identify.prediction.chart_bands import KnownCovariance, bands, closed_plane, region
from identify.prediction.continuation import continuation
from identify.prediction.cycle import CycleMap
from identify.prediction.map_axes import Site, admissible, axis, check_axes, known_axes, moved, setting_path, slopes
from identify.prediction.map_grid import outline, plane
from identify.prediction.orbit import settle
from identify.prediction.quantities import quantities
from identify.prediction.solutions import solution_set
from identify.simulation.sliding import growth_rates
from tests.support.maps_case import ALL, DEMO, SITE, SPANS

sys.path.insert(0, str(Path(__file__).parents[2] / "experiments"))
import brute_force


@pytest.fixture
def slips_counted(monkeypatch):
    """The clock of a map shows the slips that it has integrated."""
    counted, slide = [0], cycle_room.Machine.slide

    def counting(*given, **how):
        counted[0] += 1
        return slide(*given, **how)

    monkeypatch.setattr(cycle_room.Machine, "slide", counting)
    for module in (chart_room, orbit_search):
        monkeypatch.setattr(module, "process_time", lambda: float(counted[0]))


@pytest.mark.parametrize("names", [("drive_speed", "stiffness"), ("damping", "mass"), ("t_cr", "D")])
def test_a_map_says_what_more_points_cost(slips_counted, names):
    coarse, fine = (chart(SITE, names, points=(n, n)) for n in (8, 16))
    whole = coarse.cost.seconds(1.0)
    assert coarse.cost.seconds(2.0) == pytest.approx(fine.cost.seconds(1.0), rel=0.3)
    assert fine.cost.seconds(0.5) == pytest.approx(whole, rel=0.3)
    if coarse.sticking.crossings:
        assert 4.0 * whole > 1.3 * fine.cost.seconds(1.0), "nodes alone would say too much"


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


@pytest.mark.parametrize("name", known_axes(SITE.model))
def test_slopes_of_settings_are_exact(name):
    value, step = axis(SITE, name).value, 1e-6 * abs(axis(SITE, name).value)
    by_difference = (moved(SITE, {name: value + step}) - moved(SITE, {name: value - step})) / (2 * step)
    np.testing.assert_allclose(slopes(SITE, {name: value}, name), by_difference, rtol=1e-6, atol=1e-9)
    q = axis(SITE, name)
    way = setting_path(SITE, q)
    place = q.place(value)
    by_place = (way.setting(place + 1e-6) - way.setting(place - 1e-6)) / 2e-6
    np.testing.assert_allclose(way.slope(place), by_place, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(way.setting(place), SITE.setting, rtol=1e-12)


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
        loops = outline(inside, x, x, crossings["x"], crossings["y"])
        areas = [0.5 * float(p[:, 0] @ np.roll(p[:, 1], -1) - p[:, 1] @ np.roll(p[:, 0], -1)) for p in _points(loops)]
        assert len(areas) == 2 and min(areas) < 0.0 < max(areas)  # the hole runs the other way round
        assert all(loop.open_pieces()[0][0] == loop.open_pieces()[0][-1] for loop in loops)
        errors.append(abs(sum(areas) / (np.pi * (0.83**2 - 0.41**2)) - 1))
    assert errors[0] < 2e-3 < errors[1]


def _points(loops):
    return [loop.points for loop in loops]


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
    for kind in ("x", "y"):
        edge = next(e for e in made.sticking.crossings if e[0] == kind)
        crossing = made.sticking.crossings[edge]
        way, begin, _ = made.plane.way(edge)
        inward = 1.0 if np.isfinite(made.multiplier[edge[1], edge[2]]) else -1.0
        assert begin < crossing.place
        state = None
        for share, sticks in ((0.05, True), (0.01, True), (-0.01, False)):
            w = way.setting(crossing.place - inward * share)
            values = dict(zip(SITE.model.parameter_names, w[:-2].tolist(), strict=True))
            pair = brute_force.Pair.of(values, float(w[-2]))
            found = brute_force.settled(pair, float(w[-1]), *([] if state is None else [state]))
            assert (found is not None) is sticks
            state = None if found is None else found.end


def test_an_end_moves_as_the_boundary_through_other_quantities_says(speed_and_stiffness):
    """On the end, dv/dk by the derivatives of the end over speed and over stiffness, and by the boundary itself."""
    made = speed_and_stiffness
    names = (*SITE.model.parameter_names, "normal_force", "drive_speed")
    k, v = names.index("stiffness"), names.index("drive_speed")
    rows = [(edge, c) for edge, c in made.sticking.crossings.items() if edge[0] == "x"]
    (lower, first), (upper, second) = (min(rows, key=lambda r: abs(r[0][1] - j)) for j in (2, 3))
    ln_k = made.plane.y_places
    chord = (second.place - first.place) / (ln_k[upper[1]] - ln_k[lower[1]])
    exact = [c.slopes[k] * made.plane.y_values[e[1]] for e, c in ((lower, first), (upper, second))]
    assert chord == pytest.approx(np.mean(exact), rel=1e-2)  # each end is closed in on to 2e-4
    down = next(c for e, c in made.sticking.crossings.items() if e[0] == "y")
    assert np.isfinite(down.slopes[v]) and down.slopes[v] > 0.0


def test_sliding_loses_stability_where_its_damping_vanishes(speed_and_stiffness):
    """Above v_cr that is c = -dmu_k a F_n exp(-a v), at every stiffness; and so are its derivatives."""
    made = speed_and_stiffness
    found = [(edge, c) for edge, c in made.unstable.crossings.items() if edge[0] == "x"]
    assert len(found) == 7
    names = (*SITE.model.parameter_names, "normal_force", "drive_speed")
    for edge, crossing in found:
        damper = DEMO["damping"] * np.sqrt(DEMO["mass"] / made.plane.y_values[edge[1]])
        v = np.log(-DEMO["delta_mu_k"] * DEMO["a"] / damper) / DEMO["a"]
        assert crossing.place == pytest.approx(np.log(v), abs=1e-7)
        by_mass, by_load = (crossing.slopes[names.index(n)] for n in ("mass", "normal_force"))
        assert by_mass == pytest.approx(-0.5 / (DEMO["a"] * DEMO["mass"]) / v, rel=1e-5)
        assert by_load == pytest.approx(1 / (DEMO["a"] * v), rel=1e-5)


def test_sliding_that_jumps_to_stability_does_so_where_the_contact_wears_out():
    """Without weakening and with damping: unstable below v_cr = D/t_cr, stable above it."""
    site = Site(SITE.model, {**DEMO, "delta_mu_k": -1e-9}, 1e-4, 1.0)
    grid = plane(site, ("drive_speed", "t_cr"), ((1e-5, 1e-3), (0.1, 1.0)), (6, 3))
    growth = growth_rates(site.model, grid.settings.reshape(-1, 11)).reshape(grid.shape)
    found = {edge: c for edge, c in losses_of_stability(grid, growth).items() if edge[0] == "x"}
    assert len(found) == 3
    for edge, crossing in found.items():
        t_cr = grid.y_values[edge[1]]
        assert np.exp(crossing.place) == pytest.approx(DEMO["D"] / t_cr, rel=1e-3)
        assert crossing.slopes[site.model.parameter_names.index("t_cr")] == pytest.approx(-1 / t_cr, rel=1e-2)


@pytest.mark.parametrize(("name", "below"), [("drive_speed", True), ("normal_force", False), ("damping", True)])
def test_a_continuation_ends_where_simulation_does(name, below):
    answer = continuation(SITE, name, points=16)
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
        np.testing.assert_allclose(np.abs(answer.multipliers[i]), np.abs(orbit.multipliers), atol=1e-5)


def test_multipliers_are_how_a_disturbance_shrinks_in_simulation():
    """The arrest force, pushed off its cycle, comes back by the largest multiplier in each cycle."""
    answer = continuation(SITE, "drive_speed", (1e-3, 1.1e-3), 2)
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


def test_a_band_reaches_as_far_as_the_boundary_moves(speed_and_stiffness):
    sd = 0.004
    known = KnownCovariance.of(("mu_s",), np.array([[sd**2]]))
    ((left, right),) = bands(speed_and_stiffness.plane, speed_and_stiffness.sticking, known)
    other = Site(SITE.model, {**DEMO, "mu_s": DEMO["mu_s"] + 1.959964 * sd}, 5e-3, 1.0)
    again = chart(other, ("drive_speed", "stiffness"), SPANS, (9, 7))
    ((points, _),) = again.sticking.lines()
    size = np.ptp(points, axis=0)
    far = [np.min(np.linalg.norm((side[:, None] - points) / size, axis=2)) for side in (left, right)]
    inner = np.interp(np.median(points[:, 1]), *_by_height(points))
    sides = [np.interp(np.median(points[:, 1]), *_by_height(side)) for side in (left, right)]
    ((middle, _),) = speed_and_stiffness.sticking.lines()
    half = inner - np.interp(np.median(points[:, 1]), *_by_height(middle))
    assert min(far) < 0.02
    assert abs(half) == pytest.approx(0.5 * abs(sides[0] - sides[1]), rel=0.1)
    assert bands(speed_and_stiffness.plane, speed_and_stiffness.unstable, known)  # mu_s does not move it: a line
    flat = bands(speed_and_stiffness.plane, speed_and_stiffness.unstable, known)[0]
    assert np.allclose(*flat, atol=1e-9)


def _by_height(points):
    order = np.argsort(points[:, 1])
    return points[order, 1], points[order, 0]


def test_the_region_of_the_point_is_what_is_known_of_the_two_quantities():
    grid = plane(SITE, ("t_cr", "D"), points=(3, 3))
    cov = np.diag([0.02, 1e-6]) ** 2
    ring = region(grid, KnownCovariance.of(("t_cr", "D"), cov))
    half = np.ptp(ring, axis=0) / 2
    np.testing.assert_allclose(half, np.sqrt(5.991464547) * np.array([0.02 / 0.5, 1e-6 / 37.4e-6]), rtol=1e-3)
    assert region(grid, KnownCovariance.of(("mu_s",), np.array([[1e-4]]))) is None
    assert KnownCovariance.of(("mu_s",), np.array([[np.inf]])) is None


def test_closed_forms_lie_on_the_map_where_they_are_exact():
    """Without ageing and weakening eq. 18 is where the map of the nonlinear model ends; with them it is not valid."""
    model = assemble(("inertia", "hysteresis_damping"))
    site = Site(model, {name: DEMO[name] for name in model.parameter_names}, 2e-2, 1.0)
    made = chart(site, ("drive_speed", "damping"), ((2e-3, 0.2), (60.0, 600.0)), (8, 4))
    closed = closed_plane(made.plane)
    assert closed is not None and np.all(closed.valid)
    rows = {edge[1]: crossing.place for edge, crossing in made.sticking.crossings.items() if edge[0] == "x"}
    assert sorted(rows) == [0, 1, 2, 3]
    for j, place in rows.items():
        assert np.interp(made.plane.y_places[j], closed.y, _zeros(closed)) == pytest.approx(place, abs=2e-3)
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
    answer = continuation(site, "D", (1e-4, 3e-4), 6)
    (end,), (loss,) = answer.ends, answer.losses
    assert end.below and end.value == pytest.approx(loss.value, rel=2e-3)
    assert np.nanmin(answer.figures["drop"]) < 1e-3
    for share, sticks in ((0.98, True), (1.02, False)):
        pair = brute_force.Pair.of({**DEMO, "D": share * end.value})
        assert (brute_force.settled(pair, site.drive_speed) is not None) is sticks
