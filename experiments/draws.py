"""Random scenes over the whole admissible box: any composition of effects, rig and drive. Same seed, same scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identify.effects import ALL, MAIN
from identify.model.model import Model, assemble

LAWS = ("velocity_weakening", "linear_weakening", "power_law")
FREE = ("direct_effect", "occlusion", "friction_heterogeneity", "skin_compliance", "excitation", "finger_motion")
SENSOR = ("force_sensor", "sensor_lag", "sensor_second_lag")
# Where skin on polymer lies: half of the draws are taken from here, the others from the whole box.
LABORATORY = {
    "mass": (1e-2, 2.0),
    "stiffness": (1e2, 1e5),
    "D": (1e-6, 1e-3),
    "t_cr": (1e-2, 1e2),
    "a": (1.0, 1e4),
    "mu_s": (0.1, 3.0),
    "drive_speed": (1e-6, 1e-1),
    "normal_force": (0.1, 100.0),
}
YEAR = 2026
ACCURACIES = (1e-4, 1e-6, 1e-8)
BOX = {"drive_speed": (1e-9, 1.0), "normal_force": (1e-3, 1e3)}


@dataclass(frozen=True)
class Draw:
    """One scene, SI. drive: (start [s], speed [m/s]) pairs; normal_force: times [s] and values [N]; accuracy asked."""

    seed: int
    effects: tuple[str, ...]
    values: dict[str, float]
    drive: tuple[tuple[float, float], ...]
    normal_force: tuple[tuple[float, ...], tuple[float, ...]]
    duration: float
    start: dict[str, float]
    accuracy: float

    @property
    def model(self) -> Model:
        """Its model."""
        return assemble(self.effects)


class _Dice:
    """Numbers of one draw: `wide` says whether they come from the whole box."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng([YEAR, seed])
        self.wide = bool(self.random.random() < 0.5)

    def chance(self, share: float) -> bool:
        return bool(self.random.random() < share)

    def log(self, low: float, high: float) -> float:
        return float(np.exp(self.random.uniform(np.log(low), np.log(high))))

    def flat(self, low: float, high: float) -> float:
        return float(self.random.uniform(low, high))

    def sign(self) -> float:
        return 1.0 if self.chance(0.5) else -1.0

    def size(self, name: str, model: Model | None = None) -> float:
        """A positive quantity by name, log-uniform in its box."""
        if name in LABORATORY and not self.wide:
            return self.log(*LABORATORY[name])
        if name in BOX:
            return self.log(*BOX[name])
        assert model is not None
        parameter = model.parameter(name)
        return self.log(parameter.lower, parameter.upper)


def _effects(dice: _Dice) -> tuple[str, ...]:
    if dice.chance(0.3):
        return MAIN
    chosen = {"inertia"}
    if dice.chance(0.8):
        chosen.add("hysteresis_damping" if dice.chance(0.7) else "driven_damping")
    if dice.chance(0.75):
        chosen.add("contact_ageing")
    if dice.chance(0.7):
        chosen.add(LAWS[int(dice.random.integers(len(LAWS)))])
    if dice.chance(0.2):
        chosen.add("load_dependence" if dice.chance(0.5) else "pressure_dependence")
    chosen |= {name for name in (*FREE, "varying_normal_force") if dice.chance(0.2)}
    if dice.chance(0.3):
        chosen |= set(SENSOR[: int(dice.random.integers(1, 4))])
    return tuple(effect.name for effect in ALL if effect.name in chosen)


def _main_values(dice: _Dice, model: Model) -> dict[str, float]:
    """Rig and friction, the paper's parameters; the kinetic coefficient below the static one but for a few."""
    has = set(model.parameter_names)
    v = {name: dice.size(name, model) for name in ("mass", "stiffness", "mu_s", "D", "t_cr", "a") if name in has}
    v["mu_k0"] = max(v["mu_s"] * (dice.flat(0.02, 1.0) if dice.chance(0.9) else dice.flat(0.98, 1.02)), 1e-4)
    if "delta_mu_k" in has:
        v["delta_mu_k"] = v["mu_k0"] * (dice.flat(-0.95, 0.0) if dice.chance(0.7) else dice.flat(0.0, 1.0))
    if "slope" in has:
        v["slope"] = dice.sign() * dice.log(1e-3, 1e2) * v["mu_k0"]
    if "damping_frequency" in has:
        v["damping_frequency"] = dice.log(1e-6, 1e6) if dice.wide else dice.log(1.0, 1e3)
    if "damping" in has:
        ratio = 0.0 if dice.chance(0.1) else dice.log(1e-4, 20.0)
        v["damping"] = min(2.0 * ratio * v["stiffness"], 1e8)
        if "damping_frequency" in has:
            v["damping"] = min(
                2.0 * ratio * np.sqrt(v["stiffness"] * v["mass"]) * 2 * np.pi * v["damping_frequency"], 1e8
            )
    return v


def _more_values(
    dice: _Dice, names: set[str], v: dict[str, float], speed: float, force: float, duration: float
) -> None:
    """Parameters of the other effects, within what leaves friction positive and vibrations countable."""
    weak, reach = v["mu_k0"], v["mu_s"] * force / v["stiffness"]
    for name, low, high in (("direct_strength", -4.0, -0.5), ("field_sd", -4.0, -1.0)):
        if name in names:
            v[name] = min(weak * 10.0 ** dice.flat(low, high), 1.0)
    if "lowest_speed" in names:
        v["lowest_speed"] = float(np.clip(speed * dice.log(1e-2, 1.0), 1e-9, 1.0))
        v["speed_exponent"] = dice.flat(-0.5, 1.0)
    table = {
        "direct_speed": lambda: dice.log(1e-9, 1.0),
        "load_exponent": lambda: dice.flat(-1.0, 1.0),
        "reference_force": lambda: float(np.clip(force * dice.log(0.1, 10.0), 1e-3, 1e4)),
        "pressure_exponent": lambda: dice.flat(-1.0, 1.0),
        "reference_pressure": lambda: float(np.clip(force / 2.262e-4 * dice.log(0.1, 10.0), 1.0, 1e9)),
        "occlusion_level": lambda: dice.flat(-2.0, 2.0),
        "occlusion_hastening": lambda: dice.flat(-0.9, 5.0),
        "occlusion_time": lambda: float(np.clip(duration * dice.log(1e-3, 1e2), 1e-2, 1e6)),
        "field_length": lambda: float(np.clip(reach * dice.log(0.1, 1e3), 1e-9, 10.0)),
        "strength_sd": lambda: dice.flat(0.0, 0.5),
        "loading_sd": lambda: dice.flat(0.0, 0.2) if dice.chance(0.5) else 0.0,
        "field_seed": lambda: float(dice.random.integers(1, 1000)),
        "skin_stiffness": lambda: float(np.clip(v["stiffness"] * dice.log(1e-2, 1e4), 1.0, 1e12)),
        "skin_retardation": lambda: dice.log(1e-6, 1e3) if dice.wide else dice.log(1e-4, 1.0),
        "excitation_amplitude": lambda: dice.sign() * min(reach * dice.log(1e-6, 2.0), 1e-2),
        "excitation_frequency": lambda: float(np.clip(dice.log(0.1, 1e3) / duration, 1e-3, 1e4)),
        "finger_drift": lambda: dice.sign() * min(speed * dice.log(1e-3, 2.0), 1e-2),
        "lag_time": lambda: dice.log(1e-6, 10.0),
        "second_lag_time": lambda: dice.log(1e-6, 10.0),
        "sensor_gain": lambda: dice.log(0.5, 2.0),
        "sensor_offset": lambda: force * dice.flat(-1.0, 1.0),
    }
    for name, roll in table.items():
        if name in names:
            v[name] = roll()
    for rhythm in ("breathing", "pulse", "tremor"):
        if f"{rhythm}_amplitude" in names:
            v[f"{rhythm}_amplitude"] = dice.sign() * min(reach * dice.log(1e-6, 1.0), 1e-2)


def _programme(dice: _Dice, speed: float, duration: float) -> tuple[tuple[float, float], ...]:
    """One speed, or up to four: other speeds, holds, reversals."""
    if dice.chance(0.7):
        return ((0.0, speed),)
    starts = np.sort(dice.random.uniform(0.05, 0.95, int(dice.random.integers(1, 4)))) * duration
    others = [dice.random.choice([0.0, -speed, speed * dice.log(0.1, 10.0)]) for _ in starts]
    return ((0.0, speed), *((float(t), float(np.clip(v, -1.0, 1.0))) for t, v in zip(starts, others, strict=True)))


def _course(dice: _Dice, force: float, duration: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """A constant normal force, or one that wanders by up to a factor of three."""
    if dice.chance(0.75):
        return (0.0,), (force,)
    n = int(dice.random.integers(2, 7))
    times = np.concatenate([[0.0], np.sort(dice.random.uniform(0.0, 1.0, n - 1)) * duration])
    values = np.clip(force * np.exp(dice.random.uniform(-1.0, 1.0, n)), 1e-3, 1e3)
    return tuple(np.unique(times).tolist()), tuple(values[: np.unique(times).size].tolist())


def effects_of(seed: int) -> tuple[str, ...]:
    """The effects of a seed's scene: ten seeds in a row share them, so that what is built for them is used again."""
    return _effects(_Dice(seed // 10))


def draw(seed: int) -> Draw:
    """The scene of a seed: at least one onset where the drive reaches it, then some cycles or some sliding."""
    dice = _Dice(seed)
    effects = effects_of(seed)
    model = assemble(effects)
    names = set(model.parameter_names)
    values = _main_values(dice, model)
    speed, force = dice.size("drive_speed"), dice.size("normal_force")
    loading = values["mu_s"] * force / (values["stiffness"] * speed)
    natural = float(np.sqrt(values["mass"] / values["stiffness"]))
    further = dice.log(1.0, 300.0) * natural if dice.chance(0.7) else min(3.0 * loading, 2000.0 * natural)
    duration = loading * dice.flat(0.8, 1.3) + further
    _more_values(dice, names, values, speed, force, duration)
    for name in names - set(values):
        values[name] = model.parameter(name).default
    speed *= dice.sign()
    start = {"gamma": dice.flat(0.0, 1.0)} if "contact_ageing" in effects and dice.chance(0.5) else {}
    if dice.chance(0.15):
        start |= {"elongation": speed * loading * dice.flat(-0.5, 1.5), "sliding_speed": speed * dice.flat(-1.0, 2.0)}
    programme, course = _programme(dice, speed, duration), _course(dice, force, duration)
    return Draw(seed, effects, values, programme, course, duration, start, float(dice.random.choice(ACCURACIES)))
