"""Integration of slopes by a sparse least-squares solver: the slow twin of `integrate_slopes` and `free_pressed_rim`."""

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

Pixel = tuple[int, ...]


def integrate_slowly(slopes: NDArray[np.float64], pitch: tuple[float, float], pressed: float = np.inf) -> NDArray[np.float64]:
    """Find the z whose differences between neighbours are the mean slope times the pitch, one equation per pair; z = 0 beyond the rim.

    `slopes` is (2, rows, cols) along x and y; where a neighbour lies beyond the rim, its slope is 0. An equation with such a neighbour
    is dropped if the other pixel lies deeper than it says by more than `pressed`, and what is left is solved again.
    """
    shape = slopes.shape[1:]
    pairs: list[tuple[Pixel, Pixel]] = [
        (first, (first[0] + down, first[1] + 1 - down)) for down in (0, 1) for first in product(*(range(-1, n) for n in shape))
    ]
    pairs = [pair for pair in pairs if any(inside(pixel, shape) for pixel in pair)]
    while True:
        surface = solve(slopes, pitch, pairs)
        left = [pair for pair in pairs if resistance(surface, slopes, pitch, pair) <= pressed]
        if len(left) == len(pairs):
            return surface
        pairs = left


def inside(pixel: Pixel, shape: tuple[int, ...]) -> bool:
    return all(0 <= k < n for k, n in zip(pixel, shape, strict=True))


def solve(slopes: NDArray[np.float64], pitch: tuple[float, float], pairs: list[tuple[Pixel, Pixel]]) -> NDArray[np.float64]:
    shape = slopes.shape[1:]
    entries, right = list[tuple[int, int, float]](), list[float]()
    for pair in pairs:
        size, rise = equation(slopes, pitch, pair)
        for sign, pixel in zip((-1.0, 1.0), pair, strict=True):
            if inside(pixel, shape):
                entries.append((len(right), pixel[0] * shape[1] + pixel[1], sign / size))
        right.append(rise / size)
    number, unknown, value = zip(*entries, strict=True)
    matrix = coo_matrix((value, (number, unknown)), shape=(len(right), shape[0] * shape[1])).tocsr()
    return np.asarray(spsolve((matrix.T @ matrix).tocsc(), matrix.T @ np.array(right))).reshape(shape)


def equation(slopes: NDArray[np.float64], pitch: tuple[float, float], pair: tuple[Pixel, Pixel]) -> tuple[float, float]:
    """Return the distance of two neighbours, and by how much the second lies deeper by the slopes."""
    down = pair[1][0] - pair[0][0]
    size = pitch[0] if down else pitch[1]
    return size, size * sum(slopes[down][pixel] / 2 for pixel in pair if inside(pixel, slopes.shape[1:]))


def resistance(surface: NDArray[np.float64], slopes: NDArray[np.float64], pitch: tuple[float, float], pair: tuple[Pixel, Pixel]) -> float:
    """Return by how much the pixel of the rim lies deeper than its pair says; -inf for a pair inside."""
    inner = [inside(pixel, surface.shape) for pixel in pair]
    rise = equation(slopes, pitch, pair)[1]
    return float("-inf") if all(inner) else float(surface[pair[0]] + rise if inner[0] else surface[pair[1]] - rise)
