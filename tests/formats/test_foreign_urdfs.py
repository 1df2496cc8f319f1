"""URDFs of real hands: mimic joints, packages, arms above the palm, colours with commas, links without mass, Drake's tags."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image

from pipeline.errors import InvalidInput
from pipeline.formats.hand_file import load_hand
from pipeline.formats.mesh_reader import load_mesh
from pipeline.formats.urdf import parse_urdf, read_urdf
from pipeline.kernels.hand.collision_shapes import collision_spheres
from pipeline.kernels.hand.convex_shapes import MAX_FACES
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.hand.model import Hand
from pipeline.physics.hand_urdf import inertia_notes, write_hand_urdf

BAR = '<{0}><origin xyz="0 0 0.02"/><geometry><box size="0.01 0.01 0.04"/></geometry></{0}>'
BODY = '<inertial><mass value="0.01"/></inertial>' + BAR.format("collision")
TIP = """<visual><geometry><mesh filename="package://claw/meshes/tip.glb"/></geometry></visual>
         <collision><geometry><mesh filename="package://claw/meshes/tip.glb"/></geometry></collision>"""


def joint(name: str, kind: str, parent: str, child: str, more: str = "", xyz: str = "0 0 0.04") -> str:
    axis = '<axis xyz="1 0 0"/><limit lower="-0.5" upper="1" effort="0"/>' if kind == "revolute" else ""
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>{axis}{more}</joint>'


PAINTED = BAR.format("visual").replace("<origin", '<material name="blue"/><origin')
CLAW = f"""<robot name="claw">
  <material name="blue"><color rgba="0.1, 0.2, 0.9, 1"/></material>
  <drake:collision_filter_group name="palm"><drake:member link="one"/></drake:collision_filter_group>
  <link name="world"/><link name="arm">{BODY}</link><link name="palm">{BODY}{PAINTED}</link>
  <link name="one">{BODY}</link><link name="two">{BODY}</link><link name="tip">{TIP}</link><link name="lever">{BODY}</link>
  {joint("flight", "floating", "world", "arm")}
  {joint("shoulder", "revolute", "arm", "palm")}
  {joint("first", "revolute", "palm", "one")}
  {joint("second", "revolute", "one", "two", '<mimic joint="first" multiplier="2" offset="0.1"/>')}
  {joint("third", "revolute", "two", "tip", '<mimic joint="second" multiplier="-0.5"/>')}
  {joint("brake", "revolute", "palm", "lever", xyz="0.05 0 0.02")}
</robot>"""


def finger(name: str, tip: str, *joints: str) -> dict[str, object]:
    sensor = {"name": name, "link": tip, "origin": [0, 0, 0], "normal": [0, 0, 1], "columns": [1, 0, 0]}
    return {"name": name, "joints": list(joints), "sensor": sensor}


HAND = {
    "name": "claw",
    "urdf": "urdf/claw.urdf",
    "sensor": "gel_16mm",
    "palm": {"link": "palm", "facing": [0, 0, 1], "centre": [0, 0, 0.04]},
    "frozen": {"brake": 0.25},
    "fingers": [finger("only", "tip", "first")],
}


def claw(folder: Path, text: str = CLAW, **changed: object) -> Path:
    package = folder / "my things" / "claw"
    for inner in ("urdf", "meshes"):
        (package / inner).mkdir(parents=True, exist_ok=True)
    trimesh.creation.cone(radius=0.01, height=0.03).export(package / "meshes" / "tip.glb")
    (package / "urdf" / "claw.urdf").write_text(text)
    (package / "claw.yaml").write_text(yaml.safe_dump(HAND | changed))
    return package / "claw.yaml"


@pytest.fixture
def hand(tmp_path: Path) -> Hand:
    return load_hand(claw(tmp_path))


def test_arm_above_the_palm_is_cut_off(hand: Hand) -> None:
    assert [link.name for link in hand.links] == ["palm", "one", "lever", "two", "tip"]
    assert hand.joint_names == ("first",)
    assert hand.links[0].visuals[0].mesh.look.base_color[0].tolist() == [26, 51, 230, 255]


def test_mimic_joint_follows_another_mimic_joint(hand: Hand) -> None:
    """Rotations about one axis add up: 0.3, twice that and 0.1, less half of the latter."""
    turned = forward_kinematics(hand, np.eye(4), np.array([0.3]))[[1, 3, 4], :3, :3]
    angles = np.arctan2(turned[:, 2, 1], turned[:, 2, 2])
    np.testing.assert_allclose(angles, [0.3, 0.3 + 0.7, 0.3 + 0.7 - 0.35], atol=1e-12)


def test_fingers_that_share_motors_with_a_third_one_are_one_finger(tmp_path: Path) -> None:
    followers = (
        f'<link name="near">{BODY}</link><link name="far">{BODY}</link>'
        f"""{joint("nearer", "revolute", "palm", "near", '<mimic joint="first"/>', xyz="0.1 0 0")}"""
        f"""{joint("farther", "revolute", "near", "far", '<mimic joint="brake"/>')}</robot>"""
    )
    fingers = [finger("one", "tip", "first"), finger("two", "lever", "brake"), finger("three", "far", "nearer", "farther")]
    hand = load_hand(claw(tmp_path, CLAW.replace("</robot>", followers), frozen={}, fingers=fingers))
    assert [(one.name, one.joints, len(one.sensors)) for one in hand.fingers] == [("one+two+three", (0, 1), 3)]


def test_frozen_joint_stays_at_its_angle(hand: Hand) -> None:
    for angle in (-0.4, 0.9):
        lever = forward_kinematics(hand, np.eye(4), np.array([angle]))[2]
        assert np.arctan2(lever[2, 1], lever[2, 2]) == pytest.approx(0.25)


def test_joint_that_mimics_a_frozen_joint_is_frozen(tmp_path: Path) -> None:
    assert load_hand(claw(tmp_path, frozen={"brake": 0.25, "second": 0.3})).frozen == {"brake": 0.25, "second": 0.3, "third": -0.15}


def test_physics_urdf_has_convex_meshes_masses_and_no_visuals(hand: Hand, tmp_path: Path) -> None:
    no_mass, no_inertia = inertia_notes(hand)
    assert no_mass.startswith("no mass stated for tip: estimated at 1000 kg/m³")
    assert "for palm, one, lever, two: estimated from mass and collision shapes" in no_inertia
    robot = parse_urdf(write_hand_urdf(hand, tmp_path))
    assert not robot.findall("*/visual")
    assert not robot.findall("*/mimic")
    assert {mesh.get("filename", "")[-4:] for mesh in robot.iter("mesh")} == {".obj"}
    assert all(float(mass.get("value", 0)) > 0 for mass in robot.iter("mass"))
    assert len(robot.findall("link/inertial")) == 5
    _, joints = read_urdf(tmp_path / "hand.urdf")
    frozen = next(joint_read for joint_read in joints if joint_read.name == "brake")
    mine = next(joint_read for joint_read in hand.joints if joint_read.name == "brake")
    assert frozen.kind == "fixed"
    np.testing.assert_allclose(frozen.origin, mine.origin, atol=1e-12)


@pytest.mark.parametrize(
    ("changed", "old", "new", "message"),
    [
        ({"frozen": {}}, "", "", "brake belong to no finger; list them under a finger's joints, or freeze them: {brake: 0}"),
        ({"frozen": {"brake": 2}}, "", "", "frozen: brake is 2, outside its limits -0.5 … 1"),
        ({}, 'mimic joint="first"', 'mimic joint="third"', "mimics itself"),
        ({}, 'multiplier="2"', 'multiplier="0"', "joint second mimics 'first' with multiplier 0; make it fixed"),
        (
            {},
            'mimic joint="first"',
            'mimic joint="shoulder"',
            "joint second follows 'shoulder', which is no moving joint of the hand; freeze it: {second: 0}",
        ),
        (
            {"frozen": {"brake": 0, "first": 0.1}, "fingers": [finger("only", "tip", "second")]},
            "",
            "",
            "joint second follows 'first', which is frozen; leave it out of the finger, or do not freeze that one",
        ),
        (
            {"frozen": {}, "fingers": [finger("only", "tip", "first"), finger("side", "lever", "brake")]},
            '<parent link="palm"/><child link="lever"/>',
            '<parent link="one"/><child link="lever"/>',
            "fingers 'only' and 'side' both move link 'lever', but fingers move by themselves; freeze the joint that moves both",
        ),
        ({}, "package://claw/meshes", "package://paw/meshes", "put package 'paw' beside the URDF"),
    ],
)
def test_unusable_joint_or_package_is_named(tmp_path: Path, changed: dict[str, object], old: str, new: str, message: str) -> None:
    if "paw" in new:
        new = "package://paw/textures"
    with pytest.raises(InvalidInput, match=re.escape(message)):
        load_hand(claw(tmp_path, CLAW.replace(old, new) if old else CLAW, **changed))


def test_bent_link_is_cut_into_convex_parts(tmp_path: Path) -> None:
    """The convex hull of an angle of two bars fills the corner; eight parts do not."""
    path = claw(tmp_path)
    angle = trimesh.util.concatenate(
        [
            trimesh.creation.box((0.1, 0.01, 0.01), trimesh.transformations.translation_matrix((0.05, 0, 0))),
            trimesh.creation.box((0.01, 0.01, 0.05), trimesh.transformations.translation_matrix((0, 0, 0.025))),
        ]
    )
    angle.export(path.parent / "meshes" / "tip.glb")
    whole = load_hand(path).links[4].collisions
    path.write_text(yaml.safe_dump(HAND | {"convex_parts": {"tip": 8}}))
    parts = load_hand(path).links[4].collisions
    assert (len(whole), len(parts)) == (1, 8)
    low = min(part.mesh.vertices.min() for part in parts)
    assert low == pytest.approx(angle.vertices.min())
    volumes = [trimesh.Trimesh(part.mesh.vertices, part.mesh.faces).convex_hull.volume for part in parts]
    assert sum(volumes) == pytest.approx(0.1 * 0.01 * 0.01 + 0.01 * 0.01 * 0.045, rel=0.2)


@pytest.mark.parametrize("name", ["../../tip.glb", "{0}/tip.glb", "file://{0}/tip.glb", "package://{1}/tip.glb", "../meshes/link.glb"])
def test_mesh_outside_the_package_is_refused(tmp_path: Path, name: str) -> None:
    """`../meshes/tip.glb` is inside; a folder with a package.xml is a package as a whole."""
    path = claw(tmp_path, CLAW.replace("package://claw/meshes", "../meshes"))
    assert len(load_hand(path).links) == 5
    trimesh.creation.box((0.01, 0.01, 0.01)).export(tmp_path / "my things" / "tip.glb")
    trimesh.creation.box((0.01, 0.01, 0.01)).export(tmp_path / "tip.glb")
    (path.parent / "meshes" / "link.glb").symlink_to(tmp_path / "tip.glb")
    outside = CLAW.replace("package://claw/meshes/tip.glb", name.format(tmp_path / "my things", tmp_path.name))
    path = claw(tmp_path, outside)
    message = rf"outside {re.escape(str(path.parent))}, the package of the URDF; copy it there, or put an empty package\.xml into"
    with pytest.raises(InvalidInput, match=message):
        load_hand(path)
    if name == "../../tip.glb":
        (tmp_path / "my things" / "package.xml").touch()
        assert len(load_hand(path).links) == 5


def test_sibling_package_is_read(tmp_path: Path) -> None:
    path = claw(tmp_path, CLAW.replace("package://claw", "package://tips"))
    tips = tmp_path / "my things" / "tips"
    (path.parent / "meshes").rename(tips.parent / "meshes")
    tips.mkdir()
    (tips.parent / "meshes").rename(tips / "meshes")
    with pytest.raises(InvalidInput, match=r"outside .*, the package of the URDF"):
        load_hand(path)
    (tips / "package.xml").touch()
    assert len(load_hand(path).links) == 5


def test_texture_elsewhere_in_the_package_is_read_and_listed_as_a_file_of_the_hand(tmp_path: Path) -> None:
    path = claw(tmp_path, CLAW.replace("tip.glb", "tip.obj"))
    skin = path.parent / "materials" / "textures" / "skin.png"
    skin.parent.mkdir(parents=True)
    Image.new("RGB", (2, 2), (9, 9, 9)).save(skin)
    cone = trimesh.creation.cone(radius=0.01, height=0.03)
    cone.visual = trimesh.visual.TextureVisuals(cone.vertices[:, :2], trimesh.visual.material.SimpleMaterial(image=Image.open(skin)))
    (path.parent / "meshes" / "tip.obj").write_text(trimesh.exchange.obj.export_obj(cone, mtl_name="tip.mtl"))
    (path.parent / "meshes" / "tip.mtl").write_text("newmtl material_0\nmap_Kd ../materials/textures/skin.png\n")
    hand = load_hand(path)
    assert len(hand.links[4].visuals[0].mesh.look.textures) == 1
    assert skin.resolve() in hand.files


@pytest.mark.parametrize(("name", "color"), [("red", [255, 0, 0, 255]), ("blue", [26, 51, 230, 255])])
def test_material_defined_by_a_link_colours_others_unless_the_robot_defines_it(tmp_path: Path, name: str, color: list[int]) -> None:
    material = f'<material name="{name}"><color rgba="1 0 0 1"/></material>'
    defined = f'<link name="arm"><visual><geometry><sphere radius="1"/></geometry>{material}</visual>'
    text = CLAW.replace(PAINTED, PAINTED.replace("blue", name)).replace('<link name="arm">', defined)
    assert load_hand(claw(tmp_path, text)).links[0].visuals[0].mesh.look.base_color[0].tolist() == color


def test_total_faces_are_bounded_and_each_mesh_file_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, read = claw(tmp_path), list[Path]()
    monkeypatch.setattr("pipeline.formats.urdf.load_mesh", lambda file, root: (read.append(file), load_mesh(file, root))[1])
    load_hand(path)
    assert len(read) == 1
    monkeypatch.setattr("pipeline.formats.urdf.MAX_FACES", 100)
    with pytest.raises(InvalidInput, match=r"its shapes have 1\d\d faces or more, 100 are the most; decimate their meshes"):
        read_urdf(path.parent / "urdf" / "claw.urdf")


def test_large_hand_mesh_is_simplified_and_cached_until_a_file_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tip of 81,920 faces: physics and distances get a thousand. The hand is cached until the mesh changes."""
    path = claw(tmp_path)
    tip = path.parent / "meshes" / "tip.glb"
    trimesh.creation.icosphere(subdivisions=6, radius=0.02).export(tip)
    hand = load_hand(path)
    (shape,) = hand.links[4].collisions
    assert len(hand.links[4].visuals[0].mesh.faces) == 81_920
    assert len(shape.mesh.faces) <= MAX_FACES
    np.testing.assert_allclose(shape.mesh.vertices.max(axis=0), 0.02, atol=2e-4)
    spheres = collision_spheres(hand, spacing=0.003).of_links([4])
    assert len(spheres.radii) < 5000
    with monkeypatch.context() as patched:
        patched.setattr("pipeline.formats.urdf.load_mesh", lambda path, root: pytest.fail(f"{path} is read again"))
        assert load_hand(path) is hand
    trimesh.creation.icosphere(subdivisions=6, radius=0.01).export(tip)
    assert load_hand(path).links[4].collisions[0].mesh.vertices.max() == pytest.approx(0.01, abs=2e-4)
    tip.unlink()
    with pytest.raises(InvalidInput, match=r"tip\.glb"):
        load_hand(path)


def test_shape_that_is_too_large_to_fill_is_named(tmp_path: Path) -> None:
    """A mesh in millimetres without its scale would take all memory."""
    path = claw(tmp_path)
    trimesh.creation.box((20, 30, 50)).export(path.parent / "meshes" / "tip.glb")
    with pytest.raises(InvalidInput, match=r"a collision shape of link tip is 20 x 30 x 50 m large; is the scale of its mesh right\?"):
        collision_spheres(load_hand(path), spacing=0.003)


def test_physics_urdf_states_what_engines_cannot_read_or_guess(tmp_path: Path) -> None:
    """Commas between numbers, an axis that is not of unit length, a mass without inertia."""
    text = CLAW.replace('<axis xyz="1 0 0"/>', '<axis xyz="2, 0, 0"/>').replace('xyz="0 0 0.04"', 'xyz="0, 0, 0.04"')
    robot = parse_urdf(write_hand_urdf(replace(load_hand(claw(tmp_path, text)), followers=()), tmp_path))
    assert "," not in "".join(element.get("xyz", "") for element in robot.iter())
    assert {tuple(map(float, axis.get("xyz", "").split())) for axis in robot.iter("axis")} == {(1.0, 0.0, 0.0)}
    for inertial in robot.iter("inertial"):
        mass, moments = (element.attrib for element in (inertial.find("mass"), inertial.find("inertia")) if element is not None)
        assert min(float(moments[name]) for name in ("ixx", "iyy", "izz")) > 0
        if float(mass["value"]) == 0.01:
            assert float(moments["ixx"]) == pytest.approx(0.01 / 12 * (0.01**2 + 0.04**2))


BOX_INERTIA = (0.01 / 12 * (0.01**2 + 0.04**2), 0.01 / 12 * (0.01**2 + 0.04**2), 0.01 / 12 * 2 * 0.01**2)
"""kg m², of a `BODY` about its middle."""


def stated_inertia(folder: Path, moments: tuple[float, ...], product: float = 0.0) -> tuple[list[float], list[str]]:
    """Give the link "one" these moments and an ixy, kg m²; return the moments that engines get without rotors, and the notes."""
    xx, yy, zz = moments
    tensor = f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="{product}" ixz="0" iyz="0"/>'
    hand = load_hand(claw(folder, CLAW.replace(f'name="one">{BODY}', f'name="one">{BODY.replace("</inertial>", tensor + "</inertial>")}')))
    written = parse_urdf(write_hand_urdf(replace(hand, followers=()), folder)).find("link[@name='one']/inertial/inertia")
    assert written is not None
    return [float(written.get(name, "nan")) for name in ("ixx", "iyy", "izz")], [note for note in inertia_notes(hand) if " one," in note]


@pytest.mark.parametrize(
    ("moments", "product", "expected"),
    [
        ((0.0, 0.0, 0.0), 0.0, None),
        ((-1e-6, 1e-6, 1e-6), 0.0, None),
        ((1e-6, 1e-6, 2.1e-6), 0.0, None),
        ((1e-6, 1e-6, 1e-6), 1.5e-6, None),  # the moments are positive, those about its principal axes are not
        (tuple(1e4 * moment for moment in BOX_INERTIA), 0.0, None),  # kg cm²
        (tuple(1e-6 * moment for moment in BOX_INERTIA), 0.0, None),
        (tuple(0.3 * moment for moment in BOX_INERTIA), 0.0, tuple(0.3 * moment for moment in BOX_INERTIA)),
        (tuple(3.0 * moment for moment in BOX_INERTIA), 0.0, tuple(3.0 * moment for moment in BOX_INERTIA)),
        ((1.0e-6, 1.0e-6, 2.01e-6), 0.0, (1.01e-6, 1.01e-6, 2.02e-6)),  # a thin plate, rounded
    ],
)
def test_inertia_that_no_body_can_have_is_estimated_and_named(
    tmp_path: Path, moments: tuple[float, ...], product: float, expected: tuple[float, ...] | None
) -> None:
    written, notes = stated_inertia(tmp_path, moments, product)
    assert len(notes) == (expected is None)
    np.testing.assert_allclose(written, expected or BOX_INERTIA, rtol=1e-5)
    assert written[2] < written[0] + written[1]
