"""A long text read in blocks of numbers says what it says read line by line, whatever is wrong with it."""

import numpy as np
import pytest

from data_io import read_log, segments, table
from data_io.values import LogError

ROWS = 20_000
HEADER = b"time (s),Fz (N),Fx (N)\n"


@pytest.fixture(scope="module")
def lines() -> list[bytes]:
    draw = np.random.default_rng(7)
    forces = draw.normal((2.0, 0.8), 0.01, (ROWS, 2))
    return [b"%.4f,%.6f,%.6f\n" % (0.01 * i, *forces[i]) for i in range(ROWS)]


def changed(lines: list[bytes], what: str) -> bytes:
    rows, middle = list(lines), len(lines) // 2
    if what == "long row":
        rows[middle] = rows[middle][:-1] + b",7.5\n"
    elif what == "long rows below":
        rows[middle:] = [row[:-1] + b",7.5\n" for row in rows[middle:]]
    elif what == "short row":
        rows[middle] = rows[middle].rsplit(b",", 1)[0] + b"\n"
    elif what == "word":
        rows[middle] = b"100.0000,overload,0.8\n"
    elif what == "zero byte":
        rows[middle] = b"100.0000,2.\0000,0.8\n"
    elif what == "zero bytes":
        rows.insert(middle, bytes(500) + b"\n")
    elif what == "remark":
        rows.insert(middle, b"# 100,2.0,0.8\n")
    elif what == "truth":
        rows[middle] = b"100.0000,True,0.8\n"
    elif what == "decimal comma":
        rows[middle:] = [row.replace(b".", b"#").replace(b",", b";").replace(b"#", b",") for row in rows[middle:]]
    elif what == "blanks":
        rows[middle] = b"100.0000, 2.0 ,0.8\n"
    elif what == "two numbers":
        rows[middle] = b"100.0000,2.0 2.1,0.8\n"
    elif what == "nan":
        rows[middle] = b"100.0000,nan,0.8\n"
    elif what == "empty field":
        rows[middle] = b"100.0000,,0.8\n"
    elif what == "quoted":
        rows[middle] = b'100.0000,"2.0","0.8"\n'
    elif what == "second header":
        rows.insert(middle, HEADER)
    elif what == "blank lines":
        rows.insert(middle, b"\n\n")
    elif what == "cut row":
        rows[-1] = rows[-1][:-4]
    elif what == "no last line end":
        rows[-1] = rows[-1][:-1]
    elif what == "zeros at the end":
        rows.append(bytes(500))
    whole = HEADER + b"".join(rows)
    if what == "blank line above":
        whole = b"\n" + whole
    return whole.replace(b"\n", b"\r\n") if what == "CRLF" else whole


def told(path, channels=None):
    try:
        record = read_log(path, channels=channels)
    except LogError as error:
        return str(error), ()
    columns = {name: values.tobytes() for name, values in record.columns().items()}
    return columns, sorted((finding.code, finding.message) for finding in record.findings)


KINDS = (
    "as it is, CRLF, blank lines, blank line above, blanks, long row, long rows below, short row, word, nan, "
    "zero byte, zero bytes, remark, truth, decimal comma, two numbers, empty field, quoted, second header, cut row, "
    "no last line end, zeros at the end"
).split(", ")


@pytest.mark.parametrize("what", KINDS)
@pytest.mark.parametrize("channels", [None, ()])
def test_blocks_change_nothing(tmp_path, monkeypatch, lines, what, channels):
    path = tmp_path / "log.csv"
    path.write_bytes(changed(lines, what))
    monkeypatch.setattr(segments, "AT_ONCE", 1 << 16)
    read_block, taken = table.read_block, []
    monkeypatch.setattr(table, "read_block", lambda *a: taken.append(read_block(*a)) or taken[-1])
    in_blocks = told(path, channels)
    assert sum(numbers is not None for numbers in taken) > 2
    monkeypatch.setattr(table, "read_block", lambda *_: None)
    assert told(path, channels) == in_blocks


def test_a_field_too_many_is_not_dropped_in_silence(tmp_path, lines):
    path = tmp_path / "log.csv"
    path.write_bytes(changed(lines, "long rows below"))
    assert f"line {ROWS // 2 + 2} holds 4 fields" in told(path)[0]


@pytest.mark.parametrize("place", range(50, 60))
def test_points_above_tell_that_a_comma_below_is_no_decimal_mark(tmp_path, monkeypatch, lines, place):
    pieces = [(segments, name) for name in ("TOP", "FIRST", "AT_ONCE", "BLOCK")] + [(table, "FIRST"), (table, "BLOCK")]
    for module, name in pieces:
        monkeypatch.setattr(module, name, 100)
    rows = [line.replace(b",", b"\t") for line in lines[:100]]
    rows[place] = rows[place].replace(b".", b",")
    path = tmp_path / "log.txt"
    path.write_bytes(HEADER.replace(b",", b"\t") + b"".join(rows))
    record = read_log(path)
    assert np.flatnonzero(np.isnan(record.friction_force)).tolist() == [place]
    assert "text_in_rows" in {finding.code for finding in record.findings}
