"""The operating point of a map: what happens there, alive while it is dragged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from identify.app.folder import PageError
from identify.app.tries import ONE_AT_A_TIME
from identify.prediction.map_axes import Site, axis, known_axes, moved_values
from identify.prediction.predict import predict
from identify.prediction.sources import Tested, pair_of
from identify.report.stored_result import plain
from identify.scene import Scene

SPEED, LOAD = "drive_speed", "normal_force"


def site_of(scene: Scene, document: Mapping[str, Any] | None, number: int) -> Site:
    """The operating point of a log (from 0) of a scene, with the values of a fit where there is one.

    Raises:
        PageError: a fit without values, or no speed or load that anybody told.
    """
    entry = scene.logs[number] if number < len(scene.logs) else None
    values = scene.values(entry)
    rig = scene.rig_for(entry) if entry else scene.rig
    said: Mapping[str, Any] = {}
    if document is not None:
        pair = pair_of(document, scene, min(number, len(document["logs"]) - 1))
        if pair.untold or not pair.values:
            raise PageError(pair.untold or "this fit has no values; mend the fit first")
        values = values | {name: value for name, value in pair.values.items() if name in values}
        said = document["logs"][min(number, len(document["logs"]) - 1)]
    drive = said.get("drive_speed_m_per_s") or rig.drive_speed
    speeds = [abs(v) for _, v in drive if v] if isinstance(drive, tuple) else [abs(drive)] if drive else []
    load = said.get("normal_force_N") or rig.normal_force
    if not speeds or not load:
        raise PageError("neither the scene nor the fit tells drive speed and normal force; give them under [rig]")
    area = scene.contact.area_at(load)
    return Site(scene.model, values, speeds[0], load, area, scene.contact.exponent or 0.0)


def axes_of(site: Site) -> list[dict[str, Any]]:
    """The quantities a map can be over, with their values here."""
    names = [name for name in known_axes(site.model) if site.area is not None or name not in ("area", "pressure")]
    return [
        {"name": q.name, "label": q.label, "unit": q.unit, "value": q.value, "logarithmic": q.logarithmic}
        for q in (axis(site, name) for name in names)
    ]


def answer_at(site: Site, document: Mapping[str, Any] | None, changes: Mapping[str, float]) -> dict[str, Any]:
    """Outcome, numbers and words at a point, what of it no log tested, and the drive speeds [m/s] at which the outcome
    changes.

    Raises:
        SimulationError, PageError: a point without meaning.
    """
    unknown = [name for name in changes if name not in known_axes(site.model)]
    if unknown or len(changes) > 4:
        raise PageError("an operating point is changed by quantities of the map only; load the page again")
    moved = moved_values(site, dict(changes))
    values = {name: float(moved[name]) for name in site.model.parameter_names}
    speed, load = float(moved.get(SPEED, site.drive_speed)), float(moved.get(LOAD, site.normal_force))
    with ONE_AT_A_TIME:
        found = predict(site.model, values, speed, load)
    tested = None if document is None else Tested.of_result(document)
    here = {SPEED: speed, LOAD: load, "stiffness": values["stiffness"]}
    beyond = "" if tested is None else tested.beyond(here)
    windows = found.get("stability", {}).get("windows", [])
    numbers = {
        name: entry
        for name, entry in found.get("amplitude", {}).items()
        if isinstance(entry, Mapping) and "unit" in entry
    }
    return dict(
        plain(
            {
                "outcome": found.get("stability", {}).get("outcome", "no answer"),
                "text": found["text"],
                "beyond": beyond,
                "tested": {} if tested is None else {name: list(span) for name, span in tested.ranges.items()},
                "numbers": numbers,
                "ends": [window["to"] for window in windows[:-1]],
            }
        )
    )
