"""Whatever effects compose without inertia: the forces balance while sliding, the grip holds while resting, or the
motion is refused by name."""

from __future__ import annotations

import numpy as np
import pytest

from identify.base.errors import SimulationError
from identify.effects import ALL
from identify.model.model import Model, assemble
from identify.simulation.drive import Drive
from identify.simulation.simulate import run

GIVEN = {"mu_s": 0.6, "mu_k0": 0.45, "stiffness": 1470.0, "D": 500e-6, "damping_frequency": 13.0, "field_sd": 1e-4}
GIVEN |= {"slope": 0.5, "speed_exponent": -0.1, "delta_mu_k": 0.05, "excitation_amplitude": 1e-7, "strength_sd": 0.0}
FREE = [e for e in ALL if e.name != "inertia" and "inertia" not in e.needs]
STROKES = ((0.0, 5e-4), (1.3, -2e-3), (2.2, 0.0), (2.5, 1e-3))
LOADS = ((0.0, 1.0, 3.0), (1.0, 1.2, 0.9))
DURATION, COUNTS = 3.0, 1e-8
TIMES = np.linspace(0.0, DURATION, 401)


def _values(model: Model) -> dict[str, float]:
    return {n: GIVEN.get(n, model.parameter(n).default) for n in model.parameter_names}


def _chosen(random: np.random.Generator) -> tuple[str, ...]:
    """A random subset, one of each role, with what its effects need."""
    kept: dict[str, str] = {}
    for i in random.permutation(len(FREE)).tolist():
        if random.random() < 0.4:
            kept.setdefault(FREE[i].role or FREE[i].name, FREE[i].name)
    names = set(kept.values())
    names |= {need for e in FREE if e.name in names for need in e.needs}
    return tuple(e.name for e in FREE if e.name in names)


def _check(names: tuple[str, ...], wrong: float = 0.0) -> int:
    """Forces of a motion at many times, from the functions of the model at the sampled states; number of slides.
    wrong: added to the static coefficient of the motion alone."""
    model = assemble(names)
    assert model.balance is not None
    values = _values(model)
    motion = run(model, values | {"mu_s": values["mu_s"] + wrong}, STROKES, LOADS, DURATION)
    samples = motion.sample(TIMES)
    assert all(np.all(np.isfinite(column)) for column in samples.values())
    x, p = np.array([samples[s.name] for s in model.states]), np.array(list(values.values()))[:, None]
    direction = np.sign(samples["sliding_speed"])
    drive = np.array([Drive.of(STROKES).at(t) for t in TIMES])
    u = np.stack([drive, samples["normal_force"], np.where(direction == 0.0, 1.0, direction), TIMES])
    beside = np.min(np.abs(TIMES[:, None] - np.array([p.start for p in motion.phases])), axis=1) > 1e-9
    moving, still = beside & (direction != 0.0), beside & (samples["sliding"] == 0.0)
    p = np.repeat(p, TIMES.size, axis=1)
    spare = np.array(model.balance(x, p, u, np.abs(samples["sliding_speed"])[None, :])).ravel()
    assert np.all(np.abs(spare[moving]) < COUNTS)
    grip, pull = (np.array(f(x, p, u)).ravel() for f in (model.grip, model.driving_force))
    assert np.all((grip - np.abs(pull))[still] > -COUNTS)
    assert np.all((samples["sliding"] == 1.0) >= (direction != 0.0))
    return motion.onsets.size


@pytest.mark.parametrize("seed", range(24))
def test_random_compositions_balance_or_are_refused_by_name(seed: int) -> None:
    names = _chosen(np.random.default_rng(seed))
    try:
        assert _check(names) >= 1
    except SimulationError as refused:
        assert "the motion jumps, and without inertia nothing says how far; add the effect inertia" in str(refused)
        assert not {"driven_damping", "contact_ageing", "linear_weakening"} & set(names)  # these hold the motion here


@pytest.mark.parametrize("effect", FREE, ids=lambda e: e.name)
def test_every_effect_composes_with_an_ageing_contact(effect: object) -> None:
    """Ageing holds the motion on a branch; every other effect is added to it."""
    names = ("contact_ageing", effect.name, *effect.needs)  # type: ignore[attr-defined]
    assert _check(tuple(dict.fromkeys(names))) >= 2


def test_the_check_sees_a_force_that_is_missing() -> None:
    with pytest.raises(AssertionError):
        _check(("contact_ageing",), wrong=1e-6)
