"""Reconstructions from no touch and from twenty touches, and observations that are refused."""

from unittest.mock import Mock

import numpy as np
import pytest
import torch

from pipeline.kernels.charts.vision_charts import vision_charts
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS
from pipeline.kernels.touch.touched_points import chart_touches
from pipeline.models.observation import Observation, stored_observation
from pipeline.models.reconstruction import DeformationReconstructor, Reconstructor
from schemas.charts import StopRule
from tests.stages import ball_dataset as spheres

SPHERE = vision_charts(0)
SIZE = spheres.SIDE**2


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Reconstructor]:
    data = tmp_path_factory.mktemp("models")
    return {name: DeformationReconstructor(spheres.make_model(data, name)) for name in ("touch", "unoccluded")}


def felt(count: int, touched: bool = True) -> Observation:
    charts = np.random.default_rng(0).uniform(-0.1, 0.1, (count, SIZE, 3)) + [0, 0, 0.6]
    return Observation(None, chart_touches(charts, np.full(count, touched)))


@pytest.mark.parametrize(("count", "touched"), [(0, True), (1, True), (20, True), (20, False)])
def test_surface_has_the_charts_of_successful_touches_only(models: dict[str, Reconstructor], count: int, touched: bool) -> None:
    reconstructions = models["touch"].reconstruct([felt(count, touched), felt(0)])
    assert [len(made.vertices) for made in reconstructions] == [len(SPHERE.vertices) + count * touched * SIZE, len(SPHERE.vertices)]
    assert all(np.isfinite(made.vertices).all() for made in reconstructions)
    assert reconstructions[0].faces.max() == len(reconstructions[0].vertices) - 1


def test_charts_without_a_fit_count_as_failed_touches() -> None:
    """Every ended fit is a surface; the square of a sensor without touch is not."""
    rules = np.array([list(StopRule)])  # one grasp of a hand with that many sensors
    arrays = {"vertices": np.zeros((*rules.shape, SIZE, 3), np.float32), "stop_rule": rules}
    rows = Mock(read=lambda name, object_id: arrays[name], diagonal=lambda object_id: 0.5)
    view = stored_observation(rows, "a", [0], CONFIGURATIONS["touch"])
    assert dict(zip(StopRule, view.touched.tolist(), strict=True)) == {
        StopRule.no_touch: False,
        StopRule.threshold: True,
        StopRule.cap: True,
        StopRule.too_few_points: False,
        StopRule.collapsed: False,
    }


def test_observations_that_do_not_match_the_model_are_refused(models: dict[str, Reconstructor]) -> None:
    nowhere = felt(2)
    nowhere.touches[1].chart[3, 0] = np.nan
    image = np.zeros((1, 1, 3), np.uint8)
    size = spheres.CAMERA.resolution
    for name, views, message in (
        ("touch", [], "observations is empty"),
        ("touch", [nowhere], "touch_vertices has values that are not finite"),
        ("unoccluded", [Observation(image)], r"unoccluded was trained on images of .* these have \[1, 1\]"),
        ("unoccluded", [Observation(np.zeros((size, size, 3), np.float32))], r"images are .* torch.float32; stored images are"),
    ):
        with pytest.raises(ValueError, match=message):
            models[name].reconstruct(views)


def test_reconstruction_keeps_the_state_of_torchs_generator(models: dict[str, Reconstructor]) -> None:
    before = torch.random.get_rng_state()
    models["touch"].reconstruct([felt(1)])
    assert torch.equal(torch.random.get_rng_state(), before)
