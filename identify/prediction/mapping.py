"""Maps and continuations for scripts: of a scene, by the names of the quantities."""

from __future__ import annotations

from identify.base.errors import SimulationError
from identify.prediction.chart import Chart, Range, chart
from identify.prediction.continuation import Continuation, continuation
from identify.prediction.map_axes import Site
from identify.scene import Scene


def site_of(scene: Scene, drive_speed: float | None = None, normal_force: float | None = None) -> Site:
    """The operating point of a scene: its values (fixed, else start, else default), its rig and its contact.

    Args:
        drive_speed: [m/s], sign irrelevant; None: that of the rig. normal_force: [N]; None: that of the rig.

    Raises:
        SimulationError: a speed or a force that nobody said.
    """
    speed = scene.rig.drive_speed if drive_speed is None else drive_speed
    load = scene.rig.normal_force if normal_force is None else normal_force
    if isinstance(speed, tuple) or not speed or not load:
        raise SimulationError(
            "the scene gives no single drive speed or no normal force; say both: drive_speed=1e-3, normal_force=1.0"
        )
    contact = scene.contact
    area = contact.area_at(float(load))
    return Site(
        scene.model,
        scene.values(None),
        abs(float(speed)),
        float(load),
        area,
        (contact.exponent or 0.0) if area else 0.0,
    )


def stability_map(
    scene: Scene | Site,
    x: str,
    y: str,
    x_range: Range | None = None,
    y_range: Range | None = None,
    points: int = 60,
) -> Chart:
    """Where a pair sticks and slips, slides steadily, or does either, over two quantities (`axes.known_axes`).

    Args:
        scene: a scene, or an operating point of it (`site_of`). x_range, y_range: [SI]; None: around the point.
        points: along each quantity.

    Returns:
        a `Chart`: outcomes, drop, period and the rest on the grid, and the boundaries; `chart_data.write_chart` stores
        it, `report.draw_map.draw_map` draws it.

    Raises:
        SimulationError: quantities, ranges or a model that make no map.
    """
    site = site_of(scene) if isinstance(scene, Scene) else scene
    return chart(site, (x, y), (x_range, y_range), (points, points))


def continue_over(scene: Scene | Site, quantity: str, span: Range | None = None, points: int = 120) -> Continuation:
    """Orbits, multipliers, eigenvalues and where stick-slip ends, over one quantity; arguments as of `stability_map`.

    Raises:
        SimulationError: a quantity, range or model that cannot be continued.
    """
    site = site_of(scene) if isinstance(scene, Scene) else scene
    return continuation(site, quantity, span, points)
