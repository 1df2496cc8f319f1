"""What an image must show, by other means than the renderer's."""

from __future__ import annotations

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.vision.camera import Camera, camera_pose


def cast(camera: Camera, *meshes: Mesh) -> np.ndarray:
    """(R, R) the number of the mesh, from 1, that Embree's ray through each pixel's centre meets first; 0 where it meets none."""
    rows, cols = np.indices((camera.resolution, camera.resolution))
    (fx, fy), (cx, cy) = camera.focal, camera.centre
    inside = np.stack([(cols + 0.5 - cx) / fx, -(rows + 0.5 - cy) / fy, -np.ones(rows.shape)], axis=-1).reshape(-1, 3)
    frame = camera_pose(camera)
    directions = (inside @ frame[:3, :3].T).astype(np.float32)
    origins = np.broadcast_to(frame[:3, 3], directions.shape).astype(np.float32)
    scene = rtcore_scene.EmbreeScene()
    for mesh in meshes:
        TriangleMesh(scene, mesh.vertices[mesh.faces].astype(np.float32))
    hit = scene.run(origins, np.ascontiguousarray(directions), query="INTERSECT", output=True)
    return np.where(hit["primID"] >= 0, hit["geomID"] + 1, 0).reshape(rows.shape)
