"""How sure an answer is, as a document and in words: probability of stick-slip, lines and draws compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from identify.model.model import Model
from identify.prediction.chance import DRAWS, Certainty, Chance, certainty, document
from identify.prediction.cycle import CycleMap
from identify.prediction.drawn import POINT
from identify.prediction.outlook_words import said
from identify.prediction.prospect import prospect
from identify.prediction.sensitivity import QUANTITIES, orbit_slopes, quantities
from identify.prediction.spread import Interval, Spread


def sureness(
    model: Model,
    values: Mapping[str, float],
    drive_speed: float,
    normal_force: float,
    covariance: ArrayLike | None,
    names: Sequence[str],
    draws: int = DRAWS,
    seed: int = 0,
) -> dict[str, Any]:
    """Probability of stick-slip at an operating point and intervals of its jumps, by lines and by draws.

    Args:
        values: every parameter of the model by name [SI]. drive_speed [m/s] and normal_force [N], positive.
        covariance: (f, f) [SI] of `names` (parameters, "drive_speed", "normal_force"), None where nothing is known.
        draws: how many; each takes some milliseconds.

    Returns:
        {"possible", "certain": {"value", "unit", "interval", "linear"}, "quantities": {name: {"value", "unit",
        "interval", "linear", "alike", "validity"}}, "draws", "refused", "open", "text"}; null where there is
        nothing to say.

    Raises:
        SimulationError: a motion that cannot be integrated.
    """
    where = f"{said(abs(drive_speed), 'm/s')} and {said(normal_force, 'N')}"
    if covariance is None or not names:
        why = "nothing that it depends on has an error: give tolerances, priors, or the result of a fit that tells it"
        empty = document(Certainty(None, None, {}, 0, 0), {}, {})
        return empty | {"text": f"How sure this is at {where} cannot be said: {why}."}
    map_ = CycleMap(model, normal_force, np.array([float(values[name]) for name in model.parameter_names]))
    answer = prospect(map_, abs(drive_speed))
    found = certainty(map_, answer, names, covariance, draws, seed)
    lines: dict[str, Interval | None] = {}
    now: dict[str, float] = {}
    if answer.orbit is not None:
        point = dict(zip(POINT, (answer.orbit.drive_speed, normal_force), strict=True))
        spread = Spread(model, map_.p, names, np.asarray(covariance, float), point)
        row = quantities(map_, answer.orbit.cycle, answer.orbit.drive_speed)
        slopes = orbit_slopes(map_, answer.orbit, names)
        now = dict(zip(QUANTITIES, row.tolist(), strict=True))
        lines = {name: spread.positive(now[name], s) for name, s in zip(QUANTITIES, slopes, strict=True)}
    told = document(found, lines, now)
    return told | {"text": _text(where, found, told)}


def _text(where: str, found: Certainty, told: Mapping[str, Any]) -> str:
    if found.possible is None or found.certain is None:
        return f"Probability of stick-slip at {where}: open, as these data do not tell {', '.join(found.open)}."
    sentences = [
        f"Probability of stick-slip at {where}: {_probability(found.possible, found.draws)}.",
        f"That it starts by itself from steady sliding: {_probability(found.certain, found.draws)}.",
    ]
    compared = {name: row for name, row in told["quantities"].items() if row["alike"] is not None}
    if compared and all(row["alike"] for row in compared.values()):
        sentences.append("Intervals from draws and from straight lines agree.")
    for name, row in told["quantities"].items():
        low, high = (said(end, row["unit"]) for end in row["interval"])
        if name in compared and not row["alike"]:
            sentences.append(f"95 % of the draws of the {name.replace('_', ' ')} lie from {low} to {high}.")
    if found.refused:
        sentences.append(f"{found.refused} draws were left out: no pair has such friction.")
    return " ".join(sentences)


def _probability(chance: Chance, draws: int) -> str:
    low, high = (100 * end for end in chance.interval)
    share = 100 * chance.sampled
    middle = f"above {low:.3g} %" if share == 100 else f"below {high:.2g} %" if share == 0 else f"{share:.3g} %"
    line = "open" if chance.linear is None else _line(100 * chance.linear)
    ends = "" if share in (0, 100) else f", 95 %: {low:.3g} to {high:.3g} %"
    return f"{middle} ({draws} draws{ends}; by straight lines {line})"


def _line(percent: float) -> str:
    return "below 0.1 %" if percent < 0.1 else "above 99.9 %" if percent > 99.9 else f"{percent:.3g} %"
