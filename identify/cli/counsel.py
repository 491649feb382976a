"""What a finished fit says beyond its numbers: how sure its answers are, and what to change, at one of its logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from identify.base.errors import SimulationError
from identify.base.outcome import numbers_of
from identify.cli.point import Point
from identify.cli.points import points_of
from identify.prediction.probability import probability_document
from identify.prediction.sources import Tested, groups_of
from identify.prediction.stabilising import stabilising_changes
from identify.report.finished import Fit
from identify.scene import Scene

DRAWS = 100  # some milliseconds each


def with_counsel(scene: Scene, fit: Fit) -> Fit:
    """The fit with "sureness" and "advice" among the derived quantities of the fastest log that sticks and slips (the
    nearest to where stick-slip ends), else of the fastest; as it was where there is no answer."""
    result, logs = fit.result, list(fit.result["logs"])
    answered = [i for i, log in enumerate(logs) if "stability" in (log.get("derived") or {})]
    if not fit.converged or not answered:
        return fit
    chosen = max(answered, key=lambda i: (_sticks(logs[i]["derived"]), abs(logs[i]["drive_speed_m_per_s"] or 0.0)))
    point = _point(scene, result, chosen)
    if point is None:
        return fit
    at = (point.model, point.values, point.drive_speed, point.normal_force, point.covariance, point.names)
    try:
        further = {
            "sureness": probability_document(*at, DRAWS),
            "advice": stabilising_changes(*at, Tested.of_result(result)),
        }
    except SimulationError:
        return fit  # the answers of the logs say why
    logs[chosen] = {**logs[chosen], "derived": {**logs[chosen]["derived"], **further}}
    return replace(fit, result={**result, "logs": logs})


def _sticks(derived: Mapping[str, Any]) -> bool:
    return bool(derived["amplitude"]["drop"]["value"] is not None)


def _point(scene: Scene, result: Mapping[str, Any], place: int) -> Point | None:
    """The operating point of a log of the result (from 0), None where it has none."""
    number, groups = numbers_of(result["logs"])[place], groups_of(result, place)
    speed = abs(result["logs"][place]["drive_speed_m_per_s"] or 0.0)
    here = [p for p in points_of(scene, result) if p.log == number and p.groups == groups and not p.untold]
    return next((p for p in here if abs(p.drive_speed - speed) <= 1e-9 * speed), None)
