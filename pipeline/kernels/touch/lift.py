"""The lift of an object that only gels hold: it is freed, its weight grows on the gels, and it rests, slips, or falls.

What holds the object while the fingers close gives way first, then what carries its weight, each evenly over some steps.

Motors hold each sensor along its normal as springs do: they press with its force in the grasp, and with less where it closes further.
The object obeys Newton's law by implicit Euler steps, which damp what swings; its inertia is that of a body whose mass lies at one
distance from its centre. Rigid links carry nothing.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pipeline.errors import InvalidInput
from pipeline.kernels.arrays import Array, Array32, Mask
from pipeline.kernels.geometry.transforms import compose, invert_pose, length, pose_of, rotation_from_euler, solve_linear
from pipeline.kernels.touch.depth_maps import gel_surface, normal_force, press_gel
from pipeline.kernels.touch.friction import gel_at_rest
from pipeline.kernels.touch.sensor import Sensor, pixel_centres
from pipeline.kernels.touch.sliding import SlideStep, slide_gel

EARTH = 9.81  # m/s², along the world's -z
FREE, FULL = 1 / 8, 1 / 2  # shares of the lift after which the object is free and its weight begins to grow, and has grown
TOLERANCE, NOISE = 2e-3, 1e-4  # of the balance: shares of the weight, and of the gels' normal forces, whose solver errs by as much
NUDGE, FARTHEST = 1e-5, 3e-4  # m, of finite differences, and of a step of the solver
STILL = 1e-6  # m, of a squeeze: with less, fingers stay where they are
AT_REST = 0.02  # share of the weight within which the gels' forces carry an object that rests
MAX_STEPS, PATIENCE, PROGRESS = 40, 6, 0.7  # of the solver: steps; how many of them may gain too little; the error left by one that gains


class FreedObject(NamedTuple):
    """An object that is free to move."""

    depth: Callable[[Array, Sensor], Array32]  # its depth map (rows, cols), m, from a sensor's pose (4, 4) in its frame
    centre: Array  # (3,) of mass, m
    gyration: float  # m, radius
    mass: float  # kg


class LiftStep(NamedTuple):
    """One step of a lift."""

    pose: Array  # (4, 4) of the object, from where it was grasped, world
    closed: Array  # (S,) m by which the sensors have moved along their normals
    touches: Sequence[SlideStep]  # of each sensor
    weight: float  # N, that is on the gels
    imbalance: float  # N, of the sum of weight and gels' forces: it accelerates the object, and vanishes when it rests
    held: bool  # False from the step in which no gel touches the object any more, or it moves by more than one's thickness: it is gone
    settled: bool = True  # whether the balance was found


def freed_object(
    depth: Callable[[Array, Sensor], Array32],
    points: Array,  # (N, 3) of its surface, m, over which its mass is spread evenly
    mass: float,  # kg
) -> FreedObject:
    """Describe an object by its surface."""
    centre = points.astype(np.float64).mean(axis=0)
    return FreedObject(depth, centre, float(np.sqrt(2 / 3 * np.square(points - centre).sum(axis=1).mean())), mass)


def rests(
    held: Mask | bool,
    imbalance: ArrayLike,  # N
    weight: ArrayLike,  # N
    settled: ArrayLike,  # (..., S) of the sensors
) -> Mask:
    """Check whether objects rest on gels, in a step of a lift."""
    balanced = np.asarray(imbalance) <= AT_REST * np.asarray(weight)
    return np.asarray(held & balanced & np.all(settled, axis=-1))


def lift_object(
    body: FreedObject,
    poses: Sequence[Array],  # (4, 4) of the sensors, which touch the object, world
    sensors: Sequence[Sensor],  # with elastic gels
    friction: Sequence[float],  # coefficients of the gels
    *,
    squeeze: float,  # m by which the sensor that presses most would close until it pressed with nothing; the others' springs are as stiff
    steps: int,
    rate: float,  # steps per second
) -> Iterator[LiftStep]:
    """Lift an object; in the first step it is still fixed, and the gels are pressed without shear.

    Each step solves for the motions of object and sensors, by Broyden's method: the gels' forces and torques, its weight and its inertia
    add up to 0, and so do each gel's force and its motors'.
    """
    gone, still = [_untouched(*seen) for seen in zip(poses, sensors, strict=True)], np.zeros(6)
    last = LiftStep(np.eye(4), np.zeros(len(sensors)), gone, 0.0, 0.0, True)
    momentum, holding, jacobian = still, still, None  # of translation and, over `gyration`, of rotation; what holds it when fingers close
    grip, stiffness = np.zeros(len(sensors)), 0.0  # of the motors: N in the grasp, N/m
    for number in range(steps):
        weight = body.mass * EARTH * min(max((number / steps - FREE) / (FULL - FREE), 0.0), 1.0)
        push = np.append(momentum * rate + holding * max(1 - number / steps / FREE, 0.0), grip - stiffness * last.closed)
        inertia = np.repeat([body.mass * rate**2, stiffness], [6, len(sensors)])
        balance = partial(_balance, body, poses, friction, last, weight=weight, push=push, inertia=inertia)
        if number == 0:
            unbalanced, last = balance(0 * push)
            holding, grip = np.split(-unbalanced, [6])
            stiffness = float(grip.max()) / max(squeeze, STILL)
        elif last.held:
            pressed = sum(normal_force(np.asarray(touch.gel.pressure), touch.sensor) for touch in last.touches)
            tolerance = TOLERANCE * body.mass * EARTH + NOISE * pressed
            try:
                motion, last, jacobian = _solve(balance, np.append(momentum / (body.mass * rate), 0 * grip), jacobian, tolerance)
                momentum = body.mass * rate * motion[:6]
            except _Lost:
                last = last._replace(touches=gone)
            if not any(touch.gel.contact.any() for touch in last.touches):
                last = last._replace(touches=gone, held=False, settled=True)
        yield last if last.held else last._replace(weight=weight, imbalance=weight)


class _Lost(Exception):
    """Raised where an object moves over a gel by more than its thickness in one step: it slips out."""


def _balance(
    body: FreedObject,
    poses: Sequence[Array],
    friction: Sequence[float],
    last: LiftStep,
    motion: Array,  # (6 + S,) m since the last step, of the centre and, times `gyration`, about it; of the sensors along their normals
    *,
    weight: float,  # N
    push: Array,  # (6 + S,) N, of what holds the object, and of its momentum; of the motors
    inertia: Array,  # (6 + S,) N/m, and stiffness of the motors
) -> tuple[Array, LiftStep]:
    """Move an object and sensors, and add up the forces on it, over its radius of gyration their torques, and those on each sensor, N.

    All vanish for the motion that follows.
    """
    pose, closed = _moved(motion[:6], last.pose, body), last.closed + motion[6:]
    poses = [compose(sensor, pose_of(np.eye(3), np.array([0.0, 0.0, way]))) for sensor, way in zip(poses, closed, strict=True)]
    try:
        touches = [_touch(body, pose, *seen) for seen in zip(poses, last.touches, friction, strict=True)]
    except InvalidInput as error:  # it moves over a gel by more than its thickness
        raise _Lost from error
    force = -np.sum([_wrench(*seen, _centre(pose, body), body.gyration) for seen in zip(touches, poses, strict=True)], axis=0)
    force[2] -= weight
    presses = [normal_force(np.asarray(touch.gel.pressure), touch.sensor) for touch in touches]
    unbalanced = np.append(force, np.negative(presses)) + push - inertia * motion
    return unbalanced, LiftStep(pose, closed, touches, weight, float(length(force[:3])), True)


def _untouched(pose: Array, sensor: Sensor) -> SlideStep:
    """Make the step of a gel that nothing touches, from which a first touch starts without motion."""
    depth = np.full(sensor.shape, np.inf, np.float32)
    return SlideStep(sensor, pose, depth, press_gel(depth, sensor), gel_at_rest(sensor))


def _touch(body: FreedObject, pose: Array, sensor_pose: Array, before: SlideStep, friction: float) -> SlideStep:
    """Move the object at a sensor to a pose."""
    seen = compose(invert_pose(pose), sensor_pose)
    return next(slide_gel([(body.depth(seen, before.sensor), seen)], before.sensor, friction, before))


def _wrench(touch: SlideStep, pose: Array, centre: Array, gyration: float) -> Array:  # (6,) N
    """Add up an object's force on a gel, and its torque about the object's centre over the radius of gyration, in the world."""
    sensor = touch.sensor
    x, y = pixel_centres(sensor)
    pressure, (along_x, along_y) = np.asarray(touch.gel.pressure), np.moveaxis(touch.traction, -1, 0)
    height = gel_surface(sensor) - touch.gel.indentation
    moments = [
        -y[:, None] * pressure - height * along_y,
        height * along_x + x[None] * pressure,
        x[None] * along_y - y[:, None] * along_x,
    ]
    sums = np.array([part.sum() for part in (along_x, along_y, -pressure, *moments)]) * np.prod(sensor.pitch)
    force, torque = compose(pose[:3, :3], sums.reshape(2, 3).T).T
    return np.concatenate([force, (torque + np.cross(pose[:3, 3] - centre, force)) / gyration])


def _centre(pose: Array, body: FreedObject) -> Array:  # (3,) world, m
    return compose(pose[:3, :3], body.centre[:, None])[:, 0] + pose[:3, 3]


def _moved(motion: Array, pose: Array, body: FreedObject) -> Array:  # (4, 4)
    """Turn an object about its centre, and shift it."""
    rotation, centre = rotation_from_euler(motion[3:] / body.gyration), _centre(pose, body)
    return compose(pose_of(rotation, centre + motion[:3] - compose(rotation, centre[:, None])[:, 0]), pose)


def _solve(
    balance: Callable[[Array], tuple[Array, LiftStep]],
    motion: Array,  # (6 + S,) m, to start from
    jacobian: Array | None,  # (6 + S, 6 + S) of the step before
    tolerance: float,  # N
) -> tuple[Array, LiftStep, Array | None]:
    """Find the motion of balance; a jacobian is computed where there is none, or the one that is updated does not help."""
    error, step = balance(motion)
    least, stalled = np.inf, 0
    for _ in range(MAX_STEPS):
        size = float(length(error))
        if size <= tolerance:
            return motion, step, jacobian
        stalled = 0 if size < PROGRESS * least else stalled + 1
        least = min(least, size)
        if jacobian is None or stalled > PATIENCE:
            jacobian = np.stack([(balance(motion + nudge)[0] - error) / NUDGE for nudge in NUDGE * np.eye(len(motion))], axis=1)
            stalled = 0
        change = -solve_linear(jacobian, error)
        change *= min(1.0, FARTHEST / np.abs(change).max())
        before, motion = error, motion + change
        error, step = balance(motion)
        jacobian = jacobian + np.outer(error - before - (jacobian * change).sum(axis=1), change) / np.square(change).sum()
    return motion, step._replace(settled=False), jacobian
