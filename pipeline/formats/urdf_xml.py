"""The XML of a URDF file: its encoding, its limits, and other formats that are given in its place."""

import re
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from pipeline.errors import InvalidInput
from pipeline.formats.file_content import MARKS, read_file, without_mark

MAX_BYTES, MAX_PARTS = 10 * 2**20, 1000  # limits of a URDF file: its size; its number of links, joints and shapes
UNMARKED = {b"<\0": "utf-16-le", b"\0<": "utf-16-be"}
"""Encodings by the first bytes of a file without a byte-order mark."""
DECLARATION = re.compile(rb"<\?xml\s[^>]*?encoding\s*=\s*[\"']([A-Za-z0-9._:-]+)[\"'][^>]*>")
OTHER_FORMATS = {
    "mujoco": "MJCF, MuJoCo's format",
    "mujocoinclude": "a part of an MJCF file, MuJoCo's format",
    "sdf": "SDF, Gazebo's format",
    "gazebo": "SDF, Gazebo's format",
    "model": "the model.config of an SDF model",
    "COLLADA": "COLLADA, a format of meshes",
    "launch": "a launch file of ROS",
    "html": "a web page: download the file itself",
}
"""Formats by their root element."""


def parse_urdf(path: Path) -> Element:
    """Parse a URDF file; raise an `InvalidInput` that names the file if it is none."""
    content = read_file(path, MAX_BYTES)
    try:
        text = _decode(content)
        _check_size(text)
        robot = _parse_xml(text)
        _check_format(robot)
        return robot
    except (expat.ExpatError, ValueError) as error:
        reason = error if isinstance(error, InvalidInput) else f"it is not XML ({error}); a hand's `urdf` must be a URDF file"
        raise InvalidInput(f"{path}: {reason}") from error


def _decode(content: bytes) -> str:
    """Decode XML by its byte-order mark, or the encoding that it declares: expat knows four."""
    marked = content.startswith(tuple(MARKS))
    content = without_mark("it", content)
    encoding = UNMARKED.get(content[:2])
    declaration = None if marked else DECLARATION.match(content.lstrip())
    try:
        if encoding is None and declaration is not None:
            encoding = declaration[1].decode()
            if declaration[0].decode(encoding) != declaration[0].decode():  # such as UTF-16, in which it cannot be read
                raise InvalidInput(f"it says that its encoding is {encoding}, and it is another; save it as UTF-8")
        return content.decode(encoding or "utf-8")
    except LookupError as error:
        raise InvalidInput(f"its encoding, {encoding}, is unknown; save it as UTF-8") from error
    except UnicodeError as error:
        stated = f"{encoding}, as it says" if encoding else "UTF-8, and names no other encoding"
        raise InvalidInput(f"it is not in {stated} ({error}); save it as UTF-8") from error


def _check_size(text: str) -> None:
    """Refuse content that no hand has, and that would take minutes or gigabytes to read."""
    if re.match(r"\s*<(!doctype\s+)?html", text, re.IGNORECASE):
        raise InvalidInput(_foreign("html"))
    if "<!" in text.replace("<!--", "").replace("<![CDATA[", ""):
        raise InvalidInput("it declares a document type or entities; write out their content")
    if (parts := sum(text.count(tag) for tag in ("<link", "<joint", "<visual", "<collision"))) > MAX_PARTS:
        raise InvalidInput(f"it has {parts} links, joints and shapes, {MAX_PARTS} are the most")


def _parse_xml(text: str) -> Element:
    """Parse XML whose prefixes need no declaration: Drake's `<drake:…>` never has one.

    Drake's own shapes, such as `<drake:capsule>`, lose their prefix: the physics engines know them without.
    """
    tree, parser = TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = tree.start, tree.end, tree.data
    parser.Parse(text, True)
    robot = tree.close()
    for geometry in robot.iter("geometry"):
        for shape in geometry:
            shape.tag = shape.tag.removeprefix("drake:")
    return robot


def _check_format(robot: Element) -> None:
    if robot.tag != "robot":
        raise InvalidInput(_foreign(robot.tag))
    for element in robot.iter():
        marked = [f' {name}="{value}"' for name, value in element.attrib.items() if "${" in value or "$(" in value]
        if marked or element.tag.startswith("xacro:"):
            part = f"<{element.tag}{''.join(marked[:1])}>"
            raise InvalidInput(f"it is xacro, from which a URDF is made: it has {part[:100]}; run xacro first, `xacro IN > OUT.urdf`")


def _foreign(root: str) -> str:
    name = OTHER_FORMATS.get(root, f"a file whose root is <{root}>")
    return f"it is {name}; a hand's `urdf` must be a URDF file, whose root is <robot>: name that, or convert this one"
