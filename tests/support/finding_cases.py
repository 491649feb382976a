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
    RATE,
    N,
    clipped_run,
    made,
    noise,
    rate_switch,
    ratio,
    samples_per_swing,
    saw,
    stopped,
    unloaded_rows,
)

Found = Sequence[Finding]
Make = Callable[[Path], Found]

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


def judged(make: Callable[[], tuple[Record, list[Any]]], rows: int | None = None) -> Make:
    """What the gate finds; rows: so many at the front count."""
    used = None if rows is None else np.arange(N) < rows

    def found(_folder: Path) -> Found:
        record, parts = make()
        return judge(record, parts, used=used).findings

    return found


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


def one_value_but(rows: int) -> np.ndarray:
    force = np.full(N, 0.3)
    force[100 : 100 + rows] += 1e-4
    return force


def set_load(rows: int) -> tuple[Record, list[Any]]:
    load = np.ones(N)
    load[100 : 100 + rows] += 1e-6
    return made(normal=load)


def clipped_load(rows: int) -> tuple[Record, list[Any]]:
    load = 1.0 + noise(2)
    load[100 : 100 + rows] = load.max() + 1e-4
    return made(normal=load)


def loading(share: float) -> tuple[Record, list[Any]]:
    """A first stick that is over after a share of the log; no slip comes."""
    time = np.arange(N) / RATE
    return made(0.5 * np.minimum(time / (share * time[-1]), 1.0) + noise(1))


def swapped(slips: int) -> tuple[Record, list[Any]]:
    """Forces exchanged, cut behind so many slips."""
    record, _ = made()
    rows = round((slips + 0.5) * 0.4 * RATE)
    return made(record.normal_force[:rows], record.friction_force[:rows], record.time[:rows])


def tared(stop: float) -> Make:
    """A zero taken from 0 s to `stop` in a record whose drive moves from 2 s on."""

    def make(_folder: Path) -> Found:
        time = np.arange(N) / RATE
        record = Record(time, np.ones(N), np.where(time < 2.0, 0.0, 0.4 + saw(time - 2.0)) + noise(1))
        return correct(record, Corrections(tare=(0.0, stop))).record.findings

    return make


def driven(stated: float) -> Make:
    """A drive that moves at 1 mm/s by the position column, and was stated as something else."""

    def make(_folder: Path) -> Found:
        time = np.arange(N) / RATE
        track = {"channels": {"position": 1e-3 * time}, "channel_units": {"position": "m"}}
        rig = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0, "drive_speed": stated}
        scene = Scene.from_document({"effects": "auto", "rig": rig, "logs": [{"path": "log.csv"}]}, Path())
        return with_drive_checked(scene, scene.logs[0], Record(time, np.ones(N), np.full(N, 0.3), **track)).findings

    return make


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
CASES: dict[str, list[tuple[Make, Make]]] = {
    "missing_time": [(log(GOOD.replace("0.20,", "nan,")), log(GOOD.replace("0.20,", "0.205,")))],
    "clock_rounded": [(stamped(3), stamped(5))],
    "friction_from_coefficient": [
        (log(GOOD.replace("Fx", "COF").replace("s,N,N", "s,,N")), log(GOOD)),
    ],
    "time_from_distance": [
        (
            log("Distance [m],Speed [mm/s],Fx [N],Fz [N]\n" + "".join(f"{i}.0,10,{i % 7}.5,3.0\n" for i in range(9))),
            log("Time [s],Speed [mm/s],Fx [N],Fz [N]\n" + "".join(f"{i}.0,10,{i % 7}.5,3.0\n" for i in range(9))),
        ),
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
    "stopped": [(judged(lambda: stopped(60)), judged(lambda: stopped(15)))],
    "unloaded_rows": [(judged(lambda: unloaded_rows(0.09)), judged(lambda: unloaded_rows(0.11)))],
    "rate_switch": [(judged(lambda: rate_switch(1.6)), judged(lambda: rate_switch(1.4)))],
    "strange_coefficient": [
        (judged(lambda: ratio(10.5)), judged(lambda: ratio(9.5))),
        (judged(lambda: ratio(0.00095)), judged(lambda: ratio(0.00105))),
    ],
    "sampled_too_slowly": [(judged(lambda: samples_per_swing(3.9)), judged(lambda: samples_per_swing(15.0)))],
    "still_loading": [(judged(lambda: loading(1.0)), judged(lambda: loading(0.8)))],
    "friction_constant": [(judged(lambda: made(one_value_but(0))), judged(lambda: made(one_value_but(1))))],
    "no_load": [
        (judged(lambda: made(normal=np.zeros(N))), judged(lambda: made(normal=np.full(N, 1e-3)))),
        (judged(lambda: made(normal=-np.ones(N))), judged(lambda: made(normal=np.ones(N)))),
    ],
    "no_rows": [(judged(made, rows=1), judged(made, rows=2))],
    "normal_force_not_measured": [(judged(lambda: set_load(0)), judged(lambda: set_load(1)))],
    "normal_clipped": [(judged(lambda: clipped_load(10)), judged(lambda: clipped_load(9)))],
    "friction_clipped": [(judged(lambda: clipped_run(10)), judged(lambda: clipped_run(9)))],
    "forces_swapped": [(judged(lambda: swapped(3)), judged(lambda: swapped(2)))],
    "tare_not_quiet": [(tared(2.2), tared(1.9))],
    "drive_speed_disagrees": [(driven(1.03e-3), driven(1.01e-3))],
}
