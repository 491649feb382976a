"""The operating point of a map: what happens there, alive while it is dragged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from identify.app.folder import PageError
from identify.app.tries import ONE_AT_A_TIME
from identify.base.document import to_document
from identify.base.result import LogResult, Result
from identify.prediction.axes import Site, axis, known_axes, moved_values
from identify.prediction.predict import predict
from identify.prediction.sources import Tested, pair_of
from identify.report.stored_result import plain
from identify.scene import Scene

SPEED, LOAD = "drive_speed", "normal_force"
EXAMPLES = {SPEED: '"1 mm/s"', LOAD: '"1 N"'}


def site_of(scene: Scene, result: Result | None, number: int) -> Site:
    """The operating point of a log (from 0) of a scene, with the values of a fit where there is one.

    Raises:
        PageError: a fit without values, or no speed or load that is known.
    """
    entry = scene.logs[number] if number < len(scene.logs) else None
    values = scene.values(entry)
    rig = scene.rig_for(entry) if entry else scene.rig
    log = LogResult()
    if result is not None:
        log = result.logs[min(number, len(result.logs) - 1)]
        pair = pair_of(result, scene, min(number, len(result.logs) - 1))
        if pair.untold or not pair.values:
            raise PageError(pair.untold or "this fit has no values; mend the fit first")
        values = values | {name: value for name, value in pair.values.items() if name in values}
    drive = log.drive_speed_m_per_s or rig.drive_speed
    speeds = [abs(v) for _, v in drive if v] if isinstance(drive, tuple) else [abs(drive)] if drive else []
    load = log.normal_force_N or rig.normal_force
    if not speeds or not load:
        missing = [*([SPEED] if not speeds else []), *([LOAD] if not load else [])]
        words = " and ".join(name.replace("_", " ") for name in missing)
        given = ", ".join(f"{name} = {EXAMPLES[name]}" for name in missing)
        raise PageError(
            f"the scene does not tell its {words}, which only a fit that has converged takes from the logs; map such a "
            f"fit, or give under [rig]: {given}"
        )
    area = scene.contact.area_at(load)
    return Site(scene.model, values, speeds[0], load, area, scene.contact.exponent or 0.0)


def axes_of(site: Site) -> list[dict[str, Any]]:
    """The quantities a map can be over, with their values here."""
    names = [name for name in known_axes(site.model) if site.area is not None or name not in ("area", "pressure")]
    return [
        {"name": q.name, "label": q.label, "unit": q.unit, "value": q.value, "logarithmic": q.logarithmic}
        for q in (axis(site, name) for name in names)
    ]


def answer_at(site: Site, result: Result | None, changes: Mapping[str, float]) -> dict[str, Any]:
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
    tested = None if result is None else Tested.of_result(result)
    here = {SPEED: speed, LOAD: load, "stiffness": values["stiffness"]}
    beyond = "" if tested is None else tested.beyond(here)
    return dict(
        plain(
            {
                "outcome": found.stability.outcome,
                "text": found.text,
                "beyond": beyond,
                "tested": {} if tested is None else {name: list(span) for name, span in tested.ranges.items()},
                "numbers": to_document(found.amplitude.numbers),
                "ends": [window.high for window in found.stability.windows[:-1]],
            }
        )
    )
