"""Logs that are no train of equal cycles: sliding, holds, steps, strokes, gaps; each found, its wrong twin refused."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.record_kinds import DEMO, HOLDS, KINDS, MILD, RIG, STIFF, STROKES, Kind
from identify.base.result import Status
from identify.effects import MAIN
from identify.estimation import search
from identify.estimation.covariance import information_at
from identify.logs.prepare import name_of, prepare
from identify.logs.scene_records import parted, parts_of
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.shooting.layout import COARSE_GRID
from identify.shooting.placing import follow
from identify.shooting.shooting import shooting_problem
from identify.simulation.drive import Drive
from identify.simulation.sliding import slidings

MODEL = assemble(MAIN)
NAMES = MODEL.parameter_names


def _kind(*logs, pair=DEMO, rig=RIG):
    return Kind("", logs, logs, pair, rig)


def _prepared(kind, seed=1):
    scene, records = kind.made(seed)
    unknowns = from_scene(scene)
    return [prepare(scene, e, r, unknowns) for e, r in zip(scene.logs, records, strict=True)], unknowns


def test_steady_sliding_is_the_closed_form_and_fades_where_it_is_stable():
    for pair, rig, speed, renewed in ((DEMO, RIG, 0.05, True), (MILD, STIFF, 1e-3, True), (MILD, STIFF, 1e-5, False)):
        values = pair | rig
        p, u = np.array([values[n] for n in NAMES]), np.array([speed, 1.0, 1.0, 0.0])
        (found,) = slidings(MODEL, np.append(p, [u[1], u[0]]))
        mu_k = values["mu_k0"] + values["delta_mu_k"] * -np.expm1(-values["a"] * speed)
        gamma = max(0.0, 1.0 - speed * values["t_cr"] / values["D"])
        assert found.renewed is renewed
        shown = float(MODEL.load_cell(found.state, p, u))
        assert shown == pytest.approx(mu_k + (values["mu_s"] - mu_k) * gamma, rel=1e-9)
        assert found.stable
    (slow,) = slidings(MODEL, np.array([*((DEMO | RIG)[n] for n in NAMES), 1.0, 1e-3]))
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
    problem = shooting_problem([data], [found[0]], at, COARSE_GRID)
    assert found[1] == data.end
    assert 2 * problem.evaluate(problem.start, derivatives=False).cost < 1.5 * problem.samples
    # As many unknowns as rows, but for the parameters, the load of each part, elongation and gamma at the begin.
    assert problem.layout.size - problem.layout.rows == int(unknowns.free.sum()) + found[0].parts + 2
    other = replace(data, programme=Drive(data.programme.starts, tuple(1.5 * v for v in data.programme.speeds)))
    wrong = follow(unknowns.model, other, p, begins_sliding=False)
    problem = shooting_problem([other], [wrong[0]], at, COARSE_GRID)
    assert 2 * problem.evaluate(problem.start, derivatives=False).cost > 3 * problem.samples


def test_strokes_become_logs_and_rests_are_left_out():
    scene, records = _kind(STROKES).made(1)
    cut, copies = parted(scene, records)
    half = np.pi * np.sqrt(RIG["mass"] / RIG["stiffness"])  # a slip may go on so long after a turn without a rest
    windows = [(0.0, 2.0), (2.5, 3.5), (4.0, 6.0), (pytest.approx(6.0 + half), 7.0)]
    assert [entry.window for entry in cut.logs] == windows
    assert len(copies) == 4 and copies[3] is records[0]
    assert name_of(cut.logs[1]) == "log_1.csv, stroke 2 back"
    assert parts_of(scene, cut.logs) == [1, 1, 1, 1] and parts_of(scene, scene.logs) == [None]
    assert parted(cut, copies) == (cut, copies), "what goes one way is left alone"


def test_an_excluded_slip_parts_a_log_and_a_stick_does_not():
    scene, records = next(kind for kind in KINDS if kind.name == "a slip excluded").made(1)
    cut, copies = parted(scene, records)
    assert [entry.window for entry in cut.logs] == [(0.0, 1.56), (1.66, 4.0), None] and len(copies) == 3
    stick = replace(scene, logs=(replace(scene.logs[0], exclude=((1.45, 1.5),)), scene.logs[1]))
    assert parted(stick, records)[0] is stick
    unknowns = from_scene(cut)
    prepared = [prepare(cut, entry, part, unknowns) for entry, part in zip(cut.logs, copies, strict=True)]
    found, left_out = search.search(search.SearchProblem(prepared, unknowns))
    assert found.gate.status is Status.CONVERGED and not left_out, found.gate.message
    away = found.solved.theta - unknowns.theta(np.array([(DEMO | RIG)[n] for n in unknowns.names]), unknowns.base(RIG))
    covariance = information_at(found.solved, unknowns).covariance()
    assert np.max(np.abs(away[unknowns.free]) / np.sqrt(np.diag(covariance))) < 4.0
