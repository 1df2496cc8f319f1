"""Write a dataset's objects as ShapeNetCore's meshes and 3D-R2N2's renderings: a folder for the manifest `single-image`.

Run as `python -m tools.synthetic_renderings DATA FOLDER`. Meshes and images are made by this project; what reads the
folder does not know. Viewpoints are drawn as in the cited renderings: azimuths all around, elevations of 25 to 30 degrees.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

from pipeline.config.folder_sources import ShapeNet
from pipeline.config.manifest import load_manifest
from pipeline.console import Meter, errors, print_lines
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.errors import StageError
from pipeline.formats.rendering_folder import METADATA, PIXELS, VIEWS, image_name
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.mesh_cleaning import POSITION, bounding_diagonal
from pipeline.kernels.vision.camera import FARTHEST, FOCAL, SENSOR, Camera, Viewpoint, look_at
from pipeline.kernels.vision.scene import Label
from pipeline.rng import numpy_rng
from pipeline.store.atomic import atomic_writes
from pipeline.store.directory import DataDirectory
from pipeline.store.storage import as_location
from schemas.surfaces import SURFACES
from stages.render_vision.renderer import Renderer

LAMP_ABOVE = 0.6
"""m that the lamp is above the camera, so that visible surfaces are lit."""
LOWEST, HIGHEST, NEAREST = 25.0, 30.0, 0.65
"""Degrees, and the least distance ratio, of the cited renderings."""
FIELD_OF_VIEW = 25.0
"""Degrees, the last value of each line of the metadata: the cited renderings state it, and were not made with it."""


def write_renderings(folder: Path, images: NDArray[np.uint8], viewpoints: Sequence[Viewpoint]) -> None:
    """Write a model's renderings (24, 137, 137, 4), sRGB and opacity, in the form that `read_renderings` reads."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, image in enumerate(images):
        Image.fromarray(image).save(folder / image_name(number))
    (folder / "renderings.txt").write_text("".join(f"{image_name(number)}\n" for number in range(len(images))))
    (folder / METADATA).write_text(
        "".join(" ".join(map(repr, [*vars(viewpoint).values(), FIELD_OF_VIEW])) + "\n" for viewpoint in viewpoints)
    )


def write_dataset(data: str, folder: Path, seed: int = 0) -> int:  # the number of objects
    """Write all objects of a data directory that have a surface, as `ShapeNetCore.v1` and `ShapeNetRendering` in a folder."""
    surfaces, synsets = DataDirectory(as_location(data)).collection(SURFACES), synsets_of("single-image")
    names = [name for name in surfaces if not surfaces.row(name).failure]
    if unknown := sorted({surfaces.row(name).category for name in names} - synsets.keys()):
        raise StageError(f"the manifest single-image has no class {unknown[0]}; it has {', '.join(synsets)}: add it there, with its synset")
    meter = Meter(errors, "write-renderings", len(names), "objects")
    with atomic_writes(folder) as fresh, Renderer(load_scene("supplement"), PIXELS) as renderer, meter:
        for name in names:
            category = surfaces.row(name).category
            inner = Path(synsets[category]) / name.removeprefix(f"{category}-")
            mesh = read_mesh(surfaces.view(name))
            write_mesh(fresh / "ShapeNetCore.v1" / inner / "model.obj", mesh)
            viewpoints = draw_viewpoints(numpy_rng(seed, name, "viewpoints"))
            images = np.stack([render(renderer, mesh, viewpoint) for viewpoint in viewpoints])
            write_renderings(fresh / "ShapeNetRendering" / inner / "rendering", images, viewpoints)
            meter.advance()
    return len(names)


def synsets_of(manifest: str) -> dict[str, str]:
    """Look up the synset of each class of a manifest's ShapeNet sources."""
    sources = [source for source in load_manifest(manifest).sources if isinstance(source, ShapeNet)]
    return {category: synset for source in sources for category, synset in source.synsets.items()}


def draw_viewpoints(rng: np.random.Generator) -> list[Viewpoint]:
    """Draw the viewpoints of a model."""
    drawn = rng.uniform([0, LOWEST, NEAREST], [360, HIGHEST, 1], (VIEWS, 3)).round(6).tolist()
    return [Viewpoint(azimuth, elevation, 0.0, distance) for azimuth, elevation, distance in drawn]


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Write a normalised mesh as ShapeNetCore has it: y up, about the origin, its bounding box of diagonal 1."""
    x, y, z = ((mesh.vertices - POSITION) / bounding_diagonal(mesh.vertices)).T
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.Trimesh(np.stack([x, z, -y], axis=1), mesh.faces, process=False).export(path)


def camera_of(mesh: Mesh, viewpoint: Viewpoint) -> Camera:
    """Location the renderings' camera about a normalised mesh, in the world, z up."""
    azimuth, elevation = np.deg2rad([viewpoint.azimuth, viewpoint.elevation])
    towards = np.array([np.cos(azimuth) * np.cos(elevation), -np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    x, y, z = (POSITION + bounding_diagonal(mesh.vertices) * FARTHEST * viewpoint.distance * towards).tolist()
    focal, middle = FOCAL / SENSOR * PIXELS, PIXELS / 2
    camera = Camera(name="camera", position=(x, y, z), rotation=(0, 0, 0), focal=(focal, focal), centre=(middle, middle), resolution=PIXELS)
    return look_at(camera, (x, y, z), tuple(POSITION.tolist()))


def render(renderer: Renderer, mesh: Mesh, viewpoint: Viewpoint) -> NDArray[np.uint8]:
    """Render a mesh, (137, 137, 4) uint8 sRGB and opacity, transparent where nothing is."""
    camera = camera_of(mesh, viewpoint)
    x, y, z = camera.position
    with renderer.added(mesh, Label.OBJECT) as handle:
        image = renderer.render([(handle, np.eye(4))], camera, lamp=(x, y, z + LAMP_ABOVE))
    opacity = np.where(image.segmentation == Label.OBJECT, 255, 0).astype(np.uint8)
    return np.dstack([image.rgb, opacity])


def main() -> None:
    """Write the folder of the command line."""
    data, folder = sys.argv[1:]
    print_lines(f"{folder}: {write_dataset(data, Path(folder))} objects, {VIEWS} renderings each")


if __name__ == "__main__":
    main()
