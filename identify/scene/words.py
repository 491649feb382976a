"""A scene in words: the tables of a scene file again, in SI numbers, for provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from identify.base.budget import DEFAULT_TIME_LIMIT

if TYPE_CHECKING:
    from identify.scene.scene import Scene
    from identify.scene.values import LogEntry, ParameterSpec, Rig

NEUTRAL = (("factor", 1.0), ("offset", 0.0))


def _said(table: Mapping[str, object]) -> dict[str, Any]:
    """The table without what it does not say; tuples become lists, as in JSON."""
    kept = {key: value for key, value in table.items() if value is not None and value != () and value != {}}
    return {key: _plain(value) for key, value in kept.items()}


def _plain(value: object) -> Any:
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return dict(value) if isinstance(value, Mapping) else value


def _rig(rig: Rig) -> dict[str, Any]:
    table = _said(asdict(rig))
    for name, tolerance in table.pop("tolerances", {}).items():
        table[name] = {"value": table[name], "tolerance": tolerance}
    for name, tolerance in table.pop("ratio_tolerances", {}).items():
        if name == "zeta":
            table.pop("damping")
            table["zeta"] = {"value": rig.zeta, "tolerance": tolerance}
        else:
            table[f"{name}_tolerance"] = tolerance
    return table


def _parameter(spec: ParameterSpec) -> dict[str, Any]:
    prior = _said({"mean": spec.prior_mean, "sd": spec.prior_sd})
    bare = {"start": spec.start, "lower": spec.lower, "upper": spec.upper, "fixed": spec.fixed}
    tie = None if spec.tie is None else {k: v for k, v in asdict(spec.tie).items() if (k, v) not in NEUTRAL}
    return _said(bare | {"prior": prior, "per": spec.per, "tie": tie})


def _log(entry: LogEntry) -> dict[str, Any]:
    return _said(asdict(entry)) | {"path": str(entry.path.absolute())}


def _contact(scene: Scene) -> dict[str, Any]:
    contact = scene.contact
    law = _said({"coefficient": contact.coefficient, "exponent": contact.exponent})
    return _said({"area": contact.area, "area_law": law})


def document_of(scene: Scene) -> dict[str, Any]:
    """The tables of the scene, JSON-able, SI; what is not said is absent. Where the effects are still to be chosen that
    goes for every parameter the scene does not name: a default written down would be read back as stated."""
    listed = not isinstance(scene.effects, str)
    return {
        "name": scene.name,
        "effects": scene.effects if isinstance(scene.effects, str) else list(scene.effects),
        **({"extrapolate": list(scene.extrapolate)} if scene.extrapolate else {}),
        "rig": _rig(scene.rig),
        "contact": _contact(scene),
        **({"quality": dict(scene.thresholds.own)} if scene.thresholds.own else {}),
        **({"fit": {"time_limit": scene.time_limit}} if scene.time_limit != DEFAULT_TIME_LIMIT else {}),
        **({"tolerances": dict(scene.tolerances)} if scene.tolerances else {}),
        "initial": asdict(scene.initial),
        "parameters": {name: _parameter(spec) for name, spec in scene.parameters.items() if listed or spec.stated},
        "logs": [_log(entry) for entry in scene.logs],
    }
