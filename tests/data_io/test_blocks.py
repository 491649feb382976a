"""A long text read in blocks of numbers says what it says read line by line, whatever is wrong with it."""

import numpy as np
import pytest

from data_io import LogError
from data_io.source import Request, load
from data_io.table import read_tables

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


def told(path, channels, block):
    try:
        (*tables,), footer = read_tables(load(path), Request(channels=channels), block=block)
    except LogError as error:
        return str(error)
    columns = [{i: values.tobytes() for i, values in table.columns.items()} for table in tables]
    return columns, footer, [sorted((f.code, f.message) for f in table.remarks) for table in tables]


KINDS = (
    "as it is, CRLF, blank lines, blank line above, blanks, long row, long rows below, short row, word, nan, "
    "zero byte, zero bytes, remark, truth, decimal comma, two numbers, empty field, quoted, second header, cut row, "
    "no last line end, zeros at the end"
).split(", ")


@pytest.mark.parametrize("what", KINDS)
@pytest.mark.parametrize("channels", [None, ()])
def test_blocks_change_nothing(tmp_path, lines, what, channels):
    path = tmp_path / "log.csv"
    path.write_bytes(changed(lines, what))
    assert told(path, channels, 1 << 16) == told(path, channels, 1 << 21)


@pytest.mark.parametrize("place", range(50, 60))
def test_points_above_tell_that_a_comma_below_is_no_decimal_mark(tmp_path, lines, place):
    rows = [line.replace(b",", b"\t") for line in lines[:100]]
    rows[place] = rows[place].replace(b".", b",")
    path = tmp_path / "log.txt"
    path.write_bytes(HEADER.replace(b",", b"\t") + b"".join(rows))
    (table,), _ = read_tables(load(path), Request(), block=100)
    assert np.flatnonzero(np.isnan(table.columns[2])).tolist() == [place]
    assert "text_in_rows" in {finding.code for finding in table.remarks}
