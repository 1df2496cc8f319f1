"""A data directory with a shard of each of several artifacts, a failed object and a folder."""

import hashlib
import io
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from checks.fuzz.target import Files, Target, files_made_by, seal
from pipeline.console import show_tables
from pipeline.dataset.grasp_dataset import GraspDataset
from pipeline.dataset.labelled import open_artifact
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import ObjectRows
from pipeline.errors import StoreError
from pipeline.formats.sensor_file import load_sensor
from pipeline.store import digest
from pipeline.store.digest import hashes_of
from pipeline.store.directory import DataDirectory
from pipeline.store.layout import numpy_dtype
from pipeline.store.publish import commit_folder, commit_shard
from pipeline.store.record import Failure, FolderRecord, RowRecord, ShardRecord
from pipeline.store.rows import Result, Row, row_digest
from pipeline.store.validate import problems_below
from pipeline.tables import status
from pipeline.tables.touch_tables import read_touches, touch_tables
from schemas.base import COMMON, FIXED, Array
from schemas.grasps import GRASPS
from schemas.surfaces import SURFACES
from schemas.touch import TOUCH

LEFT_OUT = ("local_points", "local_count")
SIZE = 2
"""Size of every dimension that a dataset chooses."""
SIZES = {**FIXED, "direction": 6}
"""Sizes of the others; grasps are held against gravity in one direction or six."""
PROVENANCE: dict[str, Any] = {
    **{"location": "unpublished", "key": "0" * 64, "settings": {"grasps": 2}, "speed_settings": {}, "preset": "draft", "seed": 0},
    **{"manifest": "m", "models": {}, "versions": {"numpy": "2"}, "processor": {}},
}


class Stores(Target):
    """Readers of data directories, one per input; half of the inputs have records with updated checksums."""

    def sound(self) -> list[Files]:
        return [files_made_by(_make)]

    def read(self, folder: Path, files: Files) -> None:
        content = zlib.crc32(b"".join(files.values()))
        if content % 2:
            _seal(folder)
        checks = list(_checks(folder))
        checks[content // 2 % len(checks)]()


def _check_all(data: Path) -> None:
    if any(problems_below(data).values()):
        raise StoreError("not valid")


def _checks(data: Path) -> Iterator[Callable[[], object]]:
    yield lambda: _check_all(data)
    yield lambda: _check_all(data)
    yield lambda: status.show(status.read_account(data), Console(file=io.StringIO()))
    yield lambda: status.read_account(data).to_json()
    yield lambda: show_tables(touch_tables(read_touches(data)), Console(file=io.StringIO()))
    for artifact in (SURFACES, GRASPS, TOUCH):
        yield lambda artifact=artifact: open_artifact(data, artifact.name)
    yield lambda: read_mesh(DataDirectory(data).collection(SURFACES).view("a"))
    yield lambda: GraspDataset(data, ["points", "tactile_image", "local_points", "sensor_pose"])[1]
    yield lambda: ObjectRows(data, ["untouched", "depth"]).sensor()
    yield lambda: DataDirectory(data).verified_folder("models/unet")


def _make(data: Path) -> None:
    """Publish the artifacts of an object and of a failed one with random values."""
    directory, rng = DataDirectory(data), np.random.default_rng(0)
    directory.set_shard_count(1)
    inputs: dict[str, dict[str, str]] = {"a": {}, "b": {}}
    for artifact in (SURFACES, GRASPS, TOUCH):
        constants = {name: _values(array, rng) for name, array in artifact.arrays.items() if not array.per_object}
        per_object = {name: array for name, array in artifact.arrays.items() if array.per_object and name not in (*COMMON, *LEFT_OUT)}
        ragged = {name.replace("*", "0"): array for name, array in artifact.ragged.items()}
        values_of_objects: dict[str, Row] = {"a": {name: _values(array, rng)[0] for name, array in per_object.items()}, "b": {}}
        values_of_objects["a"] |= {name: _values(array, rng) for name, array in ragged.items()}
        failures = {"a": None, "b": Failure(stage="sample-surfaces", reason="it [is] bad")}
        rows = []
        for name, row in values_of_objects.items():
            made_of = row_digest(row, failures[name], "mug")
            facts: dict[str, Any] = {"category": "mug", "split": "train", "key": "0" * 64, "seconds": 1.5}
            rows.append(RowRecord(object_id=name, digest=made_of, inputs=dict(inputs[name]), failure=failures[name], **facts))
            inputs[name][artifact.name] = made_of
        record = ShardRecord(
            **PROVENANCE,
            stage=f"make-{artifact.name}",
            schema_version=artifact.version,
            rows=tuple(rows),
            constants_digest=digest.of_arrays(constants),
            metadata={},
        )
        sensor = load_sensor("gel_16mm").model_copy(update={"rows": SIZE, "cols": SIZE}).model_dump(mode="json")
        attributes = {"sensors": [sensor] * SIZE}
        files = directory.rows(artifact)
        results = [files.save(Result(name=name, key="0" * 64, failure=failures[name]), row) for name, row in values_of_objects.items()]
        record_path = directory.shard_record(artifact.name, 0, 1)
        commit_shard(directory, artifact, record_path, record, results, constants, attributes)
    (folder := data / ".work" / "unet").mkdir(parents=True)
    (folder / "model.json").write_text("{}")
    facts_of_folder: dict[str, Any] = {
        "stage": "train-unet",
        "splits": ("train",),
        "facts": {"epochs": 3},
        "seconds": 1.0,
        "files": hashes_of(folder),
    }
    grasps = directory.collection(GRASPS).rows_digest(("train",))
    commit_folder(directory, "models/unet", folder, FolderRecord(**PROVENANCE, **facts_of_folder, inputs={"grasps": grasps}))


def _values(array: Array, rng: np.random.Generator) -> np.ndarray:
    shape = tuple(1 if dim == "object" else SIZES.get(dim, SIZE) for dim in array.dims)
    if array.dtype == "string":
        return np.array([f"name-{number}" for number in range(shape[0])])
    if array.dims[-2:] == ("pose_row", "pose_column"):
        return np.broadcast_to(np.eye(4), shape).copy()
    return rng.integers(0, 2, shape).astype(numpy_dtype(array))


def _seal(data: Path) -> None:
    """Update the digests in records so that readers get beyond the checks."""

    def metadata(path: Path, location: str, names: dict[str, str]) -> dict[str, str]:
        return {name: hashlib.sha256((path / location / name / "zarr.json").read_bytes()).hexdigest() for name in names}

    for record in data.glob("*/????-of-????.json"):
        seal(record, lambda said, at=record.parent: {"metadata": metadata(at, said["location"], said["metadata"])})
    seal(data / "models" / "unet.json", lambda said: {"files": hashes_of(data / "models" / said["location"])})
