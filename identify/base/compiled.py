"""CasADi functions called at the price of a function call: bound once to arrays, then only run."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base import native, wide

Array = NDArray[np.float64]


class Compiled:
    """One function with one result, bound to the arrays it reads and to its own result (n,), column by column.

    Calling it runs the function on what the arrays hold now and returns the result array, which the next call
    overwrites. Holds buffers, so one per thread.
    """

    def __init__(self, function: ca.Function) -> None:
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


def compiled(function: ca.Function) -> Compiled:
    """A function ready to be bound; its result must be dense."""
    if function.nnz_out(0) != function.numel_out(0):
        raise ValueError(f"the result of {function.name()} is not dense")
    return Compiled(function)


# ----------------------------------------------------------------------------------------------------------------------
# One function for many lanes: mapped over chunks and called at the price of a few function calls.
# ----------------------------------------------------------------------------------------------------------------------

MANY = 32  # lanes per call: small enough to stay in cache, large enough to hide the call
WORK = 10_000  # instructions that hide the call as well: of a large function fewer lanes are called for at the end
WORTH = 1.0  # of what compiling takes: a function that has cost so much as it is now is compiled
AT_ONCE = 10.0  # seconds of compiling that are asked for at once: later others may have earned it more
RETRY = 0.1  # seconds more before it is asked again whether the machine code is there
USED = 0.02  # seconds that make a function worth keeping for later processes

_all: weakref.WeakSet[Mapped] = weakref.WeakSet()


def keep() -> None:
    """Have everything compiled, in the background, that this process used and others will use again."""
    if not native.busy():
        native.start([job for mapped in list(_all) if mapped.used for job in mapped.jobs[-1:]])


def _compile() -> None:
    """Have functions compiled in the background that have earned it, as many as are soon done, the dearest first."""
    if native.busy():
        return
    jobs, needed = [], 0.0
    for mapped in sorted((m for m in list(_all) if m.earned), key=lambda m: m.spent, reverse=True):
        if needed < AT_ONCE:
            jobs += mapped.jobs[:1]
            needed += native.seconds(*mapped.jobs[0])
    native.start(jobs)


@dataclass(frozen=True, eq=False)
class _Code:
    """What runs: a function that takes so many lanes at once."""

    function: ca.Function
    lanes: int

    def whole(self, chunk: int) -> int:
        """The next larger number of lanes that it takes."""
        return -(-chunk // self.lanes) * self.lanes


@dataclass(frozen=True)
class _Bench:
    """Arrays with room for several chunks of lanes, and the calls that work on each chunk of them."""

    chunk: int
    given: list[Array]
    out: list[Array]
    calls: list[Callable[[], None]]
    buffers: list[ca.FunctionBuffer]  # kept alive: the calls run on them
    code: _Code

    @staticmethod
    def of(code: _Code, chunk: int, room: int) -> _Bench:
        """Bind a function, mapped over a chunk, to arrays of so many chunks."""
        function, lanes = code.function, code.lanes
        given = [np.zeros((room * chunk, function.numel_in(i) // lanes)) for i in range(function.n_in())]
        out = [np.zeros((room * chunk, function.numel_out(i) // lanes)) for i in range(function.n_out())]
        mapped = function.map(chunk // lanes)
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
        return _Bench(chunk, given, out, calls, buffers, code)

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

    total = 0.0  # seconds that all of them took in this process so far

    def __init__(self, function: ca.Function, many: int = MANY) -> None:
        """many: lanes per call where there are so many; what is left of them is called for in smaller chunks."""
        self._function, self._many = function, many
        self.instructions = function.n_instructions()  # of one lane
        self._few = min(max(WORK // max(self.instructions, 1), 1), many)
        self._sizes = [function.numel_out(i) for i in range(function.n_out())]
        self.spent, self._ask = 0.0, 0.0  # seconds, since it runs as it runs now
        self._keys: tuple[str, ...] = ()
        self._local = threading.local()
        self._code = _Code(function, 1)
        self._asked = self._settled = False
        _all.add(self)

    @property
    def native(self) -> bool:
        """Whether machine code runs, of whatever level."""
        return self._code.function is not self._function

    def __call__(self, arguments: Sequence[Array]) -> list[Array]:
        """Arguments (n, size_i) or (n,), results (n, size_j)."""
        if not self._settled and self.spent >= self._ask:
            self._look()
        since = time.perf_counter()  # a thread's own time would cost a tenth of a fit on some systems
        count = arguments[0].shape[0]
        code = self._code
        many, few = code.whole(self._many), code.whole(self._few)
        whole = count - count % many
        arguments = [given.reshape(count, -1) for given in arguments]
        results = [np.empty((count, size)) for size in self._sizes]
        for chunk, lanes in ((many, slice(0, whole)), (few, slice(whole, count))):
            if lanes.stop > lanes.start:
                bench = self._bench(code, chunk, lanes.stop - lanes.start)
                for result, out in zip(results, bench.run([given[lanes] for given in arguments]), strict=True):
                    result[lanes] = out
        spent = time.perf_counter() - since
        self.spent += spent
        Mapped.total += spent
        return results

    def _bench(self, code: _Code, chunk: int, lanes: int) -> _Bench:
        """This thread's bench for what runs now, with room for so many lanes."""
        benches: dict[int, _Bench] = self._local.__dict__.setdefault("benches", {})
        bench, chunks = benches.get(chunk), -(-lanes // chunk)
        if bench is None or bench.code is not code or len(bench.calls) < chunks:
            room = max(chunks, 2 * len(bench.calls) if bench is not None else 1)
            bench = benches[chunk] = _Bench.of(code, chunk, room)
        return bench

    def _look(self) -> None:
        """Take the best machine code that is there; have better made if the function has earned it."""
        if not self._asked:
            self._keys, self._asked = native.keys(self._function, lanes=True), True
        for place in reversed(range(len(self._keys))):
            found = native.find(self._keys[place], self._function.name())
            if found is not None:
                self._code = _Code(found, wide.lanes_of(found, self._function))
                self._keys = self._keys[place + 1 :]
                self.spent = 0.0
                break
        self._keys = tuple(key for key in self._keys if not native.failed(key))
        self._settled = not self._keys
        if self.earned:
            _compile()
        worth = self._worth if self._keys else 0.0
        self._ask = worth if self.spent < worth else self.spent + RETRY

    @property
    def _worth(self) -> float:
        return WORTH * native.seconds(self._function, self._keys[0])

    @property
    def earned(self) -> bool:
        """Whether it has cost so much that it is compiled, or compiled better, while others wait for its numbers."""
        return bool(self._keys) and self.spent >= self._worth

    @property
    def used(self) -> bool:
        """Whether it was used enough to be kept for later processes."""
        return self.native or self.spent >= USED

    @property
    def jobs(self) -> list[tuple[ca.Function, str]]:
        """The function with the key of each way to compile it that is better than it runs now."""
        return [(self._function, key) for key in self._keys]
