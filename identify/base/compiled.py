"""CasADi functions called at the price of a function call: bound once to arrays, then only run."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base import native

Array = NDArray[np.float64]


class Compiled:
    """One function with one dense result, bound to the arrays it reads and to its own result (n,), column by column.

    Calling it runs the function on what the arrays hold now and returns the result array, which the next call
    overwrites. Holds buffers, so one per thread.
    """

    def __init__(self, function: ca.Function) -> None:
        if function.nnz_out(0) != function.numel_out(0):
            raise ValueError(f"the result of {function.name()} is not dense")
        self.given = [function.numel_in(i) for i in range(function.n_in())]
        self._result = np.zeros(function.numel_out(0))
        self._buffer, self._call = function.buffer()
        self._buffer.set_res(0, self._result.data)
        self._bound: list[Array] = []

    def bind(self, arrays: Sequence[Array]) -> None:
        """Read the arguments from these arrays (contiguous, float) from now on."""
        for i, array in enumerate(arrays):
            if array.size != self.given[i]:
                raise ValueError(f"argument {i} has {array.size} numbers; expected {self.given[i]}")
            self._buffer.set_arg(i, array.data)
        self._bound = list(arrays)  # kept alive: the buffers point into them

    def __call__(self) -> Array:
        """Run on what the arrays hold now."""
        self._call()
        return self._result


compiled = Compiled

# ----------------------------------------------------------------------------------------------------------------------
# One function for many lanes: mapped over chunks and called at the price of a few function calls.
# ----------------------------------------------------------------------------------------------------------------------

MANY = 32  # lanes per call: small enough to stay in cache, large enough to hide the call
WORK = 10_000  # instructions that hide the call as well: of a large function fewer lanes are called for at the end
RETRY = 0.1  # seconds more before it is asked again whether the machine code is there
KEPT = 0.1  # of what compiling takes: a function that has cost so much is compiled for later processes

_all: weakref.WeakSet[Mapped] = weakref.WeakSet()


def keep() -> None:
    """Have what this process used compiled in the background, the dearest first, for others that will use it."""
    _compile([mapped for mapped in _all if mapped.spent >= KEPT * mapped.cost])


def _compile(functions: Sequence[Mapped]) -> None:
    if not native.busy():
        dearest = sorted(functions, key=lambda mapped: -mapped.spent)
        native.start([(mapped.function, mapped.key) for mapped in dearest if mapped.key and not mapped.settled])


@dataclass(frozen=True)
class _Bench:
    """Arrays with room for several chunks of lanes, and the calls that work on each chunk of them."""

    function: ca.Function
    chunk: int
    given: list[Array]
    out: list[Array]
    calls: list[Callable[[], None]]
    buffers: list[ca.FunctionBuffer]  # kept alive: the calls run on them

    @staticmethod
    def of(function: ca.Function, lanes: int, chunk: int, room: int) -> _Bench:
        """Bind a function of so many lanes, mapped over a chunk, to arrays of so many chunks."""
        given = [np.zeros((room * chunk, function.numel_in(i) // lanes)) for i in range(function.n_in())]
        out = [np.zeros((room * chunk, function.numel_out(i) // lanes)) for i in range(function.n_out())]
        mapped = function.map(chunk // lanes)
        buffers, calls = [], []
        for first in range(0, room * chunk, chunk):
            buffer, call = mapped.buffer()
            for bind, arrays in ((buffer.set_arg, given), (buffer.set_res, out)):
                for i, array in enumerate(arrays):
                    if array.size:
                        bind(i, array[first : first + chunk].reshape(-1).data)
            buffers.append(buffer)
            calls.append(call)
        return _Bench(function, chunk, given, out, calls, buffers)

    def run(self, arguments: Sequence[Array]) -> list[Array]:
        """The results of so many lanes as there is room for; they hold until the next call."""
        count = arguments[0].shape[0]
        chunks = -(-count // self.chunk)
        for room, argument in zip(self.given, arguments, strict=True):
            room[:count] = argument
            room[count : chunks * self.chunk] = room[count - 1]
        for call in self.calls[:chunks]:
            call()
        return [out[:count] for out in self.out]


class Mapped:
    """A function with dense results, evaluated for any number of lanes at once.

    Runs in CasADi's virtual machine until machine code of it is found in the cache; both give the same numbers. It is
    compiled once it has cost as much as compiling does.
    """

    total = 0.0  # seconds that all of them took in this process so far

    def __init__(self, function: ca.Function, many: int = MANY) -> None:
        """many: lanes per call where there are so many; what is left of them is called for in smaller chunks."""
        self.function, self._many = function, many
        self.instructions = function.n_instructions()  # of one lane
        self._few = min(max(WORK // max(self.instructions, 1), 1), many)
        self._sizes = [function.numel_out(i) for i in range(function.n_out())]
        self.spent, self.cost = 0.0, native.seconds(function)  # seconds, so far and of compiling it
        self.settled, self._next_look = False, 0.0  # no better code will come; seconds spent before it is looked for
        self._local = threading.local()
        self._runs = (function, 1)  # the code that is called, and how many lanes it takes
        _all.add(self)

    @cached_property
    def key(self) -> str | None:
        """Under which its machine code is found; None where there will be none."""
        return native.key(self.function, lanes=True)

    @property
    def native(self) -> bool:
        """Whether machine code runs."""
        return self._runs[0] is not self.function

    def __call__(self, arguments: Sequence[Array]) -> list[Array]:
        """Arguments (n, size_i) or (n,), results (n, size_j)."""
        if not self.settled and self.spent >= self._next_look:
            self._look()
        since = time.perf_counter()  # a thread's own time would cost a tenth of a fit on some systems
        count, (code, lanes) = arguments[0].shape[0], self._runs
        many, few = (-(-chunk // lanes) * lanes for chunk in (self._many, self._few))
        whole = count - count % many
        arguments = [given.reshape(count, -1) for given in arguments]
        results = [np.empty((count, size)) for size in self._sizes]
        for chunk, part in ((many, slice(0, whole)), (few, slice(whole, count))):
            if part.stop > part.start:
                bench = self._bench(code, lanes, chunk, part.stop - part.start)
                for result, out in zip(results, bench.run([given[part] for given in arguments]), strict=True):
                    result[part] = out
        spent = time.perf_counter() - since
        self.spent += spent
        Mapped.total += spent
        return results

    def _bench(self, code: ca.Function, lanes: int, chunk: int, count: int) -> _Bench:
        """This thread's bench for a code of so many lanes a call, with room for `count` lanes."""
        benches: dict[int, _Bench] = self._local.__dict__.setdefault("benches", {})
        bench, chunks = benches.get(chunk), -(-count // chunk)
        if bench is None or bench.function is not code or len(bench.calls) < chunks:
            room = max(chunks, 2 * len(bench.calls) if bench is not None else 1)
            bench = benches[chunk] = _Bench.of(code, lanes, chunk, room)
        return bench

    def _look(self) -> None:
        """Take the machine code where it is there; have it made where the function has earned it."""
        found = None if self.key is None else native.find(self.key, self.function.name())
        if found is not None:
            self._runs = (found, found.nnz_out() // self.function.nnz_out())
        self.settled = found is not None or self.key is None or native.failed(self.key)
        if not self.settled and self.spent >= self.cost:
            _compile([mapped for mapped in _all if mapped.spent >= mapped.cost])
        self._next_look = max(self.cost, self.spent + RETRY)
