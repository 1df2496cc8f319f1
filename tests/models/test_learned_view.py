"""Cameras beside that of a network's training: the same side and size, wherever the azimuth wraps."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.kernels.networks.network_configurations import CONFIGURATIONS
from pipeline.kernels.vision.camera import DrawnViews
from pipeline.kernels.vision.view_transfer import moved_projection
from pipeline.models.reconstruction import Trained

CAMERA = np.array([[-64, 300.0, 0, 0], [-64, 0, -300, 0], [-1, 0, 0, 0]]) + np.outer([64, 64, 1], [0, 0, 0, 1.0])
"""1 m along +x from the origin, which it looks at."""


def trained(camera: np.ndarray) -> Trained:
    network = CONFIGURATIONS["occluded"].model_copy(update={"centre": (0.0, 0.0, 0.0)})
    return Trained(configuration="occluded", network=network, camera=camera.tolist(), resolution=(128, 128), charts=None)


def turned(degrees: float) -> np.ndarray:
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    return moved_projection(CAMERA, motion)


@pytest.mark.parametrize("training", [0.0, 100.0, 179.9])
def test_camera_on_the_same_side_has_the_learned_view(training: float) -> None:
    assert trained(turned(training)).has_view(turned(training + 0.2))
    assert not trained(turned(training)).has_view(turned(training + 5))


def test_network_of_drawn_cameras_has_learned_every_view_between_them():
    drawn = DrawnViews(distance=(0.5, 2), elevation=(-5, 5), azimuth=(170, 200))
    learned = trained(turned(180)).model_copy(update={"drawn": drawn})
    assert all(learned.has_view(turned(degrees)) for degrees in (171, -179, 199, -160.5))
    assert not any(learned.has_view(turned(degrees)) for degrees in (0, 165, 210))
    assert learned.learned_direction(turned(150)) == pytest.approx((170, 0))


def test_camera_of_another_zoom_has_not() -> None:
    assert not trained(CAMERA).has_view(np.diag([2.0, 2.0, 1.0]) @ CAMERA)
    blind = Trained(configuration="touch", network=CONFIGURATIONS["touch"], camera=None, resolution=None, charts={})
    assert not blind.has_view(CAMERA)
