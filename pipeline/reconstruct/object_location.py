"""Find the object of an observation: the bounding box that its network takes it to be in, in metres and the observation's frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion

from pipeline.kernels.geometry.transforms import pose_of
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.vision.view_transfer import border, camera_direction, moved_projection, optical_centre, split_projection
from pipeline.models.foreign_data import same_gel
from pipeline.models.reconstruction import Trained
from pipeline.reconstruct.observation_file import RobotObservation, View
from pipeline.reconstruct.observed_touch import ObservedTouch

BY_DEPTH = "estimated from depth and mask"
FEW = 10  # pixels, with a depth or of a mask, below which an object is not located or measured by them
INVERTED_MASK = 0.5  # share of the photograph's border that an object's mask hardly covers
RIM, SECTORS = 3, 24  # pixels across the rim of the visible part, and parts of it around the middle
OVER_MASK = 1.23
"""Diagonal of an object over that of its visible pixels at its distance: the median of 741 grasps of 150 objects of 6 to 20 cm, of
`hand-sized-test`; nine tenths have 1.0 to 2.6. `python -m benchmarks.observed_sizes` measures the error on others."""
OUTLIERS = 0.5  # percentage of the points at each side of a box around them that are ignored: some depths are wrong


class Target(Trained):
    """The network that an observation is for, and what reads its tactile images."""

    sensor: Sensor | None = None  # of the network beside it that reads tactile images; None without one

    def is_charted(self, touch: ObservedTouch, sensor: Sensor) -> bool:
        """Whether a touch becomes a touch chart, as in the network's training: it is a photograph by a sensor with the same gel."""
        return self.network.takes_charts and touch.tactile_image is not None and (self.sensor is None or same_gel(self.sensor, sensor))

    @property
    def size(self) -> float:
        """The middle, on a scale of ratios, of the sizes of the objects that the network learned from, m."""
        return float(np.sqrt(np.prod(self.sizes)))


@dataclass(frozen=True)
class ObjectBox:
    """An object's bounding box."""

    centre: NDArray[np.float64]  # (3,)
    diagonal: float | None  # None if not known
    source: str  # of the centre
    by_mask: bool = False  # the diagonal is a guess from the mask, too small where a hand hides much

    def factor(self, target: Target) -> float:
        """Compute what scales the object to the size at which a network sees all objects; an unknown size is that of the training."""
        return 2 * target.network.radius / (target.size if self.diagonal is None else self.diagonal)


def find_object(observation: RobotObservation, target: Target | None) -> ObjectBox | None:
    """Find the object: as the observation states it, else by its depth image, else by its touches.

    Its size is as stated, else by depth, else by its mask. The box has the axes of the network's world (`network_axes`), in which its
    training objects were placed by their boxes. Touches are the middle of the box around the gels; there must be two that count.
    """
    stated, unit = observation.object, observation.metres_per_unit
    centre = None if stated.centre is None else np.array(stated.centre) * unit
    diagonal = None if stated.diagonal is None else stated.diagonal * unit
    visible = None if centre is not None and diagonal is not None else _visible_box(observation, target)
    if visible is not None:
        diagonal = diagonal or visible[1]
    source = "as stated"
    if centre is None and visible is not None:
        centre, source = visible[0], BY_DEPTH
    elif centre is None:
        gels = observation.gel_centres[observation.shown_touches]
        if len(gels) < 2:
            return None
        axes = network_axes(observation, target, np.mean(gels, axis=0))
        low, high = np.min(gels @ axes.T, axis=0), np.max(gels @ axes.T, axis=0)
        centre, source = (low + high) / 2 @ axes, "estimated from the touches"
    view = observation.view
    if diagonal is None and view is not None and (span := mask_span(view, centre)):
        return ObjectBox(centre, OVER_MASK * span, source, by_mask=True)
    return ObjectBox(centre, diagonal, source)


def mask_span(view: View, centre: NDArray[np.float64]) -> float:
    """Measure the diagonal, m, of the box around the object's pixels, as far away as a point (3,).

    0 where it is not known: without a mask, with hardly a pixel, or with a mask that holds most of the photograph's border.
    """
    mask, pixels = view.camera.mask, view.camera.object_pixels
    if mask is None or pixels.sum() < FEW or border(mask).mean() > INVERTED_MASK:
        return 0.0
    low, high = np.percentile(np.argwhere(pixels), [OUTLIERS, 100 - OUTLIERS], axis=0)
    sides = (high + 1 - low) / (view.camera.intrinsics.fy, view.camera.intrinsics.fx)
    return float(np.linalg.norm(sides) * abs(view.matrix[2] @ np.append(centre, 1.0)))


def _visible_box(observation: RobotObservation, target: Target | None) -> tuple[NDArray[np.float64], float] | None:
    """Estimate the centre and diagonal by a depth image.

    It is the box around the visible points and the same points mirrored about the object's middle: what is hidden is taken to be like what
    is visible. The middle is seen in the middle of the visible part. Opposite parts of the rim of a body that is symmetric about its middle
    are as far away on average as that is; `python -m benchmarks.observed_sizes` measures what it is for others.
    """
    view = observation.view
    if view is None or view.camera.metres is None or view.camera.measured is None:
        return None
    camera, metres, measured, sides = view.camera, view.camera.metres, view.camera.measured, [OUTLIERS, 100 - OUTLIERS]
    inner = binary_erosion(measured)  # at the rim cameras mix depths with those behind
    if inner.sum() >= FEW:
        near, far = np.percentile(metres[inner], sides)
        measured = measured & (np.abs(metres - (near + far) / 2) <= 1.5 * (far - near))
    if measured.sum() < FEW:
        return None
    row, col = np.nonzero(measured)
    k, depth = camera.intrinsics, metres[measured]
    rays = np.column_stack([(col + 0.5 - k.cx) / k.fx, (row + 0.5 - k.cy) / k.fy, np.ones(len(depth))])  # camera frame, as OpenCV's
    middle = np.percentile(rays, sides, axis=0).mean(axis=0)
    beside = camera.object_pixels if camera.hand_mask is None else camera.object_pixels | camera.hand_mask
    rim = (inner & binary_dilation(~beside, iterations=RIM))[measured]
    away = _rim_depth(rays - middle, depth, rim if rim.any() else np.full(len(depth), True))
    rotation, centre = split_projection(view.matrix)[1], optical_centre(view.matrix)
    points, middle = centre + depth[:, None] * rays @ rotation, centre + away * middle @ rotation
    axes = network_axes(observation, target, points.mean(axis=0))
    low, high = np.percentile(np.concatenate([points, 2 * middle - points]) @ axes.T, sides, axis=0)
    return middle, float(np.linalg.norm(high - low))


def _rim_depth(
    across: NDArray[np.float64],  # (N, 3) from the middle of the visible part, m per m of depth
    depth: NDArray[np.float64],  # (N,) m
    rim: NDArray[np.bool_],  # (N,)
) -> float:
    """Average the greatest depths of opposite parts of a rim, of those that are both seen.

    A ball's rim lies nearer than its middle, by the squared radius over the distance; that is added for every body.
    """
    across, depth = across[rim], depth[rim]
    sector = ((np.arctan2(across[:, 1], across[:, 0]) / (2 * np.pi) + 0.5) * SECTORS).astype(int) % SECTORS
    farthest = np.full(SECTORS, -np.inf)
    np.maximum.at(farthest, sector, depth)
    pairs = (farthest + np.roll(farthest, SECTORS // 2))[: SECTORS // 2] / 2
    away = float(np.median(pairs[np.isfinite(pairs)]) if np.isfinite(pairs).any() else depth.mean())
    return away * (1 + float(np.linalg.norm(across, axis=1).mean()) ** 2)


def network_axes(
    observation: RobotObservation,
    target: Target | None,
    point: NDArray[np.float64],  # (3,) m
) -> NDArray[np.float64]:  # (3, 3)
    """Compute the rotation from the observation's frame to a network's world.

    It turns the observation's up to +z, and about +z until the camera, seen from a point, has the azimuth of the training's. Without one
    of the two cameras, or without a network, the observation keeps its own axes but for up.
    """
    upright = turn_to_z(np.array(observation.up))
    if observation.view is None or target is None or target.projection is None:
        return upright
    centre = np.array(target.network.centre)
    camera = moved_projection(observation.view.matrix, pose_of(upright, centre - upright @ point))
    angle = np.radians(target.learned_direction(camera)[0]) - camera_direction(camera, centre).azimuth
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) @ upright


def turn_to_z(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the smallest rotation (3, 3) that turns a direction (3,) to +z."""
    x, y, z = (scaled := up / np.abs(up).max()) / np.linalg.norm(scaled)
    if z < 0 and (across := x * x + y * y) < 1e-300:
        return np.diag([1.0, -1, -1])
    share = 1 / (1 + z) if z >= 0 else (1 - z) / across  # both are the same: near z = -1 the former loses its digits
    return np.array([[1 - share * x * x, -share * x * y, -x], [-share * x * y, 1 - share * y * y, -y], [x, y, z]])
