"""The hand and the object in PyBullet."""

import resource
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.formats.hand_file import load_hand
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.hand.collision_shapes import collision_boxes
from pipeline.kernels.hand.model import Hand
from pipeline.kernels.hand.self_collision import close_links
from pipeline.physics import simulation
from pipeline.physics.hand_urdf import GEARED_INERTIA, write_hand_urdf
from pipeline.physics.simulation import COLLISION_MARGIN, GEAR_SLACK, GRAVITY, TREMOR, TREMOR_STEPS, PhysicsClient, Simulation, pybullet
from stages.simulate_grasps.prepare import FINGER_GAP, finger_gap
from tests.kernels.hand.meshes import centred, mug

STEP = 1 / 240


def test_ball_falls_with_gravity(hand: Hand) -> None:
    with Simulation(hand) as physics:
        physics.load(centred(trimesh.creation.box((0.1, 0.1, 0.1))))
        client = physics.client
        shape = client.createCollisionShape(pybullet.GEOM_SPHERE, radius=0.01)
        ball = client.createMultiBody(0.1, shape, basePosition=[0.5, 0.5, 3])
        client.changeDynamics(ball, -1, linearDamping=0)
        steps = 120
        for _ in range(steps):
            client.stepSimulation()
        height = client.getBasePositionAndOrientation(ball)[0][2]
        # Bullet steps velocities first: n (n + 1) / 2 steps instead of n² / 2
        assert height == pytest.approx(3 + GRAVITY * STEP**2 * steps * (steps + 1) / 2, abs=1e-5)


@pytest.mark.parametrize("subdivisions", [3, 6])
def test_object_collides_as_its_mesh_and_not_as_its_hull(hand: Hand, subdivisions: int) -> None:
    """Rays into two spheres and between them. Faces share no vertex, as in an STL: the finer has too many for one shape."""
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.05)
    sphere.unmerge_vertices()
    mesh = centred(sphere.copy().apply_translation([-0.1, 0, 0]), sphere.copy().apply_translation([0.1, 0, 0]))
    with Simulation(hand) as physics:
        physics.load(mesh)
        starts = np.array([[-0.1, 0, 1], [0.0, 0, 1], [0.1, 0.002, 1]])
        hits = physics.client.rayTestBatch(starts.tolist(), (starts - [0, 0, 0.8]).tolist())
        assert [hit[0] >= 0 for hit in hits] == [True, False, True]
        assert hits[0][3][2] == pytest.approx(0.65, abs=1e-3)


def test_fingers_reach_a_free_target_and_rest(hand: Hand) -> None:
    far = np.eye(4)
    far[:3, 3] = [1, 1, 1]
    target = np.clip(np.full(16, 0.4), hand.lower, hand.upper)
    target[[0, 4, 8]] = 0
    with Simulation(hand) as physics:
        physics.load(mug())
        angles, rests = physics.settle(far, target - 0.1, target, max_steps=400, resting_speed=2e-3)
        assert rests
        np.testing.assert_allclose(angles, target, atol=2e-3)
        for _ in range(500):
            physics.client.stepSimulation()
        later, _ = physics._body.joint_states()
        np.testing.assert_allclose(later, angles, atol=2e-3)


def test_sliding_fingers_rest_as_near_to_their_target_as_turning_fingers(pincers: Hand) -> None:
    """In a step they go three tenths of the way that is left: when they rest, that is below a micrometre."""
    target = np.full(2, 0.05)
    with Simulation(pincers) as physics:
        physics.load(centred(trimesh.creation.box((0.001, 0.001, 0.001))))
        angles, rests = physics.settle(np.eye(4), target - 0.02, target, max_steps=400, resting_speed=2e-3)
    assert rests
    np.testing.assert_allclose(angles, target, atol=3e-6)


def test_fingers_stop_at_the_object(hand: Hand) -> None:
    """Sent 6 cm into a plate, all fingers stay out of it."""
    plate = centred(trimesh.creation.box((0.3, 0.3, 0.02)))
    pose = np.eye(4)
    pose[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # palm down
    pose[:3, 3] = [0, 0, 0.68]
    start = np.zeros(16)
    start[12] = hand.lower[12]
    target = start.copy()
    target[[1, 5, 9]] = 1.2
    with Simulation(hand) as physics:
        physics.load(plate)
        angles, _ = physics.settle(pose, start, target, max_steps=400, resting_speed=2e-3)
        assert (angles[[1, 5, 9]] < 0.9).all()
        assert (angles[[1, 5, 9]] > 0.2).all()
        assert min((point[8] for point in physics.client.getContactPoints()), default=0) > -1e-3


def test_client_prints_nothing(hand: Hand, capfd: pytest.CaptureFixture[str]) -> None:
    with Simulation(hand):
        pass
    assert capfd.readouterr() == ("", "")


def test_loaded_objects_release_their_memory(hand: Hand) -> None:
    """PyBullet keeps its input lists: new lists would cost 0.2 MB per object of 1280 faces."""
    mesh = centred(trimesh.creation.icosphere(subdivisions=3, radius=0.05))
    with Simulation(hand) as physics:
        sizes = []
        for _ in range(100):
            physics.load(mesh)
            sizes.append(int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize())
    assert sizes[-1] - sizes[20] < 5e6


CHAIN = """<robot name="chain"><link name="palm"/>
<link name="near"><collision><origin xyz="0.02 0 0"/><geometry><box size="0.03 0.01 0.01"/></geometry></collision></link>
<link name="far"><collision><origin xyz="0.02 0 0"/><geometry><box size="0.03 0.01 0.01"/></geometry></collision></link>
<joint name="bend" type="revolute"><parent link="palm"/><child link="near"/><axis xyz="0 1 0"/>
<limit lower="0" upper="1.5" effort="1" velocity="1"/></joint>
<joint name="follow" type="revolute"><parent link="near"/><child link="far"/><origin xyz="0.04 0 0"/><axis xyz="0 1 0"/>
<limit lower="0" upper="1.5" effort="1" velocity="1"/><mimic joint="bend" multiplier="1.05" offset="0"/></joint></robot>"""


CHAIN_HAND = """{name: chain, urdf: chain.urdf, sensor: gel_16mm, torque: 0.5, palm: {link: palm, facing: [0, 0, -1], centre: [0.04, 0, 0]},
fingers: [{name: finger, joints: [bend], sensor: {link: far, origin: [0.02, 0, -0.005], normal: [0, 0, -1], columns: [0, 1, 0]}}]}"""


def load_chain(folder: Path) -> Hand:
    (folder / "chain.urdf").write_text(CHAIN)
    (folder / "chain.yaml").write_text(CHAIN_HAND)
    return load_hand(folder / "chain.yaml")


def test_mimic_joint_of_a_finger_does_not_sag(tmp_path: Path) -> None:
    """Bent freely; with the gear between two branches, gravity leaves the tip 5 mrad off."""
    far = np.eye(4)
    far[:3, 3] = [1, 1, 1]
    with Simulation(load_chain(tmp_path)) as physics:
        physics.load(mug())
        angles, rests = physics.settle(far, np.array([0.1]), np.array([0.34]), max_steps=400, resting_speed=2e-3)
        names = {physics.client.getJointInfo(1, number)[1]: number for number in range(2)}
        tip = physics.client.getJointState(1, names[b"follow"])[0]
    assert rests
    assert tip == pytest.approx(1.05 * angles[0], abs=2e-3)


def test_coupled_joints_have_the_inertia_of_rotors(tmp_path: Path) -> None:
    """Both of a pair, besides that of their links, which are some 1e-6 kg m²; a hand without followers keeps its own."""
    coupled, free = load_chain(tmp_path), replace(load_chain(tmp_path), followers=())
    matrices = []
    for number, hand in enumerate((coupled, free)):
        (folder := tmp_path / str(number)).mkdir()
        client = PhysicsClient()
        body = client.loadURDF(str(write_hand_urdf(hand, folder)), flags=pybullet.URDF_USE_INERTIA_FROM_FILE, useFixedBase=True)
        matrices.append(np.array(client.calculateMassMatrix(body, [0.2, 0.2])))
        client.disconnect()
    assert matrices[0] - matrices[1] == pytest.approx(np.array([[2, 1], [1, 1]]) * GEARED_INERTIA, rel=1e-4)


def test_trembling_hand_rests_where_all_joints_stay_within_the_tremor(tmp_path: Path) -> None:
    """Two steps here, two there, as gear and contact correct each other; one joint that leaves, follower or not, moves."""
    with Simulation(load_chain(tmp_path)) as physics:
        physics.load(mug())
        tremor = np.array([[0.3, 0.315], [0.302, 0.318]] * (TREMOR_STEPS // 2))
        assert physics._body.trembles(tremor, 2e-3)
        assert not physics._body.trembles(tremor[1:], 2e-3)
        for joint in range(2):
            moving = tremor.copy()
            moving[:, joint] += np.linspace(0, TREMOR / 4, TREMOR_STEPS)  # a drift of 6e-3 rad/s
            assert not physics._body.trembles(moving, 2e-3)
        assert physics._body.gears_hold(tremor.mean(axis=0))
        assert not physics._body.gears_hold(np.array([0.3, 0.315 + 1.1 * GEAR_SLACK]))


GAP = 0.0008
FINGER = """<link name="{0}"><inertial><origin xyz="0 0 0.03"/><mass value="0.01"/>
<inertia ixx="3e-6" iyy="3e-6" izz="3e-7" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><mesh filename="finger.obj"/></geometry></collision></link>
<joint name="{0}" type="revolute"><parent link="palm"/><child link="{0}"/><origin xyz="{1} 0 0" rpy="0 {2} 0"/><axis xyz="1 0 0"/>
<limit lower="0" upper="1.5" effort="1" velocity="1"/></joint>"""
HAND = """{name: pair, urdf: pair.urdf, sensor: gel_16mm, torque: 1, palm: {link: palm, facing: [0, -1, 0], centre: [0, 0, 0]},
fingers: [
{name: left, joints: [left], sensor: {link: left, origin: [0, -0.005, 0.05], normal: [0, -1, 0], columns: [1, 0, 0]}},
{name: right, joints: [right], sensor: {link: right, origin: [0, -0.005, 0.05], normal: [0, -1, 0], columns: [1, 0, 0]}}]}"""


def load_pair(folder: Path, gap: float) -> Hand:
    """Load two fingers, 1 cm wide, whose sides are `gap` m apart and which lean towards each other by 0.1 degrees."""
    trimesh.creation.box((0.01, 0.01, 0.06), trimesh.transformations.translation_matrix([0, 0, 0.03])).export(folder / "finger.obj")
    fingers = "".join(FINGER.format(name, way * (0.005 + gap / 2), -way * 0.0017) for name, way in (("left", -1), ("right", 1)))
    (folder / "pair.urdf").write_text(f'<robot name="pair"><link name="palm"/>{fingers}</robot>')
    (folder / "pair.yaml").write_text(HAND)
    return load_hand(folder / "pair.yaml")


def settled(hand: Hand) -> np.ndarray:
    target = np.array([0.3, 0.31])
    with Simulation(hand) as physics:
        physics.load(centred(trimesh.creation.box((0.01, 0.01, 0.01))))
        angles, _ = physics.settle(np.eye(4), target - 0.2, target, max_steps=400, resting_speed=2e-3)
    return np.abs(angles - target)


def test_fingers_side_by_side_are_not_pushed_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hand = load_pair(tmp_path, GAP)
    assert settled(hand).max() < 2e-3
    monkeypatch.setattr(simulation, "HULL_MARGIN", 0.0)
    simulation._untested_pairs.cache_clear()
    assert settled(hand).max() > 2e-3  # as without the rule
    simulation._untested_pairs.cache_clear()


def test_finger_gap_is_at_most_half_of_the_gap_at_rest(tmp_path: Path, hand: Hand) -> None:
    near = load_pair(tmp_path, GAP)
    gaps = close_links(near, collision_boxes(near), 2 * FINGER_GAP)
    assert list(gaps) == [(1, 2)]
    assert 0 < gaps[1, 2] < GAP
    assert finger_gap(near) == gaps[1, 2] / 2
    assert finger_gap(hand) == FINGER_GAP


@pytest.mark.parametrize(
    "shape", ['<mesh filename="cube.stl"/>', '<cylinder radius="0.01" length="0.02"/>', '<box size="0.02 0.02 0.02"/>']
)
def test_contact_with_a_link_begins_at_its_surface(shape: str, tmp_path: Path) -> None:
    """Bullet thickens hulls and cylinders of a URDF by 1 mm, so that links that planning keeps 1 mm clear would push."""
    trimesh.creation.box((0.02, 0.02, 0.02)).export(tmp_path / "cube.stl")
    described = load_hand("two_finger_gripper")
    box = '<box size="0.06 0.17 0.05"/>'
    text = described.model.read_text()
    assert box in text
    (tmp_path / "two_finger_gripper.urdf").write_text(text.replace(box, shape))
    (tmp_path / "hand.yaml").write_text(described.path.read_text())
    hand = load_hand(tmp_path / "hand.yaml")
    low = np.concatenate([item.mesh.vertices for item in hand.links[0].collisions])[:, 0].min()
    wall = trimesh.creation.box((0.01, 1.0, 1.0), transform=trimesh.transformations.translation_matrix([low - 0.015, 0, 0]))
    with Simulation(hand) as physics:
        physics.load(Mesh.bare(np.asarray(wall.vertices), np.asarray(wall.faces)))
        physics._body.set_pose(np.eye(4), hand.lower, hand.lower)
        points = physics.client.getClosestPoints(physics._body.body, 0, 0.1, linkIndexA=-1)
    assert min(point[8] for point in points) == pytest.approx(0.01 - COLLISION_MARGIN, abs=5e-5)
