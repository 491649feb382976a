"""Logs drawn by Hypothesis: any bytes, small logs broken byte by byte, and tables in any layout with their truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

from hypothesis import strategies as st

from experiments.lookalikes import Made
from experiments.mutations import bytes_changed

GOOD = "T,Fx,Fz\ns,N,N\n" + "".join(f"{i / 100},{i % 7},3\n" for i in range(40))
CETR = (
    "Created by CETR UMT\nRun # 1\nStep No. 1\nData Count = 40\n" + GOOD + "\nStep No. 2\nStarted at: 12:00:00\n" + GOOD
)
SEMICOLON = "Zeit [s];Reibkraft [mN];Normalkraft [N]\n" + "".join(f"0,{i:03d};1,5;3,0\n" for i in range(40))
SMALL = (GOOD, CETR, SEMICOLON)

ALPHABET = 'T,Fxz;\t\n0123456789.-+eE"# sN[]()µ/_'
ANY = st.one_of(st.binary(max_size=300), st.text(alphabet=ALPHABET, max_size=300).map(str.encode))
"""Any bytes, and texts of the letters that logs are made of."""

SEPARATORS = {",": ".", ";": ".,", "\t": ".,", "   ": ".,"}
NAMES = {
    "time": ("T", "Time", "Zeit", "timestamp"),
    "normal_force": ("Fz", "Fn", "Normal force", "Load"),
    "friction_force": ("Fx", "Friction force", "Ft", "Reibkraft"),
}
UNITS: Mapping[str, Mapping[str, Fraction]] = {
    "time": {"s": Fraction(1), "ms": Fraction(1, 1000), "min": Fraction(60)},
    "normal_force": {"N": Fraction(1), "mN": Fraction(1, 1000), "gf": Fraction("0.00980665")},
    "friction_force": {"N": Fraction(1), "uN": Fraction(1, 10**6), "kgf": Fraction("9.80665")},
}
ROLES = tuple(NAMES)


def broken() -> st.SearchStrategy[bytes]:
    """One of the small logs with a few places changed, put in, taken out or repeated."""
    drawn = st.randoms(use_true_random=False)
    return st.builds(lambda data, draw: bytes_changed(data.encode(), draw), st.sampled_from(SMALL), drawn)


@st.composite
def tables(draw: st.DrawFn) -> Made:
    """A sound table: any numbers, names, units, order of columns, delimiter, decimal mark, line end and encoding."""
    separator = draw(st.sampled_from(sorted(SEPARATORS)))
    decimal = draw(st.sampled_from(SEPARATORS[separator]))
    count = draw(st.integers(2, 12))
    columns = {
        "time": _rising(draw, count),
        "normal_force": _numbers(draw, count, draw(st.sampled_from([(1e-3, 1e6), (-1e6, -1e-3)]))),
        "friction_force": _numbers(draw, count, (-1e6, 1e6)),
        "idle": _numbers(draw, count, (-1e9, 1e9)),
    }
    order = draw(st.permutations(list(columns)))
    units = {role: draw(st.sampled_from(sorted(UNITS[role]))) for role in ROLES}
    ends = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    head = _head(draw, order, units, separator)
    rows = [separator.join(cells) for cells in zip(*(columns[name] for name in order), strict=True)]
    text = ends.join([*head, *(row.replace(".", decimal) for row in rows), ""])
    t, fz, fx = ([Fraction(cell) * UNITS[role][units[role]] for cell in columns[role]] for role in ROLES)
    data = text.encode(draw(st.sampled_from(["utf-8", "utf-8-sig", "cp1252", "utf-16"])))
    return Made(data, tuple(t), tuple(abs(load) for load in fz), tuple(fx))


def _numbers(draw: st.DrawFn, count: int, span: tuple[float, float]) -> list[str]:
    """Numbers as programmes write them: so many decimals, with an exponent, or the shortest that tell the float."""
    values = [draw(st.floats(*span, allow_subnormal=False)) for _ in range(count)]
    form = draw(st.sampled_from(["repr", "f", "e"]))
    digits = draw(st.integers(1, 12))
    if form == "repr":
        return [repr(value) for value in values]
    cells = [f"{value:.{digits}{form}}" for value in values]
    # a load that is written as 0.0 presses no more
    return cells if all(float(cell) for cell in cells) else [repr(value) for value in values]


def _rising(draw: st.DrawFn, count: int) -> list[str]:
    digits = draw(st.integers(0, 6))
    time, cells = draw(st.integers(0, 10**7)), []
    for _ in range(count):
        cells.append(f"{time}" if digits == 0 else f"{time // 10**digits}.{time % 10**digits:0{digits}d}")
        time += draw(st.integers(1, 10**4))
    return cells


def _head(draw: st.DrawFn, order: Sequence[str], units: Mapping[str, str], separator: str) -> list[str]:
    """The row of names, its units in brackets or in a row below; perhaps words above."""
    names = {role: draw(st.sampled_from(NAMES[role])) for role in ROLES} | {"idle": "Z"}
    words = draw(st.sampled_from([[], ["Operator: N. N."], ["Prüfstand 7", ""], ["12.05.2022", "first try", ""]]))
    if draw(st.booleans()):
        return [*words, separator.join(f"{names[name]} [{units.get(name, 'mm')}]" for name in order)]
    return [*words, separator.join(names[n] for n in order), separator.join(units.get(n, "mm") for n in order)]
