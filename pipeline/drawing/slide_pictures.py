"""Animations of touches over time: tactile image, displacement of the gel and where it slips, forces."""

import io
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from pipeline.console import visible
from pipeline.kernels.touch.sensor import MM, Sensor, pixel_centres
from pipeline.store.shard import RowView, Shard
from schemas.presses import PRESSED

DRAWN = ("time", "tactile_image", "pressure", "shear", "slip", "force", "torque")  # quantities that an animation shows
ARROWS = 16  # along an image's longer side
LEAST = 0.05  # mm: displacements below are drawn short
INCHES, DPI = 2.4, 80  # a panel's side; pixels per inch
SHADES: dict[str, Any] = {"cmap": "Oranges", "vmin": 0, "vmax": 1.6}
STICKS, SLIPS = 0.35, 1.0  # shades of the contact

Touches = Mapping[str, np.ndarray]  # (steps, …) each, by the names `DRAWN`
Show = Callable[[int], list[Any]]  # changes what was drawn to a step, and returns these artists


def are_drawable(shard: Shard) -> bool:
    """Check that slides hold all that an animation shows."""
    return all(shard.has(f"slide_{name}") for name in DRAWN)


def first_slide(view: RowView) -> tuple[str, Touches]:
    """Read the first slide of an object, after its title."""
    position = view.shard.position[view.object_id]
    shape, friction = (view.shard.read(f"slide_{name}", (position, 0)) for name in ("shape", "friction"))
    touches = {name: np.asarray(view.shard.read(f"slide_{name}", (position, 0))) for name in DRAWN}
    return f"{view.object_id}: {PRESSED[int(shape)]}, friction {float(friction):.2f}", touches


def animate_slides(slides: Sequence[tuple[str, Touches]], sensor: Sensor) -> bytes:
    """Draw sequences of as many steps, with their titles, as a WebP: a row each, a step after the other as fast as the first's."""
    figure = Figure((3.5 * INCHES, INCHES * len(slides)), dpi=DPI, layout="constrained")
    canvas: Any = FigureCanvasAgg(figure)
    grid = figure.subplots(len(slides), 3, squeeze=False, width_ratios=(1, 1, 1.5))
    shows = [show for row, (title, touches) in zip(grid, slides, strict=True) for show in _row(row, visible(title), touches, sensor)]
    moving = [artist for show in shows for artist in show(0)]
    for artist in moving:
        artist.set_animated(True)  # `draw` leaves it out
    canvas.draw()
    still, time, frames = canvas.copy_from_bbox(figure.bbox), slides[0][1]["time"], []
    for step in range(len(time)):
        canvas.restore_region(still)
        for artist in (artist for show in shows for artist in show(step)):
            artist.axes.draw_artist(artist)
        frames.append(Image.fromarray(np.array(canvas.buffer_rgba())[..., :3]))
    buffer, pause = io.BytesIO(), round(1e3 * float(time[-1]) / max(len(time) - 1, 1))
    frames[0].save(buffer, "WEBP", save_all=True, append_images=frames[1:], duration=max(pause, 20), loop=0, quality=80, method=4)
    return buffer.getvalue()


def _row(axes: Sequence[Axes], title: str, touches: Touches, sensor: Sensor) -> list[Show]:
    """Draw a sequence's first step into three axes."""
    picture = axes[0].imshow(touches["tactile_image"][0])

    def show(step: int) -> list[Any]:
        picture.set_data(touches["tactile_image"][step])
        return [picture]

    axes[0].set_title(title, fontsize=8, loc="left", parse_math=False)
    axes[0].set_axis_off()
    return [show, draw_field(axes[1], touches, sensor), draw_forces(axes[2], touches)]


def draw_field(axes: Axes, touches: Touches, sensor: Sensor) -> Show:
    """Draw where the contact sticks and slips in the first step, and how the gel's surface is displaced.

    The longest arrow of all steps is as long as a step and a half from arrow to arrow.
    """
    x, y = (MM * centres for centres in pixel_centres(sensor))
    stride = max(1, max(sensor.shape) // ARROWS)
    part = slice(stride // 2, None, stride)
    moved = MM * touches["shear"][:, part, part]
    longest = max(float(np.hypot(*np.moveaxis(moved, -1, 0)).max()), LEAST)
    scale = longest / (1.5 * stride * MM * sensor.pitch[1])
    right, top = MM * sensor.width / 2, MM * sensor.height / 2
    shown = axes.imshow(_contact(touches, 0), extent=(-right, right, top, -top), **SHADES)
    arrows = axes.quiver(x[part], y[part], *np.moveaxis(moved[0], -1, 0), angles="xy", scale_units="xy", scale=scale, width=0.006)
    axes.set_title(f"gel moved up to {longest:.2g} mm", fontsize=8, loc="left")
    axes.set(xticks=[], yticks=[])

    def show(step: int) -> list[Any]:
        shown.set_data(_contact(touches, step))
        arrows.set_UVC(*np.moveaxis(moved[step], -1, 0))
        return [shown, arrows]

    return show


def _contact(touches: Touches, step: int) -> np.ndarray:  # (rows, cols) shades
    slips = touches["slip"][step].any(axis=-1)
    return np.where(slips, SLIPS, np.where(touches["pressure"][step] > 0, STICKS, 0.0))


def draw_forces(axes: Axes, touches: Touches) -> Show:
    """Draw forces and torque over time, and a line at the first step."""
    time, force = touches["time"], touches["force"]
    for values, label in ((-force[:, 2], "normal, N"), (force[:, 0], "along x, N"), (force[:, 1], "along y, N")):
        axes.plot(time, values, label=label, lw=1.2)
    axes.plot(time, 1e3 * touches["torque"], "--", label="torque, mN·m", lw=1.2)
    axes.legend(fontsize=6, loc="upper left", framealpha=0.6)
    axes.tick_params(labelsize=6)
    axes.set_xlim(time[0], time[-1])
    axes.set_xlabel("time, s", fontsize=7)
    now = axes.axvline(time[0], color="0.5", lw=1)

    def show(step: int) -> list[Any]:
        now.set_xdata([time[step], time[step]])
        return [now]

    return show
