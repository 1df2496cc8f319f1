"""Files named by mesh files are opened only if they are regular files below the root."""

import os
import stat
from pathlib import Path

import pytest
from PIL import Image

from pipeline.config.sources import fingerprint
from pipeline.errors import InvalidInput
from pipeline.formats.mesh_companions import Companions
from pipeline.formats.mesh_reader import load_mesh

QUAD = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl paint\nf 1/1 2/2 3/3\n"


def textured(folder: Path, texture: str) -> Path:
    """Write a mesh file in a separate folder, with a texture of any name."""
    (folder / "models").mkdir()
    (folder / "models" / "a.mtl").write_text(f"newmtl paint\nmap_Kd {texture}\n")
    (folder / "models" / "a.obj").write_text(f"mtllib a.mtl\n{QUAD}")
    return folder / "models" / "a.obj"


def test_companions_are_found_within_the_root_only(tmp_path: Path) -> None:
    file = textured(tmp_path, "../images/paint.png")
    (tmp_path / "images").mkdir()
    Image.new("RGB", (2, 2), (9, 9, 9)).save(tmp_path / "images" / "paint.png")
    assert list(Companions(file, tmp_path)) == ["a.mtl", "../images/paint.png"]
    assert len(load_mesh(file, tmp_path).look.textures) == 1
    assert list(Companions(file)) == ["a.mtl"]
    assert load_mesh(file).look.textures == ()


@pytest.mark.parametrize(
    ("named", "place"),
    [
        ("../../textures/soda.png", "objects/textures/soda.png"),  # as in robosuite and ROS packages
        ("../../textures/soda.png", "assets/materials/textures/Soda.PNG"),
        ("texture.png", "objects/soda/materials/textures/texture.png"),  # as in GSO
        ("C:\\Users\\me\\maps\\soda.png", "maps/soda.png"),
    ],
)
def test_texture_elsewhere_below_the_root_is_found_by_name(tmp_path: Path, named: str, place: str) -> None:
    file = tmp_path / "root" / "objects" / "soda" / "meshes" / "a.obj"
    for path in (file, tmp_path / "root" / place, tmp_path / "textures" / "soda.png"):
        path.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(f"mtllib a.mtl\n{QUAD}")
    file.with_suffix(".mtl").write_text(f"newmtl paint\nmap_Kd {named}\n")
    Image.new("RGB", (2, 2), (9, 9, 9)).save(tmp_path / "root" / place)
    Image.new("RGB", (2, 2), (0, 0, 255)).save(tmp_path / "textures" / "soda.png")  # outside of the root, never opened
    companions = Companions(file, tmp_path / "root")
    assert companions.paths[named] == (tmp_path / "root" / place).resolve()
    assert load_mesh(file, tmp_path / "root").look.textures[0][0, 0, 0] == 9


def test_textures_of_a_collada_file_are_named_by_its_images_alone(tmp_path: Path) -> None:
    """A surface names the image's id in the element in which the image names its file."""
    images = (
        '<image id="wood_png" name="wood"><init_from>oak &amp; ash.png</init_from></image>'
        '<image id="no.png"><asset/>\n<init_from>no.png</init_from></image>'
    )
    surface = '<newparam><surface type="2D"><init_from>wood_png</init_from></surface></newparam>'
    (tmp_path / "a.dae").write_text(f"<COLLADA><library_images>{images}</library_images>{surface}</COLLADA>")
    Image.new("RGB", (2, 2)).save(tmp_path / "oak & ash.png")
    companions = Companions(tmp_path / "a.dae")
    assert list(companions) == ["oak & ash.png"]
    assert companions.unread == ["no.png is missing below the folder of meshes"]


@pytest.mark.parametrize("options", ["-s 1 1 1", "-clamp on -o 0.5 -.5", "-bm 2"])
def test_options_before_a_texture_and_comments_are_no_names(tmp_path: Path, options: str) -> None:
    file = textured(tmp_path, f"{options} paint.png\n# map_Kd none.png")
    Image.new("RGB", (2, 2), (9, 9, 9)).save(file.with_name("paint.png"))
    assert Companions(file).unread == []
    assert load_mesh(file).look.textures[0][0, 0, 0] == 9


def test_texture_of_another_mesh_and_ambiguous_texture_are_not_taken(tmp_path: Path) -> None:
    file = textured(tmp_path, "../textures/soda.png")
    texture_of_can = tmp_path / "can" / "textures" / "soda.png"
    texture_of_can.parent.mkdir(parents=True)
    texture_of_can.write_bytes(b"x")
    (tmp_path / "can" / "can.stl").write_bytes(b"x")
    for folder in ("old", "new"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "soda.png").write_bytes(b"x")
    assert Companions(file, tmp_path).unread == ["../textures/soda.png is missing below the folder of meshes"]


def test_link_below_the_root_to_a_texture_outside_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "root").mkdir()
    file = textured(tmp_path / "root", "maps/soda.png")
    Image.new("RGB", (2, 2)).save(tmp_path / "soda.png")
    (tmp_path / "root" / "soda.png").symlink_to(tmp_path / "soda.png")
    (tmp_path / "root" / "linked").symlink_to(tmp_path)
    assert Companions(file, tmp_path / "root").unread == ["maps/soda.png is missing below the folder of meshes"]


@pytest.mark.parametrize("name", ["socket", "/dev/null", "/etc/hostname", "link", "loop", "a\0b", "x" * 300])
@pytest.mark.parametrize("kind", ["material", "texture"])
def test_no_socket_device_or_outer_file_is_opened(tmp_path: Path, name: str, kind: str) -> None:
    file = textured(tmp_path, name)
    os.mknod(file.parent / "socket", stat.S_IFSOCK | 0o600)
    (file.parent / "link").symlink_to("/etc/hostname")
    (file.parent / "loop").symlink_to("loop")
    if kind == "material":
        file.write_text(f"mtllib {name}\n{QUAD}")
    source = {"file": str(file), "root": str(tmp_path)}
    assert list(fingerprint(source)["file"]["companions"]) == (["a.mtl"] if kind == "texture" else [])
    assert load_mesh(file, tmp_path).look.textures == ()


def test_number_of_names_is_bounded(tmp_path: Path) -> None:
    file = textured(tmp_path, "0.png")
    (file.parent / "a.mtl").write_text("newmtl a\n" + "".join(f"map_Kd {number}.png\n" for number in range(1000)))
    with pytest.raises(InvalidInput, match="names more than 1000 files"):
        Companions(file)


def test_size_of_companions_is_bounded_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = textured(tmp_path, "paint.png")
    (file.parent / "paint.png").write_bytes(bytes(1000))
    monkeypatch.setattr("pipeline.formats.mesh_companions.MAX_BYTES", 1000)
    with pytest.raises(InvalidInput, match="1000 are the most; make its textures smaller"):
        Companions(file)


def test_mesh_file_that_is_a_socket_is_refused(tmp_path: Path) -> None:
    os.mknod(tmp_path / "a.obj", stat.S_IFSOCK | 0o600)
    with pytest.raises(InvalidInput, match=r"a\.obj cannot be read \(it is not a regular file\)"):
        fingerprint({"file": str(tmp_path / "a.obj"), "root": str(tmp_path)})
