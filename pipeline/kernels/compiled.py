"""Compilation of loops that numpy could only express with large temporary arrays."""

import sys
from collections.abc import Callable
from contextvars import ContextVar
from functools import cached_property, update_wrapper, wraps
from typing import Any, TypeVar, cast

import numpy as np

F = TypeVar("F", bound=Callable[..., object])

_uncompiled = ContextVar("_uncompiled", default=False)  # whether compiled functions that are called run as Python


def compiled(function: F) -> F:
    """Compile a function of numbers and arrays at its first call; division by zero gives infinity or NaN.

    Numba keeps the machine code beside the function's file, or in the user's cache. `.py_func` is the Python function, whose bits the
    compiled one gives: nothing is reordered or fused. Indices are not checked. Copy slices in a loop: ``a[m:n] = b`` takes numba three
    seconds to compile. `numba.guvectorize` is not used: its cache is not safe for several processes (numba #10128).
    """
    return cast(F, _Compiled(function))


def for_few(function: F) -> F:
    """Run a compiled function, for few numbers, as Python where numba is not imported: that takes half a second and 100 MB."""

    @wraps(function)
    def run(*arguments: object) -> object:
        before = _uncompiled.set("numba" not in sys.modules)
        try:
            with np.errstate(all="ignore"):
                return function(*arguments)
        finally:
            _uncompiled.reset(before)

    return cast(F, run)


class _Compiled:
    """A function that numba compiles when it is first called, here or by another compiled one: importing numba takes half a second."""

    def __init__(self, function: Callable[..., object]) -> None:
        self.py_func = function
        update_wrapper(self, function)

    def __call__(self, *arguments: object) -> object:
        return (self.py_func if _uncompiled.get() else self._dispatcher)(*arguments)

    @property
    def _numba_type_(self) -> Any:
        """The type by which numba finds the compiled function in other functions."""
        return self._dispatcher._numba_type_

    @cached_property
    def _dispatcher(self) -> Any:
        import numba

        try:
            return numba.njit(error_model="numpy", cache=True)(self.py_func)
        except RuntimeError:  # no cache folder is writable: every process compiles for itself
            return numba.njit(error_model="numpy")(self.py_func)
