"""STL files: how long binary ones are, text, and colours, which are said."""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.formats.mesh_file import parse_mesh
from pipeline.formats.mesh_parts import GREY
from pipeline.formats.stl import MESHLAB

BOX = trimesh.creation.box((1, 2, 3))
TEXT = BOX.export(file_type="stl_ascii")


def binary(title: bytes = b"made by CAD", attributes: Sequence[int] = (0,) * 12, count: int = 12) -> bytes:
    """Write the box as binary STL."""
    rows = [struct.pack("<12fH", 0, 0, 0, *corners.ravel(), word) for corners, word in zip(BOX.triangles, attributes, strict=True)]
    return title.ljust(80) + struct.pack("<I", count) + b"".join(rows)


def read(folder: Path, content: bytes | str) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Read triangles, the colour of each, and what is not read."""
    (folder / "box.stl").write_bytes(content if isinstance(content, bytes) else content.encode())
    mesh = parse_mesh(folder / "box.stl", folder)
    return mesh.triangles, mesh.look.base_color[mesh.look.face_material], mesh.unread


@pytest.mark.parametrize("title", [b"", b"solid of CAD", b"solid facet normal vertex"])
@pytest.mark.parametrize("behind", [b"", b"\0", b"1234567", bytes(50), b"x" * 120])
def test_binary_file_is_read_as_long_as_its_header_says(tmp_path: Path, title: bytes, behind: bytes) -> None:
    triangles, colors, unread = read(tmp_path, binary(title) + behind)
    np.testing.assert_allclose(triangles, BOX.triangles)
    assert (colors == GREY).all()
    assert unread == ((f"{len(behind)} bytes after the last of 12 triangles are ignored",) if behind else ())


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (binary()[:400], "12 triangles take 684 bytes, it has 400; it is cut off"),
        (binary(count=6), "header says 6 triangles, and 6 more follow"),
        (binary(count=0), "header says 0 triangles, and 12 more follow"),
        (b"<html>not found</html>", "is a web page"),
        (TEXT[: TEXT.rindex("endsolid")], "ends after 12 facets without the word endsolid"),
        (TEXT[:800], "in 6 facets are no triangles"),
        (TEXT.replace("endloop", "vertex 0 0 0\nendloop"), "48 vertices in 12 facets are no triangles"),
        (TEXT.replace("0.5", "0,5"), "'-?0,5' where a number is expected; write decimal points"),
    ],
)
def test_cut_off_and_damaged_files_are_refused(tmp_path: Path, content: bytes | str, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        read(tmp_path, content)


@pytest.mark.parametrize(
    "text", [TEXT, TEXT.upper(), TEXT.replace("\n", "\r\n"), TEXT.replace("\n", "\r"), f"\n{TEXT}", TEXT.replace("\n", " ")]
)
@pytest.mark.parametrize("solids", [1, 3])
def test_text_with_one_or_more_solids_is_read(tmp_path: Path, text: str, solids: int) -> None:
    triangles, _, unread = read(tmp_path, text * solids)
    np.testing.assert_allclose(triangles, np.tile(BOX.triangles, (solids, 1, 1)))
    assert unread == ()


@pytest.mark.parametrize(
    ("title", "words", "said"),
    [
        (b"", [0x8000 | 27 << 10, 0] * 6, True),
        (b"", [0x8000] * 12, True),
        (MESHLAB, [0x8000] * 12, False),
        (MESHLAB, [0x8000, 0] * 6, True),
    ],
)
def test_colours_are_said(tmp_path: Path, title: bytes, words: list[int], said: bool) -> None:
    _, colors, unread = read(tmp_path, binary(title, words))
    assert (colors == GREY).all()
    assert unread == (("colours of the STL (attributes of its triangles) are not read; write it as PLY",) if said else ())
