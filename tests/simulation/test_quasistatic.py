"""Sliding without inertia against closed forms, an independent integrator, and the model with a vanishing mass."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from identify.base.errors import FitError, SceneError, SimulationError
from identify.cli.main import main
from identify.identification import fit
from identify.model.model import assemble
from identify.prediction.predict import predict
from identify.scene import Scene
from identify.simulation.plan import Stepping
from identify.simulation.simulate import run, simulate
from identify.simulation.trajectory import Trajectory

VALUES = {
    "mass": 0.2,
    "stiffness": 1470.0,
    "mu_s": 0.6,
    "mu_k0": 0.45,
    "D": 500e-6,  # softening (mu_s - mu_k0) F_n/D = 300 N/m per newton: less than the stiffness
    "t_cr": 0.5,
    "damping": 147.0,
    "damping_frequency": 13.0,
    "delta_mu_k": -0.1,
    "a": 300.0,
    "direct_strength": 0.01,
    "direct_speed": 1e-4,
}
K, FALL, SOFTENING = VALUES["stiffness"], 0.15, 300.0
C = VALUES["damping"] / (2 * np.pi * VALUES["damping_frequency"])
STROKES = ((0.0, 1e-4), (8.0, 0.0), (12.0, -2e-4), (30.0, 1e-4))


def _run(names: tuple[str, ...], drive: object, force: object, duration: float, **more: float) -> Trajectory:
    model = assemble(names)
    options = {key: more.pop(key) for key in ("rtol", "accuracy", "locate", "start") if key in more}
    if {"rtol", "locate"} & set(options):
        options["accuracy"] = Stepping(options.pop("rtol", 1e-11), locate=bool(options.pop("locate", True)))
    given = VALUES | more
    values = {n: given.get(n, model.parameter(n).default) for n in model.parameter_names}
    return run(model, values, drive, force, duration, **options)  # type: ignore[arg-type]


def _aged(t: np.ndarray, gamma: float, speed: float) -> np.ndarray:
    """gamma while sliding with k above the softening: relaxation to 1 - v t_cr/D at the rate k/((k - k_D) t_cr)."""
    end = 1 - speed * VALUES["t_cr"] / VALUES["D"]
    return end + (gamma - end) * np.exp(-K / ((K - SOFTENING) * VALUES["t_cr"]) * t)


@pytest.mark.parametrize(("rtol", "allowed"), [(1e-5, 1e-6), (1e-8, 1e-8), (1e-11, 1e-10), (1e-13, 1e-11)])
def test_ageing_contact_approaches_sliding_as_the_closed_form_says(rtol: float, allowed: float) -> None:
    motion = _run(("contact_ageing",), 1e-4, 1.0, 20.0, rtol=rtol)
    onset = brentq(lambda t: K * 1e-4 * t - 0.45 + FALL * np.expm1(-t / 0.5), 3.0, 5.0, xtol=1e-14)
    assert motion.onsets == pytest.approx([onset], rel=1e-13)
    assert motion.arrests.size == 0
    times = np.linspace(onset, 20.0, 3001)
    samples, gamma = motion.sample(times), _aged(times - onset, -np.expm1(-onset / 0.5), 1e-4)
    speed = (K * 1e-4 - FALL * (1 - gamma) / 0.5) / (K - SOFTENING)
    assert samples["gamma"] == pytest.approx(gamma, abs=allowed)
    assert samples["force"] == pytest.approx(0.45 + FALL * gamma, abs=allowed)
    assert samples["coefficient"] == pytest.approx(samples["force"], rel=1e-14)
    assert samples["sliding_speed"][1:] == pytest.approx(speed[1:], rel=10 * allowed)


def test_a_coarse_tolerance_is_not_a_fine_one() -> None:
    """The errors of the test before are those of the steps: the coarse run misses what the fine one meets."""
    coarse, fine = (_run(("contact_ageing",), 1e-4, 1.0, 20.0, rtol=rtol) for rtol in (1e-3, 1e-13))
    times = np.linspace(fine.onsets[0], 20.0, 301)
    error = np.max(np.abs(coarse.sample(times)["gamma"] - fine.sample(times)["gamma"]))
    assert 1e-7 < error < 1e-4


@pytest.mark.parametrize("accuracy", [1e-3, 1e-5, 1e-8])
def test_it_says_by_which_method_and_how_accurately(accuracy: float) -> None:
    motion = _run(("contact_ageing",), 1e-4, 1.0, 20.0, accuracy=accuracy)
    assert motion.methods == ("radau in balance",)
    assert motion.accuracy == accuracy and motion.achieved is not None
    onset = motion.onsets[0]
    times = np.linspace(onset, 20.0, 301)
    force = 0.45 + FALL * _aged(times - onset, -np.expm1(-onset / 0.5), 1e-4)
    error = float(np.max(np.abs(motion.sample(times)["force"] - force)) / np.max(force))
    assert error <= motion.achieved.forces <= accuracy
    assert motion.refined() is motion
    assert _run(("contact_ageing",), 1e-9, 1.0, 20.0).methods == ()  # nothing slides


def test_a_damper_relaxes_exponentially_to_steady_sliding() -> None:
    motion = _run(("driven_damping",), 1e-3, 1.0, 2.0)
    onset = (0.6 - C * 1e-3) / K / 1e-3
    assert motion.onsets == pytest.approx([onset], rel=1e-13)
    times = np.linspace(onset, 2.0, 2001)
    samples = motion.sample(times)
    stretch = 0.45 / K + (1e-3 * onset - 0.45 / K) * np.exp(-K / C * (times - onset))
    assert samples["elongation"] == pytest.approx(stretch, rel=1e-10)
    assert samples["sliding_speed"][1:] == pytest.approx((K * stretch[1:] + C * 1e-3 - 0.45) / C, abs=1e-10)
    assert samples["force"][1:] == pytest.approx(np.full(2000, 0.45), rel=1e-12)


@pytest.mark.parametrize("drive", [2e-5, 1e-4, 5e-4])
def test_steady_sliding_is_at_the_level_of_the_laws(drive: float) -> None:
    names = ("contact_ageing", "velocity_weakening", "direct_effect", "driven_damping", "skin_compliance")
    motion = _run(names, drive, 2.0, 1.0 / drive * 2e-2 + 30.0, delta_mu_k=0.08)
    kinetic = 0.45 + 0.08 * -np.expm1(-300.0 * drive)
    level = kinetic + (0.6 - kinetic) * (1 - drive * 0.5 / 500e-6) + 0.01 * np.log1p(drive / 1e-4)
    samples = motion.sample([motion.duration])
    assert samples["sliding_speed"] == pytest.approx([drive], rel=1e-9)
    assert samples["force"] == pytest.approx([2.0 * level], rel=1e-9)


def _independent(slides: float, start: tuple[float, float], drive: float, end: float):
    """Elongation and gamma, with ageing, direct effect, weakening, damper, vibration and a rising normal force: the
    speed by bracketing at every call, DOP853 in between."""

    def driven(t: float) -> float:
        return drive + 2e-7 * 2 * np.pi * 5.0 * np.cos(2 * np.pi * 5.0 * t)

    def speed(t: float, x: float, gamma: float) -> float:
        def spare(v: float) -> float:
            kinetic = 0.45 + 0.05 * -np.expm1(-300.0 * v)
            friction = kinetic + (0.6 - kinetic) * gamma + 0.01 * np.log1p(v / 1e-4)
            return K * x + C * (driven(t) - v) - (1.0 + 0.02 * t) * friction

        return brentq(spare, -4e-5, 1.0, xtol=1e-18, rtol=1e-15)

    def rate(t: float, state: np.ndarray) -> list[float]:
        v = speed(t, *state)
        return [driven(t) - v, (1 - state[1]) / 0.5 - v / 500e-6]

    solution = solve_ivp(rate, (slides, end), start, method="DOP853", rtol=1e-11, atol=1e-15, dense_output=True)
    assert solution.success
    return solution.sol, lambda t: speed(t, *solution.sol(t))


def test_many_effects_at_once_agree_with_an_independent_integrator() -> None:
    names = ("contact_ageing", "velocity_weakening", "direct_effect", "driven_damping", "excitation")
    more = {"delta_mu_k": 0.05, "excitation_amplitude": 2e-7, "excitation_frequency": 5.0, "excitation_phase": 0.0}
    motion = _run((*names, "varying_normal_force"), 1e-4, ((0.0, 20.0), (1.0, 1.4)), 8.0, **more)
    onset = motion.onsets[0]
    at = motion.sample([onset])
    states, speed = _independent(onset, (at["elongation"][0], at["gamma"][0]), 1e-4, 8.0)
    assert at["elongation"][0] == pytest.approx(1e-4 * onset + 2e-7 * np.sin(10 * np.pi * onset), rel=1e-12)
    assert at["gamma"][0] == pytest.approx(-np.expm1(-onset / 0.5), rel=1e-13)
    times = np.linspace(onset, 8.0, 400)[1:]
    samples = motion.sample(times)
    assert motion.arrests.size == 0
    assert samples["elongation"] == pytest.approx(states(times)[0], rel=1e-9)
    assert samples["gamma"] == pytest.approx(states(times)[1], rel=1e-8)
    assert samples["sliding_speed"] == pytest.approx([speed(t) for t in times], rel=1e-6)


MASSES = (2e-2, 2e-3, 2e-4)


@pytest.mark.parametrize("names", [("contact_ageing",), ("contact_ageing", "sensor_lag")])
def test_a_vanishing_mass_comes_to_it_with_the_square_root(names: tuple[str, ...]) -> None:
    """At fixed h the damper h sqrt(m/k) and the swing at the onset, v sqrt(m k), both fall with sqrt(m)."""
    limit = _run(names, 1e-4, 1.0, 5.0, lag_time=1e-4)
    onset, errors = limit.onsets[0], []
    for mass in MASSES:
        times = onset + np.sqrt(mass / K) * np.linspace(0.0, 60.0, 1201)
        motion = _run(("inertia", "hysteresis_damping", *names), 1e-4, 1.0, 5.0, mass=mass, rtol=1e-9, lag_time=1e-4)
        errors.append(np.max(np.abs(motion.sample(times)["elongation"] - limit.sample(times)["elongation"])))
    for coarse, fine in pairwise(errors):
        assert np.log10(coarse / fine) == pytest.approx(0.5, abs=0.02)
    assert K * errors[-1] < 1e-4


def test_a_vanishing_mass_without_any_damping_does_not_come_to_it() -> None:
    """Undamped sliding on an ageing contact is unstable at any mass: it sticks and slips ever more often."""
    arrests = [_run(("inertia", "contact_ageing"), 1e-4, 1.0, 5.0, mass=m, rtol=1e-8).arrests.size for m in MASSES]
    assert all(more > 2.5 * fewer > 0 for fewer, more in pairwise(arrests))


def test_speed_jumps_at_a_fold_and_a_vanishing_mass_follows() -> None:
    """Friction that falls with speed, held by a damper: the slip ends where its speed folds. A mass is late there,
    by its two thirds' power (relaxation oscillations)."""
    names, more = ("driven_damping", "contact_ageing", "velocity_weakening"), {"D": 50e-6}
    limit = _run(names, 8e-3, 1.0, 0.1, **more)
    assert [p.ended_by for p in limit.phases[:5]] == ["speed", "clearance", "fold", "speed", "speed"]
    sampled = limit.sample([limit.arrests[0] * (1 - 1e-6), limit.arrests[0] * (1 + 1e-6)])
    assert sampled["sliding_speed"][0] > 5e-3
    assert sampled["sliding_speed"][1] == 0.0
    late = [
        _run(("inertia", *names), 8e-3, 1.0, 0.05, mass=m, rtol=1e-9, **more).arrests[0] - limit.arrests[0]
        for m in (1e-4, 1e-5, 1e-6)
    ]
    orders = np.log10(np.array(late[:-1]) / np.array(late[1:]))
    assert np.all((orders > 0.5) & (orders < 0.7))
    assert orders[1] > orders[0]


def test_a_fold_is_where_the_slope_of_the_balance_vanishes() -> None:
    """In a worn contact the end of the slip is a point: load - friction and its slope with speed both vanish."""
    limit = _run(("driven_damping", "contact_ageing", "velocity_weakening"), 8e-3, 1.0, 0.1, D=50e-6)
    folding = next(p for p in limit.phases if p.ended_by == "fold")
    v = np.log(0.1 * 300.0 / C) / 300.0
    stretch = (0.45 + 0.1 * np.expm1(-300.0 * v) - C * (8e-3 - v)) / K
    assert folding.x[-1][0] == pytest.approx(stretch, rel=1e-9)
    worn = next(p for p in limit.phases if p.ended_by == "clearance")
    relaxing = solve_ivp(
        lambda t, e: [8e-3 - _fast(e[0])], (0.0, 0.02), [worn.x[-1][0]], method="Radau", rtol=1e-11, atol=1e-15,
        events=_folds(stretch),
    )  # fmt: skip
    assert folding.duration == pytest.approx(relaxing.t_events[0][0], rel=1e-6)


def _fast(stretch: float) -> float:
    fold = np.log(0.1 * 300.0 / C) / 300.0
    spare = lambda v: K * stretch + C * (8e-3 - v) - 0.45 - 0.1 * np.expm1(-300.0 * v)  # noqa: E731
    return brentq(spare, fold, 10.0, xtol=1e-16) if spare(fold) > 0.0 else fold


def _folds(stretch: float):
    def event(_t: float, e: np.ndarray) -> float:
        return float(e[0]) - stretch * (1 + 1e-13)

    event.terminal = True  # type: ignore[attr-defined]
    return event


def test_strokes_stop_reverse_and_return() -> None:
    motion = _run(("contact_ageing",), STROKES, 1.0, 44.0)
    assert motion.arrests == pytest.approx([8.0, 30.0], abs=1e-9)
    assert motion.onsets.size == 3
    held = motion.sample([9.0, 11.9])
    assert np.all(held["sliding_speed"] == 0.0)
    assert held["force"][0] == held["force"][1]
    back = motion.sample([29.9])
    assert back["sliding_speed"] == pytest.approx([-2e-4], rel=1e-6)
    assert back["force"] == pytest.approx([-(0.45 + FALL * (1 - 2e-4 * 0.5 / 500e-6))], rel=1e-6)
    # Mirrored strokes are a mirrored motion.
    mirror = _run(("contact_ageing",), tuple((t, -v) for t, v in STROKES), 1.0, 44.0)
    times = np.linspace(0.0, 44.0, 701)
    assert mirror.sample(times)["force"] == pytest.approx(-motion.sample(times)["force"], abs=1e-13)


def test_onsets_are_located() -> None:
    """At the onset of the second stroke the load is what the grip withstands, gamma grown for the whole rest."""
    motion = _run(("contact_ageing",), STROKES, 1.0, 44.0)
    first, second = motion.arrests[0], motion.onsets[1]
    at = motion.sample([first, second])
    gamma = 1 - (1 - at["gamma"][0]) * np.exp(-(second - first) / 0.5)
    assert at["force"][1] == pytest.approx(-(0.45 + FALL * gamma), rel=1e-12)
    assert second == pytest.approx(12.0 + (at["force"][0] - at["force"][1]) / (K * 2e-4), rel=1e-12)


def test_arrests_in_a_vibrating_drive_are_located() -> None:
    """Coulomb friction without a drop: the contact follows the drive and rests while the spring unloads."""
    more = {"mu_s": 0.45, "excitation_amplitude": 1e-5, "excitation_frequency": 5.0, "excitation_phase": 0.0}
    motion = _run(("excitation",), 1e-4, 1.0, 6.0, **more)
    turns = np.arccos(-1e-4 / (1e-5 * 10 * np.pi)) / (10 * np.pi) + 0.2 * np.arange(40)
    expected = turns[(turns > motion.onsets[0]) & (turns < 6.0)]
    assert motion.arrests == pytest.approx(expected, abs=1e-9)
    rough = _run(("excitation",), 1e-4, 1.0, 6.0, locate=False, **more)
    assert np.max(np.abs(rough.arrests - expected)) > 1e-5


def test_a_drive_at_rest_never_slides_and_a_record_of_days_is_soon_done() -> None:
    still = _run(("contact_ageing",), 0.0, 1.0, 1e5)
    assert still.onsets.size == 0
    assert np.all(still.sample([1.0, 9e4])["force"] == 0.0)
    long = _run(("contact_ageing",), 1e-7, 1.0, 1e6)
    assert len(long.phases) == 2
    assert long.phases[1].t.size < 1000
    assert long.sample([1e6])["force"] == pytest.approx([0.45 + FALL * (1 - 1e-7 * 0.5 / 500e-6)], rel=1e-10)


def test_a_motion_that_would_jump_to_another_place_is_refused_by_name() -> None:
    with pytest.raises(SimulationError, match=r"falls by 0\.15 N as sliding sets in.*add the effect inertia"):
        _run((), 1e-4, 1.0, 10.0)
    with pytest.raises(SimulationError, match=r"falls with speed by .* N s/m.*driven_damping"):
        _run(("contact_ageing", "velocity_weakening"), 1e-4, 1.0, 10.0)
    with pytest.raises(SimulationError, match=r"at 4\.08\d* s .*raise the stiffness above 3000 N/m"):
        _run(("contact_ageing",), 1e-4, 1.0, 10.0, D=50e-6)


def test_the_stiffness_of_the_refusal_is_the_one_that_parts_them() -> None:
    for share, jumps in ((0.999, True), (1.001, False)):
        if jumps:
            with pytest.raises(SimulationError, match="stiffness above 300 N/m"):
                _run(("contact_ageing",), 1e-4, 1.0, 40.0, stiffness=300.0 * share)
        else:
            assert _run(("contact_ageing",), 1e-4, 1.0, 40.0, stiffness=300.0 * share).onsets.size == 1


def test_a_normal_force_that_softens_the_contact_too_much_is_refused_where_it_does() -> None:
    with pytest.raises(SimulationError, match="raise the stiffness above 300") as refused:
        _run(("contact_ageing",), 1e-4, ((0.0, 40.0), (0.6, 1.4)), 40.0, stiffness=300.0)
    told = float(str(refused.value).split("at ")[1].split(" s")[0])
    assert told == pytest.approx(20.0, abs=0.1)


NULLS = [
    ("driven_damping", "damping", 1e-3),
    ("direct_effect", "direct_strength", 1e-6),
    ("velocity_weakening", "delta_mu_k", 1e-5),
    ("linear_weakening", "slope", 1e-4),
]


@pytest.mark.parametrize(("name", "parameter", "small"), NULLS)
def test_off_is_absent_and_nearly_off_is_nearly_so(name: str, parameter: str, small: float) -> None:
    """At its null an effect leaves the balance free of speed: the index of the system rises, the motion stays."""
    times = np.linspace(0.0, 8.0, 401)
    plain = _run(("contact_ageing",), 1e-4, 1.0, 8.0).sample(times)["force"]

    def error(value: float) -> float:
        motion = _run((name, "contact_ageing"), 1e-4, 1.0, 8.0, **{parameter: value})
        return float(np.max(np.abs(motion.sample(times)["force"] - plain)))

    assert error(0.0) < 1e-10
    assert 0.0 < error(small) < 1e-4
    assert error(small) / error(small / 10) == pytest.approx(10.0, rel=0.05)


def test_the_smaller_model_is_counted() -> None:
    small, full = assemble(("contact_ageing",)), assemble(("inertia", "contact_ageing"))
    assert [s.name for s in small.states] == ["elongation", "gamma"]
    assert [s.name for s in full.states] == ["elongation", "sliding_speed", "gamma"]
    assert set(full.parameter_names) - set(small.parameter_names) == {"mass"}
    assert small.slip.n_instructions() < full.slip.n_instructions()
    with pytest.raises(SceneError, match=r"hysteresis_damping needs the effect inertia; .* take driven_damping"):
        assemble(("hysteresis_damping", "contact_ageing"))


SCENE = """
effects = ["contact_ageing", "driven_damping"]
[rig]
stiffness = "1470 N/m"
damping = "147 N/m"
drive_speed = "0.1 mm/s"
normal_force = "1 N"
[parameters]
mu_s = { start = 0.6 }
mu_k0 = { start = 0.45 }
D = { start = "500 um" }
t_cr = { start = "0.5 s" }
damping_frequency = { fixed = 13.0 }
"""


def _scene(folder: Path, more: str = "") -> Path:
    path = folder / "scene.toml"
    path.write_text(SCENE + more)
    return path


def test_a_scene_without_mass_is_simulated_from_the_command_line(tmp_path: Path) -> None:
    scene, log = _scene(tmp_path), tmp_path / "log.csv"
    words = ["--duration", "8", "--rate", "50", "--out", str(log)]
    assert main(["simulate", "--scene", str(scene), *words]) == 0
    force = np.loadtxt(log, delimiter=",", comments="#", skiprows=_header(log))[:, 2]
    motion = _run(("contact_ageing", "driven_damping"), 1e-4, 1.0, 8.0)
    assert force == pytest.approx(motion.sample(np.arange(401) / 50.0)["force"], abs=1e-9)


def _header(log: Path) -> int:
    lines = log.read_text().splitlines()
    return next(i for i, line in enumerate(lines) if line[:1].isdigit())


def test_what_needs_a_mass_says_so(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("")
    with pytest.raises(FitError, match=r"inertia is off.*add inertia"):
        fit(Scene.from_toml(_scene(tmp_path, '[[logs]]\npath = "log.csv"\n')))
    model = assemble(("contact_ageing",))
    with pytest.raises(SimulationError, match=r"inertia is off.*add inertia"):
        predict(model, {n: VALUES[n] for n in model.parameter_names}, 1e-3, 1.0)
    with pytest.raises(SimulationError, match=r"drop sliding_speed from \[initial\]"):
        simulate(Scene.from_toml(_scene(tmp_path, '[initial]\nsliding_speed = "1 mm/s"\n')), 1.0)


def test_a_law_that_begins_at_a_speed_holds_the_motion_there() -> None:
    """Friction that rises as a power of speed above v_low: no speed is stable below, so sliding starts at v_low."""
    more = {"speed_exponent": -0.1, "lowest_speed": 1e-3, "highest_speed": 1.0, "D": 430e-6, "t_cr": 0.4}
    motion = _run(("contact_ageing", "power_law"), 2.6e-3, 1.0, 2.0, **more)
    assert [p.mode for p in motion.phases] == ["stick", "slip", "worn"]
    started = motion.sample([motion.onsets[0] * (1 + 1e-9)])["sliding_speed"]
    assert started == pytest.approx([1e-3], rel=1e-4)
    steady = motion.sample([2.0])
    assert steady["sliding_speed"] == pytest.approx([2.6e-3], rel=1e-3)
    assert steady["force"] == pytest.approx(0.45 * (steady["sliding_speed"] / 1e-3) ** 0.1, rel=1e-9)
