"""Turn textures that are clamped or mirrored outside 0..1 into ones that repeat, as those of a `Look` do."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.formats.mesh_parts import check_count

Wrap = Literal["clamp", "mirror"]

STEPS = 8
"""Parts of its size by which a clamped texture is extended, so that parts of a mesh share the result."""

MAX_PIXELS = 2**24
"""Maximum number of pixels of a texture that is extended: one of 4096 × 4096."""


class Repeats:
    """The textures of one mesh file that were made to repeat; what several parts need is made once."""

    def __init__(self) -> None:
        self._made: dict[tuple[int, int, int, int], tuple[NDArray[np.uint8], NDArray[np.uint8]]] = {}

    def make(
        self, texture: NDArray[np.uint8], coordinates: NDArray[np.float64], axis: int, wrap: Wrap | None
    ) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
        """Make a texture that shows repeated what another shows clamped or mirrored along one axis.

        Parameters
        ----------
        texture
            (height, width, 4).
        coordinates
            (V,) of the vertices along the axis, 0..1 within the texture, in the direction of its pixels.
        axis
            0 along a column, 1 along a row.
        wrap
            What the texture shows outside 0..1; None where it repeats.

        Returns
        -------
        The texture, extended unless the vertices lie within it to half a pixel, and their coordinates in it.

        Raises
        ------
        InvalidInput
            The extended texture would have too many pixels.
        """
        size, low, high = texture.shape[axis], coordinates.min(initial=0), coordinates.max(initial=0)
        if wrap is None:
            return texture, coordinates
        if low > -0.5 / size and high < 1 + 0.5 / size:
            return texture, np.clip(coordinates, 0, 1)
        first, last = 0, 2 * size
        if wrap == "clamp":  # one pixel more at each end: colours are interpolated
            first, last = int(np.floor(low * STEPS) * size / STEPS) - 1, int(np.ceil(high * STEPS) * size / STEPS) + 1
        key = (id(texture), axis, first, last)
        if key not in self._made:
            pixels = texture.size // (4 * size) * (last - first)
            check_count("pixels in a clamped texture with what is seen outside it", pixels, MAX_PIXELS, "make it smaller")
            outside = np.arange(first, last)
            source = np.minimum(outside, last - 1 - outside) if wrap == "mirror" else np.clip(outside, 0, size - 1)
            self._made[key] = texture, texture.take(source, axis)  # with the original, so that its id stays taken
        return self._made[key][1], (coordinates * size - first) / (last - first)
