"""Objects as collision shapes of PyBullet, concave as they are."""

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.geometry.mesh import Mesh
from pipeline.physics.quiet_pybullet import PhysicsClient, pybullet

FACES_PER_SHAPE = 131_072 // 3
"""PyBullet refuses shapes of more than 131,072 vertices, and every face may have three of its own: larger meshes become several."""
COLLISION_MARGIN = 5e-4
"""m around the object at which contact begins: half the clearance asked for, so that a posture with clearance is left as it is."""


class ObjectShapes:
    """Make shapes of meshes for one client. The lists that PyBullet gets are reused: it never frees them."""

    def __init__(self, client: PhysicsClient) -> None:
        self._client = client
        self._points: list[list[float]] = []

    def create(self, mesh: Mesh) -> list[int]:
        """Make the shapes of a mesh in world coordinates; return the client's numbers of them."""
        shapes = []
        for first in range(0, len(mesh.faces), FACES_PER_SHAPE):
            used, indices = np.unique(mesh.faces[first : first + FACES_PER_SHAPE], return_inverse=True)
            vertices, corners = self._as_lists(mesh.vertices[used]), indices.ravel().tolist()
            concave = pybullet.GEOM_FORCE_CONCAVE_TRIMESH
            shapes.append(self._client.createCollisionShape(pybullet.GEOM_MESH, vertices=vertices, indices=corners, flags=concave))
            vertices.clear()
            corners.clear()
        return shapes

    def _as_lists(self, vertices: NDArray[np.float64]) -> list[list[float]]:
        self._points += [[0.0, 0.0, 0.0] for _ in range(len(vertices) - len(self._points))]
        for point, vertex in zip(self._points, vertices.tolist(), strict=False):
            point[:] = vertex
        return self._points[: len(vertices)]
