"""Evaluations on disk: `tables.zarr` with every figure, and their means in `metrics.json`."""

import re
import shutil
from collections.abc import Iterable, Mapping, Sequence, Set
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zarr
from numpy.typing import NDArray

from pipeline.errors import StoreError
from pipeline.kernels.metrics.cloud_distances import TABLE_3_FACTOR
from pipeline.store.directory import DataDirectory
from pipeline.store.layout import array_metadata, numpy_dtype
from pipeline.store.storage import list_folder
from pipeline.store.stored_array import encode_metadata, write_array, write_metadata
from pipeline.store.zarr_files import zarr_store
from schemas.evaluation import GROUPS, VERSION

TABLES_ZARR = "tables.zarr"
METRICS = "metrics.json"
METHOD_NAME = r"^[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}$"
"""Pattern of the name of a method that is scored, which becomes the name of a folder."""
SHIPPED_SCORES = "scores/shipped"  # folder of the figures of the pretrained network, below a data directory
SHIPPED_ROWS = "shipped-"  # prefix of the names of its rows in tables: `shipped-touch` takes touches

Arrays = dict[str, np.ndarray]

NOTHING = np.zeros(0, int), np.zeros(0)  # object numbers and values of a metric that was not measured


class Figure(NamedTuple):
    """A figure of one reconstruction; a row of the group `figures` without its network."""

    object_id: str
    first: int
    grasps: int
    metric: str
    value: float


class Figures:
    """The figures of one network, in the order of the objects; `rows` are as stored."""

    def __init__(self, object_ids: Sequence[str], rows: Iterable[Figure]) -> None:
        self.object_ids, self.rows = list(object_ids), list(rows)
        number = {object_id: row for row, object_id in enumerate(self.object_ids)}
        listed: dict[tuple[str, int], tuple[list[int], list[float]]] = {}
        for figure in self.rows:
            numbers, values = listed.setdefault((figure.metric, figure.grasps), ([], []))
            numbers.append(number[figure.object_id])
            values.append(figure.value)
        # object numbers and values, (N,) each
        self._values = {key: (np.array(numbers, int), np.array(values, np.float64)) for key, (numbers, values) in listed.items()}

    @property
    def grasps(self) -> list[int]:
        """List the numbers of grasps that were the network's input."""
        return sorted(grasps for metric, grasps in self._values if metric == "chamfer")

    @property
    def rings(self) -> list[int]:
        """List the rings in which a touch has points, from 1."""
        return sorted(int(metric.rpartition("_")[2]) for metric, _ in self._values if metric.startswith("local_chamfer_"))

    def firsts(self, grasps: int) -> set[int]:
        """List the first grasps that have figures with a number of grasps."""
        return {figure.first for figure in self.rows if figure.grasps == grasps and figure.metric == "chamfer"}

    def only(self, firsts: Set[int]) -> "Figures":
        """Keep the figures of some first grasps."""
        return Figures(self.object_ids, (row for row in self.rows if row.first in firsts))

    def per_case(self, metric: str, grasps: int = 1) -> NDArray[np.float64]:
        """Take a metric of every object and choice of grasps: (object, first)."""
        return np.reshape(self.available(metric, grasps), (len(self.object_ids), -1))

    def per_object(self, metric: str, grasps: int = 1) -> NDArray[np.float64]:
        """Compute the mean over the choices of grasps: (object,); (0,) if the network was not measured with this number."""
        values = self.per_case(metric, grasps)
        return np.asarray(values.mean(axis=1)) if values.size else np.zeros(0)

    def means(self) -> dict[str, dict[int, float]]:
        """Average each metric over objects and choices of grasps, by number of grasps."""
        means: dict[str, dict[int, float]] = {}
        for (metric, grasps), (_, values) in self._values.items():
            means.setdefault(metric, {})[grasps] = float(np.mean(values))
        return means

    def available(self, metric: str, grasps: int = 1) -> NDArray[np.float64]:
        """List a metric of the objects that have it: (object,); (0,) if it was not measured."""
        return self._values.get((metric, grasps), NOTHING)[1]

    def by_object(self, metric: str, grasps: int = 1) -> NDArray[np.float64]:
        """Compute the mean of a metric that not every case has: (object,); NaN for objects without it."""
        numbers, values = self._values.get((metric, grasps), NOTHING)
        counts = np.bincount(numbers, minlength=len(self.object_ids))
        sums = np.bincount(numbers, weights=values, minlength=len(self.object_ids))
        means: NDArray[np.float64] = np.divide(sums, counts, out=np.full(len(counts), np.nan), where=counts > 0)
        return means

    def ring(self, number: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Compute the local Chamfer distance in a ring, and count the touches with points in it: (object,) each.

        The distance is the mean over these touches, 0 without any.
        """
        metric = f"local_chamfer_{number}"
        sites = np.bincount(self._values.get((metric, 1), NOTHING)[0], minlength=len(self.object_ids))
        return np.nan_to_num(self.by_object(metric)), sites


def chamfer_by_object(folder: Path) -> dict[str, float]:
    """Read the Chamfer distances of the first network of an evaluation, in Table 3's unit: mean over numbers of grasps, by object."""
    name = next(iter(read_root(folder)["configurations"]))
    figures = read_figures(folder)[name]
    values = np.mean([figures.per_object("chamfer", number) for number in figures.grasps], axis=0)
    return dict(zip(figures.object_ids, (TABLE_3_FACTOR * values).tolist(), strict=True))


def evaluation_name(training_seed: int = 0) -> str:
    """Name the folder of an evaluation, below a data directory."""
    return f"evaluation-seed-{training_seed}" if training_seed else "evaluation"


def evaluations(directory: DataDirectory) -> list[str]:
    """Name the evaluations of a data directory, that of training seed 0 first."""
    matches = [re.fullmatch(r"evaluation(?:-seed-(\d+))?\.json", name) for name in list_folder(directory.root)]
    return [evaluation_name(seed) for seed in sorted(int(match[1] or 0) for match in matches if match)]


def write_evaluation(
    folder: Path,
    groups: Mapping[str, Mapping[str, Any]],  # arrays by name, by group (`objects`, `predictions/touch`, …)
    attributes: Mapping[str, Any],  # of the root
) -> None:
    """Write groups of `tables.zarr`, whose arrays must be those of the schema; other groups stay."""
    checked = {name: _conform(name, arrays) for name, arrays in groups.items()}
    root = folder / TABLES_ZARR
    metadata = {"": encode_metadata("group", attributes={"schema": "evaluation", "schema_version": VERSION, **attributes})}
    for name, arrays in checked.items():
        shutil.rmtree(root / name, ignore_errors=True)
        declared = GROUPS[name.partition("/")[0]]
        metadata[name] = encode_metadata("group", attributes={"summary": declared.summary})
        for key, value in arrays.items():
            metadata[f"{name}/{key}"] = encode_metadata("array", **array_metadata(declared.arrays[key], value.shape))
            write_array(root / name / key, declared.arrays[key], value)
    write_metadata(root, metadata)


def long_table(figures: Mapping[str, Figures]) -> dict[str, list[Any]]:
    """Join the figures of all networks to the group `figures`."""
    rows = [(name, *figure) for name, of_network in figures.items() for figure in of_network.rows]
    return dict(zip(GROUPS["figures"].arrays, map(list, zip(*rows, strict=True)), strict=True))


def _conform(name: str, arrays: Mapping[str, Any]) -> Arrays:
    """Check the arrays of a group against its schema, and cast them to the types that it declares."""
    declared = GROUPS[name.partition("/")[0]].arrays
    if set(arrays) != set(declared):
        raise StoreError(f"evaluation: {name} has arrays {sorted(arrays)}, its schema declares {sorted(declared)}")
    try:
        conformed = {key: np.asarray(value, numpy_dtype(declared[key])) for key, value in arrays.items()}
    except (TypeError, ValueError) as error:
        raise StoreError(f"evaluation: an array of {name} has another type than its schema declares ({error})") from error
    sizes: dict[str, int] = {}
    for key, value in conformed.items():
        dims = declared[key].dims
        if value.ndim != len(dims) or any(sizes.setdefault(dim, size) != size for dim, size in zip(dims, value.shape, strict=True)):
            raise StoreError(f"evaluation: {name}/{key} has shape {value.shape}, its dimensions are {dims} with {sizes}")
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            raise StoreError(f"evaluation: {name}/{key} holds NaN or infinity")
    return conformed


def _root(folder: Path) -> zarr.Group:
    path = folder / TABLES_ZARR
    try:
        root = zarr.open_group(zarr_store(path), mode="r")
    except (OSError, ValueError, KeyError) as error:
        raise StoreError(f"{path} cannot be read as an evaluation ({error}); run evaluate first") from error
    if root.attrs.get("schema_version") != VERSION:
        raise StoreError(f"{path} is not of schema version {VERSION}; run evaluate, or score, again")
    return root


def read_root(folder: Path) -> dict[str, Any]:
    """Read the attributes of an evaluation folder: settings, seed, configurations; raise a `StoreError` if it cannot be read."""
    return dict(_root(folder).attrs.asdict())


def has_table(folder: Path, name: str) -> bool:
    """Return whether an evaluation folder has a group of that name."""
    return name in _root(folder)


def read_table(folder: Path, name: str) -> Arrays:
    """Read the arrays of one group; raise a `StoreError` if it is missing or invalid."""
    root = _root(folder)
    group = root.get(name)
    if not isinstance(group, zarr.Group):
        raise StoreError(f"{root.store_path} has no group {name}; it has {', '.join(sorted(root.group_keys()))}")
    return _conform(name, {key: np.asarray(array[...]) for key, array in group.arrays()})


def read_figures(folder: Path) -> dict[str, Figures]:
    """Read the figures of an evaluation folder by network."""
    table, object_ids = read_table(folder, "figures"), read_table(folder, "objects")["object_id"].tolist()
    rows: dict[str, list[Figure]] = {}
    for network, *figure in zip(*(table[name].tolist() for name in GROUPS["figures"].arrays), strict=True):
        rows.setdefault(network, []).append(Figure(*figure))
    return {network: Figures(object_ids, figures) for network, figures in rows.items()}


def read_surfaces(folder: Path, configuration: str) -> Arrays | None:
    """Read the surfaces of a configuration: its group below `predictions` or, of a network without charts, `meshes`; None if not kept."""
    names = [name for group in ("meshes", "predictions") if has_table(folder, name := f"{group}/{configuration}")]
    return read_table(folder, names[0]) if names else None


def surface_of(
    surfaces: Arrays,  # of `read_surfaces`
    number: int,  # of its object
    case: int,  # of its choice of grasps
) -> tuple[np.ndarray, np.ndarray]:  # vertices (V, 3) m, faces (F, 3)
    """Take one of the surfaces of a network."""
    if "position" in surfaces:
        return surfaces["vertices"][number, case], surfaces["faces"]
    index = (number, case)
    at = int(np.ravel_multi_index(index, surfaces["vertex_count"].shape))
    first, face = (surfaces[key].ravel()[:at].sum() for key in ("vertex_count", "face_count"))
    vertices = surfaces["vertices"][first : first + surfaces["vertex_count"][index]]
    return vertices, surfaces["faces"][face : face + surfaces["face_count"][index]]
