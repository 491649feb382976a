"""Growth of a disturbance of steady sliding, simulated, and its limit (docs/equations.md, section 6) written again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.plan import Stepping
from identify.simulation.simulate import run

Array = NDArray[np.float64]

FIXED_DAMPER = ("inertia", "driven_damping", "contact_ageing")  # c does not change with the stiffness
DISTURBANCE = 1e-6
PERIODS, PER_PERIOD = 12, 24
RTOL = 1e-11


@dataclass(frozen=True)
class Pair:
    """One parameter set, SI: `viscous` is the damping constant c [N s/m] at the critical stiffness."""

    effects: tuple[str, ...]
    mass: float
    viscous: float
    mu_s: float
    mu_k0: float
    delta_mu_k: float
    a: float
    D: float
    t_cr: float
    speed: float
    load: float

    def damper(self, stiffness: float, critical: float) -> float:
        """c [N s/m] at a stiffness: h sqrt(m/k) with h fixed, or fixed itself."""
        return self.viscous * (critical / stiffness) ** 0.5 if self.effects == MAIN else self.viscous

    def slope(self) -> float:
        """d(sliding friction)/d(speed) at fixed gamma [N s/m]."""
        worn = self.speed * self.t_cr / self.D
        return self.load * self.delta_mu_k * self.a * np.exp(-self.a * self.speed) * worn

    def step(self) -> float:
        """mu_s minus the kinetic coefficient at the drive speed."""
        return self.mu_s - self.mu_k0 + self.delta_mu_k * float(np.expm1(-self.a * self.speed))

    def excess(self, stiffness: float, critical: float) -> float:
        """Pi - Pi_fc of section 6: positive where steady sliding is unstable."""
        impedance = (self.mass * stiffness) ** 0.5
        z = (self.damper(stiffness, critical) + self.slope()) / impedance
        T = self.t_cr * (stiffness / self.mass) ** 0.5
        return self.load * self.step() * self.t_cr / self.D / impedance - z * (1.0 + T * T / (1.0 + z * T))

    def critical(self) -> float:
        """The stiffness [N/m] at which the two are equal, the damper being `viscous` there."""
        return float(brentq(lambda k: self.excess(k, k), 1e-6, 1e12, rtol=1e-14))

    def rate(self, share: float) -> tuple[float, float]:
        """Growth rate [1/s] and angular frequency [rad/s] at this share of the critical stiffness, from a simulation.

        Steady sliding is disturbed by 1e-6 of gamma; the speed that follows is sampled and its oscillation found by
        linear prediction (a recurrence of third order has the three eigenvalues as the logarithms of its roots).
        """
        critical = self.critical()
        k = share * critical
        c = self.damper(k, critical)
        p = {"mass": self.mass, "stiffness": k, "mu_s": self.mu_s, "mu_k0": self.mu_k0, "D": self.D, "t_cr": self.t_cr}
        if self.effects == MAIN:
            p |= {"damping": c * (k / self.mass) ** 0.5, "delta_mu_k": self.delta_mu_k, "a": self.a}
        else:
            p |= {"damping": c * 2.0 * np.pi, "damping_frequency": 1.0}
        gamma = 1.0 - self.speed * self.t_cr / self.D
        kinetic = self.mu_s - self.step()
        start = {
            "elongation": self.load * (kinetic + self.step() * gamma) / k,
            "sliding_speed": self.speed,
            "gamma": gamma * (1.0 + DISTURBANCE),
        }
        slowest = self._frequency(k, c)
        duration = 2.0 * np.pi / slowest * PERIODS
        motion = run(assemble(self.effects), p, self.speed, self.load, duration, start=start, accuracy=Stepping(RTOL))
        times = np.linspace(0.0, duration, PERIODS * PER_PERIOD + 1)
        return _oscillation(motion.sample(times)["sliding_speed"] / self.speed - 1.0, times[1])

    def _frequency(self, k: float, c: float) -> float:
        """About the frequency at the limit [rad/s]: how long to simulate."""
        z, T = (c + self.slope()) / (self.mass * k) ** 0.5, self.t_cr * (k / self.mass) ** 0.5
        return float((k / self.mass) ** 0.5 / (1.0 + max(z * T, 0.0)) ** 0.5)


def _oscillation(y: Array, dt: float) -> tuple[float, float]:
    """Growth rate and angular frequency of the oscillating part of y, the last two thirds of it."""
    y = y[y.size // 3 :]
    past = np.stack([y[2:-1], y[1:-2], y[:-3]], axis=1)
    weights = np.linalg.lstsq(past, y[3:], rcond=1e-9)[0]
    roots = np.roots([1.0, *(-weights)]).astype(complex)
    pair = max(roots, key=lambda root: abs(root.imag))
    return float(np.log(abs(pair)) / dt), float(abs(np.angle(pair)) / dt)


def pairs(count: int, seed: int = 1) -> list[Pair]:
    """Random parameter sets, by turns with a damper that is fixed and with the paper's four effects."""
    random, out = np.random.default_rng(seed), []
    while len(out) < count:
        main = len(out) % 2 == 1

        def log(low: float, high: float) -> float:
            return float(np.exp(random.uniform(np.log(low), np.log(high))))

        mu_k0, rise, load = random.uniform(0.2, 0.8), random.uniform(0.05, 0.4), log(0.3, 10.0)
        D, t_cr = log(1e-5, 1e-3), log(0.03, 3.0)
        speed = random.uniform(0.1, 0.8) * D / t_cr
        weakening = load * rise * t_cr / D
        pair = Pair(
            MAIN if main else FIXED_DAMPER,
            log(0.02, 2.0),
            weakening * log(0.01, 0.5),
            mu_k0 + rise,
            mu_k0,
            random.uniform(-0.3, 0.3) * mu_k0 if main else 0.0,
            log(0.01, 1.0) / speed if main else 1.0,
            D,
            t_cr,
            speed,
            load,
        )
        limits = [pair.excess(k, k) for k in (1e-6, 1e12)]
        damped = pair.viscous + pair.slope() > 0.0
        if damped and limits[0] > 0.0 > limits[1]:
            out.append(pair)
    return out
