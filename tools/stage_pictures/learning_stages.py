"""The pictures of the stages that learn, and of the charts."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from pipeline.contrib.report.figures import colored_charts, draw_gallery, draw_local_points
from pipeline.contrib.report.report_source import two_coloured
from pipeline.drawing.colors import depth_colors
from pipeline.drawing.picture_sheet import spread_evenly
from pipeline.kernels.touch.depth_maps import in_gel, local_points
from pipeline.models.touch_model import LocalTouchModel, load_touch_model
from schemas.catalogue import ARTIFACTS
from tools.picture_row import Panel, draw_row
from tools.stage_pictures.data_stages import CONTACT_COLOR
from tools.stage_pictures.subject import Subject, cutting_plane, frame_cut, outline

OBJECTS = 5
"""Reconstructions that are shown."""

Panels = list[tuple[str, Panel]]


def draw_unet(subject: Subject, path: Path) -> None:
    """Draw a touch, and its depth as predicted."""
    model = load_touch_model(subject.source.directory.verified_folder("models/unet"), "cpu")
    depths, sensors = subject.rows["touch"]["depth"][subject.grasp], subject.source.sensors()
    touched = np.flatnonzero(subject.rows["grasps"]["touch_success"][subject.grasp]).tolist()
    finger = max(touched, key=lambda number: float(np.ptp(depths[number][in_gel(depths[number], sensors[number])])))
    tactile_image, depth = subject.rows["touch"]["tactile_image"][subject.grasp, finger], depths[finger]
    sensor, (predicted, mask) = model.sensor, (maps[0] for maps in model.maps(tactile_image[None]))
    difference = np.where(mask & in_gel(depth, sensor), np.abs(predicted - depth), 0)
    error = matplotlib.colormaps["magma"](np.clip(difference / 0.5e-3, 0, 1))[..., :3]
    panels: Panels = [
        ("tactile image", tactile_image),
        ("true depth", depth_colors(depth, sensor)),
        ("predicted, where it touched", depth_colors(np.where(mask, predicted, np.inf), sensor)),
        (f"error, mean {1e3 * difference[difference > 0].mean():.2f} mm", np.round(255 * error).astype(np.uint8)),
    ]
    draw_row(panels, path)


def draw_local_network(subject: Subject, path: Path) -> None:
    """Draw the press with the largest contact that does not reach the rim, and what the local network reads in it."""
    model = load_touch_model(subject.source.directory.verified_folder("models/touch"), "cpu")
    assert isinstance(model, LocalTouchModel)
    row = subject.source.directory.collection(ARTIFACTS["presses"]).view(subject.object_id)
    number = largest_uncut_contact(row["press_contact"])
    draw_row(reading_panels(model, row["press_image"][number], row["press_indentation"][number], row["press_untouched"]), path)


def largest_uncut_contact(contacts: np.ndarray) -> int:
    """Find the largest of some contacts, (N, rows, cols), that the rim of the image does not cut."""
    cut = contacts[:, [0, -1]].any(axis=(1, 2)) | contacts[:, :, [0, -1]].any(axis=(1, 2))
    return int(np.where(cut, 0, contacts.sum(axis=(1, 2))).argmax())


def reading_panels(model: LocalTouchModel, image: np.ndarray, indentation: np.ndarray, untouched: np.ndarray) -> Panels:
    """Make panels of a press: image, true and read indentation, error; bright is deep, orange the contact that is read."""
    reading = model.read(image[None], untouched)
    deepest, error = float(indentation.max()), 1e3 * np.abs(reading.indentation[0] - indentation)

    def grey(depth: np.ndarray) -> np.ndarray:
        return np.clip(60 + 195 * np.maximum(depth, 0) / deepest, 0, 255)[..., None] * np.ones(3)

    read_grey, error_colors = grey(reading.indentation[0]), matplotlib.colormaps["magma"](np.clip(error / 0.2, 0, 1))
    return [
        ("tactile image", image),
        (f"true indentation, {1e3 * deepest:.2f} mm", grey(indentation).astype(np.uint8)),
        ("read; orange: contact", np.where(reading.contact[0][..., None], read_grey * CONTACT_COLOR, read_grey).astype(np.uint8)),
        (f"error, mean {error.mean():.3f} mm", np.round(255 * error_colors[..., :3]).astype(np.uint8)),
    ]


def draw_charts(subject: Subject, path: Path) -> None:
    """Draw true and predicted points of the grasp's touches, with their charts."""
    rows, sensors = subject.rows, subject.source.sensors()
    model = load_touch_model(subject.source.directory.verified_folder("models/unet"), "cpu")
    panels: Panels = []
    for finger in np.flatnonzero(rows["grasps"]["touch_success"][subject.grasp]).tolist():
        pose, depth = rows["grasps"]["sensor_pose"][subject.grasp, finger], rows["touch"]["depth"][subject.grasp, finger]
        points, count = local_points(depth, pose, sensors[finger])
        cloud = model.clouds(rows["touch"]["tactile_image"][subject.grasp, finger][None])[0]
        panels.append((subject.source.hand().sensors[finger].name, _local_points(rows, points[:count], cloud, subject.grasp, finger)))
    draw_row(panels, path, projection="3d")


def _local_points(*drawn: Any) -> Callable[[Any], None]:
    return lambda axes: draw_local_points(axes, *drawn)


def draw_deformation(subject: Subject, path: Path) -> None:
    """Draw the vision charts after each pass, then with the touch charts."""
    network, observation = subject.networks["gcn"]
    reconstructions = []
    config = network.network.config
    for passes in range(config.passes + 1):
        network.network.config = config.model_copy(update={"passes": passes})  # the same weights in each pass
        reconstructions.append(network.reconstruct([observation])[0])
    panels: Panels = [("what is seen", observation.image)] if observation.image is not None else []
    for passes, reconstruction in enumerate(reconstructions):
        title = f"after pass {passes}" if passes else "sphere of charts"
        panels.append((title, subject.picture_of(colored_charts(network.network.charts, reconstruction.vertices[: reconstruction.vision]))))
    grey = int((reconstructions[-1].faces < reconstructions[-1].vision).all(axis=1).sum())
    panels.append(("with touch charts", subject.picture_of(two_coloured(reconstructions[-1].vertices, reconstructions[-1].faces, grey))))
    draw_row([*panels, ("object", subject.picture_of(subject.mesh()))], path)


def draw_implicit(subject: Subject, path: Path) -> None:
    """Draw the predicted closed mesh, and a cut through it and the object."""
    network, observation = subject.networks["implicit"]
    reconstruction = network.reconstruct([observation])[0]
    predicted = two_coloured(reconstruction.vertices, reconstruction.faces, len(reconstruction.faces))

    def cut(axes: Any) -> None:
        plane = cutting_plane(subject.rows["surfaces"]["points"])
        outline(axes, subject.mesh(), *plane, "black")
        outline(axes, predicted, *plane, "C1")
        frame_cut(axes)

    panels: Panels = [("what is seen", observation.image)] if observation.image is not None else []
    pictures = [("predicted mesh", subject.picture_of(predicted)), ("object", subject.picture_of(subject.mesh()))]
    draw_row([*panels, *pictures, ("cut: true black", cut)], path)


def draw_reconstructions(subject: Subject, path: Path) -> None:
    """Draw reconstructions of some test objects by each network."""
    evaluation = subject.source.evaluation
    assert evaluation is not None
    draw_gallery(subject.source, path, spread_evenly(evaluation.object_ids, OBJECTS), evaluation.configurations)
