"""Sphere tracing without the exact last step."""

from __future__ import annotations

import numpy as np

from pipeline.kernels.touch.ray_depth import box_faces, cull_faces, ray_depth
from pipeline.kernels.touch.sphere_tracing import trace_spheres
from tests.kernels.touch.shapes import (
    SENSOR,
    box,
)


def test_rays_along_a_wall_are_reported_as_unsettled() -> None:
    wall = box((0.04, 0.04, 0.02), x=0.02 + 1e-5, z=0.015)
    local = cull_faces(box_faces(wall), np.eye(4), SENSOR)
    depth, settled = trace_spheres(local, SENSOR, tolerance=1e-7, max_steps=30)
    assert not settled.all()
    assert settled.mean() > 0.9
    exact = ray_depth(box_faces(wall), np.eye(4), SENSOR)
    assert (np.isfinite(depth) == np.isfinite(exact))[settled].all()
