"""Write the URDF that physics engines load: a hand as its file describes it, without what they cannot read."""

from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.console import abbreviate
from pipeline.formats.urdf import mass_of
from pipeline.formats.urdf_shapes import numbers_of
from pipeline.formats.urdf_xml import parse_urdf
from pipeline.kernels.hand.model import Hand, Joint, Link

DENSITY = 1000.0
"""kg/m³ of the boxes around a link's collision shapes, to estimate the mass of a link without one."""

MIN_MASS = 1e-3
"""Mass of a link without a mass and without collision shapes, kg."""

ROUNDED = 0.01
"""Share by which the largest moment of inertia may exceed the sum of the two others, which no body's does: files round."""
LEAST_GYRATION = 0.01
"""Least possible greatest radius of gyration of a link, as a share of the diagonal of its box: a rod has 0.29. No body has more than 1."""


def write_physics_urdf(hand: Hand, folder: Path) -> Path:
    """Write the parts of a hand's URDF that physics needs into a folder.

    Parameters
    ----------
    hand
        Only its links are written: those above the palm are left out, frozen joints are fixed.
    folder
        An existing folder for the file and its convex meshes.

    Returns
    -------
    The URDF. Visuals and names with a prefix are removed, every collision mesh is a convex OBJ, every link has a mass and an inertia that
    a body can have, and a joint that follows another one is as free as that one. Everything else is copied from the hand's file unchanged.
    """
    links, joints = {link.name: link for link in hand.links}, {joint.name: joint for joint in hand.joints}
    robot = Element("robot", name=hand.name)
    for element in parse_urdf(hand.urdf):
        name = element.get("name", "")
        if element.tag == "link" and name in links:
            robot.append(_link(element, links[name], folder / f"link-{hand.links.index(links[name])}"))
        elif element.tag == "joint" and name in joints:
            robot.append(_joint(element, joints[name], hand))
    path = folder / "hand.urdf"
    ElementTree(robot).write(path)
    return path


def inertia_notes(hand: Hand) -> list[str]:
    """Name the links whose mass or inertia is estimated, because the URDF states none, or one that no body can have."""
    links = {link.name: link for link in hand.links}
    elements = {name: element for element in parse_urdf(hand.urdf).findall("link") if (name := element.get("name", "")) in links}
    massless = [name for name, element in elements.items() if not mass_of(element)]
    guessed = [name for name, element in elements.items() if mass_of(element) and _inertia(element, links[name]) is None]
    notes = []
    if massless:
        notes.append(
            f"the URDF states no mass for {abbreviate(massless)}: estimated at {DENSITY:g} kg/m³ of the collision shapes, "
            "at least 1 g per link"
        )
    if guessed:
        notes.append(
            f"the URDF states no <inertia> that a body of that mass and size can have for {abbreviate(guessed)}: estimated from mass and "
            "collision shapes; give positive moments in kg m², none greater than the sum of the two others"
        )
    return notes


def _without_prefixes(element: Element) -> Element:
    """Copy an element without tags and attributes such as `drake:…`: XML parsers refuse a prefix that is not declared.

    Commas between numbers become blanks: PyBullet reads no others.
    """
    copy = Element(element.tag, {name: _plain(name, value) for name, value in element.attrib.items() if ":" not in name})
    copy.text, copy.tail = element.text, element.tail
    copy.extend(_without_prefixes(child) for child in element if ":" not in child.tag)
    return copy


def _plain(name: str, value: str) -> str:
    return value.replace(",", " ") if name in ("xyz", "rpy", "size") else value


def _link(element: Element, link: Link, stem: Path) -> Element:
    copy = _without_prefixes(element)
    for visual in copy.findall("visual"):
        copy.remove(visual)
    if any(shape.kind == "mesh" for shape in link.collisions):
        for collision in copy.findall("collision"):
            if collision.find("geometry/mesh") is not None:
                copy.remove(collision)
        for number, shape in enumerate(link.collisions):
            if shape.kind == "mesh":
                path = stem.with_name(f"{stem.name}-{number}.obj")
                trimesh.Trimesh(shape.mesh.vertices, shape.mesh.faces, process=False).convex_hull.export(path)
                SubElement(SubElement(SubElement(copy, "collision"), "geometry"), "mesh", filename=str(path))
    if not mass_of(element):
        for inertial in copy.findall("inertial"):
            copy.remove(inertial)
        copy.append(_estimated_inertial(link))
    else:
        inertia = _inertia(element, link)
        for inertial in copy.findall("inertial"):
            for stated in inertial.findall("inertia"):
                inertial.remove(stated)
            inertial.append(_estimated_inertia(link, mass_of(element)) if inertia is None else inertia)
    return copy


def _inertia(element: Element, link: Link) -> Element | None:
    """Read the inertia of a link that has a mass; None if its numbers are incomplete, or no body of this mass and size has it.

    Where rounded numbers violate the triangle inequality, all moments are raised by what is missing: PyBullet would take 0, and MuJoCo
    the mean of the three.
    """
    stated = element.find("inertial/inertia")
    if stated is None or not {"ixx", "iyy", "izz"} <= stated.attrib.keys():
        return None
    numbers = {name: float(numbers_of(stated, name, (0.0,))[0]) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
    xx, xy, xz, yy, yz, zz = numbers.values()
    least, middle, greatest = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).tolist()
    if least <= 0 or greatest > (1 + ROUNDED) * (least + middle):
        return None
    low, high = _box(link)
    gyration, size = np.sqrt(greatest / mass_of(element)), float(np.linalg.norm(high - low))
    if size and not LEAST_GYRATION * size <= gyration <= size:
        return None
    missing = max(greatest * (1 + 1e-6) - least - middle, 0.0)
    return Element("inertia", {name: repr(value + missing * (name[1] == name[2])) for name, value in numbers.items()})


def _estimated_inertial(link: Link) -> Element:
    """Estimate mass and inertia as those of a box of water around the collision shapes."""
    low, high = _box(link)
    mass = max(DENSITY * float(np.prod(high - low)), MIN_MASS)
    inertial = Element("inertial")
    SubElement(inertial, "origin", xyz=_text((low + high) / 2))
    SubElement(inertial, "mass", value=repr(mass))
    inertial.append(_estimated_inertia(link, mass))
    return inertial


def _estimated_inertia(link: Link, mass: float) -> Element:
    """Estimate the inertia as that of a box of this mass, kg, around the collision shapes."""
    low, high = _box(link)
    x, y, z = high - low
    moments = {"ixx": y * y + z * z, "iyy": x * x + z * z, "izz": x * x + y * y}
    zeros = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    return Element("inertia", {name: repr(max(mass / 12 * float(value), 1e-9)) for name, value in moments.items()} | zeros)


def _box(link: Link) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find the least and the greatest corner (3,) of the collision shapes, else of what is seen, m; both 0 for a link without shapes."""
    corners = np.concatenate([shape.mesh.vertices for shape in link.collisions or link.visuals] or [np.zeros((1, 3))])
    return corners.min(axis=0), corners.max(axis=0)


def _joint(element: Element, joint: Joint, hand: Hand) -> Element:
    copy = _without_prefixes(element)
    for mimic in copy.findall("mimic"):
        copy.remove(mimic)
    if joint.name in hand.frozen:
        copy.set("type", "fixed")
        for origin in copy.findall("origin"):
            copy.remove(origin)
        add_origin(copy, joint.origin)
    for axis in copy.findall("axis"):
        if not np.array_equal(numbers_of(axis, "xyz", (1.0, 0.0, 0.0)), joint.axis):  # PyBullet slides along an axis by its length
            axis.set("xyz", _text(joint.axis))
    for follower in hand.followers:
        if follower.link == joint.child:
            ends = [follower.multiplier * float(limit[follower.entry]) + follower.offset for limit in (hand.lower, hand.upper)]
            for limit in copy.findall("limit"):
                limit.set("lower", repr(min(ends) - 0.1))  # its leader's limits bind it, and its own must not conflict with them
                limit.set("upper", repr(max(ends) + 0.1))
    return copy


def add_origin(element: Element, pose: np.ndarray) -> None:
    """Add the pose (4, 4) of an element's frame; at a pitch of 90°, any of the equivalent triples of angles."""
    angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", suppress_warnings=True)
    SubElement(element, "origin", xyz=_text(pose[:3, 3]), rpy=_text(angles))


def _text(numbers: np.ndarray) -> str:
    return " ".join(repr(float(number)) for number in numbers)
