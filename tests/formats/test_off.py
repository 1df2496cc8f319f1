"""OFF files: what may stand before, in and behind their lines; colours are said."""

from pathlib import Path

import pytest

from pipeline.errors import InvalidInput
from pipeline.formats.mesh_file import parse_mesh
from pipeline.kernels.geometry.mesh import Mesh

CORNERS = ("0 0 0", "1 0 0", "1 1 0", "0 1 0")
FACES = ("3 0 1 2", "3 0 2 3")


def read(folder: Path, *lines: str, end: str = "\n") -> Mesh:
    (folder / "a.off").write_bytes("".join(line + end for line in lines).encode())
    return parse_mesh(folder / "a.off", folder)


@pytest.mark.parametrize(
    "head", [("OFF", "4 2 0"), ("OFF 4 2 5",), ("OFF4 2 0",), ("# made by", "", "OFF # x", "4 2"), ("4 2 0",), ("off", "4 2 0")]
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_first_lines_of_every_form_are_read(tmp_path: Path, head: tuple[str, ...], end: str) -> None:
    mesh = read(tmp_path, *head, *CORNERS, "", *FACES, end=end)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.unread == ()


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (("OFF", "4 2 0", *CORNERS, "3 0 1 2 7", FACES[1]), "colours of faces of the OFF are not read (1 of 2)"),
        (("COFF", "4 2 0", *(corner + " 9 9 9" for corner in CORNERS), *FACES), "colours and texture coordinates of the vertices"),
        (("NCOFF", "4 2 0", *(corner + " 0 0 1 9 9 9" for corner in CORNERS), *FACES), "colours and texture coordinates of the vertices"),
        (("OFF", "4 2 0", *CORNERS, *FACES, "0 1", "some text"), "2 lines after the last of 2 faces are ignored"),
    ],
)
def test_what_is_not_read_is_said(tmp_path: Path, lines: tuple[str, ...], said: str) -> None:
    (line,) = read(tmp_path, *lines).unread
    assert said in line


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("OFF", "4 2 0", *CORNERS, FACES[0]), "4 vertices and 2 faces take as many lines, and 5 follow; is it cut off"),
        (("OFF", "4 1 0", *CORNERS, "4 0 1 2"), "line of face 0 has fewer corners than it says"),
        (("OFF", "4 1 0", *CORNERS, "3 0 1 4"), "a face names a vertex outside 0..3"),
        (("OFF", "4 1 0", *CORNERS[:3], "0 1", FACES[0]), "does not have 3 numbers"),
        (("OFF BINARY", "4 1 0"), "binary"),
        (("nOFF", "4", "4 1 0"), "OFF of many dimensions"),
        (("OFF",), "does not begin with OFF and the numbers"),
        (("OFF", "4 0 0", *CORNERS), "holds no triangle mesh"),
    ],
)
def test_files_that_cannot_be_read_are_refused(tmp_path: Path, lines: tuple[str, ...], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        read(tmp_path, *lines)


def test_normals_are_no_loss(tmp_path: Path) -> None:
    assert read(tmp_path, "NOFF", "4 2 0", *(corner + " 0 0 1" for corner in CORNERS), *FACES).unread == ()


def test_fourth_coordinate_divides_the_others(tmp_path: Path) -> None:
    mesh = read(tmp_path, "4OFF", "4 2 0", "0 0 0 1", "2 0 0 2", "3 3 0 3", "0 1 0 1", *FACES)
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
