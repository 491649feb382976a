"""The preview of a fit: before anything is fitted, the detected cycles, and what the start shows, over the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from data_io import Record
from identify.base.errors import FitError
from identify.base.result import LogCurves
from identify.estimation.attempt import place_on
from identify.estimation.fit_wording import prefit_warnings, wrong_unit
from identify.estimation.starts import features_of, starts_of
from identify.logs.scene_records import prepare_scene
from identify.logs.unknowns import user_start
from identify.scene import Scene
from identify.shooting.layout import COARSE_GRID
from identify.shooting.shooting import shooting_problem


@dataclass(frozen=True)
class PreviewLog:
    """One log before the fit: its curves, with the force of the start trajectory in place of the fitted one (NaN where
    there is none and behind the last slip that it is placed on), and a sentence."""

    curves: LogCurves
    text: str


@dataclass(frozen=True)
class Preview:
    """What a fit would start from: where the start comes from, its parameters (SI) by name, units by name, the logs;
    notices: sentences on rig and scatter."""

    source: str
    parameters: dict[str, float]
    units: dict[str, str]
    logs: list[PreviewLog]
    notices: list[str]


def preview(scene: Scene, records: Sequence[Record]) -> Preview:
    """Detect the cycles of every log and place the start on them; nothing is fitted but one folded cycle.

    Raises:
        FitError, SceneError: as the fit itself; and where no fit can succeed.
    """
    preparation = prepare_scene(scene, records)
    prepared, unknowns = preparation.logs, preparation.unknowns
    if refused := wrong_unit(prepared):
        raise FitError(refused)
    able = [log for log in prepared if log.left_out is None]
    theta, source = unknowns.start, "the defaults: no log shows enough cycles to start from"
    if user_start(preparation.scene):
        source = "the start values of the scene"
    elif features_of(able)[0]:
        theta, source = next(starts_of(able, unknowns)), "the mean cycle of each log"
    logs, at_start = [], replace(unknowns, start=theta)
    for log in prepared:
        trajectory = np.full(log.record.time.size, np.nan)
        text = log.left_out or "with these values the model does not move like this"
        for _, cut, motion in [] if log.left_out else place_on([log], [0], at_start):
            own = replace(unknowns.with_weak_priors(), start=motion.theta(theta))
            problem = shooting_problem([cut.data], [motion], own, COARSE_GRID)
            trajectory = problem.fitted(problem.start)[0]
            inside = np.isfinite(trajectory) & log.used
            off = float(np.sqrt(np.mean((trajectory - log.force)[inside] ** 2))) if np.any(inside) else float("nan")
            text = f"the start is off by {1e3 * off:.3g} mN (rms); the noise is {1e3 * log.data.noise:.3g} mN"
        shown = replace(log.curves, fitted_force=np.where(log.used, trajectory, np.nan))
        logs.append(PreviewLog(shown, f"{log.segmentation.cycles.count} cycles found; {text}"))
    values = dict(zip(unknowns.names, unknowns.values(theta, prepared[0].data.base).tolist(), strict=True))
    units = {q.name: q.unit for q in unknowns.model.parameters}
    return Preview(source, values, units, logs, prefit_warnings(prepared))
