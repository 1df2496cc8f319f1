"""The hold test against Coulomb's law: a post between the pads of a gripper."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.gel_balance import with_force
from pipeline.kernels.hand.grasp import Contact, Grasp, contact_from_depth
from pipeline.kernels.hand.kinematics import sensor_poses
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.sensor import Gel
from pipeline.physics.hold_test import GEL_MODULUS, GRAVITY, OVERLAP, REST, WITHIN, HoldTest, Motion, Track, gel_spring, is_held
from tests.kernels.hand.meshes import centred, points_on
from tests.physics.pincers import check_friction_limit

GRIPPER, SENSOR = load_hand("two_finger_gripper"), load_sensor("gel_16mm")
WIDTH, PRESSED = 0.03, 0.002
HOLDS = 2 * GRIPPER.friction * GEL_MODULUS * SENSOR.width**2 * PRESSED / SENSOR.w / -GRAVITY
"""kg that friction of the two pads holds: 0.8."""


def post(subdivisions: int = 0) -> Mesh:
    body = trimesh.creation.box((WIDTH, WIDTH, 0.2))
    for _ in range(subdivisions):
        body = body.subdivide()
    return centred(body)


def lifted(mesh: Mesh, *, mass: float, sideways: float = 0.0, engine: type[HoldTest] = HoldTest) -> bool:
    """Grip a post from its side, the gels pressed in by 2 mm; with the gripper moved sideways only the right finger touches."""
    angles = np.array([WIDTH / 2 + SENSOR.w - PRESSED + sideways])
    pose, faces = gripping_pose(sideways), box_faces(mesh.triangles)
    contacts = [contact_from_depth(ray_depth(faces, at, SENSOR), at, SENSOR) for at in sensor_poses(GRIPPER, pose, angles)]
    with engine(GRIPPER, [SENSOR, SENSOR], mass=mass) as test:
        test.load(mesh, points_on(mesh, 2000, seed=0)[0])
        return test.hold(Grasp(pose, angles, angles, angles, np.empty((0, 4, 4)), contacts)).moved <= 0.05


def gripping_pose(sideways: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # the palm faces +x, the fingers slide along y
    pose[:3, 3] = [-0.082, sideways, 0.6]
    return pose


def check_gripped_weights(engine: type[HoldTest]) -> None:
    """Check that opposed gels hold up to the friction limit, and one gel nothing."""
    assert lifted(post(), mass=0.8 * HOLDS, engine=engine)
    assert not lifted(post(), mass=1.25 * HOLDS, engine=engine)
    assert not lifted(post(), mass=0.05, sideways=0.03, engine=engine)


def check_untouched_object(engine: type[HoldTest], gel_heights: Callable[[HoldTest], list[float]]) -> None:
    """Check that an object a metre away falls freely, while gels stay drawn in, also under ten times gravity along their normals."""
    angles, mesh = np.array([0.03]), post()
    grasp = Grasp(gripping_pose(1.0), angles, angles, angles, np.empty((0, 4, 4)), [None, None])
    with engine(GRIPPER, [SENSOR, SENSOR], mass=0.05) as test:
        test.load(mesh, points_on(mesh, 2000, seed=0)[0])
        motion = test.hold(grasp)
        assert 0.1 < motion.moved < 0.14
        assert motion.speed == pytest.approx(motion.moved / np.sqrt(2 * motion.moved / -GRAVITY), rel=0.35)
        test.hold(grasp, acceleration=(0.0, 10 * GRAVITY, 0.0), seconds=0.1, limit=10.0)
        np.testing.assert_allclose(gel_heights(test), 0.0, atol=2e-4)


def test_friction_of_gels_is_coulombs_in_every_direction(pincers: Hand) -> None:
    check_friction_limit(HoldTest, pincers)


def test_opposed_gels_hold_weights_up_to_the_friction_limit_and_one_gel_none() -> None:
    check_gripped_weights(HoldTest)


def test_untouched_object_falls_freely_and_gels_without_contact_stay_drawn_in() -> None:
    check_untouched_object(HoldTest, lambda test: [test.client.getJointState(test._body.body, gel)[0] for gel in test._gels])


def recorded(distance: Callable[[float], float]) -> tuple[float, Motion]:
    """Let an object sink by a distance, m, of time, s, for a second: when the record ended, s, and the motion."""
    start = np.array([0.0, 0, 1, 0, 0, 0, 1])
    track = Track(start, limit=WITHIN, interval=0.02)
    for sample in range(1, 51):
        pose = start.copy()
        pose[2] -= distance(0.02 * sample)
        if track.ends(pose):
            break
    return 0.02 * sample, track.motion(0.0)


@pytest.mark.parametrize("acceleration", [0.1, 0.5, 9.81])
def test_object_that_slides_at_a_constant_acceleration_is_not_held(acceleration: float) -> None:
    end, motion = recorded(lambda time: acceleration * time**2 / 2)
    assert not is_held(motion.moved, motion.speed)
    assert motion.moved == pytest.approx(acceleration * end**2 / 2)
    start = max(end - 0.24, 0)  # of the last twelve samples
    assert motion.speed == pytest.approx(acceleration * (start + end) / 2)


@pytest.mark.parametrize("sag", [0.0, 0.015, 0.03])
def test_object_that_sags_with_its_motors_and_rests_is_held(sag: float) -> None:
    end, motion = recorded(lambda time: sag * (1 - np.exp(-time / 0.05)))
    assert is_held(motion.moved, motion.speed)
    assert motion.moved == pytest.approx(sag, rel=0.02)
    assert motion.speed < 0.005
    assert end < 0.6  # it rests, and the test ends


def test_object_that_creeps_is_judged_by_its_speed_at_the_end() -> None:
    for speed in (0.5 * REST, 1.5 * REST):
        end, motion = recorded(lambda time, speed=speed: speed * time)
        assert end == 1.0
        assert motion.speed == pytest.approx(speed)
        assert is_held(motion.moved, motion.speed) == (speed < REST)


def test_motion_of_an_engine_that_failed_is_no_hold() -> None:
    end, motion = recorded(lambda time: np.nan if time > 0.1 else 0.0)
    assert end < 0.2
    assert motion.moved == motion.speed == np.inf
    assert not is_held(motion.moved, motion.speed)


@pytest.mark.parametrize("thickness", [None, 2 * SENSOR.w])
def test_gel_spring_has_the_stiffness_of_its_layer_and_an_upper_bound_for_slight_contact(thickness: float | None) -> None:
    sensor = SENSOR.model_copy(update={"gel": Gel(modulus=GEL_MODULUS, thickness=thickness)})
    layer, area = GEL_MODULUS / (thickness or SENSOR.w), SENSOR.width**2
    for pressed in (PRESSED, 1.0001 * OVERLAP, OVERLAP / 2):
        contact = Contact(np.zeros(3), np.zeros(3), area=area, volume=area * pressed, nearest=SENSOR.w - pressed)
        spring = gel_spring(sensor, contact, friction=0.5)
        assert 0 < spring.stiffness < 1.1 * layer * area
        assert spring.height <= SENSOR.w
        if pressed == PRESSED:
            assert spring.stiffness * (SENSOR.w - spring.height) == pytest.approx(layer * area * pressed)


def test_mesh_of_several_shapes_is_one_body() -> None:
    """49,152 faces: more than one shape of PyBullet takes."""
    fine = post(subdivisions=6)
    assert lifted(fine, mass=0.5 * HOLDS)
    assert not lifted(fine, mass=0.5 * HOLDS, sideways=0.03)


@pytest.mark.parametrize("modulus", [5e4, 2e5])
def test_elastic_gels_press_with_their_force_and_carry_the_weight_of_an_object_at_rest(modulus: float) -> None:
    sensor = load_sensor("gelsight_mini").model_copy(update={"gel": Gel(modulus=modulus, poisson=0.3, thickness=0.002)})
    mesh, mass, angles = post(), 0.2, np.array([WIDTH / 2 + sensor.w - 0.0004])
    pose, faces = gripping_pose(0.0), box_faces(mesh.triangles)
    poses = sensor_poses(GRIPPER, pose, angles)
    contacts = [contact_from_depth(ray_depth(faces, at, sensor), at, sensor) for at in poses]
    assert contacts[0]
    force = with_force(contacts[0], faces, poses[0], sensor).force
    with HoldTest(replace(GRIPPER, torque=1e3), [sensor, sensor], mass=mass) as test:
        test.load(mesh, points_on(mesh, 2000, seed=0)[0])
        motion = test.hold(Grasp(pose, angles, angles, angles, poses, contacts), seconds=2.0)
        test.advance(0.25)
        forces, weight = test.forces(), mass * GRAVITY
    assert is_held(motion.moved, motion.speed) == (2 * GRIPPER.friction * force > -weight)
    if motion.moved < 0.01:
        np.testing.assert_allclose(forces.sum(axis=0), [0, 0, -weight], atol=0.02 * -weight)
        np.testing.assert_allclose(np.abs(forces[:2, 1]), force, rtol=0.1)
        np.testing.assert_allclose(forces[2], 0, atol=1e-9)  # rigid links do not touch


def test_force_of_an_elastic_gels_plate_is_the_contacts_with_its_slope_and_goes_on_straight() -> None:
    sensor = load_sensor("gelsight_mini")
    contact = Contact(np.zeros(3), np.zeros(3), area=1e-4, volume=5e-8, nearest=sensor.w - 0.001, force=5.0, stiffness=12000.0)
    spring = gel_spring(sensor, contact, friction=0.5)
    assert spring.force(spring.travel) == pytest.approx(5.0)
    assert (spring.force(spring.travel) - spring.force(spring.travel - 1e-7)) / 1e-7 == pytest.approx(12000, rel=1e-3)
    assert spring.force(2 * spring.travel) == pytest.approx(5.0 + 12000 * spring.travel)
    assert spring.force(0.0) == spring.force(-0.001) == 0
    assert spring.force(spring.travel - 5.0 / 12000) == pytest.approx(5.0 / 4)  # at half the depth
