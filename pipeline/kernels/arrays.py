"""Names of the array types that kernels take and return."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Floats = NDArray[np.floating]
Integers = NDArray[np.integer]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
