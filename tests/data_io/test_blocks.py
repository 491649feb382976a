"""A long text read in blocks of numbers says what it says read line by line, whatever is wrong with it."""

import numpy as np
import pytest

from data_io import LogError
from data_io.source import Request, load
from data_io.table import read_tables

ROWS = 8_000
HEADER = b"time (s),Fz (N),Fx (N)\n"


@pytest.fixture(scope="module")
def lines() -> list[bytes]:
    draw = np.random.default_rng(7)
    forces = draw.normal((2.0, 0.8), 0.01, (ROWS, 2))
    return [b"%.4f,%.6f,%.6f\n" % (0.01 * i, *forces[i]) for i in range(ROWS)]


MIDDLE = ROWS // 2
ONE_ROW = {
    "word": b"100.0000,overload,0.8\n",
    "zero byte": b"100.0000,2.\0000,0.8\n",
    "truth": b"100.0000,True,0.8\n",
    "blanks": b"100.0000, 2.0 ,0.8\n",
    "two numbers": b"100.0000,2.0 2.1,0.8\n",
    "nan": b"100.0000,nan,0.8\n",
    "empty field": b"100.0000,,0.8\n",
    "quoted": b'100.0000,"2.0","0.8"\n',
    "long row": b"100.0000,2.0,0.8,7.5\n",
    "short row": b"100.0000,2.0\n",
}
MORE = {"zero bytes": bytes(500) + b"\n", "remark": b"# 100,2.0,0.8\n", "second header": HEADER, "blank lines": b"\n\n"}
BELOW = {
    "long rows below": lambda row: row[:-1] + b",7.5\n",
    "decimal comma": lambda row: row.translate(bytes.maketrans(b".,", b",;")),
}
WHOLE = {
    "as it is": lambda text: text,
    "CRLF": lambda text: text.replace(b"\n", b"\r\n"),
    "blank line above": lambda text: b"\n" + text,
    "cut row": lambda text: text[:-4],
    "no last line end": lambda text: text[:-1],
    "zeros at the end": lambda text: text + bytes(500),
}


def changed(lines: list[bytes], what: str) -> bytes:
    rows = list(lines)
    if what in BELOW:
        rows[MIDDLE:] = map(BELOW[what], rows[MIDDLE:])
    elif what not in WHOLE:
        rows[MIDDLE : MIDDLE + (what in ONE_ROW)] = [ONE_ROW.get(what) or MORE[what]]
    return WHOLE.get(what, bytes)(HEADER + b"".join(rows))


def told(path, channels, block):
    try:
        (*tables,), footer = read_tables(load(path), Request(channels=channels), block=block)
    except LogError as error:
        return str(error)
    columns = [{i: values.tobytes() for i, values in table.columns.items()} for table in tables]
    return columns, footer, [sorted((f.code, f.message) for f in table.remarks) for table in tables]


@pytest.mark.parametrize("what", [*WHOLE, *BELOW, *MORE, *ONE_ROW])
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


@pytest.mark.parametrize(
    ("late", "rows"),
    [(b"1000,2.0,0.8\r\n1001,2.0,0.8\r1002,2.0,0.9\n", 3), (b"pause of 5 \xb5s\n1000,2.0,0.8\n", 1),
     (b"1000,2.0,1'000.5\n1001,2.0,0.8\n", 2), (b"1000,2.0,\xe2\x88\x920.8\n1001,2.0,0.8\n", 2), (bytes(500), 0)],
)  # fmt: skip
def test_what_is_no_plain_text_far_below_is_read_as_near_the_top(tmp_path, lines, late, rows):
    """A letter beyond ASCII above the header has all of the text brought into UTF-8 at once."""
    found = []
    for above in (b"# um\n", "# µm\n".encode()):
        (tmp_path / "log.csv").write_bytes(above + HEADER + b"".join(lines) * 6 + late)
        found.append(told(tmp_path / "log.csv", None, 1 << 16))
    assert found[0] == found[1] and len(np.frombuffer(found[0][0][0][2])) == 6 * ROWS + rows
