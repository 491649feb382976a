"""Reading the result.json of an earlier fit, and the scene it was fitted with."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identify.cli.common import CommandLineError
from identify.errors import SceneError

if TYPE_CHECKING:
    from identify.scene import Scene


def read_result(path: Path) -> dict[str, Any]:
    """The document of a stored result.

    Raises:
        CommandLineError: no such file, or no result of ours.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CommandLineError(f"{path}: no such file; give the result.json of a fit") from None
    except IsADirectoryError:
        raise CommandLineError(f"{path}: this is a folder; give the result.json in it") from None
    except (ValueError, RecursionError):
        raise CommandLineError(f"{path}: this is not JSON; give the result.json of a fit") from None
    if not _is_result(document):
        raise CommandLineError(f"{path}: this is no result of a fit; give a result.json that stickslip fit wrote")
    return dict(document)


def place_of(document: Mapping[str, Any], number: int) -> int:
    """Where a result has log `number` (from 0) of its scene: its first stroke, where it was cut into strokes."""
    logs = document["logs"]
    mine = [place for place, log in enumerate(logs) if log.get("part_of") == number + 1]
    whole = [place for place, log in enumerate(logs) if "part_of" not in log]
    before = len({log["part_of"] for log in logs if "part_of" in log and log["part_of"] <= number})
    return mine[0] if mine else whole[number - before]


def scene_of(document: Mapping[str, Any], path: Path) -> Scene:
    """The scene that a result was fitted with.

    Raises:
        CommandLineError: what is recorded there is no scene any more.
    """
    from identify.scene import Scene

    try:
        return Scene.from_document(document["provenance"]["scene"])
    except SceneError as error:
        raise CommandLineError(f"{path}: the scene recorded there: {error}") from None


def _is_result(document: Any) -> bool:
    """Whether the parts that commands read are there and of the right kind."""
    if not isinstance(document, Mapping) or not {"status", "parameters", "logs", "provenance"} <= set(document):
        return False
    parameters, logs, provenance = document["parameters"], document["logs"], document["provenance"]
    if not isinstance(parameters, Mapping) or not isinstance(logs, list) or not isinstance(provenance, Mapping):
        return False
    scene = provenance.get("scene")
    if not isinstance(scene, Mapping) or len(scene.get("logs", ())) != len(logs):
        return False
    told = (document.get("correlation") or {}).get("names") or []
    return (
        all(isinstance(p, Mapping) and {"value", "standard_error", "verdict"} <= set(p) for p in parameters.values())
        and all(isinstance(log, Mapping) and "sha256" in log for log in logs)
        and all(name in parameters for name in told)
    )
