"""Compilation of loops that numpy could only express with large temporary arrays."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a function of numbers and arrays at its first call; division by zero gives infinity or NaN.

    The machine code is kept beside the function's file or in the user's cache; the Python function is the result's
    `.py_func`. The result has the bits of the Python function: nothing is reordered or fused. Indices are not checked.
    Copy slices in a loop, not by ``a[m:n] = b``: numba compiles the words of an error into that, which takes three
    seconds. `numba.guvectorize` is not used: its cache is not safe for several processes (numba #10128).
    """
    try:
        return cast(F, numba.njit(error_model="numpy", cache=True)(function))
    except RuntimeError:  # no cache folder is writable: every process compiles for itself
        return cast(F, numba.njit(error_model="numpy")(function))
