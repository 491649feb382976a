"""What is searched: which parameters are free, in which scale, with which bounds and priors.

Search variable of a parameter: its deviation from a base value, or the logarithm of the ratio to it.
For friction parameters the base is 0 or 1, so theta is the value or its logarithm; for rig quantities
the base is each log's own value, so one theta shared by all logs is a common deviation of the rig.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SceneError
from identify.effects import ALL
from identify.model.model import RIG_PARAMETERS, Model
from identify.scene import Scene

Array = NDArray[np.float64]

SOFT_FACTOR = 3.0  # sd of a logarithm: a factor of twenty
SOFT_SPREADS = 10.0  # sd of a parameter on a linear scale, in its own spread: 1 for a coefficient
FORGOTTEN = 1e3  # spreads: sd of a parameter of which nothing is known before
AT_BOUND = 1e-6  # of the spread: a parameter that close to its bound sits on it
RESOLVED = 0.04  # of sqrt(m/k): time constants that go to zero cannot be told from zero below that
RIG_REACH = 1.1  # of the logarithm: a rig quantity with a tolerance stays within a factor of three


@dataclass(frozen=True)
class Unknowns:
    """The search space, all arrays (n_p,) in the order of the model's parameters.

    `start` is theta at the first guess and the value of what is not free; `lower`, `upper` bound theta;
    `prior_mean`, `prior_sd` are Gaussian (sd infinite: no prior); `stated`: the scene has a value of it;
    `user_bounds` (2, n_p): the lower and upper bounds that the scene itself gives, the others are the model's own;
    `prior_about` (n_p,): the parameter about which a prior is, beyond its mean, -1 where about none;
    `per`: by what each parameter differs from log to log (None: by nothing; "log"; a label; empty: none differs).
    """

    model: Model
    free: NDArray[np.bool_]
    start: Array
    lower: Array
    upper: Array
    prior_mean: Array
    prior_sd: Array
    stated: NDArray[np.bool_]
    user_bounds: NDArray[np.bool_]
    prior_about: NDArray[np.int64]
    per: tuple[str | None, ...] = ()

    @property
    def prior_precision(self) -> Array:
        """Precision (n_p, n_p) of theta before any data."""
        rows, varied = np.eye(self.free.size), np.flatnonzero(self.prior_about >= 0)
        rows[varied, self.prior_about[varied]] -= 1.0
        return np.asarray(rows.T @ (rows / self.prior_sd[:, None] ** 2))

    @property
    def prior_deviation(self) -> Array:
        """Standard deviation of theta (n_p,) before any data, with that of what a prior is about."""
        varied, out = self.prior_about >= 0, self.prior_sd.copy()
        own = out[self.prior_about[varied]]
        out[varied] = np.hypot(out[varied], np.where(self.free[self.prior_about[varied]], own, 0.0))
        return out

    def off_prior(self, theta: Array) -> Array:
        """By how many standard deviations theta (n_p,) is off each prior (n_p,); 0 where there is none."""
        varied, out = self.prior_about >= 0, theta - self.prior_mean
        out[varied] -= theta[self.prior_about[varied]]
        return np.asarray(out / self.prior_sd)

    @property
    def names(self) -> tuple[str, ...]:
        """Names in the order of theta."""
        return self.model.parameter_names

    @property
    def spread(self) -> Array:
        """Typical uncertainty of theta before a fit."""
        return np.array([q.spread for q in self.model.parameters])

    @property
    def logarithmic(self) -> NDArray[np.bool_]:
        """Which parameters are searched by their logarithm."""
        return np.array([q.scale == "log" for q in self.model.parameters])

    @property
    def own(self) -> NDArray[np.bool_]:
        """Which free parameters logs, or groups of them, have for themselves."""
        return self.free & (np.array([q.own for q in self.model.parameters]) | self.grouped)

    @property
    def grouped(self) -> NDArray[np.bool_]:
        """Which free parameters the scene gives to logs or groups of them."""
        return self.free & np.array([by is not None for by in self.per or (None,) * self.free.size])

    def at_own_bounds(self, theta: Array) -> NDArray[np.bool_]:
        """Which parameters (n_p,) sit at a bound of the model that is none of the scene."""
        near = AT_BOUND * self.spread
        low = (np.abs(theta - self.lower) < near) & ~self.user_bounds[0]
        high = (np.abs(theta - self.upper) < near) & ~self.user_bounds[1]
        return np.asarray(self.free & (low | high))

    def base(self, rig: Mapping[str, float]) -> Array:
        """Base values for a log with this rig (mass, stiffness, damping by name)."""
        neutral = np.where(self.logarithmic, 1.0, 0.0)
        return np.array([rig[n] if n in RIG_PARAMETERS else neutral[i] for i, n in enumerate(self.names)])

    def values(self, theta: Array, base: Array) -> Array:
        """Parameter values from theta (..., n_p) and base (..., n_p)."""
        with np.errstate(over="ignore"):
            return np.where(self.logarithmic, base * np.exp(theta), base + theta)

    def strength(self, theta: Array) -> float:
        """|mu_s - mu_k0| at theta (n_p,)."""
        values = self.values(theta, np.where(self.logarithmic, 1.0, 0.0))
        return abs(float(values[self.names.index("mu_s")] - values[self.names.index("mu_k0")]))

    def theta(self, values: Array, base: Array) -> Array:
        """Theta of parameter values (..., n_p)."""
        with np.errstate(all="ignore"):
            return np.where(self.logarithmic, np.log(values / base), values - base)

    def own_prior(self, i: int, start: float) -> tuple[float, float]:
        """Mean and standard deviation of the prior on parameter i of a log, or a group, that has it for itself."""
        mean, sd, spread = float(self.prior_mean[i]), float(self.prior_sd[i]), float(self.spread[i])
        # A phase of nothing has no information at all: a prior that says nothing keeps the matrices regular.
        if self.grouped[i] and sd < FORGOTTEN * spread:
            return mean, sd
        return start if np.isfinite(mean) else 0.0, min(sd, FORGOTTEN * spread)

    @property
    def weakest(self) -> Array:
        """Standard deviations (n_p,) of priors that only keep what the data do not tell from wandering off."""
        return np.where(self.logarithmic, SOFT_FACTOR, SOFT_SPREADS * self.spread)

    def with_weak_priors(self) -> Unknowns:
        """The same search with the weakest priors around the start where there is none; the information matrix never
        sees them."""
        none = ~np.isfinite(self.prior_sd)
        return replace(
            self,
            prior_mean=np.where(none, self.start, self.prior_mean),
            prior_sd=np.where(none, self.weakest, self.prior_sd),
        )

    def within_region(self, weight: float) -> Unknowns:
        """The same search with a further prior around the start, of the information of so many of the weakest."""
        known, more = self.prior_sd**-2.0, np.where(self.prior_about < 0, weight / self.weakest**2, 0.0)
        mean = np.where(known > 0.0, known * self.prior_mean, 0.0) + more * self.start
        with np.errstate(divide="ignore", invalid="ignore"):
            return replace(
                self,
                prior_mean=np.where(more > 0.0, mean / (known + more), self.prior_mean),
                prior_sd=(known + more) ** -0.5,
            )


def stated_rig(scene: Scene) -> dict[str, float]:
    """Mass [kg], stiffness [N/m] and damping [N/m] as [rig] of a scene states them, by name."""
    return {name: float(getattr(scene.rig, name)) for name in RIG_PARAMETERS}


def from_scene(scene: Scene) -> Unknowns:
    """The search space a scene describes.

    Friction parameters are free unless fixed; a rig quantity is free when it stands in [parameters], or when
    [rig] gives it a tolerance, which then is its prior.

    Raises:
        SceneError: a rig quantity of zero that is to be estimated.
    """
    model, rig = scene.model, stated_rig(scene)
    names, n = model.parameter_names, len(model.parameters)
    free, start = np.zeros(n, bool), np.zeros(n)
    lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
    mean, sd, stated = np.zeros(n), np.full(n, np.inf), np.zeros(n, bool)
    nulls = {name: value for effect in ALL if effect.name in model.effects for name, value in effect.null.items()}
    user_bounds, about = np.zeros((2, n), bool), np.full(n, -1)
    per = []
    for i, declared in enumerate(model.parameters):
        name, spec, logarithmic = declared.name, scene.parameters.get(declared.name), declared.scale == "log"
        of_rig, neutral = name in RIG_PARAMETERS, 1.0 if logarithmic else 0.0
        base, tolerance = rig[name] if of_rig else neutral, scene.rig.tolerances.get(name, 0.0)
        per.append(spec.per if spec is not None else None)
        if of_rig and base == 0.0 and (spec is not None or tolerance > 0.0):
            raise SceneError(f"{name} of [rig] is 0 and is to be estimated; give a positive value to start from")
        if spec is None and of_rig:
            if tolerance > 0.0:
                free[i], sd[i], lower[i], upper[i] = True, tolerance, -RIG_REACH, RIG_REACH
            continue
        if spec is None:
            raise SceneError(f"the scene has no {name}, which its effects need; add it to [parameters]")

        def search(value: float, base: float = base, logarithmic: bool = logarithmic) -> float:
            if not logarithmic:
                return value - base
            return float(np.log(value / base)) if value > 0.0 else -np.inf

        value = next((v for v in (spec.fixed, spec.start, spec.prior_mean) if v is not None), None)
        stated[i] = value is not None
        start[i] = search(value if value is not None else base if of_rig else declared.default)
        free[i] = spec.fixed is None
        lower[i], upper[i] = search(spec.lower), search(spec.upper)
        user_bounds[:, i] = spec.lower > declared.lower, spec.upper < declared.upper
        if logarithmic and declared.unit == "s" and nulls.get(name) == 0.0 and rig["mass"] > 0.0:
            # A time constant that makes its effect vanish as it goes to zero.
            lower[i] = max(lower[i], float(np.log(RESOLVED * np.sqrt(rig["mass"] / rig["stiffness"]))))
        if spec.prior_mean is not None and spec.prior_sd is not None:
            mean[i] = search(spec.prior_mean)
            sd[i] = spec.prior_sd / spec.prior_mean if logarithmic else spec.prior_sd
        elif tolerance > 0.0:
            sd[i] = tolerance
    for name, ratio, share in (("damping", "zeta", 1.0), ("mass", "natural_frequency", 2.0)):
        spec, known = scene.parameters.get(name), scene.rig.ratio_tolerances.get(ratio, 0.0)
        if known and name in names and free[names.index(name)] and (spec is None or spec.prior_sd is None):
            about[names.index(name)], sd[names.index(name)] = names.index("stiffness"), share * known
    start = np.clip(start, lower, upper)
    return Unknowns(model, free, start, lower, upper, mean, sd, stated, user_bounds, about, tuple(per))


def user_start(scene: Scene) -> bool:
    """Whether the user gave a start value of any friction parameter."""
    return any(spec.start is not None for spec in scene.parameters.values())
