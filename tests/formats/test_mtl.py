"""Material libraries: damaged ones and statements that are not read are listed; the others are read."""

from pathlib import Path

import pytest
from PIL import Image

from pipeline.formats.mesh_file import parse_mesh
from pipeline.kernels.geometry.mesh import Mesh


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
        (b"Dear reader,\n", "is not a material library"),
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
        ("Kd 1 0 0\nd 0\nTr 1", [255, 0, 0, 0]),
        ("Kd 1 0 0\nd -halo 0.5\nTr 0", [255, 0, 0, 128]),
        ("KD 1 0 0  # red", [255, 0, 0, 255]),
        ("Kd 0.2", [51, 51, 51, 255]),
        ("Kd 0 1 0\nKe 1 0 0", [0, 255, 0, 255]),
        ("Kd 0 0 0\nKe 1 0 0", [255, 0, 0, 255]),
        ("Ke 5 0 0", [255, 0, 0, 255]),
        ("Kd 1 0 0\nNs 1 2\nname other\nimage a.png\nillum x", [255, 0, 0, 255]),
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
        ("map_Kd a.png", 1.5, ()),
        ("map_Kd -s 1 1 1 -o 0 0 -mm 0 1 a.png", 0.5, ()),
        ("map_Kd -s 2 2 1 -o 0.5 0 a.png", 0.5, ("-s 2 2 1 -o 0.5 0 of a.png is not applied",)),
        ("map_Ka a.png", 0.5, ("map_Ka of material a is not read",)),
        ("Kd 0 0 0\nmap_Ke a.png", 0.5, ("map_Ke of material a is not read",)),
        ("map_Kd a.png\nmap_Ka a.png", 0.5, ()),
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
