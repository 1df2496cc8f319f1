"""Colours and frame of meshes in files for other programs."""

import numpy as np
from numpy.typing import NDArray
from trimesh.visual.color import srgb_to_linear

Color = tuple[int, int, int, int]

VISION_COLORS: tuple[Color, ...] = ((150, 170, 190, 255), (120, 145, 170, 255), (175, 190, 205, 255), (135, 158, 180, 255))
"""Neighbouring vision charts mostly differ in shade."""
TOUCH_COLOR: Color = (230, 159, 0, 255)
"""Touch charts stand out (after Okabe and Ito: for the colour-blind too)."""
Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""From the world, z up, to glTF's frame, y up."""


def linear_colors(colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Turn (N, 4) sRGB colours into the linear ones that glTF's factors and vertex colours are; opaque."""
    linear = srgb_to_linear(colors[:, :3] / 255)
    return np.concatenate([np.round(255 * linear), np.full((len(colors), 1), 255)], axis=1).astype(np.uint8)
