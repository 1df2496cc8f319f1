"""Animations of touches over time: tactile image, displacement of the gel and where it slips, forces."""

import io
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from pipeline.console import visible
from pipeline.dataset.object_rows import sensors_of
from pipeline.kernels.touch.sensor import MM, Sensor, pixel_centres
from pipeline.store.directory import Collection
from pipeline.store.shard import RowView
from schemas.presses import PRESSED

DRAWN = ("time", "tactile_image", "pressure", "shear", "slip", "force", "torque")  # quantities that an animation shows
ARROWS = 16  # along an image's longer side
LEAST = 0.05  # mm: displacements below are drawn short
INCHES, DPI = 2.4, 80  # a panel's side; pixels per inch
SHADES: dict[str, Any] = {"cmap": "Oranges", "vmin": 0, "vmax": 1.6}
STICKS, SLIPS = 0.35, 1.0  # shades of the contact

Touches = Mapping[str, np.ndarray]  # (steps, …) each, by the names `DRAWN`
Show = Callable[[int], list[Any]]  # changes what was drawn to a step, and returns these artists


class Drawn(NamedTuple):
    """A slide or a lift to draw."""

    title: str
    touches: Mapping[str, Touches]  # by name of the sensor
    sensors: Sequence[Sensor]
    weight: np.ndarray | None = None  # (2, steps) N, of a lift: on the gels, and what these carry


def are_drawable(collection: Collection, kind: str) -> bool:
    """Check that slides or lifts have been made, and hold all that an animation shows."""
    return bool(collection.shards) and all(collection.first.has(f"{kind}_{name}") for name in DRAWN)


def first_sequence(view: RowView, kind: str) -> Drawn:
    """Read the first slide of an object, or the lift of its first grasp."""
    shard, position = view.shard, view.shard.position[view.object_id]

    def read(name: str) -> np.ndarray:
        return np.asarray(shard.read(f"{kind}_{name}", (position, 0)))

    arrays, sensors = {name: read(name) for name in DRAWN}, sensors_of(shard)
    if kind == "slide":
        title = f"{view.object_id}: {PRESSED[int(read('shape'))]}, friction {float(read('friction')):.2f}"
        return Drawn(title, {"": arrays}, sensors)
    turns = read("object_pose")[:, :3, :3] @ read("pose")[..., :3, :3]  # (sensor, steps, 3, 3) sensor frame to world
    carried = -(turns[..., 2, :] * arrays["force"]).sum(axis=(0, 2))
    touches = {str(name): {of: array[s] for of, array in arrays.items()} for s, name in enumerate(shard.read("sensor"))}
    title = f"{view.object_id}, first grasp" + ("" if read("held")[-1] else ": it slips out")
    return Drawn(title, touches, sensors, np.stack([read("weight"), carried]))


def animate(sequences: Sequence[Drawn]) -> bytes:
    """Draw sequences of as many steps as a WebP, one below the other, in the time of the first."""
    count = len(sequences[0].sensors)
    names = [[f"{what} {s}" for s in range(count)] for what in ("image", "field")]
    rows = [[*names[0], *names[1], "forces"]] if count == 1 else [[*row, "forces"] for row in names]
    widths = [*(len(rows[0]) - 1) * [1.0], 1.5]
    figure = Figure((INCHES * sum(widths), INCHES * len(rows) * len(sequences)), dpi=DPI, layout="constrained")
    canvas: Any = FigureCanvasAgg(figure)
    shows = []
    for part, drawn in zip(figure.subfigures(len(sequences), 1, squeeze=False)[:, 0], sequences, strict=True):
        shows += _panels(part.subplot_mosaic(rows, width_ratios=widths), drawn)
    moving = [artist for show in shows for artist in show(0)]
    for artist in moving:
        artist.set_animated(True)  # `draw` leaves it out
    canvas.draw()
    still, frames = canvas.copy_from_bbox(figure.bbox), []
    time = next(iter(sequences[0].touches.values()))["time"]
    for step in range(len(time)):
        canvas.restore_region(still)
        for artist in (artist for show in shows for artist in show(step)):
            artist.axes.draw_artist(artist)
        frames.append(Image.fromarray(np.array(canvas.buffer_rgba())[..., :3]))
    buffer, pause = io.BytesIO(), round(1e3 * float(time[-1]) / max(len(time) - 1, 1))
    frames[0].save(buffer, "WEBP", save_all=True, append_images=frames[1:], duration=max(pause, 20), loop=0, quality=80, method=4)
    return buffer.getvalue()


def _panels(axes: Mapping[str, Axes], drawn: Drawn) -> list[Show]:
    """Draw a sequence's first step: image and field of each sensor, and forces."""
    shows, forces, lines = [], axes["forces"], {}
    for s, (sensor, (name, touches)) in enumerate(zip(drawn.sensors, drawn.touches.items(), strict=True)):
        shows += [_image(axes[f"image {s}"], touches["tactile_image"], name), draw_field(axes[f"field {s}"], touches, sensor)]
        lines[f"{name}, normal, N"] = -touches["force"][:, 2]
    forces.set_title(visible(drawn.title), fontsize=8, loc="left", parse_math=False)
    if drawn.weight is None:
        return [*shows, draw_forces(forces, touches)]
    lines |= {"gels carry, N": drawn.weight[1], "weight, N": drawn.weight[0]}
    return [*shows, _curves(forces, touches["time"], lines, dashed="weight, N")]


def _image(axes: Axes, images: np.ndarray, title: str) -> Show:
    picture = axes.imshow(images[0])
    axes.set_title(visible(title), fontsize=8, loc="left", parse_math=False)
    axes.set_axis_off()

    def show(step: int) -> list[Any]:
        picture.set_data(images[step])
        return [picture]

    return show


def draw_field(axes: Axes, touches: Touches, sensor: Sensor) -> Show:
    """Draw where the contact sticks and slips in the first step, and how the gel's surface is displaced.

    What the gel moves by at most in all steps would be an arrow as long as a step and a half from arrow to arrow.
    """
    x, y = (MM * centres for centres in pixel_centres(sensor))
    stride = max(1, max(sensor.shape) // ARROWS)
    part = slice(stride // 2, None, stride)
    moved = MM * touches["shear"][:, part, part]
    farthest = MM * float(np.hypot(*np.moveaxis(touches["shear"], -1, 0)).max())
    scale = max(farthest, LEAST) / (1.5 * stride * MM * sensor.pitch[1])
    right, top = MM * sensor.width / 2, MM * sensor.height / 2
    shown = axes.imshow(_contact(touches, 0), extent=(-right, right, top, -top), **SHADES)
    arrows = axes.quiver(x[part], y[part], *np.moveaxis(moved[0], -1, 0), angles="xy", scale_units="xy", scale=scale, width=0.006)
    axes.set_title(f"gel moved up to {farthest:.2g} mm", fontsize=8, loc="left")
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
    force = touches["force"]
    lines = {"normal, N": -force[:, 2], "along x, N": force[:, 0], "along y, N": force[:, 1], "torque, mN·m": 1e3 * touches["torque"]}
    return _curves(axes, touches["time"], lines, dashed="torque, mN·m")


def _curves(axes: Axes, time: np.ndarray, lines: Mapping[str, np.ndarray], *, dashed: str) -> Show:
    for label, values in lines.items():
        axes.plot(time, values, "--" if label == dashed else "-", label=visible(label), lw=1.2)
    for text in axes.legend(fontsize=6, loc="best", framealpha=0.6).get_texts():
        text.set_parse_math(False)
    axes.tick_params(labelsize=6)
    axes.set_xlim(time[0], time[-1])
    axes.set_xlabel("time, s", fontsize=7)
    now = axes.axvline(time[0], color="0.5", lw=1)

    def show(step: int) -> list[Any]:
        now.set_xdata([time[step], time[step]])
        return [now]

    return show
