"""CasADi functions called at the price of a function call: bound once to arrays, then only run."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

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
