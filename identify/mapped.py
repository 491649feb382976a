"""One function for many lanes: mapped over chunks and called at the price of a few function calls."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable, Sequence

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


class Mapped:
    """A function with dense results, evaluated for any number of lanes at once.

    Runs in CasADi's virtual machine until machine code of it is found in the cache; both give the same numbers.
    """

    def __init__(self, function: ca.Function, chunk: int) -> None:
        self._function, self._chunk = function, chunk
        self._sizes = [function.numel_out(i) for i in range(function.n_out())]
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
        since = time.thread_time()
        count, chunk = arguments[0].shape[0], self._chunk
        padded = -(-count // chunk) * chunk
        given = []
        for a in arguments:
            full = np.empty((padded, a.shape[1] if a.ndim > 1 else 1))
            full[:count] = a.reshape(count, -1)
            full[count:] = full[count - 1] if count else 0.0
            given.append(full)
        out = [np.empty((padded, size)) for size in self._sizes]
        buffer, call = self._buffer()
        for first in range(0, padded, chunk):
            for i, a in enumerate(given):
                if a.size:
                    buffer.set_arg(i, a[first : first + chunk].reshape(-1).data)
            for i, o in enumerate(out):
                if o.size:
                    buffer.set_res(i, o[first : first + chunk].reshape(-1).data)
            call()
        self._spent += time.thread_time() - since
        return [o[:count] for o in out]

    def _buffer(self) -> tuple[ca.FunctionBuffer, Callable[[], None]]:
        """This thread's buffer of the function that runs now."""
        held = getattr(self._local, "held", None)
        if held is None or held[0] != self._version:
            if self._mapped is None:
                self._mapped = self._function.map(self._chunk)
            held = (self._version, *self._mapped.buffer())
            self._local.held = held
        return held[1], held[2]

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
