"""Materials of an OBJ with many pages: each face has the one that it names, or that is said."""

from pathlib import Path

import pytest

from pipeline.errors import InvalidInput
from pipeline.formats.mesh_file import parse_mesh
from pipeline.formats.obj import rewrite_uses

CORNERS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
LIBRARY = b"newmtl Red\nKd 1 0 0\nnewmtl Wood #25\nKd 0 1 0\nnewmtl two words\nKd 0 0 1\n"


@pytest.mark.parametrize(
    ("stated", "name"),
    [
        (b"usemtl Red", b"Red"),
        (b"usemtl\tRed  ", b"Red"),
        (b"usemtl Red # of the roof", b"Red"),
        (b"usemtl red", b"Red"),
        (b"usemtl Wood #25", b"Wood #25"),
        (b"usemtl Wood #25 # a comment", b"Wood #25 # a comment"),
        (b"usemtl two \t words", b"two words"),
        (b"usemtl None", b"None"),
        (b"usemtl", b""),
    ],
)
def test_materials_are_found_by_their_names(stated: bytes, name: bytes) -> None:
    unread = list[str]()
    content = rewrite_uses(b"v 0 0 0\n" + stated + b"\nf 1 2 3\n", LIBRARY, unread)
    assert content.split(b"\n")[1] == (b"usemtl " + name if name else b"usemtl")
    assert unread == (["materials that no library defines are not read: Wood #25 # a comment"] if b"a comment" in stated else [])


def test_undefined_materials_and_several_definitions_are_said(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl same\nKd 1 0 0\nnewmtl twice\nKd 0 1 0\n")
    (tmp_path / "b.mtl").write_text("newmtl same\nKd  1 0 0\nnewmtl twice\nKd 0 0 1\n")
    uses = "usemtl same\nf 1 2 3\nusemtl twice\nf 1 3 4\nusemtl none of them\nf 1 2 4\n"
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\nmtllib b.mtl\n{CORNERS}{uses}")
    mesh = parse_mesh(tmp_path / "a.obj", tmp_path)
    assert mesh.unread == (
        "materials that no library defines are not read: none of them",
        "materials with several definitions have the last one: twice",
    )
    assert sorted(mesh.look.base_color[:, :3].tolist()) == [[0, 0, 255], [178, 178, 178], [255, 0, 0]]


def test_at_most_five_undefined_materials_are_listed() -> None:
    unread = list[str]()
    rewrite_uses(b"".join(b"usemtl m%d\n" % number for number in range(8)), LIBRARY, unread)
    assert unread == ["materials that no library defines are not read: m0, m1, m2, m3, m4 and 3 more"]


def test_materials_without_a_library_are_said() -> None:
    unread = list[str]()
    rewrite_uses(b"usemtl wood\nf 1 2 3\n", b"", unread)
    assert unread == ["materials that no library defines are not read: wood"]
    rewrite_uses(b"mtllib missing.mtl\nusemtl wood\nf 1 2 3\n", b"", unread := [])
    assert unread == []


@pytest.mark.parametrize(("end", "encoding"), [("\r", "utf-8"), ("\r", "latin-1"), ("\n", "latin-1"), ("\r\n", "utf-16")])
def test_materials_are_found_in_text_of_other_lines_and_encodings(tmp_path: Path, end: str, encoding: str) -> None:
    (tmp_path / "a.mtl").write_bytes("newmtl Würfel\nKd 1 0 0\n".replace("\n", end).encode(encoding))
    (tmp_path / "a.obj").write_bytes(f"MTLLIB a.mtl\n{CORNERS}USEMTL Würfel\nf 1 2 3\n".replace("\n", end).encode(encoding))
    mesh = parse_mesh(tmp_path / "a.obj", tmp_path)
    assert (mesh.look.base_color.tolist(), mesh.unread) == ([[255, 0, 0, 255]], ())


def test_colours_in_comments_are_said(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(f"{CORNERS}#MRGB ffff0000ffff0000\nf 1 2 3\n")
    assert parse_mesh(tmp_path / "a.obj", tmp_path).unread == ("colours of vertices in comments (#MRGB) are not read",)


def test_vertex_0_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(f"{CORNERS}f 1 2 3\nf 0 1 2\n")
    with pytest.raises(InvalidInput, match="a face names vertex 0, the first one is 1"):
        parse_mesh(tmp_path / "a.obj", tmp_path)


@pytest.mark.parametrize("statement", ["cstype bezier\ndeg 1 1\nsurf 0 1 0 1 1 2 4 3\nend", "fo 1 2 3"])
def test_surfaces_that_are_no_polygons_are_refused(tmp_path: Path, statement: str) -> None:
    (tmp_path / "a.obj").write_text(f"{CORNERS}f 1 2 3\n{statement}\n")
    with pytest.raises(InvalidInput, match=r"free-form or outdated surfaces \((surf|fo)\), which cannot be read"):
        parse_mesh(tmp_path / "a.obj", tmp_path)
