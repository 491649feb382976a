"""Friction parameters of stick-slip, identified from tribometer logs."""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identify import amplitude, stability
    from identify.asked import Asked
    from identify.identification import fit
    from identify.mapping import continue_over, stability_map
    from identify.scene import Scene
    from identify.simulate import simulate

__all__ = ["Asked", "Scene", "amplitude", "continue_over", "fit", "simulate", "stability", "stability_map"]

_HOMES = {
    "Asked": "identify.asked",
    "Scene": "identify.scene",
    "continue_over": "identify.mapping",
    "fit": "identify.identification",
    "simulate": "identify.simulate",
    "stability_map": "identify.mapping",
}


class _Package(ModuleType):
    """Loads the promised names on first use, because they bring CasADi (a second) which `stickslip --help` can spare.

    `simulate` is a promised function and the room it lives in: the function keeps the name when the room is imported.
    """

    def __getattr__(self, name: str) -> Any:
        if name in _HOMES:
            return getattr(importlib.import_module(_HOMES[name]), name)
        if name in ("amplitude", "stability"):
            return importlib.import_module(f"identify.{name}")
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __setattr__(self, name: str, value: Any) -> None:
        super().__setattr__(name, value.simulate if name == "simulate" and isinstance(value, ModuleType) else value)


sys.modules[__name__].__class__ = _Package
