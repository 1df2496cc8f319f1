"""Meshes and the scene of the vision tests."""

import numpy as np
import trimesh

from pipeline.formats.scene_file import load_scene
from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.vision.camera import camera_pose

SCENE = load_scene("supplement")
CENTRE = np.array([0.0, 0.0, 0.6])
HERE = np.eye(4)


def from_trimesh(body: trimesh.Trimesh, color: tuple[int, int, int] = (178, 178, 178)) -> Mesh:
    return Mesh(np.array(body.vertices, np.float64), np.array(body.faces, np.int32), Look.plain(len(body.vertices), len(body.faces), color))


def ball(radius: float = 0.2, subdivisions: int = 4, color: tuple[int, int, int] = (178, 178, 178)) -> Mesh:
    body = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    body.apply_translation(CENTRE)
    return from_trimesh(body, color)


def box(extents: tuple[float, float, float] = (0.3, 0.2, 0.25), turn: tuple[float, float, float] = (0.3, 0.4, 0.5)) -> Mesh:
    body = trimesh.creation.box(extents=extents)
    body.apply_transform(trimesh.transformations.euler_matrix(*turn))
    body.apply_translation(CENTRE)
    return from_trimesh(body)


def card(half: float, texture: np.ndarray | None, color: tuple[int, int, int, int] = (255, 255, 255, 255)) -> Mesh:
    """Make a square before the camera, upright in its image, at the distance of the object's centre; uv runs right and up."""
    frame = camera_pose(SCENE.camera)
    right, up = frame[:3, 0], frame[:3, 1]
    vertices = np.array([CENTRE + half * (x * right + y * up) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    look = Look(
        uv=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32),
        face_material=np.zeros(2, np.int32),
        base_color=np.array([color], np.uint8),
        material_texture=np.array([-1 if texture is None else 0], np.int32),
        textures=() if texture is None else (texture,),
    )
    return Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32), look)


def turned_over(mesh: Mesh) -> Mesh:
    """Turn a mesh inside out."""
    return Mesh(mesh.vertices, np.ascontiguousarray(mesh.faces[:, ::-1]), mesh.look)


def half_turned(mesh: Mesh) -> Mesh:
    """Reverse the winding of every other face."""
    faces = mesh.faces.copy()
    faces[::2] = faces[::2, ::-1]
    return Mesh(mesh.vertices, faces, mesh.look)
