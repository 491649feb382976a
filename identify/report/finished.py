"""A finished fit in Python: its document, its tables as data frames, its pictures, and what it predicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from identify.base.document import Json, to_dict
from identify.base.errors import FitError
from identify.base.outcome import LogCurves, Status
from identify.base.result import Result
from identify.base.wording import wrapped
from identify.model.model import RIG_PARAMETERS
from identify.prediction.predict import PointPrediction, predict
from identify.prediction.sources import pair_of
from identify.report.report_page import first_screen
from identify.report.report_tables import classical_table
from identify.report.stored_result import plain, read_document, scene_of
from identify.report.summary import summary
from identify.scene import Scene
from identify.scene.parameters import default_spec
from identify.scene.tables import quantity
from identify.simulation.simulate import simulate
from identify.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CYCLE_COLUMNS = ("onset_s", "arrest_s", "onset_force_N", "arrest_force_N", "misfit_z")
Quantity = float | str  # SI, or text with a unit


@dataclass(frozen=True, repr=False)
class Fit:
    """A finished identification; in a notebook it shows its first screen, elsewhere its summary.

    result: the document of result.json (names, units and verdicts as the interface promises);
    logs: the curves, one per log, in the order of result["logs"]; empty where only the document was read.
    """

    result: Mapping[str, Any]
    logs: tuple[LogCurves, ...] = ()

    @staticmethod
    def from_json(path: str | Path) -> Fit:
        """The fit that a result.json tells of; without curves, so without `cycles` and `plot`.

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
        from identify.report.hdf5 import read_curves

        document, curves = Path(folder) / "result.json", Path(folder) / "result.h5"
        return Fit(read_document(document), read_curves(curves) if curves.exists() else ())

    @property
    def status(self) -> Status:
        """How the fit ended."""
        return Status(self.result["status"])

    @cached_property
    def typed(self) -> Result:
        """The document as values."""
        return Result.from_dict(plain(self.result))

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

        rows = {}
        for name, entry in self.typed.parameters.items():
            least, most = entry.interval_rig_exact or (None, None)
            rows[name] = {
                "value": entry.value,
                "standard_error": entry.standard_error,
                "lower": entry.ends[0],
                "upper": entry.ends[1],
                "lower_rig_exact": least,
                "upper_rig_exact": most,
                "unit": entry.unit,
                "verdict": entry.verdict,
                "reason": entry.reason,
            }
        frame = pd.DataFrame.from_dict(rows, orient="index")
        numbers = [column for column in frame.columns if column not in ("unit", "verdict", "reason")]
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

        self._check_curves()
        frames = []
        for number, curves in enumerate(self.logs, 1):
            frame = pd.DataFrame(curves.cycles, columns=list(CYCLE_COLUMNS))
            frame["drop_N"] = frame["onset_force_N"] - frame["arrest_force_N"]
            frame["hold_s"] = frame["onset_s"] - frame["arrest_s"].shift()
            frame.insert(0, "cycle", np.arange(1, len(frame) + 1))
            frame.insert(0, "log", number)
            frames.append(frame)
        return pd.concat(frames, ignore_index=True)

    def plot(self, log: int = 1) -> Figure:
        """Measured and fitted force of a log (from 1) with residuals and normal force, as in the report.

        Raises:
            FitError: no such log, or a fit without curves.
        """
        self._check_curves()
        self._check_log(log)
        from identify.report.figures import draw_force
        from identify.report.style import drawing_style

        with drawing_style():
            figure: Figure = draw_force(self.logs[log - 1], log, self.converged).figure
        return figure

    @property
    def correlation(self) -> pd.DataFrame:
        """Correlation of the estimates (f, f), by name."""
        import pandas as pd

        known = self.typed.correlation
        if known is None:
            raise FitError(f"this fit has no correlation: {self.typed.message}")
        return pd.DataFrame(known.matrix, index=known.names, columns=known.names, dtype=float)

    def residuals(self, log: int = 1) -> NDArray[np.float64]:
        """Measured less fitted force (n,) of a log (from 1) [N]; NaN where nothing was fitted."""
        self._check_curves()
        self._check_log(log)
        curves = self.logs[log - 1]
        return np.asarray(np.where(curves.used, curves.friction_force - curves.fitted_force, np.nan))

    def plot_forces(self, log: int = 1, axes: Axes | None = None) -> Axes:
        """Measured and fitted force of a log (from 1) over time, on new axes or these."""
        self._check_curves()
        self._check_log(log)
        return paper_figures().forces(self, log, axes)

    def plot_residuals(self, log: int = 1, axes: Axes | None = None) -> Axes:
        """Residuals of a log (from 1) in standard deviations of its noise."""
        return paper_figures().residuals(self, log, axes)

    def plot_parameters(self, axes: Axes | None = None) -> Axes:
        """Forest plot of all 95 % intervals, as deviations from the values in per cent."""
        return paper_figures().parameters(self, axes)

    def plot_correlation(self, axes: Axes | None = None) -> Axes:
        """Correlation matrix of the estimates."""
        return paper_figures().correlation(self, axes)

    def plot_profile(self, parameter: str, axes: Axes | None = None) -> Axes:
        """Profile likelihood of a parameter, where the fit was asked for it or ran it."""
        return paper_figures().profile(self, parameter, axes)

    def plot_friction(self, log: int = 1, axes: Axes | None = None) -> Axes:
        """Kinetic coefficient over sliding speed with its 95 % band; shaded: the drive speeds of the logs."""
        self._check_log(log)
        return paper_figures().friction(self, log, axes)

    def plot_ageing(self, log: int = 1, axes: Axes | None = None) -> Axes:
        """Static coefficient over the time at rest with its 95 % band."""
        self._check_log(log)
        return paper_figures().ageing(self, log, axes)

    def predict(
        self, *, drive_speed: Quantity | None = None, normal_force: Quantity | None = None, log: int = 1
    ) -> Prediction:
        """What this pair does at another drive speed or normal force on the rig of a log: stability and amplitude.

        Args:
            drive_speed: [m/s]; normal_force: [N]; numbers or text with a unit; None: those of the log.
            log: whose rig and group, from 1.

        Raises:
            FitError: the fit has no values. SimulationError: no answer there.
        """
        scene = self.scene(log)
        speed = scene.rig.drive_speed if drive_speed is None else quantity(drive_speed, "m/s", "drive_speed")
        load = scene.rig.normal_force if normal_force is None else quantity(normal_force, "N", "normal_force")
        if not isinstance(speed, float) or load is None:
            raise FitError(f"log {log} has no single drive speed or normal force; give drive_speed and normal_force")
        pair = pair_of(self.typed, scene, log - 1)
        return Prediction(predict(scene.model, scene.values(), speed, load, pair.covariance, pair.names))

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
            FitError: no such log, or no values to use.
        """
        self._check_log(log)
        if not self.converged:
            raise FitError(f"this fit has no values ({self.typed.status}): {self.typed.message}")
        return fitted_scene(self.typed, log)

    def save(self, folder: str | Path) -> Path:
        """Write report.html, result.json, classical.csv, result.h5 and figures/ into a folder, made where needed.

        Returns:
            the path of report.html.
        """
        from identify.report.report_files import write_report

        return write_report(self, Path(folder))[-1]

    def _check_curves(self) -> None:
        if not self.logs:
            raise FitError(
                "only the document of this fit is here, without curves; they stand in result.h5, or fit again"
            )

    def _check_log(self, log: int) -> None:
        count = len(self.typed.logs)
        if not 1 <= log <= count:
            raise FitError(f"log {log} was asked for; this fit has {count}, counted from 1: choose one of them")


@dataclass(frozen=True, repr=False)
class Prediction:
    """Stability and amplitude at one operating point; shows itself in words.

    document: as `stickslip stability --json` has it, every number with unit, interval and validity.
    """

    answer: PointPrediction

    @property
    def document(self) -> Mapping[str, Json]:
        """The prediction as a document."""
        return to_dict(self.answer)

    def __repr__(self) -> str:
        return "\n".join(wrapped(line) for line in self.answer.text.splitlines())

    def to_frame(self) -> pd.DataFrame:
        """The amplitude as a table, SI: value, lower and upper end (95 %), unit; one row per quantity."""
        import pandas as pd

        rows = {name: (n.value, *n.ends, n.unit) for name, n in self.answer.amplitude.numbers.items()}
        return pd.DataFrame.from_dict(rows, orient="index", columns=["value", "lower", "upper", "unit"])


def paper_figures() -> ModuleType:
    """The module that draws, which brings matplotlib (half a second)."""
    import identify.report.paper_figures

    return identify.report.paper_figures


def fitted_scene(result: Result, log: int) -> Scene:
    """The scene of a converged result with the estimates that hold for a log (from 1) as values, and its rig.

    Raises:
        FitError: the logs tell nothing of that log's group, or one of its parameters.
    """
    scene = scene_of(result, "the result")
    if scene.effects == "auto":
        scene = scene.with_effects(result.effects.names)
    pair = pair_of(result, scene, log - 1)
    missing = [name for name, entry in result.parameters.items() if entry.value is None]
    if pair.untold or (missing and not pair.values):
        raise FitError(
            pair.untold or f"this fit has no value of {', '.join(missing)}; fix it in the scene and fit again"
        )
    told, entry = result.logs[log - 1], scene.logs[result.numbers[log - 1]]
    values = {**scene.values(entry), **pair.values}
    measured: dict[str, Any] = {name: values[name] for name in RIG_PARAMETERS if name in values}
    rig, speed, load = scene.rig_for(entry), told.drive_speed_m_per_s, told.normal_force_N
    rig = replace(
        rig,
        drive_speed=rig.drive_speed if speed is None else speed,
        normal_force=rig.normal_force if load is None else load,
        **measured,
    )
    specs = {p.name: replace(default_spec(p), fixed=values[p.name]) for p in scene.declared if p.kind != "rig"}
    return replace(scene, rig=rig, parameters=specs, logs=())
