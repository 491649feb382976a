"""Reading one TOML table: quantities with units, known keys, and complaints that name the place."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from data_io.units import UnitError, parse_quantity
from identify.base.errors import SceneError
from identify.effects import ALL
from identify.model.model import RIG_PARAMETERS
from identify.scene.values import EACH_LOG, DriveSpeed

if TYPE_CHECKING:
    from identify.scene.scene import Scene

LONGEST_WORD = 60  # characters of a word that are compared with known ones


def nearest(word: str, known: Iterable[str]) -> str:
    """The known word that looks most like this one."""
    said = word[:LONGEST_WORD].lower()
    return max(known, key=lambda name: difflib.SequenceMatcher(None, said, name.lower()).ratio())


def quantity(value: object, unit: str, where: str) -> float:
    """A number in SI from "text with a unit" or a bare SI number.

    Args:
        unit: the SI unit of the result ("" for a pure number).
        where: names the place in a complaint, such as "[rig] mass".

    Raises:
        SceneError: neither a number nor text, an unknown unit, or a number that is not finite.
    """
    shape = f'"1.5 {unit}"' if unit else "0.5"
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise SceneError(f"{where} is {value!r}; expected a quantity such as {shape}, or a bare SI number")
    try:
        number = float(parse_quantity(value, unit)) if isinstance(value, str) else float(value)
    except UnitError as error:
        raise SceneError(f"{where}: {error}") from None
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise SceneError(f"{where} is {value!r}; expected a finite number: correct it")
    return number


def stated(value: object, unit: str, where: str) -> float:
    """As `quantity`, of a scene file: quotes around a bare number mean that its unit was forgotten.

    Raises:
        SceneError: as `quantity`, or a text without a unit where there is one.
    """
    number = quantity(value, unit, where)
    if unit and isinstance(value, str) and is_number(value):
        raise SceneError(
            f'{where} is "{value}", a text without a unit; write for instance "{value} {unit}", or the bare SI number '
            f"{value.strip()} without quotes"
        )
    return number


def is_number(text: str) -> bool:
    """Whether a text is a number and nothing else, so that a unit is missing."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def share(value: object, where: str) -> float | None:
    """ "2 %" as 0.02; None for anything that is no percentage.

    Raises:
        SceneError: a percentage without a number.
    """
    if not isinstance(value, str) or not value.strip().endswith("%"):
        return None
    return quantity(value.strip()[:-1].strip(), "", where) / 100.0


@dataclass(frozen=True)
class TomlTable:
    """A TOML table and where it stands ("[rig]"); every reader answers None for an absent key."""

    data: Mapping[str, Any]
    where: str

    @staticmethod
    def of(value: object, where: str, known: Iterable[str] | None, example: str) -> TomlTable:
        """The value as a table with none but the known keys (None: any).

        Raises:
            SceneError: not a table, or an unknown key; the nearest known one is named.
        """
        if not isinstance(value, Mapping):
            raise SceneError(f"{where} is {value!r}; expected a table such as {example}")
        names = list(known) if known is not None else list(value)
        for key in value:
            if key not in names:
                raise SceneError(
                    f"{where} has a key {key!r} that is not known; did you mean {nearest(str(key), names)!r}? "
                    f"Known are {', '.join(names)}"
                )
        return TomlTable(value, where)

    def place(self, key: str) -> str:
        """How a complaint calls this key."""
        return f"{self.where} {key}"

    def quantity(self, key: str, unit: str) -> float | None:
        """A quantity in SI."""
        return stated(self.data[key], unit, self.place(key)) if key in self.data else None

    def whole(self, key: str) -> int | None:
        """A whole number."""
        value = self.data.get(key)
        if value is not None and (isinstance(value, bool) or not isinstance(value, int)):
            raise SceneError(f"{self.place(key)} is {value!r}; expected a whole number: correct it")
        return value

    def truth(self, key: str) -> bool | None:
        """true or false."""
        value = self.data.get(key)
        if value is not None and not isinstance(value, bool):
            raise SceneError(f"{self.place(key)} is {value!r}; expected true or false: correct it")
        return value

    def text(self, key: str) -> str | None:
        """A non-empty text; a path that Python gives is one."""
        value = self.data.get(key)
        value = str(value) if isinstance(value, PurePath) else value
        if value is not None and (not isinstance(value, str) or not value.strip()):
            raise SceneError(f"{self.place(key)} is {value!r}; expected a text in quotes: correct it")
        return value

    def words(self, key: str) -> dict[str, str] | None:
        """A table of texts; numbers become text."""
        value = self.data.get(key)
        if value is None:
            return None
        example = '{ time = "T", friction_force = "Fx" }'
        table = TomlTable.of(value, self.place(key), None, example)
        for name, word in table.data.items():
            if isinstance(word, (Mapping, list)):
                raise SceneError(f"{table.place(name)} is {word!r}; expected a text in quotes: correct it")
        return {name: str(word) for name, word in table.data.items()}

    def span(self, key: str) -> tuple[float, float] | None:
        """A pair [start, stop] of times [s]."""
        return span(self.data[key], self.place(key)) if key in self.data else None


def span(value: object, where: str) -> tuple[float, float]:
    """A pair [start, stop] of times [s].

    Raises:
        SceneError: not two times.
    """
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise SceneError(f'{where} is {value!r}; expected two times such as ["5 s", "20 s"]')
    return stated(value[0], "s", where), stated(value[1], "s", where)


# ----------------------------------------------------------------------------------------------------------------------
# Parts of a scene that contradict each other, and measured laws outside the range of their measurements.
# ----------------------------------------------------------------------------------------------------------------------

LOAD_LAW = "load law"  # role of the effects whose range is one of normal force


def check_ranges(
    effects: Sequence[str],
    extrapolate: Sequence[str],
    values: Mapping[str, float],
    drive_speed: DriveSpeed | None,
    normal_forces: Iterable[float] = (),
) -> None:
    """Refuse a law outside the range of its measurements.

    Args:
        effects: those that are on. extrapolate: those of them that are used all the same.
        values: parameters by name [SI].
        drive_speed: [m/s], or a programme; while the drive stands nothing slides. normal_forces: [N], none: unknown.

    Raises:
        SceneError: the effect's own sentence, and how to override it.
    """
    programme = drive_speed if isinstance(drive_speed, tuple) else ((0.0, drive_speed or 0.0),)
    speeds = [speed for _, speed in programme if speed != 0.0]
    loads = list(normal_forces)
    for effect in ALL:
        if effect.name not in effects or effect.name in extrapolate:
            continue
        asked = loads if effect.role == LOAD_LAW else loads[:1] or [1.0]
        for load in asked:
            for speed in speeds if effect.role != LOAD_LAW else speeds[:1] or [1.0]:
                sentence = effect.refusal(values, load, speed)
                if sentence is not None:
                    raise SceneError(f'{sentence}, or use it there all the same: extrapolate = ["{effect.name}"]')


def check_groups(scene: Scene) -> None:
    """A parameter that differs by a label asks for that label of every log."""
    for name, spec in scene.parameters.items():
        if spec.per is None or spec.per == EACH_LOG:
            continue
        for entry in scene.logs:
            if spec.per not in entry.labels:
                raise SceneError(
                    f"{name} differs by {spec.per}, of which log {entry.path.name} says nothing; give it labels = "
                    f'{{ {spec.per} = "…" }}, or write per = "log"'
                )


def check_log_overrides(scene: Scene) -> None:
    """A log may not give its own value of what is estimated for all."""
    for entry in scene.logs:
        for name in RIG_PARAMETERS:
            if name in scene.parameters and getattr(entry, name) is not None:
                raise SceneError(
                    f"log {entry.path.name} gives its own {name}, but [parameters] estimates one {name} for all logs; "
                    "drop one of the two"
                )


def check_mass(scene: Scene) -> None:
    """Only a model without inertia does without a mass."""
    if scene.rig.mass == 0.0 and (scene.effects == "auto" or "inertia" in scene.effects):
        raise SceneError("mass is 0 kg; expected a positive number: correct it, or take inertia out of effects")


def check_rig_bounds(scene: Scene) -> None:
    """A rig quantity that is estimated starts within its bounds."""
    for name in RIG_PARAMETERS:
        spec, value = scene.parameters.get(name), getattr(scene.rig, name)
        if spec and not spec.lower <= value <= spec.upper:
            raise SceneError(
                f"{name} = {value:g} of [rig] is outside the bounds {spec.lower:g} to {spec.upper:g} of [parameters]; "
                "widen them"
            )


def check_coefficients(scene: Scene) -> None:
    """Kinetic friction lies below static friction, and above zero."""
    values = scene.values()
    static, kinetic = values["mu_s"], values["mu_k0"]
    change = values.get("delta_mu_k", 0.0) if scene.effects != "auto" else 0.0  # which law holds is still open
    if kinetic >= static:
        raise SceneError(
            f"mu_k0 = {kinetic:g} is not below mu_s = {static:g} (start values, or defaults where none is given); "
            "give [parameters] a start of mu_k0 below that of mu_s"
        )
    if not kinetic + change > 0.0 or math.isnan(change):
        raise SceneError(
            f"mu_k0 + delta_mu_k = {kinetic + change:g} is the kinetic coefficient at high speed; expected a positive "
            "number: raise one of the two in [parameters]"
        )
