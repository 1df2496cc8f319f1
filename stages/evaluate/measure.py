"""One network or method on the objects of a split: reconstruct each case once, and measure it by a protocol."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Meter
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import DatasetJob
from pipeline.errors import StageError, StoreError
from pipeline.kernels.geometry.mesh import sample_triangles
from pipeline.kernels.metrics.cloud_distances import CloudDistances, cloud_distances, sampled_area, sampling_floor
from pipeline.models.reconstruction import Reconstruction
from pipeline.rng import numpy_rng
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import Location
from schemas.surfaces import SURFACES
from stages.evaluate.evaluation_files import Arrays, Figure, Figures
from stages.evaluate.reconstructors import Case, Reconstructor

SPLIT = "test"
PAPER_DIAGONAL = 0.5
"""Diagonal to which the paper scales its objects, m."""


def training_objects(data: Location, arrays: Iterable[str]) -> ObjectRows | None:
    """Open the training objects, from which baselines retrieve; None if there are none, or all of them failed."""
    try:
        return ObjectRows(data, list(arrays), "train")
    except StoreError:
        return None


def has_paper_sizes(data: Location) -> bool:
    """Check whether every object was scaled to the paper's diagonal: only then can figures in metres be compared with the paper's."""
    shard = DataDirectory(data).collection(SURFACES).first
    if shard.attributes.get("settings", {}).get("diagonal", PAPER_DIAGONAL) != PAPER_DIAGONAL:
        return False
    if not shard.has("metres_per_unit"):  # older datasets keep no real sizes
        return True
    rows = ObjectRows(data, ["metres_per_unit"], split=None)
    return all(rows.read("metres_per_unit", object_id) == 0 for object_id in rows.object_ids)


class TestObjects:
    """Hold the objects of the test split that have every array which a model needs: the same for all models.

    `count` is the number of points of S^obj per object: as many as are drawn from a reconstruction. A `StageError` says
    that the dataset has fewer.
    """

    def __init__(self, data: Location, arrays: Iterable[str], count: int, stage: str) -> None:
        self.rows, self.count = ObjectRows(data, list(arrays), SPLIT), count
        self.surfaces = DataDirectory(data).collection(SURFACES)
        if (available := self.rows.size("points", "point")) < count:
            raise StageError(f"{stage}.points is {count}, the dataset has {available} points per object; lower it, or sample more surface")

    def __len__(self) -> int:
        return len(self.rows)

    def stack(self, array: str) -> np.ndarray:
        """Read an array of all objects: (object, …)."""
        return np.stack([self.rows.read(array, object_id) for object_id in self.rows.object_ids])

    def points(self, row: int) -> NDArray[np.float64]:
        """Read (count, 3) points of S^obj of an object, world frame, m: drawn independently, hence the first are a fair sample."""
        return self.rows.read("points", self.rows.object_ids[row])[: self.count].astype(np.float64)

    def normals(self, row: int) -> NDArray[np.float64]:
        """Read the (count, 3) outward unit normals at `points`."""
        return self.rows.read("normals", self.rows.object_ids[row])[: self.count].astype(np.float64)

    def area(self, row: int) -> float:
        """Estimate the area of an object's surface, m², from distances between points: two sides of thin parts count once."""
        return sampled_area(self.points(row))

    def diagonal(self, row: int) -> float:
        """Compute the diagonal of an object's bounding box, m."""
        return self.rows.diagonal(self.rows.object_ids[row])

    def table(self) -> Arrays:
        """Make the group `objects` of the schema."""
        areas = [self.area(row) for row in range(len(self))]
        return {
            "object_id": np.array(self.rows.object_ids),
            "category": np.array(self.rows.categories),
            "diagonal": np.array([self.diagonal(row) for row in range(len(self))]),
            "area": np.array(areas),
            "floor": np.array([sampling_floor(area, self.count) for area in areas]),
        }


@dataclass(frozen=True)
class MeasuredCase:
    """Hold a reconstruction of an object in a case, and its distances to the object."""

    row: int  # the object's number
    case: Case
    reconstruction: Reconstruction
    points: NDArray[np.float64]  # (N, 3) m, drawn from the reconstruction
    faces: NDArray[np.int64]  # (N, 3) vertices of the face of each point; (0, 3) of a point cloud, which has no faces
    distances: CloudDistances  # between these points and the object's
    is_first: bool  # of the object's cases


class Protocol(ABC):
    """Choose the inputs of networks and the figures of their reconstructions."""

    stage: ClassVar[str]  # its name
    objects: TestObjects
    training: ObjectRows | None  # from which baselines retrieve, if there are any

    @abstractmethod
    def cases(self, reconstructor: Reconstructor) -> list[Case]:
        """List the cases of a network or method."""

    @abstractmethod
    def identity(self, object_id: str, case: Case) -> tuple[str | int, ...]:
        """Name the draw of points from a reconstruction, for the random generator: the same for every network."""

    @abstractmethod
    def figures(self, reconstructor: Reconstructor, measured: MeasuredCase) -> Iterator[tuple[int, str, float]]:
        """Measure the reconstruction of an object in a case: first grasp or view, metric and value."""

    @abstractmethod
    def baselines(self) -> dict[str, Figures]:
        """Measure training objects in place of reconstructions, by method of choice."""

    def extra(self) -> dict[str, Arrays]:
        """Make further groups of the schema; by default none."""
        return {}


def sample_reconstruction(
    reconstruction: Reconstruction,  # a surface, or a point cloud without faces
    count: int,  # points; of a cloud with fewer, all of them
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:  # points (N, 3) m; vertices (N, 3) of their faces, (0, 3) of a cloud
    """Draw points from the surface of a reconstruction."""
    if not len(reconstruction.faces):
        return rng.permutation(reconstruction.vertices)[:count], reconstruction.faces
    points, face = sample_triangles(reconstruction.vertices[reconstruction.faces], count, rng)
    return points, reconstruction.faces[face]


def measure(
    reconstructor: Reconstructor,
    protocol: Protocol,
    job: DatasetJob,  # batch size and seed
) -> tuple[list[Figure], Arrays]:  # figures, and the group below `predictions` or `meshes`, empty if no surfaces are kept
    """Measure a network or method on the test objects; a `StageError` names a reconstruction that is not finite."""
    objects, cases, size = protocol.objects, protocol.cases(reconstructor), job.settings.batch_size
    kept_cases = cases if reconstructor.has_charts else [case for case in cases if case.first == 0]  # meshes are larger
    rows: list[Figure] = []
    kept: list[Reconstruction] = []
    work = [(row, case) for row in range(len(objects)) for case in cases]
    with Meter(job.console, f"{protocol.stage} {reconstructor.name}", len(work), "reconstructions") as meter:
        for start in range(0, len(work), size):
            batch = work[start : start + size]
            surfaces = reconstructor.reconstruct(objects.rows, [(objects.rows.object_ids[row], case) for row, case in batch])
            for (row, case), surface in zip(batch, surfaces, strict=True):
                # float32, in which it is stored and exported, so that measurements can be repeated from files
                reconstruction = replace(surface, vertices=surface.vertices.astype(np.float32).astype(np.float64))
                object_id = objects.rows.object_ids[row]
                identity = protocol.identity(object_id, case)
                if not np.isfinite(reconstruction.vertices).all():
                    case_name = " ".join(map(str, (reconstructor.name, *identity)))
                    raise StageError(f"the reconstruction of {case_name} holds NaN or infinity; was the model trained to the end?")
                points, faces = sample_reconstruction(reconstruction, objects.count, numpy_rng(job.seed, protocol.stage, *identity))
                distances = cloud_distances(points, objects.points(row))
                measured = MeasuredCase(row, case, reconstruction, points, faces, distances, is_first=case is cases[0])
                rows += [
                    Figure(object_id, first, case.grasp_count, metric, value)
                    for first, metric, value in protocol.figures(reconstructor, measured)
                ]
                if reconstructor.keeps_surfaces and case in kept_cases:
                    kept.append(reconstruction)
                meter.advance()
    if not kept:
        return rows, {}
    surfaces_of = _charts if reconstructor.has_charts else _meshes
    return rows, {
        "object_id": np.array(objects.rows.object_ids),
        "first_grasp": np.array([case.first for case in kept_cases]),
        "grasps_given": np.array([len(case.grasps) for case in kept_cases]),
        **surfaces_of(kept, (len(objects), len(kept_cases))),
    }


def _charts(kept: Sequence[Reconstruction], shape: tuple[int, int]) -> Mapping[str, np.ndarray]:
    example = kept[-1]
    vertices = np.array([surface.vertices[: surface.vision] for surface in kept], np.float32)
    faces = example.faces[(example.faces < example.vision).all(axis=1)]
    return {"vertices": vertices.reshape(*shape, -1, 3), "faces": faces, "position": example.position}


def _meshes(kept: Sequence[Reconstruction], shape: tuple[int, int]) -> Mapping[str, np.ndarray]:
    return {
        "vertices": np.concatenate([surface.vertices for surface in kept]),
        "faces": np.concatenate([surface.faces for surface in kept]),
        "vertex_count": np.reshape([len(surface.vertices) for surface in kept], shape),
        "face_count": np.reshape([len(surface.faces) for surface in kept], shape),
    }
