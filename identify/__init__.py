"""Friction parameters of stick-slip, identified from tribometer logs."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identify.base.errors import FitError, IdentifyError, SceneError, SimulationError
    from identify.base.progress import ProgressBar
    from identify.estimation.estimator import Estimated, EstimationTask, Estimator
    from identify.identification import fit
    from identify.prediction import ageing, amplitude, stability
    from identify.prediction.maps import stability_map
    from identify.report.finished import Fit
    from identify.scene import Scene
    from identify.shooting.accuracy import Asked, FitOptions
    from identify.simulation.simulate import simulate

    __version__: str

__all__ = [
    "Asked",
    "FitOptions",
    "Estimated",
    "EstimationTask",
    "Estimator",
    "Fit",
    "FitError",
    "IdentifyError",
    "ProgressBar",
    "Scene",
    "SceneError",
    "SimulationError",
    "__version__",
    "ageing",
    "amplitude",
    "fit",
    "simulate",
    "stability",
    "stability_map",
]

_HOMES = {
    "Asked": "identify.shooting.accuracy",
    "FitOptions": "identify.shooting.accuracy",
    "Estimated": "identify.estimation.estimator",
    "EstimationTask": "identify.estimation.estimator",
    "Estimator": "identify.estimation.estimator",
    "Fit": "identify.report.finished",
    "FitError": "identify.base.errors",
    "IdentifyError": "identify.base.errors",
    "ProgressBar": "identify.base.progress",
    "Scene": "identify.scene",
    "SceneError": "identify.base.errors",
    "SimulationError": "identify.base.errors",
    "fit": "identify.identification",
    "simulate": "identify.simulation.simulate",
    "stability_map": "identify.prediction.maps",
}


def check_data_io() -> None:
    """Look whether `data_io`, without which nothing here works, is the package that was installed with this one.

    Raises:
        ImportError: a file or folder of that name stands before it on the path, beside the user's script as a rule.
    """
    spec = importlib.util.find_spec("data_io")
    place = None if spec is None or spec.origin is None else Path(spec.origin).resolve()
    if place != (Path(__file__).parents[1] / "data_io" / "__init__.py").resolve():
        raise ImportError(
            f"data_io is {place or 'missing'}, not the package of the workbench, which it hides: rename that file"
        )


def __getattr__(name: str) -> Any:
    """Loads a promised name on first use, because it brings CasADi (a second) which `stickslip --help` can spare."""
    if name in _HOMES:
        check_data_io()
        return getattr(importlib.import_module(_HOMES[name]), name)
    if name in ("ageing", "amplitude", "stability"):
        check_data_io()
        return importlib.import_module(f"identify.prediction.{name}")
    if name == "__version__":
        from importlib.metadata import version

        return version("stick-slip-workbench")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)
