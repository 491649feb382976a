"""Batches: everything around the fit, with a quick stand-in for it; the fit itself in one test at the end."""

import json
import os
import re
import shutil
import signal
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from data_io.values import LogError
from experiments.batch_trials import STUB, alive, children, kill, put, started, wait_for, write_case
from experiments.stub_fits import numbers
from identify.studies.batch_store import (
    CRASHED,
    DEFECT,
    FAILED,
    OUTDATED,
    TIMED_OUT,
    TRY_AGAIN,
    BatchError,
    Job,
    complete,
    locked,
)
from identify.studies.planning import plan
from identify.studies.running import run_batch
from identify.studies.workers import LocalWorkers, guarded, make
from tests.support.batch_case import Silent

GROUPS = ["G1", "G2", "G3"]


def run(case, out, jobs=1, resume=False, limit=30.0, overrides=()):
    """Plan and run; the summary and what was heard."""
    teller = Silent()
    made = plan(*case, overrides)
    summary = run_batch(made, out, LocalWorkers(jobs, STUB), resume=resume, limit=limit, progress=teller)
    return summary, teller.heard


def folders(out):
    return sorted(item.name for item in out.iterdir() if item.is_dir())


def hidden(out):
    return sorted(item.name for item in out.iterdir() if item.name.startswith(".") and item.name != ".lock")


def results(out):
    """Every result by group, without what may differ between two runs."""
    found = {}
    for path in out.glob("*/result.json"):
        document = json.loads(path.read_text())
        document["provenance"].pop("machine")
        found[path.parent.name] = document
    return found


def test_every_group_gets_its_folder_and_its_own_numbers_whatever_workers_and_order(tmp_path):
    case = write_case(tmp_path / "in", GROUPS)
    summary, heard = run(case, tmp_path / "out")
    assert summary.status == "done" and folders(tmp_path / "out") == GROUPS and hidden(tmp_path / "out") == []
    for planned in plan(*case).jobs:
        job, folder = Job.from_document(planned.as_document()), tmp_path / "out" / planned.group
        found = json.loads((folder / "result.json").read_text())["parameters"]
        assert {name: entry["value"] for name, entry in found.items()} == numbers(job)
        document = complete(folder)
        assert document["key"] == job.key and document["labels"] == {"material": "AB"[GROUPS.index(job.group) % 2]}
    assert heard[0] == ("3 groups", 0.0) and [h[1] for h in heard[1:]] == [1 / 3, 2 / 3, 1.0]
    assert [h[0].partition(" ")[0] for h in heard[1:]] == ["1/3", "2/3", "3/3"] and " left" not in heard[3][0]
    head, *lines = case[0].read_text().splitlines()
    case[0].write_text("\n".join([head, *reversed(lines)]) + "\n")
    run(case, tmp_path / "three", jobs=3)
    assert results(tmp_path / "out") == results(tmp_path / "three") and len(results(tmp_path / "out")) == 3


def test_what_goes_wrong_is_recorded_with_its_reason_and_stops_nothing(tmp_path):
    case = write_case(tmp_path / "in", ["crash", "defect", "good1", "hang", "refuse", "good2"])
    summary, _ = run(case, tmp_path / "out", limit=2.0)
    assert summary.status == "failures"
    ends = {name: (end.status, end.message) for name, end in summary.ended.items()}
    assert {name: status for name, (status, _) in ends.items()} == {
        "crash": CRASHED, "defect": DEFECT, "good1": "converged", "hang": TIMED_OUT, "refuse": FAILED,
        "good2": "converged",
    }  # fmt: skip
    assert "SIGSEGV" in ends["crash"][1] and "2 s" in ends["hang"][1] and "reads no log" in ends["refuse"][1]
    told = complete(tmp_path / "out" / "defect")
    assert "divides by zero" in told["message"] and "Traceback" in told["detail"] and told["result_sha256"] is None
    assert "Segmentation fault" in complete(tmp_path / "out" / "crash")["detail"]
    index = (tmp_path / "out" / "index.csv").read_text().splitlines()
    assert index[0] == "group,status,message,result,folder,logs,material,seconds" and len(index) == 7
    # the seconds are those of the clock, which a busy machine lengthens
    assert re.fullmatch(r"good1,converged,a stub that converged,good1/result\.json,good1,2,A,\d+\.\d{1,3}", index[3])
    assert index[4].startswith("hang,timed_out,") and ",,hang,2,B," in index[4]


def test_a_resumed_batch_redoes_what_is_missing_changed_or_was_not_decided(tmp_path):
    groups = ["crash", "changed", "damaged", "gone", "kept", "refuse"]
    case, out = write_case(tmp_path / "in", groups), tmp_path / "out"
    run(case, out)
    shutil.rmtree(out / "gone")
    (out / "damaged" / "result.h5").write_bytes(b"cut off")
    (tmp_path / "in" / "log_1_0.csv").write_text("T,Fz,Fx\ns,N,N\n0,1,0.9\n1,1,0.4\n2,1,0.5\n")
    before = {group: (out / group).stat().st_ino for group in groups if (out / group).exists()}
    summary, heard = run(case, out, resume=True)
    redone = {h[0].split()[1].rstrip(":") for h in heard[1:]}
    assert redone == {"crash", "changed", "damaged", "gone"} and summary.kept == 2
    assert (out / "kept").stat().st_ino == before["kept"] and (out / "refuse").stat().st_ino == before["refuse"]
    fresh, _ = run(case, tmp_path / "fresh")
    assert fresh.status == "failures" and results(out) == results(tmp_path / "fresh")
    assert hidden(out) == []


def test_a_log_that_changes_while_the_batch_runs_is_no_result_and_no_verdict(tmp_path):
    (job,) = plan(*write_case(tmp_path / "in", ["G1"])).jobs

    def refused(job, part):
        raise LogError("no such log")

    assert guarded(refused, job, tmp_path / "part").status == FAILED
    log = Path(job.logs[0].path)
    log.rename(log.with_suffix(".away"))
    end = guarded(refused, job, tmp_path / "part")
    assert end.status == OUTDATED and "taken away" in end.message and end.status in TRY_AGAIN
    assert make(replace(job, numerics="older"), tmp_path / "part").status == OUTDATED


def test_a_full_disk_stops_the_batch_and_keeps_what_has_ended(tmp_path):
    case, out = write_case(tmp_path / "in", ["a", "full", "z"]), tmp_path / "out"
    case[0].write_text(case[0].read_text().replace("log_0_1.csv,a,2 mm/s,A\n", ""))
    (tmp_path / "in" / "log_0_0.csv").write_text("T,Fz,Fx\ns,N,N\n" + "0,1,0.4\n" * 900)
    (tmp_path / "in" / "log_1_0.csv").write_text("T,Fz,Fx\ns,N,N\n" + "0,1,0.4\n" * 800)
    summary, _ = run(case, out)
    assert summary.status == "stopped" and "No space left" in summary.message and "--resume" in summary.message
    assert folders(out) == ["a"] and hidden(out) == []
    document = json.loads((out / "batch.json").read_text())
    assert document["status"] == "stopped" and [g["status"] for g in document["groups"]] == [
        "converged", "waiting", "waiting"
    ]  # fmt: skip


def test_a_finished_batch_is_kept_taken_over_and_not_shared_or_overwritten(tmp_path):
    case, out = write_case(tmp_path / "in", GROUPS), tmp_path / "out"
    run(case, out)
    (out / "G2").rename(out / f".{16 * 'b'}.part")  # not put
    (out / f".{16 * 'c'}.part").mkdir()
    (out / f".{16 * 'd'}.part.csv").write_text("half")
    summary, heard = run(case, out, resume=True)
    assert [h[0].split()[1] for h in heard[1:]] == ["G2:"] and summary.kept == 2
    assert folders(out) == GROUPS and hidden(out) == []
    assert run(case, out, resume=True, overrides=['rig.mass="0.3 kg"'])[0].kept == 0, "another scene"
    assert run(case, out, resume=True, overrides=['rig.mass="300 g"'])[0].kept == 3, "the same number"
    moved = write_case(tmp_path / "elsewhere", GROUPS)
    assert [j.key for j in plan(*moved).jobs] == [j.key for j in plan(*case).jobs], "where logs lie does not count"
    with pytest.raises(BatchError, match="--resume"):
        run(case, out)
    with locked(out), pytest.raises(BatchError, match=f"another batch is running there .process {os.getpid()}"):
        run(case, out, resume=True)
    (out / "G1" / "notes.txt").write_text("mine")
    with pytest.raises(BatchError, match=r"notes\.txt"):
        run(case, out, resume=True)
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "cat.png").write_text("")
    for place, words in (("photos", "holds no batch of ours"), ("photos/cat.png", "choose another name")):
        with pytest.raises(BatchError, match=words):
            run(case, tmp_path / place, resume=True)


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_a_terminated_batch_says_so_and_leaves_no_process(tmp_path):
    case, out = write_case(tmp_path / "in", [f"G{i}" for i in range(8)]), tmp_path / "out"
    batch = started([case[0], "--scene", case[1], "--out", out, "--jobs", 2], seconds=0.15)
    wait_for(lambda: len(put(out)) >= 3)
    below = children(batch.pid)
    batch.send_signal(signal.SIGTERM)
    _, words = batch.communicate(timeout=30)
    assert batch.returncode == 130 and b"interrupted" in words and b"--resume" in words and len(below) == 2
    wait_for(lambda: not any(alive(pid) for pid in below))
    before = put(out)
    document = json.loads((out / "batch.json").read_text())
    assert document["status"] == "stopped" and document["counts"]["converged"] == len(before) and hidden(out) == []
    assert run(case, out, resume=True)[0].kept == len(before) < 8
    assert {name: put(out)[name] for name in before} == before, "nothing finished was done again"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux ends a process with its parent")
def test_no_fit_outlives_a_batch_that_is_killed(tmp_path):
    case, out = write_case(tmp_path / "in", ["hang"]), tmp_path / "out"
    batch = started([case[0], "--scene", case[1], "--out", out, "--jobs", 1])
    wait_for(lambda: (out / "batch.json").exists() and len(children(batch.pid)) == 1)
    (fit,) = children(batch.pid)
    batch.kill()
    batch.communicate()
    wait_for(lambda: not alive(fit))


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs /proc")
def test_a_fit_that_is_killed_from_outside_costs_only_itself(tmp_path):
    case, out = write_case(tmp_path / "in", ["a", "b", "hang"]), tmp_path / "out"
    batch = started([case[0], "--scene", case[1], "--out", out, "--jobs", 1])
    wait_for(lambda: (out / "b").is_dir())
    (pid,) = children(batch.pid)
    kill(pid)
    _, words = batch.communicate(timeout=30)
    assert batch.returncode == 3 and b"Traceback" not in words
    assert complete(out / "hang")["status"] == CRASHED and "SIGKILL" in complete(out / "hang")["message"]
