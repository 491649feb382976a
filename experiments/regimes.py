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
from identify.logs.unknowns import from_scene

SLIPLESS = (None, "none", "sliding", "programme")


@dataclass(frozen=True)
class Seen:
    """One record: its kind, the true regime, what `inspect` says without and with the rig, what the fit says (None
    where it refuses the record before it looks); whether both looks of `inspect` tell the truth, and whether
    stick-slip is claimed where there is none."""

    kind: str
    truth: str
    alone: str
    with_rig: str
    by_fit: str | None
    evidence: str
    right: bool
    claimed: bool


def looked_at(number: int) -> Seen:
    """Draw the record of a number, the kinds in turn, and look at it."""
    kind = tuple(KINDS)[number % len(KINDS)]
    made = drawn(kind, 1 + number // len(KINDS))
    parted = made.regime == "programme" or made.strokes > 1  # a column tells the speed; each part is a log of its own
    rig = StatedRig(made.rig["stiffness"], None if parted else made.rig["drive_speed"], made.rig["mass"])
    looks = [inspection("log", made.record, stated).regime for stated in (StatedRig(), rig)]
    alone, known = ("none" if look.regime is None else look.regime.value for look in looks)
    fitted = None if parted else _by_fit(made)
    right = alone == known == made.regime
    claimed = not made.slips and any(word not in SLIPLESS for word in (alone, known, fitted))
    return Seen(kind, made.regime, alone, known, fitted, "; ".join(looks[0].evidence), right, claimed)


def _by_fit(made: Drawn) -> str | None:
    """The regime as the fit sees the record under its scene; None where it refuses it before."""
    rig = {name: made.rig[name] for name in ("mass", "stiffness", "damping")}
    logs = [{"path": "a.csv", "drive_speed": made.rig["drive_speed"]}]
    scene = Scene.from_document({"effects": list(MAIN), "rig": rig, "logs": logs}, Path())
    try:
        regime = prepare(scene, scene.logs[0], made.record, from_scene(scene)).regime
    except FitError:
        return None
    return "none" if regime is None else regime.value
