"""Write the page of one object: an interactive scene, grasps with images, tactile images and depth maps, and reconstructions."""

import base64
import gzip
import hashlib
import io
from collections.abc import Mapping
from contextlib import ExitStack
from functools import cached_property
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Template
from numpy.typing import NDArray
from PIL import Image

from pipeline.contrib.report.reconstruction_gallery import render_mesh
from pipeline.contrib.report.report_source import ReportSource, best, errors_table, shown_scene
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.drawing.contact_sheet_page import depth_colors, enlarged, finger_colors, grasp_note, size_note
from pipeline.drawing.grasp_scene import GraspScenes, Rows
from pipeline.drawing.second_view import fitted_camera
from pipeline.kernels.touch.depth_maps import pressed_pixels
from pipeline.kernels.touch.sensor import Sensor
from stages.render_vision.renderer import Renderer

THUMBNAIL = 150
"""Pixels per side of a picture in the gallery."""

MAX_COLUMNS = 10
"""Most columns of a grasp's pictures; more continue in further rows of equal length. A camera image takes two."""

ENDINGS = (".html", ".webp", ".mesh.js", ".predictions.js")
"""Endings of an object's files; the last needs an evaluation."""

PARTS = {
    "object": "object",
    "hand": "hand",
    "sensors": "sensors (front of each gel)",
    "touched": "touched surface",
    "charts": "touch charts",
}
"""Nodes of a scene that a page can hide, and their labels."""


class ObjectPages:
    """Write the pages of a report's objects into its folder `objects`: ID.html, ID.webp, ID.mesh.js, ID.predictions.js.

    `opened` closes the renderer of thumbnails, which is opened when first needed.
    """

    def __init__(self, source: ReportSource, template: Template, folder: Path, opened: ExitStack) -> None:
        self.source, self.template, self.folder, self._opened = source, template, folder, opened
        self.scene = shown_scene(source.directory)
        self.sensors = source.sensors()
        self.scenes = GraspScenes(source.hand(), self.sensors, small=True)

    @cached_property
    def _renderer(self) -> Renderer:
        return self._opened.enter_context(Renderer(self.scene, 2 * THUMBNAIL))

    def write(self, object_id: str, before: str | None, after: str | None, common: Mapping[str, Any]) -> dict[str, Any]:
        """Write an object's page, with links to the pages before and after it, and its files; return its `ObjectCard`, without the key."""
        rows = self.source.rows(object_id)
        grasps = [self._grasp(rows, number) for number in range(len(rows["grasps"]["hand_pose"]))]
        (self.folder / f"{object_id}.webp").write_bytes(_webp(self._thumbnail(rows)))
        self._write_mesh(f"{object_id}.mesh.js", self.scenes.scene(rows))
        evaluation = self.source.evaluation
        predictions = evaluation.predictions(object_id) if evaluation else []
        if evaluation and predictions:
            self._write_mesh(f"{object_id}.predictions.js", self.scenes.predictions(evaluation.surfaces(object_id)))
        surface = self.source.collections["surfaces"].row(object_id)
        page = self.template.render(
            id=object_id,
            category=surface.category,
            split=surface.split,
            size=size_note(rows["surfaces"]),
            grasps=grasps,
            parts=[(part, label) for part, label in PARTS.items() if part != "charts" or "charts" in rows],
            predictions=[
                {"value": prediction.name, "label": prediction.label, "best": prediction is best(predictions)} for prediction in predictions
            ],
            errors=errors_table(predictions) if predictions else None,
            before=before,
            after=after,
            **common,
        )
        (self.folder / f"{object_id}.html").write_text(page, encoding="utf-8")
        touched = rows["grasps"]["touch_success"]
        areas = self._contact_areas(rows)[touched]
        files = [path for ending in ENDINGS if (path := self.folder / f"{object_id}{ending}").exists()]
        return {
            "category": surface.category,
            "split": surface.split,
            "touches": int(touched.sum()),
            "areas": areas.round(10).tolist(),
            "files": {f"{self.folder.name}/{path.name}": hashlib.sha256(path.read_bytes()).hexdigest() for path in files},
        }

    def _write_mesh(self, name: str, scene: Any) -> None:
        packed = base64.b64encode(gzip.compress(self.scenes.glb(scene), 6, mtime=0)).decode()
        (self.folder / name).write_text(f'vtMesh("{name}", "{packed}");\n')

    def _grasp(self, rows: Rows, number: int) -> dict[str, Any]:
        touched, touch = rows["grasps"]["touch_success"][number], rows["touch"]
        names = [mount.name for mount in self.scenes.hand.sensors]
        areas, colors = self._contact_areas(rows)[number], finger_colors(len(names))
        sensors = []
        for sensor, name in enumerate(names):
            depth = touch["depth"][number, sensor]
            verdict, deepest = "nothing in range", 1e3 * float(depth.min())
            if touched[sensor]:
                verdict = f"touch, deepest point {deepest:.1f} mm, contact {1e6 * areas[sensor]:.0f} mm²"
            elif np.isfinite(deepest):
                verdict = f"no touch, nearest point {deepest:.1f} mm"
            sensors.append(
                {
                    "name": name,
                    "touched": bool(touched[sensor]),
                    "color": "#{:02x}{:02x}{:02x}".format(*colors[sensor]),
                    "verdict": verdict,
                    "tactile_image": _inline(touch["tactile_image"][number, sensor]),
                    "depth": _inline(depth_colors(depth, self.sensors[sensor])),
                }
            )
        pictures = self._pictures(rows, number)
        return {
            "touches": f"{touched.sum()} of {len(touched)} sensors touch",
            "note": f"{grasp_note(rows['grasps'], number)}.",
            "pictures": pictures,
            "sensors": sensors,
            "columns": columns(2 * len(pictures) + len(sensors)),
        }

    def _pictures(self, rows: Rows, number: int) -> list[dict[str, Any]]:
        """Collect the camera images of a grasp, without and with the hand, enlarged if the object is small in them."""
        if "vision" not in rows:
            return []
        vision = rows["vision"]
        images = {"camera image": vision["unoccluded"][0]}
        masks = vision["segmentation"][:1, 0]
        if "occluded" in list(vision):
            images["with the hand"] = vision["occluded"][number, 0]
            masks = vision["segmentation"][[0, 1 + number], 0]
        pictures = []
        for caption, image in images.items():
            part, note = enlarged(image, masks > 0)
            height, width = part.shape[:2]
            pictures.append(
                {"image": _inline(part), "alt": f"Camera image, {caption}", "caption": caption + note, "width": width, "height": height}
            )
        return pictures

    def _thumbnail(self, rows: Rows) -> NDArray[np.uint8]:
        """Render the object, (R, R, 3), from the position of the dataset's camera."""
        mesh = read_mesh(rows["surfaces"])
        return render_mesh(self._renderer, mesh, fitted_camera(self.scene.square_camera(2 * THUMBNAIL), mesh.vertices))

    def _contact_areas(self, rows: Rows) -> NDArray[np.float64]:
        """Read or compute the (grasp, sensor) area of the pixels that the surface presses on, m²."""
        if "contact_area" in list(rows["grasps"]):
            return np.asarray(rows["grasps"]["contact_area"], np.float64)
        depth = rows["touch"]["depth"]
        return np.stack([_pressed_area(depth[:, number], sensor) for number, sensor in enumerate(self.sensors)], axis=1)


def columns(places: int) -> int:
    """Divide places of a grid into rows of at most `MAX_COLUMNS`, of about equal length; return that length."""
    return ceil(places / ceil(places / MAX_COLUMNS))


def _pressed_area(depth: np.ndarray, sensor: Sensor) -> NDArray[np.float64]:
    """Compute the area, m², of the pixels of depth maps (…, rows, cols) that the surface presses on: (…)."""
    return np.asarray(sensor.width * sensor.height * pressed_pixels(depth, sensor).mean(axis=(-2, -1)), np.float64)


def _webp(image: NDArray[np.uint8]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(buffer, "WEBP", quality=85)
    return buffer.getvalue()


def _inline(image: NDArray[np.uint8]) -> str:
    """Write an image (R, C, 3) as a data URI, so that a page is one file."""
    return f"data:image/webp;base64,{base64.b64encode(_webp(image)).decode()}"
