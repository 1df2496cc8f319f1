"""Checks of description files: what a sensor or scene file describes, as lines and as a picture; hands and manifests are beside."""

import shlex
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from pipeline.checks.hand_check import check_hand
from pipeline.checks.manifest_check import MeshFiles, check_manifest
from pipeline.drawing.plots import save_figure
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import Kind, description_path, read_yaml, shipped_files, texts_in
from pipeline.formats.file_content import expanded
from pipeline.formats.scene_file import load_scene
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh_cleaning import POSITION
from pipeline.kernels.touch.calibrated_shading import fitted_range, slope_degrees
from pipeline.kernels.touch.depth_maps import gel_surface, normal_force, press_gel
from pipeline.kernels.touch.markers import MarkerGrid
from pipeline.kernels.touch.sensor import MM, Sensor, pixel_centres
from pipeline.kernels.touch.sliding import resting_image
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from pipeline.kernels.vision.camera import Camera, camera_pose, project_points, projection_matrix

ENTRIES: dict[Kind, set[str]] = {  # entries that identify the kinds of description files
    "sensor": {"w", "rows", "cols"},
    "hand": {"model", "urdf", "palm", "fingers"},
    "scene": {"cameras", "background"},
    "manifest": {"sources", "splits"},
    "observation": {"object", "camera", "touches"},
}
SIZE = 0.5  # m, diagonal of an object that must be visible in the images
PRESS = 0.25  # depth to which ball and edge are pressed in, as a share of the gel's height in its middle


class DescribedFile(NamedTuple):
    """A description file, and where to draw what it describes."""

    path: Path
    kind: Kind
    picture: Path  # PNG


def check_file(
    described: DescribedFile,
    meshes: MeshFiles | None = None,  # that a manifest is checked with
) -> list[str]:  # lines that describe the file's content; faults begin with "fault:"
    """Check a hand, sensor, scene or manifest file, and draw what it describes; an `InvalidInput` names each entry that cannot be used."""
    path, kind, picture = described
    if kind == "manifest":
        return check_manifest(path, picture, meshes or MeshFiles())
    if meshes is not None:
        raise InvalidInput(f"{path} is a {kind} file; only a manifest takes a folder of objects, their unit and up-axis")
    checks = {"sensor": check_sensor, "hand": check_hand, "scene": check_scene}
    return checks[kind](path, picture)


def described_file(
    name: str,  # path of a file, or the name of a shipped one
    picture: Path | None,  # PNG to write, which may replace no file that the description needs; by default NAME.png in the current folder
) -> DescribedFile:
    """Find a description file and its kind."""
    path = _path_of(name)
    content = read_yaml(path)
    kind, picture = _kind_of(path, content), picture or Path(f"{path.stem}.png")
    namesakes = [path.parent / file for file in (path.name, *texts_in(content)) if Path(file).name == picture.name]
    if _place(picture) in map(_place, namesakes):
        raise InvalidInput(f"{picture} is a file that {path} needs, and the picture would replace it; name another one with --picture")
    return DescribedFile(path, kind, picture)


def _path_of(name: str) -> Path:
    shipped = {file_name: kind for kind in ENTRIES for file_name in shipped_files(kind)}
    path = description_path(shipped[name], name) if name in shipped else expanded(name)
    if not path.exists():
        raise InvalidInput(f"{path} does not exist; shipped files are {', '.join(sorted(shipped))}")
    if path.is_dir():
        raise InvalidInput(f"{path} is a folder; to check its meshes, run `vt-pipeline check directory --objects {shlex.quote(name)}`")
    return path


def _kind_of(path: Path, content: Any) -> Kind:
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


def _camera_line(camera: Camera) -> str:
    rows, columns = camera.shape
    corners = POSITION + SIZE / 2 / np.sqrt(3) * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    pixels = project_points(projection_matrix(camera), np.concatenate([POSITION[None], corners]))
    inside = np.all((pixels >= 0) & (pixels < [columns, rows]), axis=1)  # NaN, behind the camera, is not
    distance = np.linalg.norm(np.subtract(camera.position, POSITION))
    summary = f"{camera.name}: {columns} x {rows} pixels, {distance:.2f} m from the object's middle"
    if not inside[0]:
        return f"fault: {summary}, which it does not see; turn it"
    return summary + ("" if inside.all() else f"; corners of a cube with a diagonal of {SIZE} m leave the image")


def check_sensor(path: Path, picture: Path) -> list[str]:
    """Describe a sensor file, and draw it; parameters, result and errors as `check_file`."""
    sensor = load_sensor(path)
    untouched = untouched_image(sensor)
    _draw_sensor(sensor, picture)
    clipped = 100 * float(np.mean((untouched == 0) | (untouched == 255)))
    return [
        f"{path}: sensor {sensor.name}, no faults",
        f"gel {MM * sensor.width:.4g} x {MM * sensor.height:.4g} mm, {MM * sensor.w:.4g} mm thick; rays reach {MM * sensor.range:.4g} mm",
        f"{sensor.cols} x {sensor.rows} pixels of {MM * sensor.pitch[1]:.3g} x {MM * sensor.pitch[0]:.3g} mm",
        f"untouched image: mean {', '.join(f'{level:.0f}' for level in untouched.mean(axis=(0, 1)))} of 255, {clipped:.1f} % clipped",
        *([] if sensor.gel is None else [_gel_line(sensor)]),
        *([] if sensor.markers is None else [_markers_line(sensor, sensor.markers)]),
        *(fitted_range(sensor.calibrated) if sensor.calibrated else []),
        f"picture: {picture}",
    ]


def _gel_line(sensor: Sensor) -> str:
    """Describe an elastic gel, and how hard it is pressed in the picture."""
    pressure = press_gel(_pressed_ball(sensor), sensor).pressure
    assert sensor.gel is not None
    assert pressure is not None
    layer = f"{sensor.gel.modulus / 1e6:.3g} MPa, Poisson's ratio {sensor.gel.poisson:g}, {MM * sensor.layer_thickness:.4g} mm"
    layer += "" if sensor.gel.friction is None else f", friction {sensor.gel.friction:g}"
    felt = f"{normal_force(pressure, sensor):.3g} N, at most {pressure.max() / 1e3:.3g} kPa"
    return f"elastic gel: {layer}; the ball in the picture, {MM * PRESS * _height_in_middle(sensor):.3g} mm deep, presses with {felt}"


def _markers_line(sensor: Sensor, dots: MarkerGrid) -> str:
    """Describe the dots that are printed on a gel."""
    apart = f"{MM * sensor.width / dots.cols:.3g} x {MM * sensor.height / dots.rows:.3g} mm"
    return f"markers: {dots.cols} x {dots.rows} dots {2 * MM * dots.radius:.3g} mm wide, {apart} apart"


def _draw_sensor(sensor: Sensor, path: Path) -> None:
    """Draw a sensor: the gel in section with a ball in it, its outline with pixels and lamps, and three tactile images."""
    ball = _pressed_ball(sensor)
    _, y = np.meshgrid(*pixel_centres(sensor))
    edge = _height_in_middle(sensor) * (1 - PRESS) + np.abs(y)  # of a box, right-angled and parallel to the gel's rows
    figure = Figure((15, 3.4), dpi=110, layout="constrained")
    section, plan, *images = figure.subplots(1, 5)
    _section(section, sensor, ball)
    _plan(plan, sensor)
    panels = {"untouched": resting_image(sensor), "a ball": tactile_image(ball, sensor), "an edge": tactile_image(edge, sensor)}
    for axes, (title, image) in zip(images, panels.items(), strict=True):
        axes.imshow(image, aspect=sensor.pitch[0] / sensor.pitch[1])
        axes.set(title=title, xticks=[], yticks=[])
    save_figure(figure, path)


def _height_in_middle(sensor: Sensor) -> float:
    """Return the height of the undeformed gel in its middle, m: w, or that of its height map."""
    return float(np.broadcast_to(gel_surface(sensor), sensor.shape)[sensor.rows // 2, sensor.cols // 2])


def _pressed_ball(sensor: Sensor) -> NDArray[np.float64]:  # (rows, cols) m
    """Compute the depth map of a ball of a quarter of the gel's shorter side, pressed into its middle."""
    x, y = np.meshgrid(*pixel_centres(sensor))
    radius = min(sensor.width, sensor.height) / 4
    lowest = _height_in_middle(sensor) * (1 - PRESS) + radius - np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0))
    return np.where(x**2 + y**2 < radius**2, lowest, np.inf)


def _section(axes: Axes, sensor: Sensor, depth: NDArray[np.float64]) -> None:
    """Draw the middle row: the gel, undeformed and pressed in, over the sensor plane."""
    x = pixel_centres(sensor)[0] * MM
    row = depth[sensor.rows // 2] * MM
    surface = np.broadcast_to(gel_surface(sensor), sensor.shape)[sensor.rows // 2] * MM
    axes.fill_between(x, surface - MM * press_gel(depth, sensor).indentation[sensor.rows // 2], color="#9ecae1", label="gel")
    axes.plot(x, surface, "k--", linewidth=0.8, label="undeformed")
    axes.plot(x, row, color="#d94801", linewidth=1.2, label="ball")
    axes.set(title="the middle row in section", xlabel="x, mm", ylabel="D, mm", ylim=(0, 1.4 * sensor.w * MM), aspect="equal")
    axes.legend(fontsize=7, loc="upper right")


def _plan(axes: Axes, sensor: Sensor) -> None:
    """Draw the gel from below: about ten rows and columns of pixels, and the lamps or the part that was fitted to photographs."""
    x, y = (centres[:: max(1, len(centres) // 10)] * MM for centres in pixel_centres(sensor))
    axes.plot(*(grid.ravel() for grid in np.meshgrid(x, y)), ".", color="#bbbbbb", markersize=2)
    half, tall = MM * sensor.width / 2, MM * sensor.height / 2
    axes.plot([-half, half, half, -half, -half], [-tall, -tall, tall, tall, -tall], "k", linewidth=1)
    for color in ("red", "green", "blue") if sensor.lights else ():
        lamp = getattr(sensor.lights, color)
        axes.plot((lamp[0] - 0.5) * 2 * half, lamp[1] * 2 * half - tall, "*", color=color, markersize=12)
    if sensor.calibrated and sensor.calibrated.within:
        left, top, right, bottom = (MM * side for side in sensor.calibrated.within)
        axes.add_patch(Rectangle((left, top), right - left, bottom - top, fill=False, color="#d94801", linestyle="--"))
        axes.text(left, top, f" photographed: to {slope_degrees(sensor.calibrated):.0f}°", color="#d94801", fontsize=7, va="top")
    axes.set(title="pixels and lamps, +y downwards", xlabel="x, mm", ylabel="y, mm", aspect="equal")
    axes.invert_yaxis()
