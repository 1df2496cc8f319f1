"""Compilation of loops that numpy could only express with large temporary arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a function of numbers and arrays to machine code at its first call, cached beside its file or in the user's cache.

    Parameters
    ----------
    function
        What is decorated; the Python function stays its `.py_func`.

    Returns
    -------
    The compiled function.

    Notes
    -----
    The result has the bits of the Python function: nothing is reordered or fused, division by zero gives infinity or NaN. Indices are
    not checked.
    """
    try:
        return cast(F, numba.njit(function, cache=True, error_model="numpy"))
    except RuntimeError:  # no cache folder is writable: every process compiles for itself
        return cast(F, numba.njit(function, error_model="numpy"))
