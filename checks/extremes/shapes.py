"""Shapes at the extremes: (V, 3) vertices, m, and (F, 3) faces."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh

from pipeline.kernels.touch.sensor import Sensor, pixel_centres
from tests.kernels.touch.shapes import coarse
from tests.strategies import sliver

Mesh = tuple[np.ndarray, np.ndarray]

PIXELS = 8
TINY = 1e-150
"""m; the squares of smaller lengths vanish in float64, and so do their errors."""
REFERENCE = coarse(PIXELS)


@dataclass(frozen=True)
class Shape:
    """A mesh at an extreme.

    Attributes
    ----------
    name
        What is extreme about it.
    make
        Makes its vertices and faces.
    beyond
        Whether it lies beyond the stated ranges, so that kernels may refuse it in words.
    large
        Whether only `make test-slow` and `make test-extremes` feed it.
    """

    name: str
    make: Callable[[], Mesh]
    beyond: bool = False
    large: bool = False

    @cached_property
    def mesh(self) -> Mesh:
        """(V, 3) vertices as float64, m, and (F, 3) faces as int64."""
        vertices, faces = self.make()
        return np.asarray(vertices, np.float64), np.asarray(faces, np.int64)

    @cached_property
    def bounds(self) -> np.ndarray:
        """(2, 3) m: the least and the greatest finite coordinates, 0 and 1 where there is no vertex."""
        vertices = self.mesh[0][np.isfinite(self.mesh[0]).all(axis=1)]
        return np.array([vertices.min(axis=0), vertices.max(axis=0)]) if len(vertices) else np.array([np.zeros(3), np.ones(3)])

    @property
    def size(self) -> float:
        """The longest side of the bounding box, m."""
        return float((self.bounds[1] - self.bounds[0]).max())

    @property
    def extent(self) -> float:
        """The largest coordinate, m, but no less than `TINY`: errors are shares of it."""
        return max(float(np.abs(self.bounds).max()), TINY)

    @property
    def centre(self) -> np.ndarray:
        """(3,) middle of the bounding box, m."""
        return self.bounds[0] + (self.bounds[1] - self.bounds[0]) / 2

    def sensor(self) -> Sensor:
        """Make a sensor two fifths as wide as the shape, but from 10 µm to 10 m, that sees all of the shape."""
        return _sensor(self.size)

    def sensor_pose(self) -> np.ndarray:
        """(4, 4) the pose of that sensor: it looks up at the shape's lowest point, half its gel pressed in."""
        pose = np.eye(4)
        pose[:3, 3] = [*self.centre[:2], self.bounds[0, 2] - self.sensor().w / 2]
        return pose

    def points(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count, 3) points: half of them in and around the shape, half close to vertices, m."""
        around = self.centre + self.size * rng.normal(scale=0.5, size=(count // 2, 3))
        if not len(self.mesh[0]):
            return around
        chosen = self.mesh[0][-1 - rng.integers(len(self.mesh[0]), size=count - count // 2)]
        return np.concatenate([around, chosen + 1e-3 * self.size * rng.normal(size=chosen.shape)])


def _sensor(size: float) -> Sensor:
    factor = float(np.clip(0.4 * size, 1e-5, 10)) / REFERENCE.width
    lengths = {name: factor * getattr(REFERENCE, name) for name in ("width", "w", "membrane")}
    return REFERENCE.model_copy(update={**lengths, "given_height": None, "range": max(2 * size, 2 * lengths["w"])})


def ball(diameter: float, centre: tuple[float, float, float] = (0, 0, 0), subdivisions: int = 1) -> Mesh:
    """Make an icosphere, by default of 80 faces."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.5)
    return mesh.vertices * diameter + np.array(centre), mesh.faces


def with_slivers(aspect: float) -> Mesh:
    """Make a ball of 0.1 m, and cut from each face a sliver along one of its edges."""
    vertices, faces = ball(0.1)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    inner = 0.4 * a + 0.6 * b
    inner += (c - inner) / aspect
    new = len(vertices) + np.arange(len(faces))
    i, j, k = faces.T
    return np.concatenate([vertices, inner]), np.concatenate([np.stack(part, axis=1) for part in ((i, j, new), (j, k, new), (k, i, new))])


def coincident() -> Mesh:
    """Make a ball of 0.1 m whose faces share no vertex; a face twice, once inside out; and a segment and a point for faces."""
    vertices, faces = ball(0.1)
    soup = vertices[faces]
    soup = np.concatenate([soup, soup[:1], soup[:1, ::-1], soup[:1, [0, 1, 1]], soup[:1, [0, 0, 0]]])
    return soup.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3)


def walls(tilt: float) -> Mesh:
    """Make walls of 0.1 m that a ray of each column of pixels meets half way up, at an angle of `tilt` rad."""
    x = pixel_centres(_sensor(0.1))[0]
    lean = np.array([-tilt / 20, tilt / 20])
    corners = [[x_k + lean[top], y, 0.1 * top] for x_k in x for y, top in ((-0.05, 0), (0.05, 0), (0.05, 1), (-0.05, 1))]
    first = 4 * np.arange(len(x))[:, None, None]
    return np.array(corners), (first + [[0, 1, 2], [0, 2, 3]]).reshape(-1, 3)


def single_precision() -> Mesh:
    """Make a ball as a file in single precision holds it."""
    vertices, faces = ball(0.1, (0.1, 0.2, 0.6))
    return vertices.astype(np.float32), faces


def one_face() -> Mesh:
    """Make the first face of a ball."""
    vertices, faces = ball(0.1)
    return vertices[faces[0]], np.array([[0, 1, 2]])


def not_a_number() -> Mesh:
    """Make a ball with a vertex that is not a number."""
    vertices, faces = ball(0.1)
    vertices[0] = np.nan
    return vertices, faces


SHAPES = (
    Shape("0.5 m, at 0.6 m", lambda: ball(0.5, (0, 0, 0.6))),
    Shape("1e-4 m", lambda: ball(1e-4)),
    Shape("1e3 m", lambda: ball(1e3)),
    Shape("100 m away", lambda: ball(0.1, (100, -100, 100))),
    Shape("slivers 1e8", lambda: with_slivers(1e8), large=True),
    Shape("one sliver 1e8", lambda: (0.1 * sliver(1e8, np.random.default_rng(0)), np.array([[0, 1, 2]]))),
    Shape("grazing 1e-8", lambda: walls(1e-8)),
    Shape("coincident", coincident),
    Shape("one face", one_face),
    Shape("float32", single_precision),
    Shape("1.3 million faces", lambda: ball(0.1, (0, 0, 0.6), subdivisions=8), large=True),
    Shape("1e-9 m", lambda: ball(1e-9), beyond=True),
    Shape("1e9 m", lambda: ball(1e9), beyond=True),
    Shape("1e6 m away", lambda: ball(0.1, (1e6, -1e6, 1e6)), beyond=True),
    Shape("slivers 1e12", lambda: with_slivers(1e12), beyond=True),
    Shape("denormal", lambda: ball(1e-310), beyond=True),
    Shape("1e200 m", lambda: ball(1e200), beyond=True),
    Shape("no face", lambda: (np.zeros((0, 3)), np.zeros((0, 3), np.int64)), beyond=True),
    Shape("NaN", not_a_number, beyond=True),
)
"""From the ordinary to what nothing can be made of."""
