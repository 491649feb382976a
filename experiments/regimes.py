"""What is said of the regime of a drawn record: by `inspect` without and with the rig, and by the fit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from experiments.regime_records import KINDS, Drawn, drawn
from identify import Scene
from identify.base.errors import FitError
from identify.cli.inspection import StatedRig, inspection
from identify.effects import MAIN
from identify.logs.prepare import prepare
from identify.logs.regime import Regime
from identify.logs.unknowns import from_scene


@dataclass(frozen=True)
class Seen:
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


def looked_at(number: int) -> Seen:
    """Draw the record of a number, the kinds in turn, and look at it."""
    kind, seed = tuple(KINDS)[number % len(KINDS)], 1 + number // len(KINDS)
    made = drawn(kind, seed)
    rig = StatedRig(made.rig["stiffness"], made.rig["drive_speed"], made.rig["mass"])
    if made.regime == "programme" or made.strokes > 1:
        rig = StatedRig(rig.stiffness, None, rig.mass)  # the column tells it
    alone = inspection("alone", made.record).regime
    known = inspection("with rig", made.record, rig).regime
    return Seen(
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
