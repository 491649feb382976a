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

MANY = 32  # lanes per call: small enough to stay in cache, large enough to hide the call
WORK = 10_000  # instructions that hide the call as well: of a large function fewer lanes are called for at the end
WORTH = 1e-5  # seconds in the virtual machine per instruction from which on a function is compiled
RETRY = 0.1  # seconds more before it is asked again whether the machine code is there
USED = 0.02  # seconds in the virtual machine that make a function worth keeping for later processes

_all: weakref.WeakSet[Mapped] = weakref.WeakSet()


def keep() -> None:
    """Have everything compiled, in the background, that this process used and others will use again."""
    _compile([mapped for mapped in list(_all) if mapped.used])


def _compile(some: Sequence[Mapped]) -> None:
    """Have functions compiled in the background, those first that cost most."""
    if not native.busy():
        some = sorted(some, key=lambda mapped: mapped.spent, reverse=True)
        native.start([job for mapped in some if (job := mapped.job) is not None])


@dataclass(frozen=True)
class _Bench:
    """Arrays with room for several chunks of lanes, and the calls that work on each chunk of them."""

    chunk: int
    given: list[Array]
    out: list[Array]
    calls: list[Callable[[], None]]
    buffers: list[ca.FunctionBuffer]  # kept alive: the calls run on them
    version: int

    @staticmethod
    def of(function: ca.Function, chunk: int, room: int, version: int) -> _Bench:
        """Bind a function, mapped over a chunk, to arrays of so many chunks."""
        given = [np.zeros((room * chunk, function.numel_in(i))) for i in range(function.n_in())]
        out = [np.zeros((room * chunk, function.numel_out(i))) for i in range(function.n_out())]
        mapped = function.map(chunk)
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
        return _Bench(chunk, given, out, calls, buffers, version)

    def run(self, arguments: Sequence[Array]) -> list[Array]:
        """The results of so many lanes as there is room for; they hold until the next call."""
        count = arguments[0].shape[0]
        chunks = -(-count // self.chunk)
        for held, given in zip(self.given, arguments, strict=True):
            held[:count] = given
            held[count : chunks * self.chunk] = held[count - 1]
        for call in self.calls[:chunks]:
            call()
        return [out[:count] for out in self.out]


class Mapped:
    """A function with dense results, evaluated for any number of lanes at once.

    Runs in CasADi's virtual machine until machine code of it is found in the cache; both give the same numbers.
    """

    def __init__(self, function: ca.Function, many: int = MANY) -> None:
        """many: lanes per call where there are so many; what is left of them is called for in smaller chunks."""
        self._function, self._many = function, many
        self._few = min(max(WORK // max(function.n_instructions(), 1), 1), many)
        self.spent, self._ask = 0.0, 0.0  # seconds in the virtual machine
        self._key: str | None = None
        self._local = threading.local()
        self._version = 0
        self._runs = function
        self._settled = False
        _all.add(self)

    @property
    def native(self) -> bool:
        """Whether machine code runs."""
        return self._version > 0

    def __call__(self, arguments: Sequence[Array]) -> list[Array]:
        """Arguments (n, size_i) or (n,), results (n, size_j)."""
        if not self._settled and self.spent >= self._ask:
            self._look()
        since = 0.0 if self._settled else time.thread_time()  # on some systems a tenth of a fit goes into such calls
        count = arguments[0].shape[0]
        whole = count - count % self._many
        arguments = [given.reshape(count, -1) for given in arguments]
        results = [np.empty((count, self._function.numel_out(i))) for i in range(self._function.n_out())]
        for chunk, lanes in ((self._many, slice(0, whole)), (self._few, slice(whole, count))):
            if lanes.stop > lanes.start:
                bench = self._bench(chunk, lanes.stop - lanes.start)
                for result, out in zip(results, bench.run([given[lanes] for given in arguments]), strict=True):
                    result[lanes] = out
        if not self._settled:
            self.spent += time.thread_time() - since
        return results

    def _bench(self, chunk: int, lanes: int) -> _Bench:
        """This thread's bench for the function that runs now, with room for so many lanes."""
        benches: dict[int, _Bench] = self._local.__dict__.setdefault("benches", {})
        bench, chunks = benches.get(chunk), -(-lanes // chunk)
        if bench is None or bench.version != self._version or len(bench.calls) < chunks:
            room = max(chunks, 2 * len(bench.calls) if bench is not None else 1)
            bench = benches[chunk] = _Bench.of(self._runs, chunk, room, self._version)
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
            self._runs, self._settled = found, True
            self._version += 1
        elif not self.earned:
            self._ask = WORTH * self._function.n_instructions()
        else:
            self._ask = self.spent + RETRY
            _compile([mapped for mapped in list(_all) if mapped.earned])

    @property
    def earned(self) -> bool:
        """Whether it has cost so much in the virtual machine that it is compiled while others wait for its numbers."""
        return self.spent >= WORTH * self._function.n_instructions()

    @property
    def used(self) -> bool:
        """Whether it was used enough to be kept for later processes."""
        return self.spent >= USED

    @property
    def job(self) -> tuple[ca.Function, str] | None:
        """Function and key, where it can be compiled and is not yet."""
        return None if self.native or self._key is None else (self._function, self._key)
