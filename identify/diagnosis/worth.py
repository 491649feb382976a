"""Does each effect earn its place? The accepted fit beside fits that lack one effect each.

Information criteria on the same samples, and errors on what was left out: cycles within every log, and whole logs of
which only the first cycles are shown, so that their start is known and the rest is foretold from the other logs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.base.document import finite
from identify.base.errors import IdentifyError
from identify.base.progress import Progress
from identify.base.result import ComparedModel
from identify.diagnosis.fitted import Fitted, as_it_ended, foretold
from identify.diagnosis.nested import fit_smaller
from identify.diagnosis.subsets import held_out_error
from identify.estimation.attempt import Attempt
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.scene import Scene
from identify.scene.variant import scene_with

Array = NDArray[np.float64]

SHOWN = 2  # cycles of a log that is left out
FEWEST_LOGS = 2
ALWAYS = ("inertia",)
SURE = 10.0  # difference of BIC beyond which nobody argues
SAME = 1.02  # factor of an error on what was left out that says nothing


@dataclass(frozen=True)
class Worth:
    """One model: the effect that it lacks ("" for the accepted one); number of parameters; chi^2 per sample; AIC and
    BIC against the accepted model; mean squares on left-out cycles and logs, in noise variances; a verdict in words.
    NaN where there is no number."""

    without: str
    parameters: int
    chi2: float
    aic: float
    bic: float
    cycles: float
    logs: float
    verdict: str


def worth(
    scene: Scene,
    records: Sequence[Record],
    prepared: Sequence[Prepared],
    unknowns: Unknowns,
    attempt: Attempt,
    progress: Progress,
) -> list[Worth]:
    """The accepted fit, then one row per effect that can be left out."""
    full = as_it_ended(scene, unknowns, prepared, attempt)
    progress("errors on what is left out", None)
    rows = [_row("", full, full, held_out_error(full), logs_left_out(full))]
    whole = rows[0]
    for effect in unknowns.model.effects:
        if effect in ALWAYS:
            continue
        try:
            smaller = scene_with(scene, [e for e in unknowns.model.effects if e != effect], {})
        except IdentifyError:
            continue  # another effect needs it
        if len(smaller.model.parameters) == len(unknowns.names):
            continue  # it has no parameters to pay for
        progress(f"the fit without {effect}", None)
        less = fit_smaller(full, smaller, records)
        rows.append(_judged(_row(effect, less, full, held_out_error(less), logs_left_out(less)), whole))
    return rows


def _row(effect: str, fitted: Fitted, full: Fitted, cycles: float, logs: float) -> Worth:
    assert full.attempt is not None
    samples = full.attempt.solved.problem.samples
    fewer = full.searched - fitted.searched
    loss = fitted.excess - full.excess if math.isfinite(fitted.excess) else math.nan
    chi2 = 1.0 + fitted.excess / samples if math.isfinite(fitted.excess) else math.nan
    verdict = "" if effect else "this fit"
    return Worth(
        effect, fitted.searched, chi2, loss - 2 * fewer, loss - fewer * math.log(samples), cycles, logs, verdict
    )


def _judged(row: Worth, whole: Worth) -> Worth:
    """The row with its verdict."""
    name = row.without.replace("_", " ")
    if not math.isfinite(row.bic):
        return replace(row, verdict=f"without {name} no fit was found: it stays")
    worse = max(_factor(row.cycles, whole.cycles), _factor(row.logs, whole.logs))
    told = f"; what was left out is foretold with {worse:.2g} times the error" if worse > SAME else ""
    if row.bic > SURE:
        return replace(row, verdict=f"{name} earns its place{told}")
    if row.bic > 0.0:
        return replace(row, verdict=f"{name} gains a little{told}")
    return replace(row, verdict=f"these logs do not need {name}{told}")


def _factor(without: float, whole: float) -> float:
    return without / whole if math.isfinite(without) and math.isfinite(whole) and whole > 0.0 else 1.0


def logs_left_out(fitted: Fitted) -> float:
    """Mean square, in noise variances, of the forces of logs foretold from the others; NaN with one log alone."""
    attempt = fitted.attempt
    if attempt is None or len(attempt.fitted_logs) < FEWEST_LOGS or attempt.solved.solution.constraint_violation > 1e-6:
        return float("nan")
    total, count = 0.0, 0
    for number, (log, trajectory) in enumerate(zip(attempt.fitted_logs, attempt.solved.trajectories, strict=True)):
        if trajectory.cycles <= SHOWN:
            continue
        hidden = [np.zeros(other.data.time.size, bool) for other in attempt.fitted_logs]
        hidden[number] = log.data.time > trajectory.arrest[SHOWN - 1]
        squares, samples = foretold(fitted, hidden)
        total, count = total + squares, count + samples
    return total / count if count else float("nan")


def compared_models(rows: Sequence[Worth]) -> tuple[ComparedModel, ...]:
    """`effects_table` of the result."""
    return tuple(
        ComparedModel(
            f"without {row.without}" if row.without else "this fit",
            row.without or None,
            row.parameters,
            finite(row.chi2),
            finite(row.aic),
            finite(row.bic),
            finite(row.cycles),
            finite(row.logs),
            row.verdict,
        )
        for row in rows
    )
