"""`sample-surfaces`: every object's cleaned and normalised mesh, and points on its exterior surface (supplement 1.1, 1.2)."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.config.manifest import Object
from pipeline.config.sources import identity, modelled
from pipeline.console import abbreviate, pluralise
from pipeline.dataset.mesh_rows import mesh_row
from pipeline.engine.stage import Cost, Inputs, ObjectStage
from pipeline.engine.unit import Unit
from pipeline.formats.file_content import is_pointer_file
from pipeline.formats.mesh_file import load_mesh
from pipeline.kernels.geometry.exterior_sampling import sample_exterior
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.mesh_cleaning import CleaningReport, clean_mesh
from pipeline.kernels.geometry.normalise import normalise_mesh, normalising_transform
from pipeline.store.rows import Row
from pipeline.store.shard import Shard
from schemas.surfaces import SURFACES
from stages.sample_surfaces.settings import SurfaceSettings


class SampleSurfaces(ObjectStage):
    """Clean, normalise and sample a manifest's objects; the only stage that opens source files."""

    name = "sample-surfaces"
    summary = "Clean and normalise every mesh, draw points from its exterior surface."
    output = SURFACES
    settings_type = SurfaceSettings

    def describe_objects(self, settings: SurfaceSettings, objects: Sequence[Object]) -> Iterator[str]:
        """Report files without units, which are scaled to one size, and warn if others have units and are not scaled."""
        files = [item for item in objects if "file" in item.source and not is_pointer_file(Path(item.source["file"]))]
        sized = [item.object_id for item in files if item.source.get("metres_per_unit") is not None]
        if unitless := len(files) - len(sized):
            size = f"{settings.diagonal:g} m; --units mm (make: UNITS=mm), or another unit, keeps real sizes"
            yield f"{pluralise(unitless)} scaled to a diagonal of {size}"
            if sized:
                yield (
                    f"warning: sizes are mixed: {pluralise(len(sized))} ({abbreviate(sized)}) not scaled, because files or manifest state "
                    "a unit; write a manifest with a folder for each unit, and its metres_per_unit"
                )

    def describe_shard(self, settings: SurfaceSettings, shard: Shard) -> Iterator[str]:
        """Name the objects that lack something of their files, such as a texture."""
        if not shard.has("unread"):  # all objects failed
            return
        unread = shard.read("unread")
        yield from unread_remarks({name: str(unread[row]).split("\n") for name, row in shard.position.items() if unread[row]})

    def cost(self, settings: SurfaceSettings) -> Cost:
        """Estimate one mesh and its points."""
        return Cost(seconds=0.15, kilobytes=400 * settings.points / 10_000)

    @contextmanager
    def session(self, settings: SurfaceSettings, models: Mapping[str, Path]) -> Iterator[Callable[[Unit, Inputs], Row]]:
        """Keep nothing between objects."""
        yield lambda unit, inputs: _process(unit, settings)


def _process(unit: Unit, settings: SurfaceSettings) -> Row:
    mesh, placement, report = normalised_mesh(unit.source, settings)
    points, normals = sample_exterior(mesh, settings.points, unit.rng("sample-surfaces"), directions=settings.directions)
    return {
        "points": points,
        "normals": normals,
        "placement": placement,
        **_origin(unit),
        "unread": np.array("\n".join(mesh.unread)),
        "watertight": np.array(report.watertight),
        "degenerate_faces": np.array(report.degenerate_faces, np.int32),
        "duplicate_faces": np.array(report.duplicate_faces, np.int32),
        **mesh_row(mesh),
    }


def _origin(unit: Unit) -> Row:
    """Describe an object's origin: its file with checksum, licence and unit, or what was modelled."""
    source = unit.source
    file, sha256 = identity(source), ""
    if "file" in source:
        file, sha256 = Path(source["file"]).relative_to(source["root"]).as_posix(), file
    return {
        "source_file": np.array(file),
        "source_sha256": np.array(sha256),
        "licence": np.array(source.get("licence", "")),
        "metres_per_unit": np.array(source.get("metres_per_unit") or 0.0),
    }


def unread_remarks(unread: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Name the objects that lack something of their files, and what the first of them lacks."""
    if unread:
        first, reasons = next(iter(unread.items()))
        yield f"warning: {pluralise(len(unread))} not read in full ({abbreviate([*unread])}); in {first}: {abbreviate(reasons)}"


def normalised_mesh(source: Mapping[str, Any], settings: SurfaceSettings) -> tuple[Mesh, np.ndarray, CleaningReport]:
    """Clean and normalise the mesh of an object's source; return it with its placement (4, 4) and the report of removed faces."""
    mesh, report = clean_mesh(source_mesh(source), settings.max_faces)
    options = {"up": source.get("up", "z"), "diagonal": settings.diagonal, "metres_per_unit": source.get("metres_per_unit")}
    return normalise_mesh(mesh, **options), normalising_transform(mesh, **options), report


def source_mesh(source: Mapping[str, Any]) -> Mesh:
    """Read the mesh of an object from its file, or let its source model it."""
    return load_mesh(Path(source["file"]), Path(source["root"])) if "file" in source else modelled(source).mesh(source)
