"""The compiled scan conversion has the bits of its Python functions."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.kernels.touch import ray_depth as depth_module
from pipeline.kernels.touch import ray_depth as scan_conversion
from pipeline.kernels.touch.ray_depth import box_faces
from tests.kernels.touch.shapes import (
    coarse,
    pybullet_triangles,
    random_pose,
)


@pytest.mark.parametrize("name", ["duck.obj", "objects/mug.obj", "random_urdfs/126/126.obj"])
def test_compiled_scan_conversion_equals_python(name: str, monkeypatch) -> None:
    triangles = pybullet_triangles(name)
    faces, rng, sensor = box_faces(triangles), np.random.default_rng(2), coarse(40)
    poses = [random_pose(triangles, rng) for _ in range(4)]
    compiled = [depth_module.ray_depth(faces, pose, sensor) for pose in poses]
    functions = {name: function.py_func for name, function in vars(scan_conversion).items() if hasattr(function, "py_func")}
    assert len(functions) == 3
    for name_of, function in functions.items():
        monkeypatch.setattr(scan_conversion, name_of, function)
    monkeypatch.setattr(depth_module, "scan_convert", functions["scan_convert"])
    interpreted = [depth_module.ray_depth(faces, pose, sensor) for pose in poses]
    assert sum(int(np.isfinite(depth).sum()) for depth in compiled) > 1000
    for ours, theirs in zip(compiled, interpreted, strict=True):
        assert ours.tobytes() == theirs.tobytes()
