"""Measure methods on the objects of a split: reconstruct each case once, and measure it by a protocol."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.console import Meter
from pipeline.dataset.object_rows import ObjectRows
from pipeline.engine.stage import DatasetJob
from pipeline.errors import StageError, StoreError
from pipeline.kernels.geometry.mesh import sample_triangles
from pipeline.kernels.metrics.cloud_distances import CloudDistances, cloud_distances, sampled_area, sampling_floor
from pipeline.kernels.metrics.nearest_points import Cloud
from pipeline.models.foreign_data import as_learned
from pipeline.models.observation import Observation, stored_observation
from pipeline.models.reconstruction import Reconstruction, Reconstructor
from pipeline.rng import numpy_rng
from pipeline.store.shard import RowView
from pipeline.store.storage import Location
from schemas.surfaces import SURFACES
from stages.evaluate.evaluation_files import Arrays, Figure, Figures

SPLIT = "test"


class MeasuredObjects(ObjectRows):
    """The objects of a split that have every array which a method needs: the same for all."""

    def __init__(
        self,
        data: Location,
        arrays: Iterable[str],
        count: int,  # points of S^obj per object: as many as are drawn from a reconstruction
        stage: str,
        split: str = SPLIT,
    ) -> None:
        super().__init__(data, list(arrays), split)
        self.count = count
        if (available := self.size("points", "point")) < count:
            raise StageError(f"{stage}.points is {count}, the dataset has {available} points per object; lower it, or sample more surface")

    def surface(self, object_id: str) -> RowView:
        """Open an object's row of `surfaces`."""
        return self.directory.collection(SURFACES).view(object_id)

    def points(self, object_id: str) -> NDArray[np.float64]:
        """Read (count, 3) points of S^obj of an object, world frame, m: drawn independently, hence the first are a fair sample."""
        return self.read("points", object_id)[: self.count].astype(np.float64)

    def normals(self, object_id: str) -> NDArray[np.float64]:
        """Read the (count, 3) outward unit normals at `points`."""
        return self.read("normals", object_id)[: self.count].astype(np.float64)

    def table(self) -> Arrays:
        """Make the group `objects` of the schema."""
        areas = [sampled_area(self.points(object_id)) for object_id in self.object_ids]  # two sides of thin parts count once
        return {
            "object_id": np.array(self.object_ids),
            "category": np.array(self.categories),
            "diagonal": np.array([self.diagonal(object_id) for object_id in self.object_ids]),
            "area": np.array(areas),
            "floor": np.array([sampling_floor(area, self.count) for area in areas]),
        }


@dataclass(frozen=True)
class Case:
    """Choose grasps, or a view, the same for every object."""

    first: int  # the first grasp, with whose hand the occluded image is; or the view
    grasps: tuple[int, ...]  # whose touches are given, none for a network without touch
    grasp_count: int  # under which the figures are reported
    firsts: tuple[int, ...]  # the first grasps whose figures the reconstruction gives


class Method(ABC):
    """Reconstructs test objects in the cases that it has: a row of the tables."""

    name: str
    image: str | None  # the kind of image that it, or baselines beside it, take
    touch: bool  # whether it, or baselines beside it, take touches
    inputs: Mapping[str, Any]  # for tables
    charts = False  # whether it takes touches as touch charts
    has_charts = False  # whether its surfaces are deformed charts
    keeps_surfaces = False  # whether the evaluation keeps them

    def prepare(self, protocol: "Protocol", grasps: int) -> None:  # noqa: B027 (optional)
        """Check what is needed for the protocol's objects, which have `grasps` grasps each; by default nothing."""

    @abstractmethod
    def cases(self, available: int, numbers: Sequence[int]) -> list[Case]:
        """List the cases of objects with `available` grasps each, for the requested numbers of grasps."""

    @abstractmethod
    def reconstruct(self, objects: ObjectRows, work: Sequence[tuple[str, Case]]) -> list[Reconstruction]:
        """Reconstruct objects, by id, in cases."""

    def remarks(self) -> Iterable[str]:
        """Report on what was measured; by default nothing."""
        return ()


class Network(Method):
    """A trained network."""

    def __init__(
        self,
        name: str,
        model: Reconstructor,
        *,
        first_only: bool = False,  # only cases that begin with the first grasp: a fifth of the time of five grasps
        keeps_surfaces: bool = True,
        foreign: bool = False,  # it has learned from another dataset, whose view it is given
        of_gels: bool = False,  # it is given depth maps in place of touch charts: of another sensor
    ) -> None:
        self.name, self.model, self.first_only, self.keeps_surfaces = name, model, first_only, keeps_surfaces
        self.image, self.touch, self.charts = model.config.image, model.config.touch, model.config.takes_charts and not of_gels
        self.foreign, self.of_gels = foreign, of_gels
        self.has_charts = model.has_charts
        self.inputs = {"image": self.image, "touch": self.touch}

    def cases(self, available: int, numbers: Sequence[int]) -> list[Case]:
        return make_cases(available, numbers, touch=self.touch, occluded=self.image == "occluded", first_only=self.first_only)

    def observe(self, objects: ObjectRows, object_id: str, case: Case) -> Observation:
        """Read its input."""
        seen = stored_observation(objects, object_id, case.grasps or (case.first,), self.model.config, of_gels=self.of_gels)
        return as_learned(self.model.trained, seen)[0] if self.foreign else seen

    def reconstruct(self, objects: ObjectRows, work: Sequence[tuple[str, Case]]) -> list[Reconstruction]:
        return self.model.reconstruct([self.observe(objects, object_id, case) for object_id, case in work])


def make_cases(
    available: int,  # grasps per object
    numbers: Sequence[int],  # of grasps to evaluate; those above `available` are skipped
    *,
    touch: bool,  # the network takes touches
    occluded: bool,  # the network takes the occluded image
    first_only: bool = False,  # only cases that begin with the first grasp
) -> list[Case]:
    """List the cases of a network.

    A network without touch gives the same result for any number of grasps, and without the occluded image for any grasp.
    All grasps together are the same input whichever comes first.
    """
    every = tuple(range(available))
    firsts = every[:1] if first_only else every
    if not touch:
        return [Case(first, (), 1, (first,)) for first in firsts] if occluded else [Case(0, (), 1, firsts)]
    cases = []
    for number in (number for number in numbers if number <= available):
        if number == available and not occluded:
            cases.append(Case(0, every, number, firsts))
            continue
        for first in firsts:
            cases.append(Case(first, tuple((first + step) % available for step in range(number)), number, (first,)))
    return cases


@dataclass(frozen=True)
class MeasuredCase:
    """A reconstruction of an object in a case, and its distances to the object."""

    object_id: str
    case: Case
    reconstruction: Reconstruction
    points: NDArray[np.float64]  # (N, 3) m, drawn from the reconstruction
    faces: NDArray[np.int64]  # (N, 3) vertices of the face of each point; (0, 3) of a point cloud, which has no faces
    distances: CloudDistances  # between these points and the object's
    is_first: bool  # of the object's cases


class Protocol(ABC):
    """Choose the cases of methods and the figures of their reconstructions."""

    stage: ClassVar[str]  # its name

    def __init__(
        self,
        job: DatasetJob,
        arrays: Sequence[str],  # of the test objects
        training_arrays: Sequence[str],  # of the training objects, from which baselines retrieve
    ) -> None:
        self.job, self.settings = job, job.settings
        self.objects = MeasuredObjects(job.data, arrays, job.settings.points, self.stage)
        self.training: ObjectRows | None = None
        with suppress(StoreError):  # there are none, or all of them failed
            self.training = ObjectRows(job.data, training_arrays, "train")

    @abstractmethod
    def cases(self, method: Method) -> list[Case]:
        """List the cases of a method."""

    @abstractmethod
    def identity(self, object_id: str, case: Case) -> tuple[str | int, ...]:
        """Name the draw of points from a reconstruction, for the random generator: the same for every method."""

    @abstractmethod
    def figures(self, method: Method, measured: MeasuredCase) -> Iterator[tuple[int, str, float]]:
        """Measure the reconstruction of an object in a case: first grasp or view, metric and value."""

    @abstractmethod
    def baselines(self) -> dict[str, Figures]:
        """Measure training objects in place of reconstructions, by method of choice; none without training objects."""

    def extra(self) -> dict[str, Arrays]:
        """Make further groups of the schema; by default none."""
        return {}


def sample_reconstruction(
    surface: Reconstruction,  # or a point cloud without faces
    count: int,  # points; of a cloud with fewer, all of them
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:  # points (N, 3) m; vertices (N, 3) of their faces, (0, 3) of a cloud
    """Draw points from the surface of a reconstruction."""
    if not len(surface.faces):
        return rng.permutation(surface.vertices)[:count], surface.faces
    points, face = sample_triangles(surface.vertices[surface.faces], count, rng)
    return points, surface.faces[face]


def measure(
    method: Method,
    protocol: Protocol,
    job: DatasetJob,  # batch size and seed
) -> tuple[list[Figure], Arrays]:  # figures, and the group below `predictions` or `meshes`, empty if no surfaces are kept
    """Measure a method on the test objects; a `StageError` names a reconstruction that is not finite."""
    objects, cases, size = protocol.objects, protocol.cases(method), job.settings.batch_size
    kept_cases = cases if method.has_charts else [case for case in cases if case.first == 0]  # meshes are larger
    rows: list[Figure] = []
    kept: list[Reconstruction] = []
    truth: dict[str, Cloud] = {}  # the current object's points: its cases follow one another
    work = [(object_id, case) for object_id in objects.object_ids for case in cases]
    with Meter(job.console, f"{protocol.stage} {method.name}", len(work), "reconstructions") as meter:
        for start in range(0, len(work), size):
            batch = work[start : start + size]
            for (object_id, case), made in zip(batch, method.reconstruct(objects, batch), strict=True):
                # float32, in which it is stored and exported, so that measurements can be repeated from files
                surface = replace(made, vertices=made.vertices.astype(np.float32).astype(np.float64))
                identity = protocol.identity(object_id, case)
                if not np.isfinite(surface.vertices).all():
                    case_name = " ".join(map(str, (method.name, *identity)))
                    raise StageError(f"the reconstruction of {case_name} holds NaN or infinity; was the model trained to the end?")
                points, faces = sample_reconstruction(surface, objects.count, numpy_rng(job.seed, protocol.stage, *identity))
                truth = truth if object_id in truth else {object_id: Cloud(objects.points(object_id))}
                distances = cloud_distances(points, truth[object_id])
                measured = MeasuredCase(object_id, case, surface, points, faces, distances, is_first=case is cases[0])
                rows += [
                    Figure(object_id, first, case.grasp_count, metric, value) for first, metric, value in protocol.figures(method, measured)
                ]
                if method.keeps_surfaces and case in kept_cases:
                    if method.has_charts:  # touch charts are input, and the vision charts have the same faces in every reconstruction
                        faces = kept[0].faces if kept else surface.faces[(surface.faces < surface.vision).all(axis=1)]
                        surface = replace(surface, vertices=surface.vertices[: surface.vision].astype(np.float32), faces=faces)
                    kept.append(surface)
                meter.advance()
    if not kept:
        return rows, {}
    shape = (len(objects), len(kept_cases))
    if method.has_charts:
        vertices = np.reshape([surface.vertices for surface in kept], (*shape, -1, 3))
        surfaces: Arrays = {"vertices": vertices, "faces": kept[0].faces, "position": kept[0].position}
    else:
        surfaces = {
            "vertices": np.concatenate([surface.vertices for surface in kept]),
            "faces": np.concatenate([surface.faces for surface in kept]),
            "vertex_count": np.reshape([len(surface.vertices) for surface in kept], shape),
            "face_count": np.reshape([len(surface.faces) for surface in kept], shape),
        }
    return rows, {
        "object_id": np.array(objects.object_ids),
        "first_grasp": np.array([case.first for case in kept_cases]),
        "grasps_given": np.array([len(case.grasps) for case in kept_cases]),
        **surfaces,
    }
