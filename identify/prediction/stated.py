"""How well an operating point is known where nothing was fitted: by the tolerances and priors its scene states."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from identify.scene import Scene

Array = NDArray[np.float64]


def stated(scene: Scene, values: Mapping[str, float], drive_speed: float) -> tuple[tuple[str, ...], Array] | None:
    """Names and covariance (f, f) [SI] of what a scene says is not exact; None where it takes all as exact.

    Args:
        values: every parameter of the model at the operating point, SI. drive_speed: [m/s].

    The tolerances of the rig are relative standard deviations, that of the drive speed among them; a prior of a
    parameter is its standard deviation, in SI. They are independent.
    """
    deviations = {
        name: share * abs(drive_speed if name == "drive_speed" else values[name])
        for name, share in scene.rig.tolerances.items()
        if name == "drive_speed" or name in values
    }
    for name, spec in scene.parameters.items():
        if spec.prior_sd is not None and name in values:
            deviations[name] = spec.prior_sd
    known = {name: sd for name, sd in deviations.items() if sd > 0.0}
    return (tuple(known), np.diag(np.square(list(known.values())))) if known else None
