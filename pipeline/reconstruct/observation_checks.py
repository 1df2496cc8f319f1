"""Check a robot's observation, once and as a whole: its entries, its geometry, and what its network needs."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pipeline.console import pluralise
from pipeline.errors import InvalidInput
from pipeline.formats.description_file import with_entries
from pipeline.kernels.geometry.transforms import invert_pose
from pipeline.kernels.networks.network_configurations import ImageKind, NetworkInputs
from pipeline.kernels.touch.photograph_faults import photograph_faults, untouched_faults
from pipeline.kernels.vision.view_transfer import optical_centre
from pipeline.reconstruct.object_location import BY_DEPTH, FEW, ObjectBox, Target, find_object
from pipeline.reconstruct.observation_file import RobotObservation, View, read_observation

FARTHEST, NEAREST = 10.0, 0.01
"""m: largest coordinate of a pose, and least distance of a camera from the object's centre."""
SIZE_TOLERANCE = 0.02  # relative difference of sensors, and of the sides of tactile images, that is taken for rounding
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
    """Yield tactile images that do not look like the sensor's, or like the untouched one."""
    if observation.sensor is None or observation.accept_photographs:
        return
    texts = [] if observation.untouched is None else untouched_faults(observation.untouched, observation.sensor)
    for number, touch in enumerate(observation.touches if not texts else ()):  # else they may differ from it as they should
        texts += photograph_faults(touch.tactile_image, observation.untouched, observation.sensor, observation.name_of(number))
    if texts:
        yield Fault(f"{'; '.join(texts)}; if these photographs are right as they are, add accept_photographs: true")


def _unsuited_inputs(observation: RobotObservation, target: Target) -> Iterator[Fault]:
    """Yield inputs that the network needs and that are missing or unsuitable."""
    model, inputs = f"model {target.configuration}", used_inputs(target.network, observation)
    if inputs.image == "rendering":
        yield Fault(f"{model} was trained on renderings from many sides, not on a camera's images: name --data, an object and a --view")
    elif inputs.image is not None and observation.camera is None:
        yield Fault(f"{model} needs a photograph: add the entry camera", ("camera",))
    if inputs.touch and not observation.touches and not observation.is_felt:  # touches may all be stated to be none
        yield Fault(f"{model} needs touches: add the entry touches", ("touches",))
    ours, theirs = target.sensor, observation.sensor
    if not inputs.touch or not observation.touches or ours is None or theirs is None:
        return
    sizes = [(sensor.width, sensor.height, sensor.w) for sensor in (theirs, ours)]
    if not np.allclose(sizes[0], sizes[1], rtol=SIZE_TOLERANCE, atol=0):
        observed, trained = (f"{1e3 * width:.4g} x {1e3 * height:.4g} mm with a gel of {1e3 * w:.4g} mm" for width, height, w in sizes)
        yield Fault(
            f"sensor {theirs.name} has {observed}, the model's {ours.name} {trained}: "
            "give photographs by such a sensor, or train a model with this one"
        )
    rows, cols = observation.touches[0].tactile_image.shape[:2]
    if abs(cols / rows / (ours.cols / ours.rows) - 1) > SIZE_TOLERANCE:
        size = f"{cols} x {rows} pixels, another shape than the model's {ours.cols} x {ours.rows}"
        yield Fault(f"tactile images have {size}: crop them to the gel")


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
        limit, reason = box.diagonal, f"the object's diagonal seems to be {box.diagonal:.3g} m"
    elif target is not None:
        limit = target.network.radius / box.factor(target)
        reason = f"model {target.configuration} looks for the object within {limit:.3g} m of it"
    else:
        return
    margin = 0.0 if (sensor := observation.sensor) is None else float(np.hypot(sensor.width, sensor.height)) / 2 + sensor.w
    for number, distance in enumerate(np.linalg.norm(observation.gel_centres - box.centre, axis=1)):
        if observation.shown_touches[number] and distance > limit + margin:
            where = f"{distance:.3g} m from the object's centre ({box.source}), but {reason}"
            scale = " and camera.depth_scale" if box.source == BY_DEPTH else ""
            yield Fault(f"{observation.name_of(number)} is {where}: check its pose{scale}, or write touched: false")


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
    elif abs(depth - distance) > (FARTHEST if box.diagonal is None else box.diagonal):
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
