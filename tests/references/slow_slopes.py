"""Integration of slopes by a sparse least-squares solver: the slow twin of `integrate_slopes`."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve


def integrate_slowly(slopes: NDArray[np.float64], pitch: tuple[float, float]) -> NDArray[np.float64]:
    """Find the z whose differences between neighbours are the mean slope times the pitch, one equation per pair; z = 0 beyond the rim.

    `slopes` is (2, rows, cols) along x and y; where a neighbour lies beyond the rim, its slope is 0.
    """
    rows, cols = slopes.shape[1:]
    entries: list[tuple[int, int, float]] = []
    right: list[float] = []
    for part, (down, across), size in ((slopes[0], (0, 1), pitch[1]), (slopes[1], (1, 0), pitch[0])):
        for row in range(-down, rows):
            for col in range(-across, cols):
                ends = [(row, col), (row + down, col + across)]
                rise = 0.0
                for sign, (r, c) in zip((-1.0, 1.0), ends, strict=True):
                    if 0 <= r < rows and 0 <= c < cols:
                        entries.append((len(right), r * cols + c, sign / size))
                        rise += part[r, c] / 2
                right.append(rise)
    number, unknown, value = zip(*entries, strict=True)
    matrix = coo_matrix((value, (number, unknown)), shape=(len(right), rows * cols)).tocsr()
    return np.asarray(spsolve((matrix.T @ matrix).tocsc(), matrix.T @ np.array(right))).reshape(rows, cols)
