"""Shapes of glTF files that must be computed, against closed forms, and files that are refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.formats.gltf_scene import pose_matrix
from pipeline.formats.mesh_file import parse_mesh
from pipeline.kernels.geometry.mesh import Mesh
from tests.formats.gltf_builder import BOX, CORNERS, Gltf

QUARTER = [0, 0, 0.5**0.5, 0.5**0.5]
"""A quarter turn about z, which takes x to y."""


def volume(mesh: Mesh) -> float:
    return float(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume)


def whole(weights: list[float], joints: list[int]) -> dict[str, np.ndarray]:
    """Weight all corners of the box alike."""
    arrays = np.tile(np.array(joints, np.uint8), (8, 1)), np.tile(np.array(weights, np.float32), (8, 1))
    return dict(zip(("JOINTS_0", "WEIGHTS_0"), arrays, strict=True))


JOINTS = [{"mesh": 0, "skin": 0, "translation": [9, 9, 9]}, {"scale": [0.5] * 3, "children": [2]}, {"translation": [0, 0, 4]}]
"""A skinned mesh whose own node is moved, and two joints: one scales by a half, the other is 4 above it, before that scale."""


@pytest.mark.parametrize(
    ("weights", "joints", "expected"),
    [
        ([1, 0, 0, 0], [0, 0, 0, 0], CORNERS * 0.5),
        ([1, 0, 0, 0], [1, 0, 0, 0], CORNERS * 0.5 + [0, 0, 2]),
        ([0.25, 0.75, 0, 0], [0, 1, 0, 0], CORNERS * 0.5 + [0, 0, 1.5]),
        ([0.125, 0.375, 0, 0], [0, 1, 0, 0], CORNERS * 0.5 + [0, 0, 1.5]),  # of the sum 0.5
        ([0, 0, 0, 0], [1, 0, 0, 0], CORNERS * 0.5 + [0, 0, 2]),  # no weights: the first joint
        ([1, 0, 0, 0], [1, 255, 7, 2], CORNERS * 0.5 + [0, 0, 2]),  # joints without weight need not be there
    ],
)
def test_skinned_mesh_follows_its_joints_and_not_its_node(
    tmp_path: Path, weights: list[float], joints: list[int], expected: np.ndarray
) -> None:
    document = Gltf()
    primitive = document.box(**whole(weights, joints))
    mesh = document.read(tmp_path, primitive, nodes=JOINTS, scenes=[{"nodes": [0, 1]}], skins=[{"joints": [1, 2]}])
    np.testing.assert_allclose(mesh.vertices, expected, atol=1e-6)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_weights_of_integers_and_of_two_sets_are_added_and_bind_matrices_come_first(tmp_path: Path, kind: type) -> None:
    """Two joints at x = 0 and 8, each of which is bound at its place, and weighted by a third set and the first."""
    document = Gltf()
    most = np.iinfo(kind).max
    sets = {"JOINTS_0": [0, 0, 0, 0], "WEIGHTS_0": [most // 3, 0, 0, 0], "JOINTS_1": [1, 0, 0, 0], "WEIGHTS_1": [most - most // 3, 0, 0, 0]}
    primitive = document.box()
    for name, row in sets.items():
        array = np.tile(np.array(row, kind), (8, 1))
        primitive["attributes"][name] = document.array(array, **({"normalized": True} if "WEIGHTS" in name else {}))
    binds = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1))
    binds[1, 3, 0] = -8  # columns first: moves by -8 along x
    nodes = [{"mesh": 0, "skin": 0}, {}, {"translation": [8, 0, 0], "rotation": QUARTER}]
    skin = {"joints": [1, 2], "inverseBindMatrices": document.array(binds.reshape(2, 16))}
    mesh = document.read(tmp_path, primitive, nodes=nodes, scenes=[{"nodes": [0, 1, 2]}], skins=[skin])
    turned = np.stack([8 - CORNERS[:, 1], CORNERS[:, 0] - 8, CORNERS[:, 2]], axis=1)
    np.testing.assert_allclose(mesh.vertices, CORNERS / 3 + turned * 2 / 3, atol=1e-5)


@pytest.mark.parametrize(
    ("mesh", "node", "shift"),
    [({"weights": [0.5, 1]}, {}, [1, 4, 0]), ({"weights": [0.5, 1]}, {"weights": [2, 0]}, [4, 0, 0]), ({}, {}, [0, 0, 0])],
)
def test_morph_targets_have_the_weights_of_the_node_or_else_of_the_mesh(
    tmp_path: Path, mesh: dict[str, Any], node: dict[str, Any], shift: list[float]
) -> None:
    document = Gltf()
    rows = list(range(8))
    targets = [np.tile(np.float32([2, 0, 0]), (8, 1)), np.tile(np.float32([0, 4, 0]), (8, 1))]
    of = [{"POSITION": document.array(targets[0])}, {"POSITION": document.sparse(rows, targets[1], 8)}]
    primitive = document.box() | {"targets": of}
    read = document.read(tmp_path, meshes=[{"primitives": [primitive], **mesh}], nodes=[{"mesh": 0, **node}])
    np.testing.assert_allclose(read.vertices, CORNERS + np.float32(shift), atol=1e-6)


def test_instances_are_placed_below_their_node_and_keep_one_material(tmp_path: Path) -> None:
    document = Gltf()
    attributes = {
        "TRANSLATION": document.array(np.float32([[0, 0, 0], [10, 0, 0], [20, 0, 0]])),
        "ROTATION": document.array(np.int16([[0, 0, 0, 32767], [0, 0, 23170, 23170], [0, 0, 0, 32767]]), normalized=True),
        "SCALE": document.array(np.float32([[1, 1, 1], [1, 1, 1], [1, 1, -2]])),
    }
    node = {"mesh": 0, "translation": [0, 0, 7], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}
    primitive = document.box(COLOR_0=np.ones((8, 3), np.float32))
    mesh = document.read(tmp_path, primitive, nodes=[node], extensionsUsed=["EXT_mesh_gpu_instancing"])
    turned = np.stack([10 - CORNERS[:, 1], CORNERS[:, 0], CORNERS[:, 2]], axis=1)
    expected = np.concatenate([CORNERS, turned, CORNERS * [1, 1, -2] + [20, 0, 0]]) + [0, 0, 7]
    np.testing.assert_allclose(mesh.vertices, expected, atol=1e-4)
    assert volume(mesh) == pytest.approx(6 + 6 + 12, abs=1e-3)  # the mirrored one too is wound outwards
    assert len(mesh.look.base_color) == 1
    assert mesh.look.vertex_color is not None
    assert (len(mesh.look.uv), len(mesh.look.face_material), len(mesh.look.vertex_color)) == (24, 36, 24)
    assert mesh.unread == ()


def test_poses_of_nodes_are_matrices_or_translation_after_rotation_after_scale(tmp_path: Path, rng: np.random.Generator) -> None:
    document = Gltf()
    translation, rotation, scale = rng.normal(size=3), rng.normal(size=4), rng.uniform(0.5, 2, 3)
    pose = pose_matrix(translation, rotation, scale)
    parts = {"translation": translation.tolist(), "rotation": rotation.tolist(), "scale": scale.tolist()}
    nodes = [{**parts, "children": [1]}, {"mesh": 0, "matrix": pose.T.ravel().tolist()}]
    mesh = document.read(tmp_path, document.box(), nodes=nodes)
    x, y, z, w = rotation / np.linalg.norm(rotation)
    slow = trimesh.transformations.quaternion_matrix([w, x, y, z]) @ np.diag([*scale, 1])
    slow[:3, 3] = translation
    np.testing.assert_allclose(mesh.vertices, trimesh.transform_points(CORNERS, slow @ slow), atol=1e-6)


@pytest.mark.parametrize(
    ("entries", "size", "left_out"),
    [
        ({}, 1, 3),
        ({"scene": 1}, 5, 3),
        ({"scene": 2}, 6, 2),
        ({"scenes": None}, 14, 0),  # a library of nodes
        ({"scenes": None, "nodes": None}, 1, 0),  # and of meshes
    ],
)
def test_scene_that_is_shown_is_read_and_the_rest_is_counted(tmp_path: Path, entries: dict[str, Any], size: float, left_out: int) -> None:
    document = Gltf()
    parent, child = {"mesh": 0, "translation": [11, 0, 0], "children": [3]}, {"mesh": 0, "translation": [-5, 0, 0]}
    nodes = [{"mesh": 0}, {"mesh": 0, "scale": [5, 1, 1]}, parent, child]
    scenes = [{"nodes": [0]}, {"nodes": [1]}, {"nodes": [2, 3]}]  # the last lists a node and its child
    mesh = document.read(tmp_path, document.box(), **({"nodes": nodes, "scenes": scenes} | entries))
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(size)
    lost = f"{left_out} of its nodes with a mesh are left out: they are hidden, or not in the scene that it shows"
    assert mesh.unread == ((lost,) if left_out else ())


def test_hidden_nodes_are_left_out_with_those_below_them(tmp_path: Path) -> None:
    document = Gltf()
    hidden = {"mesh": 0, "scale": [5, 1, 1], "children": [2], "extensions": {"KHR_node_visibility": {"visible": False}}}
    nodes = [{"mesh": 0, "children": [1]}, hidden, {"mesh": 0, "scale": [1, 9, 1]}]
    mesh = document.read(tmp_path, document.box(), nodes=nodes, extensionsUsed=["KHR_node_visibility"])
    np.testing.assert_allclose(mesh.vertices, CORNERS)
    assert "2 of its nodes" in mesh.unread[0]


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


def test_points_and_lines_are_listed(tmp_path: Path) -> None:
    document = Gltf()
    lines = document.box() | {"mode": 1}
    assert document.read(tmp_path, document.box(), lines).unread == ("points and lines of mesh 0 are not read",)
    with pytest.raises(InvalidInput, match=r"holds no triangle mesh.*; points and lines of mesh 0 are not read"):
        document.read(tmp_path, lines)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("asset/version", "1.0", "is glTF 1.0; convert it to glTF 2.0"),
        ("scene", 7, "names number 7 of 1 scenes"),
        ("nodes/0/mesh", 3, "names number 3 of 1 meshes"),
        ("nodes/0/mesh", -1, "names number -1 of 1 meshes"),
        ("nodes/0/children", [0], "a node of it is its own ancestor"),
        ("nodes", [{"children": [2]}, {"children": [2]}, {}], "a node of it has two parents"),
        ("nodes/0/skin", 0, "names number 0 of 0 skins"),
        ("meshes/0/primitives/0/attributes", {}, "names number None of 2 accessors"),
        ("accessors/0/count", 9, "buffer view 0 has 96 bytes, too few for 9 rows; is the file cut off"),
        ("accessors/0/count", -1, "count -1, not a size"),
        ("accessors/0/count", 10**9, "has 1000000000 rows, not at most 6000000"),
        ("accessors/0/type", "VEC2", "accessor 0 is VEC2 of 5126"),
        ("accessors/0/componentType", 5130, "accessor 0 is VEC3 of 5130"),
        ("accessors/1/componentType", 5122, "a face names a vertex outside"),
        ("accessors/1/count", 35, "a list of triangles has 35 corners"),
        ("accessors/0/byteOffset", 12, "too few for 8 rows"),
        ("bufferViews/0/byteOffset", 12, "is missing or cut off: 108 bytes are needed, there are 96"),
        ("buffers/0/uri", "gone.bin", "gone.bin is missing or cut off: 96 bytes are needed, there are 0"),
        ("nodes/0/extensions", {"EXT_mesh_gpu_instancing": {"attributes": {"SCALE": 0, "ROTATION": 0}}}, "accessor 0 is VEC3"),
        ("nodes/0/matrix", [1, 2, 3], "cannot be read as GLTF"),
    ],
)
def test_damaged_files_are_refused_in_words(tmp_path: Path, path: str, value: object, message: str) -> None:
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
