"""Friction parameters of stick-slip, identified from tribometer logs."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identify import amplitude, stability
    from identify.identification import fit
    from identify.scene import Scene
    from identify.simulate import simulate

__all__ = ["Scene", "amplitude", "fit", "simulate", "stability"]

_HOMES = {"Scene": "identify.scene", "fit": "identify.identification"}  # loaded on first use: they bring CasADi


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    if name in ("amplitude", "stability"):
        return importlib.import_module(f"identify.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
