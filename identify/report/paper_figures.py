"""Figures for a paper, each on axes of its own or on given ones: what the methods `plot_…` of a `Fit` draw."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from identify.base.errors import FitError
from identify.base.wording import scale_for
from identify.prediction.draws import Draws
from identify.prediction.sources import pair_of
from identify.prediction.windows import QUANTILES
from identify.report.report_figures import correlation_cells
from identify.report.report_wording import plain_symbol
from identify.report.style import FITTED, MEASURED, QUIET, RESIDUAL, SHADE, drawing_style

if TYPE_CHECKING:
    from identify.report.finished import Fit

Array = NDArray[np.float64]
COLUMN = (3.5, 2.6)  # [inch]: one column of a journal
POINTS = 200


@contextmanager
def _on(axes: Axes | None) -> Iterator[Axes]:
    """The axes that are given, or new ones of one column in the one style."""
    with drawing_style():
        yield axes if axes is not None else Figure(figsize=COLUMN, layout="constrained").add_subplot()


def forces(fit: Fit, log: int, axes: Axes | None = None) -> Axes:
    """Measured and fitted friction force [N] of a log over time [s]."""
    curves = fit.logs[log - 1]
    with _on(axes) as on:
        on.plot(curves.time, curves.friction_force, color=MEASURED, linewidth=0.7, label="measured")
        on.plot(curves.time, curves.fitted_force, color=FITTED, linewidth=1.0, label="fitted")
        on.set(xlabel="time (s)", ylabel="friction force (N)")
        on.legend(loc="lower right", ncols=2, bbox_to_anchor=(1.0, 1.0))
    return on


def residuals(fit: Fit, log: int, axes: Axes | None = None) -> Axes:
    """Measured less fitted force of a log, in standard deviations of its noise, over time [s]."""
    left, curves = fit.residuals(log), fit.logs[log - 1]
    with _on(axes) as on:
        on.plot(curves.time, left / curves.noise, ".", markersize=1.5, color=RESIDUAL)
        on.axhline(0.0, color=QUIET, linewidth=0.7)
        on.set(xlabel="time (s)", ylabel="residual (noise sd)")
    return on


def parameters(fit: Fit, axes: Axes | None = None) -> Axes:
    """Forest plot: 95 % intervals of all parameters as deviations from their values [%], that of noise alone thick."""
    bounded = {n: e for n, e in fit.typed.parameters.items() if e.value and None not in e.ends}
    if not bounded:
        raise FitError("no parameter of this fit has an interval with two ends; plot_forces shows what was fitted")
    with _on(axes) as on:
        for place, entry in enumerate(bounded.values()):
            for ends, width, colour in ((entry.ends, 1.0, QUIET), (entry.interval_rig_exact, 3.5, FITTED)):
                if ends is not None and None not in ends:
                    shares = [100.0 * (end / entry.value - 1.0) for end in ends if end is not None and entry.value]
                    on.plot(shares, [place, place], color=colour, linewidth=width, solid_capstyle="butt")
            on.plot([0.0], [place], "o", color=MEASURED, markersize=3.5)
        on.set_yticks(range(len(bounded)), [plain_symbol(name) for name in bounded])
        on.invert_yaxis()
        on.set(xlabel="deviation from the value (%)", ylabel="")
    return on


def correlation(fit: Fit, axes: Axes | None = None) -> Axes:
    """Correlation matrix of the estimates, with the numbers in its cells, as in the report."""
    matrix = fit.correlation
    with _on(axes) as on:
        correlation_cells(on, [plain_symbol(name) for name in matrix.index], matrix.to_numpy())
    return on


def profile(fit: Fit, name: str, axes: Axes | None = None) -> Axes:
    """Profile likelihood of a parameter: loss in units of chi^2 over its value, with the limit of the 95 % interval."""
    made = fit.typed.profile
    if made is None or name not in made.parameters:
        known = ", ".join(made.parameters) if made is not None else "none"
        raise FitError(
            f"no profile of {name} is here (there is: {known}); fit with --profile, or asked=FitOptions(profile=True)"
        )
    curve, entry = made.parameters[name], fit.typed.parameters[name]
    scale = scale_for(entry.value, entry.unit)
    with _on(axes) as on:
        on.plot(
            np.array(curve.values, float) / scale.factor, np.array(curve.loss, float), "o-", color=FITTED, markersize=3
        )
        on.axhline(made.limit, color=MEASURED, linewidth=0.7)
        on.set(xlabel=f"{plain_symbol(name)} ({scale.unit})" if scale.unit else plain_symbol(name), ylabel="loss (χ²)")
    return on


def friction(fit: Fit, log: int, axes: Axes | None = None) -> Axes:
    """Kinetic coefficient over sliding speed [mm/s] by eq. (6), with the 95 % band of the draws; shaded: the drive
    speeds of the logs."""
    values, drawn = _drawn(fit, log, "velocity_weakening")
    tested = [speed for speed in (entry.drive_speed_m_per_s for entry in fit.typed.logs) if speed]
    speed = np.geomspace(0.3 * min(tested), 10.0 * max(max(tested), 1.0 / values["a"]), POINTS)

    def law(v: Mapping[str, Array | float]) -> Array:
        return np.asarray(v["mu_k0"] - v["delta_mu_k"] * np.expm1(-np.multiply.outer(v["a"], speed).T)).T

    with _on(axes) as on:
        on.axvspan(1e3 * min(tested), 1e3 * max(tested), color=SHADE, linewidth=0)
        _band(on, 1e3 * speed, law(values), law(drawn) if drawn else None)
        on.set_xscale("log")
        on.set(xlabel="sliding speed (mm/s)", ylabel="kinetic coefficient")
    return on


def ageing(fit: Fit, log: int, axes: Axes | None = None) -> Axes:
    """Static coefficient over the time at rest [s] by eqs. (3) and (5), with the 95 % band of the draws."""
    values, drawn = _drawn(fit, log, "contact_ageing")
    rest = np.geomspace(0.01 * values["t_cr"], 10.0 * values["t_cr"], POINTS)

    def law(v: Mapping[str, Array | float]) -> Array:
        aged = -np.expm1(-np.divide.outer(rest, v["t_cr"]))
        return np.asarray(v["mu_k0"] + (np.asarray(v["mu_s"]) - v["mu_k0"]) * aged).T

    with _on(axes) as on:
        _band(on, rest, law(values), law(drawn) if drawn else None)
        on.set_xscale("log")
        on.set(xlabel="time at rest (s)", ylabel="static coefficient")
    return on


def _band(axes: Axes, x: Array, y: Array, drawn: Array | None) -> None:
    if drawn is not None:
        axes.fill_between(x, *np.quantile(drawn, QUANTILES, axis=0), color=FITTED, alpha=0.25, linewidth=0)
    axes.plot(x, y, color=FITTED)


def _drawn(fit: Fit, log: int, effect: str) -> tuple[dict[str, float], dict[str, Array]]:
    """Parameters by name [SI] of a log's pair, and draws (n,) of each from their covariance; none without one."""
    scene = fit.scene(log)
    if effect not in scene.effects:
        raise FitError(
            f"this fit has no {effect}, whose law the figure shows; its effects are {', '.join(scene.effects)}"
        )
    values, pair = scene.values(), pair_of(fit.typed, scene, log - 1)
    if pair.covariance is None:
        return values, {}
    point = {**values, "normal_force": scene.rig.normal_force or 1.0, "drive_speed": 1.0}
    draws = Draws.of(scene.model, point, pair.names, pair.covariance)
    return values, {name: draws.column(name)[: draws.count] for name in scene.model.parameter_names}
