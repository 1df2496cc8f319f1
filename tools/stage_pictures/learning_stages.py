"""The pictures of the stages that learn, and of the charts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from pipeline.kernels.touch.contact import local_points
from pipeline.kernels.touch.gel_surface import in_gel
from pipeline.models.touch_model import LocalTouchModel, load_touch_model
from pipeline.reports.contact_sheet_page import depth_colors, spread_evenly
from pipeline.reports.paper_figures import colored_charts, draw_local_points
from pipeline.reports.reconstruction_gallery import draw_gallery, two_coloured
from schemas.catalogue import ARTIFACTS
from tools.picture_row import Panel, draw_row
from tools.stage_pictures.cuts import cutting_plane, frame_cut, outline
from tools.stage_pictures.data_stages import CONTACT_COLOR
from tools.stage_pictures.shown import Shown

OBJECTS = 5
"""Reconstructions that are shown."""

Panels = list[tuple[str, Panel]]


def draw_unet(shown: Shown, path: Path) -> None:
    """Draw a touch, and its depth as predicted."""
    model = load_touch_model(shown.source.directory.verified_folder("models/unet"), "cpu")
    depths, sensors = shown.rows["touch"]["depth"][shown.grasp], shown.source.sensors()
    touched = np.flatnonzero(shown.rows["grasps"]["touch_success"][shown.grasp]).tolist()
    finger = max(touched, key=lambda number: float(np.ptp(depths[number][in_gel(depths[number], sensors[number])])))
    tactile_image, depth = shown.rows["touch"]["tactile_image"][shown.grasp, finger], depths[finger]
    sensor, (predicted, mask) = model.sensor, (maps[0] for maps in model.maps(tactile_image[None]))
    apart = np.where(mask & in_gel(depth, sensor), np.abs(predicted - depth), 0)
    error = matplotlib.colormaps["magma"](np.clip(apart / 0.5e-3, 0, 1))[..., :3]
    panels: Panels = [
        ("tactile image", tactile_image),
        ("true depth", depth_colors(depth, sensor)),
        ("predicted, where it touched", depth_colors(np.where(mask, predicted, np.inf), sensor)),
        (f"error, mean {1e3 * apart[apart > 0].mean():.2f} mm", np.round(255 * error).astype(np.uint8)),
    ]
    draw_row(panels, path)


def draw_local_network(shown: Shown, path: Path) -> None:
    """Draw the press with the largest contact that does not reach the rim, and what the local network reads in it."""
    model = load_touch_model(shown.source.directory.verified_folder("models/touch"), "cpu")
    assert isinstance(model, LocalTouchModel)
    row = shown.source.directory.collection(ARTIFACTS["presses"]).view(shown.object_id)
    number = largest_whole(row["press_contact"])
    draw_row(reading_panels(model, row["press_image"][number], row["press_indentation"][number], row["press_untouched"]), path)


def largest_whole(contacts: np.ndarray) -> int:
    """Find the largest of some contacts, (N, rows, cols), that the rim of the image does not cut."""
    cut = contacts[:, [0, -1]].any(axis=(1, 2)) | contacts[:, :, [0, -1]].any(axis=(1, 2))
    return int(np.where(cut, 0, contacts.sum(axis=(1, 2))).argmax())


def reading_panels(model: LocalTouchModel, image: np.ndarray, indentation: np.ndarray, untouched: np.ndarray) -> Panels:
    """Make panels of a press: image, true and read indentation, error; bright is deep, orange the contact that is read."""
    reading = model.read(image[None], untouched)
    deepest, error = float(indentation.max()), 1e3 * np.abs(reading.indentation[0] - indentation)

    def grey(depth: np.ndarray) -> np.ndarray:
        return np.clip(60 + 195 * np.maximum(depth, 0) / deepest, 0, 255)[..., None] * np.ones(3)

    read, shown = grey(reading.indentation[0]), matplotlib.colormaps["magma"](np.clip(error / 0.2, 0, 1))
    return [
        ("tactile image", image),
        (f"true indentation, {1e3 * deepest:.2f} mm", grey(indentation).astype(np.uint8)),
        ("read; orange: contact", np.where(reading.contact[0][..., None], read * CONTACT_COLOR, read).astype(np.uint8)),
        (f"error, mean {error.mean():.3f} mm", np.round(255 * shown[..., :3]).astype(np.uint8)),
    ]


def draw_charts(shown: Shown, path: Path) -> None:
    """Draw true and predicted points of the grasp's touches, with their charts."""
    rows, sensors = shown.rows, shown.source.sensors()
    model = load_touch_model(shown.source.directory.verified_folder("models/unet"), "cpu")
    panels: Panels = []
    for finger in np.flatnonzero(rows["grasps"]["touch_success"][shown.grasp]).tolist():
        pose, depth = rows["grasps"]["sensor_pose"][shown.grasp, finger], rows["touch"]["depth"][shown.grasp, finger]
        points, count = local_points(depth, pose, sensors[finger])
        cloud = model.clouds(rows["touch"]["tactile_image"][shown.grasp, finger][None])[0]
        panels.append((shown.source.hand().sensors[finger].name, _local_points(rows, points[:count], cloud, shown.grasp, finger)))
    draw_row(panels, path, projection="3d")


def _local_points(*drawn: Any) -> Callable[[Any], None]:
    return lambda axes: draw_local_points(axes, *drawn)


def draw_deformation(shown: Shown, path: Path) -> None:
    """Draw the vision charts after each pass, then with the touch charts."""
    network, observation = shown.networks["gcn"]
    made = []
    config = network.network.config
    for passes in range(config.passes + 1):
        network.network.config = config.model_copy(update={"passes": passes})  # the same weights in each pass
        made.append(network.reconstruct([observation])[0])
    panels: Panels = [("what is seen", observation.image)] if observation.image is not None else []
    for passes, one in enumerate(made):
        title = f"after pass {passes}" if passes else "sphere of charts"
        panels.append((title, shown.pictured(colored_charts(network.network.charts, one.vertices[: one.vision]))))
    grey = int((made[-1].faces < made[-1].vision).all(axis=1).sum())
    panels.append(("with touch charts", shown.pictured(two_coloured(made[-1].vertices, made[-1].faces, grey))))
    draw_row([*panels, ("object", shown.pictured(shown.mesh()))], path)


def draw_implicit(shown: Shown, path: Path) -> None:
    """Draw the predicted closed mesh, and a cut through it and the object."""
    network, observation = shown.networks["implicit"]
    made = network.reconstruct([observation])[0]
    predicted = two_coloured(made.vertices, made.faces, len(made.faces))

    def cut(axes: Any) -> None:
        plane = cutting_plane(shown.rows["surfaces"]["points"])
        outline(axes, shown.mesh(), *plane, "black")
        outline(axes, predicted, *plane, "C1")
        frame_cut(axes)

    panels: Panels = [("what is seen", observation.image)] if observation.image is not None else []
    pictures = [("predicted mesh", shown.pictured(predicted)), ("object", shown.pictured(shown.mesh()))]
    draw_row([*panels, *pictures, ("cut: true black", cut)], path)


def draw_reconstructions(shown: Shown, path: Path) -> None:
    """Reconstructions of some test objects by each network."""
    evaluation = shown.source.evaluation
    assert evaluation is not None
    draw_gallery(shown.source.directory, evaluation, path, spread_evenly(evaluation.object_ids, OBJECTS), evaluation.configurations)
