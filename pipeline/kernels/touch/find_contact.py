"""Find the circle in which a ball touches the gel, in a photograph.

Valid range: one contact of 8 pixels radius or more, whose rim shows as a change of colour.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pipeline.errors import InvalidInput
from pipeline.kernels.touch.calibration_fit import Circle

SMALLEST = 8.0
"""Pixels: radius of a contact that is looked for at least."""
LEAST_CHANGE = 6.0
"""Levels by which a contact differs from the untouched image at least, where it differs most."""
ANGLES = np.linspace(0, 2 * np.pi, 180, endpoint=False)
STEPS = (8.0, 4.0, 2.0, 1.0, 0.5, 0.25)
"""Pixels by which centre and radius are moved, in turn."""


def find_contact(image: NDArray[np.uint8], untouched: NDArray[np.uint8]) -> Circle:
    """Find the contact of a ball.

    Parameters
    ----------
    image, untouched
        (rows, cols, 3) uint8, the photograph, and the one with nothing in the gel.

    Returns
    -------
    Its centre and radius, pixels; the centre of pixel (0, 0) is (0, 0).

    Raises
    ------
    InvalidInput
        The photograph shows no contact, or one that reaches over its rim.

    Notes
    -----
    The rim is the circle across which the change of colour jumps most. The search begins at the place where colours change, from
    several radii, and moves centre and radius by ever smaller steps.
    """
    change = ndimage.gaussian_filter(image.astype(float) - untouched, (1.5, 1.5, 0))
    size = ndimage.gaussian_filter(np.abs(change - np.median(change, axis=(0, 1))).mean(axis=2), 3)
    if size.max() < LEAST_CHANGE:
        raise InvalidInput(f"nothing touches: it differs from the untouched one by {size.max():.1f} levels, {LEAST_CHANGE:g} are needed")
    labels, _ = ndimage.label(size > size.max() / 3)
    blob = labels == labels[np.unravel_index(size.argmax(), size.shape)]
    y, x = ndimage.center_of_mass(blob)
    radius = float(np.sqrt(blob.sum() / np.pi))
    starts = [(x, y, share * radius) for share in (0.5, 0.65, 0.8, 1.0, 1.2) if share * radius >= SMALLEST]
    if not starts:
        raise InvalidInput(f"the contact's radius is {radius:.1f} pixels; {SMALLEST:g} are needed")
    found = max((_climb(change, start) for start in starts), key=lambda circle: _jump(change, circle))
    x, y, radius = found
    if not (radius <= x <= image.shape[1] - 1 - radius and radius <= y <= image.shape[0] - 1 - radius):
        raise InvalidInput(f"the contact at ({x:.0f}, {y:.0f}), of {radius:.0f} pixels radius, reaches over the image's rim")
    return Circle(x, y, radius)


def _climb(change: NDArray[np.float64], start: tuple[float, float, float]) -> tuple[float, float, float]:
    best, value = start, _jump(change, start)
    for step in STEPS:
        better = True
        while better:
            better = False
            for axis in range(3):
                for sign in (-step, step):
                    other = (best[0] + sign * (axis == 0), best[1] + sign * (axis == 1), best[2] + sign * (axis == 2))
                    if other[2] >= SMALLEST and (new := _jump(change, other)) > value:
                        best, value, better = other, new, True
    return best


def _jump(change: NDArray[np.float64], circle: tuple[float, float, float]) -> float:
    """Mean jump of colours across a circle, levels: between 2 pixels inside and 2 outside."""
    x, y, radius = circle
    near, far = (
        [
            ndimage.map_coordinates(change[..., c], [y + r * np.sin(ANGLES), x + r * np.cos(ANGLES)], order=1, mode="nearest")
            for c in range(3)
        ]
        for r in (radius - 2, radius + 2)
    )
    return float(np.abs(np.subtract(near, far)).mean())
