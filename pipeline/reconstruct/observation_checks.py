"""Find faults of a robot's observation: in its geometry, and against the model that it is given to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.console import pluralise
from pipeline.kernels.geometry.transforms import invert_pose
from pipeline.kernels.vision.camera import project_points
from pipeline.kernels.vision.view_transfer import optical_centre
from pipeline.real_touch.photograph_faults import photograph_faults, untouched_faults
from pipeline.reconstruct.model_inputs import ModelInputs, used_inputs
from pipeline.reconstruct.object_box import BY_DEPTH, FEW, ObjectBox, find_object, gel_centres, shows_touch, size_factor
from pipeline.reconstruct.observation_file import NOWHERE, TO_ADD, RobotObservation

FARTHEST, NEAREST = 10.0, 0.01
"""m: largest coordinate of a pose, and least distance of a camera from the object's centre."""
SIZE_TOLERANCE = 0.02
"""Relative difference of sensors, and of the sides of tactile images, that is taken for rounding."""
UNMEASURED = (
    "camera.depth is 0 or not finite wherever camera.mask shows the object, and camera.hand_mask no robot: register it to the photograph, "
    "and check that no mask is inverted"
)


def _why_not_located(observation: RobotObservation) -> str:
    """Say why the object cannot be located, and what would locate it."""
    camera = observation.camera
    if camera is not None and camera.metres is not None and camera.mask is not None:
        measured = int((camera.object_pixels & ~np.isnan(camera.metres)).sum())
        seen = f"camera.depth is measured at only {pluralise(measured, 'pixel')} of camera.mask"
        few = f"{seen}, {FEW} are needed: register it to the photograph, and check the masks"
        return f"{few if 0 < measured < FEW else UNMEASURED}, or state it, or give two touches"
    return "state it, or give a depth image with a mask, or two touches"


def faults(observation: RobotObservation, model: ModelInputs | None = None) -> list[str]:
    """List the faults of an observation whose entries are valid by themselves, or of giving it to a model."""
    return [*_altered_photographs(observation), *_geometric_faults(observation, model)]


def _geometric_faults(observation: RobotObservation, model: ModelInputs | None) -> list[str]:
    if model is not None:
        if model.config.image == "any" and observation.camera is None and not observation.is_felt:
            return [f"model {model.configuration} needs a photograph or touches{TO_ADD}camera or touches"]
        model = replace(model, config=used_inputs(model.config, observation))
    if too_far := list(_distant_positions(observation)):
        return too_far + ([] if model is None else list(_unsuited_inputs(observation, model)))
    box = find_object(observation, model)
    problems = [] if model is None else list(_unsuited_inputs(observation, model))
    if box is None:
        return [*problems, f"{NOWHERE}, and cannot be estimated: {_why_not_located(observation)}"]
    return [*problems, *_misplaced(observation, box, model)]


def _altered_photographs(observation: RobotObservation) -> Iterator[str]:
    """Yield tactile images that do not look like the sensor's, or like the untouched one."""
    if observation.sensor is None or observation.accept_photographs:
        return
    found = [] if observation.untouched is None else untouched_faults(observation.untouched, observation.sensor)
    for number, touch in enumerate(observation.touches if not found else ()):  # else they may differ from it as they should
        found += photograph_faults(touch.tactile_image, observation.untouched, observation.sensor, observation.name_of(number))
    if found:
        yield f"{'; '.join(found)}; if these photographs are right as they are, add accept_photographs: true"


def _distant_positions(observation: RobotObservation) -> Iterator[str]:
    """Yield positions that are too far away, perhaps in another unit."""
    positions: list[tuple[str, Any]] = [("object.centre", observation.object.centre), ("object.diagonal", observation.object.diagonal)]
    positions += [("camera.pose", observation.camera.pose.array[:3, 3])] if observation.camera else []
    positions += [(f"{observation.name_of(n)} pose", touch.pose.array[:3, 3]) for n, touch in enumerate(observation.touches)]
    for name, position in positions:
        if position is not None and (distance := np.abs(position).max()) * observation.metres_per_unit > FARTHEST:
            remedy = "write unit: mm if all lengths are in millimetres" if observation.unit == "m" else "check the unit"
            away, frame = ("", "") if name == "object.diagonal" else (" away", ", and take a frame near the object")
            yield f"{name} is {distance:g} {observation.unit}{away} (at most {FARTHEST:g} m): {remedy}{frame}"


def _unsuited_inputs(observation: RobotObservation, model: ModelInputs) -> Iterator[str]:
    """Yield inputs that the model needs and that are missing or unsuitable."""
    name, config = model.configuration, model.config
    if config.image == "rendering":
        yield f"model {name} was trained on renderings from many sides, not on a camera's images: name --data, an object and a --view"
    elif config.image is not None and observation.camera is None:
        yield f"model {name} needs a photograph{TO_ADD}camera"
    if not config.touch:
        return
    if not observation.touches and not observation.is_felt:  # touches may all be stated to be none
        yield f"model {name} needs touches{TO_ADD}touches"
    if not observation.touches:
        return
    ours, theirs = model.sensor, observation.sensor
    if ours is None or theirs is None:
        return
    sizes = [(sensor.width, sensor.height, sensor.w) for sensor in (theirs, ours)]
    if not np.allclose(sizes[0], sizes[1], rtol=SIZE_TOLERANCE, atol=0):
        observed_size, model_size = (
            f"{1e3 * width:.4g} x {1e3 * height:.4g} mm with a gel of {1e3 * w:.4g} mm" for width, height, w in sizes
        )
        yield (
            f"sensor {theirs.name} has {observed_size}, the model's {ours.name} {model_size}: "
            "give photographs by such a sensor, or train a model with this one"
        )
    rows, cols = observation.touches[0].tactile_image.shape[:2]
    if abs(cols / rows / (ours.cols / ours.rows) - 1) > SIZE_TOLERANCE:
        yield f"tactile images have {cols} x {rows} pixels, another shape than the model's {ours.cols} x {ours.rows}: crop them to the gel"


def _misplaced(observation: RobotObservation, box: ObjectBox, model: ModelInputs | None) -> Iterator[str]:
    """Yield cameras and touches that do not fit the object's place."""
    if observation.camera is not None and observation.projection is not None:
        if (distance := float(np.linalg.norm(optical_centre(observation.projection) - box.centre))) < NEAREST:
            yield f"the camera is {1e3 * distance:.3g} mm from the object's centre; check unit, camera.pose and object.centre"
        elif not _sees(observation, observation.projection, box):
            yield _unseen(observation, box)
        elif (problem := _wrong_depth(observation, observation.projection, box)) is not None:
            yield problem
    if observation.object.diagonal is not None and box.diagonal is not None:
        limit, reason = box.diagonal / 2, f"the object's diagonal is {box.diagonal:.3g} m"
    elif box.diagonal is not None:  # an estimate: behind a flat face it sees nothing
        limit, reason = box.diagonal, f"the object's diagonal seems to be {box.diagonal:.3g} m"
    else:
        limit = np.inf if model is None else model.config.radius / size_factor(box, model)
        reason = f"model {'' if model is None else model.configuration} looks for the object within {limit:.3g} m of it"
    margin = 0.0 if (sensor := observation.sensor) is None else float(np.hypot(sensor.width, sensor.height)) / 2 + sensor.w
    for number, place in enumerate(gel_centres(observation)):
        distance = float(np.linalg.norm(place - box.centre))
        if shows_touch(observation.touches[number], observation) and distance > limit + margin:
            yield (
                f"{observation.name_of(number)} is {distance:.3g} m from the object's centre ({box.source}), but {reason}: check its pose"
                f"{' and camera.depth_scale' if box.source == BY_DEPTH else ''}, or write touched: false"
            )


def _wrong_depth(observation: RobotObservation, matrix: NDArray[np.float64], box: ObjectBox) -> str | None:
    """Describe a depth image that does not show the object at its place; None if it does, or if there is none."""
    camera = observation.camera
    if camera is None or camera.metres is None or camera.mask is None:
        return None
    measured = camera.metres[camera.object_pixels & ~np.isnan(camera.metres)]
    if not len(measured):
        return UNMEASURED
    depth, distance = float(np.median(measured)), float(matrix[2] @ np.append(box.centre, 1.0))  # both along the viewing direction
    if depth > FARTHEST:
        return f"camera.depth shows the object {depth:.3g} m away (at most {FARTHEST:g} m): check camera.depth_scale; floats are metres"
    if abs(depth - distance) <= (FARTHEST if box.diagonal is None else box.diagonal):
        return None
    return (
        f"camera.depth shows the object {depth:.3g} m from the camera, but its centre is {distance:.3g} m away ({box.source}): check "
        "camera.depth_scale, camera.mask, camera.pose, unit, object.centre and object.diagonal"
    )


def _sees(observation: RobotObservation, matrix: NDArray[np.float64], box: ObjectBox) -> bool:
    assert observation.camera is not None
    rows, cols = observation.camera.image.shape[:2]
    pixel = project_points(matrix, box.centre)
    return bool(((pixel >= 0) & (pixel < [cols, rows])).all())  # NaN behind the camera is not


def _unseen(observation: RobotObservation, box: ObjectBox) -> str:
    """Say that the camera does not see the object, and which other reading of its pose would."""
    camera = observation.camera
    assert camera is not None
    other_convention = "opengl" if camera.convention == "opencv" else "opencv"
    inverse = invert_pose(camera.pose.array)
    readings: list[tuple[dict[str, Any], str]] = [
        ({"convention": other_convention}, f"with convention: {other_convention} it would"),
        ({"pose": inverse}, "with the inverse pose it would: give camera to frame, not frame to camera"),
        ({"convention": other_convention, "pose": inverse}, f"with the inverse pose and convention: {other_convention} it would"),
    ]
    hint = "check camera.pose, convention, intrinsics and object.centre"
    for changes, words in readings:
        reinterpreted = observation.changed(camera=camera.changed(**changes))
        if reinterpreted.projection is not None and _sees(reinterpreted, reinterpreted.projection, box):
            hint = words
            break
    centre = ", ".join(f"{value / observation.metres_per_unit:.4g}" for value in box.centre)
    return f"the camera does not see the object's centre, [{centre}] {observation.unit} ({box.source}): {hint}"
