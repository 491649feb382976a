"""Packed logs: one that unpacks without end is met before its lines are taken apart; one that is cut off is damaged."""

import gzip
import zipfile

import pytest

from data_io import LogError, read_log, table

TABLE = b"T [s],Fx [N],Fz [N]\n" + b"".join(b"%.2f,0.5,3\n" % (0.02 * i) for i in range(60))
ENDLESS = TABLE + b",,\n" * (24 << 20)


@pytest.mark.parametrize("kind", ["gz", "zip"])
def test_a_trap_is_refused_before_its_rows_are_read(tmp_path, monkeypatch, kind):
    path = tmp_path / f"log.csv.{kind}"
    if kind == "gz":
        path.write_bytes(gzip.compress(ENDLESS))
    else:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("log.csv", ENDLESS)
    monkeypatch.setattr(table, "read_numbers", lambda *_: pytest.fail("rows were read"))
    with pytest.raises(LogError, match="unpacks to more than 100 times its size"):
        read_log(path)


def test_a_packed_log_that_is_cut_off_is_damaged_whatever_its_end_states(tmp_path):
    whole = gzip.compress(TABLE, 1)
    (tmp_path / "log.csv.gz").write_bytes(whole[: len(whole) // 2] + b"\xff\xff\xff\xff")
    with pytest.raises(LogError, match="damaged"):
        read_log(tmp_path / "log.csv.gz")
    (tmp_path / "log.csv.gz").write_bytes(whole)
    assert len(read_log(tmp_path / "log.csv.gz")) == 60
