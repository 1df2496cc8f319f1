"""Files that numpy saved."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import foreign_content, read_file

MAX_BYTES = 2**28


def read_array(path: Path) -> NDArray[Any]:
    """Read a .npy file; compare its header with its size before allocating memory.

    Raises
    ------
    InvalidInput
        The file cannot be read, is too large or damaged, or holds objects.
    """
    file = io.BytesIO(read_file(path, MAX_BYTES))
    try:
        if (version := np.lib.format.read_magic(file)) != (1, 0):
            raise ValueError(f"it is of numpy's format {version}")
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
        values = file.read()
        if dtype.hasobject or min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(values):
            raise ValueError(f"it claims {dtype} {shape}, and has {len(values)} bytes of values")
        return np.frombuffer(values, dtype).reshape(shape, order="F" if fortran else "C")
    except Exception as error:  # numpy's parsing of headers raises whatever it trips over
        foreign = foreign_content(file.getvalue())
        problem = f"is {foreign}" if foreign else f"cannot be read as an array ({error}); save it with numpy.save"
        raise InvalidInput(f"{path} {problem}") from error
