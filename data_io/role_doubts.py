"""A role that a column got by its name alone, while another column does the job: asked, with both named."""

import re
from typing import Final

import numpy as np

from data_io.columns import ALIASES, shown
from data_io.errors import UnitError
from data_io.frozen import LARGEST_FORCE, FloatArray
from data_io.part import Part
from data_io.source import Request, Source
from data_io.thinned import thinned, thinned_steps
from data_io.units import factor

_AXIS: Final = re.compile(r"(f|force|kraft)[xy]|[xy](force|kraft)?")
"""Keys of columns along the surface, of which one holds the friction force and the other hardly anything."""
_STILL: Final = 1.5
"""Standard deviations of its white noise up to which a column stands still."""
_MOVES: Final = 3.0
"""Standard deviations of its white noise from which a column moves."""
_FAR: Final = 5.0
"""By how much more the other column moves than the one that was taken."""
_FEWEST: Final = 50


class _Look:
    """What a column of force looks like [N]: its ends but for few rows, median size, scatter, white noise in it."""

    def __init__(self, values: FloatArray, scale: float) -> None:
        few, steps = scale * thinned(values), scale * thinned_steps(values)
        few, steps = few[np.abs(few) <= LARGEST_FORCE], steps[np.abs(steps) <= LARGEST_FORCE]
        low, high = np.quantile(few, [0.025, 0.975]) if few.size else (0.0, 0.0)
        self.low, self.high = float(low), float(high)
        self.size = max(abs(self.low), abs(self.high))
        self.level = float(np.median(np.abs(few))) if few.size else 0.0
        self.scatter = (self.high - self.low) / 3.92
        self.noise = float(np.sqrt(np.mean(steps**2) / 2.0)) if steps.size else 0.0

    @property
    def still(self) -> bool:
        """Whether nothing but white noise is there."""
        return self.scatter <= _STILL * self.noise or self.scatter == 0.0

    @property
    def moves(self) -> bool:
        """Whether more than white noise is there."""
        return self.scatter > _MOVES * self.noise > 0.0


def refuse_doubtful_roles(source: Source, request: Request, part: Part) -> None:
    """Ask where the friction force stands still and another force along the surface moves, or the load does instead.

    What the user named is not doubted. Raises the source's `LogError` with both names.
    """
    roles = part.header.roles
    index = roles.get("friction_force")
    if index is None or "friction_force" in request.columns or part.rows < _FEWEST or index not in part.columns:
        return
    names = part.header.names
    rivals = [
        i
        for i, name in enumerate(names)
        if i != index and i in part.columns and i != roles.get("normal_force")
        and (name.key in ALIASES["friction_force"] or _AXIS.fullmatch(name.key))
    ]  # fmt: skip
    load = None if request.normal_force is not None else roles.get("normal_force")
    if not rivals and load is None:
        return
    taken = _look(request, part, index, "friction_force")
    if taken is None or not taken.still:
        return
    for i in rivals:
        other = _look(request, part, i, "friction_force")
        if other is not None and other.moves and other.scatter > _FAR * taken.scatter and other.level > 2 * taken.level:
            raise source.error(
                f"{shown([names[index].raw])} is called as the friction force and stands still at {taken.level:.3g} N, "
                f"while {shown([names[i].raw])} moves from {other.low:.3g} to {other.high:.3g} N; one friction force "
                "was "
                f"expected; say which with --columns friction_force={names[i].name} or "
                f"friction_force={names[index].name}"
            )
    normal = None if load is None else _look(request, part, load, "normal_force")
    if load is None or normal is None or not normal.moves or taken.size <= normal.size:
        return
    if normal.scatter * taken.level > _FAR * taken.scatter * normal.level:
        raise source.error(
            f"{shown([names[index].raw])} is called as the friction force and stands still at {taken.level:.3g} N, "
            "while "
            f"{shown([names[load].raw])}, called as the normal force, moves from {normal.low:.3g} to "
            f"{normal.high:.3g} N; "
            "the two may be swapped; say which is which with --columns "
            f"friction_force={names[load].name},normal_force={names[index].name} or the other way round"
        )


def _look(request: Request, part: Part, index: int, role: str) -> _Look | None:
    """Return what a column of force looks like; None where its unit is none of force."""
    name = part.header.names[index]
    own = request.units.get(role) if part.header.roles.get(role) == index else None
    unit = own or request.units.get(name.name) or name.unit or _unit_of_friction(request, part)
    try:
        return _Look(part.columns[index], factor(unit, "N"))
    except UnitError:
        return None


def _unit_of_friction(request: Request, part: Part) -> str:
    name = part.header.names[part.header.roles["friction_force"]]
    return request.units.get("friction_force") or request.units.get(name.name) or name.unit or ""
