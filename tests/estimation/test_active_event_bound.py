"""An answer that an event holds which can go no farther."""

from __future__ import annotations

from identify.estimation.certainty import active_event_bound
from identify.shooting.layout import COARSE_GRID
from identify.shooting.passes import Solved, solve
from identify.shooting.shooting import shooting_problem
from tests.support import shooting_case as case

UNKNOWNS = case.search_space(case.PAIR, ("mu_s", "mu_k0", "t_cr"))


def held_at(room: float | None) -> Solved:
    """The answer of a noisy log of which one event has to end `room` [s] before where it is wanted (None: it goes
    where it likes)."""
    log = case.simulated(case.PAIR, *case.MIDDLE)
    data = case.log_data(log, UNKNOWNS, noise_seed=4)
    trajectories = case.placed(UNKNOWNS, [log], [data], COARSE_GRID)
    problem = shooting_problem([data], trajectories, UNKNOWNS, COARSE_GRID)
    solution = solve(problem, tolerance=1e-8, mu_init=1e-6)
    if room is not None:
        event = int(problem.layout.places[0].events[4])
        wanted = solution.x[event] - room
        problem.layout.upper[event] = wanted
        problem.layout.lower[event] = wanted - 1e-3
        solution = solve(problem, tolerance=1e-8, mu_init=1e-6)
    assert solution.success
    return Solved(problem, solution, *problem.layout.at(solution.x), 0.0, 1, 1)


def test_an_event_kept_from_its_place_is_noticed_by_what_it_does_to_the_answer() -> None:
    """The squared distance is no longer than what the misfit gains without the bound: of parameters and events together
    it is that gain; of the parameters alone it is less."""
    assert active_event_bound(held_at(1e-7), ["log"]) is None
    free, held = held_at(None), held_at(1e-3)
    said = active_event_bound(held, ["log"])
    assert said is not None and said.startswith("log: ")
    stated = float(said.split("answer by ")[1].split(" standard")[0])
    gain = 2.0 * (held.solution.cost - free.solution.cost)
    assert 0.1 * gain < stated**2 < 1.1 * gain
