"""Compiled functions give the bits of the Python functions, with and without a folder for their machine code."""

from __future__ import annotations

import numpy as np

from pipeline.kernels.compiled import compiled

SOURCE = """
def quotient(a, b):
    return a / b
"""


def test_functions_compile_without_a_writable_folder() -> None:
    made: dict = {}
    exec(SOURCE, made)  # numba keeps no machine code of a function without a file
    assert compiled(made["quotient"])(1.0, 0.0) == np.inf
