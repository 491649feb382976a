"""What a fit takes as stated, each as a column of the score test: what it changes in a log, and how it is said."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from identify.base.wording import distinct, speed_scale, three_figures
from identify.diagnosis.score_test import Change, Column, Score
from identify.estimation.attempt import Attempt
from identify.logs.log_data import LogData
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns, stated_rig
from identify.model.model import RIG_PARAMETERS
from identify.prediction.wording import shown
from identify.scene import Scene

Array = NDArray[np.float64]

DIFFERENCE = 1e-5  # relative, of what is differentiable
REACH = float(np.log(4.0))  # how far a ratio is moved
LAGS = (0.03, 0.1, 0.3)  # of sqrt(m/k): a lag is no small change of a curve with kinks
EFFECTS = {
    "sensor_lag": ("sensor_lag", "lag_time"),
    "load_exponent": ("load_dependence", "load_exponent"),
    "force_zero": ("force_sensor", "sensor_offset"),
}  # the effect, and its parameter, that a quantity is
USUAL, EXPONENT = 0.05, 0.3  # errors of zeros, of the load, and exponents that are no surprise
STOPPED = 0.2  # of its median: the least of a power spectrum that a filter made; autocorrelated noise has 0.4 and more
LINES, FEWEST, QUIET = 64, 512, 0.25  # samples of a stretch, of a log that tells, and the share of stretches that count
SHOWS = 9.0  # squares in noise variances by which an average changes a curve: three standard deviations
VARIED = 0.02  # relative range of the normal force below which nothing can be told of what it does

# What differs in a log with a quantity moved from one value to another. Ratios are moved by their logarithm.


def parameter(index: int, *, logarithmic: bool) -> Change:
    """A parameter of the model, in search units."""

    def change(log: LogData, _curve: Array, before: float, after: float) -> LogData:
        base = log.base.copy()
        base[index] = base[index] * np.exp(after - before) if logarithmic else base[index] + after - before
        return replace(log, base=base)

    return change


def drive_speed(log: LogData, _curve: Array, before: float, after: float) -> LogData:
    """The speed of the drive over the stated one."""
    times, programme = float(np.exp(after - before)), log.programme
    if programme is not None:
        scaled = {name: tuple(times * v for v in getattr(programme, name)) for name in ("speeds", "accelerations")}
        programme = replace(programme, **scaled)
    return replace(log, drive_speed=times * log.drive_speed, programme=programme)


def _loaded(log: LogData, values: Array) -> LogData:
    least = 1e-3 * log.mean_normal_force  # no column lifts the mass off
    return replace(log, normal_force=replace(log.normal_force, values=tuple(np.maximum(values, least).tolist())))


def load_gain(log: LogData, _curve: Array, before: float, after: float) -> LogData:
    """The normal force over what is read of it."""
    return _loaded(log, np.exp(after - before) * log.normal_force.knots[1])


def load_zero(log: LogData, _curve: Array, before: float, after: float) -> LogData:
    """What the normal force is where nothing is read [N]."""
    return _loaded(log, after - before + log.normal_force.knots[1])


def load_exponent(reference: float) -> Change:
    """The exponent with which all friction falls as the normal force rises beyond a reference [N]."""

    def change(log: LogData, _curve: Array, before: float, after: float) -> LogData:
        values = log.normal_force.knots[1]
        return _loaded(log, values * (values / reference) ** (before - after))

    return change


def _sensed(shown: Callable[[LogData, Array, float], Array]) -> Change:
    """What a sensor shows of the curve (n,) [N] of a log, or of the force where there is none: the measured force moves
    by what it does."""

    def change(log: LogData, curve: Array, before: float, after: float) -> LogData:
        whole = np.where(np.isfinite(curve), curve, log.force)
        return replace(log, force=log.force + shown(log, whole, before) - shown(log, whole, after))

    return change


def _lagged(log: LogData, curve: Array, lag: float) -> Array:
    """A first-order lag [s]; exact for a force that is linear between samples."""
    if curve.size < 2 or not lag > 1e-3 * log.interval:
        return curve
    decay = np.exp(-log.interval / lag)
    ramp = lag * (1.0 - decay) / log.interval
    before = curve[0] - lag * (curve[1] - curve[0]) / log.interval  # settled on the slope that the record begins with
    # The recursion as a bidiagonal system: scipy.signal, which has it, takes a third of a second to load.
    driven = np.append(before, (1.0 - ramp) * curve[1:] + (ramp - decay) * curve[:-1])
    diagonals = np.stack([np.ones(curve.size), np.full(curve.size, -decay)])
    return np.asarray(scipy.linalg.solve_banded((1, 0), diagonals, driven))


force_gain = _sensed(lambda _log, curve, size: np.exp(size) * curve)
force_zero = _sensed(lambda _log, curve, size: curve + size)
sensor_lag = _sensed(_lagged)


def held_quantities(attempt: Attempt, unknowns: Unknowns) -> list[Column]:
    """The columns of all that a fit took as stated.

    Args:
        unknowns: of the fit, without the weak priors of its solves.
    """
    logs, layout, theta = [log.data for log in attempt.fitted_logs], attempt.solved.problem.layout, attempt.solved.theta
    loads = np.concatenate([log.normal_force.values for log in logs])
    load, near = float(np.mean([log.mean_normal_force for log in logs])), 1e-6 * unknowns.spread
    with np.errstate(invalid="ignore"):  # the logarithm of nothing stands at the bound of none
        low, high = theta - unknowns.lower < near, unknowns.upper - theta < near
    at_wall = low & unknowns.user_bounds[0] | high & unknowns.user_bounds[1]
    names, out = unknowns.names, list[Column]()
    for i, declared in enumerate(unknowns.model.parameters):
        logarithmic = declared.scale == "log"
        nothing = logarithmic and not np.exp(theta[i]) * logs[0].base[i] > 0.0
        if declared.kind != "given" and not nothing and (not unknowns.free[i] or at_wall[i]):
            most = REACH if declared.name in RIG_PARAMETERS else np.inf
            change = parameter(i, logarithmic=logarithmic)
            out.append(Column(declared.name, change, DIFFERENCE, usual=declared.spread, most=most))
        elif unknowns.free[i] and np.isfinite(unknowns.prior_sd[i]) and unknowns.prior_about[i] < 0:
            own = [int(place.own[i]) for place in layout.places if place.own[i] >= 0]  # of single logs or groups
            mine = tuple(dict.fromkeys([*np.flatnonzero(layout.free == i).tolist(), *own]))
            out.append(Column(declared.name, None, 1.0, usual=float(unknowns.prior_sd[i]), prior=mine))
    out.append(Column("drive_speed", drive_speed, DIFFERENCE, of="both", most=REACH))
    out.append(Column("force_gain", force_gain, DIFFERENCE, of="both", most=REACH))
    out.append(Column("load_gain", load_gain, DIFFERENCE, of="single", most=REACH))
    if np.ptp(loads) > VARIED * load:
        out.append(Column("load_zero", load_zero, DIFFERENCE * load, usual=USUAL * load))
        out.append(Column("force_zero", force_zero, DIFFERENCE * load, usual=USUAL * load))
        out.append(Column("load_exponent", load_exponent(load), DIFFERENCE, usual=EXPONENT))
    mass, stiffness = (logs[0].base[names.index(name)] for name in ("mass", "stiffness"))
    natural = float(np.sqrt(mass / stiffness))
    half = np.pi * natural  # what lags by a slip or more shows none
    out += [Column("sensor_lag", sensor_lag, s * natural, positive=True, usual=natural, most=half) for s in LAGS]
    return [c for c in out if c.name not in EFFECTS or EFFECTS[c.name][0] not in unknowns.model.effects]


def smoothed(logs: Sequence[Prepared], curves: Sequence[Array]) -> str:
    """A sentence where the noise of a log is that of an averaged, filtered or resampled force, and an average as wide
    would change its curve (n,), whatever the model makes of it: a wrong damping looks like one. "" where no log is
    such. The curve is that of a fit, or the force itself where no start was met.

    Such a treatment leaves frequencies at which hardly any noise is left (zeros of a moving average, the stop band of a
    filter), while the spectrum of autocorrelated noise falls gradually.
    """
    time = np.arange(LINES) - 0.5 * (LINES - 1)
    for log, curve in zip(logs, curves, strict=True):
        data = log.data
        used = (data.weight > 0.0) & np.isfinite(curve)
        if np.count_nonzero(used) < FEWEST:
            continue
        # Of the quietest stretches, straight but for noise, as those of a stick are: no misfit and no slip is in them.
        stretches = np.lib.stride_tricks.sliding_window_view(data.force[used], LINES)[:: LINES // 4]
        stretches = stretches - stretches.mean(axis=1, keepdims=True)
        stretches -= np.outer(stretches @ time / (time @ time), time)
        size = np.sum(stretches**2, axis=1)
        quiet = stretches[size <= np.quantile(size, QUIET)] * np.hanning(LINES)
        power = np.mean(np.abs(np.fft.rfft(quiet, axis=1)) ** 2, axis=0)[3:-1]  # what a trend takes is no gap
        if np.min(power) > STOPPED * np.median(power):
            continue
        width = float(np.max(power) / np.mean(power))
        shown = np.where(np.isfinite(curve), curve, data.force)
        box = np.ones(round(width) | 1) / (round(width) | 1)
        padded = np.pad(shown, box.size // 2, mode="reflect", reflect_type="odd")
        change = np.where(used, np.convolve(padded, box, mode="valid") - shown, 0.0)
        if float(np.sum(data.weight * change**2)) > SHOWS:
            return (
                f"{log.name}: its noise is that of a force that was smoothed or resampled, like a moving average over "
                f"{width:.0f} samples, which would change the force by more than the noise, and the model takes every "
                "sample as measured by itself: export the force as it was sampled, without smoothing"
            )
    return ""


SAID = {
    "drive_speed": (
        "a drive speed{of} {times:.3g} times the stated one{all}{values}",
        "look at the position of the drive, or time it over a known way",
    ),
    "force_gain": (
        "a friction force{of}{all} that reads {times:.3g} times what it is",
        "hang a known weight on the friction sensor",
    ),
    "load_gain": (
        "a normal force{of}{all} {times:.3g} times what is read",
        "check its load, and whether it is of the same specimen as the others",
    ),
    "load_zero": (
        "a normal force that reads {less:.3g} mN at zero",
        "zero the sensor of the normal force, or take that off: normal_tare in [[logs]]",
    ),
    "force_zero": (
        "a friction force that reads {milli:.3g} mN at zero",
        "zero the sensor of the friction force, or take that off: tare in [[logs]]",
    ),
    "load_exponent": (
        "friction coefficients that change with the normal force (exponent {minus:.3g})",
        "add load_dependence to effects",
    ),
    "sensor_lag": ("a lag of the force sensor of {milli:.3g} ms", "add sensor_lag to effects"),
}
"""Of each quantity that is no parameter of the model: what the data suggest, and what to do."""
RATIOS = ("drive_speed", "force_gain", "load_gain")
RIG_REMEDIES = {
    "mass": ("kg", "weigh what moves"),
    "stiffness": ("N/m", "measure it against a rigid block"),
    "damping": ("N/m", "let the rig ring down without contact"),
}


@dataclass(frozen=True)
class Suggestion:
    """A quantity (of one log, or of all: None) with what it is stated as and what the data suggest, in SI (of gains and
    of the drive speed of all logs, as a ratio), in words, and what to do about it."""

    quantity: str
    log: str | None
    stated: float
    suggested: float
    standard_error: float
    words: str
    remedy: str


def suggestion(
    scene: Scene, attempt: Attempt, unknowns: Unknowns, score: Score, size: float, error: float
) -> Suggestion:
    """What the data suggest of a scored quantity.

    Args:
        size: how far the data move it, in the units of its column; error: the standard error of that.
    """
    name, log = score.column.name, None if score.log is None else attempt.fitted_logs[score.log].name
    if name in unknowns.names:
        return _of_parameter(scene, attempt, unknowns, score, size, error)
    text, remedy = SAID[name]
    times, values, stated, suggested = float(np.exp(size)), "", 0.0, size
    if name in RATIOS:
        stated, suggested, error = 1.0, times, error * times
    if name == "drive_speed" and score.log is not None:
        speed = attempt.fitted_logs[score.log].data.drive_speed
        unit, scale = speed_scale(speed)
        better, before = distinct(times * speed / scale, speed / scale)
        values = f" ({better} {unit} instead of {before} {unit})"
        stated, suggested, error = speed, times * speed, error * speed
    of, everywhere = ("", " in all logs") if log is None else (f" of {log}", "")
    milli = 1e3 * size
    words = text.format(of=of, all=everywhere, values=values, times=times, milli=milli, less=-milli, minus=-size)
    return Suggestion(name, log, stated, suggested, error, words, remedy)


def _of_parameter(
    scene: Scene, attempt: Attempt, unknowns: Unknowns, score: Score, size: float, error: float
) -> Suggestion:
    """What the data suggest of a parameter, and what of the scene speaks against it."""
    name, prior = score.column.name, bool(score.column.prior)
    i = unknowns.names.index(name)
    declared, spec = unknowns.model.parameters[i], scene.parameters.get(name)
    base, theta = unknowns.base(stated_rig(scene)), attempt.solved.theta.copy()
    if prior:
        theta[i] = unknowns.prior_mean[i]
    stated = float(unknowns.values(theta, base)[i])
    theta[i] += size
    value = float(unknowns.values(theta, base)[i])
    error = error * abs(value) if declared.scale == "log" else error
    if name in RIG_PARAMETERS:
        unit, remedy = RIG_REMEDIES[name]
        remedy += f', or let it be estimated: [parameters] {name} = {{ start = "{three_figures(value)} {unit}" }}'
        if not prior:
            better, before = distinct(value, stated)
            words = f"a {name} of {better} {unit} instead of {before} {unit}"
            return Suggestion(name, None, stated, value, error, words, remedy)
    else:
        remedy = "add skin_compliance to effects" if name == "skin_stiffness" else f"correct {name} under [parameters]"
    if spec is not None and spec.fixed is not None:
        by = f"the value it is fixed at ({shown(spec.fixed, declared.unit)})"
    elif prior:
        tolerance = float(unknowns.prior_sd[i]) * (stated if declared.scale == "log" else 1.0)
        by = f"its prior ({shown(stated, declared.unit)} ± {shown(tolerance, declared.unit, stated)})"
    else:
        ends = "" if spec is None else f" ({shown(spec.lower, declared.unit)} to {shown(spec.upper, declared.unit)})"
        by = f"its bounds{ends}"
    words = f"{name} = {shown(value, declared.unit)} (ruled out by {by})"
    return Suggestion(name, None, stated, value, error, words, remedy)


def in_series(scene: Scene, softer: Suggestion) -> Suggestion | None:
    """What gives in series with the rig, where that looks like a stiffness that is smaller than the stated one."""
    if softer.quantity != "stiffness" or not softer.suggested < softer.stated or "skin_compliance" in scene.effects:
        return None
    give = 1.0 / (1.0 / softer.suggested - 1.0 / softer.stated)
    error = softer.standard_error * (give / softer.suggested) ** 2
    words, remedy = f"something of {three_figures(give)} N/m in series with the rig", "add skin_compliance to effects"
    return Suggestion("skin_stiffness", None, np.inf, give, error, words, remedy)
