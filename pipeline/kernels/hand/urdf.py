"""A URDF as plain data: links with their shapes, joints in tree order.

The format: https://wiki.ros.org/urdf/XML.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Color = tuple[float, float, float, float]
MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, eq=False)
class Shape:
    """A visual or collision shape: `origin` (4, 4) in its link's frame, `size` in metres, a colour in 0..1.

    `size` is (x, y, z) of a box, (radius,) of a sphere, (radius, length along z) of a cylinder, the (x, y, z) scale of a mesh.
    """

    kind: Literal["box", "sphere", "cylinder", "mesh"]
    origin: NDArray[np.float64]
    size: tuple[float, ...]
    path: Path | None
    color: Color | None


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid part: its name and shapes."""

    name: str
    visuals: tuple[Shape, ...]
    collisions: tuple[Shape, ...]


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint from link number `parent` to link number `child`; `origin` (4, 4) is the child's frame in the parent's at rest."""

    name: str
    kind: str
    parent: int
    child: int
    origin: NDArray[np.float64]
    axis: NDArray[np.float64]
    lower: float
    upper: float


def parse_urdf(path: Path) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Links, the root first, and joints, every parent before its children.

    Raises `ValueError`, naming the file and the part, for what is no URDF tree or uses what this project does not support.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise ValueError(f"{path}: no XML ({error}); a hand's `urdf` must be a URDF file, not xacro") from error
    materials = {m.get("name", ""): _color(m, {}, path) for m in root.findall("material")}
    links = tuple(
        Link(_name(e, path), _shapes(e, "visual", path, materials), _shapes(e, "collision", path, materials)) for e in root.findall("link")
    )
    numbers = {link.name: i for i, link in enumerate(links)}
    joints = [_joint(e, numbers, path) for e in root.findall("joint")]
    return _sorted_tree(links, joints, path)


def _joint(element: ElementTree.Element, numbers: dict[str, int], path: Path) -> Joint:
    name, kind = _name(element, path), element.get("type", "")
    if kind not in (*MOVING, "fixed"):
        raise ValueError(f"{path}: joint {name} is of type {kind!r}; supported are {', '.join((*MOVING, 'fixed'))}")
    if element.find("mimic") is not None:
        raise ValueError(f"{path}: joint {name} mimics another one, which is not supported; give it its own motor or make it fixed")
    ends = []
    for role in ("parent", "child"):
        end = element.find(role)
        link = end.get("link", "") if end is not None else ""
        if link not in numbers:
            raise ValueError(f"{path}: joint {name} has {role} link {link!r}, which is not among the file's links")
        ends.append(numbers[link])
    axis = _numbers(element.find("axis") if kind in MOVING else None, "xyz", (1.0, 0.0, 0.0), path)  # exporters fix joints about 0 0 0
    if not axis.any():
        raise ValueError(f"{path}: joint {name} has the axis 0 0 0; give a direction")
    limit = element.find("limit")
    lower, upper = (float(limit.get(k, "0")) if limit is not None else 0.0 for k in ("lower", "upper"))
    if kind == "continuous":
        lower, upper = -np.pi, np.pi
    if kind in MOVING and not -np.inf < lower < upper < np.inf:
        raise ValueError(f"{path}: joint {name} has limits {lower} … {upper}; both must be finite, the lower one the smaller")
    return Joint(name, kind, ends[0], ends[1], _origin(element, path), axis / np.linalg.norm(axis), lower, upper)


def _sorted_tree(links: tuple[Link, ...], joints: list[Joint], path: Path) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Renumber links root first and order joints so that every parent's pose is known before its children's."""
    parents = {j.child: j for j in joints}
    roots = [i for i in range(len(links)) if i not in parents]
    if len(roots) != 1 or len(parents) != len(joints):
        names = ", ".join(links[i].name for i in roots)
        raise ValueError(f"{path}: {len(links)} links with {len(joints)} joints are no tree with one root (roots: {names})")
    order, sequence = [roots[0]], []
    for link in order:  # grows as we go: breadth first, in the file's order
        for joint in joints:
            if joint.parent == link:
                sequence.append(joint)
                order.append(joint.child)
    new = {old: i for i, old in enumerate(order)}
    renumbered = tuple(Joint(j.name, j.kind, new[j.parent], new[j.child], j.origin, j.axis, j.lower, j.upper) for j in sequence)
    return tuple(links[i] for i in order), renumbered


def _shapes(link: ElementTree.Element, tag: str, path: Path, materials: dict[str, Color | None]) -> tuple[Shape, ...]:
    return tuple(_shape(element, path, materials) for element in link.findall(tag))


def _shape(element: ElementTree.Element, path: Path, materials: dict[str, Color | None]) -> Shape:
    geometry = element.find("geometry")
    origin, color = _origin(element, path), _color(element.find("material"), materials, path)
    for part in geometry if geometry is not None else ():
        if part.tag == "box":
            return Shape("box", origin, _sizes(part, "size", path), None, color)
        if part.tag == "sphere":
            return Shape("sphere", origin, _sizes(part, "radius", path), None, color)
        if part.tag == "cylinder":
            return Shape("cylinder", origin, _sizes(part, "radius", path) + _sizes(part, "length", path), None, color)
        if part.tag == "mesh":
            file = path.parent / part.get("filename", "").removeprefix("file://")
            if not file.is_file():
                raise ValueError(f"{path}: mesh {part.get('filename')!r} is not there ({file}); paths are relative to the URDF")
            return Shape("mesh", origin, tuple(_numbers(part, "scale", (1.0, 1.0, 1.0), path).tolist()), file, color)
    raise ValueError(f"{path}: a {element.tag} has no box, sphere, cylinder or mesh")


def _sizes(element: ElementTree.Element, key: str, path: Path) -> tuple[float, ...]:
    sizes = _numbers(element, key, (0.0, 0.0, 0.0) if key == "size" else (0.0,), path)
    if not (sizes > 0).all():
        raise ValueError(f"{path}: a {element.tag} has {key}={element.get(key)!r}; give positive metres")
    return tuple(sizes.tolist())


def _name(element: ElementTree.Element, path: Path) -> str:
    name = element.get("name")
    if not name:
        raise ValueError(f"{path}: a <{element.tag}> has no name")
    return name


def _color(element: ElementTree.Element | None, materials: dict[str, Color | None], path: Path) -> Color | None:
    if element is None:
        return None
    color = element.find("color")
    if color is None:
        return materials.get(element.get("name", ""))
    r, g, b, a = _numbers(color, "rgba", (0.7, 0.7, 0.7, 1.0), path)
    return float(r), float(g), float(b), float(a)


def _numbers(element: ElementTree.Element | None, key: str, default: tuple[float, ...], path: Path) -> NDArray[np.float64]:
    """The finite numbers of an attribute, as many as its default has."""
    text = element.get(key) if element is not None else None
    if element is None or text is None:
        return np.array(default, np.float64)
    try:
        numbers = np.array([float(part) for part in text.split()], np.float64)
    except ValueError:
        numbers = np.array([np.nan])
    if len(numbers) != len(default) or not np.isfinite(numbers).all():
        raise ValueError(f"{path}: <{element.tag} {key}={text!r}> must hold {len(default)} finite numbers")
    return numbers


def _origin(element: ElementTree.Element, path: Path) -> NDArray[np.float64]:
    origin = element.find("origin")
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", _numbers(origin, "rpy", (0.0, 0.0, 0.0), path)).as_matrix()  # fixed axes, as URDF says
    pose[:3, 3] = _numbers(origin, "xyz", (0.0, 0.0, 0.0), path)
    return pose
