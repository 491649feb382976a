"""Text from logs and labels made harmless: for pages, tables of spreadsheets, LaTeX; numbers stay numbers."""

from __future__ import annotations

import math
import re
import unicodedata

SHOWN = 80  # characters of a label on a page
CELL = 2000  # characters of a cell; Excel takes 32,767
FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "|", "%", "＝", "＋", "－", "＠")
LATEX = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "$": r"\$",
    "&": r"\&",
    "#": r"\#",
    "_": r"\_",
    "%": r"\%",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "μ": r"\ensuremath{\mu}",
    "µ": r"\ensuremath{\mu}",
    "Δ": r"\ensuremath{\Delta}",
    "−": r"\ensuremath{-}",
    "·": r"\ensuremath{\cdot}",
    "–": "--",
    "…": r"\ldots{}",
    "\N{NO-BREAK SPACE}": "~",
}


def visible(text: str, most: int = SHOWN) -> str:
    """One line of at most `most` characters: control characters, line ends and marks that turn the direction of
    reading become a visible sign; what is cut off is said."""
    shown = "".join(_sign(c) for c in text[: 4 * most])
    shown = re.sub(r" +", " ", shown).strip()
    if len(shown) <= most and len(text) <= 4 * most:
        return shown
    return f"{shown[:most].rstrip()}… ({len(text)} characters)"


def brief(text: str, most: int) -> str:
    """The same in a drawing, where there is no room to say how much was cut off."""
    shown = visible(text, 4 * most)
    return shown if len(shown) <= most else f"{shown[: most - 1].rstrip()}…"


def _sign(character: str) -> str:
    if character in "\n\r\t\v\f\x85\u2028\u2029":
        return " "
    # Cc, Cf, Cs, Co, Cn: controls, marks of direction, halves of characters, what nobody has defined
    return "\N{REPLACEMENT CHARACTER}" if unicodedata.category(character)[0] == "C" else character


def cell(value: object) -> str | float | int | None:
    """A cell of a CSV file or a sheet: a number as it is, text one line long that no program takes for a formula."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return None
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return int(value) if isinstance(value, int) else float(value)
    text = visible(str(value), CELL)
    return f"'{text}" if text.startswith(FORMULA) else text


def latex(text: str) -> str:
    """Text for LaTeX (inputenc utf8, fontenc T1): special characters escaped, what the fonts lack as "?"."""
    return "".join(_latex(c) for c in visible(text))


def _latex(character: str) -> str:
    if character in LATEX:
        return LATEX[character]
    return character if character.isprintable() and ord(character) < 0x180 else "?"
