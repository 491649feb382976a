"""A scene: which effects, which rig, what is known of the parameters, which logs. Frozen; built from TOML."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

from identify.effects import ALL
from identify.errors import SceneError
from identify.model import FRICTION_PARAMETERS, RIG_PARAMETERS, Model, assemble
from identify.scene.toml import read_parts, read_toml
from identify.scene.values import Contact, Initial, LogEntry, ParameterSpec, Rig
from identify.scene.words import document_of


@dataclass(frozen=True)
class Scene:
    """What is fitted or simulated. Every friction parameter of the model has its `ParameterSpec`.

    A rig quantity (mass, stiffness, damping) stands in `parameters` only if it is to be estimated.

    Raises:
        SceneError: parts that contradict each other, one sentence.
    """

    name: str
    effects: tuple[str, ...] | Literal["auto"]
    rig: Rig
    parameters: Mapping[str, ParameterSpec]
    logs: tuple[LogEntry, ...] = ()
    initial: Initial = field(default_factory=Initial)
    contact: Contact = field(default_factory=Contact)
    source: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        _check_log_overrides(self)
        _check_rig_bounds(self)
        _check_coefficients(self.values())
        for number, entry in enumerate(self.logs, 1):
            if self.rig_for(entry).drive_speed is None:
                raise SceneError(
                    f"log {number} ({entry.path.name}) has no drive speed; "
                    'give drive_speed = "… mm/s" in its [[logs]] or under [rig]'
                )
        if not self.logs and self.rig.drive_speed is None:
            raise SceneError('the scene has no drive speed; give drive_speed = "… mm/s" under [rig]')

    @staticmethod
    def from_toml(path: str | Path, overrides: Sequence[str] = ()) -> Scene:
        """Read a scene file.

        Args:
            path: the TOML file; paths of its logs are relative to its folder.
            overrides: "dotted.key=value" each, replacing what the file says ("logs.1.mass=0.3 kg").

        Raises:
            SceneError: one sentence that names the file, the key, and what to do.
        """
        path = Path(path)
        try:
            return _build(read_toml(path, overrides), path.parent, path.stem, path)
        except SceneError as error:
            raise SceneError(f"{path}: {error}") from None

    @staticmethod
    def from_document(document: Mapping[str, Any], folder: str | Path = ".") -> Scene:
        """Build a scene from the tables of a scene file, or from what `as_document` gave.

        Args:
            folder: what relative log paths are relative to.

        Raises:
            SceneError: as `from_toml`.
        """
        return _build(document, Path(folder), "scene", None)

    def as_document(self) -> dict[str, Any]:
        """The scene as JSON-able tables, SI numbers, absolute log paths; `from_document` rebuilds it."""
        return document_of(self)

    @property
    def model(self) -> Model:
        """The oscillator composed from the scene's effects.

        Raises:
            SceneError: the effects are still to be chosen ("auto").
        """
        if self.effects == "auto":
            raise SceneError('effects = "auto" is not built yet; list the effects by name')
        return assemble(self.effects)

    @property
    def friction(self) -> SimpleNamespace:
        """The six friction parameters by name, SI; those of effects that are off at their null value."""
        absent: dict[str, float] = {}
        for effect in ALL:
            absent |= {p.name: p.default for p in effect.parameters} | dict(effect.null)
        values = absent | self.values()
        return SimpleNamespace(**{name: values[name] for name in FRICTION_PARAMETERS})

    def values(self, log: LogEntry | None = None) -> dict[str, float]:
        """Every parameter of the model, SI: fixed, else start, else the documented default.

        Args:
            log: take the rig of this log; a rig quantity that is estimated takes its start where one is given.
        """
        rig = self.rig if log is None else self.rig_for(log)
        values: dict[str, float] = {}
        for declared in self.model.parameters:
            name = declared.name
            spec = self.parameters.get(name)
            fallback = getattr(rig, name) if name in RIG_PARAMETERS else declared.default
            said = (spec.fixed, spec.start) if spec else ()
            values[name] = next((value for value in said if value is not None), fallback)
        return values

    def rig_for(self, log: LogEntry) -> Rig:
        """The rig with what this log says otherwise."""
        names = ("mass", "stiffness", "damping", "drive_speed", "normal_force", "noise")
        said = {name: getattr(log, name) for name in names if getattr(log, name) is not None}
        return replace(self.rig, **said)

    def choose(self, paths: Sequence[str | Path], added: LogEntry | None = None) -> Scene:
        """The scene with exactly these logs: chosen by path, then by unique file name, else added.

        Args:
            paths: none keeps the scene's logs.
            added: what is known of a log the scene does not list (its path is replaced).

        Raises:
            SceneError: a file name that two files of the scene share, or no such file.
        """
        template = added or LogEntry(Path())
        return replace(self, logs=tuple(e for p in paths for e in self._entries(Path(p), template))) if paths else self

    def _entries(self, path: Path, template: LogEntry) -> list[LogEntry]:
        """The scene's entries for a file (one per step, if it lists steps), or a new one."""
        same = [entry for entry in self.logs if entry.path.resolve() == path.resolve()]
        if same or path.exists():
            return same or [replace(template, path=path)]
        same = [entry for entry in self.logs if entry.path.name == path.name]
        files = {entry.path.resolve() for entry in same}
        if not files:
            raise SceneError(f"{path}: there is no such log, as a file or among the logs of the scene; check its path")
        if len(files) > 1:
            raise SceneError(f"{path} stands for {len(files)} files of the scene; give the path as the scene has it")
        return same


def _build(document: Mapping[str, Any], folder: Path, name: str, source: Path | None) -> Scene:
    parts = read_parts(document, folder)
    return Scene(
        name=parts.name or name,
        effects=parts.effects,
        rig=parts.rig,
        parameters=parts.parameters,
        logs=parts.logs,
        initial=parts.initial,
        contact=parts.contact,
        source=source,
    )


def _check_log_overrides(scene: Scene) -> None:
    for entry in scene.logs:
        for name in RIG_PARAMETERS:
            if name in scene.parameters and getattr(entry, name) is not None:
                raise SceneError(
                    f"log {entry.path.name} gives its own {name}, but [parameters] estimates one {name} for all logs; "
                    "drop one of the two"
                )


def _check_rig_bounds(scene: Scene) -> None:
    for name in RIG_PARAMETERS:
        spec, value = scene.parameters.get(name), getattr(scene.rig, name)
        if spec and not spec.lower <= value <= spec.upper:
            raise SceneError(
                f"{name} = {value:g} of [rig] is outside the bounds {spec.lower:g} to {spec.upper:g} of [parameters]; "
                "widen them"
            )


def _check_coefficients(values: Mapping[str, float]) -> None:
    static, kinetic, change = values["mu_s"], values["mu_k0"], values.get("delta_mu_k", 0.0)
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
