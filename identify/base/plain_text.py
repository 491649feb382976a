"""Text for a terminal of 80 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

WIDTH = 79


def columns(rows: Sequence[Sequence[str]], indent: str = "  ") -> str:
    """Rows of cells as aligned text; the first row is the heading."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = (indent + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)
    return "\n".join(line.rstrip() for line in lines)


def wrapped(text: str, indent: str = "", hang: str = "  ") -> str:
    """Text broken at 79 columns; lines after the first hang further in."""
    return textwrap.fill(text, WIDTH, initial_indent=indent, subsequent_indent=indent + hang)
