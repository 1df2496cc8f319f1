"""Loops that numpy could only spell as heaps of temporaries: written out for one element, and compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(signature: str | None = None) -> Callable[[F], F]:
    """Compile a function of numbers and arrays to machine code, and keep that beside its file, or else in the user's cache.

    With a signature it is compiled for these types alone, when its file is first imported, once an installation; without, when a
    compiled function calls it. So several processes that compile at once write the same.

    The result is what Python computes, to the bit: nothing is reordered or fused, division by zero gives infinity or NaN, and
    indices are not checked. `.py_func` of what is returned is the function itself, which tests compare with.
    """

    def compile_it(function: F) -> F:
        try:
            return cast(F, numba.njit(signature, cache=True, error_model="numpy")(function))
        except RuntimeError:  # no folder may be written to: it is compiled anew in every process
            return cast(F, numba.njit(signature, error_model="numpy")(function))

    return compile_it
