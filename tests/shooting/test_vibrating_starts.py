"""Logs whose drive vibrates: where slips begin, and the blocks of rests that are no straight lines.

The truth is the event-driven simulation, which knows nothing of batches, placing or shooting.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from identify.effects import MAIN
from identify.logs.log_data import LogData
from identify.logs.unknowns import from_scene
from identify.scene import Scene
from identify.shooting.blocks import AgeingBlock
from identify.shooting.layout import COARSE_GRID
from identify.shooting.passes import solve_in_passes
from identify.shooting.placing import place
from identify.shooting.shooting import shooting_problem
from identify.simulation.drive import NormalForce
from identify.simulation.plan import Stepping
from identify.simulation.simulate import run

PAIR = {"mu_s": 0.45, "mu_k0": 0.28, "delta_mu_k": -0.087, "a": 212.0, "D": 38e-6, "t_cr": 0.16}
RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
VIBRATION = {"excitation_amplitude": 2.5e-6, "excitation_frequency": 47.0, "excitation_phase": -2.8}
SPEED, DURATION, RATE, NOISE = 1e-4, 10.0, 500.0, 5e-3
REAL = 0.05  # N: what drops by less is a tremble


@lru_cache(maxsize=1)
def _case():
    """Unknowns at the truth, the log, its parameters, the motion, and onsets and arrests of the slips that are seen."""
    parameters = {name: {"start": value} for name, value in (PAIR | VIBRATION).items()}
    parameters |= {name: {"fixed": PAIR[name]} for name in ("delta_mu_k", "a", "t_cr")}  # one speed does not tell them
    parameters["excitation_frequency"] |= {"lower": 46.95, "upper": 47.05}  # as a rhythm that is found is held
    document = {"effects": [*MAIN, "excitation"], "rig": RIG, "parameters": parameters, "logs": [{"path": "a.csv"}]}
    document["logs"][0]["drive_speed"] = SPEED
    unknowns = from_scene(Scene.from_document(document, "."))
    model = unknowns.model
    values = {q.name: (PAIR | RIG | VIBRATION).get(q.name, q.default) for q in model.parameters}
    motion = run(model, values, SPEED, 1.0, DURATION, accuracy=Stepping(1e-9))
    ends = motion.arrests[np.searchsorted(motion.arrests, motion.onsets[motion.onsets < motion.arrests[-1]])]
    begins = motion.onsets[: ends.size]
    drops = motion.sample(begins)["force"] - motion.sample(ends)["force"]
    seen = drops > REAL
    assert 3 <= np.count_nonzero(seen) < seen.size, "a case with slips that are seen, and some that are not"
    time = np.arange(round(DURATION * RATE)) / RATE
    force = motion.sample(time)["force"] + NOISE * np.random.default_rng(1).standard_normal(time.size)
    weight = np.full(time.size, NOISE**-2)
    end = float(ends[seen][-1]) + 0.5
    log = LogData(time, force, weight, unknowns.base(RIG), SPEED, NormalForce.of(1.0), 0.0, 0.0, end)
    return unknowns, log, unknowns.values(unknowns.start, log.base), begins[seen], ends[seen]


def _placed():
    unknowns, log, p, onsets, arrests = _case()
    falls = onsets + 0.5 * (arrests - onsets)
    (trajectory,) = place(unknowns.model, [log], [p], [falls], COARSE_GRID)
    assert trajectory is not None
    return trajectory


def test_a_fit_from_slips_placed_without_the_vibration_ends_at_the_noise():
    unknowns, log, _, _, arrests = _case()
    solved = solve_in_passes([log], [_placed()], unknowns.with_weak_priors())
    assert solved.solution.success
    assert 2.0 * solved.solution.cost / solved.problem.samples == pytest.approx(1.0, abs=5.0 * (2.0 / 4000.0) ** 0.5)
    assert solved.trajectories[0].arrest == pytest.approx(arrests, abs=1.0 / RATE)


def _problem():
    unknowns, log, *_ = _case()
    return shooting_problem([log], [_placed()], unknowns, COARSE_GRID)


def test_derivatives_of_a_vibrating_problem_agree_with_central_differences():
    problem = _problem()
    z = problem.start + 1e-3 * np.random.default_rng(2).standard_normal(problem.start.size)
    point = problem.evaluate(z, derivatives=True)
    multipliers = np.random.default_rng(4).standard_normal(problem.layout.rows)
    jacobian, hessian = point.jacobian.toarray(), problem.exact_hessian(z, 1.0, multipliers).toarray()
    hessian = hessian + np.triu(hessian, 1).T
    ageing = next(family for family in problem.layout.families if family.block.kind == AgeingBlock())
    columns = np.unique(ageing.slots[ageing.slots >= 0])
    for i in columns.tolist():
        step = 1e-6 * np.eye(z.size)[i]
        up, down = problem.evaluate(z + step, derivatives=True), problem.evaluate(z - step, derivatives=True)
        slope = (up.rows - down.rows) / 2e-6
        assert jacobian[:, i] == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.max(np.abs(slope)))
        bend = (up.gradient + up.jacobian.T @ multipliers - down.gradient - down.jacobian.T @ multipliers) / 2e-6
        assert hessian[:, i] == pytest.approx(bend, rel=1e-4, abs=1e-6 * np.max(np.abs(hessian)))
