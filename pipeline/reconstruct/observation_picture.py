"""Describe and draw an observation: the poses of its object, camera and sensors, and the inputs of a network."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from pipeline.drawing.grasp_pictures import gel_squares
from pipeline.drawing.plots import save_figure
from pipeline.kernels.vision.camera import project_points
from pipeline.kernels.vision.view_transfer import optical_centre, split_projection
from pipeline.models.foreign_data import range_text
from pipeline.reconstruct.object_location import ObjectBox, Target
from pipeline.reconstruct.observation_checks import CheckedObservation, check
from pipeline.reconstruct.observation_file import RobotObservation, View
from pipeline.reconstruct.observation_placement import describe_object, place_observation


def draw_observation(path: Path, picture: Path, target: Target) -> list[str]:
    """Check an observation file for a network, and draw it; return lines that describe it and what the network is given."""
    checked = check(path, target)
    observation, box, placed = checked.observation, checked.box, place_observation(checked)
    outlines = np.zeros((0, 5, 3))  # of the gels' fronts, m
    if gels := [n for n, touch in enumerate(observation.touches) if touch.points is None]:
        outlines = gel_squares(observation.sensor_poses[gels], [observation.sensor_of(n) for n in gels])[:, [0, 1, 2, 3, 0]]
    panels: list[Callable[[Axes], object]] = [partial(_draw_from, checked=checked, outlines=outlines, right=0, up=up) for up in (1, 2)]
    if observation.view is not None:
        panels.insert(0, partial(_draw_photograph, view=observation.view, box=box, outlines=outlines))
    if placed.image is not None:
        panels.append(partial(_draw_image, image=placed.image, title=f"as {target.configuration} is given it"))
    figure = Figure((5 * len(panels), 5), layout="constrained")
    for axes, draw in zip(figure.subplots(1, len(panels)), panels, strict=True):
        draw(axes)
    save_figure(figure, picture)
    model = f"model {target.configuration}, trained with objects of {range_text(target.sizes, '.2g')} m"
    remarks = [f"with {model}:{'' if placed.remarks else ' no remark'}", *placed.remarks]
    return [f"{path}: observation, no faults", *_described(observation, box), *remarks, f"picture: {picture}"]


def _described(observation: RobotObservation, box: ObjectBox) -> Iterator[str]:
    yield describe_object(observation, box)
    if observation.camera is not None:
        pixels = observation.camera.object_pixels
        yield f"camera: {pixels.shape[1]} x {pixels.shape[0]} pixels; {pixels.mean():.1%} of the photograph is the object"
    distances = np.linalg.norm(observation.gel_centres - box.centre, axis=1)
    for number, touch in enumerate(observation.touches):
        touched = {True: "touches", False: "does not touch", "auto": "touches if its image, depth or points show so"}[touch.touched]
        yield f"{observation.name_of(number)}: {touched}, {1e3 * distances[number]:.3g} mm from the object's centre"


def _draw_image(axes: Axes, image: np.ndarray, title: str) -> None:
    axes.imshow(image)
    axes.set(title=title, xlim=(0, image.shape[1]), ylim=(image.shape[0], 0), xticks=[], yticks=[])


def _draw_photograph(axes: Axes, view: View, box: ObjectBox, outlines: np.ndarray) -> None:
    """Draw the photograph with its mask, the object's centre and the gels' outlines where they should appear."""
    if min(view.camera.object_pixels.shape) > 1:
        axes.contour(view.camera.object_pixels, levels=[0.5], colors="C3", linewidths=1)
    axes.plot(*project_points(view.matrix, box.centre), "+", color="C3", markersize=14)
    for outline in outlines:
        axes.plot(*project_points(view.matrix, outline).T, color="C0")
    _draw_image(axes, view.camera.image, "mask, centre and gels in the photograph")  # last: it sets the limits


def _draw_from(axes: Axes, checked: CheckedObservation, outlines: np.ndarray, right: int, up: int) -> None:
    """Draw the scene along an axis of the file's frame; `right` and `up` are the numbers of the other axes."""
    observation, box, unit = checked.observation, checked.box, checked.observation.metres_per_unit
    column, row = box.centre[[right, up]] / unit
    axes.add_patch(Circle((column, row), (box.diagonal or 0) / 2 / unit, fill=False, linestyle="--"))
    axes.plot(column, row, "+", color="C3", markersize=12, label="object")
    for number, outline in enumerate(outlines / unit):
        axes.plot(*outline[:, [right, up]].T, color="C0", label=None if number else "gels")
    if observation.view is not None:
        eye, ahead = optical_centre(observation.view.matrix), split_projection(observation.view.matrix)[1][2]
        tip = (eye + 0.3 * np.linalg.norm(eye - box.centre) * ahead) / unit
        eye = eye / unit
        axes.annotate("", xy=(tip[right], tip[up]), xytext=(eye[right], eye[up]), arrowprops={"arrowstyle": "->"})
        axes.plot(eye[right], eye[up], "o", color="black", label="camera")
    x, y, along = ("xyz"[axis] for axis in (right, up, 3 - right - up))
    axes.set(xlabel=f"{x}, {observation.unit}", ylabel=f"{y}, {observation.unit}", aspect="equal", title=f"seen along {along}")
    axes.legend(fontsize=8)
