"""The page of one object: its scene to turn, its grasps with images, tactile images and depth maps, its reconstructions."""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Template
from numpy.typing import NDArray
from PIL import Image

from pipeline.kernels.touch.contact import pressed_pixels
from pipeline.kernels.touch.sensor import Sensor
from pipeline.reports.contact_sheet_page import depth_colors, depth_note, finger_colors, lift_note
from pipeline.reports.grasp_scene import GraspScenes, Rows
from pipeline.reports.report_source import ReportSource

THUMBNAIL = 150
"""Pixels per side of a picture in the gallery."""

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
    """Write the pages of a report's objects into its folder `objects`: ID.html, ID.webp, ID.mesh.js, ID.predictions.js."""

    def __init__(self, source: ReportSource, template: Template, folder: Path) -> None:
        self.source, self.template, self.folder = source, template, folder
        self.sensors = source.sensors()
        self.scenes = GraspScenes(source.hand(), self.sensors, small=True)

    def write(self, object_id: str, before: str | None, after: str | None, common: Mapping[str, Any]) -> dict[str, Any]:
        """Write an object's page and its files.

        Parameters
        ----------
        object_id
            The object.
        before, after
            The objects of the previous and the next page.
        common
            Entries of the template that all pages share.

        Returns
        -------
        Its `ObjectCard`, without the key.
        """
        rows = self.source.rows(object_id)
        grasps = [self._grasp(rows, number) for number in range(len(rows["grasps"]["hand_pose"]))]
        (self.folder / f"{object_id}.webp").write_bytes(_webp(_thumbnail(rows)))
        self._write_mesh(f"{object_id}.mesh.js", self.scenes.scene(rows))
        evaluation = self.source.evaluation
        surfaces = evaluation.surfaces(object_id) if evaluation else {}
        if surfaces:
            self._write_mesh(f"{object_id}.predictions.js", self.scenes.predictions(surfaces))
        surface = self.source.collections["surfaces"].row(object_id)
        page = self.template.render(
            id=object_id,
            category=surface.category,
            split=surface.split,
            grasps=grasps,
            parts=[(part, label) for part, label in PARTS.items() if part != "charts" or "charts" in rows],
            predictions=[{"value": name, "label": _label(name)} for name in surfaces],
            errors=evaluation.errors(object_id) if evaluation else None,
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
            result = depth_note(bool(touched[sensor]), 1e3 * float(depth.min()))
            if touched[sensor]:
                result += f", contact {1e6 * areas[sensor]:.0f} mm²"
            sensors.append(
                {
                    "name": name,
                    "touched": bool(touched[sensor]),
                    "color": "#{:02x}{:02x}{:02x}".format(*colors[sensor]),
                    "verdict": result,
                    "tactile_image": _inline(touch["tactile_image"][number, sensor]),
                    "depth": _inline(depth_colors(depth, self.sensors[sensor])),
                }
            )
        pictures = []
        if "vision" in rows:
            shown = {"the object alone": rows["vision"]["unoccluded"][0]}
            if "occluded" in list(rows["vision"]):
                shown["in this grasp"] = rows["vision"]["occluded"][number, 0]
            for caption, image in shown.items():
                height, width = image.shape[:2]
                pictures.append(
                    {"image": _inline(image), "alt": f"Camera image: {caption}", "caption": caption, "width": width, "height": height}
                )
        note = f"rigid parts of the hand are at most {1e3 * float(rows['grasps']['penetration'][number]):.2f} mm inside the object"
        if "closure" in list(rows["grasps"]):
            margin, angle = (float(rows["grasps"][name][number]) for name in ("closure", "opposition"))
            note += f"; margin of force closure {margin:.2f}, most opposed contacts {angle:.0f}°"
        if "held" in list(rows["grasps"]):
            note += f"; {lift_note(rows['grasps']['held'][number])}"
        touches = f"{touched.sum()} of {len(touched)} sensors touch"
        return {"touches": touches, "note": note, "pictures": pictures, "sensors": sensors}

    def _contact_areas(self, rows: Rows) -> NDArray[np.float64]:
        """Read or compute the (grasp, sensor) area of the pixels that the surface presses on, m²."""
        if "contact_area" in list(rows["grasps"]):
            return np.asarray(rows["grasps"]["contact_area"], np.float64)
        depth = rows["touch"]["depth"]
        return np.stack([_pressed_area(depth[:, number], sensor) for number, sensor in enumerate(self.sensors)], axis=1)


def _pressed_area(depth: np.ndarray, sensor: Sensor) -> NDArray[np.float64]:
    """Compute the area, m², of the pixels of depth maps (…, rows, cols) that the surface presses on: (…)."""
    return np.asarray(sensor.width * sensor.height * pressed_pixels(depth, sensor).mean(axis=(-2, -1)), np.float64)


def _label(name: str) -> str:
    configuration, _, given = name.rpartition("-")
    return f"{configuration}, {given} grasp{'s' if given != '1' else ''}"


def _thumbnail(rows: Rows) -> NDArray[np.uint8]:
    """Take the object's camera image, cut around the object; the first tactile image where there is none."""
    if "vision" not in rows:
        return np.asarray(rows["touch"]["tactile_image"][0, 0])
    shown = np.argwhere(rows["vision"]["segmentation"][0, 0] == 1)
    image = rows["vision"]["unoccluded"][0]
    if not len(shown):
        return np.asarray(image)
    middle, reach = (shown.min(axis=0) + shown.max(axis=0)) // 2, int(np.ptp(shown, axis=0).max() * 0.58) + 2
    padded = np.pad(image, ((reach, reach), (reach, reach), (0, 0)), mode="edge")
    row, col = middle
    return np.asarray(padded[row : row + 2 * reach, col : col + 2 * reach])


def _webp(image: NDArray[np.uint8], side: int = 2 * THUMBNAIL) -> bytes:
    made = Image.fromarray(np.ascontiguousarray(image))
    made = made.resize((side, side), Image.Resampling.LANCZOS)
    written = io.BytesIO()
    made.save(written, "WEBP", quality=80)
    return written.getvalue()


def _inline(image: NDArray[np.uint8]) -> str:
    """Write an image as a data URI: one page is one file, however many images it shows."""
    written = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(written, "WEBP", quality=85)
    return f"data:image/webp;base64,{base64.b64encode(written.getvalue()).decode()}"
