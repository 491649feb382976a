"""Logs a bit beyond what makes a remark, and logs that are not: one pair for every code a finding can carry.

Codes with a threshold have their records in `verdict_cases`; here are the others.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import nptdms
import numpy as np

from data_io import Finding, Record, read_log
from data_io.correct import Corrections, correct
from identify import Scene
from identify.logs.judgement import judge
from identify.logs.recorded_drive import with_drive_checked
from tests.support.verdict_cases import (
    FORCE,
    RATE,
    TIME,
    N,
    made,
    noise,
    put,
    rate_switch,
    ratio,
    samples_per_swing,
    saw,
    stopped,
)

Found = Sequence[Finding]
Make = Callable[[Path], Found]

AT_SPEED = "".join(f"{i}.0,10,{i % 7}.5,3.0\n" for i in range(9))
FLAT = np.full(N, 0.3)
ROWS = [f"{i / 100:.2f},{i % 7}.5,3.0" for i in range(40)]
GOOD = "T,Fx,Fz\ns,N,N\n" + "".join(row + "\n" for row in ROWS)


def log(text: str, name: str = "log.csv", **options: Any) -> Make:
    """What is found while a text is read."""

    def make(folder: Path) -> Found:
        (folder / name).write_text(text, encoding="utf-8")
        return read_log(folder / name, **options).findings

    return make


def files(count: int) -> Make:
    """So many files of one test, given by their folder."""

    def make(folder: Path) -> Found:
        for number in range(count):
            (folder / f"s_{number}.csv").write_text(GOOD, encoding="utf-8")
        return read_log(folder).findings

    return make


def judged(*force_load_time: np.ndarray | None, rows: int = N) -> Make:
    """What the gate finds; rows: so many at the front count."""

    def found(_folder: Path) -> Found:
        record, parts = made(*force_load_time)
        return judge(record, parts, used=None if rows == N else np.arange(N) < rows).findings

    return found


def shown(make: Callable[[float], tuple[Record, list[Any]]], x: float) -> Make:
    """What the gate finds in a record that is made with a number."""
    return lambda _folder: judge(*make(x)).findings


def umt(*steps: str) -> str:
    """A log in steps."""
    return "Run # 1\n" + "".join(steps)


def step(number: int, rows: int = 5, count: int | None = None, started: str = "") -> str:
    """One step of rows at 10 Hz."""
    head = [f"Step No. {number}", *([] if count is None else [f"Data Count = {count}"])]
    head += [f"Started at: {started}"] if started else []
    table = [f"{i / 10},1.{i % 10},3" for i in range(rows)]
    return "\n".join([*head, "T,Fx,Fz", "s,N,N", *table, ""])


def rtec(rows: int) -> str:
    """Two steps, the second of so many rows; Timestamp restarts."""
    table = [f"{k},{i / 10},{k},3,1.5" for k, n in ((1, 5), (2, rows)) for i in range(n)]
    return "\n".join(["Step, Timestamp, RecipeStep, DAQ.Fz (N),DAQ.Fx (N)", *table, ""])


def loading(share: float) -> np.ndarray:
    """The force of a first stick that is over after a share of the log; no slip comes."""
    return 0.5 * np.minimum(TIME / (share * TIME[-1]), 1.0) + noise(1)


def lifted(values: np.ndarray, rows: int, by: float) -> np.ndarray:
    """Some rows that stand on one value beyond all others."""
    return put(values, slice(100, 100 + rows), values.max() + by)


def swapped(slips: int) -> Make:
    """Forces exchanged, cut behind so many slips."""
    rows = slice(round((slips + 0.5) * 0.4 * RATE))
    return judged(1.0 + noise(2)[rows], FORCE[rows], TIME[rows])


def tared(stop: float) -> Make:
    """A zero taken from 0 s to `stop` in a record whose drive moves from 2 s on."""

    record = Record(TIME, np.ones(N), np.where(TIME < 2.0, 0.0, 0.4 + saw(TIME - 2.0)) + noise(1))
    return lambda _folder: correct(record, Corrections(tare=(0.0, stop))).record.findings


def driven(stated: float) -> Make:
    """A drive that moves at 1 mm/s by the position column, and was stated as something else."""

    track = {"channels": {"position": 1e-3 * TIME}, "channel_units": {"position": "m"}}
    rig = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0, "drive_speed": stated}
    scene = Scene.from_document({"effects": "auto", "rig": rig, "logs": [{"path": "log.csv"}]}, Path())
    record = Record(TIME, np.ones(N), np.full(N, 0.3), **track)
    return lambda _folder: with_drive_checked(scene, scene.logs[0], record).findings


TWO = "T [s],Ff [N],Fx [N],Fz [N]\n0,{},1,3\n1,2,2,3\n2,3,3,3\n"
INTERVAL = "Interval,0.01\n\nFx (N),Fz (N)\n1,3\n2,3\n3,3\n"
CLOCKED = "Interval,0.01\n\nT (s),Fx (N),Fz (N)\n0,1,3\n0.01,2,3\n0.02,3,3\n"


def worded(words: int) -> str:
    """Four rows, so many of them with a word in the last column."""
    rows = [f"{i},1.{i},3,{'bad' if i < words else i}" for i in range(4)]
    return "\n".join(["T,Fx,Fz,Note", "s,N,N,", *rows, ""])


def interrupted(words: int) -> str:
    """Rows among which so many different lines of words stand."""
    return "T,Fx,Fz\ns,N,N\n0,1,3\n" + "".join(f"pause {i}\n{i},1,3\n" for i in range(1, words + 1))


def stamped(digits: int) -> Make:
    """A clock of 800 Hz, written with so many decimals."""
    rows = "".join(f"{i / 800:.{digits}f},{i % 7}.5,3.0\n" for i in range(60))
    return log("T,Fx,Fz\ns,N,N\n" + rows)


def with_milliseconds(step: int, beyond: int = 0) -> Make:
    """A row every so many ms: clock times of whole seconds, and beside them what is left, with so much more."""
    times = [divmod(i * step, 1000) for i in range(30)]
    rows = (f"12:00:{whole:02d},{left + beyond},{i % 7}.5,3.0\n" for i, (whole, left) in enumerate(times))
    return log("Time,ms,Fx [N],Fz [N]\n" + "".join(rows))


def paired(late: float = 0.0, interval: float = 0.2, gap: int = 0) -> Make:
    """Two forces, each with a clock of its own; late [s]: when the second begins; gap: rows it lacks."""
    clock = [late + (i + (gap if i > 5 else 0)) * interval for i in range(40)]
    rows = "".join(f"{i / 10:.1f},{i % 7}.5,{clock[i]:.2f},3.{i % 3}\n" for i in range(40))
    return log("T [s],Fx [N],T [s],Fz [N]\n" + rows)


def beside(again: str) -> Make:
    """Two tables beside each other, the force of the second one called so."""
    rows = "".join(f"{i / 10:.1f},{i % 7}.5,3.0,{i / 10:.1f},{i % 5}.5,3.0\n" for i in range(40))
    run = {"run": 2} if again == "Fx" else {}
    return log(f"T [s],Fx [N],Fz [N],T [s],{again} [N],Fz [N]\n" + rows, **run)


def cut_tdms(cut: int) -> Make:
    """A TDMS of two segments, of which so many bytes are lost at its end."""

    def make(folder: Path) -> Found:
        with nptdms.TdmsWriter(folder / "a.tdms") as writer:
            for _ in range(2):
                about = {"wf_increment": 0.1, "wf_start_offset": 0.0, "unit_string": "N"}
                forces = [nptdms.ChannelObject("test", name, np.arange(20) % 7 + 1.0, about) for name in ("Fx", "Fz")]
                writer.write_segment(forces)
                writer.write_segment([nptdms.ChannelObject("test", "Fx", np.ones(0), {"note": "x" * 200})])
        data = (folder / "a.tdms").read_bytes()
        (folder / "a.tdms").write_bytes(data[: len(data) - cut])
        return read_log(folder / "a.tdms").findings

    return make


def turning(unit: str) -> Make:
    """A column of turns beside the radius of the track."""
    rows = "".join(f"{i / 10:.1f},{i % 7}.5,3.0,60,20\n" for i in range(40))
    return log(f"T [s],Fx [N],Fz [N],n [{unit}],Radius [mm]\n" + rows)


# code: [(what triggers it, what just does not), ...], one pair for each way in which it comes about
CASES: dict[str, list[tuple[Make, ...]]] = {
    "missing_time": [(log(GOOD.replace("0.20,", "nan,")), log(GOOD.replace("0.20,", "0.205,")))],
    "clock_rounded": [(stamped(3), stamped(5))],
    "friction_from_coefficient": [
        (log(GOOD.replace("Fx", "COF").replace("s,N,N", "s,,N")), log(GOOD)),
    ],
    "force_from_torque": [(log(GOOD.replace("s,N,N", "s,N*m,N"), arm=0.1), log(GOOD, arm=0.1))],
    "time_from_distance": [
        tuple(log(f"{x},Speed [mm/s],Fx [N],Fz [N]\n{AT_SPEED}") for x in ("Distance [m]", "Time [s]")),
    ],
    "damaged_parts": [(cut_tdms(100), cut_tdms(0))],
    "clock_from_rate": [(log(GOOD, rate="4 Hz"), log(GOOD))],
    "clock_with_milliseconds": [(with_milliseconds(100), with_milliseconds(1000, beyond=1000))],
    "own_clocks": [(paired(), paired(interval=0.1))],
    "paired_over_gaps": [(paired(gap=1), paired(gap=0))],
    "rows_without_partner": [(paired(late=0.5), paired(late=0.0))],
    "tables_side_by_side": [(beside("Fx"), beside("Fa"))],
    "tables_without_force": [
        (
            log("T,Valve\ns,V\n" + "".join(f"{i / 10:.1f},{i}.5\n" for i in range(9)) + "\n" + GOOD),
            log("T,Fx,Fz\ns,N,N\n" + "".join(f"{i / 10:.1f},{i}.5,3.0\n" for i in range(9)) + "\n" + GOOD),
        ),
    ],
    "speed_from_rotation": [(turning("rpm"), turning("deg"))],
    "repeated_time": [(log(GOOD.replace("0.20,", "0.19,")), log(GOOD.replace("0.20,", "0.191,")))],
    "missing_rows": [(log(GOOD.replace("0.20,6.5,", "0.20,OVER,")), log(GOOD.replace("0.20,6.5,", "0.20,6,")))],
    "short_rows": [
        (log(GOOD.replace("0.20,6.5,3.0", "0.20,6.5")), log(GOOD.replace("0.20,6.5,3.0", "0.20,6.5,3"))),
    ],
    "last_row_cut": [
        (log(GOOD + "0.40,1."), log(GOOD + "0.40,1.5,3.0\n")),
        (log(GOOD[:-2]), log(GOOD[:-1])),
    ],
    "last_row_open": [(log(GOOD[:-1]), log(GOOD))],
    "rows_left_out": [
        (log(GOOD + "end\n1,2\n"), log(GOOD + "end\n1\n")),
        (log(GOOD + "mean\n1,2\nnext\n" + GOOD), log(GOOD + "mean\n1\nnext\n" + GOOD)),
    ],
    "text_in_rows": [
        (log(GOOD.replace("0.20,", "pause\n0.20,")), log(GOOD.replace("0.20,", "\n0.20,"))),
        (log(GOOD.replace("0.20,6.5,", "0.20,OVER,")), log(GOOD.replace("0.20,6.5,", "0.20,,"))),
    ],
    "column_of_words": [(log(worded(3)), log(worded(2)))],
    "column_choice": [(log(TWO.format(9)), log(TWO.format(1)))],
    "unit_by_context": [(log(GOOD.replace("s,N,N", "s,g,N")), log(GOOD.replace("s,N,N", "s,gf,N")))],
    "normal_force_constant": [(log(GOOD, normal_force=3.0), log(GOOD))],
    "normal_force_flipped": [(log(GOOD.replace(",3.0", ",-3.0")), log(GOOD.replace(",3.0", ",-3.0", 19)))],
    "clock_from_interval": [(log(INTERVAL), log(CLOCKED))],
    "joined_files": [(files(2), files(1))],
    "step_gap_unknown": [(log(GOOD + GOOD), log(GOOD + GOOD.replace("\n0.", "\n9.")))],
    "step_overlap": [
        (
            log(umt(step(1, started="10:00:00.0"), step(2, started="10:00:00.35"))),
            log(umt(step(1, started="10:00:00.0"), step(2, started="10:00:00.45"))),
        )
    ],
    "steps_renumbered": [(log(umt(step(1), step(1))), log(umt(step(1), step(2))))],
    "data_count": [(log(umt(step(1, 5, count=6))), log(umt(step(1, 5, count=5))))],
    "empty_step": [
        (log(umt(step(1), step(2, 0), step(3))), log(umt(step(1), step(2, 1), step(3)))),
        (log(umt(step(1), "Step No. 2\nX = 1\n")), log(umt(step(1), "Step 2 was left out\n"))),
    ],
    "short_steps": [(log(rtec(2)), log(rtec(3)))],
    "stopped": [tuple(shown(stopped, rows) for rows in (60, 15))],
    "unloaded_rows": [tuple(judged(None, put(1.0 + noise(2), 77, share)) for share in (0.09, 0.11))],
    "rate_switch": [tuple(shown(rate_switch, factor) for factor in (1.6, 1.4))],
    "strange_coefficient": [tuple(shown(ratio, x) for x in pair) for pair in ((10.5, 9.5), (0.00095, 0.00105))],
    "sampled_too_slowly": [tuple(shown(samples_per_swing, count) for count in (3.9, 15.0))],
    "still_loading": [(judged(loading(1.0)), judged(loading(0.8)))],
    "friction_constant": [(judged(FLAT), judged(lifted(FLAT, 1, 1e-4)))],
    "no_load": [
        (judged(None, np.zeros(N)), judged(None, np.full(N, 1e-3))),
        (judged(None, -np.ones(N)), judged(None, np.ones(N))),
    ],
    "no_rows": [(judged(rows=1), judged(rows=2))],
    "normal_force_not_measured": [(judged(None, np.ones(N)), judged(None, lifted(np.ones(N), 1, 1e-6)))],
    "normal_clipped": [tuple(judged(None, lifted(1.0 + noise(2), rows, 1e-4)) for rows in (10, 9))],
    "friction_clipped": [tuple(judged(lifted(FORCE, rows, 0.01)) for rows in (10, 9))],
    "forces_swapped": [(swapped(3), swapped(2))],
    "tare_not_quiet": [(tared(2.2), tared(1.9))],
    "drive_speed_disagrees": [(driven(1.03e-3), driven(1.01e-3))],
}
