"""What the usual errors of a rig and its sensors add to intervals that take both as exact.

Every such error is a direction in the space of all parameters, the rig's among them, so that the information at the
answer already holds what the data say of it: an error of a mass, a stiffness or a damping is that parameter's own
direction; one of all drive speeds is a change of the unit of length; one of the friction force's gain a change of the
unit of force with the normal force kept; one of the normal force's gain divides the coefficients; one of the friction
force's zero shifts both coefficients alike. Each error is estimated along with the parameters, its tolerance as its
prior: what the data contradict is not believed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from identify.estimation.covariance import Information, inverse
from identify.logs.unknowns import Unknowns
from identify.model.model import RIG_PARAMETERS

Array = NDArray[np.float64]

COEFFICIENTS = ("mu_s", "mu_k0", "delta_mu_k", "slope", "direct_strength")  # the friction force is linear in them


TOLERANCE_WORDS = {
    "mass": "the mass",
    "stiffness": "the stiffness",
    "damping": "the damping",
    "drive_speed": "the drive speed",
    "friction_force": "the gain of the friction force",
    "normal_force": "the gain of the normal force",
    "friction_zero": "the zero of the friction force",
    "normal_zero": "the zero of the normal force",
    "specimen": "the likeness of the specimens of the logs",
}
LEVELS = ("mu_s", "mu_k0")  # a zero of the friction force is a level of both
LENGTHS = {"m": 1.0, "m/s": 1.0, "s/m": -1.0, "N/m": -1.0}  # powers of a length; an area only makes a pressure


def added_by_tolerances(known: Information, values: Array, tolerances: Mapping[str, float], memory: float) -> Array:
    """Covariance (f, f) of the free theta that errors of rig and sensors add to that of the fit.

    Args:
        known: at the answer; values (n_p,) of all parameters there [SI].
        tolerances: relative, one standard deviation each, of mass, stiffness, damping (where the fit holds them),
            drive_speed, friction_force and normal_force (the gains of their sensors), and the zeros of both sensors as
            shares of the normal force (friction_zero, normal_zero); what is absent is exact.
        memory: by how much the autocorrelation of the noise widens a variance.
    """
    free, n_p = known.free, len(known.unknowns.names)
    known_of = {name: direction for name, direction in _directions(known, values) if tolerances.get(name)}
    moves = np.column_stack([np.eye(n_p)[:, free], *known_of.values()])
    matrix = moves.T @ (known.data / memory) @ moves
    count = free.size
    matrix[:count, :count] += (known.total - known.data)[np.ix_(free, free)]  # a tap ties mass and stiffness
    matrix[np.arange(count, len(matrix)), np.arange(count, len(matrix))] += [1.0 / tolerances[n] ** 2 for n in known_of]
    return np.asarray(inverse(matrix)[:count, :count] - inverse(matrix[:count, :count]))


def standard_deviations(covariance: Array) -> Array:
    """Roots (f,) of the variances of what errors add; rounding leaves none below 0."""
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _directions(known: Information, values: Array) -> Iterator[tuple[str, Array]]:
    """How theta (n_p,) moves with a relative error, by what is in error."""
    unknowns = known.unknowns
    size = np.where(unknowns.logarithmic, 1.0, values)  # of a relative change
    units = [parameter.unit for parameter in unknowns.model.parameters]
    rig = np.array([name in RIG_PARAMETERS for name in unknowns.names])
    coefficient = np.array([name in COEFFICIENTS for name in unknowns.names])
    there = ~rig | (values > 0.0)
    for i in np.flatnonzero(rig & there & ~unknowns.free):
        yield unknowns.names[i], np.eye(values.size)[i]
    yield "drive_speed", there * by_drive_speed(unknowns, values)
    yield "friction_force", size * there * (coefficient | rig | np.array(["N" in unit for unit in units]))
    yield "normal_force", -size * coefficient
    yield "normal_zero", -size * coefficient  # of a steady load, a zero is a gain
    yield "friction_zero", np.isin(unknowns.names, LEVELS).astype(float)


def by_drive_speed(unknowns: Unknowns, values: Array) -> Array:
    """How theta (n_p,) moves with a relative error of all drive speeds: a change of the unit of length.

    Args:
        values: (n_p,) of all parameters [SI].
    """
    rig = np.array([name in RIG_PARAMETERS for name in unknowns.names])
    lengths = np.array([LENGTHS.get(parameter.unit, 0.0) for parameter in unknowns.model.parameters])
    return np.asarray(np.where(unknowns.logarithmic, 1.0, values) * np.where(rig, -1.0, lengths))
