"""One function for many lanes: mapped over chunks and called at the price of a few function calls."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify import native

Array = NDArray[np.float64]

WORTH = 5e-5  # seconds in the virtual machine per instruction from which on a function is compiled
RETRY = 0.3  # seconds more before it is asked again whether the machine code is there
USED = 0.02  # seconds in the virtual machine that make a function worth keeping for later processes

_all: weakref.WeakSet[Mapped] = weakref.WeakSet()


def keep() -> None:
    """Have everything compiled, in the background, that this process used and others will use again."""
    if not native.busy():
        native.start([job for mapped in list(_all) if (job := mapped.wanted()) is not None])


@dataclass(frozen=True)
class _Bench:
    """Arrays with room for several chunks, and the calls that work on each chunk of them."""

    given: list[Array]
    out: list[Array]
    calls: list[Callable[[], None]]
    buffers: list[ca.FunctionBuffer]  # kept alive: the calls run on them
    version: int

    @staticmethod
    def of(mapped: ca.Function, chunk: int, room: int, version: int) -> _Bench:
        """Bind a function that is mapped over a chunk to arrays of so many chunks."""
        given = [np.zeros((room * chunk, mapped.numel_in(i) // chunk)) for i in range(mapped.n_in())]
        out = [np.zeros((room * chunk, mapped.numel_out(i) // chunk)) for i in range(mapped.n_out())]
        buffers, calls = [], []
        for first in range(0, room * chunk, chunk):
            buffer, call = mapped.buffer()
            for i, array in enumerate(given):
                if array.size:
                    buffer.set_arg(i, array[first : first + chunk].reshape(-1).data)
            for i, array in enumerate(out):
                if array.size:
                    buffer.set_res(i, array[first : first + chunk].reshape(-1).data)
            buffers.append(buffer)
            calls.append(call)
        return _Bench(given, out, calls, buffers, version)


class Mapped:
    """A function with dense results, evaluated for any number of lanes at once.

    Runs in CasADi's virtual machine until machine code of it is found in the cache; both give the same numbers.
    """

    def __init__(self, function: ca.Function, chunk: int) -> None:
        self._function, self._chunk = function, chunk
        self._spent, self._ask = 0.0, 0.0
        self._key: str | None = None
        self._local = threading.local()
        self._version = 0
        self._mapped: ca.Function | None = None
        self._settled = False
        _all.add(self)

    @property
    def native(self) -> bool:
        """Whether machine code runs."""
        return self._version > 0

    def __call__(self, arguments: Sequence[Array]) -> list[Array]:
        """Arguments (n, size_i) or (n,), results (n, size_j)."""
        if not self._settled and self._spent >= self._ask:
            self._look()
        since = 0.0 if self._settled else time.thread_time()  # on some systems a tenth of a fit goes into such calls
        count = arguments[0].shape[0]
        chunks = -(-count // self._chunk)
        bench = self._bench_for(chunks)
        for held, given in zip(bench.given, arguments, strict=True):
            held[:count] = given.reshape(count, -1)
            held[count : chunks * self._chunk] = held[count - 1] if count else 0.0
        for call in bench.calls[:chunks]:
            call()
        if not self._settled:
            self._spent += time.thread_time() - since
        return [out[:count].copy() for out in bench.out]

    def _bench_for(self, chunks: int) -> _Bench:
        """This thread's bench for the function that runs now, with room for so many chunks."""
        bench: _Bench | None = getattr(self._local, "bench", None)
        if bench is None or bench.version != self._version or len(bench.calls) < chunks:
            if self._mapped is None:
                self._mapped = self._function.map(self._chunk)
            room = max(chunks, 2 * len(bench.calls) if bench is not None else 1)
            bench = self._local.bench = _Bench.of(self._mapped, self._chunk, room, self._version)
        return bench

    def _look(self) -> None:
        """Take the machine code if it is there; have it made if the function has earned it."""
        if self._key is None:
            self._key = native.key(self._function)
        if self._key is None:
            self._settled = True
            return
        found = native.find(self._key, self._function.name())
        if found is not None:
            self._mapped, self._settled = found.map(self._chunk), True
            self._version += 1
        elif self._spent < (worth := WORTH * self._function.n_instructions()):
            self._ask = worth
        else:
            self._ask = self._spent + RETRY
            if not native.busy():
                native.start([(self._function, self._key)])

    def wanted(self) -> tuple[ca.Function, str] | None:
        """Function and key, where it was used enough and is not compiled yet."""
        if self.native or self._key is None or self._spent < USED:
            return None
        return self._function, self._key
