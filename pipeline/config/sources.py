"""The objects of a dataset, and their sources: each kind lists its objects, and describes how to load each."""

import hashlib
import re
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from importlib import resources
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from pipeline import plugins
from pipeline.console import CONTROLS
from pipeline.entries import Entries, Range
from pipeline.errors import InvalidInput
from pipeline.formats.file_content import read_file
from pipeline.formats.file_units import GREATEST_UNIT, LEAST_UNIT, stated_units
from pipeline.formats.mesh_companions import MAX_BYTES, Companions

if TYPE_CHECKING:
    from pipeline.kernels.geometry.mesh import Mesh

NOT_UTF8 = re.compile("[\ud800-\udfff]")  # characters that Python writes for bytes of a file's name that are not UTF-8 (`surrogateescape`)
Diagonal = Annotated[float, Field(ge=1e-3, le=100)]  # m
MAX_OBJECTS = 200_000  # most objects of a source: listing them takes a second, and memory, before anything else is done


@dataclass(frozen=True)
class Object:
    """An object of a dataset."""

    object_id: str
    category: str
    source: dict[str, Any]  # how to load it: JSON values; `file` is a path
    split: str = ""  # that the manifest draws


class Source(Entries):
    """What every source states: the licence of its meshes, and a checksum where its files are known beforehand."""

    kind: str = Field(description="Which kind of source it is, of those below or of a package that declares it.")
    licence: str = Field(min_length=1, description="Of the meshes; recorded with every object.")
    sha256: str | None = Field(None, pattern="[0-9a-f]{64}", description="Checksum of mesh files; an error states theirs if it differs.")
    split: Literal["train", "valid", "test"] | None = Field(
        None, description="Of all its objects, instead of one that is drawn for each: `test` for a source that no network is to learn from."
    )
    diagonals: Range[Diagonal] | None = Field(
        None,
        description="m, least and most bounding-box diagonal, for example [0.06, 0.2]. An object whose real size is known and lies between "
        "them keeps it; others are scaled to a size drawn between them.",
    )
    url: str | None = Field(None, pattern="^https?://[!-~]{1,1000}$", description="Address of its files, for remakes from its recipe.")

    @abstractmethod
    def list_objects(self, root: Path | None) -> Iterator[Object]:
        """List every object of the source; raise an `OSError` or `InvalidInput` if something is missing."""

    def find(self, root: Path | None) -> list[Object]:
        """List every object of the source, and check its checksum if it states one."""
        objects = list(islice(self.list_objects(root), MAX_OBJECTS + 1))
        if not objects:
            raise InvalidInput(f"a {type(self).__name__.lower()} source names no objects; give it some, or leave it out")
        if len(objects) > MAX_OBJECTS:
            raise InvalidInput(f"a source has more than {MAX_OBJECTS} objects; split it into several manifests")
        if self.sha256 is not None and (actual := checksum(objects)) != self.sha256:
            raise InvalidInput(
                f"the {len(objects)} files of this source have checksum {actual}, the manifest says {self.sha256}: "
                "other files than it was written for; install the pinned packages, or state the new checksum in a manifest of your own"
            )
        if self.diagonals is not None:
            objects = [replace(item, source=item.source | {"diagonals": self.diagonals}) for item in objects]
        return objects


class MeshSource(Source):
    """A source of mesh files: which axis of theirs points up, and how large they are."""

    up: Literal["x", "y", "z"] | None = Field(
        None, description="Axis of the files that points up; by default what the file or its format states, else z. Or `--up`."
    )
    metres_per_unit: float | None = Field(
        None,
        ge=LEAST_UNIT,
        le=GREATEST_UNIT,
        description="Keeps real sizes: 0.001 for mm; by default what a file or its format states, else objects are scaled to "
        "one size. Or `--units`.",
    )

    def describe(self, file: Path, root: Path, up: str | None = None, metres_per_unit: float | None = None) -> dict[str, Any]:
        """Describe how to load a file of this source; it may name files below `root`, and state its up-axis and unit."""
        if CONTROLS.search(str(file)) or NOT_UTF8.search(str(file)):
            raise InvalidInput(f"{str(file)!r} has bytes that are not UTF-8, or control characters, in its name; rename it")
        unit, axis = stated_units(file)
        return {
            "file": str(file),
            "root": str(root),
            "up": up or self.up or axis or "z",
            "metres_per_unit": metres_per_unit or self.metres_per_unit or unit,
            "licence": self.licence,
        }

    def remarks(self, root: Path | None) -> Iterator[str]:
        """Report the recognised layout of the folder, and skipped files that look like objects."""
        yield from ()


class ModelledSource(Source):
    """A source that models its objects: the `source` of each has a `kind`, under which `modelled` finds the class again."""

    @staticmethod
    @abstractmethod
    def mesh(source: Mapping[str, Any]) -> "Mesh":
        """Make an object's mesh, the same for the same `source`, in m unless `metres_per_unit` says otherwise."""

    @staticmethod
    @abstractmethod
    def identity(source: Mapping[str, Any]) -> str:
        """Name what the object is; recorded with it, and equal for equal objects."""

    @staticmethod
    @abstractmethod
    def module(source: Mapping[str, Any]) -> str:
        """Name the module whose code makes the object: keys depend on it, and on what it imports."""


def modelled(source: Mapping[str, Any]) -> type[ModelledSource]:
    """Find the class of a modelled object's source, by its kind."""
    kind: type[ModelledSource] = plugins.named("sources", source["kind"], ModelledSource)
    return kind


def identity(source: Mapping[str, Any]) -> str:
    """Name what an object is, wherever its file lies: by the kind that models it, or as the SHA-256 of its mesh file."""
    return file_checksum(Path(source["file"])) if "file" in source else modelled(source).identity(source)


class PybulletFile(Entries):
    """One mesh of the pybullet wheel."""

    file: str = Field(description="Its path in `pybullet_data`.")
    up: Literal["x", "y", "z"] | None = Field(None, description="Axis of the file that points up; by default the source's.")


class Pybullet(MeshSource):
    """Meshes that come inside the pybullet wheel.

    ```yaml
    - {kind: pybullet, licence: zlib, files: {duck: {file: duck.obj, up: y}}, random_urdfs: 10}
    ```
    """

    kind: Literal["pybullet"]
    files: dict[str, PybulletFile] = Field({}, description="Meshes, by the ids that the objects get.")
    random_urdfs: int = Field(0, ge=0, le=1000, description="How many of the wheel's thousand `random_urdfs`.")
    category: str = Field("object", description="Of all these objects.")

    def list_objects(self, root: Path | None) -> Iterator[Object]:
        """List the named files, then the first of `random_urdfs`."""
        data = Path(str(resources.files("pybullet_data")))
        named_files = [(name, entry.file, entry.up) for name, entry in self.files.items()]
        numbered_files = [(f"random-{n:03d}", f"random_urdfs/{n:03d}/{n:03d}.obj", self.up) for n in range(self.random_urdfs)]
        for name, file, up in [*named_files, *numbered_files]:
            if not (data / file).is_file():
                raise InvalidInput(f"there is no {file!r} in {data}; correct the path of {name}, or reinstall the pinned packages")
            yield Object(name, self.category, self.describe(data / file, (data / file).parent, up))


def fingerprint(source: dict[str, Any]) -> dict[str, Any]:
    """Describe an object's source independently of where its files lie: a file is replaced by the hash of its content.

    The materials and textures that it names count too; renderings, which belong to another stage's key, and the licence
    do not.
    """
    description = {name: value for name, value in source.items() if name not in ("root", "renderings", "licence")}
    if "file" not in source:
        return description
    companions = Companions(Path(source["file"]), Path(source["root"]))
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in companions.items()}
    return {**description, "file": {"sha256": companions.sha256, "companions": digests}}


def checksum(objects: list[Object]) -> str:
    """Compute one SHA-256 for all files of a source, of the lines `ID SHA256` in id order."""
    files = sorted((item.object_id, Path(item.source["file"])) for item in objects if "file" in item.source)
    return hashlib.sha256("".join(f"{name} {file_checksum(file)}\n" for name, file in files).encode()).hexdigest()


def file_checksum(file: Path) -> str:
    """Compute the SHA-256 of a mesh file."""
    return hashlib.sha256(read_file(file, MAX_BYTES)).hexdigest()
