"""Loops that numpy could only spell as heaps of temporaries: written out for one element, and compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a function of numbers and arrays to machine code when it is first called, and keep that beside its file.

    The result is what Python computes, to the bit: nothing is reordered or fused, division by zero gives infinity or NaN, and
    indices are not checked. `.py_func` of what is returned is the function itself, which tests compare with.
    """
    try:
        kept = numba.njit(function, cache=True, error_model="numpy")
    except RuntimeError:  # no folder may be written to: it is compiled anew in every process
        kept = numba.njit(function, error_model="numpy")
    return cast(F, kept)
