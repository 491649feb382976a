"""One operating point of a pair, as calculators and maps of the command line take it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from identify.prediction.map_axes import Site
from identify.prediction.sources import Groups, named

if TYPE_CHECKING:
    from identify.model.model import Model

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Point:
    """One operating point: drive speed [m/s] and normal force [N], every parameter [SI], how well they are known.

    covariance (f, f) of `names` (parameters, "drive_speed") [SI], None where nothing is said of it; groups: of the log,
    by what the parameters of a fit differ by; untold: why the fit has no values for it, empty where it has; log: its
    number in the scene (from 0).
    """

    name: str
    model: Model
    values: Mapping[str, float]
    drive_speed: float
    normal_force: float
    covariance: Array | None
    names: tuple[str, ...]
    area: float | None = None
    area_exponent: float = 0.0
    groups: Groups = ()
    untold: str = ""
    log: int = 0

    @property
    def title(self) -> str:
        """Its name, with its group where there are several."""
        return f"{self.name} ({named(self.groups)})" if self.groups else self.name

    @property
    def site(self) -> Site:
        """The point as maps take it; `area` [m^2] is the contact's nominal one under its normal force."""
        return Site(self.model, self.values, self.drive_speed, self.normal_force, self.area, self.area_exponent)
