"""A scene in words: the tables of a scene file again, in SI numbers, for provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from identify.base.budget import DEFAULT_TIME_LIMIT
from identify.scene.tables import TIED

if TYPE_CHECKING:
    from identify.scene.scene import Scene
    from identify.scene.values import ParameterSpec, Rig

NEUTRAL = (("factor", 1.0), ("offset", 0.0))


def _stated(table: Mapping[str, object]) -> dict[str, Any]:
    """The table without what it does not say; tuples become lists, as in JSON."""
    kept = {key: value for key, value in table.items() if value is not None and value != () and value != {}}
    return {key: _plain(value) for key, value in kept.items()}


def _plain(value: object) -> Any:
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return dict(value) if isinstance(value, Mapping) else value


def _rig(rig: Rig) -> dict[str, Any]:
    table = _stated(asdict(rig))
    tolerances, ratios = table.pop("tolerances", {}), table.pop("ratio_tolerances", {})
    table |= {name: {"value": table[name], "tolerance": tolerance} for name, tolerance in tolerances.items()}
    if "zeta" in ratios:
        del table["damping"]
        table["zeta"] = {"value": rig.zeta, "tolerance": ratios["zeta"]}
    return table | ({TIED: ratios["natural_frequency"]} if "natural_frequency" in ratios else {})


def _parameter(spec: ParameterSpec) -> dict[str, Any]:
    prior = _stated({"mean": spec.prior_mean, "sd": spec.prior_sd})
    bare = {"start": spec.start, "lower": spec.lower, "upper": spec.upper, "fixed": spec.fixed}
    tie = None if spec.tie is None else {k: v for k, v in asdict(spec.tie).items() if (k, v) not in NEUTRAL}
    return _stated(bare | {"prior": prior, "per": spec.per, "tie": tie})


def document_of(scene: Scene) -> dict[str, Any]:
    """The tables of the scene, JSON-able, SI; what is not said is absent. Where the effects are still to be chosen that
    goes for every parameter the scene does not name: a default written down would be read back as stated."""
    listed, contact = not isinstance(scene.effects, str), scene.contact
    optional = {
        "extrapolate": list(scene.extrapolate),
        "quality": dict(scene.thresholds.own),
        "fit": {"time_limit": scene.time_limit} if scene.time_limit != DEFAULT_TIME_LIMIT else {},
        "tolerances": dict(scene.tolerances),
    }
    law = _stated({"coefficient": contact.coefficient, "exponent": contact.exponent})
    return {
        "name": scene.name,
        "effects": list(scene.effects) if listed else scene.effects,
        "rig": _rig(scene.rig),
        "contact": _stated({"area": contact.area, "area_law": law}),
        **{name: table for name, table in optional.items() if table},
        "initial": asdict(scene.initial),
        "parameters": {name: _parameter(spec) for name, spec in scene.parameters.items() if listed or spec.stated},
        "logs": [_stated(asdict(entry)) | {"path": str(entry.path.absolute())} for entry in scene.logs],
    }
