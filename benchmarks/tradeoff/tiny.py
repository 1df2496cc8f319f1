"""PyBullet's own software renderer, which one would pick where there is no OpenGL."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.vision.camera import Camera, camera_pose
from stages.render_vision.renderer import FAR_PLANE, NEAR_PLANE
from stages.simulate_grasps.bullet import pybullet


@contextmanager
def tiny_renderer(camera: Camera) -> Iterator[Callable[[Mesh], NDArray[np.bool_]]]:
    """Draws a mesh alone, as this camera sees it; (R, R) where it is seen."""
    client = pybullet.connect(pybullet.DIRECT)
    view, projection = np.linalg.inv(camera_pose(camera)), _projection(camera)

    def draw(mesh: Mesh) -> NDArray[np.bool_]:
        shape = pybullet.createVisualShape(
            pybullet.GEOM_MESH, vertices=mesh.vertices.tolist(), indices=mesh.faces.ravel().tolist(), physicsClientId=client
        )
        body = pybullet.createMultiBody(0, -1, shape, physicsClientId=client)
        image = pybullet.getCameraImage(
            camera.resolution,
            camera.resolution,
            view.T.ravel().tolist(),
            projection.T.ravel().tolist(),
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=client,
        )
        pybullet.removeBody(body, physicsClientId=client)
        mask: NDArray[np.bool_] = np.reshape(image[4], (camera.resolution, camera.resolution)) >= 0
        return mask

    try:
        yield draw
    finally:
        pybullet.disconnect(client)


def _projection(camera: Camera) -> NDArray[np.float64]:
    """OpenGL's projection (4, 4) of the camera's intrinsics, in pixels."""
    (fx, fy), (cx, cy), size = camera.focal, camera.centre, camera.resolution
    return np.array(
        [
            [2 * fx / size, 0, 1 - 2 * cx / size, 0],
            [0, 2 * fy / size, 2 * cy / size - 1, 0],
            [0, 0, -(FAR_PLANE + NEAR_PLANE) / (FAR_PLANE - NEAR_PLANE), -2 * FAR_PLANE * NEAR_PLANE / (FAR_PLANE - NEAR_PLANE)],
            [0, 0, -1, 0],
        ]
    )
