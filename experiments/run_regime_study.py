"""Regimes of drawn records: how often the right one is told, how often stick-slip is claimed where there is none, and
whether `inspect` and the fit say the same.

Every record is looked at twice by `inspect`: as a user has it who knows nothing of the rig, and with the rig that the
scene states; the fit looks at it as `prepare` does. Records come from `regime_records`, each kind in turn, so that the
seeds FIRST to LAST draw ten kinds of each.

    python experiments/run_regime_study.py [FIRST LAST]
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.regime_records import KINDS, Drawn, drawn
from identify import Scene
from identify.base.errors import FitError
from identify.cli.inspection import StatedRig, inspection
from identify.effects import MAIN
from identify.logs.prepare import prepare
from identify.logs.regime import Regime
from identify.logs.unknowns import from_scene

FIRST, LAST = 1, 50


@dataclass(frozen=True)
class Line:
    """One record: its kind, the true regime, what `inspect` says without and with the rig, what the fit says (None
    where it refuses the record before it looks), and how sure `inspect` is without the rig."""

    kind: str
    seed: int
    truth: str
    alone: str
    with_rig: str
    by_fit: str | None
    confidence: float
    evidence: str
    slips: bool

    @property
    def right(self) -> bool:
        """Whether both looks of `inspect` tell the truth."""
        return self.alone == self.with_rig == self.truth

    @property
    def claimed(self) -> bool:
        """Whether stick-slip is claimed where there is none."""
        return not self.slips and any(_slips(said) for said in (self.alone, self.with_rig, self.by_fit))


def _slips(said: str | None) -> bool:
    return said not in (None, "none", "sliding", "programme")


def line(kind: str, seed: int) -> Line:
    """Draw one record and look at it."""
    made = drawn(kind, seed)
    rig = StatedRig(made.rig["stiffness"], made.rig["drive_speed"], made.rig["mass"])
    if made.regime == "programme" or made.strokes > 1:
        rig = StatedRig(rig.stiffness, None, rig.mass)  # the column tells it
    alone = inspection("alone", made.record).regime
    known = inspection("with rig", made.record, rig).regime
    return Line(
        kind,
        seed,
        made.regime,
        _word(alone.regime),
        _word(known.regime),
        _by_fit(made),
        alone.confidence,
        "; ".join(alone.evidence),
        made.slips,
    )


def _word(regime: Regime | None) -> str:
    return "none" if regime is None else regime.value


def _by_fit(made: Drawn) -> str | None:
    """The regime as the fit sees the record under its scene; None where there is no single log of it."""
    if made.regime == "programme" or made.strokes > 1:
        return None  # each part is a log of its own
    rig = {name: made.rig[name] for name in ("mass", "stiffness", "damping")}
    logs = [{"path": "a.csv", "drive_speed": made.rig["drive_speed"]}]
    scene = Scene.from_document({"effects": list(MAIN), "rig": rig, "logs": logs}, Path())
    try:
        return _word(prepare(scene, scene.logs[0], made.record, from_scene(scene)).regime)
    except FitError:
        return None


def table(lines: list[Line]) -> str:
    """By kind: records, right without and with the rig, false claims, agreement of `inspect` with the fit."""
    rows = [
        "| kind | records | right, rig unknown | right, rig known | stick-slip claimed | fit as inspect |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    groups = [(kind, [made for made in lines if made.kind == kind]) for kind in KINDS]
    for kind, own in [*groups, ("all", lines)]:
        if not own:
            continue
        fitted = [made for made in own if made.by_fit is not None]
        none = [made for made in own if not made.slips]
        cells = [
            kind,
            len(own),
            sum(made.alone == made.truth for made in own),
            sum(made.with_rig == made.truth for made in own),
            f"{sum(made.claimed for made in none)} of {len(none)}" if none else "–",
            f"{sum(made.by_fit == made.with_rig for made in fitted)} of {len(fitted)}",
        ]
        rows.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(rows)


def main(fast: bool = False, first: int = FIRST, last: int = LAST) -> list[Line]:
    """Print the table, and a line for every record that is not told rightly."""
    seeds = range(1, 2) if fast else range(first, last + 1)
    lines = [line(kind, seed) for seed in seeds for kind in KINDS]
    print(table(lines))
    for made in lines:
        if not made.right or made.claimed or made.by_fit not in (None, made.with_rig):
            said = f"{made.alone} alone, {made.with_rig} with the rig, {made.by_fit} by the fit"
            print(f"{made.kind} {made.seed}: {made.truth} told as {said} ({made.confidence:.2f}: {made.evidence})")
    print(dict(Counter("right" if made.right else "wrong" for made in lines)))
    return lines


if __name__ == "__main__":
    main(first=int(sys.argv[1]) if len(sys.argv) > 2 else FIRST, last=int(sys.argv[2]) if len(sys.argv) > 2 else LAST)
