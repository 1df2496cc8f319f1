"""Objects, gels and cameras that a network has not learned from: one rule for robots' observations and for datasets.

Objects are scaled to the size that the network knows, images turned and zoomed to its camera, gels become points; what differs is said.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.transforms import invert_similarity
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.vision.view_transfer import (
    background_color,
    camera_direction,
    carried_camera,
    foreground,
    moved_projection,
    transfer_view,
)
from pipeline.models.observation import Observation
from pipeline.models.reconstruction import Trained
from pipeline.models.shipped_weights import is_like

FAR_VIEW, MIN_SHOWN = 10.0, 0.9
"""Limits for warnings: degrees between views, and share of the training camera's image that an image shows."""
SIZE_TOLERANCE = 0.02  # relative difference of sensors, and of the sides of tactile images, that is taken for rounding


def same_gel(one: Sensor, other: Sensor) -> bool:
    """Check whether two sensors have gels of one size: touch charts of one are then like those of the other."""
    ours, theirs = ((sensor.width, sensor.height, sensor.w) for sensor in (one, other))
    return bool(np.allclose(ours, theirs, rtol=SIZE_TOLERANCE, atol=0))


def size_remarks(
    trained: Trained,
    diagonals: Sequence[float],  # m, of the objects
    sensors: Sequence[Sensor] = (),  # whose touches are given
    learned: Sensor | None = None,  # the sensor of the network's touch charts
) -> Iterator[str]:
    """Warn of objects of other sizes than those learned, and of gels that are wider or narrower beside the object."""
    sizes = trained.sizes
    if not all(is_like(diagonal, sizes) for diagonal in diagonals):
        subject = "the object's diagonal is" if len(diagonals) == 1 else "the objects' diagonals are"
        text = f"{subject} {range_text(diagonals)} m, the network has learned from objects of {range_text(sizes)} m"
        yield f"warning: {text}: hand and touches have another size beside this one"
    gels = trained.gels
    if gels is None and learned is not None and trained.network.takes_charts:
        gels = learned.width / sizes[1], learned.width / sizes[0]
    widths = [sensor.width for sensor in sensors]
    shares = [min(widths, default=0) / max(diagonals), max(widths, default=0) / min(diagonals)]
    if sensors and gels and not all(is_like(share, gels) for share in shares):
        names = ", ".join(dict.fromkeys(sensor.name for sensor in sensors))
        yield (
            f"warning: gels of {names} are {range_text(100 * np.array(shares), '.2g')} % of the object's diagonal wide, "
            f"the network has learned from {range_text(100 * np.array(gels), '.2g')} %: touches help less than measured"
        )


def range_text(values: Sequence[float] | NDArray[np.float64], form: str = ".3g") -> str:
    """Describe values by the least and the greatest."""
    return " to ".join(dict.fromkeys(format(float(value), form) for value in (min(values), max(values))))


@dataclass(frozen=True)
class LearnedView:
    """An image as a network's camera would have taken it from the same position."""

    image: NDArray[np.uint8]  # (rows, cols, 3)
    camera: NDArray[np.float64]  # (3, 4) projection matrix
    remarks: tuple[str, ...]


def learned_view(
    trained: Trained,  # of a network with images
    image: NDArray[np.uint8],  # (rows, cols, 3)
    camera: NDArray[np.float64],  # (3, 4) projection matrix, in the network's world
    fill: tuple[int, int, int],  # sRGB of what the image does not show
    scale: float,  # of the object
) -> LearnedView:
    """Turn and zoom an image about its lens to how the training's camera would show the object."""
    assert trained.projection is not None
    assert trained.resolution is not None
    centre = np.array(trained.network.centre)
    carried = carried_camera(trained.projection, camera, centre)
    view, training_above = camera_direction(camera, centre), trained.learned_direction(camera)[1]
    above = np.degrees(view.elevation)
    difference = abs(above - training_above)
    learned = f"{training_above:z.1f}°" if trained.drawn is None else "{:g}° to {:g}°".format(*trained.drawn.elevation)
    remarks = [
        f"{'warning: ' if difference > FAR_VIEW else ''}camera {view.distance / scale:.3g} m from the object and {above:z.1f}° above "
        f"its horizon; in training {learned}: the views differ by {difference:.1f}°"
    ]
    transferred, share = transfer_view(image, camera, carried, trained.resolution, fill)
    if share < MIN_SHOWN:
        remarks.append(f"warning: the photograph shows {share:.0%} of what the training camera would; the rest is background")
    return LearnedView(transferred, carried, tuple(remarks))


def as_learned(trained: Trained, seen: Observation) -> tuple[Observation, tuple[str, ...]]:
    """Give an observation of a dataset to a network of another one: as it is, if the image is from the training's view.

    Else it is turned about the vertical until the camera has the azimuth of the training's, and its image is transferred.
    """
    centre = np.array(trained.network.centre)
    if seen.image is None or seen.camera is None or trained.projection is None:
        return seen, ()
    camera = seen.scaled(centre).camera
    assert camera is not None
    if seen.image.shape[:2] == trained.resolution and trained.has_view(camera):
        return seen, ()
    turn = np.radians(trained.learned_direction(camera)[0]) - camera_direction(camera, centre).azimuth
    turned = replace(seen, turn=float(turn))
    image, fill = seen.image, trained.background or background_color(seen.image)
    if trained.background is not None:
        image = np.where(foreground(image)[..., None], image, np.array(fill, np.uint8))
    placed = turned.scaled(centre).camera
    assert placed is not None
    view = learned_view(trained, image, placed, fill, seen.scale)
    to_own = invert_similarity(turned.placement(centre))
    return replace(turned, image=view.image, camera=moved_projection(view.camera, to_own)), view.remarks
