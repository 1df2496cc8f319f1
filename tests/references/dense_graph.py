"""The averages over neighbours of a batch, slowly: a dense adjacency filled face by face, vertices compared by their coordinates."""

from collections.abc import Sequence
from itertools import permutations

import numpy as np


def square_faces(side: int) -> list[tuple[int, int, int]]:
    """Faces of a touch chart: every cell is cut along the diagonal from (row, column) to (row + 1, column + 1)."""
    faces = []
    for row in range(side - 1):
        for column in range(side - 1):
            here, across = row * side + column, (row + 1) * side + column + 1
            faces += [(here, here + 1, across), (here, across, across - 1)]
    return faces


def dense_mean(
    faces: np.ndarray, vertices: np.ndarray, centres: np.ndarray, side: int, counts: Sequence[int], *, touch_edges: str = "centres"
) -> np.ndarray:
    """(N, N) rows that sum to 1, from the vision charts' faces, vertices and centres."""
    size = sum(len(vertices) + count * side * side for count in counts)
    adjacency = np.eye(size)
    first = 0
    for count in counts:
        for face in faces:
            for a, b in permutations(face, 2):
                adjacency[first + a, first + b] = 1
        for a in range(len(vertices)):
            for b in np.flatnonzero(np.abs(vertices - vertices[a]).max(axis=1) < 1e-9):
                adjacency[first + a, first + b] = 1
        touch = first + len(vertices)
        for _ in range(count):
            for face in square_faces(side):
                for a, b in permutations(face, 2):
                    adjacency[touch + a, touch + b] = 1
            middle = touch + (side * side - 1) // 2
            if touch_edges == "all":
                adjacency[first : first + len(vertices), middle] = 1
            for centre in centres if touch_edges == "centres" else ():
                adjacency[middle, first + centre] = adjacency[first + centre, middle] = 1
            touch += side * side
        first = touch
    return adjacency / adjacency.sum(axis=1, keepdims=True)
