"""The files of a method: listed by object, checked and read."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.console import abbreviate, pluralise
from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import InvalidInput, StageError, closest_name
from pipeline.formats.file_content import MESH_SUFFIXES
from pipeline.formats.image_file import read_array
from pipeline.formats.mesh_reader import load_mesh
from pipeline.kernels.geometry.mesh import check_coordinates, face_cross_products, is_watertight
from pipeline.kernels.geometry.mesh_cleaning import number_positions
from pipeline.kernels.metrics.nearest_points import Cloud
from pipeline.kernels.metrics.retrieval import mean_squared_distance
from pipeline.models.reconstruction import Reconstruction
from pipeline.rng import numpy_rng
from stages.evaluate.measure import Case, Method, Protocol, sample_reconstruction

CLOUD = ".npy"  # suffix of a point cloud as an array; a PLY file may hold one too
SUFFIXES = (*MESH_SUFFIXES, CLOUD)
CASE = re.compile(r"grasps-([1-9]\d*)(?:-from-(\d+))?")
"""Folders below: how many grasps were given, and the first of them."""
Y_UP = (".glb", ".gltf")  # formats whose y points up by their standard; they are turned to the world's z

SIZES = 10.0
"""Ratio of sizes beyond which a reconstruction is taken to be in another unit than the object, and not just bad."""
TURNED = 0.25
"""Share of its error that remains when a reconstruction is turned, below which it was made with another axis up."""
DRAWN = 500  # points of a reconstruction with which that is tested
UNITS = {1e-3: "km", 1e2: "cm", 1e3: "mm", 39.37: "inches"}  # units, by their number per metre


class Files(Method):
    """The reconstructions in a folder. Their inputs are not known: they are compared with the networks that take touches."""

    def __init__(
        self,
        name: str,
        folder: Path,  # as `find_files` takes it
        given: int,  # grasps that the files in the folder itself were made from
        *,
        misplaced: bool,  # also measure reconstructions far from their objects
        image: str | None,  # the kind of image that baselines take, and whether they take touches
        touch: bool,
    ) -> None:
        self.name, self.folder, self.given, self.misplaced, self.image, self.touch = name, folder, given, misplaced, image, touch
        self.inputs = {"image": None, "touch": True}
        self.sparse: list[int] = []  # points of the clouds that have fewer than are measured

    def prepare(self, protocol: Protocol, grasps: int) -> None:
        """List the files of the test objects; an `InvalidInput` names all that are missing or cannot be scored."""
        tested, every = protocol.objects.object_ids, ObjectRows(protocol.job.data, ["points"], None)
        untested = [name for name in (*every.object_ids, *every.failed) if name not in tested]
        self.files, self.points = find_files(self.folder, tested, untested, self.given, grasps), protocol.objects.count
        if faults := list(find_faults(self.files, protocol.objects.points, misplaced=self.misplaced)):
            raise InvalidInput(f"{self.folder} cannot be scored:\n  " + "\n  ".join(faults))

    def cases(self, available: int, numbers: Sequence[int]) -> list[Case]:
        """List the numbers of grasps, and the first grasps, that have files."""
        return [
            Case(first, tuple((first + step) % available for step in range(count)), count, (first,))
            for count, first in sorted(self.files.paths)
        ]

    def reconstruct(self, objects: ObjectRows, work: Sequence[tuple[str, Case]]) -> list[Reconstruction]:
        """Read the files; raise a `StageError` if one has become unreadable since it was checked."""
        try:
            surfaces = [read_surface(self.files.paths[case.grasp_count, case.first][object_id]) for object_id, case in work]
        except InvalidInput as error:
            raise StageError(f"{self.folder} changed while it was measured: {error}; score it again") from error
        self.sparse += [len(item.vertices) for item in surfaces if not len(item.faces) and len(item.vertices) < self.points]
        return surfaces

    def remarks(self) -> Iterator[str]:
        """Report files that were not scored, and point clouds with fewer points than are measured."""
        if self.files.unused:
            yield f"{pluralise(len(self.files.unused), 'file')} of objects outside the test split: not scored"
        if self.sparse:
            yield (
                f"{pluralise(len(self.sparse), 'point cloud')} with fewer than {self.points} points, {min(self.sparse)} or more: all of "
                "them are measured, and distances are larger than a surface's"
            )


@dataclass(frozen=True)
class ScoredFiles:
    """The files of a folder."""

    folder: Path
    paths: Mapping[tuple[int, int], Mapping[str, Path]]  # by number of grasps and first grasp, and by object
    faults: Sequence[str]  # a line for each file that is missing or cannot be used
    unused: Sequence[str]  # names of files without a test object


def surface_files(folder: Path) -> list[Path]:
    """List the files of reconstructions in a folder, and in those below it that are called `grasps-N` or `grasps-N-from-K`."""
    folders = [folder, *(path for path in sorted(folder.iterdir()) if path.is_dir() and CASE.fullmatch(path.name))]
    files = [path for below in folders for path in sorted(below.iterdir()) if path.suffix.lower() in SUFFIXES]
    return [path for path in files if not path.name.startswith(".")]  # macOS leaves ._OBJECT.ply beside OBJECT.ply


def find_files(
    folder: Path,  # files OBJECT.SUFFIX, and perhaps folders `grasps-N` or `grasps-N-from-K` of such files
    tested: Sequence[str],  # objects that are scored
    others: Sequence[str],  # the dataset's other objects
    grasps_given: int,  # that the files in the folder itself were made from
    grasps_held: int,  # in the dataset, per object
) -> ScoredFiles:
    """List the file of each test object."""
    paths: dict[tuple[int, int], dict[str, Path]] = {}
    faults, unused = [], []
    for path in sorted(folder.iterdir()):
        if path.is_dir() and path.name.lower().startswith("grasps") and not CASE.fullmatch(path.name):
            faults.append(f"{path.name}: folders are called grasps-N or grasps-N-from-K, with N from 1 and K from 0")
    for path in surface_files(folder):
        name = str(path.relative_to(folder))
        match = CASE.fullmatch(path.parent.name) if path.parent != folder else None
        case = (int(match[1]), int(match[2] or 0)) if match else (grasps_given, 0)
        if case[0] > grasps_held or case[1] >= grasps_held:
            which = f"{pluralise(case[0], 'grasp')}{f' from {case[1]} on' if case[1] else ''}"
            faults.append(f"{name}: it is of {which}, but the dataset holds {pluralise(grasps_held, 'grasp')} of each object, from 0")
        elif path.stem in others:
            unused.append(name)
        elif path.stem not in tested:
            guess = closest_name(path.stem, tested)
            faults.append(f"{name}: the dataset has no object {path.stem}{f', did you mean {guess}?' if guess else ''}")
        elif path.stem in (case_files := paths.setdefault(case, {})):
            faults.append(f"{name}: {case_files[path.stem].relative_to(folder)} is of the same object and grasps; keep one of them")
        else:
            case_files[path.stem] = path
    for (number, first), case_files in paths.items():
        if missing := [object_id for object_id in tested if object_id not in case_files]:
            which = f" with {pluralise(number, 'grasp')} from {first} on" if len(paths) > 1 else ""
            faults.append(f"{len(missing)} of {len(tested)} test objects have no file{which}: {', '.join(missing)}")
    if not paths and not faults:
        faults.append(f"there is no file of a test object: files are called OBJECT with a suffix of {', '.join(SUFFIXES)}, and the test ")
        faults[-1] += f"objects are {abbreviate(list(tested))}"
    return ScoredFiles(folder, paths, faults, unused)


def read_surface(
    path: Path,  # a mesh file, a PLY file of points, or an array (N, 3) of points; world frame, m
) -> Reconstruction:
    """Read a mesh or, without faces, a point cloud; glTF's y becomes the world's z."""
    if path.suffix.lower() == CLOUD:
        points = read_array(path)
        if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
            raise InvalidInput(f"it holds an array {points.shape} of {points.dtype}, not (number of points, 3) numbers")
        vertices, faces = points.astype(np.float64), np.zeros((0, 3), np.int64)
    else:
        vertices, faces = _read_mesh(path)
    if not len(vertices):
        raise InvalidInput("it holds no point")
    check_coordinates(vertices, "points")
    if path.suffix.lower() in Y_UP:
        vertices = np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1)
    return Reconstruction(vertices, faces, vision=len(vertices), position=np.arange(len(vertices)), side=2)


def _read_mesh(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    try:
        mesh = load_mesh(path)
    except InvalidInput as error:
        if path.suffix.lower() != ".ply":
            raise
        try:
            cloud = trimesh.load(path, process=False)
        except Exception:  # trimesh raises errors of many types; the one that it holds no mesh says more
            raise error from None
        if not isinstance(cloud, trimesh.PointCloud):
            raise
        return np.asarray(cloud.vertices, np.float64), np.zeros((0, 3), np.int64)
    vertices, faces = mesh.vertices, mesh.faces.astype(np.int64)
    if not is_watertight(faces):  # STL stores each corner by itself
        number = number_positions(vertices)
        if path.suffix.lower() == ".stl" or is_watertight(number[faces]):
            vertices, faces = vertices[np.unique(number, return_index=True)[1]], number[faces]
    if not (used := np.isin(np.arange(len(vertices)), faces)).all():  # others would count for the box around the surface
        vertices, faces = vertices[used], (np.cumsum(used) - 1)[faces]
    return vertices, faces


def find_faults(
    files: ScoredFiles,
    truth: Callable[[str], NDArray[np.float64]],  # reads the points of an object, (N, 3) world, m
    *,
    misplaced: bool,  # also score reconstructions far from their object, or of quite another size
) -> Iterator[str]:
    """Read every file, and name those that cannot be scored."""
    yield from files.faults
    shares, anyway = [], "; --misplaced measures it as it is"
    for object_id, path in ((object_id, path) for objects in files.paths.values() for object_id, path in objects.items()):
        name = path.relative_to(files.folder)
        try:
            reconstruction = read_surface(path)
        except InvalidInput as error:
            yield f"{name}: {error}"
            continue
        if len(reconstruction.faces) and not face_cross_products(reconstruction.vertices[reconstruction.faces]).any():
            yield f"{name}: none of its {len(reconstruction.faces)} faces has an area"
            continue
        points, surface = truth(object_id), sample_reconstruction(reconstruction, DRAWN, numpy_rng(0, "score", object_id))[0]
        if not misplaced and (problem := misplacement(surface, points)):
            yield f"{name}: {problem}{anyway}"
        else:
            shares.append(_share_when_turned(surface, points))
    if shares and not misplaced and np.median(shares) < TURNED:
        yield (
            "turned by 90° about x, half of the reconstructions or more would be several times nearer to their objects: the files have y "
            f"up, and the world's z points up{anyway}"
        )


def misplacement(
    surface: NDArray[np.float64],  # (M, 3) m, drawn from the reconstruction
    points: NDArray[np.float64],  # (N, 3) m, of the object
) -> str | None:
    """Explain why a reconstruction cannot be in the world's frame and in metres; None if it may.

    One in a hundred of the points of either may be anywhere.
    """
    (middle, size), (true_middle, true_size) = _box(surface), _box(points)
    if not true_size / SIZES < size < true_size * SIZES:
        times = size / true_size
        unit = min(UNITS, key=lambda factor: abs(np.log(max(times, 1e-9) / factor)))
        hint = f", as if it were in {UNITS[unit]}" if 0.5 < times / unit < 2 else ""
        return f"it is {times:.3g} times as large as the object{hint}; the world's unit is the metre"
    if np.linalg.norm(middle - true_middle) > true_size:
        middles = ("(" + ", ".join(f"{value:.3g}" for value in point) + ")" for point in (middle, true_middle))
        x, y, z = middle
        hint = ""
        if np.linalg.norm([x, -z, y] - true_middle) < true_size / 2:
            hint = "; it would be, turned by 90° about x: the file has y up, and the world's z points up"
        elif np.linalg.norm([x, z, -y] - true_middle) < true_size / 2:
            hint = "; it would be, turned by 90° about x: glTF's y points up, but this file's z does"
        return "its middle is at {}, the object's at {} m: it is not in the world's frame".format(*middles) + hint
    return None


def _box(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Compute the middle (3,) and diagonal of the box of points (N, 3) without the outermost hundredth per side."""
    low, high = np.quantile(points, (0.01, 0.99), axis=0)
    return (low + high) / 2, float(np.linalg.norm(high - low))


def _share_when_turned(
    sample: NDArray[np.float64],  # (M, 3) m, of the reconstruction
    points: NDArray[np.float64],  # (N, 3) m, of the object
) -> float:
    """Compute the share of their distance that remains after turning `sample` from y up to z up about its middle."""
    cloud, middle = Cloud(points), _box(points)[0]
    x, y, z = (sample - middle).T
    turned = Cloud(middle + np.stack([x, -z, y], axis=1))
    return mean_squared_distance(cloud, turned) / max(mean_squared_distance(cloud, Cloud(sample)), 1e-12)
