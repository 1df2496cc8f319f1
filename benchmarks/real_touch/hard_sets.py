"""Simulated photographs of balls that are hard to calibrate with: deep presses, printed markers, images askew, other lamps and gels.

Colours are those of lamps near the gel, and not of the polynomials that a calibration fits.

Valid range: contacts within the ball's equator.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from skimage.transform import ProjectiveTransform, warp

from pipeline.contrib.calibration.ball_contact import Circle
from pipeline.contrib.calibration.calibrate_sensor import uncalibrated_sensor
from pipeline.kernels.touch.calibrated_shading import shade_depth
from pipeline.kernels.touch.depth_maps import gel_under
from pipeline.kernels.touch.markers import MarkerGrid, draw_dots
from pipeline.kernels.touch.sensor import Gel, Sensor, pixel_centres

STEEPEST = 2.75
"""Slope of the gel's surface at the rim of a contact at most: that of 70°."""
GAMMA, BLUR, NOISE, DRIFT = 1.6, 0.7, 1.0, 2.0
"""Of the camera: tone curve; standard deviations of blur, pixels, of noise and of drifting light, levels."""

SHADE = 6e-4
"""m below the edge of a shadow at which a lamp's light falls to 1/e: lamps are wide, and the gel scatters."""

Lamp = tuple[float, float, tuple[float, float, float]]
"""Direction of a lamp, degrees from +x to +y; height over the gel, of its distance from the middle; strength of red, green and blue."""
LAMPS: dict[str, tuple[Lamp, ...]] = {
    "three": ((90, 0.5, (1.0, 0.1, 0.1)), (210, 0.5, (0.1, 0.9, 0.15)), (330, 0.5, (0.1, 0.15, 1.0))),
    "sides": ((0, 0.35, (0.9, 0.1, 0.2)), (90, 0.35, (0.1, 0.9, 0.1)), (180, 0.35, (0.2, 0.1, 0.9)), (270, 0.5, (0.3, 0.3, 0.3))),
    "corners": ((45, 0.6, (0.8, 0.2, 0.2)), (135, 0.6, (0.2, 0.7, 0.2)), (225, 0.6, (0.2, 0.2, 0.8)), (315, 0.6, (0.5, 0.5, 0.2))),
}


@dataclass(frozen=True)
class HardSet:
    """A sensor and how balls are pressed into it."""

    name: str
    reach: tuple[float, float] = (0.8, 0.98)  # radii of the contacts, of the ball's
    tail: float | None = 0.5  # mm by which the gel around a contact falls to 1/e of its depth there; None for an elastic layer
    thickness: float = 4.0  # mm, of an elastic layer
    lamps: str = "three"
    markers: MarkerGrid | None = None
    askew: float = 0.0  # share of the image's sides by which its corners are moved
    row_scale: float = 1.0  # height over width of a pixel
    ball_radius: float = 2.35  # mm
    mm_per_pixel: float = 0.06
    shape: tuple[int, int] = (240, 320)
    seed: int = 0

    @property
    def sensor(self) -> Sensor:
        """Describe the sensor without its colours."""
        sizes = {"pitch": 1e-3 * self.mm_per_pixel, "thickness": 4e-3, "row_scale": self.row_scale}
        gel = None if self.tail else Gel(modulus=2e5, thickness=1e-3 * self.thickness)
        return uncalibrated_sensor("hard", self.shape, **sizes).model_copy(update={"gel": gel})


DOTS = MarkerGrid(rows=9, cols=12, radius=3e-4, colour=(18, 16, 20))
HARD_SETS = (
    HardSet("shallow", reach=(0.45, 0.6), tail=0.3),
    HardSet("deep, short skirt", tail=0.25),
    HardSet("deep, long skirt", tail=0.6, lamps="corners"),
    HardSet("deep, elastic 4 mm", tail=None, reach=(0.7, 0.8)),
    HardSet("deep, elastic 1.5 mm", tail=None, thickness=1.5, reach=(0.7, 0.8), lamps="sides"),
    HardSet("deep, marked", tail=0.35, markers=DOTS),
    HardSet("deep, askew", tail=0.4, askew=0.05, lamps="sides"),
    HardSet("deep, marked, askew, pixels not square", tail=0.45, markers=DOTS, askew=0.03, row_scale=1.15, lamps="corners"),
)


@dataclass(frozen=True, eq=False)
class HardPress:
    """A photograph of a ball and its truth."""

    image: NDArray[np.uint8]  # (rows, cols, 3)
    indentation: NDArray[np.float64]  # (rows, cols) m
    contact: NDArray[np.bool_]  # (rows, cols)
    circle: Circle  # as one would annotate it: as large as the contact


def hard_untouched(described: HardSet) -> NDArray[np.uint8]:
    """Render the untouched photograph."""
    rng = np.random.default_rng((described.seed, 0))
    nothing = np.zeros(described.shape)
    return _photograph(described, _lit(described, nothing), nothing, rng)


def hard_press(described: HardSet, number: int, ball_radius: float | None = None) -> HardPress:
    """Press a ball, by default the set's, at a random position, and photograph it."""
    described = replace(described, ball_radius=ball_radius or described.ball_radius)
    rng = np.random.default_rng((described.seed, 1, number))
    sensor, ball = described.sensor, 1e-3 * described.ball_radius
    reach = rng.uniform(*described.reach) * ball
    x, y = pixel_centres(sensor)
    at = rng.uniform(-1, 1, 2) * (np.array([sensor.width, sensor.height]) / 2 - 0.7 * ball)
    distance = np.hypot(x[None] - at[0], y[:, None] - at[1])
    if described.tail:
        indentation, contact = _ball_with_skirt(distance, ball, reach, 1e-3 * described.tail)
    else:
        indentation, contact = _ball_in_layer(sensor, distance, ball, reach)
    image = _photograph(described, _lit(described, indentation), indentation, rng)
    indentation, contact = _askew(described, indentation), _askew(described, contact.astype(float)) > 0.5
    rows, cols = np.nonzero(_askew(described, (distance < reach).astype(float)) > 0.5)
    square = np.sqrt(contact.sum() * described.row_scale / np.pi)  # of a contact within the image
    radius = float(square) if rows.min() > 0 and rows.max() < sensor.rows - 1 and cols.min() > 0 and cols.max() < sensor.cols - 1 else None
    middle = _moved(described, at, sensor)
    return HardPress(image, indentation, contact, Circle(*middle, radius or float(reach / sensor.pitch[1])))


def _ball_with_skirt(
    distance: NDArray[np.float64], ball: float, reach: float, tail: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Draw the gel in around a contact by an exponential that continues the ball's slope."""
    rise = np.sqrt(ball**2 - reach**2)
    at_rim = tail * min(reach / rise, STEEPEST)
    inside = np.sqrt(np.maximum(ball**2 - distance**2, 0)) - rise + at_rim
    return np.where(distance < reach, inside, at_rim * np.exp(-np.maximum(distance - reach, 0) / tail)), distance < reach


def _ball_in_layer(
    sensor: Sensor, distance: NDArray[np.float64], ball: float, reach: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Press a ball into an elastic layer until its contact is as large."""
    height = np.sqrt(np.maximum(ball**2 - distance**2, 0))
    low, high = 0.0, float(np.sqrt(ball**2 - reach**2))
    for _ in range(12):
        middle = (low + high) / 2
        gel = gel_under(np.maximum(height - middle, 0), sensor)
        low, high = (middle, high) if gel.contact.sum() > (distance < reach).sum() else (low, middle)
    return np.maximum(gel.indentation, 0), gel.contact


def _lit(described: HardSet, indentation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Light a surface by lamps near the gel, which cast shadows."""
    sensor = described.sensor
    x, y = pixel_centres(sensor)
    down, across = np.gradient(indentation, *sensor.pitch)
    size, away = np.sqrt(1 + down**2 + across**2), 1.3 * sensor.width
    light = np.full((*sensor.shape, 3), 0.06)
    for direction, height, strength in LAMPS[described.lamps]:
        angle = np.deg2rad(direction)
        to = [away * np.cos(angle) - x[None], away * np.sin(angle) - y[:, None], away * height - indentation]
        squared = to[0] ** 2 + to[1] ** 2 + to[2] ** 2
        facing = np.maximum(to[2] - across * to[0] - down * to[1], 0) / size / np.sqrt(squared)
        shade = gaussian_filter(shade_depth(indentation, sensor.pitch, direction=angle, slope=height), 2)
        light += (0.7 * facing * away**2 / squared * np.exp(-shade / SHADE))[..., None] * np.array(strength)
    return 255 * np.clip(light, 0, 1) ** (1 / GAMMA)


def _photograph(
    described: HardSet, lit: NDArray[np.float64], indentation: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Print the markers, which the stretched gel carries outwards, and take the photograph."""
    sensor, image = described.sensor, np.rint(lit).astype(np.uint8)
    if described.markers is not None:
        down, across = np.gradient(gaussian_filter(indentation, 3), *sensor.pitch)
        displacement = np.ascontiguousarray(-1.5e-4 * np.stack([across, down], axis=-1))
        positions = described.markers.positions(sensor.width, sensor.height)
        draw_dots(image, displacement, sensor.pitch, positions, described.markers.radius, described.markers.colour)
    corners = rng.normal(0, DRIFT, (2, 2, 3))
    v, u = (np.linspace(0, 1, count) for count in sensor.shape)
    drift = np.einsum("ra,cb,abk->rck", np.stack([1 - v, v], axis=1), np.stack([1 - u, u], axis=1), corners)
    blurred = gaussian_filter(_askew(described, image.astype(float)), (BLUR, BLUR, 0))
    return np.rint(np.clip(blurred + drift + rng.normal(0, NOISE, blurred.shape), 0, 255)).astype(np.uint8)


def _skew(described: HardSet) -> ProjectiveTransform:
    """Make the transform of (x, y) pixels from a view along the normal to the photograph's."""
    rows, cols = described.shape
    corners = np.array([[0, 0], [cols, 0], [cols, rows], [0, rows]], float)
    shifts = described.askew * np.array([[0.5, 1], [-1, 0.2], [0.3, 0], [0, -0.6]]) * (cols, rows)
    return ProjectiveTransform.from_estimate(corners, corners + shifts)


def _askew(described: HardSet, image: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(warp(image, _skew(described).inverse, mode="edge", preserve_range=True)) if described.askew else image


def _moved(described: HardSet, at: NDArray[np.float64], sensor: Sensor) -> tuple[float, float]:
    x, y = at[0] / sensor.pitch[1] + sensor.cols / 2 - 0.5, at[1] / sensor.pitch[0] + sensor.rows / 2 - 0.5
    moved_x, moved_y = _skew(described)(np.array([[x, y]]))[0].tolist() if described.askew else (float(x), float(y))
    return moved_x, moved_y
