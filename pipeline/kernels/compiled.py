"""Compilation of loops that numpy could only express with large temporary arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., object])


def cached(decorator: Callable[..., Any], *signature: object, **options: object) -> Callable[[Callable[..., Any]], Any]:
    """Compile with one of numba's decorators, and keep the machine code beside the function's file or in the user's cache.

    Parameters
    ----------
    decorator
        `numba.njit` or `numba.guvectorize`.
    signature, options
        Its arguments.

    Returns
    -------
    The decorator.

    Notes
    -----
    The result has the bits of the Python function: nothing is reordered or fused. Indices are not checked.
    """

    def compile_function(function: Callable[..., Any]) -> Any:
        try:
            return decorator(*signature, **options, cache=True)(function)
        except RuntimeError:  # no cache folder is writable: every process compiles for itself
            return decorator(*signature, **options)(function)

    return compile_function


def compiled(function: F) -> F:
    """Compile a function of numbers and arrays at its first call; division by zero gives infinity or NaN.

    Parameters
    ----------
    function
        The Python function, which `.py_func` of the compiled one is.

    Returns
    -------
    The compiled function.
    """
    faster: F = cached(numba.njit, error_model="numpy")(function)
    return faster
