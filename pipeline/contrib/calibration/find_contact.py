"""Find the circle in which a ball touches the gel, in a photograph.

Valid range: one contact of 8 pixels radius or more, up to the ball's equator, whose rim shows as a change of colour, two fifths of it or
more in the image.
"""

import math
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from skimage.filters import gaussian
from skimage.measure import CircleModel, label, ransac, regionprops
from skimage.transform import warp_polar

from pipeline.contrib.calibration.ball_contact import Circle
from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Mask

SMALLEST = 8.0  # radius of a contact that is searched for, pixels
LEAST_CHANGE = 6.0  # from the untouched image, levels, where a contact differs most
LEAST_SEEN = 0.4  # share of a contact's rim that must lie in the image
LEAST_FILLED = 0.4  # share of a contact that must differ by a third of its largest change; else the circle may be wrong
MARGIN = 20  # pixels around a region of changed colours, in which the change fades
ANGLES, PER_PIXEL = 180, 4  # directions in which the rim is searched, and samples per pixel of radius
AT_RIM = 0.93
"""Share of the greatest change along a ray from the middle of a contact, at its rim: up to there the ball's slope grows, and around it the
gel's falls. Chosen by simulated photographs, where rims are known, and by annotated ones, whose radii differ by -4 and 9 % in two sets."""
ALIKE = 3.0  # standard deviation of smoothing across rays, in rays
FITS, SETTLED = 5, 0.2  # of the circle, each about the middle of the last; largest shift of the last one, radii
BEYOND = 1.05  # radii of the ball up to which the rim is searched
ASIDE = 0.06  # distance of points of the rim from the circle, radii, up to which they count
RIM = 2.0  # the same in pixels, at least
ONE_WAY = 0.7  # length of the mean change of a region's colours over their mean change, beyond which it is a shadow, not a second contact


def find_contact(
    image: NDArray[np.uint8],  # (rows, cols, 3)
    untouched: NDArray[np.uint8],  # (rows, cols, 3), with nothing in the gel
    largest: float,  # radius that a contact can have, pixels: the ball's
) -> Circle:
    """Find the contact of a ball in a photograph; the image's rim may cut it.

    Opposite sides of a ball slope oppositely, and their colours change oppositely: the centre is first sought where the change of colour
    is most nearly an odd function. Then a circle is fitted by RANSAC to the rim, a point in each direction that the image shows: the last
    in which the change is nearly its greatest. Where it falls fastest is the gel around the contact, far outside that of a deep press.
    """
    change = smooth_change(image, untouched)
    strength = gaussian(np.abs(change).mean(axis=2), 3)
    if strength.max() < LEAST_CHANGE:
        raise InvalidInput(f"nothing touches: it differs from the untouched one by {strength.max():.1f} of {LEAST_CHANGE:g} levels")
    regions = regionprops(label(strength > strength.max() / 3), intensity_image=strength)
    region, *others = sorted(regions, key=lambda region: -region.intensity_max)
    reach = min(BEYOND * largest, region.equivalent_diameter_area + 2 * SMALLEST)
    x, y = _by_symmetry(change, region)
    for _ in range(FITS):
        before = x, y
        x, y, radius = _fit_rim(change, x, y, reach)
    if math.dist(before, (x, y)) > SETTLED * radius:
        raise InvalidInput(f"no circle fits the rim of the contact at ({x:.0f}, {y:.0f}); give it in circles.csv")
    if radius < SMALLEST:
        raise InvalidInput(f"the contact's radius is {radius:.1f} pixels; {SMALLEST:g} are needed")
    _check_seen(_polar(change, x, y, int(radius) + 1)[1][:, int(radius * PER_PIXEL)], x, y)
    for other in others:
        row, col = other.centroid
        colours = change[tuple(other.coords.T)]
        one_way = np.linalg.norm(colours.mean(axis=0)) > ONE_WAY * np.linalg.norm(colours, axis=1).mean()
        apart = not one_way or math.dist((col, row), (x, y)) > 2 * largest  # for there are two radii between two balls
        if apart and other.area > np.pi * SMALLEST**2 and other.intensity_max > strength.max() / 2:
            shown = f"it shows a contact at ({x:.0f}, {y:.0f}) and a second one at ({col:.0f}, {row:.0f})"
            raise InvalidInput(f"{shown}; photograph one ball at a time, or give the contact that counts in circles.csv")
    row, col = np.indices(strength.shape)
    filled = float((strength > strength.max() / 3)[np.hypot(col - x, row - y) < radius].mean())
    if filled < LEAST_FILLED:
        raise InvalidInput(f"no circle fits where it differs from the untouched one: {100 * filled:.0f} % of the best one differ")
    return Circle(x, y, min(radius, largest))


def smooth_change(
    image: NDArray[np.uint8],  # (rows, cols, 3)
    untouched: NDArray[np.uint8],  # (rows, cols, 3)
) -> Array:  # (rows, cols, 3) levels
    """Compute the change of colours against the untouched photograph, without noise and drift of the whole image."""
    change = gaussian(image.astype(float) - untouched, 1.5, channel_axis=2)
    return np.asarray(change - np.median(change, axis=(0, 1)))


def _by_symmetry(change: Array, region: Any) -> tuple[float, float]:
    """Find the point of a region around which the change of colours is most nearly odd, pixels."""
    top, left, bottom, right = region.bbox
    rows, cols = slice(max(top - MARGIN, 0), bottom + MARGIN), slice(max(left - MARGIN, 0), right + MARGIN)
    window = change[rows, cols]
    size = [2 * count for count in window.shape[:2]]
    opposite = -np.sum([scipy.fft.irfft2(scipy.fft.rfft2(channel, size) ** 2, size) for channel in np.moveaxis(window, 2, 0)], axis=0)
    y, x = (index / 2 for index in np.unravel_index(opposite.argmax(), opposite.shape))  # at i: of pixels whose indices sum to i
    return cols.start + x, rows.start + y


def _fit_rim(change: Array, x: float, y: float, reach: float) -> tuple[float, float, float]:
    """Fit a circle to the rim of a contact, seen from a point in it, up to a distance: its middle and radius, pixels."""
    rays, inside = _polar(change, x, y, int(reach) + 1)
    size = gaussian_filter1d(np.linalg.norm(rays, axis=2), ALIKE, axis=0, mode="wrap")
    shown = np.where(inside, size, 0)
    greatest, beyond = shown.max(axis=1, keepdims=True), np.arange(size.shape[1]) > shown.argmax(axis=1)[:, None]
    falls = beyond & (size < AT_RIM * greatest)
    at = np.where(falls.any(axis=1), falls.argmax(axis=1), size.shape[1] - 1)
    seen = np.take_along_axis(inside, at[:, None], axis=1)[:, 0]
    _check_seen(seen, x, y)
    angles, radii = np.linspace(0, 2 * np.pi, ANGLES, endpoint=False)[seen], at[seen] / PER_PIXEL
    points = np.stack([x + radii * np.cos(angles), y + radii * np.sin(angles)], axis=1)
    aside = max(RIM, ASIDE * float(np.median(radii)))
    circle, _ = ransac(points, CircleModel, min_samples=3, residual_threshold=aside, max_trials=200, rng=0)
    if not circle:
        raise InvalidInput(f"no circle fits the rim of the contact at ({x:.0f}, {y:.0f}); give it in circles.csv")
    return float(circle.center[0]), float(circle.center[1]), float(circle.radius)


def _check_seen(seen: Mask, x: float, y: float) -> None:
    """Raise an `InvalidInput` if the image shows a contact's rim in too few directions."""
    if seen.mean() < LEAST_SEEN:
        share = f"{100 * seen.mean():.0f} % of the rim of the contact at ({x:.0f}, {y:.0f})"
        raise InvalidInput(f"the image shows {share}; {100 * LEAST_SEEN:.0f} % are needed")


def _polar(image: Array, x: float, y: float, reach: int) -> tuple[Array, Mask]:
    """(angle, radius, channel) values around a point, up to `reach` pixels away, and (angle, radius) whether the image shows them."""
    shape = (ANGLES, reach * PER_PIXEL)
    rays = np.asarray(warp_polar(image, center=(y, x), radius=reach, output_shape=shape, channel_axis=2, mode="edge"))
    angles, radii = np.linspace(0, 2 * np.pi, ANGLES, endpoint=False)[:, None], np.arange(shape[1]) / PER_PIXEL
    col, row = x + radii * np.cos(angles), y + radii * np.sin(angles)
    return rays, (row >= 0) & (col >= 0) & (row <= image.shape[0] - 1) & (col <= image.shape[1] - 1)
