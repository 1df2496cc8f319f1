"""Move a robot's observation to the world of a network's training, and its photograph to the training's camera."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skimage.transform import resize

from pipeline.kernels.charts.visible_charts import WIDTH, visible_charts
from pipeline.kernels.geometry.transforms import compose, invert_similarity, transform_points, unit_vectors
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.vision.camera import project_points
from pipeline.kernels.vision.view_transfer import background_color, border, moved_projection, optical_centre, split_projection
from pipeline.models.foreign_data import learned_view, size_remarks
from pipeline.reconstruct.object_location import INVERTED_MASK, ObjectBox, Target, mask_span, network_axes
from pipeline.reconstruct.observation_checks import CheckedObservation
from pipeline.reconstruct.observation_file import ObservedCamera, RobotObservation, View

FEW_PATCHES = 4  # of the visible surface, for a warning

FACING_AWAY = -0.5
"""Cosine between a sensor's normal and the direction to the object's centre below which it faces away: the centre of a thin object may be
beside a finger."""

MASK_SPAN = 0.2, 1.25  # limits of the mask's diagonal in the photograph, over that of the object's at its distance


@dataclass(frozen=True)
class Placement:
    """An observation in the form that a network is given."""

    checked: CheckedObservation
    to_network: NDArray[np.float64]  # (4, 4) motion and scale from the observation's frame, m, to the network's world
    # (rows, cols, 3): the photograph as the network's camera would have taken it from the same position; None for networks without images
    image: NDArray[np.uint8] | None
    camera: NDArray[np.float64] | None  # (3, 4) projection matrix of that
    factor: float  # of that scale
    sensor_poses: NDArray[np.float64]  # (T, 4, 4) in the network's world, m, scaled as the object is
    visible_charts: NDArray[np.float32]  # (C, side², 3) network's world, m: the visible surface, where it is given as touched
    remarks: list[str]  # what was assumed, and what differs from the training

    def returned(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform points (V, 3) of the network's world, m, to the observation's frame and unit."""
        return transform_points(invert_similarity(self.to_network), points) / self.checked.observation.metres_per_unit


def place_observation(checked: CheckedObservation) -> Placement:
    """Move an observation to where its network expects it.

    The object's centre is moved to the network's, the observation's up to +z. About +z, the observation is turned until its camera has the
    azimuth of the training's; without a camera it keeps its own axes. It is scaled, with its camera and its touches, to the size at which
    networks see all objects.
    """
    observation, box, target, inputs, view = checked.observation, checked.box, checked.target, checked.inputs, checked.observation.view
    assert target is not None
    centre, to_network = np.array(inputs.centre), np.eye(4)
    factor = box.factor(target)
    to_network[:3, :3] = factor * network_axes(observation, target, box.centre)
    to_network[:3, 3] = centre - to_network[:3, :3] @ box.centre
    sensors = [observation.sensor_of(n) for n, is_shown in enumerate(observation.shown_touches) if is_shown and inputs.touch]
    image, camera, remarks = None, None, list(_size_remarks(box, target, sensors))
    if view is not None and inputs.image is not None:
        real = moved_projection(view.matrix, to_network)
        fill, photograph = _background(view.camera, target, hand_is_shown=inputs.image == "occluded")
        learned = learned_view(target, photograph, real, fill, factor)
        image, camera = learned.image, learned.camera
        remarks += learned.remarks
        remarks += _mask_remarks(view, box, target, checked)
    charts: NDArray[np.float32] = np.zeros((0, inputs.side**2, 3), np.float32)
    if view is not None and view.camera.metres is not None and view.camera.depth_as_touch and inputs.touch:
        intrinsic, rotation = split_projection(view.matrix)
        seen = visible_charts(view.camera.metres, view.camera.object_pixels, intrinsic, inputs.side, factor) @ rotation
        charts = transform_points(to_network, seen + optical_centre(view.matrix)).astype(np.float32)
    remarks += _touch_remarks(checked, target, len(charts), factor)
    return Placement(checked, to_network, image, camera, factor, compose(to_network, observation.sensor_poses), charts, remarks)


def network_tactile_images(
    observation: RobotObservation,
    numbers: Sequence[int],  # of T touches with photographs by such a sensor
    sensor: Sensor,  # of the network
    untouched: NDArray[np.uint8],  # (rows, cols, 3), its image without contact
) -> NDArray[np.uint8]:  # (T, rows, cols, 3)
    """Resample an observation's tactile images to the pixels of a network's sensor.

    Where a touch has an untouched image, its difference to the network's is subtracted.
    """
    images = []
    for number in numbers:
        photograph, own = observation.touches[number].tactile_image, observation.untouched_of(number)
        assert photograph is not None
        image = _resampled(photograph, sensor)
        if own is not None:
            image = np.clip(image.astype(np.int16) - _resampled(own, sensor) + untouched, 0, 255).astype(np.uint8)
        images.append(image)
    return np.stack(images)


def _resampled(image: NDArray[np.uint8], sensor: Sensor) -> NDArray[np.uint8]:
    if image.shape[:2] == sensor.shape:
        return image
    resized = resize(image, sensor.shape, order=1, preserve_range=True, anti_aliasing=image.shape[0] > sensor.rows)
    return np.asarray(np.rint(resized), np.uint8)


def _background(camera: ObservedCamera, target: Target, *, hand_is_shown: bool) -> tuple[tuple[int, int, int], NDArray[np.uint8]]:
    """Choose the colour of what the photograph does not show, and paint the pixels outside its mask."""
    if target.background is None:
        return background_color(camera.image), camera.image
    if camera.mask is None:
        return target.background, camera.image
    mask = camera.mask
    if camera.hand_mask is not None:
        mask = mask | camera.hand_mask if hand_is_shown else mask & ~camera.hand_mask
    return target.background, np.where(mask[..., None], camera.image, np.array(target.background, np.uint8))


def describe_object(observation: RobotObservation, box: ObjectBox) -> str:
    """State where the object is, in the observation's frame and unit, and how large."""
    unit = observation.metres_per_unit
    centre = ", ".join(f"{value:.4g}" for value in box.centre / unit)
    size = "size not known" if box.diagonal is None else f"diagonal {box.diagonal / unit:.3g} {observation.unit}"
    return f"object at [{centre}] {observation.unit} ({box.source}), {size}{', by its mask' * box.by_mask}"


def _size_remarks(box: ObjectBox, target: Target, sensors: Sequence[Sensor]) -> Iterator[str]:
    if box.diagonal is None:
        yield f"the object's size is not known, and taken to be {2 * target.network.radius / box.factor(target):.3g} m, as in training"
        return
    if box.by_mask:
        size = f"the object's diagonal is taken to be {box.diagonal:.2g} m, by its mask"
        yield f"{size}; it may be twice that in a hand, and what follows goes by it: state object.diagonal"
    yield from size_remarks(target, [box.diagonal], sensors, target.sensor)


def _mask_remarks(view: View, box: ObjectBox, target: Target, checked: CheckedObservation) -> Iterator[str]:
    camera, stated = view.camera, checked.observation.object.diagonal is not None
    for name, mask in (("mask", camera.mask), ("hand_mask", camera.hand_mask)):
        if mask is not None and border(mask).mean() > INVERTED_MASK:
            yield f"warning: camera.{name} holds most of the photograph's border: is it inverted?"
    if not camera.object_pixels.any():
        yield "warning: camera.hand_mask covers all of the object: is it inverted?"
    if camera.mask is None:
        yield f"warning: no camera.mask: the {camera.object_pixels.mean():.0%} of the photograph that differ from its border are the object"
        return
    if target.background is None:
        yield "the model does not state its images' background: what is outside the mask stays"
    row, col = np.nonzero(camera.mask)
    pixel = project_points(view.matrix, box.centre)
    low, high = np.array([col.min(), row.min()]), np.array([col.max(), row.max()])
    if not ((pixel >= low) & (pixel <= high + 1)).all():
        yield (
            f"warning: the object's centre is seen at column {pixel[0]:.0f}, row {pixel[1]:.0f}, but the mask spans columns {low[0]} to "
            f"{high[0]} and rows {low[1]} to {high[1]}: check camera.pose, intrinsics and object.centre"
        )
    distance, span = float(view.matrix[2] @ np.append(box.centre, 1.0)), mask_span(view, box.centre)
    if stated and span and box.diagonal is not None and not MASK_SPAN[0] <= span / box.diagonal <= MASK_SPAN[1]:
        yield (
            f"warning: the mask's diagonal is {span:.3g} m at the object's distance, {distance:.3g} m, but object.diagonal is "
            f"{box.diagonal:.3g} m: check it, unit, camera.pose and camera.mask"
        )
    if checked.inputs.image == "occluded" and camera.hand_mask is None:
        yield "warning: the network saw the hand in its images: give camera.hand_mask too, else background takes the hand's place"


def _touch_remarks(
    checked: CheckedObservation,
    target: Target,
    count: int,  # of patches of the visible surface
    factor: float,  # of the object's scale
) -> Iterator[str]:
    observation, inputs, sensor, camera = checked.observation, checked.inputs, target.sensor, checked.observation.camera
    if inputs.touch and observation.touches:
        charted = [n for n, touch in enumerate(observation.touches) if sensor and target.is_charted(touch, observation.sensor_of(n))]
        charted_images = [image for n in charted if (image := observation.touches[n].tactile_image) is not None]
        if sensor and charted_images and charted_images[0].shape[:2] != sensor.shape:
            rows, cols = charted_images[0].shape[:2]
            yield f"tactile images resampled from {cols} x {rows} to {sensor.cols} x {sensor.rows} pixels"
        photographed = [n for n, touch in enumerate(observation.touches) if touch.tactile_image is not None]
        if names := {observation.sensor_of(n).name for n in photographed if observation.untouched_of(n) is None}:
            yield f"untouched image: that of the model's sensor, {', '.join(sorted(names))}"
        read = {observation.sensor_of(n).name for n in photographed if n not in charted}
        if read:
            yield f"photographs by {', '.join(sorted(read))} are read by the pretrained network for such a sensor"
        towards = (unit_vectors(checked.box.centre - observation.gel_centres) * unit_vectors(observation.gel_normals)).sum(axis=1)
        touching = [(number, touch.touched is not False) for number, touch in enumerate(observation.touches)]
        if turned := [observation.name_of(number) for number, touches in touching if touches and towards[number] < FACING_AWAY]:
            yield f"warning: {', '.join(turned)} face away from the object's centre: +z, and normals, must point out of the gel"
    if camera is not None and camera.metres is not None:
        if camera.depth_as_touch and inputs.touch:
            causes = f"small beside a patch ({1e3 * WIDTH / factor:.2g} mm), rough, seen at a flat angle, or not measured"
            few = "" if count >= FEW_PATCHES else f"; most of it is {causes}"
            yield f"{'warning: ' if few else ''}{count} patches of the visible surface are given as touched{few}"
        elif camera.mask is None:
            yield "warning: camera.depth is not used without camera.mask: it neither locates the object nor is checked"
        elif target.network.touch:  # whether or not touches are given: depth may be, as touch
            yield "the depth image is not given to the network; camera.depth_as_touch: true would give it"
    if camera is not None and inputs.image is None:
        yield f"model {target.configuration} takes no image: the photograph only colours a closed mesh"
    if observation.touches and not inputs.touch:
        yield f"model {target.configuration} takes no touch: the touches are not used"
