"""Cameras beside that of a network's training: the same side and size, wherever the azimuth wraps."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.kernels.vision.view_transfer import moved_projection
from pipeline.models.learned_view import has_learned_view

CAMERA = np.array([[0, 300.0, 0, 0], [0, 0, -300, 0], [-1, 0, 0, 0]]) + np.outer([64, 64, 1], [0, 0, 0, 1.0])
"""1 m along +x from the origin, which it looks at."""


def model(camera: np.ndarray) -> Any:
    return SimpleNamespace(camera=camera, resolution=(128, 128), config=SimpleNamespace(centre=(0.0, 0.0, 0.0), radius=0.25))


def turned(degrees: float) -> np.ndarray:
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    return moved_projection(CAMERA, motion)


@pytest.mark.parametrize("training", [0.0, 100.0, 179.9])
def test_camera_on_the_same_side_has_the_learned_view(training: float) -> None:
    assert has_learned_view(model(turned(training)), turned(training + 0.2))
    assert not has_learned_view(model(turned(training)), turned(training + 5))


def test_camera_of_another_zoom_has_not() -> None:
    assert not has_learned_view(model(CAMERA), np.diag([2.0, 2.0, 1.0]) @ CAMERA)
    assert not has_learned_view(SimpleNamespace(camera=None, resolution=None), CAMERA)  # type: ignore[arg-type]
