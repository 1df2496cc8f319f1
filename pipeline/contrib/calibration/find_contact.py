"""Find the circle in which a ball touches the gel, in a photograph.

Valid range: one contact of 8 pixels radius or more, whose rim shows as a change of colour, two fifths of it or more in the image.
"""

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from skimage.filters import gaussian
from skimage.measure import CircleModel, label, ransac, regionprops
from skimage.transform import warp_polar

from pipeline.contrib.calibration.ball_contact import Circle
from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array

SMALLEST = 8.0  # radius of a contact that is searched for, pixels
LEAST_CHANGE = 6.0  # from the untouched image, levels, where a contact differs most
LEAST_SEEN = 0.4  # share of a contact's rim that must lie in the image
LEAST_FILLED = 0.4  # share of a contact that must differ by a third of its largest change; else the circle may be wrong
MARGIN = 20  # pixels around a region of changed colours, in which the change fades
ANGLES, PER_PIXEL = 180, 4  # directions in which the rim is searched, and samples per pixel of radius
FADES = (0.3, 0.15)  # largest shifts of the rim, radii, of the rounds that search where the change fades most
REFINED = 0.05  # the same of the round that searches where colours jump most: in the middle of a blurred rim
ROUNDNESS, LEAST_ROUND, ROUNDS = 0.2, 0.8, 10  # of `contact_aspect`: largest shift, radii; share in the image; rounds
RIM = 2.0  # largest distance of a point of the rim from the circle, pixels; and pixels on either side that are compared

Round = tuple[float, float, float]


def find_contact(image: NDArray[np.uint8], untouched: NDArray[np.uint8]) -> Circle:
    """Find the contact of a ball in a photograph (rows, cols, 3), given the one with nothing in the gel; the image's rim may cut it.

    Opposite sides of a ball slope oppositely, and their colours change oppositely: the centre is first sought where the change of
    colour is most nearly an odd function, and the rim as the circle around it where colours fade fastest. Lamps and the image's rim
    shift that centre. So a circle is fitted by RANSAC to the points, one in each direction that the image shows, where the strength
    of the change falls most, twice, and finally to those where colours jump most.
    """
    change = gaussian(image.astype(float) - untouched, 1.5, channel_axis=2)
    change -= np.median(change, axis=(0, 1))
    size = np.abs(change).mean(axis=2)
    strength = gaussian(size, 3)
    if strength.max() < LEAST_CHANGE:
        raise InvalidInput(f"nothing touches: it differs from the untouched one by {strength.max():.1f} of {LEAST_CHANGE:g} levels")
    regions = regionprops(label(strength > strength.max() / 3), intensity_image=strength)
    region, *others = sorted(regions, key=lambda region: -region.intensity_max)
    reach = int(region.equivalent_diameter_area + 2 * SMALLEST)
    x, y = _by_symmetry(change, region)
    circle = _checked((x, y, _fading(strength, x, y, reach)))
    for largest_shift in FADES:
        circle = _checked(_by_rim(strength[..., None], circle, largest_shift))
    x, y, _ = circle
    x, y, radius = _checked(_by_rim(change, (x, y, _fading(size, x, y, reach)), REFINED))
    for other in others:
        distance = np.hypot(other.coords[:, 1] - x, other.coords[:, 0] - y).min()
        if distance > radius + SMALLEST and other.area > np.pi * SMALLEST**2 and other.intensity_max > strength.max() / 2:
            row, col = other.centroid
            shown = f"it shows a contact at ({x:.0f}, {y:.0f}) and a second one at ({col:.0f}, {row:.0f})"
            raise InvalidInput(f"{shown}; photograph one ball at a time, or give the contact that counts in circles.csv")
    row, col = np.indices(strength.shape)
    filled = float((strength > strength.max() / 3)[np.hypot(col - x, row - y) < radius].mean())
    if filled < LEAST_FILLED:
        raise InvalidInput(f"no circle fits where it differs from the untouched one: {100 * filled:.0f} % of the best one differ")
    return Circle(x, y, radius)


def contact_aspect(image: NDArray[np.uint8], untouched: NDArray[np.uint8], contact: Circle) -> float | None:
    """Measure width over height of a contact's rim, in pixels; None if less than `LEAST_ROUND` of the rim shows.

    The rim lies, in each direction θ, where colours jump most within a fifth of the radius. a + b cos 2θ and the terms of 2θ and θ
    that shift and turn it are fitted to its radius by reweighted least squares; the ratio is (a + b)/(a - b).
    """
    change = gaussian(image.astype(float) - untouched, 1.5, channel_axis=2)
    angles, radii, visible = _rim_points(change, (contact.x, contact.y, contact.radius), ROUNDNESS)
    if visible < LEAST_ROUND:
        return None
    terms = np.stack([np.ones_like(angles), np.cos(2 * angles), np.sin(2 * angles), np.cos(angles), np.sin(angles)], axis=1)
    weights = np.ones(len(angles))
    for _ in range(ROUNDS):
        fitted = np.linalg.lstsq(terms * weights[:, None], radii * weights, rcond=None)[0]
        weights = 1 / (1 + ((radii - terms @ fitted) / RIM) ** 2)
    return float((fitted[0] + fitted[1]) / (fitted[0] - fitted[1]))


def _checked(circle: Round) -> Round:
    if circle[2] < SMALLEST:
        raise InvalidInput(f"the contact's radius is {circle[2]:.1f} pixels; {SMALLEST:g} are needed")
    return circle


def _by_symmetry(change: Array, region: Any) -> tuple[float, float]:
    """Find the point of a region around which the change of colours is most nearly odd, pixels."""
    top, left, bottom, right = region.bbox
    rows, cols = slice(max(top - MARGIN, 0), bottom + MARGIN), slice(max(left - MARGIN, 0), right + MARGIN)
    window = change[rows, cols]
    size = [2 * count for count in window.shape[:2]]
    opposite = -np.sum([scipy.fft.irfft2(scipy.fft.rfft2(channel, size) ** 2, size) for channel in np.moveaxis(window, 2, 0)], axis=0)
    y, x = (index / 2 for index in np.unravel_index(opposite.argmax(), opposite.shape))  # at i: of pixels whose indices sum to i
    return cols.start + x, rows.start + y


def _fading(strength: Array, x: float, y: float, reach: int) -> float:
    """Find the radius around a point at which the strength of the change falls fastest, pixels."""
    rays = _polar(strength[..., None], x, y, reach, 1)[..., 0]
    radii = np.flatnonzero(np.isfinite(rays).mean(axis=0) >= LEAST_SEEN / 2)
    if len(radii) < SMALLEST:
        raise InvalidInput(f"the contact at ({x:.0f}, {y:.0f}) lies outside the image; photograph one whose rim shows")
    mean = gaussian(np.nanmean(rays[:, radii], axis=0), 2)
    brightest = int(mean.argmax())
    return float(radii[brightest + np.gradient(mean)[brightest:].argmin()])


def _by_rim(values: Array, start: Round, largest_shift: float) -> Round:
    """Fit a circle to the points within `largest_shift` radii of `start`, one per direction, where strength falls or colours jump most."""
    x, y, radius = start
    angles, at, visible = _rim_points(values, start, largest_shift)
    if visible < LEAST_SEEN:
        raise InvalidInput(
            f"the image shows {100 * visible:.0f} % of the rim of the contact at ({x:.0f}, {y:.0f}), of {radius:.0f} pixels radius; "
            f"{100 * LEAST_SEEN:.0f} % are needed"
        )
    points = np.stack([x + at * np.cos(angles), y + at * np.sin(angles)], axis=1)
    aside = max(RIM, largest_shift * radius / 2) if values.shape[2] == 1 else RIM
    circle, _ = ransac(points, CircleModel, min_samples=3, residual_threshold=aside, max_trials=200, rng=0)
    if not circle:
        raise InvalidInput(f"no circle fits the rim of the contact at ({x:.0f}, {y:.0f}); give it in circles.csv")
    return float(circle.center[0]), float(circle.center[1]), float(circle.radius)


def _rim_points(values: Array, start: Round, largest_shift: float) -> tuple[Array, Array, float]:
    """Find the rim near a circle: angles, and the radius at each where strength falls or colours jump most; and the share in the image."""
    x, y, radius = start
    across, reach = int(2 * RIM * PER_PIXEL), int(radius * (1 + largest_shift) + RIM) + 2
    rays = _polar(values, x, y, reach, PER_PIXEL)
    fall = rays[:, :-across] - rays[:, across:]
    jump = fall[..., 0] if fall.shape[2] == 1 else np.abs(fall).mean(axis=2)
    radii = RIM + np.arange(jump.shape[1]) / PER_PIXEL
    in_range = np.abs(radii - radius) <= largest_shift * radius
    visible = np.isfinite(jump[:, in_range]).all(axis=1)
    angles = np.linspace(0, 2 * np.pi, ANGLES, endpoint=False)[visible]
    return angles, radii[in_range][jump[visible][:, in_range].argmax(axis=1)], float(visible.mean())


def _polar(image: Array, x: float, y: float, reach: int, per_pixel: int) -> Array:
    """(angle, radius, channel) values around a point, out to a radius of `reach` pixels; NaN beyond the image."""
    shape = (ANGLES, reach * per_pixel)
    rays = np.asarray(warp_polar(image, center=(y, x), radius=reach, output_shape=shape, channel_axis=2, mode="edge"))
    angles, radii = np.linspace(0, 2 * np.pi, ANGLES, endpoint=False)[:, None], np.arange(shape[1]) / per_pixel
    col, row = x + radii * np.cos(angles), y + radii * np.sin(angles)
    rays[(row < 0) | (col < 0) | (row > image.shape[0] - 1) | (col > image.shape[1] - 1)] = np.nan
    return rays
