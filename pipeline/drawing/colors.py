"""Colours of fingers, charts and depth maps; glTF's linear colours and upright axis."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.touch.depth_maps import in_gel
from pipeline.kernels.touch.sensor import Sensor

Color = tuple[int, int, int]
Opaque = tuple[int, int, int, int]

COLORS: tuple[Color, ...] = ((0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 60, 140), (86, 180, 233), (213, 94, 0))
"""One colour per finger, after Okabe and Ito for the colour-blind; they repeat beyond six."""
VISION_COLORS: tuple[Opaque, ...] = ((150, 170, 190, 255), (120, 145, 170, 255), (175, 190, 205, 255), (135, 158, 180, 255))
"""Shades of vision charts; neighbours mostly differ."""
TOUCH_COLOR: Opaque = (230, 159, 0, 255)
MISS, BEYOND = np.array([250, 250, 250]), (np.array([205, 205, 210]), np.array([238, 238, 240]))
"""Where a depth map meets nothing; and, near to far, where it meets something beyond the gel."""
Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # from the world, z up, to glTF's frame, y up


def finger_colors(count: int) -> list[Color]:
    """List the colours of that number of fingers."""
    return [COLORS[k % len(COLORS)] for k in range(count)]


def depth_colors(
    depth: NDArray[np.floating],  # (rows, cols) m
    sensor: Sensor,
) -> NDArray[np.uint8]:  # (rows, cols, 3)
    """Colour a depth map: viridis in the gel (bright is deep), greys from there to the range, white where nothing is met."""
    gel, reach, met = sensor.w, sensor.range, np.isfinite(depth)
    near, far = BEYOND
    share = np.clip((np.where(met, depth, reach) - gel) / (reach - gel or 1), 0, 1)[..., None]  # the range may end with the gel
    colors = np.where(met[..., None], near + (far - near) * share, MISS)
    inside = in_gel(depth, sensor)
    colors[inside] = _viridis()[np.clip(depth[inside] / gel * 255, 0, 255).astype(int)]
    return np.round(colors).astype(np.uint8)


@cache
def _viridis() -> NDArray[np.float64]:  # (256, 3) 0 to 255, bright first
    import matplotlib

    return np.asarray(matplotlib.colormaps["viridis"](np.linspace(1, 0, 256))[:, :3] * 255)


def linear_colors(
    colors: NDArray[np.uint8],  # (N, 4) sRGB
) -> NDArray[np.uint8]:  # (N, 4) opaque
    """Make the linear colours that glTF's factors and vertex colours are."""
    from trimesh.visual.color import srgb_to_linear

    linear = srgb_to_linear(colors[:, :3] / 255)
    return np.concatenate([np.round(255 * linear), np.full((len(colors), 1), 255)], axis=1).astype(np.uint8)
