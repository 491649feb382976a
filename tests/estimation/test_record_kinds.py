"""Logs that are no train of equal cycles: sliding, holds, steps, strokes, gaps; each found, its wrong twin refused."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from data_io import Record
from experiments.record_kinds import (
    DEMO,
    FAST,
    HOLDS,
    KINDS,
    MILD,
    RIG,
    SLIDING,
    SLOW,
    STEPS,
    STIFF,
    STROKES,
    Kind,
    Log,
)
from identify import Scene, fit
from identify.base.outcome import Status
from identify.effects import MAIN
from identify.estimation import search
from identify.estimation.certainty import _lower_start, certainty, information_at
from identify.estimation.covariance import information
from identify.estimation.goodness_of_fit import Gate
from identify.logs.parting import _unrecorded, gaps_apart, name_of, parts_of, strokes_apart
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.shooting.blocks import AgeingBlock, RestBlock, SlideBlock, SteadyBlock
from identify.shooting.following import follow, glide
from identify.shooting.grid import COARSE_GRID
from identify.shooting.shooting import shooting_problem
from identify.simulation.drive import Drive
from identify.simulation.simulate import run
from identify.simulation.sliding import lasting
from tests.support import oracle

MODEL = assemble(MAIN)
NAMES = MODEL.parameter_names


def _kind(*logs, pair=DEMO, rig=RIG):
    return Kind("", logs, logs, pair, rig)


def _prepared(kind, seed=1):
    scene, records = kind.made(seed)
    unknowns = from_scene(scene)
    return [prepare(scene, e, r, unknowns) for e, r in zip(scene.logs, records, strict=True)], unknowns


def _free(unknowns):
    return [(i, unknowns.names[j]) for i, j in enumerate(np.flatnonzero(unknowns.free).tolist())]


def _covariance(attempt):
    solved = attempt.solved
    at = replace(solved.problem.layout.unknowns, start=solved.theta)
    made = solved.problem.with_all_parameters(at, solved.solution.z)
    return information(*made).covariance()


def _off(result, truth):
    """Largest error of what has an interval, in standard errors."""
    told = {n: p for n, p in result["parameters"].items() if p["standard_error"] is not None}
    return max(abs(p["value"] - truth[n]) / p["standard_error"] for n, p in told.items()), len(told)


@pytest.mark.parametrize(
    ("log", "truth"),
    [(STEPS, DEMO | RIG), (HOLDS, DEMO | RIG), (STROKES, DEMO | RIG), (replace(SLIDING, duration=0.5), DEMO | RIG)],
    ids=["steps", "holds", "strokes", "sliding"],
)
def test_the_records_are_those_of_an_independent_integrator(log, truth):
    drive = log.drive if isinstance(log.drive, tuple) else ((0.0, log.drive),)
    duration = min(log.duration, 3.2)
    ours = run(MODEL, truth, drive, 1.0, duration)
    theirs = oracle.simulate(truth, drive, 1.0, duration)
    times = np.linspace(0.0, duration, 1001)[1:-1]
    times = times[np.min(np.abs(times[:, None] - [t for t, _ in drive]), axis=1) > 1e-6]
    np.testing.assert_allclose(ours.sample(times)["force"], theirs.force(times), atol=2e-6)


def test_steady_sliding_is_the_closed_form_and_fades_where_it_is_stable():
    for pair, rig, speed, worn in ((DEMO, RIG, 0.05, True), (MILD, STIFF, 1e-3, True), (MILD, STIFF, 1e-5, False)):
        values = pair | rig
        p, u = np.array([values[n] for n in NAMES]), np.array([speed, 1.0, 1.0, 0.0])
        found = lasting(MODEL, p, u)
        mu_k = values["mu_k0"] + values["delta_mu_k"] * -np.expm1(-values["a"] * speed)
        gamma = max(0.0, 1.0 - speed * values["t_cr"] / values["D"])
        assert found.worn is worn
        shown = float(MODEL.load_cell(found.state, p, u))
        assert shown == pytest.approx(mu_k + (values["mu_s"] - mu_k) * gamma, rel=1e-9)
        assert found.stable
    slow = lasting(MODEL, np.array([(DEMO | RIG)[n] for n in NAMES]), np.array([1e-3, 1.0, 1.0, 0.0]))
    assert slow is not None and not slow.stable


@pytest.mark.parametrize(("log", "pair", "rig"), [(HOLDS, DEMO, RIG), (KINDS[6].logs[0], MILD, STIFF)])
def test_a_course_at_the_truth_joins_up_and_fits(log, pair, rig):
    """Every stretch ends where the next begins, and the misfit is noise before anything is solved; with the drive
    told wrong it is not."""
    (prepared,), unknowns = _prepared(_kind(log, pair=pair, rig=rig))
    data = prepared.data
    p = np.array([(pair | rig)[n] for n in unknowns.names])
    at = replace(unknowns, start=unknowns.theta(p, data.base))
    found = follow(unknowns.model, data, p, begins_sliding=False)
    problem = shooting_problem([data], [found.trajectory], at, COARSE_GRID)
    assert found.end == data.end
    assert 2 * problem.evaluate(problem.start, derivatives=False).cost < 1.5 * problem.samples
    # As many unknowns as rows, but for the parameters, the load of each part, elongation and gamma at the begin.
    assert problem.layout.size - problem.layout.rows == int(unknowns.free.sum()) + found.trajectory.parts + 2
    other = replace(data, programme=Drive(data.programme.starts, tuple(1.5 * v for v in data.programme.speeds)))
    wrong = follow(unknowns.model, other, p, begins_sliding=False)
    problem = shooting_problem([other], [wrong.trajectory], at, COARSE_GRID)
    assert 2 * problem.evaluate(problem.start, derivatives=False).cost > 3 * problem.samples


def test_the_derivatives_of_a_course_are_those_of_differences():
    (prepared,), unknowns = _prepared(_kind(KINDS[6].logs[0], pair=MILD, rig=STIFF))
    p = np.array([(MILD | STIFF)[n] for n in unknowns.names])
    at = replace(unknowns, start=unknowns.theta(p, prepared.data.base))
    trajectory = follow(unknowns.model, prepared.data, p, begins_sliding=False).trajectory
    problem = shooting_problem([prepared.data], [trajectory], at, COARSE_GRID)
    kinds = {family.block.kind for family in problem.layout.families}
    steps = COARSE_GRID.steps
    slides = {SlideBlock(steps, worn=True), SlideBlock(steps), SteadyBlock(worn=True)}
    assert slides | {RestBlock("time"), RestBlock("onset"), AgeingBlock()} <= kinds
    z, random = problem.start, np.random.default_rng(1)
    point = problem.evaluate(z, derivatives=True)
    for _ in range(3):
        way = random.standard_normal(z.size)
        h = 1e-6
        ahead, behind = (problem.evaluate(z + s * h * way, derivatives=False) for s in (1.0, -1.0))
        slope = (ahead.rows - behind.rows) / (2 * h)
        assert np.max(np.abs(slope - point.jacobian @ way)) < 1e-6 * np.max(np.abs(slope))
        assert (ahead.cost - behind.cost) / (2 * h) == pytest.approx(point.gradient @ way, rel=1e-6)


@pytest.mark.slow
def test_sliding_sharpens_a_fit_and_one_at_another_speed_is_left_out():
    logs, unknowns = _prepared(_kind(SLOW, FAST, SLIDING), seed=2)
    alone, _ = search.search(search.SearchProblem(logs[:2], unknowns))
    joined, left_out = search.search(search.SearchProblem(logs, unknowns))
    assert alone.gate.status is joined.gate.status is Status.CONVERGED
    assert joined.log_numbers == (0, 1, 2) and not left_out
    free = np.flatnonzero(unknowns.free).tolist()
    sd = {n: [float(np.sqrt(c[i, i])) for c in map(_covariance, (alone, joined))] for i, n in _free(unknowns)}
    assert sd["a"][1] < 0.7 * sd["a"][0]
    truth = unknowns.theta(np.array([(DEMO | RIG)[n] for n in unknowns.names]), logs[0].data.base)
    assert max(abs(joined.solved.theta - truth)[i] / sd[unknowns.names[i]][1] for i in free) < 4.0
    logs, unknowns = _prepared(_kind(SLOW, FAST, replace(SLIDING, said=5e-3)), seed=2)
    wrong, left_out = search.search(search.SearchProblem(logs, unknowns))
    assert wrong.log_numbers == (0, 1) and "log_3.csv" in left_out[2]


def test_one_log_with_steps_of_speed_tells_all_six_and_a_wrong_step_is_refused(no_further_logs):
    kind = next(kind for kind in KINDS if kind.name == "speed steps")
    result = fit(*kind.made(1)).result
    assert result["status"] == "converged", result["message"]
    off, told = _off(result, DEMO)
    assert (told, off < 4.0) == (6, True)
    assert len(result["logs"]) == 1 and result["logs"][0]["drive_speed_m_per_s"] == 5e-3


def test_holds_between_sticks_tell_how_the_contact_ages(no_further_logs):
    scene, records = _kind(HOLDS).made(1)
    known = {name: replace(scene.parameters[name], fixed=DEMO[name]) for name in ("a", "delta_mu_k")}  # what slips tell
    result = fit(replace(scene, parameters={**scene.parameters, **known}), records).result
    assert result["status"] == "converged", result["message"]
    assert _off(result, DEMO)[0] < 4.0
    t_cr = result["parameters"]["t_cr"]
    assert t_cr["standard_error"] < 0.01 * t_cr["value"], "a stick without holds tells it to a fifth"


def test_strokes_become_logs_with_their_sign_and_rests_are_left_out(no_further_logs):
    scene, records = _kind(STROKES).made(1)
    cut, copies = strokes_apart(scene, records)
    half = np.pi * np.sqrt(RIG["mass"] / RIG["stiffness"])  # a slip may go on so long after a turn without a rest
    assert [entry.window for entry in cut.logs] == [
        (0.0, 2.0),
        (2.5, 3.5),
        (4.0, 6.0),
        (pytest.approx(6.0 + half), 7.0),
    ]
    assert len(copies) == 4 and copies[3] is records[0]
    assert name_of(cut.logs[1]) == "log_1.csv, stroke 2 back"
    assert parts_of(scene, cut.logs) == [1, 1, 1, 1] and parts_of(scene, scene.logs) == [None]
    assert strokes_apart(cut, copies) == (cut, copies), "what goes one way is left alone"
    result = fit(scene, records).result
    assert result["status"] == "converged", result["message"]
    assert [log["friction_sign"] for log in result["logs"]] == [1, -1, 1, -1]
    assert _off(result, DEMO)[0] < 4.0


def test_a_stroke_begins_when_the_slip_that_the_drive_turned_in_is_over():
    values = {**DEMO, **RIG}
    first = run(assemble(MAIN), values, 1e-3, 1.0, 2.0, start={"gamma": 0.0}).onsets
    turn = round(float(first[3]) + 0.015, 3)
    log = Log(((0.0, 1e-3), (turn, -1e-3)), turn + 2.0, 1000.0)
    scene, records = _kind(log).made(1)
    cut, _ = strokes_apart(scene, records)
    motion = run(assemble(MAIN), values, log.drive, 1.0, log.duration, start={"gamma": log.gamma})
    begun = motion.sample(np.array([turn, cut.logs[1].window[0], cut.logs[1].window[0] + 0.1]))["sliding_speed"]
    assert begun[0] > 1e-3 and begun[1] == begun[2] == 0.0, "it slides on, and then rests"


def test_a_position_column_tells_strokes_where_one_speed_is_stated():
    scene, (record,) = _kind(replace(STROKES, said=1e-3)).made(1)
    starts, speeds = np.array(STROKES.drive).T
    speed = np.sign(speeds[np.searchsorted(starts, record.time, side="right") - 1]) * 1e-3
    position = np.concatenate([[0.0], np.cumsum(speed[:-1] * np.diff(record.time))])
    told = replace(record, channels={"position": position}, channel_units={"position": "m"})
    cut, _ = strokes_apart(scene, [told])
    windows = np.array([entry.window for entry in cut.logs])
    half = np.pi * np.sqrt(RIG["mass"] / RIG["stiffness"])
    np.testing.assert_allclose(windows, [(0.0, 2.0), (2.5, 3.5), (4.0, 6.0), (6.0 + half, 7.0)], atol=0.02)
    assert strokes_apart(scene, [record])[0] is scene, "without the column one speed stays one speed"


def test_an_excluded_slip_parts_a_log_and_a_stick_does_not():
    scene, records = next(kind for kind in KINDS if kind.name == "a slip excluded").made(1)
    cut, copies = gaps_apart(scene, records)
    assert [entry.window for entry in cut.logs] == [(0.0, 1.56), (1.66, 4.0), None] and len(copies) == 3
    stick = replace(scene, logs=(replace(scene.logs[0], exclude=((1.45, 1.5),)), scene.logs[1]))
    assert gaps_apart(stick, records)[0] is stick
    unknowns = from_scene(cut)
    prepared = [prepare(cut, entry, part, unknowns) for entry, part in zip(cut.logs, copies, strict=True)]
    found, left_out = search.search(search.SearchProblem(prepared, unknowns))
    assert found.gate.status is Status.CONVERGED and not left_out, found.gate.message
    away = found.solved.theta - unknowns.theta(np.array([(DEMO | RIG)[n] for n in unknowns.names]), unknowns.base(RIG))
    covariance = information_at(found, unknowns).covariance()
    assert np.max(np.abs(away[unknowns.free]) / np.sqrt(np.diag(covariance))) < 4.0


@pytest.fixture(scope="module")
def two_speeds():
    """Two logs, their unknowns, and the answer."""
    prepared, unknowns = _prepared(_kind(SLOW, FAST))
    return prepared, unknowns, search.search(search.SearchProblem(prepared, unknowns))[0]


def test_a_slip_that_was_missed_is_put_in_by_the_motion_that_follows_from_the_answer(two_speeds):
    prepared, unknowns, right = two_speeds
    spoiled = [replace(prepared[0], falls=np.delete(prepared[0].falls, 4)), prepared[1]]
    found, _ = search.search(search.SearchProblem(spoiled, unknowns, thorough=False))
    assert found.gate.status is Status.CONVERGED
    np.testing.assert_allclose(found.solved.theta, right.solved.theta, atol=0.01)  # standard errors up to 0.2


@pytest.mark.parametrize(
    ("gain", "settles", "status"),
    [(20.0, False, Status.BETTER_START_FOUND), (20.0, True, Status.CONVERGED), (9.0, False, Status.CONVERGED)],
)
def test_a_lower_point_is_tried_as_a_start_and_named_where_the_solver_converges_from_nowhere(
    two_speeds, monkeypatch, gain, settles, status
):
    # Within the joint region of six parameters (12.6) it is another point of the same ridge.
    import identify.estimation.certainty as room
    from identify.estimation.profile import FREE, ProfilePoint, Profiles
    from identify.shooting.accuracy import FitOptions

    prepared, unknowns, attempt = two_speeds
    place = ProfilePoint(attempt.solved.theta + 0.01, attempt.solved.trajectories, 0.0, FREE)
    found = iter([Profiles({}, lower=place, gain=gain)])
    monkeypatch.setattr(room, "profile", lambda *_, **__: next(found, Profiles({}, best=attempt.solved.theta)))
    lost = replace(attempt, gate=replace(attempt.gate, status=Status.SOLVER_FAILED, solver="Restoration_Failed"))
    monkeypatch.setattr(room, "solve_again", lambda *_, **__: lost)
    tried = []

    def anew(_answer, _unknowns, theta):
        tried.append(theta)
        return replace(attempt) if settles else None

    monkeypatch.setattr(room, "placed_anew", anew)
    base = prepared[0].data.base
    options = FitOptions(profile=True)
    sure = certainty(attempt, unknowns, base, options, speed_tolerance=0.0, seed=0, progress=lambda *_: None)
    assert sure.attempt.gate.status is status
    np.testing.assert_array_equal(tried[0], place.theta)
    words, message = ("a better place was met", "t_cr = "), sure.attempt.gate.message
    assert [word in message for word in words] == 2 * [status is Status.BETTER_START_FOUND]
    assert "start values" not in message, "what was tried from there already is not advised"


@pytest.mark.parametrize("kinetic", [0.4, 0.7])
def test_a_lower_point_that_no_start_can_say_is_not_advised_as_one(kinetic):
    """The scene refuses a start of mu_k0 above mu_s."""
    scene = Scene.from_document({"effects": list(MAIN), "rig": dict(RIG), "logs": [{"path": "a.csv"}]}, Path())
    unknowns = from_scene(scene)
    base = unknowns.base(dict(RIG))
    values = unknowns.values(unknowns.start, base)
    for name, value in (("mu_s", 0.6), ("mu_k0", kinetic)):
        values[unknowns.names.index(name)] = value
    lower = SimpleNamespace(lower=SimpleNamespace(theta=unknowns.theta(values, base)), gain=40.0)
    one = np.ones(1)
    gate = Gate(1.0, one, one.astype(np.int64), one.astype(np.int64), "Failed", 0.0, Status.SOLVER_FAILED, "")
    question = SimpleNamespace(unknowns=unknowns, base=base)
    message = _lower_start(SimpleNamespace(gate=gate), lower, question).message
    assert ("give it a prior" in message) == (kinetic < 0.6)
    assert "start values" not in message
    assert ("bound mu_k0" in message) == (kinetic > 0.6)
    assert f"mu_k0 = {kinetic:g}" in message


def test_a_level_that_never_settles_is_left_out_with_its_reason():
    """Sliding that swings to the end, at no resting cycle: no level, no cycle."""
    times = np.arange(4001) / 1000
    force = 0.5 + 0.05 * np.sin(2 * np.pi * 13 * times) + 5e-3 * np.random.default_rng(1).standard_normal(times.size)
    record = Record(times, np.ones(times.size), force)
    document = {"effects": list(MAIN), "rig": dict(RIG), "logs": [{"path": "swing.csv", "drive_speed": 0.05}]}
    result = fit(Scene.from_document(document, Path()), [record]).result
    assert result["status"] in ("no_cycles", "model_misfit")
    assert "swing.csv" in result["message"] or "model" in result["message"]


def test_gliding_needs_a_drive_that_moves():
    (prepared,), unknowns = _prepared(_kind(SLIDING))
    p = np.array([(DEMO | RIG)[n] for n in unknowns.names])
    assert glide(unknowns.model, prepared.data, p).stretches[0].steady
    assert glide(unknowns.model, replace(prepared.data, drive_speed=0.0), p) is None


def test_a_log_of_its_own_course_is_told_from_one_of_cycles():
    logs, _ = _prepared(_kind(SLOW, SLIDING, Log(5e-2, 3.0, 2000.0), HOLDS))
    assert [log.fit_mode.name for log in logs] == ["cycles", "sliding", "continuous", "continuous"]
    assert [log.left_out for log in logs] == [None] * 4
    assert len(logs[3].pieces) == 3 and all(piece.fit_mode.name == "cycles" for piece in logs[3].pieces)


def test_a_slip_that_was_not_recorded_parts_a_log_and_a_stick_does_not():
    """Rows are missing over 1.56 to 1.66 s, where it slips, or 1.45 to 1.5 s, where it does not."""
    whole = next(kind for kind in KINDS if kind.name == "a slip excluded")
    scene, records = whole.made(1)
    scene = replace(scene, logs=tuple(replace(entry, exclude=()) for entry in scene.logs))
    assert gaps_apart(scene, records)[0] is scene
    for first, last, parts in ((1.56, 1.66, 2), (1.45, 1.5, 1)):
        kept = (records[0].time <= first) | (records[0].time >= last)
        rows = [getattr(records[0], name)[kept] for name in ("time", "normal_force", "friction_force")]
        cut, _ = gaps_apart(scene, [Record(*rows), *records[1:]])
        assert len(cut.logs) == len(scene.logs) + parts - 1
        if parts == 2:
            np.testing.assert_allclose([cut.logs[0].window[1], cut.logs[1].window[0]], [first, last], atol=2e-3)


def test_what_a_logger_left_empty_for_as_long_as_a_slip_was_not_recorded():
    time = np.arange(400) / 20.0
    force = 0.4 + 0.1 * np.sin(time)
    force[100:105] = np.nan
    record = Record(time, np.ones(time.size), force)
    assert _unrecorded(record, 0.2, 1470.0) == [(4.95, 5.25)]
    assert _unrecorded(record, 0.2, 0.01) == [], "too short for a slip of that rig"
    force[100:105] = 0.4
    assert _unrecorded(Record(time, np.ones(time.size), force), 0.2, 1470.0) == []
