"""The check of a scene file: its cameras, and a plan of where they stand and what they see."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pipeline.formats.description_file import load_scene
from pipeline.kernels.geometry.normalise import POSITION
from pipeline.kernels.vision.camera import Camera, camera_pose, project_points, projection_matrix
from pipeline.reports.picture_row import save_figure

SIZE = 0.5
"""m, diagonal of the objects that are looked for in the images."""


def check(path: Path, picture: Path) -> list[str]:
    """Say what a scene file describes, and draw it; parameters, result and errors as `check_file`."""
    scene = load_scene(path)
    figure = Figure((12, 6), layout="constrained")
    for axes, (right, up) in zip(figure.subplots(1, 2), ((0, 1), (0, 2)), strict=True):
        axes.plot(POSITION[right], POSITION[up], "s", color="black", label="object")
        axes.plot(scene.lamp.position[right], scene.lamp.position[up], "*", color="orange", markersize=14, label="lamp")
        for camera in scene.cameras:
            pose = camera_pose(camera)
            axes.plot(pose[right, 3], pose[up, 3], "o")
            ahead = pose[:3, 3] - pose[:3, 2] * 0.5
            axes.annotate("", xy=ahead[[right, up]], xytext=pose[[right, up], 3], arrowprops={"arrowstyle": "->"})
            axes.annotate(camera.name, pose[[right, up], 3])
        axes.set(xlabel="xyz"[right] + ", m", ylabel="xyz"[up] + ", m", aspect="equal")
        axes.legend()
    save_figure(figure, picture)
    lines = [_camera(camera.name, camera) for camera in scene.cameras]
    return [
        f"{path}: scene {scene.name}, {'no faults' if not any('fault' in line for line in lines) else 'faults below'}",
        *lines,
        f"picture: {picture}",
    ]


def _camera(name: str, camera: Camera) -> str:
    rows, columns = camera.shape
    corners = POSITION + SIZE / 2 / np.sqrt(3) * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    pixels = project_points(projection_matrix(camera), np.concatenate([POSITION[None], corners]))
    inside = np.all((pixels >= 0) & (pixels < [columns, rows]), axis=1)  # NaN, behind the camera, is not
    said = f"{name}: {columns} x {rows} pixels, {np.linalg.norm(np.subtract(camera.position, POSITION)):.2f} m from the object's middle"
    if not inside[0]:
        return f"fault: {said}, which it does not see; turn it"
    return said + ("" if inside.all() else f"; corners of a cube with a diagonal of {SIZE} m leave the image")
