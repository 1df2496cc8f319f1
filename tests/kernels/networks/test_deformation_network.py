"""Deformation network against its slow twin; its batches, seams and gradients."""

import math
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from pipeline.kernels.charts.vision_charts import vision_charts
from pipeline.kernels.networks.deformation_network import DeformationNetwork
from pipeline.kernels.networks.image_encoder import ENCODER_PLANS, ImageEncoder, MapGrid
from pipeline.kernels.networks.network_configurations import CONFIGURATIONS, SINGLE_IMAGE, NetworkConfig
from tests.kernels.networks.test_perceptual_pooling import scene_camera, slow_pool
from tests.references.dense_graph import dense_mean

SMALL = NetworkConfig(
    image="occluded", touch=True, encoder_layers=12, encoder_width=0.1, gcn_layers=4, gcn_features=12, splits=0, side=3, passes=3
)
COUNTS = [2, 0, 1]


def small(seed: int = 0, **changes: Any) -> DeformationNetwork:
    return DeformationNetwork(SMALL.model_copy(update=changes), torch.Generator().manual_seed(seed)).double()


def inputs(counts: list[int], config: NetworkConfig = SMALL, seed: int = 1) -> dict[str, Any]:
    generator = torch.Generator().manual_seed(seed)
    size = ENCODER_PLANS[config.encoder_layers].resolution
    images = torch.rand(len(counts), 3, size, size, dtype=torch.float64, generator=generator)
    charts = sum(counts) if config.touch else 0
    touch = torch.rand(charts, config.side**2, 3, dtype=torch.float64, generator=generator) * 0.3 + torch.tensor([-0.15, -0.15, 0.45])
    touched = torch.rand(charts, generator=generator) < 0.5
    seen = config.image is not None
    return {
        "images": images if seen else None,
        "camera": scene_camera() if seen else None,
        "touch_vertices": touch,
        "touched": touched,
        "counts": counts,
    }


def in_float32(given: dict[str, Any]) -> dict[str, Any]:
    return {name: value.float() if isinstance(value, Tensor) and value.is_floating_point() else value for name, value in given.items()}


def slow_network(
    network: DeformationNetwork, images: Tensor, touch_vertices: Tensor, touched: Tensor, counts: list[int], **_: Any
) -> np.ndarray:
    """(B, V, 3) the same network item by item and vertex by vertex, with a dense adjacency and the encoder in every pass."""
    sphere, config = vision_charts(network.config.splits), network.config
    camera = scene_camera().numpy()
    assert isinstance(network.encoder, ImageEncoder)
    centre, size = np.array(config.centre), config.side**2
    vertices = [centre + config.radius * sphere.vertices for _ in counts]
    firsts = np.cumsum([0, *counts])
    for _ in range(config.passes):
        maps = [features.detach().numpy() for features in network.encoder(images)]
        for item, count in enumerate(counts):
            own = touch_vertices[firsts[item] : firsts[item + 1]].reshape(count * size, 3).numpy()
            kinds = [0.0] * len(vertices[item]) + [
                1.0 if touched[firsts[item] + chart] else -1.0 for chart in range(count) for _ in range(size)
            ]
            rows = []
            for vertex, kind in zip([*vertices[item], *own], kinds, strict=True):
                u, v, depth = camera @ [*vertex, 1]
                pooled = [
                    slow_pool(features[item], MapGrid(start, jump), u / depth, v / depth)
                    for features, start, jump in zip(maps, (5.5, 15.5, 35.5, 75.5), (2, 4, 8, 16), strict=True)
                ]
                rows.append(np.concatenate([(vertex - centre) / config.radius, [kind], *pooled]))
            dense = dense_mean(sphere.faces, sphere.vertices, sphere.centres, config.side, [count], touch_edges=config.touch_edges)
            features = np.stack(rows)
            for layer in network.gcn.hidden:
                linear = layer.linear
                assert isinstance(linear, nn.Linear)
                features = features @ linear.weight.detach().numpy().T + linear.bias.detach().numpy()
                mixed = features.shape[1] // 3
                features[:, :mixed] = dense @ features[:, :mixed]
                features = np.maximum(features, 0)
            moved = features @ network.gcn.last.weight.detach().numpy().T + network.gcn.last.bias.detach().numpy()
            moved = moved[: len(vertices[item])]
            if config.seams == "tied":
                moved = np.stack([moved[sphere.position == number].mean(axis=0) for number in sphere.position])
            vertices[item] = vertices[item] + config.radius * moved
    return np.stack(vertices)


@pytest.mark.parametrize("changes", [{}, {"seams": "tied"}, {"touch_edges": "all"}], ids=str)
def test_network_equals_its_slow_twin(changes: dict[str, str]) -> None:
    network, given = small(**changes).eval(), inputs(COUNTS)
    with torch.no_grad():
        fast = network(**given)
    assert fast.shape == (3, 456, 3)
    np.testing.assert_allclose(fast.numpy(), slow_network(network, **given), atol=1e-9)


@pytest.mark.parametrize("name", [*CONFIGURATIONS, "single-image"])
def test_each_configuration_runs_and_has_gradients(name: str) -> None:
    changes = {"gcn_layers": 3, "gcn_features": 9, "encoder_width": 0.1, "splits": 0, "side": 3}
    config = CONFIGURATIONS.get(name, SINGLE_IMAGE).model_copy(update=changes)
    network = DeformationNetwork(config, torch.Generator().manual_seed(0)).double()
    vertices = network(**inputs([1, 2] if config.touch else [0, 0], config))
    assert vertices.shape == (2, 456, 3)
    vertices.square().sum().backward()
    for parameter in network.parameters():
        assert parameter.grad is not None
        assert torch.isfinite(parameter.grad).all()


def test_tied_seams_stay_closed_to_the_bit() -> None:
    network, sphere = small(seams="tied").float(), vision_charts(0)
    vertices = network(**in_float32(inputs([2, 1]))).detach()
    assert (vertices - vertices.mean(dim=1, keepdim=True)).norm(dim=-1).std() > 1e-3  # no sphere any more
    for number in range(sphere.position.max() + 1):
        copies = vertices[:, sphere.position == number]
        assert torch.equal(copies, copies[:, :1].expand_as(copies))


def test_encoder_runs_once_per_step() -> None:
    network = small(passes=3)
    calls: list[int] = []
    assert network.encoder is not None
    network.encoder.register_forward_hook(lambda *_: calls.append(1))
    network(**inputs(COUNTS)).sum().backward()
    assert len(calls) == 1


def test_items_do_not_depend_on_others_in_the_batch() -> None:
    network, given = small().eval(), inputs(COUNTS)
    last = {name: given[name][2:] for name in ("images", "touch_vertices", "touched", "counts")}
    with torch.no_grad():
        torch.testing.assert_close(network(**given)[2:], network(**(given | last)))


def test_surface_moves_with_the_scene() -> None:
    """Sphere, camera and charts moved together by 10 m."""
    batch = inputs([1, 2])
    shift = torch.full((3,), 10.0, dtype=torch.float64)
    camera = batch["camera"].clone()
    camera[:, 3] -= camera[:, :3] @ shift
    centre = tuple((torch.tensor(SMALL.centre, dtype=torch.float64) + shift).tolist())
    with torch.no_grad():
        here = small().eval()(**batch)
        moved = small(centre=centre).eval()(**(batch | {"camera": camera, "touch_vertices": batch["touch_vertices"] + shift}))
    torch.testing.assert_close(moved - shift, here, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "single_bound", "half_bound"), [("touch", 1e-6, 0.01), ("occluded-touch", 1e-6, 0.01), ("single-image", 1e-5, 0.05)]
)
def test_float32_and_bfloat16_err_as_documented(name: str, single_bound: float, half_bound: float) -> None:
    """Errors in m as documented, at a quarter of the widths."""
    config = CONFIGURATIONS.get(name, SINGLE_IMAGE).model_copy(update={"splits": 0, "side": 3, "encoder_width": 0.25, "gcn_features": 60})
    network = DeformationNetwork(config, torch.Generator().manual_seed(0)).double().eval()
    exactly = inputs([1] if config.touch else [0], config)
    single = in_float32(exactly)
    with torch.no_grad():
        true = network(**exactly)
        found = network.float()(**single)
        with torch.autocast("cpu", torch.bfloat16):
            rough = network(**single)
    assert float((found - true).abs().max()) <= single_bound
    assert float((rough - found).abs().max()) <= half_bound
    assert rough.dtype == torch.float32
    steps = rough.flatten().sort().values.diff()
    assert float(steps[steps > 0].min()) < 1e-6  # vertices are added up in float32: bfloat16 would place them 4 mm apart


def test_diverged_network_raises() -> None:
    """Divergence is reported where vertices are projected, in the second pass."""
    network = small()
    with torch.no_grad():
        network.gcn.last.bias.fill_(math.inf)
    with pytest.raises(ValueError, match="diverged"):
        network(**inputs([1]))


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"images": torch.full((3, 3, 256, 256), math.inf)}, "inf"),
        ({"camera": torch.full((3, 4), math.nan)}, "camera"),
        ({"touch_vertices": torch.full((3, 9, 3), torch.nan)}, "touch_vertices"),
    ],
)
def test_invalid_inputs_are_rejected(changes: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        small()(**(inputs(COUNTS) | changes))
