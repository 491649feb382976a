"""Logs drawn at random: any bytes, small logs broken byte by byte, and tables in any layout with their truth."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction

from experiments.lookalikes import Made
from experiments.mutations import bytes_changed

GOOD = "T,Fx,Fz\ns,N,N\n" + "".join(f"{i / 100},{i % 7},3\n" for i in range(40))
CETR = (
    "Created by CETR UMT\nRun # 1\nStep No. 1\nData Count = 40\n" + GOOD + "\nStep No. 2\nStarted at: 12:00:00\n" + GOOD
)
SEMICOLON = "Zeit [s];Reibkraft [mN];Normalkraft [N]\n" + "".join(f"0,{i:03d};1,5;3,0\n" for i in range(40))
ALPHABET = 'T,Fxz;\t\n0123456789.-+eE"# sN[]()µ/_'
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


def anything(draw: random.Random) -> bytes:
    """Any bytes, or a text of the letters that logs are made of."""
    if draw.random() < 0.5:
        return draw.randbytes(draw.randrange(300))
    return "".join(draw.choices(ALPHABET, k=draw.randrange(300))).encode()


def broken(draw: random.Random) -> bytes:
    """One of three small logs with a few places changed, put in, taken out or repeated."""
    return bytes_changed(draw.choice((GOOD, CETR, SEMICOLON)).encode(), draw)


def table(draw: random.Random) -> Made:
    """A sound table: any numbers, names, units, order of columns, delimiter, decimal mark, line end and encoding."""
    separator, count = draw.choice(list(SEPARATORS)), draw.randint(2, 12)
    columns = {
        "time": _rising(draw, count),
        "normal_force": _numbers(draw, count, (-3, 6), (draw.choice((-1.0, 1.0)),)),
        "friction_force": _numbers(draw, count, (-300, 6), (-1.0, 0.0, 1.0)),
        "idle": _numbers(draw, count, (-300, 9), (-1.0, 0.0, 1.0)),
    }
    order = draw.sample(list(columns), len(columns))
    units = {role: draw.choice(list(of_role)) for role, of_role in UNITS.items()}
    decimal, end = draw.choice(SEPARATORS[separator]), draw.choice(("\n", "\r\n", "\r"))
    rows = [separator.join(cells) for cells in zip(*(columns[name] for name in order), strict=True)]
    text = end.join([*_head(draw, order, units, separator), *(row.replace(".", decimal) for row in rows), ""])
    t, fz, fx = ([Fraction(cell) * UNITS[role][units[role]] for cell in columns[role]] for role in UNITS)
    data = text.encode(draw.choice(("utf-8", "utf-8-sig", "cp1252", "utf-16")))
    return Made(data, tuple(t), tuple(abs(load) for load in fz), tuple(fx))


DRAWS: Sequence[Callable[[random.Random], bytes | Made]] = (anything, broken, table)


def _numbers(draw: random.Random, count: int, powers: tuple[int, int], signs: Sequence[float]) -> list[str]:
    """Numbers as programmes write them: so many decimals, with an exponent, or the shortest that tell the float."""
    least = powers[0] if draw.random() < 0.3 else max(powers[0], -3)
    values = [draw.choice(signs) * math.pow(10.0, draw.uniform(least, powers[1])) for _ in range(count)]
    form, digits = draw.choice(("repr", "f", "e")), draw.randint(1, 12)
    if form != "repr":
        cells = [f"{value:.{digits}{form}}" for value in values]
        if all(float(cell) for cell in cells):  # a load that is written as 0.0 presses no more
            return cells
    return [repr(value) for value in values]


def _rising(draw: random.Random, count: int) -> list[str]:
    digits, time, cells = draw.randint(0, 6), draw.randint(0, 10**7), []
    for _ in range(count):
        cells.append(f"{time}" if digits == 0 else f"{time // 10**digits}.{time % 10**digits:0{digits}d}")
        time += draw.randint(1, 10**4)
    return cells


def _head(draw: random.Random, order: Sequence[str], units: Mapping[str, str], separator: str) -> list[str]:
    """The row of names, its units in brackets or in a row below; perhaps words above."""
    names = {role: draw.choice(of_role) for role, of_role in NAMES.items()} | {"idle": "Z"}
    words = draw.choice(([], ["Operator: N. N."], ["Prüfstand 7", ""], ["12.05.2022", "first try", ""]))
    if draw.random() < 0.5:
        return [*words, separator.join(f"{names[name]} [{units.get(name, 'mm')}]" for name in order)]
    return [*words, separator.join(names[n] for n in order), separator.join(units.get(n, "mm") for n in order)]
