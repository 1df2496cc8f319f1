"""Where closing fingers stop on elastic gels: where the force of a gel takes all the torque of a motor, or the gel is known no deeper."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.hand.grasp import Contact
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.hand.model import Finger, Hand
from pipeline.kernels.touch.depth_maps import gel_surface, gel_under, impression, normal_force
from pipeline.kernels.touch.ray_depth import BoxedFaces, ray_depth
from pipeline.kernels.touch.sensor import Sensor, pixel_centres, resample_longer_side

PIXELS = 64  # along the longer side of a gel whose force is computed
SAFE_SHARE = 0.98  # share of a motor's torque, and of a calibration's depth, that is used: with all pixels a force is up to 2 % larger
MAX_STRAIN = 0.9  # strain beyond which no finger closes, and a gel's force is that of its linear layer times a constant
CLOSED_SHARE = 0.95  # share of the greatest load from which a finger has closed
SHARE_TOLERANCE = 1e-4  # share of a finger's way to which its end is searched: a micrometre where it is drawn back by 6 mm
DIFFERENCE_STEP = 1e-5  # rad, of finite differences
NUDGE = 1e-5  # m, of the derivative of a force


@lru_cache(maxsize=8)
def with_fewer_pixels(sensor: Sensor) -> Sensor:
    """Reduce a sensor's pixels to those that the force of its gel needs; none is larger than the layer is thick."""
    pixels = max(PIXELS, int(np.ceil(max(sensor.width, sensor.height) / sensor.layer_thickness)))
    return sensor if max(sensor.shape) <= pixels else resample_longer_side(sensor, pixels)


def gel_strain(pressed: Array, sensor: Sensor) -> float:
    """Compute the largest strain under an impression (rows, cols), m, over the thickness of the layer, or of what is above the plate."""
    return float((pressed / np.minimum(sensor.layer_thickness, gel_surface(sensor))).max())


def gel_load(pressed: Array, sensor: Sensor) -> tuple[float, Array]:  # N, (3,) sensor frame, m
    """Compute the normal force of an elastic gel under an impression (rows, cols), m, and its centre, on the sensor plane.

    It is the linear layer's over 1 - strain^4, of the largest strain: a layer cannot be pressed thinner than nothing. That is 0.2 % more at
    a strain of a fifth, up to which neo-Hookean layers of finite elements are linear to 1 %, and a quarter more at two thirds.
    """
    pressure = gel_under(pressed, sensor).pressure
    if pressure is None or not pressure.any():
        return 0.0, np.zeros(3)
    strain = min(gel_strain(pressed, sensor), MAX_STRAIN)
    x, y = pixel_centres(sensor)
    centre = np.array([(pressure.sum(axis=0) * x).sum(), (pressure.sum(axis=1) * y).sum(), 0.0]) / pressure.sum()
    return normal_force(pressure, sensor) / (1 - strain * strain * strain * strain), centre  # the same bits everywhere


def with_force(contact: Contact, faces: BoxedFaces, pose: Array, sensor: Sensor) -> Contact:
    """Add to a contact of a sensor at a pose (4, 4) the force of its elastic gel, and by how much it grows with further depth."""
    sensor = with_fewer_pixels(sensor)
    pressed = impression(ray_depth(faces, pose, sensor), sensor)
    force, further = (gel_load(np.where(pressed > 0, pressed + more, 0.0), sensor)[0] for more in (0.0, NUDGE))
    return replace(contact, force=force, stiffness=(further - force) / NUDGE)


def close_to_torque(
    hand: Hand,
    sensors: Sequence[Sensor],  # of its mounts, with elastic gels
    faces: BoxedFaces,  # of the object
    hand_pose: Array,  # (4, 4) root link to world, m
    start: Array,  # (J,) from which the fingers close, rad (m)
    end: Array,  # (J,) at which they rest where gels do not push back
) -> tuple[Array, bool]:  # (J,), and whether no motor is overloaded
    """Stop each finger, on its way from one posture to another, where its gels take all the torque of one of its motors.

    Torques are those that balance the gels' normal forces, the Jacobian transposed times the force. A finger stops earlier where a gel is
    as deep as its model is known, `MAX_STRAIN` of the layer and the calibration's deepest contact. One that needs less torque closes to the
    end; one that is overloaded at the start stays there.
    """
    nudges = DIFFERENCE_STEP * np.concatenate([np.zeros((1, len(end))), np.eye(len(end))])
    closed, reached = end.copy(), list[float]()
    for finger in hand.fingers:
        joints = list(finger.joints)

        def load(share: float, finger: Finger = finger, joints: list[int] = joints) -> float:
            torque, poses = np.zeros(len(joints)), sensor_poses(hand, hand_pose, start + share * (end - start) + nudges)
            for s in finger.sensors:
                sensor, (pose, *nudged) = with_fewer_pixels(sensors[s]), poses[[0, *(1 + joint for joint in joints)], s]
                force, centre = gel_load(impression(ray_depth(faces, pose, sensor), sensor), sensor)
                moved = transform_points(np.array(nudged), centre[None])[:, 0] - transform_points(pose, centre[None])
                torque += force * (moved * pose[:3, 2]).sum(axis=1) / DIFFERENCE_STEP
            taken = float(np.abs(torque).max(initial=0.0)) / (SAFE_SHARE * hand.torque)
            if taken > 1:
                return taken
            depth = max((_share_of_depth(faces, poses[0, s], sensors[s]) for s in finger.sensors), default=0.0)
            return max(taken, depth * depth)  # which grows as a torque does

        reached.append(_last_within(load))
        closed[joints] = (start + reached[-1] * (end - start))[joints]
    return closed, min(reached) > 0


def _share_of_depth(faces: BoxedFaces, pose: Array, sensor: Sensor) -> float:
    """Compute the depth in a gel over the greatest at which its model is known: by `MAX_STRAIN`, or what its colours were fitted to."""
    pressed = impression(ray_depth(faces, pose, sensor), sensor)
    fitted = sensor.calibrated.deepest if sensor.calibrated else np.inf
    return max(gel_strain(pressed, sensor) / MAX_STRAIN, float(pressed.max()) / (SAFE_SHARE * fitted))


def _last_within(load: Callable[[float], float]) -> float:
    """Find the last share of a way whose load, which grows from 0, is at most 1; one that is above `CLOSED_SHARE` counts as it."""
    low, high, least, most = 0.0, 1.0, 0.0, load(1.0)
    if most <= 1:
        return 1.0
    halve = False
    while high - low > SHARE_TOLERANCE and least < CLOSED_SHARE:
        # loads grow about as the square of the depth
        part = 0.5 if halve else float((1 - np.sqrt(least)) / (np.sqrt(most) - np.sqrt(least)))
        halve, share = not halve, low + part * (high - low)
        measured = load(share)
        if measured <= 1:
            low, least = share, measured
        else:
            high, most = share, measured
    return low
