"""Check a manifest: each object's size, unit, faces and textures, and its faults, before any stage runs."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import ceil
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pipeline.config.manifest import SPLITS, load_manifest
from pipeline.config.sources import Object, identity
from pipeline.console import Columns, abbreviate, pluralise, table_lines, tabulate, with_progress
from pipeline.drawing.picture_sheet import spread_evenly
from pipeline.drawing.plots import save_figure
from pipeline.drawing.views import fitted_camera, render_mesh
from pipeline.errors import InvalidInput
from pipeline.formats.file_units import METRES, stated_units
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.geometry.mesh_cleaning import bounding_diagonal
from stages.render_vision.renderer import Renderer
from stages.sample_surfaces import SampleSurfaces, SurfaceSettings, normalised_mesh, unread_remarks

LISTED = 50  # objects, faults or categories that are listed one by one
USUAL = (0.01, 2.0)  # m, diagonals of objects that hands grasp; others raise doubt about the unit
DRAWN, PER_ROW, PIXELS = 12, 6, 200  # objects that are drawn, spread evenly by size: number, number per row, pixels of each
LIKELY = (0.03, 0.6)  # m, diagonals at which a unit is likely
SCALED = "none: scaled"
QUANTILES = {"smallest": 0.0, "5 % are smaller": 0.05, "half are smaller": 0.5, "95 % are smaller": 0.95, "largest": 1.0}


@dataclass(frozen=True)
class CheckedObject:
    """Facts that were read of an object."""

    name: str  # its id
    unit: str  # of its file, and where this is from
    real_size: bool  # there is a unit, which keeps the size
    sides: tuple[float, ...]  # of its final bounding box, m; x, y and z up
    diagonal: float  # of this box, m
    in_file: float  # the diagonal in the unit of its file
    faces: int  # of its mesh, cleaned
    watertight: bool
    textures: int  # how many
    unread: tuple[str, ...]  # what the file holds or names and the mesh lacks, with reasons

    @property
    def doubt(self) -> str | None:
        """A warning about the unit, if the size is unusual."""
        if not self.real_size or USUAL[0] <= self.diagonal <= USUAL[1]:
            return None
        likely = _likely_units(self.in_file)
        question = f"is the unit {' or '.join(likely)}?" if likely else "is the unit right?"
        return f"warning: {self.name} is {self.diagonal:.3g} m large: {question}"

    def size(self, digits: int = 3) -> str:
        """Write its sides."""
        return " × ".join(f"{side:.{digits}g}" for side in self.sides)


COLUMNS: Columns = {
    "x × y × z, m": ("", CheckedObject.size),
    "unit of its file": ("", attrgetter("unit")),
    "faces": ("", attrgetter("faces")),
    "textures": ("", lambda item: str(item.textures) + (f", {len(item.unread)} missing or unread" if item.unread else "")),
    "watertight": ("", lambda item: "yes" if item.watertight else "no"),
}
QUANTILE_COLUMNS: Columns = {
    "diagonal, m": (".3g", attrgetter("diagonal")),
    "in its file": (".3g", attrgetter("in_file")),
    "faces": ("", attrgetter("faces")),
    "object": ("", attrgetter("name")),
}


@dataclass(frozen=True)
class MeshFiles:
    """The folder of a manifest's mesh files, their unit and up-axis, where they replace the manifest's."""

    root: Path | None = None
    units: str | None = None
    up: str | None = None


def _likely_units(diagonal: float) -> list[str]:
    """List the units in which a diagonal is one of objects that hands grasp."""
    return [unit for unit in ("mm", "cm", "m", "in") if LIKELY[0] <= diagonal * METRES[unit] <= LIKELY[1]]


def check_manifest(
    path: Path,
    picture: Path,
    meshes: MeshFiles,  # states what the manifest does not
) -> list[str]:  # lines; those of objects that cannot be used begin with "fault:"
    """Read and describe each object of a manifest; draw categories, splits and some of the meshes as a PNG."""
    manifest = load_manifest(str(path)).with_units(meshes.units, meshes.up)
    objects = manifest.objects(meshes.root)
    checked, faults = list[CheckedObject](), list[str]()
    for item in with_progress(objects, "reading objects", after=2.0):
        try:
            checked.append(_read_object(item, meshes.units))
        except (InvalidInput, OSError) as error:
            faults.append(f"fault: {item.object_id}: {error}")
    checked.sort(key=lambda item: (item.diagonal, item.in_file, item.name))
    sources, usable = {item.object_id: item.source for item in objects}, {item.name for item in checked}
    _draw(objects, {f"{item.name}\n{item.size(2)} m": sources[item.name] for item in spread_evenly(checked, DRAWN)}, picture)
    verdict = f"{len(faults)} of them cannot be used" if faults else "no faults"
    return [
        f"{path}: manifest {manifest.name}, {pluralise(len(objects))}, {verdict}",
        *_categories(objects),
        *manifest.remarks(meshes.root),
        *_tables(checked),
        *_first(faults),
        *_first([doubt for item in checked if (doubt := item.doubt)]),
        *unread_remarks(unread := {item.name: item.unread for item in checked if item.unread}),
        *_first([f"warning: in {name}: {abbreviate(reasons)}" for name, reasons in [*unread.items()][1:]]),
        *SampleSurfaces().describe_objects(SurfaceSettings(), [item for item in objects if item.object_id in usable]),
        *_first(list(_same_files(objects))),
        *_scaled_sizes(sorted(item.in_file for item in checked if item.unit == SCALED)),
        f"picture: {picture}",
    ]


def _read_object(
    item: Object,
    units: str | None,  # of `--units`, for files for which the manifest states none
) -> CheckedObject:
    """Read an object as `sample-surfaces` does; an `InvalidInput` or `OSError` says why it cannot be used."""
    source, unit = item.source, "m, modelled"
    metres = source.get("metres_per_unit")
    if "file" in source and metres is None:
        unit = SCALED
    elif "file" in source and metres is not None:
        stated = stated_units(Path(source["file"]))[0]
        stated_by = "--units" if units and metres == METRES[units] else "manifest"
        by_another = f"{stated_by} (its file: {_symbol(stated)})" if stated else stated_by
        unit = f"{_symbol(metres)}, {'its file' if stated == metres else by_another}"
    mesh, placement, report = normalised_mesh(source, SurfaceSettings())
    diagonal, scale = bounding_diagonal(mesh.vertices), float(np.linalg.norm(placement[:3, 0]))
    if "diagonals" in source and not np.isclose(scale, metres or float("file" not in source)):
        unit = "drawn size"
    return CheckedObject(
        name=item.object_id,
        unit=unit,
        real_size=metres is not None or "diagonals" in source,
        sides=tuple(np.ptp(mesh.vertices, axis=0).tolist()),
        diagonal=diagonal,
        in_file=diagonal / scale,
        faces=len(mesh.faces),
        watertight=report.watertight,
        textures=len(mesh.look.textures),
        unread=mesh.unread,
    )


def _symbol(metres: float) -> str:
    """Name a unit of this many metres."""
    return next((sign for sign, value in METRES.items() if value == metres), f"{metres:g} m")


def _tables(checked: Sequence[CheckedObject]) -> Iterator[str]:
    """List the objects by size; of too many, the sizes' quantiles and objects of unusual size or without their textures."""
    if len(checked) > LISTED:
        quantiles = {label: checked[round(share * (len(checked) - 1))] for label, share in QUANTILES.items()}
        yield from table_lines(tabulate("", "by size", quantiles, QUANTILE_COLUMNS))
        checked = [item for item in checked if item.doubt or item.unread]
    if checked:
        yield from table_lines(tabulate("", "object", {item.name: item for item in checked[:LISTED]}, COLUMNS))
    if len(checked) > LISTED:
        yield f"and {len(checked) - LISTED} more"


def _first(lines: Sequence[str]) -> list[str]:
    """Return the first lines, and how many more there are."""
    return [*lines[:LISTED], *([f"and {len(lines) - LISTED} more"] if len(lines) > LISTED else [])]


def _scaled_sizes(sizes: Sequence[float]) -> Iterator[str]:  # in increasing order
    """Yield the sizes in their files of objects without a unit, and the likely units."""
    if sizes:
        middle = sizes[len(sizes) // 2]
        likely = " or ".join(f"{middle * METRES[unit]:.2g} m if the unit is {unit}" for unit in _likely_units(middle))
        guess = f", half of them at most {middle:.3g}: {likely}" if likely else ""
        yield f"their files state diagonals from {sizes[0]:.3g} to {sizes[-1]:.3g} without a unit{guess}"


def _same_files(objects: Sequence[Object]) -> Iterator[str]:
    """Warn of objects of one file in several splits: networks would be tested on their training data."""
    by_identity = defaultdict[str, list[Object]](list)
    for item in objects:
        with suppress(InvalidInput, OSError):  # is a fault already
            by_identity[identity(item.source)].append(item)
    for items in by_identity.values():
        if len({item.split for item in items}) > 1:
            yield f"warning: the same file in several splits: {', '.join(f'{item.object_id} ({item.split})' for item in items)}"


def _categories(objects: Sequence[Object]) -> list[str]:
    """Count the objects of each category in each split."""
    counts = Counter((item.category, item.split) for item in objects)
    categories = sorted({item.category for item in objects})
    return _first([f"{category}: " + ", ".join(f"{counts[category, split]} {split}" for split in SPLITS) for category in categories])


def _draw(
    objects: Sequence[Object],
    drawn_sources: Mapping[str, Mapping[str, Any]],  # by caption
    picture: Path,
) -> None:
    """Draw how many objects of the largest categories are in each split, and the meshes of `drawn_sources`, as a PNG."""
    counts = Counter((item.category, item.split) for item in objects)
    categories = sorted(name for name, _ in Counter(item.category for item in objects).most_common(LISTED))
    bars, rows = 1 + 0.3 * len(categories), ceil(len(drawn_sources) / PER_ROW)
    figure = Figure((8, bars + 1.6 * rows), layout="constrained")
    grid = figure.add_gridspec(1 + rows, PER_ROW, height_ratios=[bars, *[1.6] * rows])
    axes, left, places = figure.add_subplot(grid[0, :]), np.zeros(len(categories)), np.arange(len(categories))
    for split in SPLITS:
        width = np.array([counts[category, split] for category in categories])
        axes.barh(places, width, left=left, label=split)
        left += width
    axes.set(xlabel="objects", yticks=places, yticklabels=categories)
    axes.legend(ncols=len(SPLITS), loc="lower left", bbox_to_anchor=(0, 1), frameon=False)
    scene = load_scene("supplement")
    with Renderer(scene, PIXELS) as renderer:
        for number, (caption, source) in enumerate(drawn_sources.items()):
            mesh, _, _ = normalised_mesh(source, SurfaceSettings())
            small = figure.add_subplot(grid[1 + number // PER_ROW, number % PER_ROW])
            small.imshow(render_mesh(renderer, mesh, fitted_camera(scene.square_camera(PIXELS), mesh.vertices)))
            small.axis("off")
            small.set_title(caption, fontsize=6)
    save_figure(figure, picture)
