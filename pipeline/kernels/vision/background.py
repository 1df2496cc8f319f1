"""Find the background of an image: it has the colour of most of the border."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.arrays import Mask

ALIKE = 6  # levels of 255 in each colour by which a pixel of the background differs at most from the image's border


def foreground(image: NDArray[np.uint8]) -> Mask:
    """Find the pixels of an image, (rows, cols, 3), that do not have the colour of most of its border: (rows, cols) bool."""
    return np.asarray((np.abs(image - np.median(border(image), axis=0)) > ALIKE).any(axis=2))


def background_color(image: NDArray[np.uint8]) -> tuple[int, int, int]:
    """Compute the colour of most of the border of an image, (rows, cols, 3): sRGB."""
    red, green, blue = (int(level) for level in np.median(border(image), axis=0))
    return red, green, blue


def border(image: NDArray[Any]) -> NDArray[Any]:
    """Take the outermost pixels of an image (rows, cols, …): (N, …), the corners twice."""
    return np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
