"""Write the URDF that physics engines load: a hand as its files describe it, with a plate for each gel."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

import numpy as np
import scipy
from numpy.typing import ArrayLike

from pipeline.console import abbreviate
from pipeline.formats.urdf_shapes import PRIMITIVES
from pipeline.kernels.arrays import Array
from pipeline.kernels.hand.convex_shapes import shrunken_hull
from pipeline.kernels.hand.model import Hand, Inertial, Joint, Link
from pipeline.kernels.touch.depth_maps import gel_top
from pipeline.kernels.touch.sensor import Sensor

DENSITY = 1000.0  # kg/m³ of the boxes around a link's collision shapes, to estimate the mass of a link without one
MIN_MASS = 1e-3  # mass of a link without a mass and without collision shapes, kg
MIN_MOMENT = 1e-9  # kg m², least moment of inertia that is estimated
ROUNDED = 0.01  # share by which the largest moment of inertia may exceed the sum of the two others, which no body's does: files round
LEAST_GYRATION = 0.01  # least possible radius of gyration over the diagonal of a link's box: a rod has 0.29, no body more than 1
GEL_MASS = 0.02  # kg, of a gel's plate: a lighter one swings on its spring faster than steps of 1/240 s can follow
GEARED_INERTIA = 1e-4  # kg m², of the rotors that move coupled joints: 1e-8 kg m² behind a gear of 100 to 1; URDF has no place for it
ARMATURE = {"revolute": 1e-3, "continuous": 1e-3, "prismatic": 0.3}
"""kg m² and kg of a motor's rotor, reflected to its joint; without it, a light fingertip swings faster than the steps can follow."""
FOLLOWER_SLACK = 0.1  # rad (m) beyond its leader's limits that a following joint is free to move, so that the limits do not conflict


def write_hand_urdf(
    hand: Hand,
    folder: Path,
    sensors: Sequence[Sensor] = (),
    *,
    rotors: bool = False,  # whether links that joints move have the inertia of `ARMATURE`, and its weight where they slide
    margin: float = 0.0,  # m, by which the engine thickens convex meshes: they are written as much smaller
) -> Path:
    """Write a hand's URDF and its collision meshes, as convex OBJ files, into a folder.

    Visuals are left away, every link has a mass and an inertia that a body can have, frozen joints are fixed, and a joint that follows
    another one is as free as that one. The links of both have the inertia of rotors too: without it, links of a few grams give way before
    the solver of PyBullet has found the force of the gear. With the sensors of its mounts, each has a plate that slides along its normal.
    """
    robot, geared = Element("robot", name=hand.name), geared_links(hand)
    for number, link in enumerate(hand.links):
        kind = hand.joints[number - 1].kind if number and rotors else "fixed"
        body, turning = _estimated(link), GEARED_INERTIA if number in geared else 0.0
        if kind == "prismatic":
            body = replace(body, mass=body.mass + ARMATURE[kind])
        else:
            turning = max(turning, ARMATURE.get(kind, 0.0))
        _add_link(robot, link, folder / f"link-{number}", body, rotors=turning, margin=margin)
    for joint in hand.joints:
        _add_joint(robot, joint, hand)
    for number, sensor in enumerate(sensors):
        _add_plate(robot, hand, number, sensor)
    indent(robot)  # PyBullet breaks lines after 8192 characters, wherever that is
    path = folder / "hand.urdf"
    ElementTree(robot).write(path)
    return path


def geared_links(hand: Hand) -> set[int]:
    """Find the links whose rotation another joint follows, or that follow one."""
    pairs = ((hand.joint_links[follower.entry], follower.link) for follower in hand.followers)
    return {link for pair in pairs for link in pair if hand.joints[link - 1].kind != "prismatic"}


def inertia_notes(hand: Hand) -> list[str]:
    """Name the links whose mass or inertia is estimated, because none is stated, or one that no body can have."""
    massless = [link.name for link in hand.links if link.inertial is None]
    guessed = [link.name for link in hand.links if link.inertial is not None and _possible_moments(link) is None]
    notes = []
    if massless:
        notes.append(f"no mass stated for {abbreviate(massless)}: estimated at {DENSITY:g} kg/m³ of collision shapes, at least 1 g each")
    if guessed:
        notes.append(
            f"no <inertia> is stated that a body of that mass and size can have for {abbreviate(guessed)}: estimated from mass and "
            "collision shapes; give positive moments in kg m², none greater than the sum of the two others"
        )
    return notes


def gel_name(number: int) -> str:
    """Name the link of a sensor's plate, and the joint that moves it."""
    return f"gel of sensor {number}"


def _add_link(robot: Element, link: Link, stem: Path, body: Inertial, *, rotors: float, margin: float) -> None:
    element = SubElement(robot, "link", name=link.name)
    xx, xy, xz, yy, yz, zz = body.moments or ()
    _add_inertial(element, replace(body, moments=(xx + rotors, xy, xz, yy + rotors, yz, zz + rotors)))  # about all axes: no body has one
    numbered = sorted(enumerate(link.collisions), key=lambda item: item[1].kind == "mesh")  # results depend on the order, by chance
    for number, shape in numbered:
        collision = SubElement(element, "collision")
        geometry = SubElement(collision, "geometry")
        if shape.kind == "mesh":
            import trimesh  # takes half a second, which hands of boxes save

            path = stem.with_name(f"{stem.name}-{number}.obj")
            mesh = shrunken_hull(shape.mesh, margin) if margin else shape.mesh
            trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).convex_hull.export(path)
            SubElement(geometry, "mesh", filename=str(path))
        else:
            _add_origin(collision, shape.origin, shape.rpy)
            counts, sizes = PRIMITIVES[shape.kind][0], iter(shape.size)
            SubElement(geometry, shape.kind, {name: _text(list(islice(sizes, count))) for name, count in counts.items()})


def _add_inertial(element: Element, body: Inertial) -> None:
    inertial = SubElement(element, "inertial")
    SubElement(inertial, "origin", xyz=_text(body.centre), rpy=_text(body.rpy))
    SubElement(inertial, "mass", value=repr(body.mass))
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    SubElement(inertial, "inertia", {name: repr(moment) for name, moment in zip(names, body.moments or (), strict=True)})


def _estimated(link: Link) -> Inertial:
    """Return the mass and the moments of a link; what is not known is estimated as that of a box of water around its shapes."""
    low, high = _box(link)
    body = link.inertial
    if body is None:
        mass = max(DENSITY * float(np.prod(high - low)), MIN_MASS)
        body = Inertial(mass, (low + high) / 2, (0.0, 0.0, 0.0), None)
    x, y, z = (high - low).tolist()
    moments = [max(body.mass / 12 * moment, MIN_MOMENT) for moment in (y * y + z * z, x * x + z * z, x * x + y * y)]
    box = (moments[0], 0.0, 0.0, moments[1], 0.0, moments[2])
    return replace(body, moments=_possible_moments(link) or box)


def _possible_moments(link: Link) -> tuple[float, ...] | None:
    """Return the stated moments of a link; None if there are none, or no body of this mass and size has them.

    Where rounded numbers violate the triangle inequality, all moments are raised by what is missing: PyBullet would take 0, and MuJoCo
    the mean of the three.
    """
    if link.inertial is None or link.inertial.moments is None:
        return None
    xx, xy, xz, yy, yz, zz = link.inertial.moments
    least, middle, greatest = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).tolist()
    if least <= 0 or greatest > (1 + ROUNDED) * (least + middle):
        return None
    low, high = _box(link)
    gyration, size = np.sqrt(greatest / link.inertial.mass), float(np.linalg.norm(high - low))
    if size and not LEAST_GYRATION * size <= gyration <= size:
        return None
    missing = max(greatest * (1 + 1e-6) - least - middle, 0.0)
    return xx + missing, xy, xz, yy + missing, yz, zz + missing


def _box(link: Link) -> tuple[Array, Array]:
    """Find the least and the greatest corner (3,) of the collision shapes, else of what is seen, m; both 0 for a link without shapes."""
    corners = np.concatenate([shape.mesh.vertices for shape in link.collisions or link.visuals] or [np.zeros((1, 3))])
    return corners.min(axis=0), corners.max(axis=0)


def _add_joint(robot: Element, joint: Joint, hand: Hand) -> None:
    element = SubElement(robot, "joint", name=joint.name, type=joint.kind)
    SubElement(element, "parent", link=hand.links[joint.parent].name)
    SubElement(element, "child", link=hand.links[joint.child].name)
    _add_origin(element, joint.origin, joint.rpy)
    SubElement(element, "axis", xyz=_text(joint.axis))  # of length 1: PyBullet slides along an axis by its length
    lower, upper = joint.lower, joint.upper
    for follower in hand.followers:
        if follower.link == joint.child:
            lower, upper = hand.follower_range(follower)
            lower, upper = lower - FOLLOWER_SLACK, upper + FOLLOWER_SLACK
    SubElement(element, "limit", lower=repr(lower), upper=repr(upper), effort=repr(hand.torque), velocity="100")
    SubElement(element, "dynamics", damping=repr(joint.damping), friction=repr(joint.friction))


def _add_plate(robot: Element, hand: Hand, number: int, sensor: Sensor) -> None:
    link = SubElement(robot, "link", name=gel_name(number))
    _add_inertial(link, Inertial(GEL_MASS, np.zeros(3), (0.0, 0.0, 0.0), (1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-6)))
    plate = SubElement(link, "collision")
    SubElement(plate, "origin", xyz=f"0 0 {-sensor.w / 2}")
    SubElement(SubElement(plate, "geometry"), "box", size=f"{sensor.width} {sensor.height} {sensor.w}")
    joint = SubElement(robot, "joint", name=gel_name(number), type="prismatic")
    SubElement(joint, "parent", link=hand.links[hand.sensors[number].link].name)
    SubElement(joint, "child", link=gel_name(number))
    _add_origin(joint, hand.sensors[number].pose, None)
    SubElement(joint, "axis", xyz="0 0 1")
    SubElement(joint, "limit", lower="0", upper=str(gel_top(sensor)), effort="1000", velocity="10")


def _add_origin(
    element: Element,
    pose: Array,  # (4, 4)
    rpy: Sequence[float] | None,  # rad; None: any angles of the pose, of several at a pitch of 90°
) -> None:
    angles = scipy.spatial.transform.Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", suppress_warnings=True) if rpy is None else rpy
    SubElement(element, "origin", xyz=_text(pose[:3, 3]), rpy=_text(angles))


def _text(numbers: ArrayLike) -> str:
    return " ".join(map(repr, np.asarray(numbers, np.float64).tolist()))
