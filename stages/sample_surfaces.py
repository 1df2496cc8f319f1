"""`sample-surfaces`: every object's cleaned and normalised mesh, and points on its exterior surface (supplement 1.1, 1.2)."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.config.settings import ObjectSettings, defining, setting
from pipeline.config.sources import Object, identity, modelled
from pipeline.console import abbreviate, pluralise
from pipeline.dataset.mesh_rows import mesh_row
from pipeline.dataset.object_rows import paired_rows
from pipeline.engine.stage import Cost, Inputs, ObjectStage, Trade, Unit
from pipeline.formats.file_content import is_pointer_file
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.mesh_cleaning import DIAGONAL, CleaningReport, bounding_diagonal, clean_mesh, normalise_mesh
from pipeline.kernels.geometry.transforms import length
from pipeline.rng import numpy_rng
from pipeline.store.rows import Row
from pipeline.store.shard import Shard
from schemas.surfaces import SURFACES


class SurfaceSettings(ObjectSettings):
    """How meshes become points on their exterior surface (supplement 1.1, 1.2)."""

    points: int = setting(10_000, "the supplement's S^obj (1.1)", ge=10)
    diagonal: float = defining(DIAGONAL, "bounding-box diagonal that objects are scaled to, m: the authors' 1 × 0.5", ge=1e-3, le=100)
    directions: int = setting(
        256,
        "view directions per point; a point is exterior if two are unobstructed: 64 miss 0.1 % of the surface, more reach ever narrower "
        "gaps; with fewer than 16, no two may see a face of a box",
        ge=16,
    )
    max_faces: int = defining(500_000, "with more, physics takes minutes per object, and hardly changes", gt=0)


class SampleSurfaces(ObjectStage):
    """Clean, normalise and sample a manifest's objects; the only stage that opens source files."""

    name = "sample-surfaces"
    summary = "Clean and normalise every mesh, draw points from its exterior surface."
    output = SURFACES
    settings_type = SurfaceSettings

    def describe_objects(self, settings: SurfaceSettings, objects: Sequence[Object]) -> Iterator[str]:
        """Report files without units, which are scaled to one size, and warn if others have units and are not scaled."""
        unsized = [item for item in objects if "file" in item.source and "diagonals" not in item.source]
        files = [item for item in unsized if not is_pointer_file(Path(item.source["file"]))]
        sized = [item.object_id for item in files if item.source.get("metres_per_unit") is not None]
        if unitless := len(files) - len(sized):
            yield (
                f"{pluralise(unitless)} without a unit, scaled to a diagonal of {settings.diagonal:g} m where it can be read; --units mm "
                "(make: UNITS=mm), or another unit, keeps real sizes"
            )
            if sized:
                yield (
                    f"warning: sizes are mixed: {pluralise(len(sized))} ({abbreviate(sized)}) not scaled, because files or manifest state "
                    "a unit; write a manifest with a folder for each unit, and its metres_per_unit"
                )

    def describe_shard(self, settings: SurfaceSettings, shard: Shard) -> Iterator[str]:
        """Name the objects that lack something of their files, such as a texture."""
        unread = shard.read("unread")
        yield from unread_remarks({name: str(unread[row]).split("\n") for name, row in shard.position.items() if unread[row]})

    def cost(self, settings: SurfaceSettings) -> Cost:
        return Cost(seconds=0.15, kilobytes=400 * settings.points / 10_000)

    def process(self, unit: Unit, inputs: Inputs, settings: SurfaceSettings) -> Row:
        from pipeline.kernels.geometry.exterior_sampling import sample_exterior

        source, file, sha256 = unit.source, identity(unit.source), ""
        if "file" in source:  # its identity is its checksum
            file, sha256 = Path(source["file"]).relative_to(source["root"]).as_posix(), file
        mesh, placement, report = normalised_mesh(source, settings)
        points, normals = sample_exterior(mesh, settings.points, unit.rng("sample-surfaces"), directions=settings.directions)
        return {
            "points": points,
            "normals": normals,
            "placement": placement,
            "source_file": np.array(file),
            "source_sha256": np.array(sha256),
            "licence": np.array(source.get("licence", "")),
            "metres_per_unit": np.array(length(placement[:3, 0]) if "diagonals" in source else source.get("metres_per_unit") or 0.0),
            "unread": np.array("\n".join(mesh.unread)),
            "watertight": np.array(report.watertight),
            "degenerate_faces": np.array(report.degenerate_faces, np.int32),
            "duplicate_faces": np.array(report.duplicate_faces, np.int32),
            **mesh_row(mesh),
        }


def unread_remarks(unread: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Name the objects that lack something of their files, and what the first of them lacks."""
    if unread:
        first, reasons = next(iter(unread.items()))
        yield f"warning: {pluralise(len(unread))} not read in full ({abbreviate([*unread])}); in {first}: {abbreviate(reasons)}"


def normalised_mesh(
    source: Mapping[str, Any], settings: SurfaceSettings
) -> tuple[Mesh, np.ndarray, CleaningReport]:  # world, m; (4, 4) from the file to the world; what was removed
    """Clean and normalise the mesh of an object's file, or the one that its source models."""
    from pipeline.formats.mesh_reader import load_mesh

    read = load_mesh(Path(source["file"]), Path(source["root"])) if "file" in source else modelled(source).mesh(source)
    mesh, report = clean_mesh(read, settings.max_faces)
    unit, diagonal = _size(source, mesh, settings)
    return *normalise_mesh(mesh, up=source.get("up", "z"), diagonal=diagonal, metres_per_unit=unit), report


def _size(source: Mapping[str, Any], mesh: Mesh, settings: SurfaceSettings) -> tuple[float | None, float]:
    """Choose the scale that keeps an object's real size, if it is known and wanted; and the diagonal, m, that counts without one."""
    unit = source.get("metres_per_unit")
    if "diagonals" not in source:
        return unit, settings.diagonal
    low, high = source["diagonals"]
    unit = unit if "file" in source else unit or 1.0
    if unit is not None and low <= unit * bounding_diagonal(mesh.vertices) <= high:
        return unit, settings.diagonal
    share = numpy_rng(0, "diagonal", identity(source)).random()
    return None, float(low * (high / low) ** share)


def coverage(data: Path, reference: Path) -> dict[str, float]:
    """Measure the distance of the reference's points from the nearest points: RMS by object, mm.

    The reference's first points are skipped, if as many remain: with the same random numbers, they lie in the same triangles as these.
    """
    from scipy.spatial import cKDTree

    errors = {}
    for name, (points,), (dense,) in paired_rows(data, reference, "points"):
        tested = dense[len(points) :] if len(dense) >= 2 * len(points) else dense
        errors[name] = 1e3 * float(np.sqrt(np.square(cKDTree(points).query(tested)[0]).mean()))
    return errors


TRADE = Trade(
    metric="distance from the surface to the nearest point, RMS",
    unit="mm",
    candidates=({"points": 2500}, {"points": 5000}, {"points": 20_000}, {"directions": 64}),
    errors=coverage,
    reference={"points": 40_000},
)
