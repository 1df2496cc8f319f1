"""A PyBullet client without a window or output, and objects as its collision shapes, concave as they are."""

import os
import sys

import numpy as np

from pipeline.kernels.arrays import Array
from pipeline.kernels.geometry.mesh import Mesh

sys.stderr.flush()
_stderr = os.dup(2)
_null = os.open(os.devnull, os.O_WRONLY)
os.dup2(_null, 2)  # PyBullet prints its build time on import, which would look like a warning
try:
    import pybullet
    from pybullet_utils.bullet_client import BulletClient
finally:
    os.dup2(_stderr, 2)
    os.close(_stderr)
    os.close(_null)

__all__ = ["PhysicsClient", "pybullet"]
FACES_PER_SHAPE = 131_072 // 3
"""PyBullet refuses shapes of more than 131,072 vertices, and every face may have three of its own: larger meshes become several."""
COLLISION_MARGIN = 5e-4
"""m around the object at which contact begins: half the clearance asked for, so that a posture with clearance is left as it is."""


class PhysicsClient(BulletClient):  # type: ignore[misc]
    """A client; `BulletClient` itself connects with empty options, for which PyBullet prints a line."""

    def __init__(self) -> None:
        self._client, self._pid = pybullet.connect(pybullet.DIRECT), os.getpid()
        self._points: list[list[float]] = []

    def create_shapes(self, mesh: Mesh) -> list[int]:
        """Make the collision shapes of a mesh in world coordinates; return their numbers."""
        shapes = []
        for first in range(0, len(mesh.faces), FACES_PER_SHAPE):
            used, indices = np.unique(mesh.faces[first : first + FACES_PER_SHAPE], return_inverse=True)
            vertices, corners = self._as_lists(mesh.vertices[used]), indices.ravel().tolist()
            concave = pybullet.GEOM_FORCE_CONCAVE_TRIMESH
            shapes.append(self.createCollisionShape(pybullet.GEOM_MESH, vertices=vertices, indices=corners, flags=concave))
            vertices.clear()
            corners.clear()
        return shapes

    def _as_lists(self, vertices: Array) -> list[list[float]]:
        """List points (N, 3) in lists that are reused: PyBullet never frees those that it gets."""
        self._points += [[0.0, 0.0, 0.0] for _ in range(len(vertices) - len(self._points))]
        for point, vertex in zip(self._points, vertices.tolist(), strict=False):
            point[:] = vertex
        return self._points[: len(vertices)]
