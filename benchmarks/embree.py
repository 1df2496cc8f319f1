"""Embree's first hits in float32: the raw limit of tracing a sensor's rays."""

from __future__ import annotations

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from pipeline.kernels.touch.sensor import Sensor, ray_origins


class EmbreeDepth:
    """Distances along a sensor's rays to the faces (F, 3, 3) of a mesh."""

    def __init__(self, triangles: NDArray[np.float64], sensor: Sensor) -> None:
        self._sensor, self._scene = sensor, EmbreeScene()
        self._mesh = TriangleMesh(self._scene, triangles.astype(np.float32))  # the scene does not keep its mesh alive

    def rays(self, pose: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Compute origins and directions (rows · cols, 3) as Embree takes them."""
        origins = ray_origins(pose, self._sensor).reshape(-1, 3).astype(np.float32)
        return origins, np.tile(pose[:3, 2].astype(np.float32), (len(origins), 1))

    def trace(self, rays: tuple[NDArray[np.float32], NDArray[np.float32]]) -> NDArray[np.float32]:
        """Trace rays, and nothing else; (rows · cols,) distances, 1e37 where nothing is hit."""
        distances: NDArray[np.float32] = self._scene.run(*rays, query="DISTANCE")
        return distances

    def depth(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """Trace a sensor's depth map (rows, cols), m; +inf where nothing is hit within range."""
        distance = np.asarray(self.trace(self.rays(pose)), np.float64).reshape(self._sensor.shape)
        return np.where(distance <= self._sensor.range, distance, np.inf)
