"""Materials of an OBJ with many pages: each face has the one that it names, or that is said."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.formats.mesh_file import parse_mesh
from pipeline.formats.obj_lines import rewrite_uses

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
