"""PLY files: polygons and strips in text and both byte orders, names and types of colours, and pages of textures."""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import InvalidInput
from pipeline.formats.mesh_file import parse_mesh
from pipeline.formats.mesh_parts import GREY
from pipeline.kernels.geometry.mesh import Mesh

XYZ = ("float x", "float y", "float z")
CORNERS = ("0 0 0", "1 0 0", "1 1 0", "0 1 0")
LIST = "list uchar int vertex_indices"
FACES = ("3 0 1 2", "3 0 2 3")
RED, BLUE = (220, 20, 20), (20, 20, 220)
PAGES = ("comment TextureFile red.png", "comment TextureFile blue.png")
UV = " 6 0 0 1 0 1 1"


def header(*elements: tuple[str, int, Sequence[str]], form: str = "ascii", comments: Sequence[str] = ()) -> list[str]:
    """Write the lines of a header from the name, the length and the properties of each element."""
    lines = ["ply", f"format {form} 1.0", *comments]
    for name, length, properties in elements:
        lines += [f"element {name} {length}", *(f"property {of}" for of in properties)]
    return [*lines, "end_header"]


def read(
    folder: Path,
    corners: Sequence[str] = CORNERS,
    faces: Sequence[str] = FACES,
    *,
    of_vertex: Sequence[str] = (),
    of_face: Sequence[str] = (LIST,),
    comments: Sequence[str] = (),
) -> Mesh:
    """Read a text file with such elements, beside a red and a blue texture."""
    for name, color in (("red", RED), ("blue", BLUE)):
        Image.new("RGB", (2, 2), color).save(folder / f"{name}.png")
    head = header(("vertex", len(corners), (*XYZ, *of_vertex)), ("face", len(faces), of_face), comments=comments)
    (folder / "a.ply").write_text("\n".join([*head, *corners, *faces, ""]))
    return parse_mesh(folder / "a.ply", folder)


def colors(mesh: Mesh) -> list[tuple[int, ...]]:
    """Return the colour of each face: its texture's, or its material's."""
    look = mesh.look
    pages = look.material_texture[look.face_material]
    plain = look.base_color[look.face_material]
    return [tuple((look.textures[page][0, 0] if page >= 0 else color)[:3].tolist()) for page, color in zip(pages, plain, strict=True)]


@pytest.mark.parametrize(
    ("kind", "levels", "expected"),
    [
        ("uchar", (220, 20, 0), (220, 20, 0)),
        ("char", (-36, 20, 0), (220, 20, 0)),
        ("int", (220, 20, 0), (220, 20, 0)),
        ("ushort", (56540, 5140, 0), (220, 20, 0)),
        ("float", (1, 0.2, 0), (255, 51, 0)),
        ("float", (220, 20, 0), (220, 20, 0)),
    ],
)
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_colours_of_every_type_are_read(tmp_path: Path, form: str, kind: str, levels: tuple[float, ...], expected: tuple[int, ...]) -> None:
    names = [f"{kind} {channel}" for channel in ("red", "green", "blue")]
    head = header(("vertex", 3, (*XYZ, *names)), ("face", 1, (LIST,)), form=form)
    rows = [(0, 0, 0, *levels), (1, 0, 0, *levels), (0, 1, 0, *levels)]
    if form == "ascii":
        body = "".join(f"{' '.join(map(str, row))}\n" for row in rows).encode() + b"3 0 1 2\n"
    else:
        order = "<" if "little" in form else ">"
        letter = {"uchar": "B", "char": "b", "int": "i", "ushort": "H", "float": "f", "double": "d"}[kind]
        body = b"".join(struct.pack(f"{order}3f3{letter}", *row) for row in rows) + struct.pack(f"{order}B3i", 3, 0, 1, 2)
    (tmp_path / "a.ply").write_bytes("\n".join([*head, ""]).encode() + body)
    look = parse_mesh(tmp_path / "a.ply", tmp_path).look
    assert look.vertex_color is not None
    assert look.vertex_color.tolist() == [[*expected, 255]] * 3
    assert look.base_color.tolist() == [[255] * 4]


@pytest.mark.parametrize(
    "names",
    [
        ("red", "green", "blue"),
        ("r", "g", "b"),
        ("diffuse_red", "diffuse_green", "diffuse_blue"),
        ("red", "green", "blue", "alpha"),
        ("ambient_red", "r", "g", "b", "a"),
        ("specular_red", "diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"),
    ],
)
@pytest.mark.parametrize("of", ["vertex", "face"])
def test_colours_are_read_under_every_name(tmp_path: Path, names: tuple[str, ...], of: str) -> None:
    levels = {"red": 220, "green": 20, "blue": 20, "r": 220, "g": 20, "b": 20, "alpha": 255, "a": 255}
    behind = "".join(
        f" {0 if name.startswith(('ambient', 'specular')) else levels[name.lower().removeprefix('diffuse_')]}" for name in names
    )
    properties = tuple(f"uchar {name}" for name in names)
    if of == "vertex":
        mesh = read(tmp_path, [corner + behind for corner in CORNERS], of_vertex=properties)
        assert mesh.look.vertex_color is not None
        assert mesh.look.vertex_color.tolist() == [[*RED, 255]] * 4
    else:
        mesh = read(tmp_path, faces=[face + behind for face in FACES], of_face=(LIST, *properties))
        assert colors(mesh) == [RED, RED]
    assert mesh.unread == ()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"corners": [f"{corner} 99" for corner in CORNERS], "of_vertex": ("uint rgb",)}, "colours of each vertex (rgb) are not read"),
        ({"corners": [f"{corner} 9" for corner in CORNERS], "of_vertex": ("uchar intensity",)}, "colours of each vertex (intensity)"),
        ({"faces": [f"{face} 0" for face in FACES], "of_face": (LIST, "int material_index")}, "colours of each face (material_index)"),
        ({"faces": ["3 0 1 2", "2 0 1"]}, "faces of fewer than three corners are not read (1)"),
        ({"comments": PAGES[:1]}, "the texture of the PLY is not read: it has no texture coordinates"),
        (
            {"comments": PAGES, "faces": [face + UV for face in FACES], "of_face": (LIST, "list uchar float texcoord")},
            "2 textures are not read: no property such as texnumber says which faces use which",
        ),
        (
            {
                "comments": PAGES[:1],
                "corners": [f"{corner} 0 0 1 2 3" for corner in CORNERS],
                "of_vertex": ("float s", "float t", "uchar red", "uchar green", "uchar blue"),
            },
            "colours of the PLY are not read beside its texture",
        ),
    ],
)
def test_what_is_not_read_is_said(tmp_path: Path, options: dict[str, Sequence[str]], said: str) -> None:
    (line,) = read(tmp_path, **options).unread
    assert said in line


def test_elements_that_are_no_faces_are_said_or_refused(tmp_path: Path) -> None:
    edge = header(("vertex", 4, XYZ), ("face", 2, (LIST,)), ("edge", 1, ("int vertex1", "int vertex2")), ("camera", 1, ("float view_px",)))
    (tmp_path / "a.ply").write_text("\n".join([*edge, *CORNERS, *FACES, "0 1", "0", "9 9 9"]))
    assert parse_mesh(tmp_path / "a.ply", tmp_path).unread == (
        "3 numbers after the last row are ignored",
        "elements of the PLY that are no faces are not read: edge (1)",
    )
    fans = header(("vertex", 4, XYZ), ("trifans", 1, (LIST,)))
    (tmp_path / "a.ply").write_text("\n".join([*fans, *CORNERS, "4 0 1 2 3"]))
    with pytest.raises(InvalidInput, match="it has trifans with lists of vertices, which cannot be read"):
        parse_mesh(tmp_path / "a.ply", tmp_path)


@pytest.mark.parametrize("name", ["vertex_indices", "vertex_index", "vertices", "Vertex_Indices"])
def test_lists_of_vertices_have_several_names(tmp_path: Path, name: str) -> None:
    faces = [f"1 {face} 0.5" for face in FACES]
    mesh = read(tmp_path, faces=faces, of_face=("int flags", f"list uint8 uint32 {name}", "float quality"))
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("sizes", [(3, 4, 5), (4, 4, 4), (3, 3, 3)])
def test_polygons_of_any_sizes_are_cut_into_triangles(tmp_path: Path, form: str, end: str, sizes: Sequence[int]) -> None:
    """The first corners of a regular pentagon, with numbers before and behind the list of each face."""
    angles = np.arange(5) * 0.4 * np.pi
    head = header(("vertex", 5, ("double x", "double y", "double z")), ("face", 3, ("uchar a", LIST, "short b")), form=form)
    points = [(np.cos(angle), np.sin(angle), 0) for angle in angles]
    if form == "ascii":
        rows = [*(f"{x!r} {y!r} 0" for x, y, _ in np.array(points).tolist()), *(f"7 {n} {' '.join(map(str, range(n)))} -2" for n in sizes)]
        body = end.join([*rows, ""]).encode()
    else:
        order = "<" if "little" in form else ">"
        body = b"".join(struct.pack(f"{order}3d", *point) for point in points)
        body += b"".join(struct.pack(f"{order}BB{n}ih", 7, n, *range(n), -2) for n in sizes)
    path = tmp_path / "a.ply"
    path.write_bytes(end.join([*head, ""]).encode() + body)
    mesh = parse_mesh(path, tmp_path)
    cuts = [[0, 1, 2], [2, 3, 0], [3, 4, 0]]
    assert mesh.faces.tolist() == [cut for n in sizes for cut in cuts[: n - 2]]
    np.testing.assert_allclose(mesh.vertices, points)
    path.write_bytes(path.read_bytes() + (b"1 2 3" if form == "ascii" else b"123"))
    assert parse_mesh(path, tmp_path).unread == (f"3 {'numbers' if form == 'ascii' else 'bytes'} after the last row are ignored",)
    path.write_bytes(end.join([*head, ""]).encode() + body[: -3 - len(end) if form == "ascii" else -1])
    with pytest.raises(InvalidInput, match="its 3 rows of face need more than the"):
        parse_mesh(path, tmp_path)


def test_triangle_strips_turn_every_other_triangle(tmp_path: Path) -> None:
    """Two strips in one row and one in another: all triangles of the flat grid face upwards."""
    grid = [f"{x} {y} 0" for x in range(4) for y in (1, 0)]
    head = header(("vertex", 8, XYZ), ("tristrips", 2, ("list int int vertex_indices",)))
    (tmp_path / "a.ply").write_text("\n".join([*head, *grid, "9 0 1 2 3 -1 2 3 4 5", "5 -1 4 5 6 -1", ""]))
    mesh = parse_mesh(tmp_path / "a.ply", tmp_path)
    sides = np.diff(mesh.triangles, axis=1)
    assert np.cross(sides[:, 0], sides[:, 1])[:, 2].tolist() == [1] * 5
    assert mesh.faces.tolist() == [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5], [4, 5, 6]]


def test_each_face_has_the_page_that_it_names(tmp_path: Path) -> None:
    of_face = (LIST, "list uchar float texcoord", "int texnumber")
    faces = [f"{face}{UV} {number}" for face, number in zip(FACES * 2, (1, 0, -1, 2), strict=True)]
    mesh = read(tmp_path, faces=faces, of_face=of_face, comments=PAGES)
    assert colors(mesh) == [BLUE, RED, GREY[:3], GREY[:3]]
    assert mesh.unread == ("textures of triangles are not read (1): their number is beyond the 2 of the PLY",)
    missing = read(tmp_path, faces=faces[:2], of_face=of_face, comments=("comment TextureFile none.png", PAGES[1]))
    assert colors(missing) == [BLUE, GREY[:3]]
    assert missing.unread == ("none.png is missing below the folder of meshes",)


def test_texture_coordinates_of_corners_stay_with_their_corners(tmp_path: Path) -> None:
    """A quad and a triangle share vertices, but not texture coordinates; a third face has none."""
    faces = ["4 0 1 2 3 8 0 0 1 0 1 1 0 1", "3 0 1 2 6 .5 .5 .25 .5 .5 .25", "3 0 1 2 0"]
    mesh = read(tmp_path, faces=faces, of_face=(LIST, "list uchar float texcoord"), comments=PAGES[:1])
    assert mesh.look.uv[mesh.faces].tolist()[:3] == [
        [[0, 0], [1, 0], [1, 1]],
        [[1, 1], [0, 1], [0, 0]],
        [[0.5, 0.5], [0.25, 0.5], [0.5, 0.25]],
    ]
    assert colors(mesh) == [RED, RED, RED, GREY[:3]]
    assert mesh.vertices[mesh.faces[3]].tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0]]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("solid", "it has no header that begins with ply"),
        ("\n".join([*header(("vertex", 4, XYZ), ("face", 2, ("int a",))), *CORNERS, "1", "1"]), "2 faces have no list of their vertices"),
        ("\n".join([*header(("vertex", 4, XYZ), ("face", 1, (LIST,))), *CORNERS, "3 0 1 4"]), r"a vertex outside 0\.\.3"),
        ("\n".join([*header(("vertex", 4, XYZ), ("face", 1, (LIST,))), *CORNERS, "3 0 1 x"]), "'x' where a number is expected"),
        ("\n".join([*header(("vertex", 4, XYZ), ("face", 2, (LIST,))), *CORNERS, "3 0 1 2", "-3 0 1 2"]), "a list in row 1 of its element"),
        ("\n".join(header(("vertex", 9_000_000, XYZ))), "9000000 rows of vertex, 6000000 are the most"),
        ("\n".join([*header(("vertex", 4, XYZ)), *CORNERS]), "holds no triangle mesh"),
    ],
)
def test_files_that_cannot_be_read_are_refused(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "a.ply").write_text(content + "\n")
    with pytest.raises(InvalidInput, match=message):
        parse_mesh(tmp_path / "a.ply", tmp_path)


def test_page_of_vertices_counts_for_their_faces(tmp_path: Path) -> None:
    corners = [f"{corner} 0.5 0.5 1" for corner in CORNERS]
    mesh = read(tmp_path, corners, of_vertex=("float u", "float v", "uchar texnumber"), comments=PAGES)
    assert colors(mesh) == [BLUE, BLUE]
