"""The closed mesh of a reconstruction, coloured where an image shows it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.vision.vertex_colors import seen_colors


@dataclass(frozen=True)
class ClosedMesh:
    """Hold the closed mesh of a reconstruction.

    Attributes
    ----------
    vertices, faces
        (V, 3) float64, in the frame and unit of the reconstruction, and (F, 3) int64, normals outwards.
    colors
        (V, 3) uint8, from the image.
    seen
        (V,) bool: whether the image shows the vertex; the others have no colour.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    colors: NDArray[np.uint8]
    seen: NDArray[np.bool_]

    @classmethod
    def grey(cls, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> ClosedMesh:
        """Make a closed mesh without colours, of which no image shows anything."""
        return cls(vertices, faces, np.zeros((len(vertices), 3), np.uint8), np.zeros(len(vertices), bool))

    def coloured(self, image: NDArray[np.uint8], matrix: NDArray[np.float64], mask: NDArray[np.bool_]) -> ClosedMesh:
        """Colour the vertices that an image shows; parameters as of `seen_colors`."""
        colors, seen = seen_colors(self.vertices, self.faces, image, matrix, mask)
        return replace(self, colors=colors, seen=seen)
