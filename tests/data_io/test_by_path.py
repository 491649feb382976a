"""A long text read by its path says what it says read line by line, whatever is wrong with it."""

import numpy as np
import pytest

from data_io import read_log, rows, table
from data_io.values import LogError

ROWS = 330_000
HEADER = b"time (s),Fz (N),Fx (N)\n"


@pytest.fixture(scope="module")
def lines() -> list[bytes]:
    draw = np.random.default_rng(7)
    forces = draw.normal((2.0, 0.8), 0.01, (ROWS, 2))
    return [b"%.4f,%.6f,%.6f\n" % (0.001 * i, *forces[i]) for i in range(ROWS)]


def changed(lines: list[bytes], what: str) -> bytes:
    rows, middle = list(lines), len(lines) // 2
    if what == "long row":
        rows[middle] = rows[middle][:-1] + b",7.5\n"
    elif what == "long rows below":
        rows[middle:] = [row[:-1] + b",7.5\n" for row in rows[middle:]]
    elif what == "short row":
        rows[middle] = rows[middle].rsplit(b",", 1)[0] + b"\n"
    elif what == "word":
        rows[middle] = b"165.0000,overload,0.8\n"
    elif what == "zero byte":
        rows[middle] = b"165.0000,2.\0000,0.8\n"
    elif what == "zero bytes":
        rows.insert(middle, bytes(500) + b"\n")
    elif what == "remark":
        rows.insert(middle, b"# 165,2.0,0.8\n")
    elif what == "truth":
        rows[middle] = b"165.0000,True,0.8\n"
    elif what == "decimal comma":
        rows[middle:] = [row.replace(b".", b"#").replace(b",", b";").replace(b"#", b",") for row in rows[middle:]]
    elif what == "blanks":
        rows[middle] = b"165.0000, 2.0 ,0.8\n"
    elif what == "two numbers":
        rows[middle] = b"165.0000,2.0 2.1,0.8\n"
    elif what == "nan":
        rows[middle] = b"165.0000,nan,0.8\n"
    elif what == "empty field":
        rows[middle] = b"165.0000,,0.8\n"
    elif what == "quoted":
        rows[middle] = b'165.0000,"2.0","0.8"\n'
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


def told(path):
    try:
        record = read_log(path)
    except LogError as error:
        return str(error), ()
    columns = {name: values.tobytes() for name, values in record.columns().items()}
    return columns, sorted((finding.code, finding.message) for finding in record.findings)


SOUND = ("as it is", "CRLF", "blank lines", "blank line above", "blanks")
BROKEN = (
    *(
        "long row",
        "long rows below",
        "short row",
        "word",
        "nan",
        "zero byte",
        "zero bytes",
        "remark",
        "truth",
        "decimal comma",
        "two numbers",
        "empty field",
        "quoted",
        "second header",
        "cut row",
    ),
    *("no last line end", "zeros at the end"),
)


@pytest.mark.parametrize("what", SOUND + BROKEN)
def test_the_path_changes_nothing(tmp_path, monkeypatch, lines, what):
    path = tmp_path / "log.csv"
    path.write_bytes(changed(lines, what))
    taken = []
    read_rest = table.read_rest
    monkeypatch.setattr(table, "read_rest", lambda *a: taken.append(read_rest(*a)) or taken[-1])
    by_its_path = told(path)
    assert any(numbers is not None for numbers in taken) is (what in SOUND)
    monkeypatch.setattr(rows, "LEAST", 1 << 40)
    assert told(path) == by_its_path


def test_a_field_too_many_is_not_dropped_in_silence(tmp_path, monkeypatch, lines):
    path = tmp_path / "log.csv"
    path.write_bytes(changed(lines, "long rows below"))
    assert "holds 4 fields" in told(path)[0]
    monkeypatch.setattr(table, "read_rest", lambda source, lines, head, decimal: None)
    assert "holds 4 fields" in told(path)[0]


def test_a_file_with_words_here_and_there_is_handed_over_once(tmp_path, monkeypatch, lines):
    log_rows = list(lines)
    for at in range(40_000, ROWS, 40_000):
        log_rows[at] = b"%.4f,overload,0.8\n" % (0.001 * at)
    path = tmp_path / "log.csv"
    path.write_bytes(HEADER + b"".join(log_rows))
    monkeypatch.setattr(rows, "LEAST", 1 << 16)
    read_path, asked = rows.read_path, []
    monkeypatch.setattr(rows, "read_path", lambda *a: asked.append(a[1]) or read_path(*a))
    assert told(path)[0]
    assert len(asked) == 1
