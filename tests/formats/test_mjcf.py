"""MJCF hands: links move as MuJoCo moves bodies, shapes lie where its geoms lie, and what cannot be read is named."""

import re
import tracemalloc
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import PIL.Image
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand, read_model
from pipeline.formats.mjcf import parse_mjcf
from pipeline.formats.mjcf_files import is_mjcf
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.physics.hand_urdf import write_hand_urdf
from pipeline.physics.simulation import PhysicsClient

HAND = """
name: claw
model: model/claw.xml
sensor: gel_16mm
palm: {link: palm, facing: [0, 0, 1], centre: [0, 0, 0.03]}
frozen: {wrist: 0.3}
fingers:
  - {name: left, joints: [spread, left1, left-slide], sensor: {link: left-tip, origin: [0, 0, 0.05], normal: [1, 0, 0], columns: [0, 1, 0]}}
  - {name: right, joints: [right1, right2], sensor: {link: right-tip, origin: [0, 0, 0.05], normal: [-1, 0, 0], columns: [0, 1, 0]}}
"""
MAIN = """
<mujoco model="claw">
  <compiler meshdir="meshes" texturedir="meshes" eulerseq="zyx"/>
  <default>
    <joint damping="0.1"/>
    <default class="tip"><geom type="mesh" mesh="tip" material="red"/></default>
    <default class="hinge"><joint axis="0 1 0" range="-20 90"/></default>
  </default>
  <asset>
    <mesh name="tip" file="tip.stl" scale="0.001 0.001 0.002" refpos="1 2 3" refquat="1 1 0 0"/>
    <texture name="skin" type="2d" file="skin.png"/>
    <material name="red" texture="skin" rgba="1 0.5 0.5 1"/>
  </asset>
  <worldbody>
    <light pos="0 0 1"/>
    <body name="arm" pos="0.3 0.2 0.1" euler="10 20 30">
      <freejoint/>
      <geom size="0.05"/>
      <body name="palm" pos="0.1 0 0" quat="0.3 0.4 0.5 0.6" childclass="hinge">
        <joint name="shoulder"/>
        <geom type="box" size="0.03 0.02 0.01" pos="0 0 -0.01" euler="0 0 40"/>
        <camera name="eye" pos="0 0 1"/>
        <site name="grip"/>
        <include file="left.xml"/>
        <body name="right" pos="-0.03 0 0.01" axisangle="0 0 1 170">
          <joint name="right1" pos="0.002 0.001 -0.003" ref="15"/>
          <joint name="right2" axis="1 1 0" pos="-0.001 0 0.004" ref="-5"/>
          <geom type="capsule" fromto="0 0 0 0.005 0 0.03" size="0.008"/>
          <body name="right-tip" pos="0 0 0.03">
            <joint name="right3" ref="20" range="-90 90"/>
            <geom class="tip" pos="0 0.001 0.01" quat="1 0.2 0 0"/>
            <geom type="ellipsoid" size="0.01 0.012 0.02"/>
          </body>
        </body>
        <body name="stump" pos="0 0.03 0" xyaxes="0 1 0 -1 0 0"><geom type="cylinder" size="0.01 0.02" contype="0" group="4"/></body>
      </body>
    </body>
    <body name="object" pos="0 0 1"><freejoint/><geom size="0.1"/></body>
  </worldbody>
  <tendon><fixed name="pull"><joint joint="left1" coef="2"/><joint joint="left2" coef="-1"/></fixed>
    <fixed name="loose" range="0 1"><joint joint="left1" coef="1"/><joint joint="spread" coef="1"/></fixed></tendon>
  <equality>
    <joint joint1="right3" joint2="right2" polycoef="0.1 0.5 0 0 0"/>
    <joint joint1="left1" joint2="spread" active="false"/>
  </equality>
  <contact><exclude body1="right-tip" body2="left"/><exclude body1="object" body2="left"/></contact>
  <actuator>
    <position joint="spread" kp="1" forcerange="-3 3"/>
    <motor tendon="pull" gear="0.25" forcerange="-1 1"/>
    <position joint="right1" kp="1"/>
    <position joint="right2" kp="1" forcerange="-2 2"/>
  </actuator>
  <keyframe><key/></keyframe>
</mujoco>
"""
LEFT = """
<mujocoinclude>
  <body name="left" pos="0.03 0 0.01">
    <joint name="wrist" axis="0 0 1" range="-45 45"/>
    <joint name="spread" axis="1 0 0" range="-20 20"/>
    <joint name="left1"/>
    <geom type="sphere" size="0.01"/>
    <include file="parts/tip.xml"/>
  </body>
</mujocoinclude>
"""
TIP = """
<mujocoinclude>
  <body name="left-tip" pos="0 0 0.03">
    <joint name="left2" range="-180 180"/>
    <joint name="left-slide" type="slide" axis="0 0 2" range="0 0.02" ref="0.01"/>
    <geom class="tip" type="mesh"/>
    <geom class="tip" contype="0" conaffinity="0" rgba="0 0 1 1"/>
  </body>
</mujocoinclude>
"""


@pytest.fixture(scope="module")
def claw(tmp_path_factory: pytest.TempPathFactory) -> Hand:
    return load_hand(write_claw(tmp_path_factory.mktemp("claw")))


def write_claw(folder: Path) -> Path:
    (folder / "model" / "meshes").mkdir(parents=True)
    (folder / "model" / "parts").mkdir()
    (folder / "model" / "claw.xml").write_text(MAIN)
    (folder / "model" / "left.xml").write_text(LEFT)
    (folder / "model" / "parts" / "tip.xml").write_text(TIP)
    trimesh.creation.cone(radius=8, height=15, sections=9).export(folder / "model" / "meshes" / "tip.stl")
    PIL.Image.new("RGB", (4, 4), (200, 100, 50)).save(folder / "model" / "meshes" / "skin.png")
    (folder / "hand.yaml").write_text(HAND)
    return folder / "hand.yaml"


def posed(hand: Hand, angles: Sequence[float]) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Give MuJoCo's model of a hand a posture."""
    model = mujoco.MjModel.from_xml_path(str(hand.model))
    data = mujoco.MjData(model)
    set_posture(hand, data, angles)
    mujoco.mj_kinematics(model, data)
    return model, data


def set_posture(hand: Hand, data: mujoco.MjData, angles: Sequence[float]) -> None:
    values = dict(zip(hand.joint_names, angles, strict=True)) | dict(hand.frozen)
    values |= {hand.joints[follower.link - 1].name: float(follower.of(np.asarray(angles))) for follower in hand.followers}
    for name, value in values.items():
        data.joint(name).qpos = value


def pose_of(body: mujoco.MjData) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = body.xmat.reshape(3, 3), body.xpos
    return pose


def test_links_are_where_mujoco_has_its_bodies(claw: Hand, rng: np.random.Generator) -> None:
    model = mujoco.MjModel.from_xml_path(str(claw.model))
    data = mujoco.MjData(model)
    angles = rng.uniform(claw.lower, claw.upper, (1000, len(claw.lower)))
    bodies = {number: link.name for number, link in enumerate(claw.links) if "/" not in link.name}
    assert list(bodies.values()) == ["palm", "left", "left-tip", "right", "right-tip", "stump"]
    frames = forward_kinematics(claw, np.eye(4), angles)
    for posture, expected in zip(angles, frames, strict=True):
        set_posture(claw, data, posture)
        mujoco.mj_kinematics(model, data)
        palm = np.linalg.inv(pose_of(data.body("palm")))
        for number, name in bodies.items():
            np.testing.assert_allclose(palm @ pose_of(data.body(name)), expected[number], atol=1e-8)


def test_points_of_shapes_lie_in_mujocos_geoms(claw: Hand) -> None:
    model, data = posed(claw, [*(claw.lower + claw.upper) / 2])
    frames = forward_kinematics(claw, pose_of(data.body("palm")), (claw.lower + claw.upper) / 2)
    for number, link in enumerate(claw.links):
        if "/" in link.name:
            continue
        body = model.body(link.name).id
        geoms = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == body and model.geom_contype[geom]]
        for shape, geom in zip(link.collisions, geoms, strict=True) if link.name != "stump" else []:
            points = transform_points(frames[number], shape.mesh.vertices)
            local = (points - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
            low, high = model.geom_aabb[geom, :3] - model.geom_aabb[geom, 3:], model.geom_aabb[geom, :3] + model.geom_aabb[geom, 3:]
            np.testing.assert_allclose(local.min(axis=0), low, atol=1e-3 * (high - low).max())
            np.testing.assert_allclose(local.max(axis=0), high, atol=1e-3 * (high - low).max())


def test_joints_that_a_motor_or_an_equality_couples_follow_one_of_them(claw: Hand) -> None:
    """`right3` − 20° = 0.1 + 0.5 (`right2` + 5°); `left1` and `left2` move by 2 to −1, as their tendon is pulled."""
    followers = {claw.joints[follower.link - 1].name: follower for follower in claw.followers}
    assert followers.keys() == {"right3", "left2"}
    right, left = followers["right3"], followers["left2"]
    assert (claw.joint_names[right.entry], right.multiplier) == ("right2", 0.5)
    assert right.offset == pytest.approx(np.radians(20) + 0.1 + 0.5 * np.radians(5))
    assert (claw.joint_names[left.entry], left.multiplier, left.offset) == ("left1", -0.5, 0)


def test_weakest_actuator_limits_torque(claw: Hand) -> None:
    """The motor pulls `left2` with 0.25 N m, `left1` with 0.5 N m."""
    assert claw.torque == 0.25


def test_what_is_seen_of_a_link_are_its_geoms_for_the_eye_alone(claw: Hand) -> None:
    shapes = {link.name: ([shape.kind for shape in link.visuals], [shape.kind for shape in link.collisions]) for link in claw.links}
    assert shapes["left-tip"] == (["mesh"], ["mesh"])
    assert shapes["right-tip"] == (["mesh", "mesh"], ["mesh", "mesh"])
    assert shapes["stump"] == ([], ["cylinder"])  # of group 4
    colors = {link.name: link.visuals[0].mesh.look.base_color[0, :3].tolist() for link in claw.links if link.visuals}
    assert colors["left-tip"] == [0, 0, 255]
    assert colors["right-tip"] == [255, 128, 128]


def test_links_that_an_mjcf_excludes_from_contact_may_overlap(claw: Hand) -> None:
    names = [link.name for link in claw.links]
    assert (names.index("left"), names.index("right-tip")) in claw.allowed_contacts
    assert (names.index("left-tip"), names.index("right-tip")) not in claw.allowed_contacts


def test_files_that_an_mjcf_names_belong_to_the_hand(claw: Hand) -> None:
    folder = claw.path.parent
    assert {file.relative_to(folder).as_posix() for file in claw.files} == {
        "hand.yaml",
        "model/claw.xml",
        "model/left.xml",
        "model/parts/tip.xml",
        "model/meshes/tip.stl",
        "model/meshes/skin.png",
    }


def test_check_says_what_is_ignored(claw: Hand) -> None:
    text = "\n".join(read_model(claw.model, "palm").notes)
    for part in (
        "grasps do not need are ignored: cameras (1), lights (1), sites (1), keys (1), textures (1)",
        "dynamics of joints, which suit the MJCF's own motors, are ignored: damping",
        "tendons that no actuator pulls and no equality ties are ignored: loose",
        "equalities that are not active are ignored: equality-1",
        "one motor moves left1 and left2 by a tendon: the second follows the first, by -0.5",
        "no actuator of the MJCF moves wrist, left-slide; here each has a motor, unless it is frozen",
    ):
        assert part in text


BODY = '<mujoco>{}<worldbody><body name="palm"><geom size="0.01"/>{}</body></worldbody>{}</mujoco>'
FINGER = '<body name="tip"><joint name="j" range="0 90"/><geom size="0.01"/>{}</body>'
PAIR = FINGER.format("") + '<body name="other"><joint name="k" range="0 90"/><geom size="0.01"/></body>'


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            BODY.format("", '<body name="tip"><joint name="j" type="ball"/><geom size="0.01"/></body>', ""),
            "joint j is a ball joint; write three hinges",
        ),
        (
            BODY.format("", '<body name="tip"><joint name="j" type="slide"/><geom size="0.01"/></body>', ""),
            "joint j slides without a limit; give it a",
        ),
        (
            BODY.format('<compiler angle="radian"/>', FINGER.format(""), ""),
            "joint j has limits 0 … 90 rad, beyond 6.35; are they in degrees?",
        ),
        (
            BODY.format("", FINGER.format("").replace("0 90", "90 0"), ""),
            "joint j has the range [90.0, 0.0]; write the lower limit first",
        ),
        (
            BODY.format("", FINGER.format("").replace("90", "1.5"), ""),
            'all joints turn by less than 6.3°; are angles in radians? Then write <compiler angle="radian"/>',
        ),
        (
            BODY.format("", PAIR, '<equality><joint joint1="j" joint2="k" polycoef="0 1 0.5 0 0"/></equality>'),
            "joint equality-0 ties joints j, k; links must be a tree, in which a joint follows one other along a line",
        ),
        (
            BODY.format("", PAIR, '<equality><connect body1="tip" body2="other" anchor="0.1 0 0"/></equality>'),
            "connect equality-0 ties joints j, k; links must be a tree",
        ),
        (
            BODY.format("", PAIR, '<equality><weld body1="tip" body2="other"/></equality>'),
            "weld equality-0 ties joints j, k; links must be a tree",
        ),
        (BODY.format("", "", "").replace("palm", "hand"), "there is no body 'palm'; there are hand"),
        (
            BODY.format("<extension><plugin plugin='mujoco.pid'/></extension>", "", ""),
            "hand.xml has <plugin>, which loads something else: delete it, and what uses it",
        ),
        (
            BODY.format("<asset><model name='a' file='a.xml'/></asset>", "", ""),
            "hand.xml has <model>, which loads something else: write both models as one file",
        ),
        (BODY.format("<include file='/etc/passwd'/>", "", ""), "it names '/etc/passwd', outside"),
        (BODY.format("<include file='../hand.yaml'/>", "", ""), "it names '../hand.yaml', outside"),
        (BODY.format("<include file='hand.xml'/>", "", ""), "MuJoCo cannot read it: "),
        (BODY.format("<include file='none.xml'/>", "", ""), "none.xml, which it names, cannot be read (No such file or directory)"),
        (BODY.format("<asset><mesh file='../../secret.stl'/></asset>", "", ""), "it names '../../secret.stl', outside"),
        (BODY.format("<compiler meshdir='/etc'/><asset><mesh file='a.stl'/></asset>", "", ""), "it names '/etc/a.stl', outside"),
        (BODY.format("<asset><texture type='2d' name='t' file='../t.png'/></asset>", "", ""), "it names '../t.png', outside"),
        (BODY.format("<asset><hfield name='h' file='../t.png' size='1 1 1 1'/></asset>", "", ""), "it names '../t.png', outside"),
        (BODY.format("", "<flexcomp name='f' type='mesh' file='../mesh.obj' mass='1'/>", ""), "MuJoCo cannot read it: "),
        (BODY.format("<asset><mesh file='hand.stl'/></asset>", "", ""), "hand.stl, which it names, cannot be read"),
        (BODY.format("<nothing/>", "", ""), "MuJoCo cannot read it: XML Error: Schema violation: unrecognized element"),
        (BODY.format("", "<body><joint/></body>", ""), "MuJoCo cannot compile it: "),
        (
            BODY.format("", FINGER.format("").replace("range", "ref='nan' range"), ""),
            "it has numbers beyond 1e+06, or NaN, which MuJoCo reads as qpos0",
        ),
        ("<mujoco>", "hand.xml is not XML (no element found: line 1, column 8)"),
        ('<!DOCTYPE m [<!ENTITY a SYSTEM "/etc/passwd">]><mujoco/>', "its XML declares a document type or entities"),
        (
            BODY.format("", "<replicate count='600'><body><geom size='1'/></body></replicate>", ""),
            "it has 1202 bodies, joints and geoms, 1000 are",
        ),
    ],
)
def test_what_cannot_be_read_is_named_with_the_remedy(tmp_path: Path, content: str, message: str) -> None:
    (path := tmp_path / "hand.xml").write_text(content)
    with pytest.raises(InvalidInput, match=re.escape(message)):
        parse_mjcf(path, "palm")


def test_comments_before_the_first_element_take_no_memory(tmp_path: Path) -> None:
    comments = "<!-- " + "- " * 150_000 + "<mujoco> -->\n" + "<!--a-->" * 1000
    tracemalloc.start()
    for element, expected in (("<mujoco>", True), ("<robot>", False)):
        (path := tmp_path / "hand.xml").write_text('<?xml version="1.0"?>' + comments + element)
        assert is_mjcf(path) == expected
    assert tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()


def test_error_of_the_process_that_reads_names_the_file(tmp_path: Path) -> None:
    (tmp_path / "hand.xml").write_text("<mujoco/>")
    (tmp_path / "hand.yaml").write_text(HAND.replace("model/claw.xml", "hand.xml"))
    with pytest.raises(InvalidInput, match=r"hand\.yaml with hand\.xml: there is no body 'palm'; there are none at all"):
        load_hand(tmp_path / "hand.yaml")


def test_meshes_beside_the_folder_are_read_where_a_package_holds_both(tmp_path: Path) -> None:
    (path := tmp_path / "mjcf" / "hand.xml").parent.mkdir()
    mesh = "<compiler meshdir='../meshes'/><asset><mesh name='tip' file='tip.stl'/></asset>"
    path.write_text(BODY.format(mesh, "<geom type='mesh' mesh='tip'/>", ""))
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "meshes" / "tip.stl")
    with pytest.raises(
        InvalidInput, match=r"it names '../meshes/tip\.stl', outside .*; copy it there, or put an empty package\.xml into the"
    ):
        parse_mjcf(path, "palm")
    (tmp_path / "package.xml").touch()
    (palm,) = parse_mjcf(path, "palm").links
    np.testing.assert_allclose(np.ptp(palm.collisions[1].mesh.vertices, axis=0), [0.1, 0.2, 0.3], atol=1e-7)


def test_meshes_of_one_name_in_two_folders_are_two(tmp_path: Path) -> None:
    """MuJoCo takes one for the other where contents are given to it under the names in the MJCF."""
    names = "<mesh name='a' file='a/tip.stl'/><mesh name='b' file='b/tip.stl'/>"
    asset, geoms = f"<compiler meshdir='m'/><asset>{names}</asset>", "<geom type='mesh' mesh='a'/><geom type='mesh' mesh='b'/>"
    (tmp_path / "hand.xml").write_text(BODY.format(asset, geoms, ""))
    for folder, size in (("a", 0.1), ("b", 0.2)):
        (tmp_path / "m" / folder).mkdir(parents=True)
        trimesh.creation.box((size, size, size)).export(tmp_path / "m" / folder / "tip.stl")
    (palm,) = parse_mjcf(tmp_path / "hand.xml", "palm").links
    assert [round(float(np.ptp(shape.mesh.vertices[:, 0])), 6) for shape in palm.collisions] == [0.02, 0.1, 0.2]


def test_mujoco_opens_no_file(tmp_path: Path) -> None:
    """A `<flexcomp>` names a file that its parser opens itself."""
    trimesh.creation.box().export(tmp_path / "cube.obj")
    flexcomp = f"<flexcomp name='f' type='mesh' file='{tmp_path / 'cube.obj'}' mass='1' dim='2' radius='0.01'/>"
    content = BODY.format("", flexcomp, "")
    mujoco.MjSpec.from_string(content)
    (tmp_path / "hand.xml").write_text(content)
    with pytest.raises(InvalidInput, match="MuJoCo cannot read it"):
        parse_mjcf(tmp_path / "hand.xml", "palm")


def test_urdf_of_an_mjcf_hand_moves_in_pybullet_as_the_hand_does(claw: Hand, tmp_path: Path) -> None:
    client = PhysicsClient()
    body = client.loadURDF(str(write_hand_urdf(claw, tmp_path)), useFixedBase=True)
    angles = claw.lower + 0.7 * (claw.upper - claw.lower)
    values = dict(zip(claw.joint_names, angles, strict=True))
    values |= {claw.joints[follower.link - 1].name: float(follower.of(angles)) for follower in claw.followers}
    joints = {client.getJointInfo(body, number)[1].decode(): number for number in range(client.getNumJoints(body))}
    for name, value in values.items():
        client.resetJointState(body, joints[name], value)
    frames = forward_kinematics(claw, np.eye(4), angles)
    for joint in claw.joints:
        position, turn = client.getLinkState(body, joints[joint.name], computeForwardKinematics=True)[4:6]
        np.testing.assert_allclose(position, frames[joint.child, :3, 3], atol=1e-6)
        matrix = np.reshape(client.getMatrixFromQuaternion(turn), (3, 3))
        np.testing.assert_allclose(matrix, frames[joint.child, :3, :3], atol=1e-6)
    client.disconnect()
