"""Compiled functions give the bits of the Python functions, with and without a folder for their machine code."""

from __future__ import annotations

import numba
import numpy as np

from pipeline.kernels.compiled import cached, compiled

SOURCE = """
def quotient(a, b):
    return a / b

def scaled(values, factor, product):
    for i in range(len(values)):
        product[i] = values[i] * factor
"""


def test_cached_compiles_without_a_writable_folder() -> None:
    made: dict = {}
    exec(SOURCE, made)  # numba keeps no machine code of a function without a file
    assert compiled(made["quotient"])(1.0, 0.0) == np.inf
    ufunc = cached(numba.guvectorize, ["void(float64[:], float64, float64[:])"], "(n),()->(n)")(made["scaled"])
    np.testing.assert_array_equal(ufunc(np.ones((2, 3)), 2.0), np.full((2, 3), 2.0))
    np.testing.assert_array_equal(ufunc(np.ones(3), np.array([2.0, 3.0])), [[2.0] * 3, [3.0] * 3])
