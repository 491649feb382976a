"""Friction parameters of stick-slip, identified from tribometer logs."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identify.asked import Asked
    from identify.closed_forms import ageing, amplitude, stability
    from identify.identification import fit
    from identify.maps.mapping import continue_over, stability_map
    from identify.motion.simulate import simulate
    from identify.scene import Scene

__all__ = ["Asked", "Scene", "ageing", "amplitude", "continue_over", "fit", "simulate", "stability", "stability_map"]

_HOMES = {
    "Asked": "identify.asked",
    "Scene": "identify.scene",
    "continue_over": "identify.maps.mapping",
    "fit": "identify.identification",
    "simulate": "identify.motion.simulate",
    "stability_map": "identify.maps.mapping",
}


def __getattr__(name: str) -> Any:
    """Loads a promised name on first use, because it brings CasADi (a second) which `stickslip --help` can spare."""
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    if name in ("ageing", "amplitude", "stability"):
        return importlib.import_module(f"identify.closed_forms.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
