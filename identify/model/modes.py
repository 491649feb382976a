"""The modes of a sliding mass as data: which motion holds, what ends it, and what comes next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

ModeName = Literal["stick", "slip", "renewed"]
GuardName = Literal["speed", "clearance", "release"]

# Guards, positive while a mode holds (in the order the step function returns them):
# speed      sliding speed along the direction of slip; zero: the mass comes to rest
# clearance  bounded state minus its lower bound; zero: the contact is fresh, the state is clamped
# release    minus the free rate of the bounded state; zero: it leaves its bound again
GUARDS: tuple[GuardName, ...] = ("speed", "clearance", "release")


@dataclass(frozen=True)
class Mode:
    """One mode of motion. `exits` maps a guard that falls through zero to the mode that follows."""

    name: ModeName
    exits: tuple[tuple[GuardName, ModeName], ...]


SLIP = Mode("slip", exits=(("speed", "stick"), ("clearance", "renewed")))
RENEWED = Mode("renewed", exits=(("speed", "stick"), ("release", "slip")))
PLAIN_SLIP = Mode("slip", exits=(("speed", "stick"),))


def sliding_modes(has_clamped_state: bool) -> dict[ModeName, Mode]:
    """The sliding modes of a model; without a clamped state there is one."""
    return {"slip": SLIP, "renewed": RENEWED} if has_clamped_state else {"slip": PLAIN_SLIP}
