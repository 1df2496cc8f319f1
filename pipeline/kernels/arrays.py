"""Array types of kernels, and the check of shapes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Floats = NDArray[np.floating]
Integers = NDArray[np.integer]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

WHITE = 255  # the uint8 value of intensity 1


def check_shape(name: str, array: Any, *expected: int | str) -> None:
    """Refuse an array or tensor whose shape is not the expected one, in which a letter stands for any size."""
    shape = tuple(array.shape)
    if len(shape) != len(expected) or any(isinstance(size, int) and size != actual for size, actual in zip(expected, shape, strict=True)):
        raise ValueError(f"{name} of shape {shape} must be of shape ({', '.join(map(str, expected))})")
