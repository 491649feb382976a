"""The figures 2 to 6 of the paper, printed and derived forms side by side, at journal width."""

from __future__ import annotations

import numpy as np
import paper_printed as printed
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from paper_test import MASSES, STAND_IN, STATED, Known, arguments, box, region

from identify import amplitude, stability
from identify.model.model import assemble
from identify.prediction.batch import settle
from identify.prediction.groups import groups
from identify.prediction.orbit import CycleMap, loads
from identify.simulation.trajectory import moments

Array = NDArray[np.float64]

MM = 1 / 25.4  # inch
WIDTH, HEIGHT = 174 * MM, 78 * MM  # two columns of a journal
# Okabe and Ito's colours, told apart by dashes as well.
BLACK, BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY = (
    "#000000",
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
)
LINES = ((BLUE, "-"), (VERMILLION, "--"), (GREEN, "-."), (PURPLE, ":"), (BLACK, (0, (5, 1, 1, 1, 1, 1))), (ORANGE, "-"))
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 7.5,
    "axes.titlesize": 8,
    "axes.titlelocation": "left",
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 6.6,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "lines.linewidth": 1.2,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
EFFECTS = ("inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening")
LINEAR = {"a": 1.0, "delta_mu_k": 0.0}  # without weakening: alpha = zeta, where the closed forms hold at any speed


def panels() -> tuple[Figure, Axes, Axes]:
    """A figure with the printed form left and the derived one right."""
    figure = Figure(figsize=(WIDTH, HEIGHT), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.set_title("(a) as printed")
    right.set_title("(b) derived")
    return figure, left, right


def force_over_time() -> Figure:
    """Fig. 2: force against time at the stated test, and below it one slip drawn out."""
    figure = Figure(figsize=(WIDTH, 1.45 * HEIGHT), layout="constrained")
    grid = figure.subplots(2, 2)
    for column, curves in enumerate((_closed_force, _full_force)):
        whole, one = grid[0, column], grid[1, column]
        for (color, dash), mass in zip(LINES, MASSES, strict=False):
            slow, slip = curves(mass)
            whole.plot(*slow, color=color, ls=dash, lw=1.0, label=f"m = {1e3 * mass:g} g")
            one.plot(*slip, color=color, ls=dash)
        whole.set_xlim(0, 900)
        whole.set_xlabel("time [s]")
        one.set_xlabel("time from the onset of a slip [ms]")
        one.set_xlim(0, 200)
        for axes in (whole, one):
            axes.set_ylim(0, 0.75)
            axes.set_ylabel("friction force [N]")
    grid[0, 0].set_title("(a) as printed: eqs. (11)–(14), μk constant")
    grid[0, 1].set_title("(b) derived: full law, μk falls with speed")
    grid[1, 0].legend(
        *grid[0, 0].get_legend_handles_labels(), loc="center right", title="mass: not stated", title_fontsize=6.6
    )
    return figure


def _sawtooth(first: float, top: float, bottom: float, period: float) -> tuple[Array, Array]:
    """Time [s] and force [N] of sticks, slips being instants on this scale."""
    times, forces = [0.0, first], [0.0, top]
    while times[-1] < 900:
        times += [times[-1], times[-1] + period]
        forces += [bottom, top]
    return np.array(times), np.array(forces)


def _closed_force(mass: float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """The sawtooth of the printed closed forms (no damper in xi_p, contact saturated), and its slip in ms and N."""
    values = STAND_IN | LINEAR | {"mass": mass}
    g = groups(*arguments(values))
    A = g.loading  # printed (12): xi_p = mu_s w
    unit = values["drive_speed"] / g.omega_n * values["stiffness"]
    duration, end = amplitude.slip_end(g.alpha, A)
    top, drop = values["mu_s"] * values["normal_force"], (A - end) * unit
    pace = values["stiffness"] * values["drive_speed"]
    tau = np.linspace(0, 1.25 * duration, 300)
    along = np.minimum(tau, duration)
    force = (printed.elongation(np.asarray(g.alpha), np.asarray(A), along) + g.xi_o) * unit
    slow = _sawtooth(top / pace, top, top - drop, drop / pace)
    return slow, (1e3 * tau / g.omega_n, force)


def _full_force(mass: float) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """The same of the composed nonlinear model."""
    values = STAND_IN | {"mass": mass}
    model = assemble(EFFECTS)
    map_ = CycleMap(model, values["normal_force"], np.array([values[n] for n in model.parameter_names]))
    orbit = settle(map_, values["drive_speed"]).orbit
    assert orbit is not None, "the stand-in sticks and slips at the stated test"
    cycle = orbit.cycle
    top, bottom = loads(map_, cycle)
    pace = values["stiffness"] * values["drive_speed"]
    slow = _sawtooth(top / pace, top, bottom, cycle.stick)
    times = np.linspace(0.0, cycle.slip, 200)
    force = moments(model, cycle.slides, times)["force"]
    return slow, (1e3 * np.append(times, 1.25 * cycle.slip), np.append(force, force[-1]))


def phase_plane() -> Figure:
    """Fig. 3: phase plane of the slip without damping."""
    figure, left, right = panels()
    for (color, dash), mass in zip(LINES, MASSES, strict=False):
        g = groups(*arguments(STAND_IN | LINEAR | {"mass": mass}))
        length, speed = 1e6 * STATED["drive_speed"] / g.omega_n, 1e3 * STATED["drive_speed"]
        step = STAND_IN["mu_s"] - STAND_IN["mu_k0"]
        x, v = printed.slip_10(step, g.w, g.tau_cr)
        left.plot(length * x, speed * v, color=color, ls=dash, label=f"m = {1e3 * mass:g} g")
        x, v = printed.undamped(g.loading)
        right.plot(length * x, speed * v, color=color, ls=dash)
        left.plot(length * x, speed * v, color="0.6", lw=0.6, zorder=0)
    for axes in (left, right):
        axes.set_xlabel("distance slid [µm]")
        axes.set_ylabel("sliding speed [mm/s]")
        axes.set_xlim(0, 300)
        axes.set_ylim(0, 28)
    left.set_title("(a) as printed: eqs. (8)–(10), M = 1 + Δμs w/τcr")
    right.set_title("(b) derived: eq. (11), M = 1")
    left.plot([], [], color="0.6", lw=0.6, label="as in (b)")
    left.legend(loc="upper left", title="mass: not stated", title_fontsize=6.6, ncols=2)
    right.text(150, 3, "Δμs = 0.19 (not stated):\nboth axes scale with it", ha="center", fontsize=6.6)
    return figure


AMPLITUDES = (-0.5, 0.0, 0.3, 0.7, 1.5)


def amplitudes(known: Known) -> Figure:
    """Fig. 4: amplitude against overshoot."""
    figure, left, right = panels()
    A = np.concatenate([-np.geomspace(10, 1e-3, 600), [0.0], np.geomspace(1e-3, 1e5, 900)])
    for (color, dash), alpha in zip(LINES, AMPLITUDES, strict=False):
        a = np.full(A.shape, alpha)
        left.plot(A, printed.maximum(a, A)[1], color=color, ls=dash)
        right.plot(A, amplitude.slip_maximum(a, A)[1], color=color, ls=dash, label=f"α = {alpha:g}")
    centre, edge, _ = region(known, "overshoot", "alpha")
    height = amplitude.slip_maximum(centre[1], centre[0])[1]
    ends = amplitude.slip_maximum(edge[1], edge[0])[1]
    low, high = box()["loading"]
    for axes in (left, right):
        axes.set_xscale("symlog", linthresh=1, linscale=0.8)
        axes.set_yscale("log")
        axes.set_xlim(-10, 1e5)
        axes.set_ylim(1e-2, 1e5)
        axes.set_xticks([-10, -1, 0, 1, 10, 100, 1e3, 1e4, 1e5])
        axes.axvspan(low, high, color=SKY, alpha=0.25, lw=0)
        axes.set_xlabel("overshoot A = ξp − ξo [v0/ωn]")
        axes.set_ylabel("amplitude ξmax − ξo [v0/ωn]")
        axes.text(np.sqrt(low * high), 0.016, "paper's test,\nm and Δμs\nnot stated", ha="center", fontsize=6.3)
    for axes in (left, right):
        axes.plot(*centre[:1], height, "k*", ms=7, label=f"fitted stand-in (α = {centre[1]:.2f})", zorder=5)
    left.plot([], [], " ", label="no value for |α| ≥ 1; below\nA = −α the extremum before\nthe slip began (negative)")
    left.legend(loc="upper left")
    right.legend(loc="upper left")
    zoom = right.inset_axes((0.46, 0.1, 0.2, 0.22))
    zoom.plot(edge[0], ends, color="k", lw=0.8)
    zoom.plot(*centre[:1], height, "k*", ms=4)
    zoom.set_title("95 %", fontsize=6, pad=1)
    zoom.ticklabel_format(useOffset=False)
    zoom.tick_params(labelsize=5, pad=1)
    zoom.locator_params(nbins=2)
    return figure


def critical_loadings(known: Known) -> Figure:
    """Fig. 5: loading parameter against alpha."""
    figure, left, right = panels()
    alpha = np.concatenate([np.geomspace(1e-4, 0.02, 60), np.linspace(0.02, 0.97, 120)])
    for n, (color, dash) in zip((1, 2), LINES, strict=False):
        left.plot(
            alpha, printed.loading_as_printed(alpha, n), color=color, ls=dash, label=f"(17) as printed, ξv = 1, n = {n}"
        )
    right.plot(alpha, stability.critical_loading(alpha), color=BLUE, label="Φcr(α)")
    left.plot(alpha, stability.critical_loading(alpha), color="0.6", lw=0.7, label="Φcr(α) as in (b)")
    right.plot(alpha, np.sqrt(4 * np.pi * alpha), color=VERMILLION, ls="--", lw=1, label="√(4πα), classical")
    right.axvspan(0.97, 1.3, color="0.85", lw=0)
    right.text(1.13, 3, "never sticks\nagain", ha="center", fontsize=6.5, rotation=90, va="center")
    centre, edge, _ = region(known, "alpha", "loading")
    ranges = box()
    for axes in (left, right):
        axes.set_yscale("log")
        axes.set_xlim(-2.4, 1.3)
        axes.set_ylim(1e-2, 1e6)
        axes.set_xlabel("effective damping ratio α [1]")
        axes.set_ylabel("loading parameter Φ [1]")
        (a, b), (c, d) = ranges["alpha"], ranges["loading"]
        axes.add_patch(Rectangle((a, c), b - a, d - c, color=SKY, alpha=0.3, lw=0))
        axes.text(-2.28, 1.3 * c, "paper's test: m, h, Δμs, Δμk a not stated", fontsize=6.3)
        axes.axvspan(-2.4, -1, facecolor="none", hatch="///", edgecolor="0.88", lw=0, zorder=0)
        axes.text(-1.7, 0.05, "α ≤ −1: linear law\nruns away", ha="center", fontsize=6.5)
        axes.plot(*centre, "k*", ms=7, label="fitted stand-in", zorder=5)
    right.text(-0.48, 0.05, "−1 < α ≤ 0:\nalways sticks\nagain", ha="center", fontsize=6.5)
    zoom = right.inset_axes((0.13, 0.33, 0.2, 0.2))
    _zoom(zoom, centre, edge)
    left.legend(
        loc="center left",
        bbox_to_anchor=(0.0, 0.45),
        frameon=True,
        edgecolor="none",
        title="(18), ξv(τoc) = 0, has no root",
        title_fontsize=6.6,
    )
    right.legend(loc="upper left", bbox_to_anchor=(0.36, 1.02))
    return figure


def critical_frictions(known: Known) -> Figure:
    """Fig. 6: critical friction parameter against damping ratio."""
    figure, left, right = panels()
    zeta = np.geomspace(1e-3, 10, 300)
    times = [STATED["t_cr"] * np.sqrt(STATED["stiffness"] / m) for m in MASSES]
    for axes, form in ((left, "printed"), (right, "derived")):
        limits = [stability.critical_friction(zeta, T, form) for T in times]  # type: ignore[arg-type]
        axes.fill_between(zeta, np.min(limits, axis=0), np.max(limits, axis=0), color=BLUE, alpha=0.18, lw=0)
        for (color, dash), limit, T, mass in zip(LINES, limits, times, MASSES, strict=False):
            axes.plot(zeta, limit, color=color, ls=dash, label=f"τcr = {T:.3g} (m = {1e3 * mass:g} g)")
        ranges = box()
        (a, b), (c, d) = ranges["zeta"], ranges["Pi"]
        axes.add_patch(Rectangle((a, c), b - a, d - c, color=SKY, alpha=0.35, lw=0))
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlim(1e-3, 10)
        axes.set_ylim(0.1, 2e3)
        axes.set_xlabel("damping ratio ζ = h/2k [1]")
        axes.set_ylabel("critical friction parameter Πfc [1]")
        axes.text(1.5e-3, 900, "unstable", fontsize=7)
        axes.text(2.5, 0.2, "stable", fontsize=7)
        axes.text(0.0115, 1.15 * d, "paper's test", fontsize=6.3)
    for (color, _), T in zip(LINES, times, strict=False):
        left.plot(zeta, stability.critical_friction(zeta, T), color=color, lw=0.5, alpha=0.6)
    left.plot([], [], color="0.4", lw=0.5, label="derived, as in (b)")
    centre, edge, _ = region(known, "zeta", "Pi")
    for axes in (left, right):
        axes.plot(*centre, "k*", ms=7, label="fitted stand-in", zorder=5)
    zoom = right.inset_axes((0.74, 0.74, 0.24, 0.2))
    _zoom(zoom, centre, edge)
    left.legend(loc="lower right", bbox_to_anchor=(1.0, 0.08))
    right.legend(loc="lower right", bbox_to_anchor=(1.0, 0.08))
    return figure


def _zoom(axes: Axes, centre: Array, edge: Array) -> None:
    """The confidence region, which is smaller than its mark."""
    axes.plot(edge[0], edge[1], color="k", lw=0.8)
    axes.plot(*centre, "k*", ms=4)
    axes.set_title("95 % region", fontsize=6, pad=1)
    axes.ticklabel_format(useOffset=False)
    axes.tick_params(labelsize=5.5, pad=1)
    axes.locator_params(axis="y", nbins=2)
    axes.xaxis.set_major_locator(MaxNLocator(1))
