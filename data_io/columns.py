"""Which column is time, normal force, friction force: names and units as tribometers write them."""

import functools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from data_io.units import kind_of
from data_io.values import listed

ALIASES: Final[Mapping[str, tuple[str, ...]]] = {
    "time": (
        "time", "t", "timestamp", "elapsed", "elapsedtime", "testtime", "zeit", "xvalue", "czas", "temps", "tiempo",
        "tempo", "steptime", "runtime", "runningtime", "totaltime", "datetime", "dateandtime", "datetimestamp",
        "zeitstempel", "messzeit", "prüfzeit", "sec", "secs", "seconds", "sekunden",
        "时间", "测试时间", "试验时间", "采样时间", "時間", "経過時間", "試験時間",
    ),
    "normal_force": (
        "fz", "normalforce", "fn", "normal", "forcenormal", "fnormal", "fnorm", "verticalforce", "verticalload",
        "downforce", "normalload", "load", "axialforce", "normalkraft", "nominalload",
        "nominalforce", "appliedload", "nacisk", "ballload", "forcenormale", "effortnormal", "charge", "chargenormale",
        "fuerzanormal", "carga", "carganormal", "forzanormale", "carico", "cariconormale", "siłanormalna",
        "silanormalna", "si³anormalna", "obciążenie", "obciazenie", "siłanacisku", "forçanormal", "正压力", "法向力",
        "法向载荷", "载荷", "垂直荷重", "荷重", "法線力", "垂直力", "垂直抗力",
    ),
    "friction_force": (
        "fx", "frictionforce", "friction", "ff", "ft", "fr", "forcefriction", "ffriction", "ffric", "forcetangential",
        "ftangential", "shearforce", "dragforce", "horizontalforce", "tangentialforce", "tangential", "lateralforce",
        "reibkraft", "reibungskraft", "fricforce", "frictionalforce", "tractionforce", "forcedefrottement",
        "frottement", "forcetangentielle", "efforttangentiel", "fuerzadefricción", "fuerzadefriccion",
        "fuerzaderozamiento", "fricción", "rozamiento", "fuerzatangencial", "forzadiattrito", "forzadattrito",
        "attrito", "forzatangenziale", "siłatarcia", "silatarcia", "si³atarcia", "tarcie", "forçadeatrito", "摩擦力",
        "切向力", "水平力", "接線力",
    ),
}  # fmt: skip
"""Names of each role without case, blanks and punctuation; the earlier wins where a file has several."""

COEFFICIENTS: Final = (
    "cof", "mu", "μ", "frictioncoefficient", "coefficientoffriction", "coefoffriction", "coeffoffriction",
    "coefficientfriction", "fricoeff", "friccoeff", "coff", "tractioncoefficient", "tractioncoeff", "reibwert",
    "reibzahl", "reibungszahl", "reibungskoeffizient", "reibkoeffizient", "coefficientdefrottement",
    "coeficientedefricción", "coeficientedefriccion", "coeficientederozamiento", "coefficientediattrito",
    "coefficientedattrito", "współczynniktarcia", "wspolczynniktarcia", "摩擦系数", "摩擦係数", "摩擦因数",
)  # fmt: skip
"""Names of the coefficient of friction, as keys."""

DISTANCES: Final = (
    "distance", "slidingdistance", "testdistance", "totaldistance", "weg", "gleitweg", "reibweg", "laufstrecke",
    "distanceparcourue", "distancia", "distanza", "droga", "drogatarcia", "滑动距离", "滑り距離", "摺動距離",
)  # fmt: skip
_SPEEDS: Final = (
    "speed", "slidingspeed", "velocity", "slidingvelocity", "linearspeed", "v", "geschwindigkeit",
    "gleitgeschwindigkeit", "vitesse", "velocidad", "velocità", "velocita", "prędkość", "predkosc", "速度", "滑动速度",
    "滑り速度",
)  # fmt: skip

_SECONDS: Final = ("sec", "secs", "seconds", "sekunden")  # names that are a unit
_MILLISECONDS: Final = ("ms", "msec", "millisec", "millisecond", "milliseconds", "millisekunden", "millisecondes")

KIND: Final = {"time": "time", "normal_force": "force", "friction_force": "force", "drive_speed": "speed"}
"""Kind of quantity (`units.SI_UNIT`) of each role."""

EXAMPLES: Final = {
    "time": "T, Time or Timestamp",
    "normal_force": "Fz, Normal force or Load",
    "friction_force": "Fx, Ff or Friction force",
}

_LONGEST_SHOWN: Final = 60
_BRACKETS = re.compile(r"(.*?)\s*[(\[{（【]\s*([^()\[\]{}（）【】]*(?:\([^()]*\))?)\s*[)\]}）】]\s*")
_SUFFIX = re.compile(r"(.*[^\s_/,])(?:\s*[_/,]\s*|\s+)([^\s_]+)")  # behind the last of them: normal_force_N


@dataclass(frozen=True)
class Name:
    """A column as its header names it: the raw field, the name without unit, the unit ("" none, None not said)."""

    raw: str
    name: str
    unit: str | None

    @property
    def key(self) -> str:
        """The name without case, blanks, punctuation, and the number that tells columns of one name apart."""
        return _clock_key(_key(self.name))


@dataclass(frozen=True)
class Header:
    """The columns of one table, which of them carry a role (by index), and which others might have (role: indices)."""

    names: tuple[Name, ...]
    roles: Mapping[str, int]
    passed_over: Mapping[str, tuple[int, ...]] = field(default_factory=dict)


@functools.lru_cache(maxsize=4096)
def parse_name(text: str) -> Name:
    """Split `Fx (N)`, `Fx [N]`, `fx_N`, `normal_force_N`, `t / s` into name and unit.

    A unit without brackets is believed only behind a name that is itself a known alias, because `F_N` or `Fx left` say
    something else.
    """
    text = text.strip().strip('"').strip()
    if len(text) > 300:
        return Name(text, text, None)
    plain = " ".join(text.split())
    if again := re.fullmatch(r"(.*[)\]}])(?:\.| Run #?)\d{1,3}", plain):  # Time [s].1 of pandas, Time (s) Run #1
        return replace(parse_name(again[1]), raw=text)
    match = _BRACKETS.fullmatch(plain)
    if match and match[1]:
        return Name(text, match[1].rstrip(" ,_"), match[2].strip())
    match = _SUFFIX.fullmatch(plain)
    if match and role_of(text) is None and (role := role_of(match[1])) is not None:
        unit = match[2].lower() if role == "time" else match[2]  # Time_S
        if kind_of(unit) in ("time", "force"):
            return Name(text, match[1].strip(), unit)
    return Name(text, text, "s" if _key(text) in _SECONDS else None)


@functools.lru_cache(maxsize=4096)
def _key(name: str) -> str:
    name = re.sub(r"\.\d{1,3}$", "", name.strip())  # pandas writes names that stand there twice as Time, Time.1
    name = re.split(r"[.:]", name.split(" - ")[0])[-1]  # Time 1 - default sample rate, DAQ.Fx, Latest: Time
    return re.sub(r"[\W_]+", "", name.casefold())


def _clock_key(key: str) -> str:
    """Return the key of a clock without its number (Time 1, Time 2, t1); that of any other column as it is."""
    plain = key.rstrip("0123456789")
    return plain if plain in ALIASES["time"] else key


def role_of(name: str) -> str | None:
    """Return the role that a column name stands for, None if it is no known alias."""
    key = _clock_key(_key(name))
    return next((role for role in ALIASES if _place(key, role) is not None), None)


@functools.lru_cache(maxsize=4096)
def _place(key: str, role: str) -> int | None:
    """How early a key stands among the names of a role, None if it does not; two of them are one: Normal Force Fz."""
    names = ALIASES[role]
    if key in names:
        return names.index(key)
    pairs = ((key[:i], key[i:]) for i in range(2, len(key) - 1))
    return next((names.index(one) for one, other in pairs if one in names and other in names), None)


def match_header(fields: Sequence[str], wanted: Mapping[str, str]) -> Header:
    """Give roles to columns: those the user named first, the rest by alias. Missing roles are simply absent."""
    return match_names(tuple(parse_name(field) for field in fields), wanted)


def match_names(names: tuple[Name, ...], wanted: Mapping[str, str]) -> Header:
    """Give roles to columns whose names are read already, as `match_header` does."""
    roles: dict[str, int] = {}
    passed_over: dict[str, tuple[int, ...]] = {}
    for role, column in wanted.items():
        index = find_column(names, column)
        if index is not None and role in KIND:
            roles[role] = index
    for role in ALIASES:
        if role in wanted:
            continue
        places = {i: place for i, name in enumerate(names) if (place := _place(name.key, role)) is not None}
        wrong = {i for i in places if (unit := names[i].unit) and kind_of(unit) != KIND[role]}  # these come last
        unmatched = sorted(places.keys() - roles.values(), key=lambda i: (i in wrong, places[i], i))
        if unmatched:
            roles[role] = unmatched[0]
        if len(unmatched) > 1:
            passed_over[role] = tuple(unmatched[1:])
    return Header(names, roles, passed_over)


def with_unit(header: Header, index: int, unit: str) -> Header:
    """Return the header with the unit of one column as the format defines it."""
    names = tuple(replace(name, unit=unit) if i == index else name for i, name in enumerate(header.names))
    return replace(header, names=names)


def find_column(names: Sequence[Name], wanted: str) -> int | None:
    """Return the index of the column a user named: as written in the file, without its unit, without case, by number.

    Numbers count from 1, for names that are unreadable, empty or there twice.
    """
    tests = (
        lambda n: n.raw == wanted,
        lambda n: n.name == wanted,
        lambda n: wanted.strip().casefold() in (n.raw.casefold(), n.name.casefold()),
    )
    for test in tests:
        for index, name in enumerate(names):
            if test(name):
                return index
    number = int(wanted) if wanted.isascii() and wanted.isdigit() and len(wanted) < 6 else 0
    return number - 1 if 0 < number <= len(names) else None


def coefficient_column(header: Header) -> int | None:
    """Return the index of the coefficient of friction, None where a log holds none."""
    return next((i for i, name in enumerate(header.names) if name.key in COEFFICIENTS), None)


def milliseconds_column(header: Header) -> int | None:
    """Return the index of the milliseconds that stand apart from the seconds, None where a log holds none."""
    return next((i for i, name in enumerate(header.names) if name.key in _MILLISECONDS), None)


def distance_columns(header: Header) -> tuple[int, int] | None:
    """Return the indices of the sliding distance and of the sliding speed, None where a log lacks one of them."""
    distance = next((i for i, name in enumerate(header.names) if name.key in DISTANCES), None)
    drive = header.roles.get("drive_speed")
    speed = next((i for i, name in enumerate(header.names) if i == drive or name.key in _SPEEDS), None)
    return None if distance is None or speed is None else (distance, speed)


def role_indices(names: Sequence[Name], wanted: Mapping[str, str]) -> dict[str, int]:
    """Return the roles of columns that carry the project's own names, the user's wishes first."""
    own = {role: next((i for i, name in enumerate(names) if name.name == role), None) for role in KIND}
    requested = {role: find_column(names, column) for role, column in wanted.items() if role in KIND}
    return {role: index for role, index in {**own, **requested}.items() if index is not None}


def shown(names: Iterable[str], most: int = 40) -> str:
    """Return column names for a sentence, however many and however long they are."""
    short = (name if len(name) <= _LONGEST_SHOWN else name[:_LONGEST_SHOWN] + "…" for name in names)
    return listed(map(repr, short), most)


def words(role: str) -> str:
    """Return a role in words for people."""
    return role.replace("_", " ")
