"""OBJ files: lines of every form, concave polygons, and their materials; what is not read of a material library is said."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import InvalidInput
from pipeline.formats.mesh_file import parse_mesh
from pipeline.formats.mesh_reader import load_mesh
from pipeline.kernels.geometry.mesh import Mesh

CORNERS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
LIBRARY = "newmtl Red\nKd 1 0 0\nnewmtl Wood #25\nKd 0 1 0\nnewmtl two words\nKd 0 0 1\n"
GREY = (178, 178, 178)


@pytest.mark.parametrize(
    ("stated", "color"),
    [
        ("usemtl Red", (255, 0, 0)),
        ("usemtl\tRed  ", (255, 0, 0)),
        ("usemtl Red # of the roof", (255, 0, 0)),
        ("usemtl red", (255, 0, 0)),
        ("usemtl Wood #25", (0, 255, 0)),
        ("usemtl Wood #25 # a comment", GREY),
        ("usemtl two \t words", (0, 0, 255)),
        ("usemtl None", GREY),
        ("usemtl", GREY),
    ],
)
def test_materials_are_found_by_their_names(tmp_path: Path, stated: str, color: tuple[int, ...]) -> None:
    (tmp_path / "a.mtl").write_text(LIBRARY)
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{CORNERS}{stated}\nf 1 2 3\n")
    mesh = parse_mesh(tmp_path / "a.obj", tmp_path)
    assert mesh.look.base_color.tolist() == [[*color, 255]]
    assert mesh.unread == (("materials that no library defines are not read: Wood #25 # a comment",) if "a comment" in stated else ())


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


@pytest.mark.parametrize(("end", "encoding"), [("\r", "utf-8"), ("\r", "latin-1"), ("\n", "latin-1"), ("\r\n", "utf-16")])
def test_materials_are_found_in_text_of_other_lines_and_encodings(tmp_path: Path, end: str, encoding: str) -> None:
    (tmp_path / "a.mtl").write_bytes("newmtl Würfel\nKd 1 0 0\n".replace("\n", end).encode(encoding))
    (tmp_path / "a.obj").write_bytes(f"MTLLIB a.mtl\n{CORNERS}USEMTL Würfel\nf 1 2 3\n".replace("\n", end).encode(encoding))
    mesh = parse_mesh(tmp_path / "a.obj", tmp_path)
    assert (mesh.look.base_color.tolist(), mesh.unread) == ([[255, 0, 0, 255]], ())


def test_colours_in_comments_are_said(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(f"{CORNERS}#MRGB ffff0000ffff0000\nf 1 2 3\n")
    assert parse_mesh(tmp_path / "a.obj", tmp_path).unread == ("colours of vertices in comments (#MRGB) are not read",)


def painted(folder: Path, mtl: str | bytes, *, uv: float = 0.5) -> Mesh:
    """Read a triangle with a material of a library, and texture coordinates that are all `uv`."""
    (folder / "a.obj").write_text(f"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt {uv} {uv}\nusemtl a\nf 1/1 2/1 3/1\n")
    (folder / "a.mtl").write_bytes(mtl.encode() if isinstance(mtl, str) else mtl)
    Image.new("RGB", (4, 4), (9, 99, 9)).save(folder / "a.png")
    return parse_mesh(folder / "a.obj", folder)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is an empty file"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:5\nsize 5\n", "is a Git LFS pointer; run `git lfs pull`"),
        (b"<html>404</html>", "is a web page (HTML); download the file itself"),
        (bytes(range(256)), "is not a material library"),
        (b"\xff\xfeabc", "begins like text in UTF-16-LE and is not; save it as UTF-8"),
    ],
)
def test_library_that_is_none_is_listed_and_the_shape_is_kept(tmp_path: Path, content: bytes, reason: str) -> None:
    mesh = painted(tmp_path, content)
    assert len(mesh.faces) == 1
    assert mesh.unread == (f"a.mtl {reason}",)


def test_library_without_materials_is_no_loss(tmp_path: Path) -> None:
    assert painted(tmp_path, "# Material Count: 0\n").unread == ()


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
def test_library_is_read_in_the_encoding_of_its_mark(tmp_path: Path, encoding: str) -> None:
    mesh = painted(tmp_path, "newmtl a\nKd 1 0 0\n".encode(encoding))
    assert mesh.look.base_color.tolist() == [[255, 0, 0, 255]]
    assert mesh.unread == ()


@pytest.mark.parametrize(
    ("statements", "color"),
    [
        ("Kd 1 0 0", [255, 0, 0, 255]),
        ("Kd 1 0 0\nd 0.5", [255, 0, 0, 128]),
        ("Kd 1 0 0\nTr 0.25", [255, 0, 0, 191]),
        ("Kd 1 0 0\nTr 1", [255, 0, 0, 255]),
        ("Kd 1 0 0\nd -halo 0.5\nTr 0", [255, 0, 0, 128]),
        ("KD 1 0 0  # red", [255, 0, 0, 255]),
        ("Kd 0.2", [51, 51, 51, 255]),
        ("Kd 0 1 0\nKe 1 0 0", [0, 255, 0, 255]),
        ("Kd 0 0 0\nKe 1 0 0", [255, 0, 0, 255]),
        ("Ke 5 0 0", [255, 0, 0, 255]),
    ],
)
def test_colours_opacity_and_emission_are_read(tmp_path: Path, statements: str, color: list[int]) -> None:
    mesh = painted(tmp_path, f"newmtl a\n{statements}\n")
    assert mesh.look.base_color.tolist() == [color]
    assert mesh.unread == ()


@pytest.mark.parametrize(
    ("statements", "uv", "lines"),
    [
        ("map_Kd -clamp on a.png", 0.5, ()),
        ("map_Kd -clamp on a.png", 1.5, ("a.png is clamped (-clamp on), and repeats here where coordinates are outside 0 to 1",)),
        ("map_Kd -s 1 1 1 -o 0 0 -mm 0 1 a.png", 0.5, ()),
        ("map_Kd -s 2 2 1 -o 0.5 0 a.png", 0.5, ("-s 2 2 1 -o 0.5 0 of a.png is not applied",)),
        ("map_Ka a.png", 0.5, ("map_Ka of material a is not read",)),
        ("Kd 0 0 0\nmap_Ke a.png", 0.5, ("map_Ke of material a is not read",)),
        ("map_Kd a.png\nmap_d b.png", 0.5, ("map_d b.png of material a is not read",)),
        ("Kd spectral a.rfl", 0.5, ("Kd spectral a.rfl of material a in a.mtl is not read",)),
        ("Kd nan 0 0", 0.5, ("Kd nan 0 0 of material a in a.mtl is not read",)),
        ("Kd 1 0 0\nnewmtl b\nKd 1 0", 0.5, ("Kd 1 0 of material b in a.mtl is not read",)),
    ],
)
def test_statements_that_change_a_look_and_are_not_read_are_listed(
    tmp_path: Path, statements: str, uv: float, lines: tuple[str, ...]
) -> None:
    assert painted(tmp_path, f"newmtl a\n{statements}\n", uv=uv).unread == lines


def test_invalid_texture_coordinates_become_zero(tmp_path) -> None:
    (tmp_path / "odd.mtl").write_text("newmtl m\nmap_Kd odd.png\n")
    Image.new("RGB", (4, 4), (9, 9, 9)).save(tmp_path / "odd.png")
    uv = ["0.5 0.25", "nan 1", "1e39 0.5"]
    lines = ["mtllib odd.mtl", "usemtl m", "v 0 0 0", "v 1 0 0", "v 0 1 0", *(f"vt {pair}" for pair in uv), "f 1/1 2/2 3/3"]
    (tmp_path / "odd.obj").write_text("\n".join(lines))
    look = load_mesh(tmp_path / "odd.obj").look
    assert look.uv.tolist() == [[0.5, 0.25], [0, 1], [0, 0.5]]


@pytest.mark.parametrize("first", range(8))
@pytest.mark.parametrize("numbered", ["", "/1", "//1"])
def test_concave_polygon_is_not_filled(tmp_path: Path, first: int, numbered: str) -> None:
    """A U of 3 x 3 with a notch of 1 x 2, whose corners are named from any first one, before and after, by positive or negative numbers."""
    outline = np.roll([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)], -first, axis=0)
    corners = "".join(f"v {x} {y} {x + y}\n" for x, y in outline)
    for numbers in (range(1, 9), range(-8, 0)):
        first_part, second_part = (" ".join(f"{number}{numbered}" for number in part) for part in (numbers[:4], numbers[4:]))
        path = tmp_path / "u.obj"
        path.write_text(f"vt 0 0\nvn 0 0 1\n{corners}f {first_part} \\\n{second_part}\nv 9 9 9\n")
        mesh = load_mesh(path)
        assert len(mesh.faces) == 6
        sides = np.diff(mesh.triangles, axis=1)
        assert np.abs(np.cross(sides[:, 0], sides[:, 1])[:, 2]).sum() / 2 == pytest.approx(7)  # as seen from above


def test_relative_numbers_count_from_their_place_in_the_file(tmp_path: Path) -> None:
    corners = ["v 0 0 0\nv 1 0 0\nv 0 1 0\n", "v 5 0 0\nv 6 0 0\nv 5 1 0\n"]
    (tmp_path / "two.obj").write_text("f -3 -2 -1\n".join([*corners, ""]))
    assert load_mesh(tmp_path / "two.obj").triangles[:, 0].tolist() == [[0, 0, 0], [5, 0, 0]]
    (tmp_path / "two.obj").write_text(f"{corners[0]}f -1 -2 -4\n")
    with pytest.raises(InvalidInput, match="a face has relative index -4, before the first vertex; it is damaged"):
        load_mesh(tmp_path / "two.obj")


@pytest.mark.parametrize(
    ("face", "words"),
    [
        ("f 1 2 3 9", "a face names a vertex outside 0..3"),
        ("f - / 2 3", "cannot be read as OBJ"),
        ("f 1 2 x", "it has 'x' where a number is expected"),
        ("v 1 2\nf 1 2 3", "a vertex has fewer than three numbers"),
        ("f 1 2 3\nf 0 1 2", "a face names vertex 0, the first one is 1"),
        ("cstype bezier\ndeg 1 1\nsurf 0 1 0 1 1 2 4 3\nend", r"free-form or outdated surfaces \(surf\), which cannot be read"),
        ("fo 1 2 3", r"free-form or outdated surfaces \(fo\), which cannot be read"),
    ],
)
def test_lines_that_cannot_be_read_are_refused(tmp_path: Path, face: str, words: str) -> None:
    (tmp_path / "a.obj").write_text(f"{CORNERS}{face}\n")
    with pytest.raises(InvalidInput, match=words):
        parse_mesh(tmp_path / "a.obj", tmp_path)


@pytest.mark.parametrize(
    ("first", "second"), [("  v", "\tf"), ("v\t", "f"), ("v", "f\t"), (" \tv ", " f ")], ids=["indented", "tab", "tab of face", "blanks"]
)
@pytest.mark.parametrize("comment", ["", "  # of the roof"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_lines_with_other_blanks_and_comments_are_read(tmp_path: Path, first: str, second: str, comment: str, end: str) -> None:
    lines = ["# a square of C:\\", f"{first} 0 0 0", f"{first} 1 0 0{comment}", "v 1 1 0", "v 0 1 0", f"{second} 1 2 3{comment}", "f 1 3 4"]
    (tmp_path / "square.obj").write_text(end.join([*lines, ""]), newline="")
    mesh = load_mesh(tmp_path / "square.obj")
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


@pytest.mark.parametrize(
    "lines", ["mtllib a.mtl\nmtllib b.mtl", "mtllib a.mtl b.mtl", "# mtllib none.mtl\n mtllib b.mtl  a.mtl", "mtllib a b.mtl"]
)
def test_all_material_libraries_of_an_obj_are_read(tmp_path: Path, lines: str) -> None:
    one, two = "newmtl one\nKd 1 0 0\n", "newmtl two\nKd 0 0 1\n"
    for name, content in {"a.mtl": one, "b.mtl": two, "a b.mtl": one + two}.items():
        (tmp_path / name).write_text(content)
    square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl one\nf 1 2 3\nusemtl two\nf 1 3 4\n"
    (tmp_path / "square.obj").write_text(f"{lines}\n{square}")
    assert sorted(load_mesh(tmp_path / "square.obj").look.base_color[:, :3].tolist()) == [[0, 0, 255], [255, 0, 0]]
