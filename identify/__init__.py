"""Friction parameters of stick-slip, identified from tribometer logs."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from identify.base.packages import check_data_io

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
