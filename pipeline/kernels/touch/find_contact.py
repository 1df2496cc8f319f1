"""Find the circle in which a ball touches the gel, in a photograph.

Valid range: one contact of 8 pixels radius or more, whose rim shows as a change of colour.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from skimage.filters import gaussian
from skimage.measure import CircleModel, label, ransac, regionprops
from skimage.transform import warp_polar

from pipeline.errors import InvalidInput
from pipeline.kernels.touch.calibration_fit import Circle

SMALLEST = 8.0
"""Pixels: radius of a contact that is looked for at least."""
LEAST_CHANGE = 6.0
"""Levels by which a contact differs from the untouched image at least, where it differs most."""
MARGIN = 20
"""Pixels around the place where colours change, in which they fade."""
ANGLES, PER_PIXEL = 180, 4
"""Directions in which the rim is sought, and samples per pixel of radius."""
REFINED = 0.05
"""Radii by which the rim is moved at most from the circle found by symmetry: where it is blurred, colours jump most in the middle."""
RIM = 2.0
"""Pixels by which a point of the rim lies beside the circle at most, and on either side of it those whose colours are compared."""


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
    nearly an odd function. The rim is the circle around it where colours fade fastest; then the circle is fitted by RANSAC to the
    points near it, one in each direction, where colours jump most.
    """
    change = gaussian(image.astype(float) - untouched, 1.5, channel_axis=2)
    size = gaussian(np.abs(change - np.median(change, axis=(0, 1))).mean(axis=2), 3)
    if size.max() < LEAST_CHANGE:
        raise InvalidInput(f"nothing touches: it differs from the untouched one by {size.max():.1f} levels, {LEAST_CHANGE:g} are needed")
    regions = regionprops(label(size > size.max() / 3), intensity_image=size)
    start = _by_symmetry(change, max(regions, key=lambda region: region.intensity_max))
    if start[2] < SMALLEST:
        raise InvalidInput(f"the contact's radius is {start[2]:.1f} pixels; {SMALLEST:g} are needed")
    x, y, radius = _by_rim(change, start)
    if not (radius <= x <= image.shape[1] - 1 - radius and radius <= y <= image.shape[0] - 1 - radius):
        raise InvalidInput(f"the contact at ({x:.0f}, {y:.0f}), of {radius:.0f} pixels radius, reaches over the image's rim")
    return Circle(x, y, radius)


def _by_symmetry(change: NDArray[np.float64], region: Any) -> tuple[float, float, float]:
    """Centre and radius, pixels, of a contact in a region, by symmetry and by how colours fade outwards."""
    top, left, bottom, right = region.bbox
    rows, cols = slice(max(top - MARGIN, 0), bottom + MARGIN), slice(max(left - MARGIN, 0), right + MARGIN)
    window = (change - np.median(change, axis=(0, 1)))[rows, cols]
    size = [2 * count for count in window.shape[:2]]
    opposite = -np.sum([fft.irfft2(fft.rfft2(channel, size) ** 2, size) for channel in np.moveaxis(window, 2, 0)], axis=0)
    y, x = (index / 2 for index in np.unravel_index(opposite.argmax(), opposite.shape))  # at i: of pixels whose indices sum to i
    reach = int(region.equivalent_diameter_area + 2 * SMALLEST)
    strength = gaussian(np.abs(_polar(window, x, y, reach, 1)).mean(axis=(0, 2)), 2)
    brightest = int(strength.argmax())
    return cols.start + x, rows.start + y, float(brightest + np.gradient(strength)[brightest:].argmin())


def _by_rim(change: NDArray[np.float64], start: tuple[float, float, float]) -> tuple[float, float, float]:
    """Fit a circle to the points around `start` where colours jump most, one in each direction."""
    x, y, radius = start
    across, reach = int(2 * RIM * PER_PIXEL), int(radius * (1 + REFINED) + RIM) + 2
    colours = _polar(change, x, y, reach, PER_PIXEL)
    jump = np.abs(colours[:, across:] - colours[:, :-across]).mean(axis=2)
    radii = RIM + np.arange(jump.shape[1]) / PER_PIXEL
    near = np.abs(radii - radius) <= REFINED * radius
    at, angles = radii[near][jump[:, near].argmax(axis=1)], np.linspace(0, 2 * np.pi, ANGLES, endpoint=False)
    points = np.stack([x + at * np.cos(angles), y + at * np.sin(angles)], axis=1)
    circle, _ = ransac(points, CircleModel, min_samples=3, residual_threshold=RIM, max_trials=200, rng=0)
    return float(circle.center[0]), float(circle.center[1]), float(circle.radius)


def _polar(image: NDArray[np.float64], x: float, y: float, reach: int, per_pixel: int) -> NDArray[np.float64]:
    """(angle, radius, rgb) values around a point, out to a radius of `reach` pixels."""
    shape = (ANGLES, reach * per_pixel)
    return np.asarray(warp_polar(image, center=(y, x), radius=reach, output_shape=shape, channel_axis=2, mode="edge"))
