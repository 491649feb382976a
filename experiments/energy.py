"""Energy balance of a simulated motion, by quadrature from its samples: work of the drive = stored + dissipated.

Apart from the simulation: the drive's motion and the rig's dampers are written here from their definitions, and the
integrals are Gauss sums over samples between the nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.simulation.trajectory import Trajectory, inside

Array = NDArray[np.float64]
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(6)


@dataclass(frozen=True)
class Balance:
    """Energies [J] over a motion; `turnover` is what went through: the sum of the sizes of all of them."""

    work: float
    stored: float
    damper: float
    contact: float
    turnover: float

    @property
    def error(self) -> float:
        """What is missing, relative to the turnover."""
        return abs(self.work - self.stored - self.damper - self.contact) / self.turnover


def balance(motion: Trajectory, p: Mapping[str, float]) -> Balance:
    """The balance from the first to the last instant: spring, hysteresis damper, mass and, where the model has them,
    a series element (skin) and a sinusoidal excitation of the drive; `p` by name, SI."""
    states = [s.name for s in motion.model.states]
    k, m, soft = p["stiffness"], p["mass"], "skin_deformation" in states
    c = p["damping"] * (m / k) ** 0.5
    amplitude, omega = p.get("excitation_amplitude", 0.0), 2.0 * np.pi * p.get("excitation_frequency", 0.0)
    which, local, weights = [], [], []
    for i, phase in enumerate(motion.phases):
        edges = phase.t
        if phase.mode == "stick":  # the series element relaxes at the start, the excitation goes on
            even = np.linspace(0.0, phase.duration, int(np.ceil(phase.duration * omega)) + 2)
            edges = np.unique([*even, *np.geomspace(1e-12 * phase.duration, phase.duration, 61)])
        half = 0.5 * np.diff(edges)[:, None]
        local.append((edges[:-1, None] + half * (1.0 + POINTS)).ravel())
        weights.append((half * WEIGHTS).ravel())
        which.append(np.full(local[-1].size, i))
    places, after, weight = np.concatenate(which), np.concatenate(local), np.concatenate(weights)
    s = inside(motion.model, motion.phases, places, after)
    speeds, starts = np.array([(phase.situated.drive_speed, phase.situated.time) for phase in motion.phases]).T
    drive = speeds[places] + amplitude * omega * np.cos(
        omega * (starts[places] + after) + p.get("excitation_phase", 0.0)
    )
    stretching, x, damper = drive - s["sliding_speed"], s["elongation"], np.zeros_like(after)
    if soft:
        stiff, viscous = p["skin_stiffness"], p["skin_stiffness"] * p["skin_retardation"]
        y = s["skin_deformation"]
        give = (k * (x - y) + c * stretching - stiff * y) / (c + viscous)
        stretching, x, damper = stretching - give, x - y, viscous * give**2
    work = (k * x + c * stretching) * drive
    lost, contact = damper + c * stretching**2, s["coefficient"] * s["normal_force"] * s["sliding_speed"]

    def stored(state: Array) -> float:
        y = float(state[states.index("skin_deformation")]) if soft else 0.0
        energy = 0.5 * k * float(state[0] - y) ** 2 + 0.5 * m * float(state[1]) ** 2
        return energy + (0.5 * p["skin_stiffness"] * y**2 if soft else 0.0)

    first, last = stored(motion.phases[0].x[0]), stored(motion.phases[-1].x[-1])
    sums = [float(power @ weight) for power in (work, lost, contact, np.abs(work))]
    turnover = sums[3] + abs(sums[1]) + abs(sums[2]) + first + last
    return Balance(sums[0], last - first, sums[1], sums[2], turnover)
