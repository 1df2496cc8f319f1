"""Measure baselines that learn nothing, as rows of a dataset's tables: `python -m benchmarks.shape_baselines DATA`.

Their shapes follow by a rule from a silhouette, from exact depth, or from touched points. They are told the middle and the diagonal of
the object's bounding box, as networks are. `vt-pipeline report DATA` shows them beside the networks.
"""

import argparse
import hashlib
from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy
from skimage.morphology import convex_hull_image

from pipeline.config.settings import setting
from pipeline.console import console, show_tables
from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Integers, Mask
from pipeline.kernels.geometry.level_set import level_set_mesh
from pipeline.kernels.geometry.mesh import face_cross_products, sample_triangles
from pipeline.kernels.geometry.mesh_cleaning import POSITION
from pipeline.kernels.geometry.transforms import length, unit_vectors
from pipeline.kernels.vision.scene import Label
from pipeline.kernels.vision.view_transfer import optical_centre, split_projection
from pipeline.models.reconstruction import Reconstruction
from pipeline.rng import numpy_rng
from pipeline.store.directory import DataDirectory
from pipeline.tables.evaluation_tables import evaluation_tables
from schemas.touch import TOUCH
from schemas.vision import VISION
from stages.evaluate.evaluation_files import evaluations, read_root
from stages.evaluate.measure import Case, Method, Protocol, make_cases
from stages.evaluate.protocols import GraspProtocol
from stages.evaluate.scores import Score, measuring_settings
from stages.evaluate.stage import GraspMeasuringSettings
from stages.evaluate.surface_parts import SurfaceParts, hidden_points

MOST = 300  # points that a Gaussian process goes through, and as many outside
OUTSIDE = 0.01  # their distance from the surface over the object's diagonal
CORRELATED = (0.125, 0.25, 0.5)  # lengths of covariances over the diagonal, of which the likeliest is taken
NOISE = 1e-4  # variance of the values' noise over that of the process
CELLS = 40  # of the grid along the diagonal on which the surface is found
BATCH = 4096  # points at which the process is computed at a time


class ShapeSettings(GraspMeasuringSettings):
    """Choose what is measured."""

    rules: str = setting(..., "SHA-256 of this file", changes="definition")
    first_only: bool = setting(False, "as of the evaluation of networks")


class ShapeBaseline(Method):
    """Makes points of a shape in place of each reconstruction."""

    image: str | None = "occluded"
    touch = False
    parts: SurfaceParts

    def __init__(self, *, first_only: bool) -> None:
        self.first_only = first_only
        self.inputs = {"image": self.image, "touch": self.touch}

    def prepare(self, protocol: Protocol, grasps: int) -> None:
        """Take the parts of the surface, and with them what is seen and felt."""
        assert isinstance(protocol, GraspProtocol)
        if protocol.parts is None:
            raise InvalidInput(f"{protocol.job.data} has objects scaled to 0.5 m alone; these baselines are for sizes of their own")
        self.parts, self.seed = protocol.parts, protocol.job.seed

    def cases(self, available: int, numbers: Sequence[int]) -> list[Case]:
        return make_cases(available, numbers, touch=self.touch, occluded=self.image is not None, first_only=self.first_only)

    def reconstruct(self, objects: ObjectRows, work: Sequence[tuple[str, Case]]) -> list[Reconstruction]:
        shapes = [self.shape(object_id, case, objects.diagonal(object_id)) for object_id, case in work]
        shapes = [shape if len(shape) else POSITION[None] for shape in shapes]  # nothing was seen or felt
        return [Reconstruction(shape, np.zeros((0, 3), np.int64), len(shape), np.arange(len(shape)), side=2) for shape in shapes]

    @abstractmethod
    def shape(self, object_id: str, case: Case, diagonal: float) -> Array:  # (N, 3) world, m
        """Make points of the shape of an object, none if nothing is known of it."""

    def visible(self, object_id: str, grasp: int) -> tuple[Array, Array]:  # (N, 3) each
        """Draw points from the object's mesh, take those that the camera sees, and turn normals to it: exact depth."""
        mesh, scene = self.parts.traced(object_id)
        camera, shown = self.parts.view(object_id, grasp)
        rng = numpy_rng(self.seed, "shapes", "visible", object_id)
        points, face = sample_triangles(mesh.triangles, self.parts.objects.count, rng)
        seen = ~hidden_points(points, scene, camera, shown)
        normals = unit_vectors(face_cross_products(mesh.triangles[face[seen]]))
        away = ((optical_centre(camera) - points[seen]) * normals).sum(axis=1) < 0
        return points[seen], np.where(away[:, None], -normals, normals)


class Extruded(ShapeBaseline):
    """Extrudes the silhouette, with the part of its convex hull that the hand covers."""

    name = "silhouette-extruded"

    def shape(self, object_id: str, case: Case, diagonal: float) -> Array:
        camera, shown = self.parts.view(object_id, case.first)
        silhouette = shown == Label.OBJECT
        if silhouette.any():
            silhouette |= convex_hull_image(silhouette) & (shown == Label.HAND)
        return extrude_silhouette(silhouette, camera, POSITION, diagonal)


class Mirrored(ShapeBaseline):
    """Mirrors the visible surface."""

    name = "exact-depth-mirrored"

    def shape(self, object_id: str, case: Case, diagonal: float) -> Array:
        return mirrored(self.visible(object_id, case.first)[0], self.parts.view(object_id, case.first)[0], POSITION)


class Smooth(ShapeBaseline):
    """Lays a smooth surface through touched points."""

    name = "gaussian-process-touch"
    image: str | None = None
    touch = True

    def shape(self, object_id: str, case: Case, diagonal: float) -> Array:
        clouds = [self.parts.touched(object_id, case.grasps)]
        if self.image:
            clouds.append(self.visible(object_id, case.first))
        rng, cloud = numpy_rng(self.seed, "shapes", self.name, object_id), np.concatenate([np.hstack(pair) for pair in clouds])
        points, normals = np.hsplit(rng.permutation(cloud)[:MOST], 2)
        vertices, faces = smooth_surface(points, normals, POSITION, diagonal)
        return sample_triangles(vertices[faces], self.parts.objects.count, rng)[0] if len(faces) else points


class SmoothWithDepth(Smooth):
    """Lays a smooth surface through touched and visible points."""

    name = "gaussian-process-exact-depth-touch"
    image = "occluded"


def mirrored(
    points: Array,  # (N, 3) m
    camera: Array,  # (3, 4) projection matrix
    centre: Array,  # (3,) of the object's bounding box
) -> Array:  # (2 N, 3)
    """Add to points their mirror images about the plane through an object's middle that lies across the line of sight."""
    sight = unit_vectors(centre - optical_centre(camera))
    return np.concatenate([points, points - 2 * np.outer((points - centre) @ sight, sight)])


def extrude_silhouette(
    silhouette: Mask,  # (rows, cols)
    camera: Array,  # (3, 4) projection matrix
    centre: Array,  # (3,) of the object's bounding box
    diagonal: float,  # of the box, m
) -> Array:  # (N, 3), none of an empty silhouette
    """Extrude a silhouette along the viewing direction, to either side of an object's middle.

    It becomes as deep as its box needs for the known diagonal, but no deeper than wide and high: the hand may hide much of the
    silhouette. Its points are as dense as pixels.
    """
    intrinsic, rotation = split_projection(camera)
    row, col = np.nonzero(silhouette)
    rays = np.column_stack([col + 0.5, row + 0.5, np.ones(len(row))]) @ np.linalg.inv(intrinsic).T  # camera frame
    away = rotation[2] @ (centre - optical_centre(camera))
    flat = optical_centre(camera) + away * rays @ rotation
    pixel = float(away / intrinsic[0, 0])
    sides = away * np.ptp(rays[:, :2], axis=0) + pixel if len(row) else np.zeros(2)
    depth = np.clip(np.sqrt(max(diagonal**2 - np.square(sides).sum(), 0.0)), pixel, max(sides.min(), pixel))
    rim = (silhouette & ~scipy.ndimage.binary_erosion(silhouette))[row, col]
    walls = flat[rim, None] + np.linspace(-depth / 2, depth / 2, int(depth / pixel) + 1)[:, None] * rotation[2]
    return np.concatenate([flat - depth / 2 * rotation[2], flat + depth / 2 * rotation[2], walls.reshape(-1, 3)])


def smooth_surface(
    points: Array,  # (N, 3) on the surface
    normals: Array,  # (N, 3) unit, outwards
    centre: Array,  # (3,) of the object's bounding box
    diagonal: float,  # of the box, m
) -> tuple[Array, Integers]:  # vertices (V, 3), faces (F, 3): none without points, or if nothing is inside
    """Lay a smooth surface through points: where a Gaussian process is 0 (Williams and Fitzgibbon, 2007).

    Its mean is the distance to the sphere about the centre that is nearest to the points. It is 0 at the points, and `OUTSIDE` there.
    Covariances are Matérn's with ν = 3/2.
    """
    if not len(points):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    step, radius = OUTSIDE * diagonal, float(length(points - centre).mean())
    given = np.concatenate([points, points + step * normals])
    values = np.repeat([0.0, step], len(points)) - (length(given - centre) - radius)

    def covariances(queries: Array, reach: float) -> Array:
        scaled = np.sqrt(3) / reach * scipy.spatial.distance.cdist(queries, given)
        return np.asarray((1 + scaled) * np.exp(-scaled))

    fits = []
    for reach in diagonal * np.array(CORRELATED):
        factor = scipy.linalg.cho_factor(covariances(given, reach) + NOISE * np.eye(len(given)), lower=True)
        weights = scipy.linalg.cho_solve(factor, values)
        likelihood = -len(given) / 2 * np.log(values @ weights) - np.log(np.diag(factor[0])).sum()
        fits.append((likelihood, reach, weights))
    _, reach, weights = max(fits, key=lambda fit: fit[0])

    def field(queries: Array) -> Array:
        blocks = np.array_split(queries, -(-len(queries) // BATCH))
        return length(queries - centre) - radius + np.concatenate([covariances(block, reach) @ weights for block in blocks])

    corner = np.full(3, 0.55 * diagonal)  # a tenth more than any object reaches
    return level_set_mesh(field, centre - corner, centre + corner, diagonal / CELLS, halvings=1, loose_pieces=False)


def measure_shapes(data: Path) -> Path:  # the folder of the figures
    """Measure all baselines on the test objects of a data directory, in the cases of its networks if they were evaluated."""
    directory = DataDirectory(data)
    rules = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()
    evaluated = [read_root(directory.verified_folder(name))["settings"] for name in evaluations(directory)[:1]]
    cases = {name: value for chosen in evaluated for name, value in chosen.items() if name in ("grasps", "first_only")}
    numbers = GraspMeasuringSettings.model_fields["grasps"].default
    settings = ShapeSettings(**(measuring_settings(directory) | {"grasps": numbers} | cases), rules=rules)
    methods = [kind(first_only=settings.first_only) for kind in (Extruded, Mirrored, Smooth, SmoothWithDepth)]
    score = Score("scores/shapes", methods, [TOUCH, VISION])
    return directory.verified_folder(score.run(directory, settings, console))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    show_tables(evaluation_tables(measure_shapes(parser.parse_args().data)))
