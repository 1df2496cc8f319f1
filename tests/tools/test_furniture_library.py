"""Furniture libraries: unpacked files, entries of the catalogue, and omissions."""

import csv
import zipfile
from pathlib import Path

import pytest

from pipeline.config.manifest import Manifest
from pipeline.errors import InvalidInput
from tests.test_manifest import CUBE
from tools.furniture_library import main, unpack

LIST = """\
license=Creative Commons Attribution 3.0  \xa9 Somebody
name#1=Caf\\u00e9 cup
category#1=Kitchen
model#1=/lib/cup/cup.obj
creator#1=Ann
name#2=Lamp
category#2=Living room
model#2=/lib/lamp/lamp.obj
modelRotation#2=1 0 0 0 0 1 0 -1 0
creator#2=Bob
name#3=Old chair
category#3=Office
model#3=/lib/chair/chair.3ds
creator#3=Bob
"""
FILES = {
    "PluginFurnitureCatalog.properties": LIST.encode("latin-1"),
    "lib/cup.png": b"an icon",
    "lib/cup/cup.obj": f"mtllib cup.mtl\n{CUBE}".encode(),
    "lib/cup/cup.mtl": b"newmtl x\nmap_Kd cup.jpg\n",
    "lib/cup/cup.jpg": b"a picture",
    "lib/cup/LICENSE.txt": b"by Ann",
    "lib/lamp/lamp.obj": CUBE.encode(),
    "lib/chair/chair.3ds": b"no longer read",
}


@pytest.fixture
def library(tmp_path: Path) -> Path:
    path = tmp_path / "lib.sh3f"
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in FILES.items():
            archive.writestr(name, content)
    return path


def test_models_are_unpacked_with_their_companions_and_licences(library, tmp_path):
    number, left_out = unpack([library], tmp_path / "meshes")
    assert number == 2
    assert left_out == [
        "Old chair (lib/chair/chair.3ds): .3ds cannot be read; convert it to one of .obj, .ply, .stl, .off, .glb, .gltf, .dae, .3mf"
    ]
    unpacked = {str(file.relative_to(tmp_path / "meshes")) for file in (tmp_path / "meshes").rglob("*") if file.is_file()}
    assert unpacked == {
        "catalogue.csv",
        "lib/cup/cup.obj",
        "lib/cup/cup.mtl",
        "lib/cup/cup.jpg",
        "lib/cup/LICENSE.txt",
        "lib/lamp/lamp.obj",
    }
    with (tmp_path / "meshes" / "catalogue.csv").open(encoding="utf-8") as file:
        cup, lamp = csv.DictReader(file)
    assert (cup["name"], cup["creator"], cup["licence"]) == ("Café cup", "Ann", "Creative Commons Attribution 3.0  © Somebody")
    assert (lamp["object_id"], lamp["creator"]) == ("lib-lamp", "Bob")


def test_licence_and_creators_are_optional(tmp_path):
    path = tmp_path / "lib.sh3f"
    with zipfile.ZipFile(path, "w") as archive:
        kept = [line for line in LIST.splitlines() if not line.startswith(("license", "creator"))]
        for name, content in {**FILES, "PluginFurnitureCatalog.properties": "\n".join(kept)}.items():
            archive.writestr(name, content)
    assert unpack([path], tmp_path / "meshes")[0] == 2
    assert (tmp_path / "meshes" / "catalogue.csv").read_text(encoding="utf-8").splitlines()[1].endswith(",Café cup,,")


@pytest.mark.parametrize("arguments", [[], ["meshes"]])
def test_command_without_libraries_prints_its_usage(monkeypatch, arguments):
    monkeypatch.setattr("sys.argv", ["furniture_library", *arguments])
    with pytest.raises(SystemExit, match=r"usage: .* FOLDER LIBRARY\.sh3f"):
        main()


def test_unpacked_catalogue_is_a_source(library, tmp_path):
    unpack([library], tmp_path / "meshes")
    source = {"kind": "catalogue", "licence": "CC-BY", "up": "y", "path": tmp_path / "meshes"}
    splits = {"train": 1, "valid": 0, "test": 0}
    objects = Manifest(name="m", description="d", seed=0, splits=splits, sources=[source]).objects()
    assert [(one.object_id, one.category, one.source["up"]) for one in objects] == [
        ("lib-cup", "Kitchen", "y"),
        ("lib-lamp", "Living_room", "z"),  # its rotation turns z upright
    ]


@pytest.mark.parametrize("file", ["/data/cup.obj", "../cup.obj"])
def test_catalogue_may_name_files_below_its_folder_only(tmp_path, file):
    (tmp_path / "catalogue.csv").write_text(f"object_id,category,file,up\ncup,kitchen,{file},z\n")
    source = {"kind": "catalogue", "licence": "CC-BY", "up": "y", "path": tmp_path}
    with pytest.raises(InvalidInput, match=f"cup has file '{file}'; it must be a path below"):
        Manifest(name="m", description="d", seed=0, splits={"train": 1, "valid": 0, "test": 0}, sources=[source]).objects()


@pytest.mark.parametrize(("content", "why"), [(b"PK", "not a zip file"), (None, "no item named")])
def test_file_that_is_not_a_library_is_named(tmp_path, content, why):
    path = tmp_path / "other.sh3f"
    if content is None:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("a.obj", CUBE)
    else:
        path.write_bytes(content)
    with pytest.raises(InvalidInput, match=rf"other\.sh3f is not a furniture library .*{why}"):
        unpack([path], tmp_path / "meshes")
