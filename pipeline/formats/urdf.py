"""URDF files: the links and joints of a hand. The format: https://wiki.ros.org/urdf/XML.

yourdfpy and urchin read them too, but keep of an origin only the matrix that the C library's sine gives: its last digits are the
processor's, and with them every pose that follows.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np

from pipeline.console import Meter, errors
from pipeline.errors import InvalidInput, missing_name
from pipeline.formats.file_content import foreign_content, parse_xml, read_file, without_mark
from pipeline.formats.mesh_companions import Companions
from pipeline.formats.mesh_parts import MAX_FACES
from pipeline.formats.mesh_reader import load_mesh
from pipeline.formats.urdf_shapes import MAX_TURN, Color, MeshReader, check_unit, material_color, numbers_of, origin_of, shape_of
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.transforms import length
from pipeline.kernels.hand.model import Hand, Inertial, Joint, Link, Mimic, Shape

MOVING = ("revolute", "continuous", "prismatic")
BAR_AFTER = 1.0  # seconds of reading meshes after which a progress bar is shown
MAX_BYTES, MAX_PARTS = 10 * 2**20, 1000  # limits of a URDF file: its size; its number of links, joints and shapes
UNMARKED = {b"<\0": "utf-16-le", b"\0<": "utf-16-be"}  # encodings by the first bytes of a file without a byte-order mark
DECLARATION = re.compile(rb"<\?xml\s[^>]*?encoding\s*=\s*[\"']([A-Za-z0-9._:-]+)[\"'][^>]*>")


def read_urdf(path: Path, root: str | None = None) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Read the links of a URDF file, the root first and parents before children, and the joints: joint i moves link i + 1.

    Mesh files are relative to it, or to a package (`package://`) around it. `root` reads this link and its descendants alone.
    """
    robot = parse_urdf(path)
    try:
        for kind in ("link", "joint"):  # hand files and physics name them
            counts = Counter(element.get("name", "") for element in robot.findall(kind))
            if twice := [name for name, count in counts.items() if name and count > 1]:
                raise InvalidInput(f"it has {counts[twice[0]]} {kind}s called {twice[0]!r}; rename all but one")
        names, joints = _tree(robot, root)
        materials = _materials(robot)
        named = {_name(element): element for element in robot.findall("link")}
        elements = [named[name] for name in names]
        files = {mesh.get("filename") for element in elements for mesh in element.iter("mesh")}
        with Meter(errors, f"{path.name}: reading meshes", len(files), "files", after=BAR_AFTER) as meter:
            read = _reader(meter)
            links = tuple(_link(element, path.parent, materials, read) for element in elements)
        numbers = {name: number for number, name in enumerate(names)}
        return links, tuple(_joint(joint, numbers) for joint in joints)
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from error


def _materials(robot: Element) -> dict[str, Color]:
    """Read the colours of materials by name; one that a link defines is known to all links, those of the robot come first."""
    colors: dict[str, Color] = {}
    for material in (*robot.findall("material"), *robot.iter("material")):
        if material.find("color") is not None and (name := material.get("name")):
            colors.setdefault(name, material_color(material, {}))
    return colors


def _tree(robot: Element, root: str | None) -> tuple[list[str], list[Element]]:
    """List the names of links from the root, and the joints below each: breadth first, in the file's order; refuse what is no tree."""
    names, joints = [_name(link) for link in robot.findall("link")], robot.findall("joint")
    roots = sorted(set(names) - {_end_link(joint, "child") for joint in joints}, key=names.index)
    if root is not None and root not in names:
        raise InvalidInput(missing_name("link", root, names))
    order, below = ([root] if root is not None else roots[:1]), list[Element]()
    for link in order:  # grows as we go
        children = [joint for joint in joints if _end_link(joint, "parent") == link]
        below += children
        order += [child for joint in children if (child := _end_link(joint, "child")) not in order]
    for joint in joints if root is None else below:
        for role in ("parent", "child"):
            if (link := _end_link(joint, role)) not in names:
                raise InvalidInput(f"joint {_name(joint)} has {role} link {link!r}, which is not among the file's links")
    every = (names, joints) if root is None else (order, below)
    if (len(order), len(below)) != (len(every[0]), len(every[1])) or len(below) != len(order) - 1:
        listed = ", ".join(name for name in roots if name in every[0]) or "none"
        raise InvalidInput(f"{len(every[0])} links with {len(every[1])} joints are not a tree with one root (roots: {listed})")
    return order, below


def _end_link(joint: Element, role: str) -> str:
    end = joint.find(role)
    return end.get("link", "") if end is not None else ""


def _reader(meter: Meter) -> MeshReader:
    """Make a function that reads each mesh file once, and refuses more faces than a hand may have."""
    faces = 0

    @cache
    def load(path: Path, package: Path) -> tuple[Mesh, tuple[Path, ...]]:
        meter.advance()
        return load_mesh(path, package), tuple(Companions(path, package).paths.values())

    def read(path: Path, package: Path) -> tuple[Mesh, tuple[Path, ...]]:
        nonlocal faces
        mesh, companions = load(path, package)
        faces += len(mesh.faces)
        if faces > MAX_FACES:
            raise InvalidInput(f"its shapes have {faces} faces or more, {MAX_FACES} are the most; decimate their meshes")
        return mesh, companions

    return read


def _link(element: Element, folder: Path, materials: Mapping[str, Color], read: MeshReader) -> Link:
    def shapes(role: str) -> tuple[Shape, ...]:
        return tuple(shape_of(shape, folder, materials, read) for shape in element.findall(role))

    return Link(_name(element), shapes("visual"), shapes("collision"), _inertial(element))


def _inertial(link: Element) -> Inertial | None:
    inertial = link.find("inertial")
    if inertial is None:
        return None
    mass, inertia = _number(inertial.find("mass"), "value"), inertial.find("inertia")
    if mass < 0:
        raise InvalidInput(f"link {_name(link)} has the mass {mass:g} kg; give a positive one, or none, and it is estimated")
    pose, rpy = origin_of(inertial)
    moments = tuple(_number(inertia, name) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    complete = inertia is not None and {"ixx", "iyy", "izz"} <= inertia.attrib.keys()
    return Inertial(mass, pose[:3, 3], rpy, moments if complete else None) if mass else None


def _number(element: Element | None, name: str, default: float = 0.0) -> float:
    return float(numbers_of(element, name, (default,))[0])


def _joint(element: Element, numbers: Mapping[str, int]) -> Joint:
    name, kind = _name(element), element.get("type", "")
    if kind not in (*MOVING, "fixed"):
        raise InvalidInput(f"joint {name} is of type {kind!r}; supported are {', '.join((*MOVING, 'fixed'))}")
    parent, child = (numbers[_end_link(element, role)] for role in ("parent", "child"))
    axis = numbers_of(element.find("axis") if kind in MOVING else None, "xyz", (1.0, 0.0, 0.0))  # exporters fix joints about 0 0 0
    if not axis.any():
        raise InvalidInput(f"joint {name} has the axis 0 0 0; give a direction")
    limit, dynamics, (origin, rpy) = element.find("limit"), element.find("dynamics"), origin_of(element)
    mimic = None
    if (stated := element.find("mimic")) is not None and kind != "fixed":
        mimic = Mimic(stated.get("joint", ""), _number(stated, "multiplier", 1.0), _number(stated, "offset"))
        if mimic.multiplier == 0:
            raise InvalidInput(f"joint {name} mimics {mimic.joint!r} with multiplier 0; make it fixed")
        check_unit(f"joint {name} mimics {mimic.joint!r} with offset", (mimic.offset,), slides=kind == "prismatic")
    joint = Joint(
        name,
        kind,
        parent,
        child,
        origin,
        axis / length(axis),
        lower=_number(limit, "lower"),
        upper=_number(limit, "upper"),
        mimic=mimic,
        rpy=rpy,
        damping=_number(dynamics, "damping"),
        friction=_number(dynamics, "friction"),
    )
    if kind in MOVING and stated is None:  # a follower's are its leader's
        lower, upper = joint.limits
        if not lower < upper:
            raise InvalidInput(f"joint {name} has limits {lower} … {upper}; the lower one must be the smaller")
        check_unit(f"joint {name} has limits", (lower, upper), slides=kind == "prismatic")
    return joint


def ignored_limits(hand: Hand) -> Iterator[str]:
    """Describe the continuous joints whose URDF states limits that they would keep if they were revolute."""
    for joint in hand.joints:
        full_turn = joint.lower <= -0.99 * np.pi and 0.99 * np.pi <= joint.upper < MAX_TURN
        if joint.kind == "continuous" and joint.lower < joint.upper and not full_turn:
            yield (
                f"joint {joint.name} is continuous, so its limits {joint.lower:g} … {joint.upper:g} do not count: it turns through "
                "-3.14 … 3.14 rad; if they should count, make it revolute, with limits in radians"
            )


def _name(element: Element) -> str:
    name = element.get("name")
    if not name:
        raise InvalidInput(f"a <{element.tag}> has no name")
    return name


def parse_urdf(path: Path) -> Element:
    """Parse a URDF file; raise an `InvalidInput` that names the file if it is none."""
    content = read_file(path, MAX_BYTES)
    try:
        if foreign := foreign_content(content):
            raise InvalidInput(f"it is {foreign}")
        robot = parse_xml(_decode(content))
        _check_format(robot)
    except (expat.ExpatError, ValueError) as error:
        reason = error if isinstance(error, InvalidInput) else f"it is not XML ({error}); a hand's `model` must be a URDF or an MJCF file"
        raise InvalidInput(f"{path}: {reason}") from error
    for shape in robot.iterfind(".//geometry/*"):
        shape.tag = shape.tag.removeprefix("drake:")  # Drake's `<drake:capsule>`: the physics engines know it without
    return robot


def _decode(content: bytes) -> str:
    """Decode XML by its byte-order mark, or the encoding that it declares: expat knows four."""
    unmarked = without_mark("it", content)
    declaration = DECLARATION.match(unmarked.lstrip()) if unmarked == content else None
    encoding = UNMARKED.get(content[:2]) or (declaration[1].decode() if declaration else "utf-8")
    try:
        return unmarked.decode(encoding)
    except (LookupError, UnicodeError) as error:
        raise InvalidInput(f"it is not text in {encoding} ({error}); save it as UTF-8") from error


def _check_format(robot: Element) -> None:
    if robot.tag != "robot":
        raise InvalidInput(f"its root is <{robot.tag}>; a hand's `model` must be a URDF, whose root is <robot>, or an MJCF: convert it")
    if (parts := sum(element.tag in ("link", "joint", "visual", "collision") for element in robot.iter())) > MAX_PARTS:
        raise InvalidInput(f"it has {parts} links, joints and shapes, {MAX_PARTS} are the most")
    for element in robot.iter():
        marked = [f' {name}="{value}"' for name, value in element.attrib.items() if "${" in value or "$(" in value]
        if marked or element.tag.startswith("xacro:"):
            part = f"<{element.tag}{''.join(marked[:1])}>"
            raise InvalidInput(f"it is xacro, from which a URDF is made: it has {part[:100]}; run xacro first, `xacro IN > OUT.urdf`")
