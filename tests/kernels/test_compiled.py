"""Compiled functions give the bits of the Python functions, with and without a folder for their machine code."""

import importlib
import pkgutil

import numpy as np
from numba.core.dispatcher import Dispatcher

import pipeline.kernels
from pipeline.kernels.compiled import compiled

SOURCE = """
def quotient(a, b):
    return a / b
"""


def test_functions_compile_without_a_writable_folder() -> None:
    made: dict = {}
    exec(SOURCE, made)  # numba keeps no machine code of a function without a file
    assert compiled(made["quotient"])(1.0, 0.0) == np.inf


def test_compiled_functions_call_none_of_another_file() -> None:
    """Numba keeps machine code by the file of a function, and does not see that one in another file has changed."""
    for module in pkgutil.walk_packages(pipeline.kernels.__path__, "pipeline.kernels."):
        for function in vars(importlib.import_module(module.name)).values():
            if isinstance(function, Dispatcher) and function.py_func.__module__ == module.name:
                used = (function.py_func.__globals__.get(name) for name in function.py_func.__code__.co_names)
                called = {other.py_func.__module__ for other in used if isinstance(other, Dispatcher)}
                assert called <= {module.name}, f"{module.name}.{function.__name__}"
