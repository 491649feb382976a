"""Where fits run, beyond one machine: a Dask cluster that somebody has started. The scheduling is all Dask's."""

from __future__ import annotations

import socket
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from identify.studies.batch_store import new_part
from identify.studies.job import CRASHED, BatchError, End, Job, numerics
from identify.studies.workers import Answer, Grip, Pending, WorkersLostError

EXTRA = "pip install 'stick-slip-workbench[cluster]'"
WAIT = 30.0  # s for the scheduler, and for its first worker
GREETING = 10.0  # s for the first words of a scheduler
LONGEST_GREETING = 1 << 16  # bytes
DEFAULT_PORT = 8786

_mine = threading.local()
_grips: list[Grip] = []


def fit_on_worker(document: Mapping[str, object], folder: str, limit: float, module: str | None) -> tuple[Any, str]:
    """Runs on a Dask worker: fit in a process of its own, one per thread of the worker, which can be timed out."""
    grip: Grip | None = getattr(_mine, "grip", None)
    if grip is None or grip.closed:  # the batch before this one closed it
        grip = _mine.grip = Grip(module)
        _grips.append(grip)
    part = new_part(Path(folder))
    return asdict(grip.run(Job.from_document(document), part, limit)), str(part)


def end_grips() -> None:
    """Runs on a Dask worker: end its fitting processes, which hold memory that nobody needs any more."""
    while _grips:
        _grips.pop().close()


def look_around(folder: str) -> tuple[bool, str]:
    """Runs on a Dask worker: whether it sees the folder of the batch, and its numerics."""
    return Path(folder).is_dir(), numerics()


def _check_peer(address: str) -> None:
    """See whether a scheduler speaks at a TCP address, before Dask takes memory for whatever another peer says.

    A scheduler speaks first: the length of its greeting in eight bytes, then the greeting, a few hundred bytes.

    Raises:
        OSError: nobody listens, or says nothing for ten seconds, or something else.
    """
    from distributed.comm.addressing import parse_address, parse_host_port

    scheme, place = parse_address(address)
    if scheme != "tcp":
        return  # encrypted: only Dask knows how to ask
    with socket.create_connection(parse_host_port(place, DEFAULT_PORT), timeout=GREETING) as peer:
        said = peer.recv(8, socket.MSG_WAITALL)
        length = int.from_bytes(said, sys.byteorder)
        if len(said) < 8 or not 0 < length <= LONGEST_GREETING or len(peer.recv(length, socket.MSG_WAITALL)) < length:
            raise OSError(f"what answers speaks no Dask: {said!r}")


class ClusterWorkers:
    """The workers of a Dask cluster; they must see the logs and the batch folder under the same paths as we do.

    Raises:
        BatchError: Dask is not installed, or nothing answers at the address.
    """

    def __init__(self, address: str, module: str | None = None) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise BatchError([f"--scheduler needs dask.distributed, which is not installed; {EXTRA}"]) from None
        self._module = module
        try:
            _check_peer(address)
            self._client = Client(address, timeout=WAIT, set_as_default=False, name="stickslip-batch")
        except (OSError, ValueError, TypeError) as error:
            raise BatchError([f"--scheduler {address}: no Dask scheduler answers there ({error}); start one"]) from None
        self.count = 0
        with self._closing_on_error():
            self._client.wait_for_workers(1, timeout=WAIT)
            self.count = sum(self._client.nthreads().values())

    def check(self, folder: Path) -> None:
        """Ask every worker whether it sees the folder and has our numerics.

        Raises:
            BatchError: one complaint per worker that cannot take part.
        """
        with self._closing_on_error():
            told = self._client.run(look_around, str(folder))
        complaints = [
            f"the Dask worker {at} does not see {folder}; share that folder" for at, a in told.items() if not a[0]
        ]
        complaints += [
            f"the Dask worker {at} has other numerics ({other}); expected {numerics()}: install the same versions"
            for at, (_, other) in told.items()
            if other != numerics()
        ]
        if complaints:
            self._client.close()
            raise BatchError(complaints)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._client.status == "running":  # else the scheduler is gone, and asking would wait for it
            with suppress(OSError, RuntimeError, ValueError, TimeoutError):
                self._client.run(end_grips, on_error="ignore")
        self._client.close()

    def send(self, job: Job, folder: Path, limit: float) -> Pending:
        """Have a job fitted by whichever worker is free; Dask sends it again where its worker dies."""
        args = (job.as_document(), str(folder), limit, self._module)
        return _Sent(self._client.submit(fit_on_worker, *args, pure=False), job, folder)

    @contextmanager
    def _closing_on_error(self) -> Iterator[None]:
        try:
            yield
        except (OSError, TimeoutError) as error:
            self._client.close()
            raise BatchError([f"the Dask cluster has no worker that answers ({error}); start one"]) from None


class _Sent:
    """A job on its way to a Dask worker."""

    def __init__(self, future: Any, job: Job, folder: Path) -> None:
        self._future, self._job, self._folder = future, job, folder

    def add_done_callback(self, function: Callable[..., object], /) -> None:
        self._future.add_done_callback(lambda _future: function(self))

    def cancel(self) -> object:
        return self._future.cancel()

    def result(self) -> Answer:
        """The answer; what went wrong on the way there and back is one, too."""
        if self._future.cancelled():  # by nobody of ours: Dask does so when it loses its scheduler
            raise WorkersLostError("the Dask scheduler was lost; start it again, then go on with --resume")
        error = self._future.exception()
        if error is not None:
            words = f"the fit took down every Dask worker it was given to, or never came back ({error})"
            return End(CRASHED, " ".join(words.split())), new_part(self._folder)
        end, part = self._future.result()
        return End(**end), Path(part)
