"""Shapes of glTF files that must be computed, against closed forms: nodes, skins, morph targets, instances."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.formats import mesh_parts
from pipeline.formats.gltf_scene import pose_matrix
from tests.formats.gltf_builder import CORNERS, Gltf, volume

QUARTER = [0, 0, 0.5**0.5, 0.5**0.5]
"""A quarter turn about z, which takes x to y."""


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
    lost = f"{left_out} of its nodes with a mesh are skipped: they are hidden, or not in the scene that it shows"
    assert mesh.unread == ((lost,) if left_out else ())


def test_points_and_lines_are_listed(tmp_path: Path) -> None:
    document = Gltf()
    lines = document.box() | {"mode": 1}
    assert document.read(tmp_path, document.box(), lines).unread == ("points and lines of mesh 0 are not read",)
    with pytest.raises(InvalidInput, match=r"holds no triangle mesh.*; points and lines of mesh 0 are not read"):
        document.read(tmp_path, lines)


def test_instances_count_for_the_limit_of_faces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_parts, "MAX_FACES", 20)
    document = Gltf()
    places = {"TRANSLATION": document.array(np.zeros((2, 3), np.float32))}
    node = {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": places}}}
    with pytest.raises(InvalidInput, match="it has 24 faces, 20 are the most; decimate the mesh"):
        document.read(tmp_path, document.box(), nodes=[node])


def test_hidden_nodes_are_left_out_with_those_below_them(tmp_path: Path) -> None:
    document = Gltf()
    hidden = {"mesh": 0, "scale": [5, 1, 1], "children": [2], "extensions": {"KHR_node_visibility": {"visible": False}}}
    nodes = [{"mesh": 0, "children": [1]}, hidden, {"mesh": 0, "scale": [1, 9, 1]}]
    mesh = document.read(tmp_path, document.box(), nodes=nodes, extensionsUsed=["KHR_node_visibility"])
    np.testing.assert_allclose(mesh.vertices, CORNERS)
    assert "2 of its nodes" in mesh.unread[0]
