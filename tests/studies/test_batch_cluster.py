"""A batch on a Dask cluster: a scheduler and two workers of this machine; the same results as without."""

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager

import pytest

from experiments.batch_trials import ROOT, STUB, environment, wait_for, write_case
from identify.studies.batch_store import BatchError, complete
from identify.studies.planning import plan
from identify.studies.running import run_batch
from identify.studies.workers import ClusterWorkers, LocalWorkers
from tests.support.batch_case import Silent

pytest.importorskip(
    "distributed", reason="dask.distributed is not installed: pip install 'stick-slip-workbench[cluster]'"
)

DASK = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
WORKER = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
GROUPS = [f"G{i}" for i in range(6)]


@contextmanager
def cluster(folder, seconds=0.02, workers=2):
    """The address of a scheduler; its process and those of its workers."""
    file = folder / "scheduler.json"
    file.unlink(missing_ok=True)
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": ROOT, "env": environment(seconds)}
    processes = [subprocess.Popen([*DASK, "--scheduler-file", str(file)], **quiet)]
    try:
        wait_for(lambda: file.exists() and file.stat().st_size > 0, 60)  # it is made before it is filled
        command = [*WORKER, "--scheduler-file", str(file), "--local-directory", str(folder)]
        processes += [subprocess.Popen(command, **quiet) for _ in range(workers)]
        yield json.loads(file.read_text())["address"], processes
    finally:
        for process in reversed(processes):
            process.kill()
            process.wait()


def joined(address, workers=2):
    """The workers of the cluster, once all of them have joined."""
    found = ClusterWorkers(address, STUB)
    found._client.wait_for_workers(workers, timeout=60)
    return found


def results(out):
    return {p.parent.name: p.read_text().split('"machine"')[0] for p in out.glob("*/result.json")}


@pytest.mark.slow
def test_a_cluster_gives_the_results_of_one_machine_also_where_worker_and_scheduler_are_killed(tmp_path):
    case, out = write_case(tmp_path / "in", [*GROUPS, "crash", "hang"]), tmp_path / "out"
    with cluster(tmp_path, seconds=0.2) as (address, processes):
        with pytest.raises(BatchError, match="cannot read"):
            ClusterWorkers(address, STUB).check(tmp_path / "only here")
        workers = joined(address)
        teller = Silent(lambda: os.kill(processes[1].pid, signal.SIGKILL))
        summary = run_batch(plan(*case), out, workers, resume=False, limit=3.0, progress=teller, scheduler=address)
        lost = Silent(lambda: os.kill(processes[0].pid, signal.SIGKILL))
        late = tmp_path / "late"
        stopped = run_batch(plan(*case), late, joined(address, 1), resume=False, limit=9.0, progress=lost)
    assert len(teller.heard) == 9
    ends = {group: end.status for group, end in summary.ended.items()}
    assert ends == {**dict.fromkeys(GROUPS, "converged"), "crash": "crashed", "hang": "timed_out"}
    run_batch(plan(*case), tmp_path / "local", LocalWorkers(1, STUB), resume=False, limit=3.0, progress=Silent())
    assert results(out) == results(tmp_path / "local") and len(results(out)) == len(GROUPS)
    assert all(complete(out / group) for group in GROUPS)
    assert [item.name for item in out.iterdir() if item.name.startswith(".")] == [".lock"]
    assert stopped.status == "stopped" and "scheduler was lost" in stopped.message and 1 <= len(stopped.ended) < 8
    again = run_batch(plan(*case), late, LocalWorkers(1, STUB), resume=True, limit=3.0, progress=Silent())
    assert again.kept >= 1 and {g: e.status for g, e in again.ended.items()} == ends


def test_an_address_without_a_dask_scheduler_is_refused_in_a_sentence():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(BatchError, match="no Dask scheduler answers there"):
        ClusterWorkers(f"tcp://127.0.0.1:{port}", wait=1.0)
