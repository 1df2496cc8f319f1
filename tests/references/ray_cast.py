"""Expected images by ray casting, independent of the renderer."""

from collections.abc import Sequence

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.vision.camera import Camera, camera_pose


def cast(camera: Camera, *meshes: Mesh) -> np.ndarray:
    """(R, R) the number of the mesh, from 1, that Embree's ray through each pixel's centre meets first; 0 where it meets none."""
    hit = _hits(*_rays(camera), meshes)
    return np.where(hit["primID"] >= 0, hit["geomID"] + 1, 0).reshape(camera.shape)


def cast_depth(camera: Camera, mesh: Mesh) -> np.ndarray:
    """(R, C) float64, m along the viewing direction to the plane of the triangle that Embree's ray meets first; +inf where none."""
    origin, directions = _rays(camera)
    hit = _hits(origin, directions, [mesh])
    corners = mesh.vertices[mesh.faces[hit["primID"]]]  # of face -1 where none is hit
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = ((corners[:, 0] - origin) * normals).sum(axis=1) / (directions * normals).sum(axis=1)  # a step of 1 goes 1 m forwards
    return np.where(hit["primID"] >= 0, depth, np.inf).reshape(camera.shape)


def _rays(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    rows, cols = np.indices(camera.shape)
    (fx, fy), (cx, cy) = camera.focal, camera.centre
    inside = np.stack([(cols + 0.5 - cx) / fx, -(rows + 0.5 - cy) / fy, -np.ones(rows.shape)], axis=-1).reshape(-1, 3)
    frame = camera_pose(camera)
    return frame[:3, 3], inside @ frame[:3, :3].T


def _hits(origin: np.ndarray, directions: np.ndarray, meshes: Sequence[Mesh]) -> dict[str, np.ndarray]:
    directions = np.ascontiguousarray(directions, np.float32)
    origins = np.broadcast_to(origin, directions.shape).astype(np.float32)
    scene = rtcore_scene.EmbreeScene()
    for mesh in meshes:
        TriangleMesh(scene, mesh.vertices[mesh.faces].astype(np.float32))
    return scene.run(origins, directions, query="INTERSECT", output=True)
