"""What sensors feel of an object: points of its surface with normals, and points that are free, from touch charts or pressed gels."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.kernels.arrays import Array, Array32, Floats, Mask
from pipeline.kernels.geometry.transforms import frame_and_scale, transform_points, unit_vectors
from pipeline.kernels.touch.sensor import Sensor, pixel_centres

SPACING = 0.002  # m between points where objects are 0.5 m large: as dense as the vertices of the paper's touch charts
MOST_ACROSS = 24  # most points along the longer side of a gel, which may be as large as the object
PIXELS_ACROSS = 3  # pixels, along a side, whose mean is a point, at least; a gel has more, of which the others are skipped
FEW = 9  # pixels in a contact below which all are taken


@dataclass(frozen=True)
class Touch:
    """What one sensor feels of an object."""

    points: Array32  # (N, 3) world, m, on the surface; N is 0 where the sensor touches nothing
    normals: Array32  # (N, 3) unit, away from the object; 0 where unknown
    free: Array32  # (M, 3) world, m, outside the object
    free_normals: Array32  # (M, 3) unit, into the sensor
    width: float  # m, the sensor's side along +x: how large a gel is beside the object
    chart: Array32 | None = None  # (S, 3) world, m: the touch chart, for networks that deform charts; the square where nothing is touched

    @property
    def touched(self) -> bool:
        """Whether the sensor touches the object."""
        return len(self.points) > 0

    def moved(self, motion: Array) -> "Touch":
        """Move what is felt by a similarity (4, 4), m; the gel's width is scaled, too."""
        frame, scale = frame_and_scale(motion)
        turn = frame[:3, :3]
        points = {
            name: transform_points(motion, values.astype(np.float64)).astype(np.float32)
            for name in ("points", "free", "chart")
            if (values := getattr(self, name)) is not None
        }
        normals = {name: (getattr(self, name).astype(np.float64) @ turn.T).astype(np.float32) for name in ("normals", "free_normals")}
        return replace(self, **points, **normals, width=scale * self.width)


def chart_touches(
    charts: Floats,  # (T, S, 3) vertices of charts, world, m; the undeformed square of a sensor without touch
    touched: Mask,  # (T,)
) -> tuple[Touch, ...]:
    """Take the vertices of touch charts as touched points, and those of undeformed squares as free ones."""
    charts, none = charts.astype(np.float32), np.zeros((0, 3), np.float32)
    normals, corner = chart_normals(charts), round(charts.shape[1] ** 0.5) - 1  # the end of the first row
    touches = []
    for chart, normal, is_touched in zip(charts, normals, touched, strict=True):
        points, normals_there, free, free_normals = (chart, normal, none, none) if is_touched else (none, none, chart, normal)
        width = float(np.linalg.norm(chart[corner] - chart[0]))
        touches.append(Touch(points, normals_there, free, free_normals, width, chart))
    return tuple(touches)


def chart_normals(charts: Floats) -> Array32:  # (T, S, 3)
    """Compute unit normals, away from the object, at the vertices (T, S, 3) of touch charts; zeros without area."""
    side = round(charts.shape[1] ** 0.5)
    if not len(charts):
        return np.zeros(charts.shape, np.float32)
    rows, columns = np.gradient(charts.reshape(-1, side, side, 3).astype(np.float64), axis=(1, 2))
    across = np.cross(rows, columns)  # -z of the sensor, which looks at the object
    return unit_vectors(across).reshape(charts.shape).astype(np.float32)


def gel_touch(
    front: Array,  # (rows, cols) m above the sensor plane: the gel's surface, pressed in
    contact: Mask,  # (rows, cols)
    sensor: Sensor,  # with these pixels
    pose: Array,  # (4, 4) sensor frame to world, m
    scale: float,  # of the object, to the size at which networks see all objects
) -> Touch:
    """Take points of a gel's front: touched ones in the contact, free ones beside it, as dense as networks expect them."""
    spacing = _spacing(sensor, scale)
    step = max(1, int(spacing / max(sensor.pitch) / PIXELS_ACROSS))
    while step > 1 and contact[step // 2 :: step, step // 2 :: step].sum() < FEW:
        step //= 2
    part = np.s_[step // 2 :: step]
    x, y = (centres[part] for centres in pixel_centres(sensor))
    heights, felt = np.broadcast_to(front, contact.shape)[part, part], contact[part, part]
    points = np.stack([*np.meshgrid(x, y), heights], axis=-1)  # (rows, cols, 3)
    in_contact = np.where(felt, heights, np.nan)
    across, down = _slopes(in_contact, x, 1), _slopes(in_contact, y, 0)
    normals = unit_vectors(np.stack([across, down, -np.ones_like(across)], axis=-1))
    return cloud_touch(points[felt], normals[felt], sensor, pose, scale, free=points[~felt])


def cloud_touch(
    points: Array,  # (N, 3) sensor frame, m, on the surface
    normals: Array,  # (N, 3) unit, away from the object, which is into the gel
    sensor: Sensor,
    pose: Array,  # (4, 4) sensor frame to world, m
    scale: float,  # as of `gel_touch`
    *,
    free: Array,  # (M, 3) sensor frame, m, outside the object
) -> Touch:
    """Average points and normals over squares of the sensor plane, as dense as networks expect them, and move them to the world."""
    into_gel, spacing = np.broadcast_to([0.0, 0.0, -1.0], free.shape), _spacing(sensor, scale)
    return Touch(*_averaged(points, normals, spacing), *_averaged(free, into_gel, spacing), width=sensor.width).moved(pose)


def _spacing(sensor: Sensor, scale: float) -> float:
    """Choose the distance between the points of a gel, sensor frame, m."""
    return max(SPACING / scale, max(sensor.width, sensor.height) / MOST_ACROSS)


def _slopes(heights: Array, along: Array, axis: int) -> Array:
    """Compute the slopes of heights (rows, cols), NaN outside a contact, from the neighbours in it on either side; 0 without any."""
    steps = np.diff(heights, axis=axis) / (along[1] - along[0])
    before, after = (np.pad(steps, [side if axis == at else (0, 0) for at in (0, 1)], constant_values=np.nan) for side in ((1, 0), (0, 1)))
    return np.nan_to_num(np.where(np.isnan(before), after, np.where(np.isnan(after), before, (before + after) / 2)))


def _averaged(points: Array, normals: Array, spacing: float) -> tuple[Array32, Array32]:
    """Average points (N, 3) and their unit normals over squares of x and y: (M, 3) each."""
    if not len(points):
        return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32)
    column, row = np.floor(points[:, :2] / spacing).astype(np.int64).T
    cells = np.unique((row - row.min()) * (np.ptp(column) + 1) + column, return_inverse=True)[1]
    count = np.bincount(cells)
    x, y, z, *across = (np.bincount(cells, weights=axis) / count for axis in (*points.T, *normals.T))
    return np.stack([x, y, z], axis=1).astype(np.float32), unit_vectors(np.stack(across, axis=1)).astype(np.float32)


def touched_flags(touches: Sequence[Touch]) -> Mask:  # (T,)
    """Find the sensors that touch."""
    return np.array([touch.touched for touch in touches], bool)
