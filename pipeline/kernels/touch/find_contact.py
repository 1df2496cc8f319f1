"""Find the circle in which a ball touches the gel, in a photograph.

Valid range: one contact of 8 pixels radius or more, whose rim shows as a change of colour.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from pipeline.errors import InvalidInput
from pipeline.kernels.touch.calibration_fit import Circle

SMALLEST = 8.0
"""Pixels: radius of a contact that is looked for at least."""
LEAST_CHANGE = 6.0
"""Levels by which a contact differs from the untouched image at least, where it differs most."""
MARGIN = 20
"""Pixels around the place where colours change, in which they fade."""
ANGLES = np.linspace(0, 2 * np.pi, 180, endpoint=False)
REFINED = 0.05
"""Radii by which a circle found by symmetry is moved at most: where the rim is blurred, colours jump most in the middle of the contact."""
STEPS = (2.0, 1.0, 0.5, 0.25)
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
    Opposite sides of a ball slope oppositely, and their colours change oppositely: the centre is where the change of colour is most
    nearly an odd function. The rim is the circle around it where colours fade fastest; then centre and radius are moved, by ever
    smaller steps, to where the jump of colours across the circle is greatest.
    """
    change = ndimage.gaussian_filter(image.astype(float) - untouched, (1.5, 1.5, 0))
    size = ndimage.gaussian_filter(np.abs(change - np.median(change, axis=(0, 1))).mean(axis=2), 3)
    if size.max() < LEAST_CHANGE:
        raise InvalidInput(f"nothing touches: it differs from the untouched one by {size.max():.1f} levels, {LEAST_CHANGE:g} are needed")
    labels, _ = ndimage.label(size > size.max() / 3)
    start = _by_symmetry(change, labels == labels[np.unravel_index(size.argmax(), size.shape)])
    if start[2] < SMALLEST:
        raise InvalidInput(f"the contact's radius is {start[2]:.1f} pixels; {SMALLEST:g} are needed")
    x, y, radius = _climb(change, start)
    if not (radius <= x <= image.shape[1] - 1 - radius and radius <= y <= image.shape[0] - 1 - radius):
        raise InvalidInput(f"the contact at ({x:.0f}, {y:.0f}), of {radius:.0f} pixels radius, reaches over the image's rim")
    return Circle(x, y, radius)


def _by_symmetry(change: NDArray[np.float64], blob: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Centre and radius, pixels, of a contact in (rows, cols) `blob`, by symmetry and by how colours fade outwards."""
    rows, cols = ndimage.find_objects(blob.astype(int))[0]
    rows, cols = (slice(max(part.start - MARGIN, 0), part.stop + MARGIN) for part in (rows, cols))
    window = (change - np.median(change, axis=(0, 1)))[rows, cols]
    size = [2 * count for count in window.shape[:2]]
    opposite = -np.sum([fft.irfft2(fft.rfft2(channel, size) ** 2, size) for channel in np.moveaxis(window, 2, 0)], axis=0)
    y, x = (index / 2 for index in np.unravel_index(opposite.argmax(), opposite.shape))  # at i: of pixels whose indices sum to i
    radii = np.arange(2.0, 2 * np.sqrt(blob.sum() / np.pi) + 2 * SMALLEST)
    strength = ndimage.gaussian_filter1d([np.abs(_on_circle(window, x, y, radius)).mean() for radius in radii], 2)
    brightest = int(strength.argmax())
    return cols.start + x, rows.start + y, float(radii[brightest + np.gradient(strength)[brightest:].argmin()])


def _climb(change: NDArray[np.float64], start: tuple[float, float, float]) -> tuple[float, float, float]:
    best, value, reach = start, _jump(change, start), REFINED * start[2]
    for step in STEPS:
        better = True
        while better:
            better = False
            for axis in range(3):
                for sign in (-step, step):
                    other = (best[0] + sign * (axis == 0), best[1] + sign * (axis == 1), best[2] + sign * (axis == 2))
                    if np.abs(np.subtract(other, start)).max() <= reach and (new := _jump(change, other)) > value:
                        best, value, better = other, new, True
    return best


def _jump(change: NDArray[np.float64], circle: tuple[float, float, float]) -> float:
    """Mean jump of colours across a circle, levels: between 2 pixels inside and 2 outside."""
    x, y, radius = circle
    return float(np.abs(_on_circle(change, x, y, radius - 2) - _on_circle(change, x, y, radius + 2)).mean())


def _on_circle(change: NDArray[np.float64], x: float, y: float, radius: float) -> NDArray[np.float64]:
    """(angle, rgb) values on a circle."""
    at = [y + radius * np.sin(ANGLES), x + radius * np.cos(ANGLES)]
    return np.stack([ndimage.map_coordinates(change[..., c], at, order=1, mode="nearest") for c in range(3)], axis=-1)
