"""Layouts that people have: clock times, quotes, units in cells, columns by number, other languages, doubtful roles."""

from datetime import datetime, time, timedelta
from pathlib import Path

import numpy as np
import openpyxl
import pytest

from data_io import LogError, read_log
from experiments.lookalikes import EXPORTS

CASES = Path(__file__).parents[1] / "cases"
FORCE = [f"{0.5 + 0.01 * (i % 20):.4f}" for i in range(120)]


def codes(record):
    return {finding.code for finding in record.findings}


def table(folder, head, row, name="a.csv", encoding="utf-8"):
    """A file of 120 rows; row: makes one of a number and a force."""
    text = head + "\n" + "".join(row(i, force) + "\n" for i, force in enumerate(FORCE))
    (folder / name).write_bytes(text.encode(encoding))
    return folder / name


def right(record, interval=0.1, rows=120):
    assert len(record) == rows
    np.testing.assert_allclose(record.time, interval * np.arange(rows), atol=1e-6)
    np.testing.assert_allclose(record.friction_force, [float(force) for force in FORCE[:rows]], rtol=1e-12)


@pytest.mark.parametrize("name", ["hms.csv", "datetime_cells.xlsx", "hms_and_elapsed.csv", "quoted_decimal_comma.csv"])
def test_the_same_numbers_in_other_layouts(name):
    """Each of these files holds the numbers of the plain one: 100 Hz, 8 s, a mean coefficient of 0.475."""
    record = read_log(CASES / name)
    np.testing.assert_allclose(record.time, np.arange(800) / 100.0, atol=1e-6)
    assert np.mean(record.friction_force / record.normal_force) == pytest.approx(0.475, abs=2e-3)
    source = {"hms_and_elapsed.csv": "column Elapsed time in s"}.get(name, "column Time in s")
    assert record.metadata["time_source"] == source


@pytest.mark.parametrize(
    ("head", "stamp"),
    [
        ("Time", "%H:%M:%S.%f"),
        ("Timestamp", "%Y-%m-%dT%H:%M:%S.%f"),
        ("Timestamp", "%Y-%m-%d %H:%M:%S.%fZ"),
        ("Date/Time", "%d.%m.%Y %H:%M:%S.%f"),
        ("DateTime", "%m/%d/%Y %I:%M:%S.%f %p"),
        ("Zeit", "%d/%m/%Y %H:%M:%S.%f"),
        ("Time", "%Y/%m/%d %H:%M:%S,%f"),
    ],
)
def test_clock_times_go_over_midnight(tmp_path, head, stamp):
    start = datetime(2024, 2, 28, 23, 59, 55)
    path = table(tmp_path, f"{head};Fz [N];Fx [N]", lambda i, f: f"{start + timedelta(seconds=i / 10):{stamp}};3.0;{f}")
    right(read_log(path))


def test_clock_times_in_cells_of_excel(tmp_path):
    start = datetime(2024, 2, 28, 23, 59, 50)
    for kind in (
        lambda i: start + timedelta(seconds=i / 10),
        lambda i: (start + timedelta(seconds=i / 10)).time(),
        lambda i: timedelta(seconds=i / 10),
        lambda i: time(0, 0, i // 10, 100_000 * (i % 10)),
    ):
        book = openpyxl.Workbook()
        book.active.append(["Time" if not isinstance(kind(0), timedelta) else "Time [s]", "Fz [N]", "Fx [N]"])
        for i, force in enumerate(FORCE):
            book.active.append([kind(i), 3.0, float(force)])
        book.save(tmp_path / "a.xlsx")
        right(read_log(tmp_path / "a.xlsx"))


@pytest.mark.parametrize(
    ("head", "row"),
    [
        ("T [s],Fz [N],Fx [N]", lambda i, f: f'"{i / 10:.2f}","3.0","{f}"'),
        ("T [s],Fz [N],Fx [N]", lambda i, f: f'"{i / 10:.2f}","3.0","{f}"'.replace(".", ",")),
        ("T [ms],Fz [N],Fx [mN]", lambda i, f: f'"{100 * i:,.1f}","3.00","{1e3 * float(f):,.3f}"'),
        ("T [ms];Fz [N];Fx [N]", lambda i, f: f"{100 * i:,.1f};3.0;{f}".translate(str.maketrans(".,", ",."))),
        ("T;Fz;Fx", lambda i, f: f"{i / 10:.1f} s;3.0 N;{f} N"),
        ("T\tFz\tFx", lambda i, f: f"{i * 100} ms\t3000 mN\t{f} N"),
    ],
)
def test_quotes_thousands_and_units_in_cells(tmp_path, head, row):
    record = read_log(table(tmp_path, head, row))
    right(record)
    assert record.normal_force[0] == 3.0


def test_a_coefficient_and_a_load_are_a_friction_force(tmp_path):
    record = read_log(CASES / "coefficient_and_load.csv")
    np.testing.assert_allclose(record.friction_force, record.channels["COF"] * record.normal_force, rtol=1e-12)
    assert "friction_from_coefficient" in codes(record) and np.median(record.friction_force) == pytest.approx(
        6.0, abs=0.05
    )
    path = table(tmp_path, "Zeit [s];Reibwert", lambda i, f: f"{i / 10};{f}")
    right(read_log(path, normal_force="1 N"))
    path = table(
        tmp_path, "Time [s]\tFriction coefficient\tFriction force [N]\tLoad [N]", lambda i, f: f"{i / 10}\t9\t{f}\t3"
    )
    record = read_log(path)
    right(record)
    assert "friction_from_coefficient" not in codes(record), "a force that is there is taken"


def test_distance_over_speed_is_a_time(tmp_path):
    path = table(
        tmp_path, "Sliding distance [m],Sliding speed [mm/s],Fn [N],Ff [N]", lambda i, f: f"{i / 100},100,3,{f}"
    )
    record = read_log(path)
    right(record)
    assert "time_from_distance" in codes(record)
    ramp = table(
        tmp_path, "Distance [mm];Speed [mm/s];Load [N];COF", lambda i, f: f"{0.5 * (i / 10) ** 2};{i / 10};1;{f}"
    )
    right(read_log(ramp))  # half a t squared at the speed t, exactly so by the mean of two speeds
    with pytest.raises(LogError, match="no time column"):
        read_log(table(tmp_path, "Distance [m],Speed,Fn [N],Ff [N]", lambda i, f: f"{i / 100},100,3,{f}"))


def test_channels_of_ni_in_pairs():
    named = {"columns": {"friction_force": "Force"}, "units": {"friction_force": "2.5 N/V"}, "normal_force": 3.0}
    record = read_log(CASES / "ni_channels_in_pairs.csv", **named)
    assert record.friction_force[0] == pytest.approx(2.5 * -0.129930231773) and record.time[1] == 0.0005
    assert record.metadata["format"] == "ni-channels" and "Input 1" in record.channels


def test_channels_of_ni_that_start_apart_or_have_no_times(tmp_path):
    head = "Timestamp;2020-01-01 10:00:00.0;Timestamp;2020-01-01 10:00:00.5\nInterval;0.1;Interval;0.1\n"
    head += "Channel name;Fx;Channel name;Fz\nUnit;N;Unit;N"
    for row in (
        lambda i, f: f"{i / 10:.1f};{f};{i / 10:.1f};{3 + 0.1 * i + 0.5:.3f}",
        lambda i, f: f"{f};{3 + 0.1 * i + 0.5:.3f}",
    ):
        record = read_log(table(tmp_path, head, row))
        assert record.friction_force[0] == float(FORCE[5]), "the load begins five rows later"
        np.testing.assert_allclose(record.normal_force, 3.0 + record.time + 0.5, atol=1e-9)


@pytest.mark.parametrize("between", ["\t", ";", ",", " "])
def test_the_longest_block_of_equal_width_is_the_table(tmp_path, between):
    settings = "1.0 2.0 3.0 4.0 5.0\n0.5,0.6" if between != "," else "1.0\t2.0\t3.0"
    path = table(tmp_path, settings, lambda i, f: between.join(("7", f"{i / 10}", f)))
    named = {"columns": {"time": "2", "friction_force": "3"}, "units": {"time": "s", "friction_force": "N"}}
    right(read_log(path, normal_force=1.0, **named))


NUMBERED = {
    "columns": {"time": "1", "friction_force": "2", "normal_force": "3"},
    "units": {"time": "s", "friction_force": "N", "normal_force": "N"},
}


@pytest.mark.parametrize(("setting", "count"), [("{0},{0}", 20), ("{0};{0};{0}", 1_000)])
def test_settings_end_wherever_they_end(tmp_path, setting, count):
    rows = "".join(f"{i / 10}\t{FORCE[i % 120]}\t3.0\n" for i in range(10_000))
    (tmp_path / "a.txt").write_text("".join(setting.format(i) + "\n" for i in range(count)) + rows)
    record = read_log(tmp_path / "a.txt", **NUMBERED)
    assert len(record) == 10_000 and "preamble" in record.metadata
    assert record.metadata["preamble"].count("\n") == count - 1, "nothing is dropped without a word"
    np.testing.assert_allclose(record.friction_force[:120], [float(force) for force in FORCE], rtol=1e-12)


def test_a_number_and_a_word_in_each_row(tmp_path):
    path = CASES / "number_and_word.txt"
    with pytest.raises(LogError, match=r"the word 'N1' behind the numbers of the column before.*--rate"):
        read_log(path, columns={"time": "1", "friction_force": "2"}, normal_force=3.0)
    record = read_log(path, columns={"friction_force": "1"}, normal_force=3.0, rate="4 Hz")
    assert record.friction_force[0] == 0.5 and record.time[1] == 0.25 and "clock_from_rate" in codes(record)
    for row in (lambda _, f: f, lambda _, f: f"{f} N", lambda _, f: f"{f};N"):
        found = read_log(
            table(tmp_path, "Messung am Montag", row),
            columns={"friction_force": "1"}, units={"friction_force": "N"}, normal_force=3.0, rate=10.0,
        )  # fmt: skip
        right(found)


@pytest.mark.parametrize(
    ("head", "encoding"),
    [
        ("时间(s),正压力(N),摩擦力(N)", "gb18030"),
        ("时间（s）,法向载荷（N）,切向力（N）", "gb18030"),
        ("時間[s],垂直荷重[N],摩擦力[N]", "cp932"),
        ("時間[s],荷重[N],摩擦力[N]", "utf-8"),
        ("Temps (s),Force normale (N),Force de frottement (N)", "cp1252"),
        ("Tiempo [s],Carga normal [N],Fuerza de fricción [N]", "cp1252"),
        ("Tempo [s],Carico [N],Forza d'attrito [N]", "utf-8"),
        ("Czas [s],Siła normalna [N],Siła tarcia [N]", "utf-8"),
        ("Czas [s],Siła normalna [N],Siła tarcia [N]", "cp1250"),
        ("Zeit [s],Normalkraft [N],Reibkraft [N]", "utf-16"),
    ],
)
def test_names_in_the_languages_of_laboratories(tmp_path, head, encoding):
    right(read_log(table(tmp_path, head, lambda i, f: f"{i / 10},3.0,{f}", encoding=encoding)))


def test_names_in_merged_cells_and_in_two_rows(tmp_path):
    record = read_log(CASES / "merged_header.xlsx")
    assert len(record) == 800 and record.metadata["time_source"] == "column Time in s"
    right(read_log(table(tmp_path, "Time;Force;;\n;Fz;Fx;Z\ns;N;N;mm", lambda i, f: f"{i / 10};3;{f};{i}")))


@pytest.mark.parametrize("name", EXPORTS)
def test_exports_of_instruments(tmp_path, name):
    head, row, more, numbers = EXPORTS[name]
    encoding = "utf-16" if name == "Anton Paar RheoCompass" else "utf-8"
    path = table(tmp_path, head, lambda i, force: row(str(i / 10), force), "a.txt", encoding)
    right(read_log(path, **more))
    columns = dict(zip(("time", "friction_force", "normal_force"), numbers.split(","), strict=False))
    by_number = read_log(path, columns=columns, normal_force=more.get("normal_force"))
    right(by_number)
    assert by_number.normal_force[0] == 3.0


STAMP = datetime(2024, 3, 5, 23, 59, 55)


@pytest.mark.parametrize(
    ("form", "mark"),
    [("{:%H:%M:%S.%f} -> ", ","), ("{:%H:%M:%S.%f} -> ", "\t"), ("{:%H:%M:%S.%f} > ", " "), ("[{:%H:%M:%S.%f}] ", ";"),
     ("[{:%Y-%m-%d %H:%M:%S.%f}] ", " "), ("{:%H:%M:%S,%f} -> ", ",")],
)  # fmt: skip
def test_lines_that_a_terminal_has_stamped(tmp_path, form, mark):
    def row(i, force):
        return form.format(STAMP + timedelta(seconds=i / 10)) + mark.join((force, "3.0"))

    def stamped(words):
        return form.format(STAMP) + words

    named = table(tmp_path, f"{stamped('HX711 ready')}\n{stamped(mark.join(('Fx_N', 'Fz_N')))}", row)
    right(read_log(named))
    assert read_log(named).metadata["format"] == "stamped-lines"
    bare = table(tmp_path, stamped("HX711 ready"), row, "bare.txt")
    numbers = {"time": "1", "friction_force": "2", "normal_force": "3"}
    right(read_log(bare, columns=numbers, units=dict.fromkeys(("friction_force", "normal_force"), "N")))


DATA_LOGGER = (
    "Vendor,GRAPHTEC Corporation\nSampling interval,100ms\nStart time,2024/03/05,23:59:55\n"
    "CH,Signal name,Input,Range\nCH1,Friction,DC,1V\nCH2,Normal,DC,1V\nData\n"
    "Number,Date&Time,ms,CH1,CH2,Alarm\nNO.,Time,ms,N,N,A1234"
)


def logged(i, force):
    return f"{i + 1},{STAMP + timedelta(seconds=i // 10):%Y/%m/%d %H:%M:%S},{100 * (i % 10):03},+{force},+3.00,LLLL"


def test_milliseconds_beside_a_clock_of_whole_seconds(tmp_path):
    path, named = table(tmp_path, DATA_LOGGER, logged), {"friction_force": "CH1", "normal_force": "CH2"}
    record = read_log(path, columns=named)
    right(record)
    assert "clock_with_milliseconds" in codes(record) and "clock_rounded" not in codes(record)
    right(read_log(path, columns=named, channels=()))
    numbers = {"friction_force": "4", "normal_force": "5"}  # settings in pairs and words in rows are no harm
    right(read_log(path, columns=numbers, units=dict.fromkeys(numbers, "N"), rate="10 Hz"))


@pytest.mark.parametrize("part", [1, 10**3, 10**6, 10**9])
def test_a_clock_that_counts_from_1970_tells_its_unit(tmp_path, part):
    """As robots and computers write it: `rostopic echo -p` of a force sensor, in nanoseconds."""
    stamps = [f"{1_710_253_695 + 2 * i / 1000:.3f}" if part == 1 else str(1_710_253_695 * part + 2 * i * part // 1000)
              for i in range(60)]  # fmt: skip
    rows = "".join(f"{stamp},{4711 + i},-0.{3 + i % 3}00,-1.000\n" for i, stamp in enumerate(stamps))
    path = tmp_path / "wrench.csv"
    path.write_text("%time,field.header.seq,force.x,force.z\n" + rows)
    columns = {"normal_force": "force.z", "friction_force": "force.x"}
    record = read_log(path, columns=columns, units={"normal_force": "N", "friction_force": "N"})
    assert record.time[-1] - record.time[0] == pytest.approx(0.118, abs=1e-6)


N = 600
TIME = np.arange(N) / 100.0


def saw(high=0.9, low=0.5):
    """A force of stick-slip [N]."""
    return low + (high - low) * (TIME % 0.8) / 0.8 + np.random.default_rng(1).normal(0.0, 1e-3, N)


def still(level, sd=2e-3, seed=2):
    return level + np.random.default_rng(seed).normal(0.0, sd, N)


def text(folder, delimiter=",", **columns):
    rows = [delimiter.join(columns)]
    rows += [delimiter.join(f"{values[i]:.5f}" for values in columns.values()) for i in range(N)]
    (folder / "a.txt").write_text("\n".join(rows) + "\n")
    return folder / "a.txt"


def test_the_force_of_six_axes_is_asked_for():
    with pytest.raises(LogError, match=r"'Fx \(N\)'.*stands still.*'Fy \(N\)' moves.*friction_force=Fy"):
        read_log(CASES / "six_axis_off.csv")
    record = read_log(CASES / "six_axis_off.csv", columns={"friction_force": "Fy"})
    assert np.mean(record.friction_force / record.normal_force) == pytest.approx(0.475, abs=2e-3)
    assert len(read_log(CASES / "six_axis_off.csv", columns={"friction_force": "Fx"})) == 800


def test_swapped_forces_are_asked_for(tmp_path):
    path = text(tmp_path, **{"t [s]": TIME, "Fx [N]": still(2.0), "Fz [N]": saw()})
    with pytest.raises(LogError, match=r"may be swapped.*friction_force=Fz,normal_force=Fx"):
        read_log(path)
    turned = read_log(path, columns={"friction_force": "Fz", "normal_force": "Fx"})
    assert np.median(turned.normal_force) == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize(
    ("friction", "other"),
    [
        (saw(), still(0.05)),  # as it should be
        (still(0.5), still(0.05)),  # steady sliding: nothing moves
        (still(0.5), 0.01 * TIME),  # the other one drifts, and holds no friction
        (saw(), saw(9.0, 5.0)),  # both move: the name decides
    ],
)
def test_what_is_as_its_name_says_is_not_asked_for(tmp_path, friction, other):
    path = text(tmp_path, **{"t [s]": TIME, "Fx [N]": friction, "Fy [N]": other, "Fz [N]": still(1.0)})
    np.testing.assert_allclose(read_log(path).friction_force, friction, atol=1e-5)
