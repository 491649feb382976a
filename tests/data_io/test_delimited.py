"""Plain delimited text in the many ways laboratories write it; every variant holds the same numbers."""

import time
from pathlib import Path

import numpy as np
import pytest

from data_io import LogError, read_log

N = 12
TIME = np.arange(N) / 100
FRICTION = 0.5 + 0.01 * np.arange(N)
MEASURED = Path(__file__).resolve().parents[3] / "shared" / "data" / "paper_on_paper"


def rows(sep=",", dec=".", end="\n", tail="", wrap="", lead=""):
    lines = (sep.join(f"{wrap}{v:.4f}{wrap}" for v in row) for row in zip(TIME, FRICTION, np.full(N, 3.0), strict=True))
    return "".join(lead + line.replace(".", dec) + tail + end for line in lines)


def read(tmp_path, content, **options):
    path = tmp_path / "log.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_log(path, **options)


UNITS_ROW = "T,Fx,Fz\ns,N,N\n"
VARIANTS = {
    "comma": UNITS_ROW + rows(),
    "semicolon": "T;Fx;Fz\ns;N;N\n" + rows(";"),
    "tab": "T\tFx\tFz\ns\tN\tN\n" + rows("\t"),
    "blanks": "T  Fx   Fz\ns  N   N\n" + rows("   "),
    "names with blanks": "Test time [s]   Friction force [N]   Normal force [N]\n" + rows("  "),
    "brackets behind blanks": "Time [s] Fx [N] Fz [N]\n" + rows(" "),
    "parentheses": "Time (s),DAQ.Fx (N),DAQ.Fz (N)\n" + rows(),
    "suffix": "t_s,fx_N,fz_N\n" + rows(),
    "suffix of words": "time_s,friction_force_N,normal_force_N\n" + rows(),
    "slash": "t / s;F_R / N;F_N / N\n" + rows(";"),
    "decimal comma and semicolon": "Zeit [s];Reibkraft [N];Normalkraft [N]\n" + rows(";", ","),
    "decimal comma and tab": "Time [s]\tFx [N]\tFz [N]\n" + rows("\t", ","),
    "decimal comma and blanks": "Time [s]  Fx [N]  Fz [N]\n" + rows("  ", ","),
    "units in brackets below": "Time,Friction,Load\n[s],[N],[N]\n" + rows(),
    "commented header": "# T (s), Fx (N), Fz (N)\n" + rows(" "),
    "quoted": '"T","Fx","Fz"\n"s","N","N"\n' + rows(wrap='"'),
    "blank line below the units": "T,Fx,Fz\ns,N,N\n\n" + rows(),
    "preamble": "Operator: N. N.\nLoad 3 N; time 12:00\n\n" + UNITS_ROW + rows(),
    "words that look like a header": "Operator, time, load\nforce over time  of load\n" + UNITS_ROW + rows(),
    "names of the channels above": "Time, Friction, Load\n" + UNITS_ROW + rows(),
    "footer": UNITS_ROW + rows() + "TotalTime\n00:12:56.5661021\n",
    "trailing delimiter": "T,Fx,Fz,\ns,N,N,\n" + rows(tail=","),
    "padding rows of a spreadsheet": UNITS_ROW + rows() + ",,\n" * 20,
    "no newline at the end": UNITS_ROW + rows().rstrip("\n"),
    "crlf": (UNITS_ROW + rows()).replace("\n", "\r\n"),
    "lone cr": (UNITS_ROW + rows()).replace("\n", "\r"),
    "mixed line ends": UNITS_ROW.replace("\n", "\r") + rows(end="\r\n"),
    "byte-order mark": "\ufeff" + UNITS_ROW + rows(),
    "utf-16": (UNITS_ROW + rows()).encode("utf-16"),
    "cp1252": "Winkel [°];T [s];Fx [N];Fz [N]\n".encode("cp1252") + rows(";", end="\n", lead="7;").encode(),
    "real minus sign": UNITS_ROW + rows().replace("3.0000", "\u22123.0000"),
    "index column": ",time,Fx,Fz\n,s,N,N\n" + "".join(f"{i},{row}\n" for i, row in enumerate(rows().split())),
    "exponents": UNITS_ROW + rows().replace("3.0000", "3.0E+00"),
    "names that people give": "seconds,tangential_N,normal_load_N\n" + rows(),
    "words of direction": "time_s,force_tangential_N,force_normal_N\n" + rows(),
    "short words": "Time (s),Ffric (N),Fnorm (N)\n" + rows(),
    "horizontal and vertical": "Time (s),Horizontal force (N),Vertical load (N)\n" + rows(),
    "a temperature called T": "T [°C],Time [s],Fx [N],Fz [N]\n" + rows(lead="20,"),
    "reserved space behind": (UNITS_ROW + rows()).encode() + bytes(4096),
}  # fmt: skip


@pytest.mark.parametrize("name", VARIANTS)
def test_every_variant_holds_the_same_numbers(tmp_path, name):
    record = read(tmp_path, VARIANTS[name])
    np.testing.assert_allclose(record.time, TIME, atol=1e-15)
    np.testing.assert_allclose(record.friction_force, FRICTION, rtol=1e-15)
    np.testing.assert_allclose(record.normal_force, 3.0, rtol=1e-15)
    assert not [finding for finding in record.findings if finding.severity != "info"]


def test_columns_units_and_load_from_the_user(tmp_path):
    text = "A,B,C\n" + rows()
    columns = {"time": "A", "friction_force": "B"}
    units = {"time": "ms", "friction_force": "mN"}
    record = read(tmp_path, text, columns=columns, units=units, normal_force="300 g")
    assert record.time[1] == pytest.approx(1e-5) and record.friction_force[0] == pytest.approx(5e-4)
    assert (
        record.normal_force[0] == pytest.approx(0.3 * 9.80665)
        and "given by the user" in record.metadata["normal_force_source"]
    )
    assert record.channels["C"][0] == 3.0
    drive = read(
        tmp_path,
        text,
        columns={**columns, "drive_speed": "C"},
        units={**units, "drive_speed": "mm/s"},
        normal_force=1.0,
    )
    assert drive.drive_speed[0] == pytest.approx(3e-3)


def test_a_repeated_header_is_a_step(tmp_path):
    record = read(tmp_path, UNITS_ROW + rows() + "\nsecond\n" + UNITS_ROW + rows())
    assert [(s.number, s.stop) for s in record.steps] == [(1, N), (2, 2 * N)] and (np.diff(record.time) > 0).all()
    np.testing.assert_allclose(read(tmp_path, UNITS_ROW + rows() + UNITS_ROW + rows(), step=2).time, TIME)


@pytest.mark.parametrize(
    ("line", "code", "kept"),
    [
        ("0.12,OVER,3", "missing_rows", 14), ("0.12,,3", "missing_rows", 14), ("0.12,0.5", "missing_rows", 14),
        ("0.12,1e999,3", "missing_rows", 14), ("nan,0.5,3", "missing_time", 14), ("x,0.5,3", "missing_time", 14),
        ("0.11,0.5,3", "repeated_time", 13), ("# pause", "text_in_rows", 13), ("load applied", "text_in_rows", 13),
    ],
)  # fmt: skip
def test_a_bad_row_is_kept_without_weight_or_left_out_but_never_in_silence(tmp_path, line, code, kept):
    record = read(tmp_path, UNITS_ROW + rows() + line + "\n0.13,0.5,3\n")
    assert len(record) == kept and code in {finding.code for finding in record.findings}
    assert record.time[-1] == pytest.approx(0.13) and record.friction_force[-1] == 0.5


def test_an_empty_column_of_the_same_name_is_passed_over(tmp_path):
    record = read(tmp_path, "Time [s],Fx [N],Fx [N],Fz [N]\n0,,1,3\n1,,2,3\n")
    assert record.friction_force.tolist() == [1, 2]


def test_dates_and_words_in_other_columns_do_no_harm(tmp_path):
    text = "Date;Time [s];Fx [N];Fz [N];Note\n" + "".join(f"12.05.2022;0,0{i};0,5{i};3;ok\n" for i in range(9))
    record = read(tmp_path, text)
    assert record.friction_force[8] == 0.58 and not record.channels


def test_every_float_is_read_exactly(tmp_path):
    bits = np.random.default_rng(3).integers(0, 2**63, 3000).view(np.float64)
    values = np.concatenate((bits[np.isfinite(bits)], [5e-324, 1.7976931348623157e308, 0.1, 2**53 + 1.0]))
    text = "T,Fx,Fz,count\ns,N,N,\n" + "".join(f"{i},1,3,{v!r}\n" for i, v in enumerate(values.tolist()))
    assert read(tmp_path, text).channels["count"].tobytes() == values.tobytes()


def test_measured_records_are_read_as_they_are():
    if not MEASURED.is_dir():
        pytest.skip("the measured paper-on-paper records are not on this machine")
    for path in sorted(MEASURED.glob("*.csv")):
        record = read_log(path)
        table = np.loadtxt(path, delimiter=",", skiprows=2)
        assert record.friction_force.tobytes() == np.ascontiguousarray(table[:, 1]).tobytes()
        np.testing.assert_allclose(record.time + record.metadata["file_time_start"], table[:, 0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("place", ["in front", "behind", "alone"])
def test_a_long_text_of_words_is_refused_at_once(tmp_path, place):
    words = "nothing of this is a number\n" * 25_000
    rows_ = UNITS_ROW + rows()
    began = time.process_time()
    with pytest.raises(LogError, match=r"lines of words in a row|no rows of numbers"):
        read(tmp_path, {"in front": words + rows_, "behind": rows_ + words, "alone": words}[place])
    assert time.process_time() - began < 2
