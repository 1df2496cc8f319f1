"""Checks of description files: what a hand, sensor, scene or manifest file describes, as lines and as a picture."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pipeline.checks.hand_check import check_hand
from pipeline.checks.manifest_check import MeshFiles, check_manifest
from pipeline.checks.sensor_check import check_sensor
from pipeline.drawing.plots import save_figure
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import Kind, description_path, read_yaml, shipped_files, texts_in
from pipeline.formats.file_content import expanded
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.geometry.mesh_cleaning import POSITION
from pipeline.kernels.vision.camera import camera_pose, project_points, projection_matrix
from pipeline.kernels.vision.scene import NamedCamera

ENTRIES: dict[Kind, set[str]] = {
    "sensor": {"w", "rows", "cols"},
    "hand": {"urdf", "palm", "fingers"},
    "scene": {"cameras", "background"},
    "manifest": {"sources", "splits"},
    "observation": {"object", "camera", "touches"},
}
"""Entries that identify the kinds of description files."""
SIZE = 0.5
"""m, diagonal of an object that must be visible in the images."""


def check_file(
    name: str,  # path of a file, or the name of a shipped one
    picture: Path | None,  # PNG to write; by default NAME.png in the current folder
    meshes: MeshFiles | None = None,  # that a manifest is checked with
) -> list[str]:  # lines that describe the file's content; faults begin with "fault:"
    """Check a hand, sensor, scene or manifest file, and draw what it describes; an `InvalidInput` names each entry that cannot be used."""
    path, kind, picture = described_file(name, picture)
    if kind == "manifest":
        return check_manifest(path, picture, meshes or MeshFiles())
    if meshes is not None:
        raise InvalidInput(f"{path} is a {kind} file; only a manifest takes a folder of objects, their unit and up-axis")
    checks = {"sensor": check_sensor, "hand": check_hand, "scene": check_scene}
    return checks[kind](path, picture)


def described_file(name: str, picture: Path | None) -> tuple[Path, str, Path]:
    """Find a description file, its kind, and the picture to draw, which may replace no file that it needs; parameters as `check_file`."""
    path = _path_of(name)
    kind, picture = _kind_of(path), picture or Path(f"{path.stem}.png")
    namesakes = [path.parent / file for file in (path.name, *texts_in(read_yaml(path))) if Path(file).name == picture.name]
    if _place(picture) in map(_place, namesakes):
        raise InvalidInput(f"{picture} is a file that {path} needs, and the picture would replace it; name another one with --picture")
    return path, kind, picture


def _path_of(name: str) -> Path:
    shipped = {file_name: kind for kind in ENTRIES for file_name in shipped_files(kind)}
    path = description_path(shipped[name], name) if name in shipped else expanded(name)
    if not path.exists():
        raise InvalidInput(f"{path} does not exist; shipped files are {', '.join(sorted(shipped))}")
    return path


def _kind_of(path: Path) -> str:
    content: Any = read_yaml(path)
    matches = {kind: len(entries & set(content)) for kind, entries in ENTRIES.items()} if isinstance(content, dict) else {}
    if not any(matches.values()):
        hints = "; ".join(f"a{'n' * (kind == 'observation')} {kind} has {', '.join(sorted(entries))}" for kind, entries in ENTRIES.items())
        raise InvalidInput(f"{path} has no entries of a description file: {hints}")
    return max(matches, key=lambda kind: matches[kind])


def _place(file: Path) -> Path:
    """Resolve the folder of a file, but not a link to the file."""
    return file.parent.resolve() / file.name


def check_scene(path: Path, picture: Path) -> list[str]:
    """Describe a scene file, and draw it; parameters, result and errors as `check_file`."""
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
    lines = [_camera_line(camera) for camera in scene.cameras]
    return [
        f"{path}: scene {scene.name}, {'no faults' if not any(line.startswith('fault:') for line in lines) else 'faults below'}",
        *lines,
        f"picture: {picture}",
    ]


def _camera_line(camera: NamedCamera) -> str:
    rows, columns = camera.shape
    corners = POSITION + SIZE / 2 / np.sqrt(3) * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    pixels = project_points(projection_matrix(camera), np.concatenate([POSITION[None], corners]))
    inside = np.all((pixels >= 0) & (pixels < [columns, rows]), axis=1)  # NaN, behind the camera, is not
    distance = np.linalg.norm(np.subtract(camera.position, POSITION))
    summary = f"{camera.name}: {columns} x {rows} pixels, {distance:.2f} m from the object's middle"
    if not inside[0]:
        return f"fault: {summary}, which it does not see; turn it"
    return summary + ("" if inside.all() else f"; corners of a cube with a diagonal of {SIZE} m leave the image")
