"""Check a robot's observation, once and as a whole: its entries, its geometry, and what its network needs."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.console import pluralise
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import with_entries
from pipeline.kernels.geometry.transforms import invert_pose
from pipeline.kernels.networks.network_configurations import ImageKind, NetworkInputs
from pipeline.kernels.touch.depth_maps import CONTACT_MARGIN, gel_top
from pipeline.kernels.touch.photograph_faults import photograph_faults, untouched_faults
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.vision.view_transfer import optical_centre
from pipeline.models.foreign_data import SIZE_TOLERANCE, same_gel
from pipeline.models.touch_model import SIDES_TOLERANCE, shipped_touch_model
from pipeline.reconstruct.object_location import BY_DEPTH, FEW, ObjectBox, Target, find_object
from pipeline.reconstruct.observation_file import RobotObservation, View, read_observation
from pipeline.reconstruct.observed_touch import ObservedTouch

FARTHEST, NEAREST, SMALLEST = 10.0, 0.01, 1e-3
"""m: largest coordinate of a pose, least distance of a camera from the object's centre, and smallest object."""
POINTS_BEYOND = 1.5  # largest coordinates of touched points, by those of the gel: soft gels bulge, and sensor files are not exact
OF_POINTS = "implicit networks, such as the pretrained ones, take touches of any sensor as points; or train one with this sensor"
UNMEASURED = (
    "camera.depth is 0 or not finite wherever camera.mask shows the object, and camera.hand_mask no robot: register it to the photograph, "
    "and check that no mask is inverted"
)


class Fault(NamedTuple):
    """Why an observation cannot be used."""

    text: str
    without: tuple[str, ...] = ()  # entries whose absence is the reason: where one of them is invalid, that is the fault


@dataclass(frozen=True)
class CheckedObservation:
    """An observation without faults, its object, and the network that it is for."""

    observation: RobotObservation
    box: ObjectBox
    target: Target | None

    @property
    def inputs(self) -> NetworkInputs:
        """Inputs that the network gets."""
        assert self.target is not None
        return used_inputs(self.target.network, self.observation)


def check(source: Path | RobotObservation, target: Target | None = None) -> CheckedObservation:
    """Read an observation file, or take an observation, and check it; an `InvalidInput` lists all faults of all entries."""
    if isinstance(source, RobotObservation):
        observation, invalid_text, invalid, name = source, "", set[str](), "observation"
    else:
        read, invalid_text, invalid = read_observation(source)
        name = f"observation file {source}"
        if read is None:
            raise InvalidInput(with_entries(f"{name}: {invalid_text}", RobotObservation))
        observation = read
    box, faults = _examine(observation, target)
    lines = [fault.text for fault in faults if invalid.isdisjoint(fault.without)]
    if invalid_text:
        raise InvalidInput(with_entries(f"{name}: {'; '.join([invalid_text, *lines])}", RobotObservation))
    if lines:
        raise InvalidInput(f"{name}: {'; '.join(lines)}")
    assert box is not None  # otherwise there is a fault
    return CheckedObservation(observation, box, target)


def find_box(source: Path | RobotObservation) -> ObjectBox | None:
    """Find the object of an observation that is yet to be checked, without a network; None if faults keep it from being found."""
    observation = read_observation(source)[0] if isinstance(source, Path) else source
    return None if observation is None or any(_distant_positions(observation)) else find_object(observation, None)


def used_inputs(network: NetworkInputs, observation: RobotObservation) -> NetworkInputs:
    """Choose the inputs that a network gets from an observation; a network that accepts any subset gets those that are present.

    An image in which a hand is marked is an occluded one: the hand is left in it.
    """
    if network.image != "any":
        return network
    camera = observation.camera
    image: ImageKind | None = None if camera is None else "unoccluded" if camera.hand_mask is None else "occluded"
    return network.restricted_to(NetworkInputs(image=image, touch=observation.is_felt))


def _examine(observation: RobotObservation, target: Target | None) -> tuple[ObjectBox | None, list[Fault]]:
    """Find the object; list the faults of the photographs and the geometry, and of giving the observation to a network."""
    faults = list(_altered_photographs(observation))
    if target is not None and target.network.image == "any" and observation.camera is None and not observation.is_felt:
        text = f"model {target.configuration} needs a photograph or touches: add the entry camera or touches"
        return None, [*faults, Fault(text, ("camera", "touches"))]
    if target is not None:
        faults += _unsuited_inputs(observation, target)
    if distant := list(_distant_positions(observation)):
        return None, [*faults, *distant]
    box = find_object(observation, target)
    return box, faults + list(_not_located(observation) if box is None else _misplaced(observation, box, target))


def _altered_photographs(observation: RobotObservation) -> Iterator[Fault]:
    """Yield tactile images that do not look like their sensors', or like the untouched ones."""
    if observation.accept_photographs:
        return
    untouched = {id(image): (image, observation.sensor_of(n)) for n, image, _ in _photographs(observation) if image is not None}
    if observation.untouched is not None and observation.sensor is not None:
        untouched |= {id(observation.untouched): (observation.untouched, observation.sensor)}
    texts = [text for image, sensor in untouched.values() for text in untouched_faults(image, sensor)]
    for n, image, photograph in _photographs(observation) if not texts else ():  # else they may differ from it as they should
        texts += photograph_faults(photograph, image, observation.sensor_of(n), observation.name_of(n))
    if texts:
        yield Fault(f"{'; '.join(texts)}; if these photographs are right as they are, add accept_photographs: true")


def _photographs(observation: RobotObservation) -> Iterator[tuple[int, NDArray[np.uint8] | None, NDArray[np.uint8]]]:
    """Yield the number of each touch with a tactile image, the untouched image, and the tactile image."""
    for number, touch in enumerate(observation.touches):
        if touch.tactile_image is not None:
            yield number, observation.untouched_of(number), touch.tactile_image


def _unsuited_inputs(observation: RobotObservation, target: Target) -> Iterator[Fault]:
    """Yield inputs that the network needs and that are missing or unsuitable."""
    model, inputs = f"model {target.configuration}", used_inputs(target.network, observation)
    if inputs.image == "rendering":
        yield Fault(f"{model} was trained on renderings from many sides, not on a camera's images: name --data, an object and a --view")
    elif inputs.image is not None and observation.camera is None:
        yield Fault(f"{model} needs a photograph: add the entry camera", ("camera",))
    if inputs.touch and not observation.touches and not observation.is_felt:  # touches may all be stated to be none
        yield Fault(f"{model} needs touches: add the entry touches", ("touches",))
    if inputs.touch:
        names_by_text: dict[str, list[str]] = {}
        for number in range(len(observation.touches)):
            if text := _unsuited_touch(observation.touches[number], observation.sensor_of(number), target):
                names_by_text.setdefault(text, []).append(observation.name_of(number))
        yield from (Fault(f"{', '.join(names)}: {text}") for text, names in names_by_text.items())


def _unsuited_touch(touch: ObservedTouch, sensor: Sensor, target: Target) -> str | None:
    """Say what keeps a touch from being given: a network of charts, no network that reads its photograph, or another shape."""
    ours = target.sensor if target.sensor is not None and same_gel(target.sensor, sensor) else None
    if target.network.takes_charts and not target.network.of_points and not target.is_charted(touch, sensor):
        known = target.sensor
        size = "" if known is None else f" by {known.name}, {1e3 * known.width:.4g} x {1e3 * known.height:.4g} mm"
        given = f"a photograph by {sensor.name}" if touch.tactile_image is not None else "depth or points"
        return f"model {target.configuration} takes touch charts of photographs{size}, and not {given}: {OF_POINTS}"
    if touch.tactile_image is not None:
        rows, cols = touch.tactile_image.shape[:2]
        if ours is not None and abs(cols / rows / (ours.cols / ours.rows) - 1) > SIZE_TOLERANCE:
            size = f"{cols} x {rows} pixels, another shape than the model's {ours.cols} x {ours.rows}"
            return f"tactile images have {size}: crop them to the gel"
        if ours is None and target.network.of_points:
            try:
                shipped_touch_model(sensor, "cpu").check_sides(rows, cols, sensor.pitch[0] / sensor.pitch[1])
            except InvalidInput as error:
                return str(error)
    if touch.depth is not None:
        rows, cols = touch.depth.shape
        if not np.isclose(cols / rows, sensor.cols / sensor.rows, rtol=SIDES_TOLERANCE):
            return f"depth has {cols} x {rows} pixels, another shape than {sensor.name}'s {sensor.cols} x {sensor.rows}: crop it to the gel"
        if touch.depth.max() > (top := gel_top(sensor)):
            depth = f"{1e3 * touch.depth.max():.3g} mm, but the gel of {sensor.name} is {1e3 * top:.3g} mm high"
            return f"depth is up to {depth}: give how deep the gel is pressed in, in m, not the distance from its base"
        if (least := touch.depth.min()) < -max(touch.depth.max(), CONTACT_MARGIN):  # beside a press a gel rises by less
            return f"depth goes down to {1e3 * least:.3g} mm, further than up: it is positive where the gel is pressed in; turn its sign"
    return None if touch.cloud is None else _unsuited_points(touch.cloud, sensor)


def _unsuited_points(cloud: NDArray[np.float64], sensor: Sensor) -> str | None:
    """Say that points lie outside the gel, as in another frame or unit, or that their normals do not point out of it."""
    outside = np.abs(cloud[:, :3]) > POINTS_BEYOND * np.array([sensor.width / 2, sensor.height / 2, gel_top(sensor)])
    if outside.any():
        gel = f"{1e3 * sensor.width:.3g} x {1e3 * sensor.height:.3g} mm wide and {1e3 * gel_top(sensor):.3g} mm high"
        point = 1e3 * cloud[outside.any(axis=1)][0, :3]
        return (
            f"{outside.any(axis=1).sum()} of {pluralise(len(cloud), 'point')} outside the gel of {sensor.name}, {gel}, one at "
            f"[{', '.join(f'{value:.4g}' for value in point)}] mm: give them in the sensor frame, from the middle of the gel's base, in m"
        )
    if not np.median(cloud[:, 5]) > 0:
        return "normals of points do not point out of the gel (+z): turn them; those of the touched object point into it"
    return None


def _distant_positions(observation: RobotObservation) -> Iterator[Fault]:
    """Yield positions that are too far away, perhaps in another unit."""
    positions: list[tuple[str, Any]] = [("object.centre", observation.object.centre), ("object.diagonal", observation.object.diagonal)]
    positions += [("camera.pose", observation.camera.pose.array[:3, 3])] if observation.camera else []
    positions += [(f"{observation.name_of(n)} pose", touch.pose.array[:3, 3]) for n, touch in enumerate(observation.touches)]
    for name, position in positions:
        if position is not None and (distance := np.abs(position).max()) * observation.metres_per_unit > FARTHEST:
            remedy = "write unit: mm if all lengths are in millimetres" if observation.unit == "m" else "check the unit"
            away, frame = ("", "") if name == "object.diagonal" else (" away", ", and take a frame near the object")
            yield Fault(f"{name} is {distance:g} {observation.unit}{away} (at most {FARTHEST:g} m): {remedy}{frame}")
    diagonal = observation.object.diagonal
    if diagonal is not None and diagonal * observation.metres_per_unit < SMALLEST:
        yield Fault(f"object.diagonal is {diagonal:g} {observation.unit} (at least {SMALLEST:g} m): check the unit, that of all lengths")


def _not_located(observation: RobotObservation) -> Iterator[Fault]:
    """Say why the object cannot be located, and what would locate it."""
    remedy = "state it, or give a depth image with a mask, or two touches"
    if observation.camera is not None and observation.camera.measured is not None:
        count = int(observation.camera.measured.sum())
        few = f"camera.depth is measured at only {pluralise(count, 'pixel')} of camera.mask, {FEW} are needed"
        unmeasured = f"{few}: register it to the photograph, and check the masks" if 0 < count < FEW else UNMEASURED
        remedy = f"{unmeasured}, or state it, or give two touches"
    yield Fault(f"object.centre is missing, and cannot be estimated: {remedy}", ("object", "camera", "touches"))


def _misplaced(observation: RobotObservation, box: ObjectBox, target: Target | None) -> Iterator[Fault]:
    """Yield cameras and touches that do not fit the object's location."""
    if (view := observation.view) is not None:
        if (distance := float(np.linalg.norm(optical_centre(view.matrix) - box.centre))) < NEAREST:
            yield Fault(f"the camera is {1e3 * distance:.3g} mm from the object's centre; check unit, camera.pose and object.centre")
        elif not view.shows(box.centre):
            yield _unseen(observation, view, box)
        else:
            yield from _wrong_depth(view, box)
    if observation.object.diagonal is not None and box.diagonal is not None:
        limit, reason = box.diagonal / 2, f"the object's diagonal is {box.diagonal:.3g} m"
    elif box.diagonal is not None:  # an estimate: behind a flat face it sees nothing
        limit, by = (1 + box.by_mask) * box.diagonal, "by its mask " * box.by_mask
        reason = f"{by}the object's diagonal seems to be {box.diagonal:.3g} m"
    elif target is not None:
        limit = target.network.radius / box.factor(target)
        reason = f"model {target.configuration} looks for the object within {limit:.3g} m of it"
    else:
        return
    for number, distance in enumerate(np.linalg.norm(observation.gel_centres - box.centre, axis=1)):
        sensor = observation.sensor_of(number)
        margin = float(np.hypot(sensor.width, sensor.height)) / 2 + sensor.w
        if observation.shown_touches[number] and distance > limit + margin:
            where = f"{distance:.3g} m from the object's centre ({box.source}), but {reason}"
            scale = ", camera.mask and object.diagonal" if box.by_mask else " and camera.depth_scale" if box.source == BY_DEPTH else ""
            untold = observation.touches[number].tactile_image is not None and observation.untouched_of(number) is None
            shown = ", or add untouched, a photograph without contact, by which one that touches nothing is known" if untold else ""
            yield Fault(f"{observation.name_of(number)} is {where}: check its pose{scale}, or write touched: false{shown}")


def _wrong_depth(view: View, box: ObjectBox) -> Iterator[Fault]:
    """Yield a depth image that does not show the object at its location."""
    if view.camera.metres is None or view.camera.measured is None:
        return
    measured = view.camera.metres[view.camera.measured]
    if not len(measured):
        yield Fault(UNMEASURED)
        return
    depth, distance = float(np.median(measured)), float(view.matrix[2] @ np.append(box.centre, 1.0))  # both along the viewing direction
    if depth > FARTHEST:
        text = f"camera.depth shows the object {depth:.3g} m away (at most {FARTHEST:g} m)"
        yield Fault(f"{text}: check camera.depth_scale; floats are metres")
    elif abs(depth - distance) > (FARTHEST if box.diagonal is None else (1 + box.by_mask) * box.diagonal):
        yield Fault(
            f"camera.depth shows the object {depth:.3g} m from the camera, but its centre is {distance:.3g} m away ({box.source}): check "
            "camera.depth_scale, camera.mask, camera.pose, unit, object.centre and object.diagonal"
        )


def _unseen(observation: RobotObservation, view: View, box: ObjectBox) -> Fault:
    """Say that the camera does not see the object, and which other reading of its pose would."""
    camera = view.camera
    other, inverse = "opengl" if camera.convention == "opencv" else "opencv", invert_pose(camera.pose.array)
    readings: dict[str, dict[str, Any]] = {
        f"with convention: {other} it would": {"convention": other},
        "with the inverse pose it would: give camera to frame, not frame to camera": {"pose": inverse},
        f"with the inverse pose and convention: {other} it would": {"convention": other, "pose": inverse},
    }
    others = ((hint, observation.changed(camera=camera.changed(**changes)).view) for hint, changes in readings.items())
    hints = (hint for hint, read in others if read is not None and read.shows(box.centre))
    hint = next(hints, "check camera.pose, convention, intrinsics and object.centre")
    centre = ", ".join(f"{value / observation.metres_per_unit:.4g}" for value in box.centre)
    return Fault(f"the camera does not see the object's centre, [{centre}] {observation.unit} ({box.source}): {hint}")
