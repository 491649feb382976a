"""Bytes to text to fields: encodings, line ends, delimiters, number tokens. Knows nothing of columns or formats."""

import codecs
import csv
import re
from typing import Final

BLANKS: Final = r"\s+"
"""The delimiter of columns that stand apart by blanks, as pandas writes it."""

DELIMITERS: Final = ("\t", ";", ",", BLANKS)

MISSING: Final = frozenset((
    "", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "<na>", "-nan", "+nan",
    "1.#ind", "-1.#ind", "1.#qnan", "-1.#qnan", "1.#inf", "-1.#inf", "inf", "-inf", "+inf", "infinity", "-infinity",
))  # fmt: skip
"""What programs write where they have no number, in lower case."""

# a line is text unless its first field that is not empty begins like a number or a missing number
TEXT_LINE: Final = re.compile(
    r'\n(?![ \t",;]*+(?:[+-]?(?:\.?\d|\.\#)|[+-]?(?:nan|inf|infinity)\b|\n|\Z))', re.IGNORECASE
)
# possessive: of 10,000 digits that are no number each is looked at once
_NUMBER = re.compile(r"[+-]?(?:\d++\.?\d*+|\.\d++)(?:[eEdD][+-]?\d++)?")
_IN_GROUPS: Final = {
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?"),
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+,\d*"),
}
"""Numbers with marks between thousands, by their decimal mark; without a decimal part only a comma is believed."""
_EASTERN: Final = (
    "时间", "摩擦", "法向", "压力", "载荷", "位移", "速度", "時間", "荷重", "垂直", "変位", "摺動", "滑り",
)  # fmt: skip
"""Words by which a text in an encoding of China or Japan is told."""
_BOMS: Final = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")


def _as_cp1252(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeDecodeError)
    wrong = error.object[error.start : error.end]
    return wrong.decode("cp1252", errors="replace"), error.end


# byte by byte, because exports mix: a UTF-8 header below a preamble in the code page of the machine
codecs.register_error("data_io.cp1252", _as_cp1252)


def looks_like_text(head: bytes) -> bool:
    """Tell text from binary by the first bytes: a Unicode mark, or hardly any control characters and some print."""
    if any(head.startswith(mark) for mark, _ in _BOMS):
        return True
    head = head.rstrip(b"\0")  # space reserved and never written
    return len(head) > 0 and len(_CONTROL.findall(head)) <= len(head) // 200 and b"\0\0" not in head


def other_encoding(head: bytes) -> str | None:
    """Name the encoding of a text by its first bytes, None for UTF-8 and what is near it.

    UTF-16 by its mark; GB 18030 or Shift JIS where the bytes are no UTF-8 and hold words that logs have in them.
    """
    if any(head.startswith(mark) for mark, _ in _BOMS):
        return next((name for mark, name in _BOMS if name != "utf-8" and head.startswith(mark)), None)
    if head.isascii() or _is_utf8(head):
        return None
    top = head[: head.find(b"\n", len(head) // 2) + 1 or len(head)]
    for encoding in ("gb18030", "cp932"):
        text = top.decode(encoding, errors="replace")
        if any(word in text for word in _EASTERN) and "\ufffd" not in text:
            return encoding
    return None


def _is_utf8(head: bytes) -> bool:
    try:
        head[: max(len(head) - 3, 0)].decode("utf-8")
    except UnicodeDecodeError as error:
        return len(head) - error.start < 8  # a letter that the end cuts
    return True


def decode(data: bytes, start: bool = True) -> str:
    """Decode by byte-order mark (at the start of a log), else UTF-8 with single bytes of cp1252; line ends: newline."""
    for mark, encoding in _BOMS if start else ():
        if data.startswith(mark):
            text = data[len(mark) :].decode(encoding, errors="data_io.cp1252" if encoding == "utf-8" else "replace")
            break
    else:
        text = data.rstrip(b"\0").decode("utf-8", errors="data_io.cp1252")
    text = text.replace("\u2212", "-") if "\u2212" in text else text
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def split(line: str, delimiter: str) -> list[str]:
    """Split one line into stripped fields; quotes protect delimiters."""
    line = line.strip("\n")
    if delimiter == BLANKS:
        return line.split()
    if '"' not in line:
        return [field.strip() for field in line.split(delimiter)]
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:
        return [field.strip().strip('"') for field in line.split(delimiter)]


def is_number(token: str, decimal: str = ".") -> bool:
    """Tell whether a field is one number written with this decimal mark, perhaps with the other between thousands."""
    if "," in token and "." in token:
        return _IN_GROUPS[decimal].fullmatch(token) is not None
    if decimal == ",":
        if "." in token:
            return False
        token = token.replace(",", ".")
    return _NUMBER.fullmatch(token) is not None


def is_number_like(token: str) -> bool:
    """Tell whether a field is a number with either decimal mark, or a missing number."""
    return is_number(token) or is_number(token, ",") or token.lower() in MISSING


def to_number(token: str, decimal: str) -> float | None:
    """Return the number in a field, NaN where it says missing, None where it is something else."""
    token = token.strip().strip('"').strip()
    if token.lower() in MISSING:
        return float("nan")
    if ("," in token and "." in token) or (decimal == "." and "," in token):
        grouped = _IN_GROUPS[decimal].fullmatch(token) is not None
        token = token.replace("." if decimal == "," else ",", "") if grouped else ""
    if not is_number(token, decimal):
        return None
    return float(token.replace(",", ".").replace("d", "e").replace("D", "e"))


def line_number(text: str, position: int) -> int:
    """Return the number of the line, from 1, that holds a position of the text."""
    return text.count("\n", 0, position) + 1
