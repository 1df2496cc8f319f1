"""Implicit networks, and the features of touches at queries."""

import functools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn import functional

from pipeline.errors import InvalidInput
from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.networks.image_encoder import MapGrid, pool_features, project_to_pixels
from pipeline.kernels.networks.implicit_network import TANH_SLOPE, ImplicitConfig, ImplicitNetwork
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS
from pipeline.kernels.networks.touch_points import NEAREST_POINT_FEATURES, SCALES, TOUCH_FEATURES, TouchPoints, pad_touches
from pipeline.kernels.touch.touched_points import chart_touches
from tests.kernels.networks.test_deformation_network import inputs

SMALL = ImplicitConfig(image="occluded", touch=True, encoder_width=0.1, features=16, blocks=2, side=3)
COUNTS = [2, 0, 1]
WEIGHTS = torch.zeros(1, dtype=torch.float64)


def small(**changes: Any) -> ImplicitNetwork:
    return ImplicitNetwork(SMALL.model_copy(update=changes), torch.Generator().manual_seed(0)).double().eval()


def inputs_of(counts: list[int] = COUNTS, **changes: Any) -> dict[str, Any]:
    like = CONFIGURATIONS["occluded-touch"].model_copy(update={"side": 3, "encoder_layers": 12} | changes)
    given = inputs(counts, like)
    charts, touched = (given.pop(name) for name in ("touch_vertices", "touched"))
    return given | {"touches": felt(charts, touched, given.pop("counts"))}


def felt(charts: torch.Tensor, touched: torch.Tensor, counts: list[int], like: torch.Tensor = WEIGHTS) -> TouchPoints:
    """Group the vertices of charts (T, S, 3) by item."""
    touches, ends = chart_touches(charts.numpy(), touched.numpy()), np.cumsum(counts)
    return pad_touches([touches[end - count : end] for end, count in zip(ends, counts, strict=True)], like)


def queries(items: int, count: int = 20) -> torch.Tensor:
    drawn = torch.rand(items, count, 3, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    return 0.4 * drawn + torch.tensor([-0.2, -0.2, 0.4])


def test_items_and_queries_are_independent():
    network, seen, asked = small(), inputs_of(), queries(3)
    together = network(asked, **seen)
    assert together.shape == (3, 20)
    assert together.abs().max() < SMALL.band
    for item in range(3):
        touches = TouchPoints(*(values[item, None] for values in vars(seen["touches"]).values()))
        alone = seen | {"images": seen["images"][item, None], "touches": touches}
        torch.testing.assert_close(network(asked[item, None, 7:], **alone)[0], together[item, 7:])


def predict_from_all_inputs_of_each_query(network: ImplicitNetwork, asked: torch.Tensor, **seen: Any) -> torch.Tensor:
    """Predict as `forward`: every point of a touch gets a gradient, and each query carries the codes of its item."""
    code = network.encode(**seen)
    assert network.encoder is not None
    assert code.touches is not None
    assert code.cameras is not None
    felt = network.felt(code.touches.point_features) * code.touches.present[..., None]
    codes = torch.cat([code.overall[:, : network.seen.out_features], functional.pad(felt, (0, 0, 1, 0)).amax(dim=1)], dim=1)
    unit = network._unit(asked)
    pooled = pool_features(code.maps, (MapGrid(), *network.encoder.grids), project_to_pixels(code.cameras, asked[code.with_image]))
    if network.config.image == "any":
        pooled = torch.cat([pooled, torch.ones_like(pooled[..., :1])], dim=2)
    of_pixels = pooled.new_zeros(*asked.shape[:2], pooled.shape[2]).index_copy(0, code.with_image, pooled)
    at_items = codes[:, None].expand(-1, asked.shape[1], -1)
    hidden = network.first(torch.cat([unit, at_items, of_pixels, code.touches.features_at(unit)[0]], dim=2))
    for block in network.blocks:
        hidden = hidden + block(hidden)
    last = network.last(hidden.relu())[..., 0]
    return network.config.band * (torch.tanh(last) + TANH_SLOPE * last)


@pytest.mark.parametrize("image", ["occluded", "any"])
def test_predictions_and_gradients_are_those_of_all_inputs_of_each_query(image: str):
    network, seen, asked = small(image=image), inputs_of(), queries(3)
    if image == "any":
        seen["camera"] = seen["camera"].expand(3, 3, 4) * torch.tensor([1.0, 1.0, 0.0], dtype=torch.float64)[:, None, None]
    results = []
    for predict in (network, functools.partial(predict_from_all_inputs_of_each_query, network)):
        distances = predict(asked, **seen)
        results.append([distances, *torch.autograd.grad(distances.square().sum(), [*network.parameters()])])
    torch.testing.assert_close(results[0], results[1])


def test_a_batch_without_image_and_touch_has_gradients_of_zero_that_processes_wait_for():
    network = small(image="any").train()
    network(queries(2), **inputs_of([0, 0]) | {"images": None, "camera": None}).sum().backward()
    gradients = {name: parameter.grad for name, parameter in network.named_parameters()}
    assert all(gradient is not None for gradient in gradients.values())
    assert not any(gradient.any() for name, gradient in gradients.items() if name.startswith(("encoder", "seen", "felt")))


def test_predictions_do_not_depend_on_the_order_of_grasps():
    network, seen, asked = small(), inputs_of([3]), queries(1)
    turned = seen | {"touches": TouchPoints(*(values.flip(1) for values in vars(seen["touches"]).values()))}
    torch.testing.assert_close(network(asked, **turned), network(asked, **seen))


def test_decode_with_touches_uses_touches_nearby_and_the_network_far_away():
    network, seen = small(), inputs_of([1])
    along = 2.0**-6  # float32 holds it
    flat = torch.tensor([[x, y, 0.625] for y in (along, 0.0, -along) for x in (-along, 0.0, along)], dtype=torch.float64)  # faces +z
    seen |= {"touches": felt(flat[None], torch.tensor([True]), [1])}
    code = network.encode(**seen)
    errors = network.errors_at_touches(code)
    assert errors is not None
    torch.testing.assert_close(errors, network.decode(code, flat[None]))
    assert errors.abs().min() > 1e-5

    def both(points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return network.decode_with_touches(code, points[None], errors)[0], network.decode(code, points[None])[0]

    assert both(flat)[0].abs().max() < 1e-12
    above, below = (both(flat + torch.tensor([0, 0, height], dtype=torch.float64))[0] for height in (1e-3, -1e-3))
    torch.testing.assert_close(above, torch.full_like(above, 1e-3))  # in the finger there is nothing
    torch.testing.assert_close(below, torch.full_like(below, -1e-3), atol=1e-5, rtol=0)
    torch.testing.assert_close(*both(torch.tensor([[0.0, 0.0, 0.775]], dtype=torch.float64)))


@pytest.mark.parametrize("changes", [{"touch": False}, {"touch_reach": 0.0}, {"touch_reach": 1e-30}, {}])
def test_decode_with_touches_equals_decode_without_touch_or_reach(changes: dict[str, Any]):
    network, seen, asked = small(**changes), inputs_of([2 if changes.get("touch", True) else 0]), queries(1)
    points = seen["touches"].points
    if not changes:
        seen |= {"touches": replace(seen["touches"], touched=torch.zeros(points.shape[:2], dtype=torch.bool))}
    code, asked = network.encode(**seen), torch.cat([asked, points], dim=1)
    assert torch.equal(network.decode_with_touches(code, asked, network.errors_at_touches(code)), network.decode(code, asked))


def test_encode_rejects_superfluous_missing_or_infinite_input():
    seen, asked = inputs_of(), queries(3)
    with pytest.raises(ValueError, match="image 'occluded' and touch True is given something else"):
        small()(asked, **(seen | {"images": None, "camera": None}))
    with pytest.raises(ValueError, match="touch False is given something else"):
        small(touch=False)(asked, **seen)
    seen["touches"].points[0, 0, 0] = torch.nan
    with pytest.raises(InvalidInput, match="not finite"):
        small()(asked, **seen)


RADIUS = 0.5


def chart_on_ball(side: int = 5, size: float = 0.02) -> torch.Tensor:
    """Make a chart of the sensor that looks down at the ball's highest point: its +z is the world's -z."""
    flat = chart_square(side)[0] * size
    above = torch.stack([flat[:, 0], -flat[:, 1], torch.full_like(flat[:, 0], RADIUS)], dim=1)
    return RADIUS * torch.nn.functional.normalize(above, dim=1)


def test_query_features_hold_the_height_above_the_nearest_touch():
    charts = torch.stack([chart_on_ball(), chart_on_ball() + torch.tensor([0.3, 0, 0])])
    item = replace(felt(charts, torch.tensor([True, False]), [2]), widths=None)
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
    items = replace(felt(charts, torch.tensor([True, True]), [1, 0, 1]), widths=None)
    queries = torch.from_numpy(np.random.default_rng(0).normal(size=(6, 3)))
    (first, none, second), _ = items.features_at(torch.stack([queries, queries, 2 * queries]))
    assert items.present.tolist() == [[True] * 25, [False] * 25, [True] * 25]
    assert not none.any()
    assert not first[:, NEAREST_POINT_FEATURES:].any()
    torch.testing.assert_close(2 * first[:, :3], second[:, :3])


def test_network_of_gels_is_given_the_width_of_each_gel_in_radii_and_one_of_charts_is_not():
    asked = queries(3)
    for points, differs in (("gels", True), ("charts", False)):
        network, seen = small(touch_points=points), inputs_of()
        wider = seen | {"touches": replace(seen["touches"], widths=2 * seen["touches"].widths)}
        assert torch.equal(network(asked, **seen), network(asked, **wider)) != differs
    encoded = small(touch_points="gels").encode(**inputs_of())
    torch.testing.assert_close(encoded.touches.widths, inputs_of()["touches"].widths / SMALL.radius)
    touched, outside = encoded.touches.features_at(asked)[0].chunk(2, dim=2)
    assert {*touched[0, :, -1].tolist(), *outside[0, :, -1].tolist()} <= {0.0, *encoded.touches.widths[0].tolist()}
