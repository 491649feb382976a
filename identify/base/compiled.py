"""CasADi functions called at the price of a function call: bound once to arrays, then only run."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable, Sequence
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


# One function for many rows of a batch: mapped over chunks and called at the price of a few function calls.

MANY = 32  # rows per call: small enough to stay in cache, large enough to hide the call
WORK = 10_000  # instructions that hide the call as well: of a large function fewer rows are called for at the end
RETRY = 0.1  # seconds more before the machine code is looked for again
KEPT = 0.1  # of what compiling takes: a function that has cost so much is compiled for later processes

_all: weakref.WeakSet[Mapped] = weakref.WeakSet()


def keep(share: float = KEPT) -> None:
    """Have what has cost this share of its compilation compiled in the background, the dearest first."""
    if not native.busy():
        dearest = sorted((m for m in _all if m.spent >= share * m.cost), key=lambda mapped: -mapped.spent)
        native.start([(mapped.function, mapped.key) for mapped in dearest if mapped.key and not mapped.settled])


class _Buffers:
    """Arrays with room for several chunks of rows, and the calls that work on each chunk of them."""

    def __init__(self, function: ca.Function, chunk: int, room: int) -> None:
        """Bind a function of one row, mapped over a chunk, to arrays of so many chunks."""
        self.function, mapped, size = function, function.map(chunk), room * chunk
        self.arguments = [np.zeros((size, function.numel_in(i))) for i in range(function.n_in())]
        self.results = [np.zeros((size, function.numel_out(i))) for i in range(function.n_out())]
        self._alive, self.calls = list[ca.FunctionBuffer](), list[Callable[[], None]]()
        for first in range(0, size, chunk):
            buffer, call = mapped.buffer()
            for bind, arrays in ((buffer.set_arg, self.arguments), (buffer.set_res, self.results)):
                for i, array in enumerate(arrays):
                    if array.size:
                        bind(i, array[first : first + chunk].reshape(-1).data)
            self._alive.append(buffer)  # the calls run on them
            self.calls.append(call)


class Mapped:
    """A function with dense results, evaluated for any number of rows at once.

    Runs in CasADi's virtual machine until machine code of it is found in the cache; both give the same numbers. It is
    compiled once it has cost as much as compiling does.
    """

    total = 0.0  # seconds that all of them took in this process so far

    def __init__(self, function: ca.Function, many: int = MANY, within: int = 0) -> None:
        """many: rows per call where there are so many; what is left of them is called for in smaller chunks. within:
        instructions of functions that this one calls."""
        self.function, self._many = function, many
        self.instructions = max(function.n_instructions(), within)  # of one row
        self._few = min(max(WORK // max(self.instructions, 1), 1), many)
        self.spent, self.cost = 0.0, native.PER_INSTRUCTION * self.instructions  # seconds, so far and of compiling it
        self._sizes = [function.numel_out(i) for i in range(function.n_out())]
        self.settled, self._next_look = False, 0.0  # no better code will come; seconds spent before it is looked for
        self._local = threading.local()
        self._code = function  # what is called
        _all.add(self)

    @cached_property
    def key(self) -> str | None:
        """Under which its machine code is found; None where there will be none."""
        return native.key(self.function)

    @property
    def native(self) -> bool:
        """Whether machine code runs."""
        return self._code is not self.function

    def __call__(self, arguments: Sequence[Array]) -> list[Array]:
        """Arguments (n, size_i) or (n,), results (n, size_j)."""
        if not self.settled and self.spent >= self._next_look:
            self._look()
        since = time.perf_counter()  # a thread's own time would cost a tenth of a fit on some systems
        known: dict[int, _Buffers] = self._local.__dict__.setdefault("buffers", {})
        code, count, many, few = self._code, arguments[0].shape[0], self._many, self._few
        arguments = [argument.reshape(count, -1) for argument in arguments]
        results = [np.empty((count, size)) for size in self._sizes]
        whole = count - count % many
        for chunk, part in ((many, slice(0, whole)), (few, slice(whole, count))):
            size, buffers = part.stop - part.start, known.get(chunk)
            if not size:
                continue
            chunks = -(-size // chunk)
            if buffers is None or buffers.function is not code or len(buffers.calls) < chunks:
                room = max(chunks, 2 * len(buffers.calls) if buffers is not None else 1)
                buffers = known[chunk] = _Buffers(code, chunk, room)
            for place, argument in zip(buffers.arguments, arguments, strict=True):
                place[:size] = argument[part]
                place[size : chunks * chunk] = place[size - 1]  # the last chunk is filled up with its last row
            for call in buffers.calls[:chunks]:
                call()
            for result, place in zip(results, buffers.results, strict=True):
                result[part] = place[:size]
        spent = time.perf_counter() - since
        self.spent += spent
        Mapped.total += spent
        return results

    def _look(self) -> None:
        """Take the machine code where it is there; have it made where the function has earned it."""
        code = None if self.key is None else native.find(self.key, self.function.name())
        self._code = self.function if code is None else code
        self.settled = code is not None or self.key is None or native.failed(self.key)
        if not self.settled and self.spent >= self.cost:
            keep(1.0)
        self._next_look = max(self.cost, self.spent + RETRY)
