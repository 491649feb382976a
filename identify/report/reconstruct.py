"""From a solution to curves: fitted force at the samples, events of the cycles, one slip on a fine grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.base.outcome import LogCurves, SlipDetail
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting import batch as lanes
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.simulation.plan import Stepping
from identify.simulation.simulate import run

Array = NDArray[np.float64]

FINE = 400  # points of a slip in detail
AS_FITTED = 0.1  # of the range of a slip's force: farther from the fitted curve it is not drawn
LEAD, TAIL = 0.25, 0.35  # of the slip's duration, shown before and after it


def fitted_curves(
    log: Prepared, unknowns: Unknowns, theta: Array, trajectory: ShootingTrajectory, fitted: Array, z: Array
) -> LogCurves:
    """Curves of a log that was fitted.

    Args:
        theta: (n_p,) solution; trajectory: the motion moved to it; fitted (n,) force at the samples, NaN outside;
            z (c,) misfit of each cycle in standard deviations.
    """
    p = unknowns.values(trajectory.theta(theta), log.data.base)
    forces = _event_forces(log, unknowns, p, trajectory)
    cycles = np.column_stack([trajectory.onset, trajectory.arrest, *forces, z[: trajectory.cycles]])
    slip = _typical_slip(log, unknowns, p, trajectory)
    return replace(
        detected_curves(log),
        fitted_force=np.where(log.used, fitted, np.nan),
        used=log.used & np.isfinite(fitted),
        noise=log.data.noise,
        cycles=cycles,
        slip=slip if slip is not None and as_fitted(slip, log.record.time, fitted) else None,
    )


def refused_curves(log: Prepared, fitted: LogCurves) -> LogCurves:
    """Curves of a fit that was refused: cycles as they were measured, for how they scatter is what the reader is sent
    to; the misfit of each where there are as many as were fitted."""
    cycles = detected_curves(log).cycles
    if cycles.shape == fitted.cycles.shape:
        cycles[:, -1] = fitted.cycles[:, -1]
    return replace(fitted, cycles=cycles)


def detected_curves(log: Prepared) -> LogCurves:
    """Curves of a log that was not fitted: its detected cycles only."""
    c, raw = log.segmentation.cycles, log.account.raw.friction_force
    measured = np.column_stack([c.onset, c.arrest, c.onset_force, c.arrest_force])
    return LogCurves(
        name=log.name,
        time=log.record.time,
        normal_force=log.record.normal_force,
        friction_force=log.force,
        fitted_force=np.full(log.record.time.size, np.nan),
        used=log.used,
        noise=float(log.segmentation.noise),
        drive_speed=log.data.drive_speed,
        cycles=np.column_stack([measured, np.full(len(measured), np.nan)]),
        measured=measured,
        slip=None,
        raw_force=None if raw is log.record.friction_force else log.sign * raw,
        cuts=tuple((cut.kind, cut.start, cut.stop) for cut in log.account.cuts),
    )


def _event_forces(log: Prepared, unknowns: Unknowns, p: Array, trajectory: ShootingTrajectory) -> tuple[Array, Array]:
    """What the load cell sees at onset and arrest of every cycle (c,), (c,) [N]."""
    if trajectory.cycles == 0:
        return np.empty(0), np.empty(0)
    out = []
    for which in (trajectory.ending("onset"), trajectory.ending("arrest")):
        times, states = trajectory.until[which], trajectory.at_end(which)
        u = np.column_stack(
            [np.full(times.size, log.data.drive_speed), log.data.normal_force.at(times), np.ones(times.size), times]
        )
        out.append(lanes.load_cell(unknowns.model, states, np.tile(p, (times.size, 1)), u))
    return out[0], out[1]


def as_fitted(slip: SlipDetail, time: Array, fitted: Array) -> bool:
    """Whether a slip that was simulated anew runs where the fit has it: it has one normal force throughout, the fit
    another one in every slip of a load that trembles.

    Args:
        time, fitted: (n,) of the log's samples [s], [N], NaN where nothing was fitted.
    """
    at = slip.samples[np.isfinite(fitted[slip.samples])]
    off = np.abs(np.interp(time[at], slip.time, slip.force) - fitted[at])
    return bool(np.max(off, initial=0.0) < AS_FITTED * np.ptp(slip.force))


def _typical_slip(log: Prepared, unknowns: Unknowns, p: Array, trajectory: ShootingTrajectory) -> SlipDetail | None:
    """The slip of median duration (not the first where there are more), simulated from its fitted onset."""
    if trajectory.cycles == 0:
        return None
    durations = trajectory.arrest - trajectory.onset
    order = np.argsort(durations[1:]) + 1 if trajectory.cycles > 2 else np.argsort(durations)
    cycle = int(order[order.size // 2])
    onset, duration = float(trajectory.onset[cycle]), float(durations[cycle])
    model = unknowns.model
    names = [s.name for s in model.states]
    load = float(log.data.normal_force.at(onset) + trajectory.deviation[cycle])
    lead = LEAD * duration
    at_onset = trajectory.at_end(trajectory.ending("onset"))[cycle]
    start = dict(zip(names, at_onset.tolist(), strict=True)) | {"sliding_speed": 0.0}
    values = dict(zip(model.parameter_names, p.tolist(), strict=True))
    try:
        motion = run(
            model, values, log.data.drive_speed, load, (1 + TAIL) * duration, start=start, accuracy=Stepping(1e-8)
        )
    except SimulationError:  # where a failed fit ended, no slip need be possible
        return None
    times = np.linspace(0.0, (1 + TAIL) * duration, FINE)
    sampled = motion.sample(times)
    # Before the onset the mass rests: the spring loads at the drive speed, the contact hardly ages meanwhile.
    before = np.linspace(-lead, 0.0, FINE // 8, endpoint=False)
    rest = {name: np.full(before.size, sampled[name][0]) for name in sampled}
    k = values["stiffness"]
    rest["elongation"] = rest["elongation"] + log.data.drive_speed * before
    rest["force"] = rest["force"] + k * log.data.drive_speed * before
    rest["coefficient"] = rest["coefficient"] + k * log.data.drive_speed * before / load
    rest["sliding_speed"] = np.zeros(before.size)
    joined = {name: np.concatenate([rest[name], sampled[name]]) for name in sampled}
    absent = np.full(before.size + times.size, np.nan)
    shown = np.flatnonzero(
        (log.record.time >= onset - lead) & (log.record.time <= onset + (1 + TAIL) * duration) & log.used
    )
    return SlipDetail(
        cycle + 1,
        onset + np.concatenate([before, times]),
        joined["force"],
        joined["elongation"],
        joined["sliding_speed"],
        joined.get("gamma", absent),
        joined["coefficient"],
        shown,
    )
