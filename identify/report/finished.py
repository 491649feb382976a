"""A finished fit in Python: its document, its tables as data frames, its pictures, and what it predicts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data_io.spelling import Spelled, spelled
from identify.base.document import to_document
from identify.base.errors import FitError
from identify.base.result import CYCLE_COLUMNS, LogCurves, Result, Status
from identify.base.wording import quantity as quantity_text
from identify.prediction.axes import Site
from identify.prediction.draws import Draws
from identify.prediction.predict import PointPrediction, predict
from identify.prediction.sources import Tested, pair_of, scenes_at, site_of
from identify.prediction.windows import QUANTILES
from identify.report.report_page import first_screen
from identify.report.report_tables import classical_table, parameter_table, summary
from identify.report.report_wording import plain_symbol
from identify.report.stored_result import read_curves, read_document, scene_of, write_report
from identify.report.style import FITTED, MEASURED, QUIET, RESIDUAL, SHADE, axes_of, drawing_style
from identify.scene import Scene
from identify.scene.tables import quantity
from identify.simulation.simulate import simulate
from identify.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
POINTS = 200  # of the curve of a law
LEGEND = 5  # entries at most
FOREST = 100.0  # per cent: longer intervals go on beyond the figure
HISTOGRAM = 5  # standard deviations; residuals beyond are counted at its ends
Quantity = float | str  # SI, or text with a unit


@dataclass(frozen=True, repr=False)
class Fit(Spelled):
    """A finished identification; in a notebook it shows its first screen, elsewhere its summary.

    result: the document of result.json (names, units and verdicts as the interface promises);
    logs: the curves, one per log, in the order of result["logs"]; empty where only the document was read.
    """

    result: Mapping[str, Any]
    logs: tuple[LogCurves, ...] = ()

    @staticmethod
    def from_json(path: str | Path) -> Fit:
        """The fit of a result.json; without curves, so without `cycles` and `plot`.

        Raises:
            FitError: no such file, or no result of a fit.
        """
        return Fit(read_document(Path(path)))

    @staticmethod
    def load(folder: str | Path) -> Fit:
        """The fit that a folder of `stickslip fit`, or of `save`, holds: result.json, and the curves of result.h5.

        Raises:
            FitError: no result of a fit there.
        """
        document, curves = Path(folder) / "result.json", Path(folder) / "result.h5"
        return Fit(read_document(document), read_curves(curves) if curves.exists() else ())

    @property
    def status(self) -> Status:
        """How the fit ended."""
        return Status(self.result["status"])

    @cached_property
    def typed(self) -> Result:
        """The document as values."""
        return Result.from_dict(to_document(self.result))

    @property
    def converged(self) -> bool:
        """Whether the fit passed its gate."""
        return self.status is Status.CONVERGED

    def __repr__(self) -> str:
        return summary(self.typed)

    def _repr_html_(self) -> str:
        return first_screen(self.typed)

    @property
    def parameters(self) -> pd.DataFrame:
        """One row per parameter, SI: value, standard_error, lower and upper end of the interval, unit, verdict, reason.

        The interval holds errors of rig and sensors; `lower_rig_exact` and `upper_rig_exact` are of noise alone.
        """
        import pandas as pd

        numbers = ["value", "standard_error", "lower", "upper", "lower_rig_exact", "upper_rig_exact"]
        rows = {}
        for name, e in self.typed.parameters.items():
            exact = e.interval_rig_exact or (None, None)
            rows[name] = (e.value, e.standard_error, *e.ends, *exact, e.unit, e.verdict, e.reason)
        frame = pd.DataFrame.from_dict(rows, orient="index", columns=[*numbers, "unit", "verdict", "reason"])
        return frame.astype(dict.fromkeys(numbers, float))

    @property
    def classical(self) -> pd.DataFrame:
        """The classical table of all logs, as classical.csv holds it: SI, units in the column names."""
        return classical_table(self.typed.logs).to_frame().infer_objects()

    @property
    def cycles(self) -> pd.DataFrame:
        """One row per cycle of every log: onset and arrest [s], the forces there [N], their difference [N], the time at
        rest before the onset [s] (NaN of the first one), misfit in standard deviations (NaN where nothing was fitted).
        """
        import pandas as pd

        frames = []
        for number in range(1, len(self.logs or self.typed.logs) + 1):
            frame = pd.DataFrame(self._curves(number).cycles, columns=list(CYCLE_COLUMNS))
            frame["drop_N"] = frame["onset_force_N"] - frame["arrest_force_N"]
            frame["hold_s"] = frame["onset_s"] - frame["arrest_s"].shift()
            frame.insert(0, "cycle", np.arange(1, len(frame) + 1))
            frame.insert(0, "log", number)
            frames.append(frame)
        return pd.concat(frames, ignore_index=True)

    @property
    def correlation(self) -> pd.DataFrame:
        """Correlation of the estimates (f, f), by name."""
        import pandas as pd

        known = self.typed.correlation
        if known is None:
            raise FitError(f"this fit has no correlation: {self.typed.message}")
        return pd.DataFrame(known.matrix, index=known.names, columns=known.names, dtype=float)

    @property
    def covariance(self) -> pd.DataFrame:
        """Covariance of the estimates (f, f) in products of their SI units, errors of rig and sensors included, by
        name; NaN of what is not identifiable."""
        errors = self.parameters["standard_error"][self.correlation.index]
        return self.correlation.mul(errors, axis=0).mul(errors, axis=1)

    @property
    def table(self) -> pd.DataFrame:
        """The parameters as the report shows them: value, intervals and unit of the lab, verdict, all text."""
        import pandas as pd

        shown = parameter_table(self.typed.parameters)
        names = [str(name.value) for name, *_ in shown.cells]
        return pd.DataFrame([[c.shown for c in row[1:]] for row in shown.cells], names, list(shown.columns[1:]))

    def to_latex(self) -> str:
        """That table as a longtable for \\input into a paper (packages booktabs and longtable)."""
        return parameter_table(self.typed.parameters).to_latex()

    def residuals(self, log: int = 1) -> Array:
        """Measured less fitted force (n,) of a log (from 1) [N]; NaN where nothing was fitted."""
        curves = self._curves(log)
        return np.asarray(np.where(curves.used, curves.friction_force - curves.fitted_force, np.nan))

    def plot(self, log: int = 1) -> Figure:
        """Measured and fitted force of a log (from 1) with residuals and normal force, as in the report.

        Raises:
            FitError: no such log, or a fit without curves.
        """
        curves = self._curves(log)
        from identify.report.figures import draw_force

        with drawing_style():
            figure = draw_force(curves, log, self.converged).figure
        assert figure is not None
        return figure

    def plot_forces(self, log: int = 1, axes: Axes | None = None) -> Axes:
        """Measured and fitted friction force [N] of a log (from 1) over time [s], on new axes or these."""
        curves = self._curves(log)
        with axes_of(axes) as on:
            on.plot(curves.time, curves.friction_force, color=MEASURED, linewidth=0.7, label="measured")
            on.plot(curves.time, curves.fitted_force, color=FITTED, linewidth=1.0, label="fitted")
            on.set(xlabel="time (s)", ylabel="friction force (N)")
            on.legend(loc="lower right", ncols=2, bbox_to_anchor=(1.0, 1.0))
        return on

    def plot_logs(self, axes: Axes | None = None) -> Axes:
        """Friction over normal force of all logs above the travel of the drive [mm], each as far as the shortest goes;
        one colour for each drive speed."""
        curves = [self._curves(number) for number in range(1, len(self.logs or self.typed.logs) + 1)]
        travels = [1e3 * abs(log.drive_speed) * (log.time - log.time[0]) for log in curves]
        speeds = sorted(
            {quantity_text(log.drive_speed, "m/s"): log.drive_speed for log in curves}.items(), key=itemgetter(1)
        )
        colours = {text: f"C{place}" for place, (text, _) in enumerate(speeds)}
        named = {speeds[int(place)][0] for place in np.linspace(0, len(speeds) - 1, min(len(speeds), LEGEND))}
        with axes_of(axes) as on:
            for log, travel in zip(curves, travels, strict=True):
                shown, text = (
                    travel <= min(float(other[-1]) for other in travels),
                    quantity_text(log.drive_speed, "m/s"),
                )
                label = text if text in named else ""
                named.discard(text)
                share = (log.friction_force / log.normal_force)[shown]
                on.plot(travel[shown], share, color=colours[text], linewidth=0.7, label=label)
            on.set(xlabel="drive travel (mm)", ylabel="friction / normal force")
            on.legend(loc="lower right", ncols=LEGEND, bbox_to_anchor=(1.0, 1.0))
        return on

    def plot_residuals(self, log: int = 1, axes: Axes | None = None) -> Axes:
        """Residuals of a log (from 1) in standard deviations of its noise, over time [s]."""
        curves = self._curves(log)
        with axes_of(axes) as on:
            on.plot(curves.time, self.residuals(log) / curves.noise, ".", markersize=1.5, color=RESIDUAL)
            on.axhline(0.0, color=QUIET, linewidth=0.7)
            on.set(xlabel="time (s)", ylabel="residual (noise sd)")
        return on

    def plot_residual_histogram(self, axes: Axes | None = None) -> Axes:
        """Residuals of all logs in standard deviations of their noise as a density, beside the normal one."""
        parts = [self.residuals(number) / curves.noise for number, curves in enumerate(self.logs, 1)]
        values = np.concatenate([np.empty(0), *(part[np.isfinite(part)] for part in parts)])
        if not values.size:
            raise FitError("this fit has no residuals: no curve was fitted, or only its document is here")
        x = np.linspace(-HISTOGRAM, HISTOGRAM, POINTS)
        with axes_of(axes) as on:
            on.hist(np.clip(values, -HISTOGRAM, HISTOGRAM), bins=8 * HISTOGRAM, density=True, color=RESIDUAL)
            on.plot(x, np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi), color=FITTED, label="normal")
            on.set(xlabel="residual (noise sd)", ylabel="density (1)")
            on.legend(loc="upper right")
        return on

    def plot_parameters(self, axes: Axes | None = None) -> Axes:
        """Forest plot: all 95 % intervals as deviations from the values [%], those of noise alone thick; an arrow where
        one goes on or is open."""
        frame = self.parameters
        known = frame[frame["value"].notna() & (frame["value"] != 0.0) & frame[["lower", "upper"]].notna().any(axis=1)]
        if known.empty:
            raise FitError("no parameter of this fit has an interval; plot_forces shows what was fitted")
        ends = known[["lower", "upper", "lower_rig_exact", "upper_rig_exact"]].fillna(
            {"lower": -np.inf, "upper": np.inf}
        )
        off, rows = 100.0 * (ends.div(known["value"], axis=0).to_numpy() - 1.0), np.arange(len(known))
        reach = min(FOREST, 1.1 * float(np.max(np.abs(off[np.isfinite(off)]))))
        shown = off.clip(-reach, reach)
        with axes_of(axes) as on:
            on.hlines(rows, shown[:, 0], shown[:, 1], color=QUIET, linewidth=1.0)
            on.hlines(rows, shown[:, 2], shown[:, 3], color=FITTED, linewidth=3.0)
            for row, column in zip(*np.nonzero(np.abs(off[:, :2]) > reach), strict=True):
                on.plot(shown[row, column], row, "<" if off[row, column] < 0.0 else ">", color=QUIET, clip_on=False)
            on.plot(np.zeros(len(rows)), rows, "o", color=MEASURED, markersize=3.0)
            on.set_yticks(rows, [plain_symbol(name) for name in known.index])
            on.set(xlim=(-reach, reach), ylim=(len(rows) - 0.5, -0.5), xlabel="deviation from the value (%)", ylabel="")
        return on

    def plot_correlation(self, axes: Axes | None = None) -> Axes:
        """Correlation matrix of the estimates with the numbers in its cells, as in the report."""
        matrix = self.correlation
        from identify.report.figures import correlation_cells

        with axes_of(axes) as on:
            correlation_cells(on, [plain_symbol(name) for name in matrix.index], matrix.to_numpy())
        return on

    def plot_profile(self, parameter: str, axes: Axes | None = None) -> Axes:
        """Profile likelihood of a parameter as in the report, where the fit was asked for it or ran it."""
        profile = self.typed.profile
        if profile is None or parameter not in profile.parameters:
            known = ", ".join(profile.parameters) if profile is not None else "none"
            raise FitError(
                f"no profile of {parameter} is here (there is: {known}); fit with --profile, or "
                "options=FitOptions(profile=True)"
            )
        from identify.report.figures import profile_curve

        with axes_of(axes) as on:
            entry = self.typed.parameters[parameter]
            unit = profile_curve(on, profile.parameters[parameter], entry, profile.limit)
            on.set(xlabel=f"{plain_symbol(parameter)}{unit}", ylabel="loss (χ²)")
        return on

    def plot_map(self, x: str = "drive_speed", y: str = "stiffness", log: int = 1, points: int = 40) -> Axes:
        """Where the pair sticks and slips or slides steadily over two quantities, about the operating point of a log
        (from 1), as `stickslip stability --map` draws it; points: along each quantity."""
        from identify.prediction.maps import stability_map
        from identify.report.draw_map import map_figure

        with drawing_style():
            chart = stability_map(self.scene(log), x, y, points=points)
            return map_figure(chart, "stability", (), Tested.of_result(self.typed)).axes[0]

    def plot_friction(self, log: int = 1, axes: Axes | None = None) -> Axes:
        """Kinetic coefficient over sliding speed [mm/s] by eq. (6) with the 95 % band of the draws; shaded: the drive
        speeds of the logs."""
        tested = [speed for speed in (entry.drive_speed_m_per_s for entry in self.typed.logs) if speed]

        def speeds(v: Mapping[str, float]) -> Array:
            return 1e3 * np.geomspace(0.3 * min(tested), 10.0 * max(max(tested), 1.0 / v["a"]), POINTS)

        def law(v: Mapping[str, Array], speed: Array) -> Array:
            return v["mu_k0"] - v["delta_mu_k"] * np.expm1(-1e-3 * v["a"] * speed)

        on = self._law(log, "velocity_weakening", speeds, law, axes)
        on.axvspan(1e3 * min(tested), 1e3 * max(tested), color=SHADE, linewidth=0, zorder=0)
        on.set(xlabel="sliding speed (mm/s)", ylabel="kinetic coefficient")
        return on

    def plot_ageing(self, log: int = 1, axes: Axes | None = None) -> Axes:
        """Static coefficient over the time at rest [s] by eqs. (3) and (5) with the 95 % band of the draws."""

        def rests(v: Mapping[str, float]) -> Array:
            return np.geomspace(0.01 * v["t_cr"], 10.0 * v["t_cr"], POINTS)

        def law(v: Mapping[str, Array], rest: Array) -> Array:
            return v["mu_k0"] - (v["mu_s"] - v["mu_k0"]) * np.expm1(-rest / v["t_cr"])

        on = self._law(log, "contact_ageing", rests, law, axes)
        on.set(xlabel="time at rest (s)", ylabel="static coefficient")
        return on

    def _law(
        self,
        log: int,
        effect: str,
        over: Callable[[Mapping[str, float]], Array],
        law: Callable[[Mapping[str, Array], Array], Array],
        axes: Axes | None,
    ) -> Axes:
        """A law of a log's pair over `over` of its values, with the 95 % band of draws of the parameters (n, 1)."""
        site = self._site(log)
        if effect not in site.model.effects:
            have = ", ".join(site.model.effects)
            raise FitError(f"this fit has no {effect}, whose law the figure shows; its effects are {have}")
        x, draws = over(site.values), Draws.of(site)
        with axes_of(axes) as on:
            if draws.count:
                columns = {n: draws.column(n)[1 : 1 + draws.count, None] for n in site.model.parameter_names}
                band = np.quantile(law(columns, x), QUANTILES, axis=0)
                on.fill_between(x, *band, color=FITTED, alpha=0.25, linewidth=0)
            on.plot(x, law({name: np.asarray(value) for name, value in site.values.items()}, x), color=FITTED)
            on.set_xscale("log")
            on.xaxis.set_major_formatter("{x:g}")  # the style of the report takes no formulas
        return on

    @spelled
    def predict(
        self, *, drive_speed: Quantity | None = None, normal_force: Quantity | None = None, log: int = 1
    ) -> PointPrediction:
        """What this pair does at another drive speed or normal force on the rig of a log: stability and amplitude.

        Args:
            drive_speed: [m/s]; normal_force: [N]; numbers or text with a unit; None: those of the log.
            log: whose rig and group, from 1.

        Raises:
            FitError: the fit has no values. SimulationError: no answer there.
        """
        site = self._site(log)
        speed = site.drive_speed if drive_speed is None else quantity(drive_speed, "m/s", "drive_speed")
        load = site.normal_force if normal_force is None else quantity(normal_force, "N", "normal_force")
        return predict(replace(site, drive_speed=speed, normal_force=load))

    def _site(self, log: int) -> Site:
        """The operating point of a log, with how well its pair is known; errors as `scene`."""
        site, pair = site_of(self.scene(log)), pair_of(self.typed, log - 1)
        return replace(site, covariance=pair.covariance, names=pair.names)

    @spelled
    def simulate(
        self,
        duration: Quantity,
        *,
        drive_speed: Quantity | None = None,
        normal_force: Quantity | None = None,
        log: int = 1,
    ) -> Trajectory:
        """The fitted model run forward for `duration` [s] from rest; arguments and errors as `predict`."""
        return simulate(self.scene(log), duration, drive=drive_speed, normal_force=normal_force)

    def scene(self, log: int = 1) -> Scene:
        """The scene with the estimates as values, and the rig, drive speed and mean load of a log (from 1).

        Raises:
            FitError: no such log, no values to use, or no log of that log's group took part.
        """
        self._check_log(log)
        result = self.typed
        if not self.converged:
            raise FitError(f"this fit has no values ({result.status}): {result.message}")
        scene = scene_of(result, "the result")
        if scene.effects == "auto":
            scene = scene.with_effects(result.effects.names)
        pair = pair_of(result, log - 1)
        missing = [name for name, entry in result.parameters.items() if entry.value is None]
        if pair.refusal or (missing and not pair.values):
            raise FitError(
                pair.refusal or f"this fit has no value of {', '.join(missing)}; fix it in the scene and fit again"
            )
        document, entry = result.logs[log - 1], scene.logs[result.numbers[log - 1]]
        speed = document.drive_speed_m_per_s
        given = pair.values if speed is None else {**pair.values, "drive_speed": speed}
        return scenes_at(scene, entry, document, given)[0]

    def save(self, folder: str | Path) -> Path:
        """Write report.html, result.json, classical.csv, result.h5 and figures/ into a folder, made where needed.

        Returns:
            the path of report.html.
        """
        return write_report(self, Path(folder))[-1]

    def save_figures(self, folder: str | Path) -> list[Path]:
        """Write every figure of the fit into a folder, made where needed: SVG, PDF and PNG (300 dpi) as wide as one and
        as two columns of a paper, and captions.txt.

        Returns:
            the paths of the files.
        """
        from identify.report.figures import write_figures

        return write_figures(self, Path(folder))

    def _curves(self, log: int) -> LogCurves:
        if not self.logs:
            raise FitError(
                "only the document of this fit is here, without curves; they stand in result.h5, or fit again"
            )
        self._check_log(log)
        return self.logs[log - 1]

    def _check_log(self, log: int) -> None:
        count = len(self.typed.logs)
        if not 1 <= log <= count:
            raise FitError(f"log {log} was asked for; this fit has {count}, counted from 1: choose one of them")
