"""Compilation of loops that numpy could only express with large temporary arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(signature: str | list[str] | None = None) -> Callable[[F], F]:
    """Compile a function of numbers and arrays to machine code, cached beside its file or in the user's cache.

    Parameters
    ----------
    signature
        Types, or several alternatives, for which the function is compiled when its file is first imported; without, it is compiled
        when a compiled function calls it.

    Returns
    -------
    The decorator. `.py_func` of the decorated function is the Python function.

    Notes
    -----
    The result has the bits of the Python function: nothing is reordered or fused, division by zero gives infinity or NaN. Indices are
    not checked.
    """

    def compile_function(function: F) -> F:
        try:
            return cast(F, numba.njit(signature, cache=True, error_model="numpy")(function))
        except RuntimeError:  # no cache folder is writable: every process compiles for itself
            return cast(F, numba.njit(signature, error_model="numpy")(function))

    return compile_function
