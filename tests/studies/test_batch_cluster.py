"""A batch on a Dask cluster: a scheduler and two workers of this machine; the same results as without."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

from identify.studies.batch_store import complete
from identify.studies.job import BatchError
from identify.studies.planning import plan
from identify.studies.running import run_batch
from identify.studies.workers import LocalWorkers
from tests.support.batch_case import ROOT, STUB, Silent, environment, wait_for, write_case

pytest.importorskip(
    "distributed", reason="dask.distributed is not installed: pip install 'stick-slip-workbench[cluster]'"
)

from identify.studies.cluster import WAIT, ClusterWorkers

SCHEDULER = [
    sys.executable,
    "-m",
    "distributed.cli.dask_scheduler",
    "--host",
    "127.0.0.1",
    "--port",
    "0",
    "--no-dashboard",
]
WORKER = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
GROUPS = [f"G{i}" for i in range(6)]


@contextmanager
def cluster(folder, seconds=0.02, workers=2):
    """The address of a scheduler; its process and those of its workers."""
    told = folder / "scheduler.json"
    told.unlink(missing_ok=True)
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": ROOT, "env": environment(seconds)}
    processes = [subprocess.Popen([*SCHEDULER, "--scheduler-file", str(told)], **quiet)]
    try:
        wait_for(lambda: told.exists() and told.stat().st_size > 0, 60)  # it is made before it is filled
        command = [*WORKER, "--scheduler-file", str(told), "--local-directory", str(folder)]
        processes += [subprocess.Popen(command, **quiet) for _ in range(workers)]
        yield json.loads(told.read_text())["address"], processes
    finally:
        for process in reversed(processes):
            process.kill()
            process.wait()


def joined(address, out, workers=2):
    """The workers of the cluster, all of them there."""
    made = ClusterWorkers(address, STUB)
    made._client.wait_for_workers(workers, timeout=60)
    out.mkdir(exist_ok=True)
    made.check(out)
    return made


def results(out):
    return {p.parent.name: p.read_text().split('"machine"')[0] for p in out.glob("*/result.json")}


def test_a_cluster_gives_the_results_of_one_machine_also_where_a_worker_is_killed(tmp_path):
    case = write_case(tmp_path / "in", [*GROUPS, "crash", "hang"])
    out = tmp_path / "out"
    with cluster(tmp_path, seconds=0.2) as (address, processes):
        workers = joined(address, out)
        teller = Silent(lambda: os.kill(processes[1].pid, signal.SIGKILL))
        summary = run_batch(plan(*case), out, workers, resume=False, limit=4.0, progress=teller, scheduler=address)
        more = run_batch(plan(*case), out, joined(address, out, 1), resume=True, limit=4.0, progress=Silent())
        assert more.kept == len(GROUPS) and more.ended["crash"].message == summary.ended["crash"].message, "once more"
    assert len(teller.heard) == 9
    ends = {group: end.status for group, end in summary.ended.items()}
    assert ends == {**dict.fromkeys(GROUPS, "converged"), "crash": "crashed", "hang": "timed_out"}
    run_batch(plan(*case), tmp_path / "local", LocalWorkers(1, STUB), resume=False, limit=4.0, progress=Silent())
    assert results(out) == results(tmp_path / "local") and len(results(out)) == len(GROUPS)
    assert all(complete(out / group) for group in GROUPS)
    assert [item.name for item in out.iterdir() if item.name.startswith(".")] == [".lock"]


def test_a_batch_that_loses_its_scheduler_stops_and_can_go_on(tmp_path):
    case, out = write_case(tmp_path / "in", GROUPS), tmp_path / "out"
    with cluster(tmp_path, seconds=0.2, workers=1) as (address, processes):
        workers = joined(address, out, 1)
        lost = []

        def ended():
            os.kill(processes[0].pid, signal.SIGKILL)
            lost.append(time.monotonic())

        summary = run_batch(
            plan(*case), out, workers, resume=False, limit=9.0, progress=Silent(ended), scheduler=address
        )
        assert time.monotonic() - lost[0] < 0.5 * WAIT, "whoever is gone is not asked to tidy up"
    assert summary.status == "stopped" and "scheduler was lost" in summary.message and 1 <= len(summary.ended) < 6
    again = run_batch(plan(*case), out, LocalWorkers(1, STUB), resume=True, limit=9.0, progress=Silent())
    assert again.status == "done" and again.kept == len(summary.ended)


def test_a_cluster_that_is_not_there_or_sees_other_folders_is_refused(tmp_path, monkeypatch):
    import identify.studies.cluster as room

    monkeypatch.setattr(room, "WAIT", 1.0)
    with pytest.raises(BatchError, match="no Dask scheduler answers"):
        ClusterWorkers("tcp://127.0.0.1:9")
    monkeypatch.setattr(room, "WAIT", 60.0)
    with cluster(tmp_path, workers=1) as (address, _):
        with pytest.raises(BatchError, match="does not see"):
            ClusterWorkers(address, STUB).check(tmp_path / "only here")
        monkeypatch.setattr(room, "numerics", lambda: "other")
        with pytest.raises(BatchError, match="other numerics"):
            ClusterWorkers(address, STUB).check(tmp_path)
