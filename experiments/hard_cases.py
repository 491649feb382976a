"""The table of hard cases: a scene, a truth from outside, and the tolerance it meets or the sentence that refuses it.

Shared by tests/simulation/test_hard_cases.py and sample `hard` of the acceptance table. A new case is one more row.
"""

from __future__ import annotations

import mpmath as mp
import numpy as np

from experiments.hard_scenes import (
    NONE,
    OMEGA,
    PAIR,
    V_CR,
    Answer,
    HardCase,
    Scene,
    by_integration,
    continued,
    first_onset,
    forces_of,
    linear_slip,
)

INTEGRATOR = "independent integrator, DOP853 at 1e-12"
RADAU = "independent integrator, Radau at 1e-9"
CLOSED = "eq. (13) in 40 digits"
ROOT = "onset condition in 40 digits"
PLAIN = ("inertia", "hysteresis_damping", "linear_weakening")
FREE = ("inertia", "linear_weakening")
NO_DAMPER = {"damping": 0.0}
K, M = PAIR["stiffness"], PAIR["mass"]
FIRST = PAIR["mu_s"] / K  # drive travel to the first onset of a saturated contact under 1 N, no damper [m]


def _integrated(name: str, change: dict[str, float], drive: object, duration: float, **more: object) -> HardCase:
    tolerance = more.pop("tolerance", 1e-8)
    scene = Scene(change, drive, duration, **more)  # type: ignore[arg-type]
    return HardCase(name, scene, by_integration(), INTEGRATOR, tolerance)  # type: ignore[arg-type]


def _linear(name: str, change: dict[str, float], duration: float, drive: float = 1e-3, **more: object) -> HardCase:
    return HardCase(name, Scene(change, drive, duration, effects=PLAIN), linear_slip, CLOSED, **more)  # type: ignore[arg-type]


def _alpha(alpha: float, **more: object) -> HardCase:
    """alpha from the slope of friction alone: alpha = F_n slope / (2 sqrt(m k))."""
    change = NO_DAMPER | {"slope": 2.0 * alpha * float(np.sqrt(K * M)), "mu_s": 0.5}
    # Above 0 the overshoot must exceed the critical loading, or the mass never rests; the closed form knows either.
    return _linear(f"alpha = {alpha:.10g}", change, 1.6, **more)


def _refused(name: str, scene: Scene, sentence: str) -> HardCase:
    return HardCase(name, scene, None, "", refusal=sentence)


def _shaken(values: dict[str, float], t: mp.mpf) -> mp.mpf:
    """Driving force minus grip under a vibrating drive, contact without ageing, under 1 N."""
    w = 2 * mp.pi * values["excitation_frequency"]
    moved = values["excitation_amplitude"] * mp.sin(w * t)
    return values["stiffness"] * (mp.mpf(1e-3) * t + moved) - values["mu_s"]


def _crept_up(speed: float, shaken: dict[str, float]) -> HardCase:
    """A drive that creeps up on the onset, shaken all the while: the first crest that reaches the grip lets go."""
    f, amplitude = shaken["excitation_frequency"], shaken["excitation_amplitude"]
    reached = (mp.mpf(PAIR["mu_s"]) / K - amplitude) / speed
    crest = (mp.ceil(reached * f - mp.mpf(0.25)) + mp.mpf(0.25)) / f

    def pull(values: dict[str, float], t: mp.mpf) -> mp.mpf:
        moved = values["excitation_amplitude"] * mp.sin(2 * mp.pi * values["excitation_frequency"] * t)
        return values["stiffness"] * (mp.mpf(speed) * t + moved) - values["mu_s"]

    def truth(scene: Scene) -> Answer:
        # A spoilt run has another onset; the truth is that of the scene.
        values = scene.values
        t = mp.findroot(lambda t: pull(values, t), (crest - mp.mpf(0.1) / f, crest), solver="anderson", tol=1e-25)
        return Answer(np.array([float(t)]), NONE, NONE, NONE, complete=False)

    scene = Scene(shaken, speed, float(crest) + 1e-2, effects=("inertia", "excitation"))
    return HardCase("drive shaken at 1 kHz for an hour while it creeps up on the onset", scene, truth, ROOT, 1e-13)


def _moistened(values: dict[str, float], t: mp.mpf) -> mp.mpf:
    """The same with a friction level that rises in time."""
    level = values["occlusion_level"] * (1 - mp.exp(-t / values["occlusion_time"]))
    return values["stiffness"] * mp.mpf(1e-3) * t - values["mu_s"] * mp.exp(level)


def _sticks() -> list[HardCase]:
    slow, late = 1e-4 / 60, FIRST / 1e-3
    shaken = {"excitation_amplitude": 2e-6, "excitation_frequency": 1e4, "excitation_phase": 0.0}
    return [
        _integrated("sticks of minutes, slips of milliseconds", {}, slow, 2000.0),
        _integrated("drive towards zero: 1 nm/s", {}, 1e-9, 1e6),
        _integrated("drive towards zero: 1 pm/s", {}, 1e-12, 1e9),
        HardCase(
            "record of 1e6 s, onsets to the end", Scene({}, 5e-8, 1e6), continued(6), "period of the integrator", 1e-8
        ),
        _integrated("onset exactly at a step of the drive to threefold", NO_DAMPER, ((0.0, 1e-3), (late, 3e-3)), 1.0),
        _integrated("onset exactly at the stop of the drive", NO_DAMPER, ((0.0, 1e-3), (late * (1 + 1e-9), 0.0)), 1.0),
        _integrated("slips within one sample (20 per second)", {}, 1e-3, 20.0),
        HardCase(
            "onset in a crossing of microseconds: drive shaken at 10 kHz",
            Scene(shaken, 1e-3, 0.43, effects=("inertia", "excitation")),
            first_onset(_shaken, 2e-6, begin=0.41),
            ROOT,
            1e-10,
        ),
        _crept_up(1e-7, {"excitation_amplitude": 1e-5, "excitation_frequency": 1e3, "excitation_phase": 0.0}),
        HardCase(
            "grip that grows twentyfold while the drive pulls",
            Scene({"occlusion_level": 3.0, "occlusion_time": 1.0}, 1e-3, 30.0, effects=("inertia", "occlusion")),
            first_onset(_moistened, 1e-2),
            ROOT,
            1e-12,
        ),
    ]  # fmt: skip


def _friction() -> list[HardCase]:
    speeds = [
        _integrated(f"v_acr = {ratio:.7g}", {}, ratio * V_CR, min(60.0, 4e-3 / (ratio * V_CR)))
        for ratio in (0.5, 0.999999, 1.0, 1.000001, 2.0, 1e3)
    ]
    creep = [
        _integrated(f"t_cr = {ratio:g} natural periods", {"t_cr": ratio * 2 * np.pi / OMEGA}, 1e-3, 2.0)
        for ratio in (1e-3, 1.0, 1e3, 1e6)
    ]
    stiff_creep = HardCase(
        "t_cr = 1e-06 natural periods",
        Scene({"t_cr": 1e-6 * 2 * np.pi / OMEGA, "D": 1e-6 * 2 * np.pi / OMEGA * V_CR}, 1e-3, 0.5),
        by_integration("Radau", 1e-9),
        RADAU,
        1e-6,
    )
    weakening = [_integrated(f"a v = {ratio:g}", {"a": ratio / 1e-3}, 1e-3, 2.0) for ratio in (1e-6, 1e-3, 1.0, 1e3)]
    sliding = {"elongation": 3e-4, "sliding_speed": 5e-3}
    fastest = Scene({"a": 1e7}, 0.1, 0.05)
    return [
        *speeds,
        *creep,
        stiff_creep,
        *weakening,
        HardCase("a v = 1e+06", fastest, by_integration("Radau", 1e-9), RADAU, 1e-6),
        _integrated("friction that rises with speed: delta_mu_k = +0.3", {"delta_mu_k": 0.3, "mu_k0": 0.3}, 1e-3, 2.0),
        _integrated("mu_s = mu_k, ageing without effect", {"mu_s": 0.43}, 1e-3, 2.0),
        _integrated("contact that starts saturated: gamma = 1", {}, 1e-3, 2.0, start={"gamma": 1.0}),
        _integrated("start in full slide, contact fresh", {}, 1e-3, 2.0, start=sliding),
    ]  # fmt: skip


def _rigs() -> list[HardCase]:
    fading = [
        _linear(f"alpha = {a:g} from the damper, loading above critical", {"damping": 2 * a * K, "slope": 0.0}, t, v)
        for a, t, v in ((0.3, 20.0, 5e-5), (0.7, 200.0, 5e-6), (0.9, 2000.0, 5e-7))
    ]
    damped = [_integrated(f"zeta = {z:g}", {"damping": 2.0 * z * K}, 1e-3, 2.0) for z in (0.0, 1.0, 10.0)]
    straight = [
        _linear(f"zeta = {z:g}, linear law", {"damping": 2 * z * K, "slope": 0.0}, 1.6) for z in (0.0, 1.0, 10.0)
    ]
    alphas = [_alpha(a) for a in (-0.3, -1e-3, -1e-9, 0.0, 1e-9, 1e-3, 0.3, 1 - 1e-6, 1.0, 1 + 1e-6, 10.0)]
    masses = [_integrated(f"mass {f:g} of nominal", {"mass": f * M}, 1e-3, 2.0) for f in (1e-6, 1e-3, 1e3)]
    return [*damped, *straight, *alphas, *fading, *masses]


def _directions() -> list[HardCase]:
    hold = ((0.0, 1e-3), (0.9, 0.0), (30.0, 1e-3))
    strokes = tuple((0.7 * i, 1e-3 * (-1) ** i) for i in range(8))
    sagging = ((0.0, 1.0), (0.5, 1.0), (3.0, 0.3))
    wild = {"mu_s": 3.0, "mu_k0": 0.3, "delta_mu_k": 0.0, "t_cr": 50.0, "damping": 20.0}
    return [
        _integrated("slide, hold, slide", {}, hold, 32.0),
        _integrated("reciprocation", {}, strokes, 5.6),
        _integrated("both directions: drive backwards", {}, -1e-3, 2.0),
        _integrated("drive reversed in the middle of a slip", {}, ((0.0, 1e-3), (0.4231, -2e-3)), 2.0),
        _integrated("a slip that swings back past rest", wild, 1e-3, 2.5, start={"gamma": 1.0}),
        _integrated("held drive, falling load lets the mass go", {}, ((0.0, 1e-3), (0.4, 0.0)), 4.0, force=sagging),
        HardCase("drive at rest: nothing moves", Scene({}, 0.0, 1e6), by_integration(), INTEGRATOR),
    ]


def _edges() -> list[HardCase]:
    touching = {"mu_s": 0.43, "slope": 0.0} | NO_DAMPER
    return [
        HardCase(
            "mu_s = mu_k, no damper: the speed touches zero once a period",
            Scene(touching, 1e-3, 0.6, effects=FREE), forces_of(linear_slip), CLOSED,
        ),
        _linear("just rests again: loading 1e-6 above critical", _critical(1.0 + 1e-6), 2.0, tolerance=1e-6),
        _linear("just slides on: loading 1e-6 below critical", _critical(1.0 - 1e-6), 2.0, tolerance=1e-6),
    ]  # fmt: skip


def _critical(share: float, alpha: float = 0.1, drive: float = 1e-3) -> dict[str, float]:
    """mu_s at this share of the critical Phi_cr = w dmu_s, alpha from the damper (docs/equations.md, section 5)."""
    inside = mp.sqrt(1 - mp.mpf(alpha) ** 2)
    b = alpha / inside
    psi = mp.findroot(
        lambda y: mp.exp(b * y) * (mp.cos(y) - b * mp.sin(y)) - 1, (mp.pi * 1.2, 2 * mp.pi), solver="anderson"
    )
    critical = -mp.exp(b * psi) * mp.sin(psi) / inside
    rise = float(share * critical) * drive * float(np.sqrt(K * M))
    return {"slope": 0.0, "damping": 2 * alpha * K, "mu_s": PAIR["mu_k0"] + rise}


def _refusals() -> list[HardCase]:
    lift = ((0.0, 1.0), (1.0, -0.1))
    touch = ((0.0, 1.0), (1.0, 0.0))
    return [
        _refused("normal force falls below zero", Scene({}, 1e-3, 2.0, force=lift), "lift-off is not simulated"),
        _refused("normal force touches zero", Scene({}, 1e-3, 2.0, force=touch), "lift-off is not simulated"),
        _refused(
            "static below kinetic friction: sticks and slips for ever",
            Scene({"mu_s": 0.4, "mu_k0": 0.43}, 1e-3, 2.0, effects=("inertia",)),
            "without time passing .* simulate sliding where",
        ),
        _refused("alpha = -1.5: the slip runs away", _alpha(-1.5).scene, "friction pushes .* left its range"),
        _refused(
            "drive shaken for ever just below the onset",
            Scene(
                {"excitation_amplitude": 1e-5, "excitation_frequency": 1e4, "excitation_phase": 0.0},
                1e-12, 1e9, effects=("inertia", "excitation"),
            ),
            "no digits are left of the phase",
        ),
        _refused(
            "two vibrations that for ever nearly let go",
            Scene(
                {"excitation_amplitude": 1e-5, "excitation_frequency": 1e3, "excitation_phase": 0.0}
                | {"tremor_amplitude": 1e-5, "tremor_frequency": 2e3, "tremor_phase": 0.0},
                1e-10, 3.95e6, effects=("inertia", "excitation", "finger_motion"),
            ),
            "too many to look at; leave out that vibration",
        ),
    ]  # fmt: skip


CASES: tuple[HardCase, ...] = (*_sticks(), *_friction(), *_rigs(), *_directions(), *_edges(), *_refusals())
