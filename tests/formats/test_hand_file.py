"""Hand files and their URDFs are found by name or path; unusable entries are named; shipped hands besides the right Allegro."""

import os
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
import yaml
from scipy.spatial.transform import Rotation

from pipeline.errors import InvalidInput
from pipeline.formats import hand_file
from pipeline.formats.description_file import description_path
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_worn_sensors, sensor_names
from pipeline.formats.urdf import read_urdf
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses
from pipeline.kernels.hand.model import Hand
from pipeline.physics.simulation import Simulation
from tests.kernels.hand.meshes import centred


@pytest.fixture(scope="module")
def hand() -> Hand:
    return load_hand("allegro_right")


def test_hand_file_finds_links_and_joints_of_another_urdf_by_name(hand: Hand, tmp_path: Path, rng: np.random.Generator) -> None:
    """The URDF has other names, another order of links, and spheres in place of visual meshes."""
    text = hand.model.read_text()
    text = text.replace("link_", "l-").replace("joint_", "j-").replace("base_link", "palm")
    text = re.sub(r'<mesh filename="[^"]*"/>', '<sphere radius="0.01"/>', text)
    body = re.findall(r"  <link .*?</link>\n", text, re.S)
    for link in body:
        text = text.replace(link, "")
    text = text.replace("</robot>", "".join(reversed(body)) + "</robot>")
    (tmp_path / "other.urdf").write_text(text)
    file = yaml.safe_load(hand.path.read_text())
    renamed = yaml.safe_dump(file).replace("link_", "l-").replace("joint_", "j-").replace("base_link", "palm")
    path = tmp_path / "other.yaml"
    path.write_text(renamed.replace("allegro_right.urdf", "other.urdf"))
    other = load_hand(path)
    angles = rng.uniform(hand.lower, hand.upper)
    np.testing.assert_array_equal(sensor_poses(other, np.eye(4), angles), sensor_poses(hand, np.eye(4), angles))
    assert {mesh.vertices.shape for _, mesh in other.visual_meshes} == {(642, 3)}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("joint_2.0", "joint_99", "allegro_right.urdf: there is no moving joint 'joint_99'; there are joint_0.0"),
        ("link_3.0_tip", "link_3", "allegro_right.urdf: there is no sensor link 'link_3'"),
        ("link_3.0_tip", "link_7.0_tip", "'link_7.0_tip' is not moved by the joints of finger 'index'"),
        ("joint_4.0", "joint_0.0", "every moving joint must belong to one finger, or be frozen; this is not so for joint_0.0"),
        ("joint_0.0, ", "", "joint_0.0 belong to no finger; list them under a finger's joints, or freeze them: {joint_0.0: 0}"),
        ("fingers:", "allowed_contacts: [[link_0.0, link_9]]\nfingers:", "there is no link 'link_9'"),
        ("fingers:", "convex_parts: {link_9: 3}\nfingers:", "there is no link 'link_9'"),
        ("normal: [1, 0, 0]", "normal: [0, 1, 0.1]", "and columns (0.0, 1.0, 0.0) are 5.7° apart; make it 90°"),
        ("model: allegro_right.urdf", "model: nowhere.urdf", "there is no model 'nowhere.urdf'"),
        ("model: allegro_right.urdf", "model: a.urdf\nurdf: b.urdf", "`urdf` is the older name of `model`: keep one of the two"),
        ("palm:", "palms:", "palms"),
        ("name: index", 'name: "my/index"', "fingers.0.name: String should match pattern"),
        (
            "  centre:",
            "  sensors: [{link: link_3.0_tip, origin: [0, 0, 0], normal: [1, 0, 0], columns: [0, 1, 0]}]\n  centre:",
            "palm: finger 'index' moves the link of sensor 'palm'; list the sensor under that finger",
        ),
        ("joints: [joint_0.0,", "joints: [0,", "fingers.0.joints.0: it must be text (it is 0); put it in quotes"),
        ("joints: [joint_0.0,", "joints: [yes,", "fingers.0.joints.0: it must be text (it is True); put it in quotes"),
        ("joints: [joint_0.0,", "joints: [2026-01-01,", "it must be text (it is the date 2026-01-01); put it in quotes"),
        ("joints: [joint_0.0,", "joints: [[0],", "fingers.0.joints.0: it must be text. The file's entries"),
        ("link: base_link", "link: link_99", "there is no link 'link_99'"),
        ("link: base_link", "link: link_0.0", "there is no moving joint 'joint_0.0'; there are joint_1.0, joint_2.0, joint_3.0"),
    ],
)
def test_unusable_hand_file_is_refused_with_the_entry(hand: Hand, tmp_path: Path, old: str, new: str, message: str) -> None:
    text = hand.path.read_text().replace(old, new, 1)
    path = tmp_path / "wrong.yaml"
    path.write_text(text.replace("model: allegro_right.urdf", f"model: {hand.model}"))
    with pytest.raises(InvalidInput, match=re.escape(message)) as error:
        load_hand(path)
    assert str(path) in str(error.value)


def test_rounded_directions_of_a_sensor_are_made_perpendicular(hand: Hand, tmp_path: Path) -> None:
    turn = Rotation.from_euler("xyz", [0.3, 0.5, 0.7]).as_matrix()
    normal, columns = ([round(float(value), 3) for value in turn[:, axis]] for axis in (2, 0))
    text = hand.path.read_text().replace("normal: [1, 0, 0], columns: [0, 1, 0]", f"normal: {normal}, columns: {columns}", 1)
    (path := tmp_path / "turned.yaml").write_text(text.replace("model: allegro_right.urdf", f"model: {hand.model}"))
    read = load_hand(path).sensors[0].pose[:3, :3]
    np.testing.assert_allclose(read.T @ read, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(read, turn, atol=2e-3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (r'axis xyz="[^"]*"', 'axis xyz="0 0 0"', "has the axis 0 0 0"),
        (r'axis xyz="[^"]*"', 'axis xyz="nan 0 1"', "'nan 0 1'> must hold 3 finite numbers"),
        (r'upper="[^"]*"', 'upper="inf"', "<limit upper='inf'> must hold 1 finite numbers"),
        (r'lower="[^"]*"', 'lower="9"', "the lower one must be the smaller"),
        (r'type="revolute"', 'type="planar"', "is of type 'planar'; supported are revolute"),
        (r'<parent link="[^"]*"', '<parent link="nowhere"', "has parent link 'nowhere'"),
        (r'<child link="[^"]*"', '<child link="base_link"', "are not a tree with one root"),
        (r'filename="[^"]*"', 'filename="nowhere.obj"', "nowhere.obj cannot be read (No such file or directory)"),
        (r'filename="[^"]*"', 'filename="odd.urdf"', "cannot be read"),
        (r'mass value="[^"]*"', 'mass value="-0.1"', "link base_link has the mass -0.1 kg; give a positive one, or none"),
        (r'inertia ixx="[^"]*"', 'inertia ixx="nan"', "<inertia ixx='nan'> must hold 1 finite numbers"),
        (r"</robot>", '<link name="base_link"/></robot>', "it has 2 links called 'base_link'; rename all but one"),
        (r"<visual><origin", '<visual><origin rpy="0 0"', "'0 0'> must hold 3 finite numbers"),
        (r'<collision><origin xyz="[^"]*"', '<collision><origin xyz="0 0 1e999"', "must hold 3 finite numbers"),
        (r'box size="[^"]*"', 'box size="1 2 0"', "give positive metres"),
        (r'box size="[^"]*"', 'box size="1 2 1e300"', "none beyond 1e+06"),
        (r'filename="[^"]*"', f'filename="{"x" * 300}.obj"', "cannot be read (File name too long)"),
        (r"<robot", '<!DOCTYPE x [<!ENTITY a "b">]><robot', "declares a document type or entities"),
        (r"</robot>", "<link/>" * 1001 + "</robot>", "links, joints and shapes, 1000 are the most"),
        (r"</robot>", " " * 11_000_000 + "</robot>", "bytes; 10485760 are the most"),
    ],
)
def test_unusable_urdf_is_refused_with_the_part(hand: Hand, tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "odd.urdf"
    shutil.copytree(hand.model.parent / "allegro_right", tmp_path / "allegro_right")
    path.write_text(re.sub(old, new, hand.model.read_text(), count=1))
    with pytest.raises(InvalidInput, match=re.escape(message)) as error:
        read_urdf(path)
    assert str(path) in str(error.value)


def test_each_finger_may_wear_its_own_sensor(hand: Hand, tmp_path: Path) -> None:
    """Shipped sensors are given by name, others by a path from the hand file; a missing sensor is an error."""
    file = yaml.safe_load(hand.path.read_text()) | {"model": str(hand.model)}
    file["fingers"][1]["sensor"]["file"] = "gels/soft.yaml"
    path = tmp_path / "hand.yaml"
    path.write_text(yaml.safe_dump(file))
    worn = [mount.sensor for mount in load_hand(path).sensors]
    assert worn == ["gel_16mm", str(tmp_path / "gels" / "soft.yaml"), "gel_16mm", "gel_16mm"]
    del file["sensor"]
    path.write_text(yaml.safe_dump(file))
    with pytest.raises(InvalidInput, match=r"sensor 'index' has no sensor file; name one as its `file`"):
        load_hand(path)


def test_sensors_of_one_hand_need_the_same_pixels(tmp_path: Path) -> None:
    coarse = tmp_path / "coarse.yaml"
    coarse.write_text(description_path("sensor", "gel_16mm").read_text().replace("rows: 100", "rows: 50"))
    with pytest.raises(InvalidInput, match=r"same rows and columns of pixels, but gel_16mm has 100 x 100, .*coarse.yaml has 50 x 100"):
        load_worn_sensors(["gel_16mm", str(coarse)])


def test_elastic_gels_on_some_sensors_of_a_hand_are_refused_before_it_grasps(tmp_path: Path) -> None:
    soft = tmp_path / "soft.yaml"
    soft.write_text(description_path("sensor", "gel_16mm").read_text() + "gel: {modulus: 1.0e+5}\n")
    with pytest.raises(InvalidInput, match=r"of .*soft.yaml but not of gel_16mm; give all sensors a `gel`, or none"):
        load_worn_sensors(["gel_16mm", str(soft)])


@pytest.mark.parametrize("ending", [".yaml", ".yml"])
def test_sensor_for_all_fingers_is_found_from_any_folder(hand: Hand, ending: str) -> None:
    assert set(sensor_names(hand, f"gel{ending}")) == {str(Path(f"gel{ending}").absolute())}


def test_materials_and_textures_of_meshes_are_files_of_the_hand(hand: Hand, tmp_path: Path) -> None:
    """Files that change its images are part of their keys."""
    shutil.copytree(hand.model.parent, tmp_path / "hand")
    mesh = tmp_path / "hand" / "skin.obj"
    mesh.write_text("mtllib skin.mtl\nv 0 0 0\nv 0.01 0 0\nv 0 0.01 0\nv 0 0 0.01\nusemtl skin\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    (material := mesh.with_suffix(".mtl")).write_text("newmtl skin\nKd 0.5 0.2 0.1\n")
    urdf = tmp_path / "hand" / hand.model.name
    urdf.write_text(re.sub(r'<mesh filename="[^"]*"/>', '<mesh filename="skin.obj"/>', urdf.read_text(), count=1))
    path = shutil.copy(hand.path, tmp_path / "hand")
    assert {mesh.resolve(), material.resolve()} <= {file.resolve() for file in load_hand(path).files}


FAR = np.eye(4)
FAR[:3, 3] = [1, 1, 1]


def test_left_hand_mirrors_the_right_hand(rng: np.random.Generator) -> None:
    right, left = load_hand("allegro_right"), load_hand("allegro_left")
    for angles in rng.uniform(right.lower, right.upper, (5, len(right.lower))):
        links = [forward_kinematics(hand, np.eye(4), angles) for hand in (right, left)]
        mirror = np.diag([1.0, -1, 1, 1])
        np.testing.assert_allclose(links[1], mirror @ links[0] @ mirror, atol=1e-12)
        sensors = [sensor_poses(hand, np.eye(4), angles) for hand in (right, left)]
        np.testing.assert_allclose(sensors[1][:, :3, 3], sensors[0][:, :3, 3] * [1, -1, 1], atol=1e-12)


@pytest.mark.parametrize("name", ["allegro_right", "allegro_right_mini"])
def test_drawn_gels_are_as_large_as_the_sensors_and_lie_on_their_planes(name: str) -> None:
    hand = load_hand(name)
    for mount, sensor in zip(hand.sensors, load_worn_sensors(sensor_names(hand)), strict=True):
        gel = hand.links[mount.link].visuals[-1].mesh.vertices
        local = (gel - mount.pose[:3, 3]) @ mount.pose[:3, :3]
        half = np.array([sensor.width, sensor.height]) / 2
        np.testing.assert_allclose([local.min(axis=0), local.max(axis=0)], [[*-half, 0], [*half, sensor.w]], atol=2e-5)


def test_gripper_is_one_finger_with_two_sensors() -> None:
    hand = load_hand("two_finger_gripper")
    (finger,) = hand.fingers
    assert (finger.name, finger.joints, finger.sensors) == ("left+right", (0,), (0, 1))
    assert [mount.name for mount in hand.sensors] == ["left", "right"]
    left, right = sensor_poses(hand, np.eye(4), np.array([0.02]))[:, :3, 3]
    np.testing.assert_allclose([left, right], [[0, 0.02, 0.082], [0, -0.02, 0.082]], atol=1e-12)


@pytest.mark.parametrize("blocked", [False, True])
def test_follower_stays_with_its_leader_in_physics(blocked: bool) -> None:
    """Test free fingers and a block that stops only the right finger: the motor of the left one cannot push on."""
    hand = load_hand("two_finger_gripper")
    block = centred(trimesh.creation.box((0.02, 0.02, 0.02)))
    with Simulation(hand) as physics:
        physics.load(block)
        pose = FAR if not blocked else np.eye(4)
        if blocked:
            pose[:3, 3] = [0, 0.04, 0.6 - 0.08]  # the block's far side is 3 cm on the right finger's side of the middle
        start, target = np.array([0.06]), np.array([0.01])
        angles, rests = physics.settle(pose, start, target, max_steps=800, resting_speed=2e-3)
        states = [physics.client.getJointState(physics._body.body, joint)[0] for joint in range(2)]
    assert rests
    assert states[1] == pytest.approx(angles[0], abs=1e-3)
    if blocked:
        assert 0.04 < angles[0] < 0.052
    else:
        assert angles[0] == pytest.approx(0.01, abs=1e-3)


def test_hand_is_kept_between_runs_until_a_file_changes_or_another_appears(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A hand with a mesh that names a missing file is not kept."""
    file, mesh = tmp_path / "hand" / "hand.yaml", tmp_path / "hand" / "meshes" / "palm.stl"
    mesh.parent.mkdir(parents=True)
    for path in (file, mesh):
        path.write_text("old")
    os.utime(mesh.parent, (0, 0))
    links = []
    hand, loaded = SimpleNamespace(files=[file, mesh], links=links), []
    monkeypatch.setattr(hand_file, "_read", lambda path: loaded.append(path) or hand)
    monkeypatch.setattr(hand_file, "KEPT", tmp_path / "kept" / "hands.pickle")

    def lacks_material() -> None:
        mesh.touch()
        links.append(SimpleNamespace(visuals=[SimpleNamespace(mesh=SimpleNamespace(unread=["palm.mtl"]))], collisions=[]))

    changes = (lambda: None, lambda: None, lambda: mesh.write_text("another"), mesh.with_suffix(".mtl").touch, lacks_material, lambda: None)
    for change, times in zip(changes, (1, 1, 2, 3, 4, 5), strict=True):
        change()
        monkeypatch.setattr(hand_file, "_cached", {})  # as in another process
        assert load_hand(file) == hand
        assert len(loaded) == times
