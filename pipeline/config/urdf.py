"""URDF files: the links and joints of a hand. The format: https://wiki.ros.org/urdf/XML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError, fromstring

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.config.mesh_file import load_mesh
from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.geometry.transforms import length, rotation_from_euler, transform_points
from pipeline.kernels.hand.model import Joint, Link, Shape

Color = tuple[int, int, int]
MOVING = ("revolute", "continuous", "prismatic")
MAX_BYTES, MAX_PARTS, MAX_NUMBER = 10 * 2**20, 1000, 1e6
"""What a URDF file may have: bytes; links, joints and shapes; metres or radians."""

GREY: Color = (178, 178, 178)
"""sRGB colour of a visual shape that names none."""


def read_urdf(path: Path) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Read the links and joints of a URDF file, and the meshes that it names.

    Parameters
    ----------
    path
        The file; mesh files are relative to it.

    Returns
    -------
    links
        The root link first, parents before children.
    joints
        Joint i moves link i + 1.

    Raises
    ------
    InvalidInput
        The file is no URDF tree, or uses what is not supported; the message names the file and the part.
    """
    try:
        content = path.read_bytes()
        _check_size(content)
        root = fromstring(content)
        materials = {material.get("name", ""): _color(material, {}) for material in root.findall("material")}
        links = tuple(_link(element, path.parent, materials) for element in root.findall("link"))
        numbers = {link.name: i for i, link in enumerate(links)}
        return _in_tree_order(links, [_joint(element, numbers) for element in root.findall("joint")])
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from error
    except (OSError, ParseError, ValueError, LookupError) as error:  # the last two: its encoding is unknown
        raise InvalidInput(f"{path}: not XML ({error}); a hand's `urdf` must be a URDF file, not xacro") from error


def _check_size(content: bytes) -> None:
    """Refuse what no hand has and what would take minutes or gigabytes to read."""
    if len(content) > MAX_BYTES:
        raise InvalidInput(f"it has {len(content)} bytes, {MAX_BYTES} are the most")
    if b"\0" in content or b"<!" in content.replace(b"<!--", b""):
        raise InvalidInput("it declares a document type or entities, or is no UTF-8; write out what they stand for")
    if (parts := sum(content.count(tag) for tag in (b"<link", b"<joint", b"<visual", b"<collision"))) > MAX_PARTS:
        raise InvalidInput(f"it has {parts} links, joints and shapes, {MAX_PARTS} are the most")


def _link(element: Element, folder: Path, materials: Mapping[str, Color]) -> Link:
    visuals, collisions = (tuple(_shape(shape, folder, materials) for shape in element.findall(role)) for role in ("visual", "collision"))
    return Link(_name(element), visuals, collisions)


def _joint(element: Element, numbers: Mapping[str, int]) -> Joint:
    name, kind = _name(element), element.get("type", "")
    if kind not in (*MOVING, "fixed"):
        raise InvalidInput(f"joint {name} is of type {kind!r}; supported are {', '.join((*MOVING, 'fixed'))}")
    if element.find("mimic") is not None:
        raise InvalidInput(f"joint {name} mimics another one, which is not supported; give it its own motor or make it fixed")
    ends = []
    for role in ("parent", "child"):
        end = element.find(role)
        link = end.get("link", "") if end is not None else ""
        if link not in numbers:
            raise InvalidInput(f"joint {name} has {role} link {link!r}, which is not among the file's links")
        ends.append(numbers[link])
    axis = _numbers(element.find("axis") if kind in MOVING else None, "xyz", (1.0, 0.0, 0.0))  # exporters fix joints about 0 0 0
    if not axis.any():
        raise InvalidInput(f"joint {name} has the axis 0 0 0; give a direction")
    lower, upper = (float(_numbers(element.find("limit"), key, (0.0,))[0]) for key in ("lower", "upper"))
    if kind == "continuous":
        lower, upper = -np.pi, np.pi
    if kind in MOVING and not lower < upper:
        raise InvalidInput(f"joint {name} has limits {lower} … {upper}; the lower one must be the smaller")
    return Joint(name, kind, ends[0], ends[1], _origin(element), axis / length(axis), lower, upper)


def _in_tree_order(links: tuple[Link, ...], joints: list[Joint]) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Renumber links root first and order joints so that every parent comes before its children."""
    children = [joint.child for joint in joints]
    roots = [i for i in range(len(links)) if i not in children]
    order, sequence = roots[:1], []
    if len(set(children)) == len(joints):
        for link in order:  # grows as we go: breadth first, in the file's order
            below = [joint for joint in joints if joint.parent == link]
            sequence += below
            order += [joint.child for joint in below]
    if len(order) != len(links):
        names = ", ".join(links[i].name for i in roots)
        raise InvalidInput(f"{len(links)} links with {len(joints)} joints are no tree with one root (roots: {names})")
    new = {old: i for i, old in enumerate(order)}
    renumbered = tuple(replace(joint, parent=new[joint.parent], child=new[joint.child]) for joint in sequence)
    return tuple(links[i] for i in order), renumbered


def _shape(element: Element, folder: Path, materials: Mapping[str, Color]) -> Shape:
    origin, color = _origin(element), _color(element.find("material"), materials)
    for part in element.findall("geometry/*"):
        path, scale = None, (1.0, 1.0, 1.0)
        body: Any
        if part.tag == "box":
            size = _sizes(part, size=3)
            body = trimesh.creation.box(extents=size)
        elif part.tag == "sphere":
            size = _sizes(part, radius=1)
            body = trimesh.creation.icosphere(subdivisions=3, radius=size[0])
        elif part.tag == "cylinder":
            size = _sizes(part, radius=1, length=1)
            body = trimesh.creation.cylinder(radius=size[0], height=size[1], sections=32)
        elif part.tag == "mesh":
            size = scale = tuple(_numbers(part, "scale", scale).tolist())
            path = folder / part.get("filename", "").removeprefix("file://")
            body = load_mesh(path)
        else:
            continue
        vertices, faces = transform_points(origin, body.vertices * scale), np.asarray(body.faces, np.int32)
        return Shape(part.tag, size, origin, Mesh(vertices, faces, Look.plain(len(vertices), len(faces), color)), path)
    raise InvalidInput(f"a {element.tag} has no box, sphere, cylinder or mesh")


def _sizes(element: Element, **counts: int) -> tuple[float, ...]:
    """Read the positive numbers of some attributes, given how many each holds."""
    sizes: list[float] = []
    for key, count in counts.items():
        numbers = _numbers(element, key, (0.0,) * count)
        if not (numbers > 0).all():
            raise InvalidInput(f"a {element.tag} has {key}={element.get(key)!r}; give positive metres")
        sizes += numbers.tolist()
    return tuple(sizes)


def _name(element: Element) -> str:
    name = element.get("name")
    if not name:
        raise InvalidInput(f"a <{element.tag}> has no name")
    return name


def _color(material: Element | None, known: Mapping[str, Color]) -> Color:
    """Read the sRGB colour of a material, by its own element or by name."""
    if material is None:
        return GREY
    color = material.find("color")
    if color is None:
        return known.get(material.get("name", ""), GREY)
    red, green, blue, _ = (round(255 * part) for part in np.clip(_numbers(color, "rgba", (0.7, 0.7, 0.7, 1.0)), 0, 1).tolist())
    return red, green, blue


def _numbers(element: Element | None, key: str, default: tuple[float, ...]) -> NDArray[np.float64]:
    """Read the finite numbers of an attribute, as many as its default has."""
    if element is None or (text := element.get(key)) is None:
        return np.array(default, np.float64)
    try:
        numbers = np.array([float(part) for part in text.split()], np.float64)
    except ValueError:
        numbers = np.array([np.nan])
    if len(numbers) != len(default) or not (np.abs(numbers) <= MAX_NUMBER).all():
        raise InvalidInput(f"<{element.tag} {key}={text!r}> must hold {len(default)} finite numbers, none beyond {MAX_NUMBER:g}")
    return numbers


def _origin(element: Element) -> NDArray[np.float64]:
    origin = element.find("origin")
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_euler(_numbers(origin, "rpy", (0.0, 0.0, 0.0)))  # fixed axes, as URDF says
    pose[:3, 3] = _numbers(origin, "xyz", (0.0, 0.0, 0.0))
    return pose
