"""Check a sensor file: its figures, and a picture of the gel in section, its pixels, its lamps and tactile images."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from pipeline.drawing.plots import save_figure
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.calibrated_shading import fitted_range, slope_degrees
from pipeline.kernels.touch.depth_maps import gel_surface, normal_force, press_gel
from pipeline.kernels.touch.sensor import MM, Sensor, pixel_centres
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image

PRESS = 0.25
"""Depth to which ball and edge are pressed in, as a share of the gel's height in its middle."""


def check_sensor(path: Path, picture: Path) -> list[str]:
    """Describe a sensor file, and draw it; parameters, result and errors as `check_file`."""
    sensor = load_sensor(path)
    untouched = untouched_image(sensor)
    x, y = pixel_centres(sensor)
    draw(sensor, picture)
    clipped = 100 * float(np.mean((untouched == 0) | (untouched == 255)))
    return [
        f"{path}: sensor {sensor.name}, no faults",
        f"gel {MM * sensor.width:.4g} x {MM * sensor.height:.4g} mm, {MM * sensor.w:.4g} mm thick; rays reach {MM * sensor.range:.4g} mm",
        f"{sensor.cols} x {sensor.rows} pixels of {MM * (x[1] - x[0]):.3g} x {MM * (y[1] - y[0]):.3g} mm",
        f"untouched image: mean {', '.join(f'{level:.0f}' for level in untouched.mean(axis=(0, 1)))} of 255, {clipped:.1f} % clipped",
        *gel_lines(sensor),
        *(fitted_range(sensor.calibrated) if sensor.calibrated else []),
        f"picture: {picture}",
    ]


def gel_lines(sensor: Sensor) -> list[str]:
    """Describe an elastic gel, and how hard it is pressed in the picture."""
    if sensor.gel is None:
        return []
    pressure = press_gel(pressed_ball(sensor), sensor).pressure
    assert pressure is not None
    layer = f"{sensor.gel.modulus / 1e6:.3g} MPa, Poisson's ratio {sensor.gel.poisson:g}, {MM * sensor.layer_thickness:.4g} mm"
    felt = f"{normal_force(pressure, sensor):.3g} N, at most {pressure.max() / 1e3:.3g} kPa"
    return [f"elastic gel: {layer}; the ball in the picture, {MM * PRESS * height_in_middle(sensor):.3g} mm deep, presses with {felt}"]


def draw(sensor: Sensor, path: Path) -> None:
    """Draw a sensor: the gel in section with a ball in it, its outline with pixels and lamps, and three tactile images."""
    ball, edge = pressed_ball(sensor), pressed_edge(sensor)
    figure = Figure((15, 3.4), dpi=110, layout="constrained")
    section, plan, *images = figure.subplots(1, 5)
    _section(section, sensor, ball)
    _plan(plan, sensor)
    panels = {"untouched": untouched_image(sensor), "a ball": tactile_image(ball, sensor), "an edge": tactile_image(edge, sensor)}
    for axes, (title, image) in zip(images, panels.items(), strict=True):
        axes.imshow(image, aspect=sensor.pitch[0] / sensor.pitch[1])
        axes.set(title=title, xticks=[], yticks=[])
    save_figure(figure, path)


def height_in_middle(sensor: Sensor) -> float:
    """Return the height of the undeformed gel in its middle, m: w, or that of its height map."""
    return float(np.broadcast_to(gel_surface(sensor), sensor.shape)[sensor.rows // 2, sensor.cols // 2])


def pressed_ball(sensor: Sensor) -> NDArray[np.float64]:  # (rows, cols) m
    """Compute the depth map of a ball of a quarter of the gel's shorter side, pressed into its middle."""
    x, y = np.meshgrid(*pixel_centres(sensor))
    radius = min(sensor.width, sensor.height) / 4
    lowest = height_in_middle(sensor) * (1 - PRESS) + radius - np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0))
    return np.where(x**2 + y**2 < radius**2, lowest, np.inf)


def pressed_edge(sensor: Sensor) -> NDArray[np.float64]:  # (rows, cols) m
    """Compute the depth map of the edge of a box, right-angled and parallel to the gel's rows, pressed into its middle."""
    _, y = np.meshgrid(*pixel_centres(sensor))
    return height_in_middle(sensor) * (1 - PRESS) + np.abs(y)


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
