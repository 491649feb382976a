"""A scene: which effects, which rig, what is known of the parameters, which logs. Frozen; built from TOML."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Literal

from data_io.contents import log_is_at
from data_io.quality import DEFAULTS, Thresholds
from data_io.spelling import Spelled
from identify.base.budget import DEFAULT_TIME_LIMIT
from identify.base.document import to_document
from identify.base.errors import SceneError
from identify.base.wording import DASH, quantity, wrapped
from identify.effects import ALL
from identify.effects.quantities import Parameter
from identify.model.model import FRICTION_PARAMETERS, RIG_PARAMETERS, Model, assemble
from identify.scene.parts import declared_by, default_spec, known_effects, read_parts, scene_schema
from identify.scene.tables import TIED, Course
from identify.scene.toml import Tables, question_bare_numbers, read_toml, with_rig_file
from identify.scene.values import EACH_LOG, Contact, DriveSpeed, Initial, LogEntry, ParameterSpec, Rig

RIG_UNITS = {"mass": "kg", "stiffness": "N/m", "damping": "N/m", "normal_force": "N"}
SHOWN = 12  # logs on a screen
LOAD_LAW = "load law"  # role of the effects whose range is one of normal force


@dataclass(frozen=True)
class Scene(Spelled):
    """What is fitted or simulated. Every parameter of the model but those of the rig has its `ParameterSpec`.

    A rig quantity (mass, stiffness, damping) stands in `parameters` only if it is to be estimated. While the effects
    are still to be chosen ("auto"), `parameters` holds those of every effect; `with_effects` settles them.
    `extrapolate`: effects that are used outside the range of their measurements. `thresholds`: of the quality gate.
    `time_limit`: of a fit [s]. `tolerances`: relative, of what the published intervals hold, in place of the usual.

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
    thresholds: Thresholds = DEFAULTS
    extrapolate: tuple[str, ...] = ()
    time_limit: float = DEFAULT_TIME_LIMIT
    tolerances: Mapping[str, float] = field(default_factory=dict)
    source: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        _check_consistent(self)
        if not self.logs and self.rig.drive_speed is None:
            raise SceneError(
                'the scene has no drive speed; give drive_speed = "… mm/s" under [rig], or in the file that rig names'
            )
        if self.effects != "auto":
            for entry in self.logs or (None,):
                self.check_ranges(entry)

    def __repr__(self) -> str:
        """A screen of it: effects, rig, what is stated of parameters, logs."""
        rig = ((name, quantity(getattr(self.rig, name), unit)) for name, unit in RIG_UNITS.items())
        stated = [
            f"{name} fixed" if spec.fixed is not None else name for name, spec in self.parameters.items() if spec.stated
        ]
        effects = "effects chosen from the data" if self.effects == "auto" else ", ".join(self.effects)
        lines = [
            f"Scene {self.name}: {effects}",
            f"rig: {', '.join(f'{name} {text}' for name, text in rig if text != DASH)}",
            f"parameters stated: {', '.join(stated) or 'none'}",
        ]
        lines += [f"log {place}: {entry.path.name}" for place, entry in enumerate(self.logs[:SHOWN], 1)]
        lines += [f"and {len(self.logs) - SHOWN} more logs"] if len(self.logs) > SHOWN else []
        return "\n".join(wrapped(line) for line in lines)

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(repr(self))}</pre>"

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
            document = read_toml(path, overrides)
            question_bare_numbers(document)
            return Scene(**read_parts(document, path.parent, path.stem), source=path)
        except SceneError as error:
            raise SceneError(f"{path}: {error}") from None

    @staticmethod
    def from_document(document: Mapping[str, object], folder: str | Path = ".") -> Scene:
        """Build a scene from the tables of a scene file, or from what `as_document` gave.

        Args:
            folder: what relative log paths are relative to.

        Raises:
            SceneError: as `from_toml`.
        """
        return Scene(**read_parts(with_rig_file(document, Path(folder)), Path(folder), "scene"))

    @staticmethod
    def of(given: object) -> Scene:
        """The scene that a caller of the package gives: itself, the path of its file, or the tables of one.

        Raises:
            SceneError: as `from_toml`; or it is something else.
        """
        if isinstance(given, Scene):
            return given
        if isinstance(given, Mapping):
            return Scene.from_document(given)
        if isinstance(given, (str, Path)):
            return Scene.from_toml(given)
        raise SceneError(
            f"{given!r:.60} is no scene; expected a Scene, the path of a scene file, or its tables as a dict"
        )

    json_schema = staticmethod(scene_schema)

    def as_document(self) -> Tables:
        """The scene as JSON-able tables, SI numbers, absolute log paths; `from_document` rebuilds it.

        What is not stated is absent. Where the effects are still to be chosen that goes for every parameter the scene
        does not name: a default written down would be read back as stated.
        """
        listed, rig = self.effects != "auto", self.rig
        optional = {
            "extrapolate": list(self.extrapolate),
            "quality": dict(self.thresholds.own),
            "fit": {"time_limit": self.time_limit} if self.time_limit != DEFAULT_TIME_LIMIT else {},
            "tolerances": dict(self.tolerances),
        }
        usual = ("force_sensor",) if rig.force_sensor == "drive" else ()
        table = _with_course(asdict(rig), rig.drive_speed)
        table = _stated(table, without=("tolerances", "ratio_tolerances", *usual))
        table |= {name: {"value": table[name], "tolerance": share} for name, share in rig.tolerances.items()}
        if "zeta" in rig.ratio_tolerances:
            del table["damping"]
            table["zeta"] = {"value": rig.zeta, "tolerance": rig.ratio_tolerances["zeta"]}
        if "natural_frequency" in rig.ratio_tolerances:
            table[TIED] = rig.ratio_tolerances["natural_frequency"]
        law = _stated({"coefficient": self.contact.coefficient, "exponent": self.contact.exponent})
        return {
            "name": self.name,
            "effects": to_document(self.effects),
            "rig": table,
            "contact": _stated({"area": self.contact.area, "area_law": law}),
            **{name: part for name, part in optional.items() if part},
            "initial": asdict(self.initial),
            "parameters": {name: _table_of(s) for name, s in self.parameters.items() if listed or s.stated},
            "logs": [
                _stated(_with_course(asdict(entry), entry.drive_speed)) | {"path": str(entry.path.absolute())}
                for entry in self.logs
            ],
        }

    @property
    def model(self) -> Model:
        """The oscillator composed from the scene's effects.

        Raises:
            SceneError: the effects are still to be chosen ("auto").
        """
        if self.effects == "auto":
            raise SceneError(
                'effects = "auto" leaves the effects to be chosen from logs by a fit; list them by name: '
                'effects = ["inertia", …]'
            )
        return assemble(self.effects, self.rig.force_sensor)

    @property
    def declared(self) -> tuple[Parameter, ...]:
        """The parameters of the model; of every effect there is while the effects are still to be chosen."""
        return declared_by(self.effects)

    def with_effects(self, names: Sequence[str], starts: Mapping[str, float] | None = None) -> Scene:
        """The scene with exactly these effects; what it says of their parameters is kept, the others have defaults.

        Args:
            starts: values [SI] at which parameters start (or are held) that the scene gives no value.

        Raises:
            SceneError: an unknown effect, a composition that is refused, or one that does not suit the scene.
        """
        effects = known_effects(names)
        specs = {}
        for p in declared_by(effects):
            if p.name in self.parameters:
                specs[p.name] = self.parameters[p.name]
            elif p.kind != "rig":
                specs[p.name] = default_spec(p)
                if p.name in self.contact.parameters:
                    specs[p.name] = replace(specs[p.name], fixed=self.contact.parameters[p.name][1], stated=True)
        for name, value in (starts or {}).items():
            spec = specs.get(name)
            if spec is not None and not spec.states_value:
                within = min(max(value, spec.lower), spec.upper)
                specs[name] = replace(spec, start=within) if spec.fixed is None else replace(spec, fixed=value)
        allowed = tuple(name for name in self.extrapolate if name in effects)
        return replace(self, effects=effects, parameters=specs, extrapolate=allowed)

    def check_ranges(
        self,
        log: LogEntry | None = None,
        drive_speed: DriveSpeed | None = None,
        normal_forces: Sequence[float] = (),
    ) -> None:
        """Refuse a measured law outside its range, at the operating point of a log, or of the rig without one.

        Args:
            drive_speed: [m/s], or a programme, in which nothing slides while the drive stands; normal_forces: [N]; in
                place of what the scene says.

        Raises:
            SceneError: the sentence of the effect, and how to override it.
        """
        rig = self.rig if log is None else self.rig_for(log)
        speed = drive_speed or rig.drive_speed or 0.0
        speed = speed.fastest if isinstance(speed, Course) else speed
        speeds = [pace for _, pace in speed if pace] if isinstance(speed, tuple) else [speed] if speed else []
        loads = list(normal_forces) or ([] if rig.normal_force is None else [rig.normal_force])
        for effect in ALL:
            if effect.name not in self.effects or effect.name in self.extrapolate:
                continue
            by_load = effect.role == LOAD_LAW
            for load in loads if by_load else loads[:1] or [1.0]:
                for pace in (speeds[:1] or [1.0]) if by_load else speeds:
                    sentence = effect.refusal(self.values(log), load, pace)
                    if sentence is not None:
                        raise SceneError(f'{sentence}, or use it there all the same: extrapolate = ["{effect.name}"]')

    @property
    def friction(self) -> SimpleNamespace:
        """The six friction parameters by name, SI; those of effects that are off at their null value."""
        absent: dict[str, float] = {}
        for effect in ALL:
            absent |= {p.name: p.default for p in effect.parameters} | dict(effect.null)
        present = self.values()
        values = absent | {name: present[name] for name in self.model.parameter_names}
        return SimpleNamespace(**{name: values[name] for name in FRICTION_PARAMETERS})

    def values(self, log: LogEntry | None = None) -> dict[str, float]:
        """Every parameter of `declared`, SI: fixed, else start, else the documented default.

        Args:
            log: take the rig of this log; a rig quantity that is estimated takes its start where one is given.
        """
        rig = self.rig if log is None else self.rig_for(log)
        values: dict[str, float] = {}
        for declared in self.declared:
            name = declared.name
            spec = self.parameters.get(name)
            fallback = getattr(rig, name) if name in RIG_PARAMETERS else declared.default
            stated = (spec.fixed, spec.start) if spec else ()
            values[name] = next((value for value in stated if value is not None), fallback)
        return values

    def rig_for(self, log: LogEntry) -> Rig:
        """The rig with what this log says otherwise."""
        names = ("mass", "stiffness", "damping", "drive_speed", "normal_force", "noise")
        stated = {name: getattr(log, name) for name in names if getattr(log, name) is not None}
        return replace(self.rig, **stated)

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
        if same or log_is_at(path):
            return same or [replace(template, path=path)]
        same = [entry for entry in self.logs if entry.path.name == path.name]
        files = {entry.path.resolve() for entry in same}
        if not files:
            what = "this is a folder that holds no log" if path.is_dir() else "there is no such log"
            raise SceneError(f"{path}: {what}, nor one of this name among those of the scene; check its path")
        if len(files) > 1:
            raise SceneError(f"{path} stands for {len(files)} files of the scene; give the path as the scene has it")
        return same


def _stated(table: Mapping[str, object], without: Sequence[str] = ()) -> Tables:
    """The table without what it does not state; tuples become lists, as in JSON."""
    return {key: to_document(v) for key, v in table.items() if v not in (None, (), {}) and key not in without}


def _with_course(table: Tables, drive: DriveSpeed | None) -> Tables:
    """The table of a rig or a log with the course of its drive as a scene file has it."""
    return table | {"drive_speed": None, "drive": drive.table} if isinstance(drive, Course) else table


def _table_of(spec: ParameterSpec) -> Tables:
    table = _stated(asdict(spec), without=("name", "prior_mean", "prior_sd", "stated"))
    return table | _stated({"prior": _stated({"mean": spec.prior_mean, "sd": spec.prior_sd})})


def _check_consistent(scene: Scene) -> None:
    """Refuse parts of a scene that contradict each other. Raises SceneError."""
    auto = scene.effects == "auto"
    if scene.rig.mass == 0.0 and (auto or "inertia" in scene.effects):
        raise SceneError("mass is 0 kg; expected a positive number: correct it, or take inertia out of effects")
    for entry in scene.logs:
        for name, spec in scene.parameters.items():
            if name in RIG_PARAMETERS and getattr(entry, name) is not None:
                raise SceneError(
                    f"log {entry.path.name} gives its own {name}, but [parameters] estimates one {name} for all logs; "
                    "drop one of the two"
                )
            if spec.per not in (None, EACH_LOG, *entry.labels):
                raise SceneError(
                    f"{name} differs by {spec.per}, but log {entry.path.name} has no such label; give it labels = "
                    f'{{ {spec.per} = "…" }}, or write per = "log"'
                )
    for name in RIG_PARAMETERS:
        bounds, value = scene.parameters.get(name), getattr(scene.rig, name)
        if bounds and not bounds.lower <= value <= bounds.upper:
            raise SceneError(
                f"{name} = {value:g} of [rig] is outside the bounds {bounds.lower:g} to {bounds.upper:g} of "
                "[parameters]; widen them"
            )
    values = scene.values()
    static, kinetic = values["mu_s"], values["mu_k0"]
    change = 0.0 if auto else values.get("delta_mu_k", 0.0)  # which law holds is still open
    if kinetic > static:
        raise SceneError(
            f"mu_k0 = {kinetic:g} is above mu_s = {static:g} (start values, or defaults where none is given); give "
            "[parameters] a start of mu_k0 below that of mu_s, or the same where friction does not age"
        )
    if not kinetic + change > 0.0 or math.isnan(change):
        raise SceneError(
            f"mu_k0 + delta_mu_k = {kinetic + change:g} is the kinetic coefficient at high speed; expected a positive "
            "number: raise one of the two in [parameters]"
        )
