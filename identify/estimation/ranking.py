"""Starts in the order in which they deserve a solve: how well the motion that follows from each fits before any is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.estimation.attempt import place_on
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.passes import COARSE
from identify.shooting.shooting import transcribe
from identify.shooting.starts import Start

Array = NDArray[np.float64]

MISSING = 1e6  # cost per residual of a log on which a start cannot be placed


def ranked(prepared: list[Prepared], unknowns: Unknowns, tried: Iterable[Array]) -> list[Start]:
    """Thetas (n_p,) by the cost per residual of the motions that follow from them; those that can be placed on fewer
    logs last, those that can on none left out."""
    out = []
    for theta in tried:
        at = replace(unknowns, start=theta)
        placed = place_on(prepared, list(range(len(prepared))), at)
        if placed:
            logs = [log.data for _, log, _ in placed]
            problem = transcribe(logs, [guess for _, _, guess in placed], at, COARSE)
            cost = problem.evaluate(problem.start, derivatives=False).cost / max(problem.samples, 1)
            out.append(Start(theta, float(cost) + MISSING * (len(prepared) - len(placed))))
    return sorted(out, key=lambda start: start.cost)
