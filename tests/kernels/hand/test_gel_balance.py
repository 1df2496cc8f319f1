"""Closing on elastic gels: the pads of a gripper and a block or a ball between them, with forces in closed form."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.hand.gel_balance import (
    CLOSED_SHARE,
    MAX_STRAIN,
    SAFE_SHARE,
    close_to_torque,
    gel_load,
    gel_strain,
    with_fewer_pixels,
    with_force,
)
from pipeline.kernels.hand.grasp import Contact
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.touch.depth_maps import impression
from pipeline.kernels.touch.ray_depth import BoxedFaces, box_faces, ray_depth
from pipeline.kernels.touch.sensor import Gel, Sensor, Surface
from tests.kernels.hand.meshes import centred
from tests.physics.test_hold_test import gripping_pose

GRIPPER, WIDTH = load_hand("two_finger_gripper"), 0.03
MODULUS, THICKNESS = 1e5, 5e-4
THIN = load_sensor("gel_16mm").model_copy(update={"gel": Gel(modulus=MODULUS, poisson=0.0, thickness=THICKNESS), "rows": 50, "cols": 50})
"""Nearly a Winkler foundation, whose pressure is modulus * indentation / thickness."""
CALIBRATED = load_sensor("gelsight_mini")
assert CALIBRATED.calibrated
DEEPEST = CALIBRATED.calibrated.deepest
MINI = CALIBRATED.model_copy(update={"calibrated": CALIBRATED.calibrated.model_copy(update={"deepest": 10.0})})
TOUCH = Contact(np.zeros(3), np.zeros(3), area=0.0)


def boxed(body: trimesh.Trimesh) -> BoxedFaces:
    return box_faces(centred(body).triangles)


BLOCK, BALL = boxed(trimesh.creation.box((WIDTH, WIDTH, 0.2))), boxed(trimesh.creation.icosphere(subdivisions=4, radius=WIDTH / 2))


def pads(sensor: Sensor, faces: BoxedFaces, *, limit: float, depth: float) -> tuple[float, float]:
    """Close both pads, moved by one motor of `limit` N, from 6 mm before an object to a depth in their gels: depth and force at the end."""
    end = np.array([WIDTH / 2 + sensor.w - depth])
    closed, within = close_to_torque(replace(GRIPPER, torque=limit), [sensor, sensor], faces, gripping_pose(0.0), end + 0.006, end)
    assert within
    pose = sensor_poses(GRIPPER, gripping_pose(0.0), closed)[0]
    return WIDTH / 2 + sensor.w - float(closed[0]), with_force(TOUCH, faces, pose, sensor).force


@pytest.mark.parametrize(("sensor", "faces"), [(THIN, BLOCK), (MINI, BLOCK), (MINI, BALL)])
@pytest.mark.parametrize("limit", [4.0, 12.0])
def test_pads_stop_where_their_forces_together_take_the_motors_force(sensor: Sensor, faces: BoxedFaces, limit: float) -> None:
    depth, force = pads(sensor, faces, limit=limit, depth=0.9 * sensor.layer_thickness)
    assert CLOSED_SHARE * SAFE_SHARE * limit <= 2 * force <= limit * (SAFE_SHARE + 1e-6)
    assert 0 < depth < 0.9 * sensor.layer_thickness


def test_pads_that_need_less_close_to_the_end_and_strong_ones_never_through_the_layer() -> None:
    depth, force = pads(MINI, BALL, limit=100.0, depth=0.0004)
    assert depth == pytest.approx(0.0004)
    assert 2 * force < 100
    for sensor in (MINI, MINI.model_copy(update={"gel": Gel(modulus=2e5, thickness=0.006)})):  # a layer as thick as it behaves, over w
        depth, _ = pads(sensor, BALL, limit=1e6, depth=0.0039)
        assert 0.95 <= depth / (MAX_STRAIN * min(sensor.layer_thickness, sensor.w)) <= 1.005  # a facet is lower than the ball


def test_pads_stop_at_the_deepest_contact_of_the_calibration() -> None:
    depth, force = pads(CALIBRATED, BALL, limit=100.0, depth=0.0019)
    assert 0.93 * DEEPEST <= depth < DEEPEST
    assert 2 * force < 90


def test_pads_without_room_to_open_are_overloaded() -> None:
    end = np.array([WIDTH / 2 + MINI.w - 0.0015])
    closed, within = close_to_torque(replace(GRIPPER, torque=1.0), [MINI, MINI], BALL, gripping_pose(0.0), end, end)
    assert not within
    np.testing.assert_array_equal(closed, end)


def test_force_is_the_layers_and_grows_without_bound_towards_its_plate() -> None:
    area = THIN.width * THIN.height
    for strain in (0.1, 0.5, 0.85):
        pressed = np.full(THIN.shape, strain * THICKNESS)
        force, centre = gel_load(pressed, THIN)
        assert gel_strain(pressed, THIN) == pytest.approx(strain)
        assert force == pytest.approx(MODULUS * strain * area / (1 - strain**4), rel=0.03)  # cells at the rim spread into it
        np.testing.assert_allclose(centre, 0, atol=1e-9)
    slanted = np.broadcast_to(np.linspace(0, 1e-4, THIN.cols), THIN.shape).copy()
    np.testing.assert_allclose(gel_load(slanted, THIN)[1], [THIN.width / 6, 0, 0], atol=2e-4)  # of a triangle of pressure
    assert gel_load(np.zeros(THIN.shape), THIN)[0] == 0


def test_strain_of_a_curved_gel_is_over_what_lies_above_the_plate() -> None:
    curved = MINI.model_copy(update={"surface": Surface(radius=0.03), "gel": Gel(modulus=1e5, thickness=0.01), "rows": 24, "cols": 32})
    depth = np.full(curved.shape, 0.001)
    assert gel_strain(impression(depth, curved), curved) == pytest.approx(1 - 0.001 / curved.w, rel=1e-3)


def test_contact_gets_its_force_and_the_slope_of_it() -> None:
    forces, slopes = [], []
    for depth in (0.0009, 0.00091):
        pose = sensor_poses(GRIPPER, gripping_pose(0.0), np.array([WIDTH / 2 + MINI.w - depth]))[0]
        contact = with_force(TOUCH, BALL, pose, MINI)
        full = gel_load(impression(ray_depth(BALL, pose, MINI), MINI), MINI)[0]
        assert contact.force == pytest.approx(full, rel=0.03)  # with fewer pixels
        forces.append(contact.force)
        slopes.append(contact.stiffness)
    assert forces[1] - forces[0] == pytest.approx(1e-5 * np.mean(slopes), rel=0.1)
    assert max(with_fewer_pixels(MINI).shape) < max(MINI.shape)
    assert max(with_fewer_pixels(THIN).pitch) <= THICKNESS
