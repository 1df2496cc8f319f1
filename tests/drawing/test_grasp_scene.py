"""Scenes of grasps: where things are, how large the files are, and that colours survive."""

import io
from dataclasses import replace

import igl
import numpy as np
import pytest
import trimesh
from trimesh.transformations import translation_matrix
from trimesh.visual.color import linear_to_srgb

from pipeline.dataset.mesh_rows import mesh_row
from pipeline.drawing.colors import Y_UP
from pipeline.drawing.grasp_scene import GRID, LINK_FACES, OBJECT_FACES, TEXTURE, TEXTURED_FACES, GraspScenes
from pipeline.formats.hand_file import load_hand
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.hand.kinematics import forward_kinematics, sensor_poses_from_links

HAND, SENSOR = load_hand("allegro_right"), load_sensor("gel_16mm")


def ball(subdivisions: int, color: tuple[int, int, int]) -> Mesh:
    made = trimesh.creation.icosphere(subdivisions, radius=0.1)
    return Mesh(np.array(made.vertices), made.faces.astype(np.int32), Look.plain(len(made.vertices), len(made.faces), color))


@pytest.fixture
def rows():
    pose, angles = np.eye(4), (HAND.lower + HAND.upper) / 2
    pose[:3, 3] = 0.3, 0, 0
    sensors = sensor_poses_from_links(HAND, forward_kinematics(HAND, pose, angles))
    depth = np.full((1, len(sensors), *SENSOR.shape), np.inf, np.float32)
    depth[0, 0] = SENSOR.w / 2
    touched = np.arange(len(sensors))[None] == 0
    grasps = {"hand_pose": pose[None], "joint_angles": angles[None], "sensor_pose": sensors[None], "touch_success": touched}
    return {"surfaces": mesh_row(ball(3, (230, 20, 20))), "grasps": grasps, "touch": {"depth": depth}}


def test_a_scene_shows_hand_sensors_and_touched_surface_where_they_are(rows):
    scenes = GraspScenes(HAND, [SENSOR] * 4, small=False)
    read = trimesh.load(io.BytesIO(scenes.glb(scenes.scene(rows))), file_type="glb")
    below = {
        name: [part for part in read.graph.nodes_geometry if part.startswith(name)]
        for name in ("object", "grasp-0-hand", "grasp-0-touched")
    }
    assert len(below["grasp-0-hand"]) == len(HAND.visual_meshes)
    assert len(below["grasp-0-touched"]) == 1
    pose, geometry = read.graph[below["grasp-0-touched"][0]]
    patch = trimesh.transform_points(read.geometry[geometry].vertices, np.linalg.inv(Y_UP) @ pose)
    sensor = rows["grasps"]["sensor_pose"][0, 0]
    height = (patch - sensor[:3, 3]) @ sensor[:3, 2]
    np.testing.assert_allclose(height, SENSOR.w / 2, atol=5e-4)
    pose, geometry = read.graph[below["object"][0]]
    ours = trimesh.transform_points(read.geometry[geometry].vertices, np.linalg.inv(Y_UP) @ pose)
    np.testing.assert_allclose(ours, rows["surfaces"]["meshes/vertices"], atol=1e-6)


def test_a_small_scene_has_few_faces_on_a_grid_and_keeps_shape_and_colour(rows):
    rows["surfaces"] = mesh_row(ball(5, (230, 20, 20)))  # 20480 faces
    scenes = GraspScenes(HAND, [SENSOR] * 4, small=True)
    (name,) = (name for name in scenes.scene(rows).geometry if name.startswith("object"))
    made = scenes.scene(rows).geometry[name]
    assert len(made.faces) <= OBJECT_FACES
    np.testing.assert_allclose(np.linalg.norm(made.vertices, axis=1), 0.1, atol=5e-4)
    np.testing.assert_array_equal(made.vertices / GRID, np.round(made.vertices / GRID))
    red, green, _ = made.visual.vertex_colors[0, :3] / 255
    assert (red, green) == pytest.approx((0.791, 0.007), abs=0.005)  # linear, as glTF has them


def test_vertices_at_one_position_keep_their_own_colours(rows) -> None:
    corners = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    colors = np.repeat(np.array([[255, 0, 0, 255], [0, 0, 255, 255]], np.uint8), 3, axis=0)
    look = replace(Look.plain(6, 2), vertex_color=colors, base_color=np.full((1, 4), 255, np.uint8))
    rows["surfaces"] = mesh_row(Mesh(np.vstack([corners, corners]), np.arange(6, dtype=np.int32).reshape(2, 3), look))
    made = GraspScenes(HAND, [SENSOR] * 4, small=False).scene(rows)
    (mesh,) = (mesh for name, mesh in made.geometry.items() if name.startswith("object"))
    np.testing.assert_array_equal(mesh.visual.vertex_colors, colors)


def test_a_small_hand_keeps_the_parts_of_its_links() -> None:
    box = trimesh.creation.box((0.08, 0.03, 0.1)).subdivide().subdivide().subdivide().subdivide()
    knuckles = [trimesh.creation.capsule(0.02, 0.006, count=[24, 24], transform=translation_matrix([0.015 * k, 0, 0.1])) for k in range(6)]
    made = trimesh.util.concatenate([box, *knuckles])
    link = Mesh(np.array(made.vertices), made.faces.astype(np.int32), Look.plain(len(made.vertices), len(made.faces), (90, 90, 90)))
    shown = GraspScenes(HAND, [SENSOR] * 4, small=True)._shape(link)
    assert len(shown.faces) < 3 * LINK_FACES
    lost = igl.point_mesh_squared_distance(link.vertices, np.asarray(shown.vertices), np.asarray(shown.faces, np.int64))[0]
    assert np.sqrt(lost.max()) < 0.005


def globe(count: int) -> Mesh:
    """Make a ball of some 4 × `count` ** 2 faces that wears one texture of 1024 pixels: red by latitude."""
    made = trimesh.creation.uv_sphere(radius=0.1, count=[count, count])
    vertices = np.array(made.vertices)
    v = np.arcsin(np.clip(vertices[:, 2] / 0.1, -0.999, 0.999)) / np.pi + 0.5
    texture = np.full((1024, 1024, 4), 255, np.uint8)
    texture[..., 0] = np.linspace(255, 0, 1024)[:, None]
    look = replace(Look.plain(len(vertices), len(made.faces)), base_color=np.full((1, 4), 255, np.uint8))
    worn = replace(look, uv=np.stack([v, v], axis=-1).astype(np.float32), material_texture=np.zeros(1, np.int32), textures=(texture,))
    return Mesh(vertices, made.faces.astype(np.int32), worn)


@pytest.mark.parametrize(("count", "textured"), [(60, True), (80, False)])
def test_small_scene_keeps_its_texture_or_colours(rows, count, textured):
    rows["surfaces"] = mesh_row(globe(count))
    scenes = GraspScenes(HAND, [SENSOR] * 4, small=True)
    written = scenes.glb(scenes.scene(rows))
    assert len(written) < 1_000_000
    made = next(mesh for name, mesh in trimesh.load(io.BytesIO(written), file_type="glb").geometry.items() if name.startswith("object"))
    assert OBJECT_FACES < len(made.faces) <= TEXTURED_FACES
    if textured:
        assert made.visual.material.baseColorTexture.size == (TEXTURE, TEXTURE)
        red = np.asarray(made.visual.material.baseColorTexture)[::-1, 0, 0][(made.visual.uv[:, 1] * (TEXTURE - 1)).astype(int)] / 255
    else:
        red = linear_to_srgb(made.visual.vertex_colors[:, 0] / 255)
    latitude = np.arcsin(np.clip(made.vertices[:, 2] / 0.1, -1, 1)) / np.pi + 0.5
    np.testing.assert_allclose(red, latitude, atol=0.05)
