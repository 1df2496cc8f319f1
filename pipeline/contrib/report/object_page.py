"""Write the page of one object: an interactive scene, grasps with images, tactile images and depth maps, and reconstructions."""

import base64
import gzip
from collections.abc import Mapping
from contextlib import ExitStack
from functools import cached_property, lru_cache
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Template
from numpy.typing import NDArray
from pydantic import FiniteFloat

from pipeline.contrib.report.report_source import ReportSource, best, errors_table
from pipeline.dataset.grasps import grasp_count
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.drawing.grasp_pictures import Rows, camera_images, grasp_note, size_note, touches_of
from pipeline.drawing.grasp_scene import GraspScenes
from pipeline.drawing.sequence_pictures import animate, are_drawable, first_sequence
from pipeline.drawing.views import fitted_camera, render_mesh
from pipeline.drawing.written_files import WrittenFiles
from pipeline.entries import Entries
from pipeline.formats.image_file import encode_image
from pipeline.store.record import Name, Sha256
from schemas.sequences import SEQUENCES
from stages.render_vision.renderer import Renderer

THUMBNAIL = 150  # pixels per side of a picture in the gallery
MAX_COLUMNS = 10
"""Most columns of a grasp's pictures; more continue in further rows of equal length. A camera image takes two."""
PARTS = {
    "object": "object",
    "hand": "hand",
    "sensors": "sensors (front of each gel)",
    "touched": "touched surface",
    "charts": "touch charts",
}
"""Nodes of a scene that a page can hide, and their labels."""

ENDINGS = (".html", ".webp", ".mesh.js", ".predictions.js", *(f".{kind}.webp" for kind in SEQUENCES))
"""Of the files of an object's page, after its ID; the last ones only where it was reconstructed, slid over a gel, or lifted."""


class ObjectCard(Entries):
    """Facts about an object for the gallery and the statistics, under the key of what its page shows."""

    key: Sha256
    category: str
    split: str
    touches: int
    areas: tuple[FiniteFloat, ...]  # of its contacts, m²


class Pages(WrittenFiles):
    """The files of a report, and the cards of its objects."""

    objects: dict[Name, ObjectCard]

    def files_of(self, object_id: str) -> dict[str, str]:
        """Collect the SHA-256 of the files of an object's page, by path."""
        paths = [f"objects/{object_id}{ending}" for ending in ENDINGS]
        return {path: self.files[path] for path in paths if path in self.files}


class ObjectPages:
    """Writes the pages of objects into a report's folder `objects`: ID and each of `ENDINGS`.

    `opened` closes the renderer of thumbnails, which is opened when first needed.
    """

    def __init__(self, source: ReportSource, template: Template, folder: Path, opened: ExitStack) -> None:
        self.source, self.template, self.folder, self._opened = source, template, folder, opened
        self.scene, self.sensors = source.scene(), source.sensors()
        self.scenes = GraspScenes(source.hand(), self.sensors, small=True)

    @cached_property
    def _renderer(self) -> Renderer:
        return self._opened.enter_context(Renderer(self.scene, 2 * THUMBNAIL))

    def write(self, object_id: str, key: str, common: Mapping[str, Any]) -> ObjectCard:
        """Write an object's page and its files under a key; `common` has the objects before and after it, and what all pages show."""
        rows, evaluation = self.source.rows(object_id), self.source.evaluation
        mesh = read_mesh(rows["surfaces"])
        camera = fitted_camera(self.scene.square_camera(2 * THUMBNAIL), mesh.vertices)
        files = {
            ".webp": _webp(render_mesh(self._renderer, mesh, camera)),
            ".mesh.js": self._packed(object_id, "mesh", self.scenes.scene(rows)),
        }
        predictions = evaluation.predictions(object_id) if evaluation else []
        if evaluation and predictions:
            surfaces = {prediction.name: evaluation.surface(object_id, prediction) for prediction in predictions}
            files[".predictions.js"] = self._packed(object_id, "predictions", self.scenes.predictions(surfaces))
        for kind, artifact in SEQUENCES.items():
            collection = self.source.collections.get(artifact)
            if collection and are_drawable(collection, kind):
                files[f".{kind}.webp"] = animate([first_sequence(collection.view(object_id), kind)])
        surface, count = self.source.collections["surfaces"].row(object_id), grasp_count(rows["grasps"])
        areas, touched = (rows["grasps"][name][:count] for name in ("contact_area", "touch_success"))
        areas = areas.astype(np.float64)
        page = self.template.render(
            id=object_id,
            category=surface.category,
            split=surface.split,
            size=size_note(rows["surfaces"]),
            grasps=[self._grasp(rows, number, areas[number]) for number in range(count)],
            parts=[(part, label) for part, label in PARTS.items() if part != "charts" or "charts" in rows],
            predictions=predictions,
            best=best(predictions) if predictions else None,
            errors=errors_table(predictions) if predictions else None,
            animated=[kind for kind in SEQUENCES if f".{kind}.webp" in files],
            **common,
        )
        files[".html"] = page.encode()
        for ending, content in files.items():
            (self.folder / f"{object_id}{ending}").write_bytes(content)
        return ObjectCard(
            key=key,
            category=surface.category,
            split=surface.split,
            touches=int(touched.sum()),
            areas=tuple(areas[touched].round(10).tolist()),
        )

    def _packed(self, object_id: str, what: str, scene: Any) -> bytes:
        packed = base64.b64encode(gzip.compress(self.scenes.glb(scene), 6, mtime=0)).decode()
        return f'vtMesh("{object_id}.{what}.js", "{packed}");\n'.encode()

    def _grasp(
        self,
        rows: Rows,
        number: int,  # of the grasp
        areas: NDArray[np.float64],  # (S,) of the contacts, m²
    ) -> dict[str, Any]:
        images = camera_images(rows["vision"], number) if "vision" in rows else []
        touches = touches_of(rows, number, self.scenes.hand, self.sensors)
        return {
            "touches": f"{sum(touch.touched for touch in touches)} of {len(touches)} sensors touch",
            "note": f"{grasp_note(rows['grasps'], number)}.",
            "pictures": [{"image": _inline(image), "caption": caption, "shape": image.shape} for caption, image in images],
            "sensors": [
                {
                    "name": touch.name,
                    "touched": touch.touched,
                    "color": "#{:02x}{:02x}{:02x}".format(*touch.color),
                    "verdict": touch.note + (f", contact {1e6 * area:.0f} mm²" if touch.touched else ""),
                    "tactile_image": _inline(touch.tactile_image),
                    "depth": _inline(touch.depth),
                }
                for touch, area in zip(touches, areas, strict=True)
            ],
            "columns": columns(2 * len(images) + len(touches)),
        }


def columns(places: int) -> int:
    """Divide places of a grid into rows of at most `MAX_COLUMNS`, of about equal length; return that length."""
    return ceil(places / ceil(places / MAX_COLUMNS))


def _webp(image: NDArray[np.uint8]) -> bytes:
    return encode_image(image, "WEBP", quality=85, method=2)  # half the time of method 4, files 5 % larger


def _inline(image: NDArray[np.uint8]) -> str:  # a data URI, so that a page is one file
    return _data_uri(image.tobytes(), image.shape)


@lru_cache(maxsize=64)  # sensors that touch nothing see the same, and so do cameras without the hand
def _data_uri(pixels: bytes, shape: tuple[int, ...]) -> str:
    return f"data:image/webp;base64,{base64.b64encode(_webp(np.frombuffer(pixels, np.uint8).reshape(shape))).decode()}"
