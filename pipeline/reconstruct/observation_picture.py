"""Describe and draw an observation: the poses of its object, camera and sensors, and the inputs of a network."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from pipeline.drawing.plots import save_figure
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.vision.camera import project_points
from pipeline.kernels.vision.view_transfer import camera_direction, moved_projection, optical_centre, split_projection
from pipeline.reconstruct.object_location import ObjectBox, Target, gel_centres, turn_to_z
from pipeline.reconstruct.observation_checks import check
from pipeline.reconstruct.observation_file import RobotObservation
from pipeline.reconstruct.observation_placement import degrees, describe_object, facing_away, place_observation

SQUARE = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]) / 2
"""The outline of a gel, in units of its sides."""


def draw_observation(path: Path, picture: Path, target: Target | None = None) -> list[str]:
    """Check an observation file, and draw it; return lines that describe it and, with a network, the inputs that this gets."""
    checked = check(path, target)
    observation, box = checked.observation, checked.box
    panels: list[Callable[[Axes, RobotObservation, ObjectBox], None]] = [] if observation.camera is None else [_draw_photograph]
    panels += [partial(_draw_from, right=0, up=1), partial(_draw_from, right=0, up=2)]
    lines, network_image = [f"{path}: observation, no faults", *_described(observation, box)], None
    if target is not None:
        placed = place_observation(checked)
        network_image = placed.image
        lines += [f"with model {target.configuration}:{'' if placed.remarks else ' no remark'}", *placed.remarks]
    count = len(panels) + (network_image is not None)
    figure = Figure((5 * count, 5), layout="constrained")
    drawn = figure.subplots(1, count).tolist()
    for axes, draw in zip(drawn, panels, strict=False):
        draw(axes, observation, box)
    if target is not None and network_image is not None:
        drawn[-1].imshow(network_image)
        drawn[-1].set(title=f"as {target.configuration} is given it", xticks=[], yticks=[])
    save_figure(figure, picture)
    return [*lines, f"picture: {picture}"]


def _described(observation: RobotObservation, box: ObjectBox) -> Iterator[str]:
    yield describe_object(observation, box)
    if observation.camera is not None and observation.projection is not None:
        upright = np.eye(4)
        upright[:3, :3] = turn_to_z(np.array(observation.up))
        upright[:3, 3] = -upright[:3, :3] @ box.centre
        view = camera_direction(moved_projection(observation.projection, upright), np.zeros(3))
        rows, cols = observation.camera.image.shape[:2]
        yield (
            f"camera: {cols} x {rows} pixels, {view.distance:.3g} m from the object, {degrees(view.elevation)}° above its horizon; "
            f"{observation.camera.object_pixels.mean():.1%} of the photograph is the object"
        )
    distances = np.linalg.norm(gel_centres(observation) - box.centre, axis=1)
    for number, (touch, is_away) in enumerate(zip(observation.touches, facing_away(observation, box), strict=True)):
        touched = {True: "touches", False: "does not touch", "auto": "touches if its image shows so"}[touch.touched]
        facing = "; warning: it faces away from there, +z must point out of the gel" if is_away else ""
        yield f"{observation.name_of(number)}: {touched}, {1e3 * distances[number]:.3g} mm from the object's centre{facing}"


def _draw_photograph(axes: Axes, observation: RobotObservation, box: ObjectBox) -> None:
    """Draw the photograph with its mask, the object's centre and the gels' outlines where they should appear."""
    assert observation.camera is not None
    assert observation.projection is not None
    axes.imshow(observation.camera.image)
    if min(observation.camera.object_pixels.shape) > 1:
        axes.contour(observation.camera.object_pixels, levels=[0.5], colors="C3", linewidths=1)
    axes.plot(*project_points(observation.projection, box.centre), "+", color="C3", markersize=14)
    for outline in _outlines(observation):
        axes.plot(*project_points(observation.projection, outline).T, color="C0")
    rows, cols = observation.camera.image.shape[:2]
    axes.set(title="mask, centre and gels in the photograph", xlim=(0, cols), ylim=(rows, 0), xticks=[], yticks=[])


def _outlines(observation: RobotObservation) -> np.ndarray:
    """Compute the outlines of the gels' fronts, (T, 5, 3) m."""
    if observation.sensor is None:
        return np.zeros((0, 5, 3))
    sensor = observation.sensor
    return transform_points(observation.sensor_poses, np.insert(SQUARE * [sensor.width, sensor.height], 2, sensor.w, axis=1))


def _draw_from(axes: Axes, observation: RobotObservation, box: ObjectBox, *, right: int, up: int) -> None:
    """Draw the scene along an axis of the file's frame; `right` and `up` are the numbers of the other axes."""
    unit = observation.metres_per_unit
    column, row = box.centre[[right, up]] / unit
    axes.add_patch(Circle((column, row), (box.diagonal or 0) / 2 / unit, fill=False, linestyle="--"))
    axes.plot(column, row, "+", color="C3", markersize=12, label="object")
    for number, outline in enumerate(_outlines(observation) / unit):
        axes.plot(*outline[:, [right, up]].T, color="C0", label=None if number else "gels")
    if observation.projection is not None:
        eye, ahead = optical_centre(observation.projection), split_projection(observation.projection)[1][2]
        tip = (eye + 0.3 * np.linalg.norm(eye - box.centre) * ahead) / unit
        eye = eye / unit
        axes.annotate("", xy=(tip[right], tip[up]), xytext=(eye[right], eye[up]), arrowprops={"arrowstyle": "->"})
        axes.plot(eye[right], eye[up], "o", color="black", label="camera")
    x, y, along = ("xyz"[axis] for axis in (right, up, 3 - right - up))
    axes.set(xlabel=f"{x}, {observation.unit}", ylabel=f"{y}, {observation.unit}", aspect="equal", title=f"seen along {along}")
    axes.legend(fontsize=8)
