"""Records: one small JSON file per shard or folder, which names what readers see and says what it was made from.

A record is replaced atomically. What no record names is garbage.
"""

import importlib.metadata
import json
import operator
import platform
import sys
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeVar

import numpy as np
from pydantic import Field, ValidationError

from pipeline.console import CONTROLS
from pipeline.entries import Entries
from pipeline.errors import OtherVersion, StoreError, first_line
from pipeline.store import digest
from pipeline.store.storage import Location, read_bytes

FORMAT: Final = 2  # version of the format of records, raised when an older version could misread them

Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9=,+._-]{0,199}$")]  # a name that may become part of a path

RelativePath = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9=,+._-]{0,199}(/[A-Za-z0-9_-][A-Za-z0-9=,+._-]{0,199})*$")]
"""A file or folder below another one, never above it."""

Text = Annotated[str, Field(pattern=f"^{CONTROLS.pattern.replace('[', '[^', 1)}*$")]  # a name that is shown to people


ObjectOption = Literal["--manifest", "--objects", "--units", "--up"]


class Failure(Entries):
    """Why an object has no row: the stage in which it failed, and the reason."""

    stage: str
    reason: str


class Provenance(Entries):
    """What was made, by which stage, from what."""

    format: Literal[2] = FORMAT
    location: Name  # the Zarr group or folder beside the record
    stage: Text
    key: Sha256  # hash of everything that the content depends on
    settings: dict[str, Any]  # those that results depend on
    speed_settings: dict[str, Any]  # those that they do not depend on
    preset: Text
    seed: int
    manifest: Text
    # command-line options that selected the objects, as given, if the manifest's name does not; not in the file if empty
    options: dict[ObjectOption, Text] = Field({}, exclude_if=operator.not_)
    models: dict[RelativePath, Sha256]  # digest of each trained model that was read, by name
    versions: dict[str, str]
    processor: dict[str, Any]  # its properties: training and charts may differ in their last bits between processors


class RowRecord(Entries):
    """One object of a shard."""

    object_id: Name
    category: Text
    split: Text
    key: Sha256
    digest: Sha256
    inputs: dict[str, Sha256]  # digests of the rows it was made from, by artifact
    seconds: float  # time that it took
    # the kind that computed it (`processor_kind`): workers of one run may differ; empty where nothing was computed
    processor: str = ""
    failure: Failure | None = None

    def labels(self) -> dict[str, Any]:
        """Return the entries of the arrays that every artifact has (`COMMON`)."""
        object_id = self.object_id
        return {"object": object_id, "object_id": object_id, "category": self.category, "split": self.split, "ok": self.failure is None}


class ShardRecord(Provenance):
    """The record of a shard."""

    schema_version: int
    rows: tuple[RowRecord, ...]  # in order
    # objects of the manifest that belong to the shard and have not been made yet: runs with `--object` named others;
    # not in the file if empty, so that versions without it read records of complete shards
    missing: tuple[Name, ...] = Field((), exclude_if=operator.not_)
    constants_digest: Sha256  # of the arrays without an object dimension
    # SHA-256 of the `zarr.json` of the group itself, under the empty name, and of each array at its root
    metadata: dict[str, Sha256]

    def made_with(self) -> dict[str, str]:
        """List its settings, seed and models as texts that fit into a message."""
        settings = {name: json.dumps(value, sort_keys=True) for name, value in self.settings.items()}
        return {**settings, "--seed": str(self.seed), **{name: made_of[:16] for name, made_of in self.models.items()}}


class FolderRecord(Provenance):
    """The record of a folder that a dataset stage filled."""

    splits: tuple[str, ...]
    inputs: dict[Name, Sha256]  # digests of the artifacts' rows of these splits
    facts: dict[str, Any]  # figures that the stage reports
    seconds: float
    files: dict[RelativePath, Sha256]  # SHA-256 of every file that counts

    def digest(self) -> str:
        """Compute the digest of the files: equal wherever the same was computed."""
        return digest.of_json(self.files)


R = TypeVar("R", bound=Provenance)


LIBRARIES = ("vt-pipeline", "numpy", "scipy", "torch", "trimesh", "embreex", "libigl", "numba", "pyrender-maintained", "zarr")
PHYSICS = ("pybullet", "pybullet-arm64")  # packages of PyBullet: its own has no wheels beyond Python 3.11. Both give identical results.


@cache
def library_versions() -> dict[str, str]:
    """Look up the version of every library that results depend on."""
    versions = {name: importlib.metadata.version(name) for name in LIBRARIES}
    for name in PHYSICS:
        with suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    return versions


def processor() -> dict[str, Any]:
    """Describe the processor as far as results depend on it: `machine`, `model`, instruction sets of `numpy`, `torch`.

    Those of torch are given where it is imported already. Surfaces, grasps, images and touches are the same on every
    processor with FMA. Training and charts are not: BLAS and torch choose their kernels by processor.
    """
    config: Any = np.show_config(mode="dicts")
    simd = config["SIMD Extensions"]
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.processor())
    description = {"machine": platform.machine(), "model": model, "numpy": [*simd["baseline"], *simd.get("found", [])]}
    if torch := sys.modules.get("torch"):
        description["torch"] = torch.backends.cpu.get_cpu_capability()
    return description


def processor_kind(processor: Mapping[str, Any]) -> str:
    """Name the properties of a processor that results may depend on: model, machine, and the instruction sets that numpy uses."""
    sets = processor.get("numpy")
    return f"{processor.get('model')}, {processor.get('machine')}, {' '.join(map(str, sets)) if isinstance(sets, list) else sets}"


def serialise_with_checksum(record: Provenance) -> bytes:
    """Serialise a record with its checksum: one flipped bit could name another split or another group."""
    content = json.loads(record.model_dump_json())
    return json.dumps({"checksum": digest.of_json(content), **content}, indent=1).encode()


def read_record(path: Location, kind: type[R], maker: str = "the stage that makes it") -> R:
    """Read a record of a type; `maker` is what the error message says to run if there is none."""
    content = read_content(path, maker)
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        raise _damaged(path, error) from error


def read_content(path: Location, maker: str = "the stage that makes it") -> dict[str, Any]:
    """Read the fields of a record of any kind; errors are those of `read_record`."""
    try:
        content: dict[str, Any] = json.loads(read_bytes(path))
        version, checksum = content.get("format"), content.pop("checksum", None)
        is_sound = checksum == digest.of_json(content)
    except FileNotFoundError:
        raise StoreError(f"{path.with_suffix('')} has not been made; run {maker} first") from None
    except (OSError, ValueError, AttributeError, RecursionError) as error:  # also NaN, or brackets without end
        raise _damaged(path, error) from error
    if isinstance(version, int) and version != FORMAT:
        raise OtherVersion(
            f"{path}: the record is of format {version}, this version of vt-pipeline reads format {FORMAT}; "
            "use the version that wrote it, or delete the record and run its stage again"
        )
    if not is_sound:
        raise _damaged(path, ValueError("its checksum is not that of its content"))
    return content


def named_location(path: Location) -> str | None:
    """Read the name of the group or folder in a record of any kind; None if there is no readable record."""
    try:
        return str(read_content(path)["location"])
    except (StoreError, KeyError):
        return None


def _damaged(path: Location, error: Exception) -> StoreError:
    return StoreError(f"{path}: the record is damaged ({first_line(error)}); delete it and run its stage again")
