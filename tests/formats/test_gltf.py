"""Documents of glTF: their arrays and primitives, compression, extensions, and damaged files, which are refused in words."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.errors import InvalidInput
from pipeline.formats.mesh_file import parse_mesh
from tests.formats.gltf_builder import BOX, CORNERS, Gltf, glb, volume


@pytest.mark.parametrize("mode", [4, 5, 6])
def test_lists_strips_and_fans_are_wound_alike(tmp_path: Path, mode: int) -> None:
    """Five corners around a disc, by number and in order: three faces whose normals point along z."""
    angles = 2 * np.pi * np.arange(5) / 5
    disc = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1).astype(np.float32)
    order = {4: [0, 1, 2, 0, 2, 3, 0, 3, 4], 5: [0, 1, 4, 4, 4, 1, 4, 2, 3], 6: [0, 1, 2, 3, 4]}[mode]  # the strip has a joint of no area
    document = Gltf()
    numbered = {"attributes": {"POSITION": document.array(disc)}, "indices": document.array(np.uint8(order)), "mode": mode}
    listed = {"attributes": {"POSITION": document.array(disc[order])}, "mode": mode}
    mesh = document.read(tmp_path, numbered, listed)
    normals = np.cross(mesh.triangles[:, 1] - mesh.triangles[:, 0], mesh.triangles[:, 2] - mesh.triangles[:, 0])
    area = 5 / 2 * np.sin(2 * np.pi / 5)
    assert normals[:, 2].min() > -1e-7
    np.testing.assert_allclose(normals.sum(axis=0) / 2, [0, 0, 2 * area], atol=1e-6)


def test_quantised_and_sparse_positions_are_read_from_shared_rows(tmp_path: Path) -> None:
    """Corners as normalised int16, padded to 8 bytes; one of them replaced by a sparse row; one buffer for both primitives."""
    document = Gltf()
    stored = np.zeros((8, 4), np.int16)
    stored[:, :3] = np.rint(CORNERS / 2 * 32767)
    view = document.view(stored.tobytes(), byteStride=8)
    moved = {"bufferView": document.view(np.int16([[0, 0, 32767]]).tobytes())}
    sparse = {"count": 1, "indices": {"bufferView": document.view(b"\x07"), "componentType": 5121}, "values": moved}
    entry = {"bufferView": view, "componentType": 5122, "normalized": True, "type": "VEC3", "count": 8, "sparse": sparse}
    position = document.add("accessors", entry)
    halves = [document.array(faces.ravel().astype(np.uint32)) for faces in (BOX.faces[:6], BOX.faces[6:])]
    primitives = [{"attributes": {"POSITION": position}, "indices": half} for half in halves]
    mesh = document.read(tmp_path, *primitives, nodes=[{"mesh": 0, "scale": [2, 2, 2]}], extensionsRequired=["KHR_mesh_quantization"])
    corners = CORNERS.copy()
    corners[7] = 0, 0, 2
    np.testing.assert_allclose(mesh.triangles, corners[BOX.faces], atol=1e-4)


def draco(document: Gltf, *lacking: str) -> dict[str, Any]:
    """Return a primitive that is compressed by Draco, and of which some arrays are not stored otherwise."""
    primitive = document.box(TEXCOORD_0=np.zeros((8, 2), np.float32))
    numbers = {**primitive["attributes"], "indices": primitive["indices"]}
    for name in lacking:
        del document.tree["accessors"][numbers[name]]["bufferView"]
    real = {"bufferView": document.view(b"DRACO"), "attributes": {"POSITION": 0}}
    return primitive | {"extensions": {"KHR_draco_mesh_compression": real}}


@pytest.mark.parametrize("required", [True, False])
@pytest.mark.parametrize("lacking", [("POSITION", "TEXCOORD_0", "indices"), ("POSITION",), ("indices",), ("TEXCOORD_0",)])
def test_part_that_is_compressed_by_draco_is_refused(tmp_path: Path, lacking: tuple[str, ...], required: bool) -> None:
    document = Gltf()
    names = {"extensionsRequired" if required else "extensionsUsed": ["KHR_draco_mesh_compression"]}
    with pytest.raises(InvalidInput, match=r"a\.gltf: it is compressed with Draco \(KHR_draco_mesh_compression\), .* export it without"):
        document.read(tmp_path, document.box(), draco(document, *lacking), **names)


def test_draco_with_all_arrays_beside_it_is_read(tmp_path: Path) -> None:
    document = Gltf()
    mesh = document.read(tmp_path, draco(document), extensionsUsed=["KHR_draco_mesh_compression"])
    assert (volume(mesh), mesh.unread) == (pytest.approx(6), ())


@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
@pytest.mark.parametrize("content", ["real", "zeros", "missing", "none"])
def test_buffer_in_place_of_a_compressed_one_is_read_if_it_has_content(tmp_path: Path, extension: str, content: str) -> None:
    document = Gltf()
    primitive = document.box()
    buffer = document.tree["buffers"][document.tree["bufferViews"][0]["buffer"]]
    document.tree["bufferViews"][0]["extensions"] = {extension: {"buffer": 0, "mode": "ATTRIBUTES"}}
    buffer["extensions"] = {extension: {"fallback": True}}
    if content == "zeros":
        document.tree["buffers"][0] |= {"uri": "zeros.bin"}
        (tmp_path / "zeros.bin").write_bytes(bytes(96))
    elif content == "missing":
        buffer["uri"] = "gone.bin"
    elif content == "none":
        del buffer["uri"]
    if content == "real":
        assert volume(document.read(tmp_path, primitive, extensionsUsed=[extension])) == pytest.approx(6)
        return
    with pytest.raises(InvalidInput, match=f"compressed with {extension}, which cannot be read"):
        document.read(tmp_path, primitive, extensionsUsed=[extension])


def test_extensions_that_may_change_the_shape_are_listed_or_refused(tmp_path: Path) -> None:
    document = Gltf()
    harmless = ["KHR_materials_unlit", "KHR_lights_punctual", "EXT_structural_metadata", "KHR_draco_mesh_compression"]
    assert document.read(tmp_path, document.box(), extensionsUsed=harmless, extensionsRequired=harmless).unread == ()
    mesh = document.read(tmp_path, document.box(), extensionsUsed=["ACME_bends"])
    assert mesh.unread == ("its extension ACME_bends is not read",)
    with pytest.raises(InvalidInput, match="requires ACME_bends, which cannot be read; export it without extensions"):
        document.read(tmp_path, document.box(), extensionsRequired=["ACME_bends"])


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("asset/version", "1.0", "is glTF 1.0; convert it to glTF 2.0"),
        ("scene", 7, "names number 7 of 1 scenes"),
        ("nodes/0/mesh", 3, "names number 3 of 1 meshes"),
        ("nodes/0/children", [0], "a node of it is its own ancestor"),
        ("nodes", [{"children": [2]}, {"children": [2]}, {}], "a node of it has two parents"),
        ("meshes/0/primitives/0/attributes", {}, "names number None of 2 accessors"),
        ("accessors/0/count", 9, "buffer view 0 has 96 bytes, too few for 9 rows; is the file cut off"),
        ("accessors/0/count", -1, "count -1, not a size"),
        ("accessors/0/count", 10**9, "has 1000000000 rows, not at most 6000000"),
        ("accessors/0/componentType", 5130, "accessor 0 is VEC3 of 5130"),
        ("accessors/1/componentType", 5122, "a face names a vertex outside"),
        ("accessors/1/count", 35, "a list of triangles has 35 corners"),
        ("bufferViews/0/byteOffset", 12, "is missing or cut off: 108 bytes are needed, there are 96"),
        ("buffers/0/uri", "gone.bin", "gone.bin is missing or cut off: 96 bytes are needed, there are 0"),
        ("buffers/0/uri", "page.bin", "page.bin is a web page"),
        ("buffers/0/uri", "pointer.bin", "pointer.bin is a Git LFS pointer; run `git lfs pull`"),
        ("nodes/0/extensions", {"EXT_mesh_gpu_instancing": {"attributes": {"SCALE": 0, "ROTATION": 0}}}, "accessor 0 is VEC3"),
        ("nodes/0/matrix", [1, 2, 3], "cannot be read as GLTF"),
    ],
)
def test_damaged_files_are_refused_in_words(tmp_path: Path, path: str, value: object, message: str) -> None:
    (tmp_path / "page.bin").write_text("<!DOCTYPE html><p>not found</p>" * 9)
    (tmp_path / "pointer.bin").write_text(f"version https://git-lfs.github.com/spec/v1\noid sha256:{64 * '5'}\nsize 96\n")
    document = Gltf()
    file = document.write(tmp_path / "a.gltf", document.box())
    tree = json.loads(file.read_text())
    *parents, name = path.split("/")
    part = tree
    for key in parents:
        part = part[int(key) if isinstance(part, list) else key]
    part[int(name) if isinstance(part, list) else name] = value
    file.write_text(json.dumps(tree))
    with pytest.raises(InvalidInput, match=message):
        parse_mesh(file, tmp_path)


def test_binary_file_is_read_whatever_its_suffix_and_refused_where_it_is_cut_off(tmp_path: Path) -> None:
    positions, faces = CORNERS.tobytes(), BOX.faces.astype(np.uint16).tobytes()
    document = Gltf()
    primitive = document.box()
    document.tree["buffers"] = [{"byteLength": len(positions + faces)}]
    document.tree["bufferViews"][1] |= {"buffer": 0, "byteOffset": len(positions)}
    text = document.write(tmp_path / "a.gltf", primitive).read_bytes()
    content = glb(text, positions + faces)
    for name in ("a.glb", "b.gltf"):
        (tmp_path / name).write_bytes(content)
        assert volume(parse_mesh(tmp_path / name, tmp_path)) == pytest.approx(6)
    for damaged, message in (
        (content[:-5], "its buffer is missing or cut off: 168 bytes are needed, there are 163"),
        (content[:200], "cannot be read as GLB: "),
        (glb(text, version=1), "is binary glTF of version 1; convert it to glTF 2.0"),
    ):
        (tmp_path / "a.glb").write_bytes(damaged)
        with pytest.raises(InvalidInput, match=message):
            parse_mesh(tmp_path / "a.glb", tmp_path)
