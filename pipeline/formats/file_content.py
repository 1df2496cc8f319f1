"""Read files that come from a user or a stranger."""

import errno
import os
import re
import stat
from pathlib import Path
from typing import IO
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from pipeline.errors import InvalidInput

MESH_SUFFIXES = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf", ".dae", ".3mf")  # formats of mesh files that are read; no archives
MAX_POINTER = 1024  # size that a Git LFS pointer stays below (its specification, version 1)
POINTER_REMEDY = "a Git LFS pointer; run `git lfs pull`"
HEAD_BYTES = 4096  # bytes within which foreign content shows what it is
POINTER = re.compile(rb"version (https://(git-lfs|hawser)\.github\.com/spec/v|http://git-media\.io/v/)\d")
"""How a Git LFS pointer begins, also one of the first versions."""
MARKS = {  # byte-order marks and the encodings that they announce; UTF-32 before UTF-16, which has the same first bytes
    b"\xef\xbb\xbf": "utf-8",
    b"\xff\xfe\0\0": "utf-32-le",
    b"\0\0\xfe\xff": "utf-32-be",
    b"\xff\xfe": "utf-16-le",
    b"\xfe\xff": "utf-16-be",
}
XML_ENCODING = re.compile(r"""^(\s*<\?xml\b[^>]*?)\s+encoding\s*=\s*["'][^"']*["']""")
PROLOGUE = rb"\s*+(<\?xml[^>]*>\s*+)?(?><!--.*?-->\s*+)*+"
"""Text that may precede the first element of XML or HTML. Possessive: backtracking in a long comment would need much memory."""
FOREIGN = {  # contents that stand in the place of other files, by a pattern of their beginning: what each is, and the remedy
    PROLOGUE + rb"<((?i:!doctype\s+html|html|head|body)\b)": "a web page (HTML); download the file itself",
    PROLOGUE + rb"(<!DOCTYPE svg[^>]*>\s*)?<svg\b": "an SVG drawing; convert it to PNG",
    rb"\s*(40[134]: |Entry not found|\{\s*\"(message|error)\"\s*:)|"
    + PROLOGUE
    + rb"<Error>\s*<Code>": "an error message of a server; download the file itself",
    rb"/annex/objects/": "a git-annex pointer; run `git annex get`",
    rb"PK(\x03\x04|\x05\x06)": "a ZIP archive; unpack it",
    rb"\x1f\x8b|BZh\d1AY|\xfd7zXZ|\x28\xb5\x2f\xfd|7z\xbc\xaf|Rar!|.{257}ustar": "compressed, or an archive; unpack it",
    rb"\x76\x2f\x31\x01": "an OpenEXR image; convert it to PNG",
    rb"#\?(RADIANCE|RGBE)": "a Radiance HDR image; convert it to PNG",
    rb"\xabKTX ": "a KTX texture; convert it to PNG",
    rb"\0\0\0\x0cjP  |\xff\x4f\xff\x51": "a JPEG 2000 image; convert it to PNG",
    rb"\0\0\0\x0cJXL |\xff\x0a": "a JPEG XL image; convert it to PNG",
    rb".{4}ftyp(avi|hei|mif|hev)": "an AVIF or HEIC image; convert it to PNG",
    rb"8BPS": "a Photoshop image; convert it to PNG",
    rb"Kaydara FBX|; FBX ": "an FBX file; export the mesh as GLB",
    rb"BLENDER": "a Blender file; export the mesh as GLB",
    rb"ISO-10303-21": "a STEP file; export the mesh as STL",
}


def expanded(path: Path | str) -> Path:
    """Replace a leading `~` or `~USER` by that home folder; `~USER` stays if there is no such user, where pathlib raises."""
    return Path(os.path.expanduser(path))


def regular_stat(path: Path | str) -> os.stat_result:
    """Return size and times of a regular file; raise an `OSError` for others: a pipe may block for ever, a device may never end.

    Call this before a file that comes from a user or a stranger is opened, here or by a library.
    """
    try:
        status = os.stat(path)
        regular = stat.S_ISREG(status.st_mode)
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        regular = False
    except ValueError as error:  # a name with a zero byte, which no file has
        raise FileNotFoundError(errno.ENOENT, f"no file has such a name: {error}", str(path)) from error
    if not regular:
        raise IsADirectoryError(errno.EISDIR, "it is not a regular file", str(path))
    return status


def read_file(
    path: Path,
    max_bytes: int,
    name: str = "",  # for messages, by default the path
) -> bytes:
    """Read a regular file of at most `max_bytes` that is no Git LFS pointer."""
    name = name or str(path)
    try:
        if (size := regular_stat(path).st_size) > max_bytes:
            raise InvalidInput(f"{name} has {size} bytes; {max_bytes} are the most that are read")
        content = path.read_bytes()
    except OSError as error:
        raise InvalidInput(f"{name} cannot be read ({error.strerror}); give the path of a file that can") from error
    if is_pointer(content):
        raise InvalidInput(f"{name} is {POINTER_REMEDY}")
    return content


def read_text(path: Path, max_bytes: int) -> str:
    """Read a text file in UTF-8, or as its byte-order mark says; raise an `InvalidInput` as `read_file`, or if it is no such text."""
    content = without_mark(path, read_file(path, max_bytes))
    if content and (foreign := foreign_content(content)):
        raise InvalidInput(f"{path} is {foreign}")
    try:
        return content.decode()
    except UnicodeDecodeError as error:
        raise InvalidInput(f"{path} is not text in UTF-8 ({error}); save it as UTF-8") from error


def is_pointer(content: bytes) -> bool:
    """Check whether the content of a file is a Git LFS pointer: the text in its place before `git lfs pull`."""
    return len(content) < MAX_POINTER and POINTER.match(content) is not None


def is_pointer_file(path: Path | str) -> bool:
    """Check whether a file is a Git LFS pointer; one that cannot be read is none."""
    try:
        return regular_stat(path).st_size < MAX_POINTER and is_pointer(Path(path).read_bytes())
    except OSError:
        return False


def foreign_content(content: bytes) -> str | None:
    """Name content that is recognised and neither a mesh nor an image that can be read, with a remedy: "a web page (HTML); …"."""
    if not content:
        return "an empty file"
    if is_pointer(content):
        return POINTER_REMEDY
    start = content[:HEAD_BYTES]
    return next((name for pattern, name in FOREIGN.items() if re.match(pattern, start, re.DOTALL)), None)


def refuse_foreign(name: str, content: bytes) -> None:
    """Raise an `InvalidInput` if the content of a mesh file is of another kind that is recognised."""
    foreign = foreign_content(content)
    if foreign and not (name.lower().endswith(".3mf") and content.startswith(b"PK")):  # which is a ZIP archive
        raise InvalidInput(f"{name} is {foreign}")


def without_mark(path: object, content: bytes) -> bytes:
    """Encode text that begins with a byte-order mark as UTF-8 without one; return other content as it is."""
    mark = next((mark for mark in MARKS if content.startswith(mark)), None)
    if mark is None or MARKS[mark] == "utf-8":
        return content.removeprefix(mark or b"")
    try:
        text = content[len(mark) :].decode(MARKS[mark])
    except UnicodeDecodeError as error:
        raise InvalidInput(f"{path} begins like text in {MARKS[mark].upper()} and is not; save it as UTF-8") from error
    return XML_ENCODING.sub(r"\1", text).encode()


def parse_xml(content: bytes | str | IO[bytes], tree: TreeBuilder | None = None) -> Element:
    """Parse XML whose prefixes need no declaration, and stay; refuse a document type, which may declare entities."""

    def refuse_entities(*_: object) -> None:
        raise InvalidInput("its XML declares a document type or entities; write out their content")

    tree, parser = tree or TreeBuilder(), expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse_entities
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = tree.start, tree.end, tree.data
    if isinstance(content, bytes | str):
        parser.Parse(content, True)
    else:
        parser.ParseFile(content)
    return tree.close()


def decode_text(content: bytes) -> str:
    """Decode text that is UTF-8, or else Latin-1."""
    try:
        return content.decode()
    except UnicodeDecodeError:
        return content.decode("latin-1")
