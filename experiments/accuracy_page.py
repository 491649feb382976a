"""The page docs/accuracy.md and its work-precision diagrams, from what run_work_precision.py has measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.workprec import Point, Scene

DOCS = Path(__file__).resolve().parents[1] / "docs"
# Okabe and Ito: told apart by every kind of colour vision; markers tell them apart in grey.
STYLES = {
    "bogacki_shampine": ("#E69F00", "o"),
    "dormand_prince": ("#56B4E9", "s"),
    "dop853": ("#0072B2", "D"),
    "radau": ("#009E73", "^"),
    "closed_form": ("#000000", "*"),
    "cvodes": ("#999999", "v"),
    "events, DOP853": ("#D55E00", "P"),
    "tanh, LSODA": ("#CC79A7", "X"),
    "tanh, Radau": ("#CC79A7", "<"),
}
FLOOR = 1e-14  # errors below are rounding


def page(
    where: str,
    orders: Sequence[Any],
    works: Mapping[Scene, tuple[list[Point], float]],
    asked: Sequence[tuple[str, float, float, float, str]],
    costs: Sequence[tuple[str, float]],
    grids: Sequence[str],
) -> str:
    """The page in markdown."""
    parts = [
        "# What accuracy costs in time",
        "",
        "Printed by `python experiments/run_work_precision.py --docs`. Processor times on one core, warm, medians;",
        "errors of switch times are relative to the mean cycle.",
        "",
        where,
        "",
        "## Orders",
        "",
        "Equal steps without error control on a slip of the full velocity weakening; slope of the error of the first",
        "arrest and the second onset over the step length. Without location of the switch the order is lost.",
        "",
        "| method | stated order | measured, switches located | measured, not located |",
        "| --- | --- | --- | --- |",
        *(f"| {o.method.name} | {o.method.order} | {o.located:.2f} | {o.not_located:.2f} |" for o in orders),
        "",
        "## What `accuracy` delivers",
        "",
        "Largest relative error of switch times: asked for, estimated from a second run, found against the reference.",
        "",
        "| scene | asked for | estimated | found | methods |",
        "| --- | --- | --- | --- | --- |",
        *(f"| {s} | {a:.0e} | {e:.1e} | {f:.1e} | {m} |" for s, a, e, f, m in asked),
        "",
        "## Simulation",
        "",
        "Times are ratios to the fastest entry of each table. `events` is `scipy.integrate.solve_ivp` with events,",
        "sticks in closed form; `tanh` smooths the sign of friction over a width of sliding speed and integrates",
        "through sticks and slips (rtol 1e-7): its error is that of when slips pass a sliding speed, and no",
        "tolerance makes it smaller than the width allows.",
    ]
    for scene, (points, known) in works.items():
        parts += ["", f"### {scene.name}: {scene.says}", "", f"![{scene.name}](accuracy_{scene.name}.png)", ""]
        parts += [f"Reference: two methods, {known:.0e} of a cycle apart.", "", *simulation_table(points)]
    parts += [
        "",
        "## What each effect costs",
        "",
        "Time per slip of the test problem with the effect, over that without.",
        "",
    ]
    parts += ["| effect | time |", "| --- | --- |", *(f"| {name} | {share:.2f} |" for name, share in costs)]
    parts += ["", "## Fit", ""]
    parts += [
        "The test problem fitted on ever finer grids (8 + 8 intervals per slip, fourth-order steps): how far each",
        "parameter is from the finest grid's, in its standard errors.",
        "",
        *grids,
        "",
    ]
    return "\n".join(parts)


def simulation_table(points: Sequence[Point]) -> list[str]:
    """Markdown rows: program, setting, error, time as a ratio to the fastest, its spread."""
    fastest = float(np.nanmin([point.seconds for point in points]))
    rows = ["| program | tolerance | error | time (fastest = 1) | spread |", "| --- | --- | --- | --- | --- |"]
    for q in points:
        if np.isnan(q.error):
            rows.append(f"| {q.program} | {q.setting} | gave up | | |")
            continue
        error = f"{q.error:.1e}" if np.isfinite(q.error) else "other slips"
        spread = f"{1e3 * q.lowest:.2f} to {1e3 * q.highest:.2f} ms"
        rows.append(f"| {q.program} | {q.setting} | {error} | {q.seconds / fastest:.2f} | {spread} |")
    return rows


def write(text: str, works: Mapping[Scene, tuple[list[Point], float]]) -> None:
    """Write the page and one diagram per scene."""
    DOCS.joinpath("accuracy.md").write_text(text, encoding="utf-8")
    for scene, (points, _) in works.items():
        draw(scene, points, DOCS / f"accuracy_{scene.name}.png")


def draw(scene: Scene, points: Sequence[Point], path: Path) -> None:
    """Time over error, both logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7.0, 4.4), dpi=150, layout="constrained")
    for program, (colour, marker) in STYLES.items():
        mine = [q for q in points if q.program == program and np.isfinite(q.error)]
        if mine:
            errors, seconds = [max(q.error, FLOOR) for q in mine], [1e3 * q.seconds for q in mine]
            line = "--" if "," in program else "-"
            axes.plot(errors, seconds, line, color=colour, marker=marker, markersize=6, label=program, linewidth=1.4)
    axes.set(xscale="log", yscale="log", xlabel="error of switch times, of a cycle", ylabel="processor time [ms]")
    axes.invert_xaxis()
    axes.set_title(f"{scene.name}: {scene.says}", fontsize=10)
    axes.grid(visible=True, which="major", color="#dddddd", linewidth=0.6)
    axes.legend(fontsize=8, frameon=False)
    figure.savefig(path)
    pyplot.close(figure)
