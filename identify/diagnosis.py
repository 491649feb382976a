"""Why a model misfits: one thing at a time that may be wrong with rig or sensor is set free, and what explains the
logs within their noise is named.

A suspect explains a misfit where it alone takes it down to noise, or nearly all of it. What explains it is said,
never silently taken over: the answer stays a misfit until the user mends the scene.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from data_io import Record
from identify.attempt import Attempt
from identify.errors import FitError, SceneError
from identify.model import RIG_PARAMETERS
from identify.nested import Fitted, fit_from_values, fit_model, fits
from identify.prepare import Prepared
from identify.scene import Scene
from identify.scene.parameters import ParameterSpec
from identify.unknowns import Unknowns

REACH = 4.0  # factor up to which a rig value is suspected
REMAINS = 0.1  # share of the misfit that may remain for a suspect to be named
CLEAR = 0.02  # relative change of a rig value below which it is not called wrong
TOLD = 25.0  # likelihood-ratio statistic by which one explanation is better than another
UNITS = 30.0  # factor by which the slope of the sticks is off where a unit is wrong: no rig value is
NEAR = 3.0  # sum of squares per sample (in noise variances) up to which suspects start from the misfit's values


@dataclass(frozen=True)
class Suspect:
    """What may be wrong: its parameter, the scene with it free (None where it is free already), and the sentence that
    names it, given the value found and the one stated."""

    parameter: str
    freed: Callable[[Scene], Scene | None]
    words: Callable[[float, float], str]


def wrong_unit(prepared: Sequence[Prepared]) -> str:
    """A sentence where the sticks of a log rise so differently from stiffness times drive speed that a unit must be
    wrong; "" where none do."""
    for log in prepared:
        for slope in (part.slope for part in log.judgement.slips if part.slope is not None):
            times = 1.0 + slope
            if not 1.0 / UNITS < times < UNITS:
                return (
                    f"in the sticks of {log.name} the force rises {times:.3g} times as fast as stiffness times drive "
                    "speed says: check the units of its time and forces, its drive speed and the stiffness of the rig"
                )
    return ""


def diagnose(
    scene: Scene,
    records: Sequence[Record],
    prepared: Sequence[Prepared],
    unknowns: Unknowns,
    attempt: Attempt | None,
) -> str | None:
    """What alone would explain a misfit, in a sentence; None where nothing does.

    Args:
        scene, records, prepared, unknowns: those of the fit; attempt: where it ended.
    """
    excess = np.inf if attempt is None else 2.0 * attempt.solved.solution.cost - attempt.solved.problem.samples
    ended = Fitted(scene, unknowns, tuple(prepared), attempt, float(excess))
    if fits(ended):
        return None
    found: list[tuple[float, str]] = []
    if attempt is not None and excess < NEAR * attempt.solved.problem.samples:
        found = _explanations(scene, float(excess), lambda freed: fit_from_values(ended, freed, records))
    if not found:
        found = _explanations(scene, float(excess), lambda freed: fit_model(freed, records, thorough=False))
    least = min((misfit for misfit, _ in found), default=0.0)
    return "; or ".join(words for misfit, words in sorted(found) if misfit < least + TOLD) or None


def _explanations(scene: Scene, excess: float, fit: Callable[[Scene], Fitted]) -> list[tuple[float, str]]:
    """What is left of a misfit, and the sentence, of every suspect that explains it, fitted in that way."""
    found: list[tuple[float, str]] = []
    for suspect in SUSPECTS:
        freed = suspect.freed(scene)
        if freed is None:
            continue
        try:
            fitted = fit(freed)
        except (FitError, SceneError):
            continue
        nearly = np.isfinite(excess) and fitted.excess < REMAINS * excess
        if fitted.attempt is None or not (fits(fitted) or nearly):
            continue
        value, stated = _values(suspect, fitted, scene)
        if stated > 0.0 and abs(value / stated - 1.0) < CLEAR:
            continue
        rest = "within the noise" if fits(fitted) else f"but for {100 * fitted.excess / excess:.2g} % of it"
        found.append((fitted.excess, f"{suspect.words(value, stated)} explains the misfit {rest}"))
    return found


def _values(suspect: Suspect, fitted: Fitted, scene: Scene) -> tuple[float, float]:
    """Value found and value stated of a suspect (0 where none is stated)."""
    assert fitted.attempt is not None
    names = fitted.unknowns.names
    base = fitted.unknowns.base({n: float(getattr(scene.rig, n)) for n in RIG_PARAMETERS})
    value = fitted.unknowns.values(fitted.attempt.solved.theta, base)[names.index(suspect.parameter)]
    return float(value), float(getattr(scene.rig, suspect.parameter, 0.0) or 0.0)


def _rig(name: str) -> Callable[[Scene], Scene | None]:
    """A scene with a rig quantity estimated."""

    def freed(scene: Scene) -> Scene | None:
        value = float(getattr(scene.rig, name))
        if name in scene.parameters or value <= 0.0:
            return None
        spec = ParameterSpec(name, None, value / REACH, value * REACH)
        return replace(scene, parameters={**scene.parameters, name: spec})

    return freed


def _effect(name: str, parameter: str, start: Callable[[Scene], float]) -> Callable[[Scene], Scene | None]:
    """A scene with one effect more, its parameter started where it matters."""

    def freed(scene: Scene) -> Scene | None:
        if scene.effects == "auto" or name in scene.effects:
            return None
        made = scene.with_effects((*scene.effects, name))
        spec = made.parameters[parameter]
        begun = replace(spec, start=float(np.clip(start(scene), spec.lower, spec.upper)))
        return replace(made, parameters={**made.parameters, parameter: begun})

    return freed


def _stated(name: str, unit: str, remedy: str) -> Callable[[float, float], str]:
    def words(value: float, stated: float) -> str:
        return (
            f"a {name} of {value:.3g} {unit} instead of {stated:.3g} {unit} "
            f'({remedy}, or let it be estimated: [parameters] {name} = {{ start = "{value:.3g} {unit}" }})'
        )

    return words


SUSPECTS: tuple[Suspect, ...] = (
    Suspect("mass", _rig("mass"), _stated("mass", "kg", "weigh what moves")),
    Suspect("stiffness", _rig("stiffness"), _stated("stiffness", "N/m", "measure it against a rigid block")),
    Suspect("damping", _rig("damping"), _stated("damping", "N/m", "let the rig ring down without contact")),
    Suspect(
        "lag_time",
        _effect("sensor_lag", "lag_time", lambda scene: 0.3 * float(np.sqrt(scene.rig.mass / scene.rig.stiffness))),
        lambda value, _stated: f"a lag of the force sensor of {1e3 * value:.3g} ms (add sensor_lag to effects)",
    ),
    Suspect(
        "skin_stiffness",
        _effect("skin_compliance", "skin_stiffness", lambda scene: 5.0 * float(scene.rig.stiffness)),
        lambda value, _stated: f"something of {value:.3g} N/m in series with the rig (add skin_compliance to effects)",
    ),
)
