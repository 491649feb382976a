"""Energy balance of a simulated motion, by quadrature from its samples: work of the drive = stored + dissipated.

Apart from the simulation: the drive's motion and the rig's dampers are written here from their definitions, and the
integrals are Gauss sums over samples between the nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.simulation.phases import Phase
from identify.simulation.trajectory import Trajectory, inside

Array = NDArray[np.float64]
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(6)
RHYTHMS = ("excitation", "breathing", "pulse", "tremor")
SHORTEST = 1e-200  # [s]: less time than that does no work
PER_DECADE, SHORT = (
    5,
    1e-2,
)  # panels of a rest per decade of time; the first one, of the relaxation of the series element
MOST_PANELS = 20_000  # of one rest; beyond, the balance is not asked for


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
        return abs(self.work - self.stored - self.damper - self.contact) / max(self.turnover, 1e-300)


@dataclass(frozen=True)
class Rig:
    """Spring [N/m], damper [N s/m], mass [kg], series element [N/m, N s/m] and waves (A [m], omega, phase)."""

    k: float
    c: float
    m: float
    skin: tuple[float, float] | None
    waves: tuple[tuple[float, float, float], ...]
    drift: float

    @property
    def relaxation(self) -> float:
        """Time in which the series element relaxes at rest [s]; infinite without one."""
        return np.inf if self.skin is None else (self.c + self.skin[1]) / (self.k + self.skin[0])

    @staticmethod
    def of(p: Mapping[str, float]) -> Rig:
        """From the parameters by name."""
        c = 0.0
        if "damping" in p:
            f = p.get("damping_frequency")
            c = p["damping"] * ((p["mass"] / p["stiffness"]) ** 0.5 if f is None else 1.0 / (2.0 * np.pi * f))
        stiff = p.get("skin_stiffness")
        skin = None if stiff is None else (stiff, stiff * p["skin_retardation"])
        waves = tuple(
            (p[f"{r}_amplitude"], 2.0 * np.pi * p[f"{r}_frequency"], p[f"{r}_phase"])
            for r in RHYTHMS
            if f"{r}_amplitude" in p
        )
        return Rig(p["stiffness"], c, p["mass"], skin, waves, p.get("finger_drift", 0.0))

    def drive(self, programmed: Array, t: Array) -> Array:
        """Speed of the drive with all its motions at times t (n,) [s], from its programmed speeds (n,)."""
        v = programmed + self.drift
        for amplitude, omega, phase in self.waves:
            v = v + amplitude * omega * np.cos(omega * t + phase)
        return v


def _panels(phase: Phase, rig: Rig) -> Array:
    """Edges of the panels of one phase, local time [s]."""
    if phase.mode != "stick":
        return phase.t
    fastest = max((omega for amplitude, omega, _ in rig.waves if amplitude != 0.0), default=0.0)
    even = int(np.ceil(phase.duration * fastest)) + 1
    if even > MOST_PANELS:
        return np.empty(0)
    # The series element relaxes at the start of a rest, however long the rest: the first panel is short against that.
    first = min(1e-12 * phase.duration, SHORT * rig.relaxation)
    decades = int(np.ceil(np.log10(phase.duration / first)))
    graded = np.geomspace(first, phase.duration, PER_DECADE * decades + 1)
    return np.unique(np.concatenate([np.linspace(0.0, phase.duration, even + 1), graded]))


def balance(motion: Trajectory, p: Mapping[str, float]) -> Balance | None:
    """The balance from the first to the last instant; None where a rest has too many vibrations to add up."""
    rig = Rig.of(p)
    which, local, weights = [], [], []
    for i, phase in enumerate(motion.phases):
        if phase.duration < SHORTEST:
            continue
        edges = _panels(phase, rig)
        if edges.size < 2:
            return None
        half = 0.5 * np.diff(edges)[:, None]
        local.append((edges[:-1, None] + half * (1.0 + POINTS)).ravel())
        weights.append((half * WEIGHTS).ravel())
        which.append(np.full(local[-1].size, i))
    # Work, damper, contact, and the size of the work.
    sums = _powers(motion, rig, np.concatenate(which), np.concatenate(local)) @ np.concatenate(weights)
    first, last = (_stored(motion, rig, end) for end in (motion.phases[0].x[0], motion.phases[-1].x[-1]))
    turnover = sums[3] + abs(sums[1]) + abs(sums[2]) + first + last
    return Balance(float(sums[0]), last - first, float(sums[1]), float(sums[2]), float(turnover))


def _powers(motion: Trajectory, rig: Rig, which: NDArray[np.intp], local: Array) -> Array:
    """Powers [W] at times (n,) from the start of phases (n,): of the drive, in the dampers, in the contact, size of the
    first."""
    s = inside(motion.model, motion.phases, which, local)
    speeds, starts = np.array([(p.situated.drive_speed, p.situated.time) for p in motion.phases]).T
    drive = rig.drive(speeds[which], starts[which] + local)
    stretching, x = drive - s["sliding_speed"], s["elongation"]
    damper = np.zeros_like(local)
    if rig.skin is not None:
        stiff, viscous = rig.skin
        y = s["skin_deformation"]
        give = (rig.k * (x - y) + rig.c * stretching - stiff * y) / (rig.c + viscous)
        stretching, x, damper = stretching - give, x - y, viscous * give**2
    load = rig.k * x + rig.c * stretching
    friction = s["coefficient"] * s["normal_force"]
    work = load * drive
    return np.stack([work, damper + rig.c * stretching**2, friction * s["sliding_speed"], np.abs(work)])


def _stored(motion: Trajectory, rig: Rig, x: Array) -> float:
    """Energy in spring, series element and mass [J]."""
    names = [s.name for s in motion.model.states]
    y = float(x[names.index("skin_deformation")]) if rig.skin else 0.0
    energy = 0.5 * rig.k * float(x[0] - y) ** 2 + 0.5 * rig.m * float(x[1]) ** 2
    return energy + (0.5 * rig.skin[0] * y**2 if rig.skin else 0.0)
