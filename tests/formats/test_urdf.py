"""URDF files in any encoding, other formats in their place, capsules, and numbers that are evidently in degrees or millimetres."""

import re
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pybullet
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand
from pipeline.formats.urdf import ignored_limits, parse_urdf, read_urdf
from pipeline.formats.urdf_shapes import shape_of
from pipeline.kernels.hand.model import Hand
from pipeline.physics.hand_urdf import write_hand_urdf
from pipeline.physics.simulation import PhysicsClient

ROBOT = '<robot name="r"><link name="{}"/></robot>'


def declared(encoding: str, name: str = "palm") -> str:
    return f'<?xml version="1.0" encoding="{encoding}"?>\n' + ROBOT.format(name)


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (declared("gb2312", "左手").encode("gb2312"), "左手"),
        (declared("Shift_JIS", "指先").encode("shift_jis"), "指先"),
        (declared("UTF-16", "dłoń").encode("utf-16"), "dłoń"),
        (declared("UTF-16", "dłoń").encode("utf-16-be"), "dłoń"),  # without a mark
        (ROBOT.format("dłoń").encode("utf-16"), "dłoń"),
        (declared("UTF-8", "dłoń").encode("utf-8-sig"), "dłoń"),
        (declared("latin-1", "dłoń").encode("utf-8-sig"), "dłoń"),  # the mark counts
    ],
)
def test_encoding_is_that_of_the_mark_or_the_declaration(tmp_path: Path, content: bytes, name: str) -> None:
    (path := tmp_path / "hand.urdf").write_bytes(content)
    assert [link.get("name") for link in parse_urdf(path)] == [name]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (declared("UTF-8").replace("palm", "m\xfcller").encode("latin-1"), "it is not text in UTF-8 ("),
        (ROBOT.format("müller").encode("latin-1"), "it is not text in utf-8 ("),
        (declared("klingon").encode(), "it is not text in klingon (unknown encoding: klingon); save it as UTF-8"),
        (b"", "it is an empty file"),
        (b"<robot", "it is not XML (unclosed token: line 1, column 0); a hand's `model` must be a URDF or an MJCF file"),
        (b"<sdf><model/></sdf>", "its root is <sdf>; a hand's `model` must be a URDF, whose root is <robot>, or an MJCF"),
        (b"<!DOCTYPE html>\n<html><body/></html>", "it is a web page (HTML); download the file itself"),
        (
            b'<robot name="r"><link name="${side}_palm"/></robot>',
            'it is xacro, from which a URDF is made: it has <link name="${side}_palm">; run xacro first, `xacro IN > OUT.urdf`',
        ),
        (b'<robot name="r"><xacro:include filename="palm.xacro"/></robot>', "it has <xacro:include>; run xacro first"),
    ],
)
def test_what_is_no_urdf_is_named_with_the_remedy(tmp_path: Path, content: bytes, message: str) -> None:
    (path := tmp_path / "hand.urdf").write_bytes(content)
    with pytest.raises(InvalidInput, match=rf"hand\.urdf: .*{re.escape(message)}"):
        parse_urdf(path)


def test_urdf_that_xacro_wrote_may_declare_its_prefix(tmp_path: Path) -> None:
    text = ROBOT.format("palm").replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')
    (path := tmp_path / "hand.urdf").write_text(text)
    assert len(parse_urdf(path)) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('<robot name="r"/>', "there is no link 'palm'; there are none at all"),
        (
            '<robot name="r"><link name="palm"/><link name="b"/>'
            '<joint name="j" type="fixed"><parent link="palm"/><child link="b"/></joint>'
            '<joint name="k" type="fixed"><parent link="b"/><child link="palm"/></joint></robot>',
            "2 links with 2 joints are not a tree with one root (roots: none)",
        ),
    ],
)
def test_empty_lists_are_written_as_none(tmp_path: Path, text: str, message: str) -> None:
    (path := tmp_path / "hand.urdf").write_text(text)
    with pytest.raises(InvalidInput, match=re.escape(message)):
        read_urdf(path, "palm")


RADIUS, LENGTH = 0.006, 0.05
CAPSULE = f'<capsule radius="{RADIUS}" length="{LENGTH}"/>'
FINGER = """<robot name="finger"><link name="palm"/>
<link name="tip"><collision><origin xyz="0 0 0.01"/><geometry>{shape}</geometry></collision></link>
<joint name="slide" type="{kind}"><parent link="palm"/><child link="tip"/><origin rpy="{rpy}"/>
{limit}</joint></robot>"""
MOUNT = "{link: tip, origin: [0, 0, 0.01], normal: [0, 1, 0], columns: [1, 0, 0]}"
PALM = "{link: palm, facing: [0, 0, 1], centre: [0, 0, 0]}"


def finger(folder: Path, shape: str = CAPSULE, kind: str = "prismatic", rpy: str = "0 0 0", lower: str = "0", upper: str = "0.1") -> Hand:
    limit = f'<limit lower="{lower}" upper="{upper}"/>'
    (folder / "finger.urdf").write_text(FINGER.format(shape=shape, kind=kind, rpy=rpy, limit=limit))
    fingers = f"[{{name: one, joints: [slide], sensor: {MOUNT}}}]"
    (folder / "finger.yaml").write_text(f"{{name: finger, urdf: finger.urdf, sensor: gel_16mm, palm: {PALM}, fingers: {fingers}}}")
    return load_hand(folder / "finger.yaml")


@pytest.mark.parametrize("role", ["visual", "collision"])
def test_capsule_is_a_cylinder_with_half_spheres_at_its_ends(role: str, tmp_path: Path) -> None:
    shape = shape_of(
        ElementTree.fromstring(f"<{role}><geometry>{CAPSULE}</geometry></{role}>"),
        tmp_path,
        {},
        read=lambda file, package: pytest.fail("it is no mesh"),
    )
    mesh = trimesh.Trimesh(shape.mesh.vertices, shape.mesh.faces)
    assert (shape.kind, shape.size) == ("capsule", (RADIUS, LENGTH))
    np.testing.assert_allclose(mesh.bounds[1], [RADIUS, RADIUS, LENGTH / 2 + RADIUS], atol=1e-9)
    np.testing.assert_allclose(mesh.bounds[0], -mesh.bounds[1], atol=1e-9)
    assert mesh.volume == pytest.approx(np.pi * RADIUS**2 * (LENGTH + 4 / 3 * RADIUS), rel=0.02)
    axis = np.maximum(np.abs(mesh.vertices[:, 2]) - LENGTH / 2, 0.0)
    np.testing.assert_allclose(np.hypot(axis, np.linalg.norm(mesh.vertices[:, :2], axis=1)), RADIUS, atol=1e-9)


@pytest.mark.parametrize("shape", [CAPSULE, CAPSULE.replace("<capsule", "<drake:capsule")])
def test_both_physics_engines_load_the_capsule_of_a_finger(shape: str, tmp_path: Path) -> None:
    urdf = write_hand_urdf(finger(tmp_path, shape), tmp_path)
    client = PhysicsClient()
    body = client.loadURDF(str(urdf))
    (loaded,) = client.getCollisionShapeData(body, 0)
    client.disconnect()
    assert loaded[2] == pybullet.GEOM_CAPSULE
    np.testing.assert_allclose(loaded[3][:2], [LENGTH, RADIUS])
    (geom,) = mujoco.MjSpec.from_file(str(urdf)).geoms
    assert geom.type == mujoco.mjtGeom.mjGEOM_CAPSULE
    np.testing.assert_allclose(geom.size[:2], [RADIUS, LENGTH / 2])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"kind": "revolute", "upper": "90"},
            "joint slide has limits 0 … 90 rad, beyond 6.35; are they in degrees? Then write 0 … 1.571",
        ),
        ({"kind": "revolute", "lower": "-30"}, "joint slide has limits -30 … 0.1 rad, beyond 6.35; are they in degrees?"),
        ({"upper": "50"}, "joint slide has limits 0 … 50 m, beyond 1; are they in millimetres? Then write 0 … 0.05"),
        ({"rpy": "0 0 -90"}, "<origin> has rpy 0 0 -90 rad, beyond 6.35; are they in degrees? Then write 0 0 -1.571"),
        ({"upper": '0.1"/><mimic joint="other" offset="20'}, "joint slide mimics 'other' with offset 20 m, beyond 1"),
        ({"rpy": '0 0 0" quat_xyzw="0 0 0 1'}, "<origin quat_xyzw='0 0 0 1'> is not read; write the same rotation as rpy"),
        ({"shape": '<drake:ellipsoid a="1" b="1" c="1"/>'}, "has <ellipsoid>; give it a box, sphere, cylinder, capsule or mesh"),
        ({"shape": ""}, "a collision has no geometry; give it a box"),
        ({"kind": "fixed"}, "there is no moving joint 'slide'; there are none at all"),
    ],
)
def test_numbers_in_other_units_and_unknown_shapes_are_named(changes: dict[str, str], message: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=re.escape(message)):
        finger(tmp_path, **changes)


def test_a_full_turn_is_not_taken_for_degrees(tmp_path: Path) -> None:
    hand = finger(tmp_path, kind="revolute", lower="-6.2832", upper="6.2832", rpy="0 0 6.2832")
    assert hand.upper.tolist() == [6.2832]


@pytest.mark.parametrize(
    ("lower", "upper", "ignored"), [("0", "90", True), ("-1", "1", True), ("0", "0", False), ("-3.1416", "3.1416", False)]
)
def test_limits_of_a_continuous_joint_are_reported_as_ignored(lower: str, upper: str, ignored: bool, tmp_path: Path) -> None:
    lines = list(ignored_limits(finger(tmp_path, kind="continuous", lower=lower, upper=upper)))
    assert [line.split(":")[0] for line in lines] == [f"joint slide is continuous, so its limits {lower} … {upper} do not count"] * ignored
