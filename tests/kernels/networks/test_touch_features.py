"""Touch features of queries around a ball."""

import numpy as np
import torch

from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.networks.touch_features import (
    NEAREST_POINT_FEATURES,
    SCALES,
    TOUCH_FEATURES,
    chart_normals,
    touches_by_item,
)

RADIUS = 0.5


def chart_on_ball(side: int = 5, size: float = 0.02) -> torch.Tensor:
    """Make a chart of the sensor that looks down at the ball's highest point: its +z is the world's -z."""
    flat = chart_square(side)[0] * size
    above = torch.stack([flat[:, 0], -flat[:, 1], torch.full_like(flat[:, 0], RADIUS)], dim=1)
    return RADIUS * torch.nn.functional.normalize(above, dim=1)


def test_normals_point_away_from_the_object():
    chart = chart_on_ball()
    normals = chart_normals(chart[None])[0]
    torch.testing.assert_close(normals, chart / RADIUS, atol=0.02, rtol=0)
    torch.testing.assert_close(normals.norm(dim=1), torch.ones(25, dtype=torch.float64))
    assert not chart_normals(torch.zeros(1, 9, 3)).any()


def test_query_features_hold_the_height_above_the_nearest_touch():
    charts = torch.stack([chart_on_ball(), chart_on_ball() + torch.tensor([0.3, 0, 0])])
    item = touches_by_item(charts, torch.tensor([True, False]), [2])
    heights = torch.tensor([-0.1, 0.0, 0.05, 0.2], dtype=torch.float64)
    queries = torch.stack([torch.zeros(4), torch.zeros(4), RADIUS + heights], dim=1)
    found = item.features_at(queries[None])[0][0]
    assert found.shape == (4, TOUCH_FEATURES)
    touched, outside = found[:, :NEAREST_POINT_FEATURES], found[:, NEAREST_POINT_FEATURES:]
    torch.testing.assert_close(touched[:, 6], heights)
    torch.testing.assert_close(touched[:, :3], heights[:, None] * torch.tensor([0, 0, 1.0], dtype=torch.float64))
    torch.testing.assert_close(touched[:, 7], torch.exp(-heights.abs() / SCALES[0]))
    assert (outside[:, 0] < -0.28).all()  # the other chart is 0.3 away along x, and 0.02 wide


def test_query_features_depend_on_touches_of_the_same_item_and_are_zero_without_touch():
    charts = torch.stack([chart_on_ball(), 2 * chart_on_ball()])
    items = touches_by_item(charts, torch.tensor([True, True]), [1, 0, 1])
    queries = torch.from_numpy(np.random.default_rng(0).normal(size=(6, 3)))
    (first, none, second), _ = items.features_at(torch.stack([queries, queries, 2 * queries]))
    assert items.present.tolist() == [[True] * 25, [False] * 25, [True] * 25]
    assert not none.any()
    assert not first[:, NEAREST_POINT_FEATURES:].any()
    torch.testing.assert_close(2 * first[:, :3], second[:, :3])
