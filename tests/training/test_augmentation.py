"""Random variation of training items: as much as set, and none by default."""

import numpy as np
import pytest
import torch

from pipeline.formats.scene_file import load_scene
from pipeline.kernels.geometry.transforms import transform_points
from pipeline.kernels.touch.touched_points import chart_touches
from pipeline.kernels.vision.camera import project_points, projection_matrix
from pipeline.models.observation import Observation
from pipeline.training.items import draw_misplacement, misplace, vary_image, vary_observation
from stages.train_gcn import GcnSettings

GREY = np.full((64, 64, 3), 100, np.uint8)
NOTHING = GcnSettings()


def chance(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def varied(seed: int = 0, image: np.ndarray = GREY, **settings: float) -> np.ndarray:
    return vary_image(image, GcnSettings.model_validate(settings), chance(seed))


def test_augmentation_without_variation_draws_and_copies_nothing():
    generator = chance()
    before = generator.get_state()
    seen = Observation(GREY, chart_touches(np.zeros((4, 9, 3)), np.ones(4, bool)))
    same = vary_observation(seen, NOTHING, generator)
    assert same.image is GREY
    assert same.touches is seen.touches
    assert torch.equal(generator.get_state(), before)


def test_gain_shift_and_noise_change_images_as_much_as_set():
    for settings, reach in (({"image_gain": 0.2}, 20), ({"image_shift": 10.0}, 10)):
        levels = np.array([varied(seed, **settings)[0, 0] for seed in range(200)], int) - 100
        assert 0.9 * reach < np.abs(levels).max() <= reach
        assert abs(np.corrcoef(levels.T)[0, 1]) < 0.3, "each colour is drawn for itself"
        assert len(np.unique(varied(**settings).reshape(-1, 3), axis=0)) == 1
    noise = varied(image_noise=5.0).astype(float) - 100
    assert noise.std() == pytest.approx(5, rel=0.05)
    for level in (0, 255):  # levels do not wrap
        image = np.full((32, 32, 3), level, np.uint8)
        assert np.abs(varied(image=image, image_noise=30.0, image_shift=40.0).astype(int) - level).max() <= 40 + 6 * 30


def test_set_share_of_touch_charts_is_dropped():
    vertices = np.arange(1000, dtype=np.float32)[:, None, None].repeat(9, 1).repeat(3, 2)
    seen = Observation(None, chart_touches(vertices, np.arange(1000) % 2 == 0))
    fewer = vary_observation(seen, GcnSettings(dropped_touches=0.3), chance())
    kept = np.array([touch.chart[0, 0] for touch in fewer.touches]).astype(int)
    assert len(kept) == pytest.approx(700, abs=60)
    assert (fewer.touched == (kept % 2 == 0)).all()


CENTRE, RADIUS = np.array([0.0, 0.0, 0.6]), 0.25


def test_errors_of_the_place_have_the_set_deviation():
    places = [draw_misplacement(0.03, CENTRE, RADIUS, chance(seed)) for seed in range(1000)]
    shifts = np.array([transform_points(place, CENTRE[None])[0] - CENTRE for place in places])
    np.testing.assert_allclose(shifts.mean(axis=0), 0, atol=4e-3)
    np.testing.assert_allclose(shifts.std(axis=0), 0.03, rtol=0.1)
    assert np.std(np.log([place[0, 0] for place in places])) == pytest.approx(0.03 / RADIUS, rel=0.1)


@pytest.mark.parametrize("seed", range(2))
def test_misplaced_observation_shows_the_moved_points_with_its_camera(seed):
    """A blob at a point's pixel is, in the new image, at the pixel of the moved point; touches move with it, and the centre stays."""
    camera, place = projection_matrix(load_scene("supplement").camera), draw_misplacement(0.03, CENTRE, RADIUS, chance(seed))
    point = CENTRE + np.random.default_rng(seed).uniform(-0.1, 0.1, 3)
    col, row = np.meshgrid(np.arange(256) + 0.5, np.arange(256) + 0.5)
    at = project_points(camera, point)
    blob = (255 * np.exp(-((col - at[0]) ** 2 + (row - at[1]) ** 2) / 2 / 4**2)).astype(np.uint8)
    seen = Observation(np.repeat(blob[..., None], 3, axis=2), chart_touches(np.tile(point, (1, 9, 1)), np.ones(1, bool)), camera)
    wrong = misplace(seen, place, CENTRE)
    assert wrong.camera is not None
    np.testing.assert_allclose(wrong.touches[0].points, np.tile(transform_points(place, point[None]), (9, 1)), atol=1e-6)
    weight = wrong.image[..., 0].astype(float)
    mean = np.array([(weight * col).sum(), (weight * row).sum()]) / weight.sum()
    np.testing.assert_allclose(mean, project_points(wrong.camera, wrong.touches[0].points[0].astype(float)), atol=0.3)
    np.testing.assert_allclose(project_points(wrong.camera, CENTRE), project_points(camera, CENTRE), atol=1e-6)


def test_misplaced_image_is_filled_with_the_background_although_a_hand_is_at_its_top():
    camera = projection_matrix(load_scene("supplement").camera)
    image, shift = np.full((256, 256, 3), 230, np.uint8), np.eye(4)
    shift[:2, 3] = 0.2
    image[:40, 50:200] = 70
    seen = Observation(image, chart_touches(np.zeros((1, 9, 3)), np.ones(1, bool)), camera)
    wrong = misplace(seen, shift, CENTRE)
    assert (wrong.image == 230).all(axis=2).sum() > 0.8 * 256 * 256
    assert (wrong.image[-20:] == 230).all()
