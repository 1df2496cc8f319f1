from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from pipeline.kernels.charts.chart_sphere import chart_sphere
from pipeline.kernels.networks.configurations import CONFIGURATIONS, NetworkConfig
from pipeline.kernels.networks.deformation import DeformationNetwork
from pipeline.kernels.networks.encoder import ENCODER_PLANS, ImageEncoder, MapGrid
from tests.learning.graph_twin import dense_mean
from tests.learning.test_pooling import scene_camera, slow_pool

SMALL = NetworkConfig(
    image="occluded", touch=True, encoder_layers=12, encoder_width=0.1, gcn_layers=4, gcn_features=12, splits=0, side=3, passes=3
)
COUNTS = [2, 0, 1]


def small(seed: int = 0, **changes: Any) -> DeformationNetwork:
    return DeformationNetwork(SMALL.model_copy(update=changes), torch.Generator().manual_seed(seed)).double()


def inputs(
    counts: list[int], config: NetworkConfig = SMALL, seed: int = 1
) -> tuple[Tensor | None, Tensor | None, Tensor | None, Tensor | None, list[int]]:
    generator = torch.Generator().manual_seed(seed)
    size = ENCODER_PLANS[config.encoder_layers].resolution
    images = torch.rand(len(counts), 3, size, size, dtype=torch.float64, generator=generator)
    touch = torch.rand(sum(counts), config.side**2, 3, dtype=torch.float64, generator=generator) * 0.3 + torch.tensor([-0.15, -0.15, 0.45])
    touched = torch.rand(sum(counts), generator=generator) < 0.5
    seen = config.image is not None
    return (
        images if seen else None,
        scene_camera() if seen else None,
        touch if config.touch else None,
        touched if config.touch else None,
        counts,
    )


def slow_network(network: DeformationNetwork, images: Tensor, touch: Tensor, touched: Tensor, counts: list[int]) -> np.ndarray:
    """(B, V, 3) the same network item by item and vertex by vertex, with a dense adjacency and the encoder in every pass."""
    sphere, config = chart_sphere(network.config.splits), network.config
    camera = scene_camera().numpy()
    assert isinstance(network.encoder, ImageEncoder)
    centre, size = np.array(config.centre), config.side**2
    vertices = [centre + config.radius * sphere.vertices for _ in counts]
    firsts = np.cumsum([0, *counts])
    for _ in range(config.passes):
        maps = [features.detach().numpy() for features in network.encoder(images)]
        for item, count in enumerate(counts):
            own = touch[firsts[item] : firsts[item + 1]].reshape(count * size, 3).numpy()
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
            dense = dense_mean(sphere.faces, sphere.vertices, sphere.centres, config.side, [count])
            features = np.stack(rows)
            for layer in network.gcn.hidden:
                linear = layer.linear
                assert isinstance(linear, nn.Linear)
                features = features @ linear.weight.detach().numpy().T + linear.bias.detach().numpy()
                mixed = features.shape[1] // 3
                features[:, :mixed] = dense @ features[:, :mixed]
                features = np.maximum(features, 0)
            moved = features @ network.gcn.last.weight.detach().numpy().T + network.gcn.last.bias.detach().numpy()
            vertices[item] = vertices[item] + config.radius * moved[: len(vertices[item])]
    return np.stack(vertices)


def test_against_the_slow_network() -> None:
    network = small().eval()
    images, camera, touch, touched, counts = inputs(COUNTS)
    assert images is not None
    assert touch is not None
    assert touched is not None
    with torch.no_grad():
        fast = network(images, camera, touch, touched, counts)
    assert fast.shape == (3, 456, 3)
    np.testing.assert_allclose(fast.numpy(), slow_network(network, images, touch, touched, counts), atol=1e-9)


@pytest.mark.parametrize("name", list(CONFIGURATIONS))
def test_every_configuration_runs_and_learns(name: str) -> None:
    changes = {"gcn_layers": 3, "gcn_features": 9, "encoder_width": 0.1, "splits": 0, "side": 3}
    config = CONFIGURATIONS[name].model_copy(update=changes)
    network = DeformationNetwork(config, torch.Generator().manual_seed(0)).double()
    vertices = network(*inputs([1, 2] if config.touch else [0, 0], config))
    assert vertices.shape == (2, 456, 3)
    vertices.square().sum().backward()
    for parameter in network.parameters():
        assert parameter.grad is not None
        assert torch.isfinite(parameter.grad).all()


def test_without_displacement_the_sphere_stays() -> None:
    network = small(image=None, touch=False)
    nn.init.zeros_(network.gcn.last.weight)
    vertices = network(None, None, None, None, [0])
    np.testing.assert_allclose(vertices[0].detach().numpy(), 0.25 * chart_sphere(0).vertices + [0, 0, 0.6], atol=1e-15)


def test_the_first_displacements_are_small() -> None:
    for name in ("touch", "unoccluded-touch", "none"):
        network = DeformationNetwork(
            CONFIGURATIONS[name].model_copy(update={"splits": 0, "side": 3, "encoder_width": 0.1}), torch.Generator().manual_seed(0)
        )
        with torch.no_grad():
            given = [
                value.float() if isinstance(value, Tensor) and value.is_floating_point() else value
                for value in inputs([1, 1] if network.config.touch else [0, 0], network.config)
            ]
            moved = (network(*given) - torch.tensor([0, 0, 0.6])).norm(dim=-1) - 0.25
        assert 0 < moved.abs().max() < 0.25


def test_the_encoder_runs_once_a_step() -> None:
    network = small(passes=3)
    calls: list[int] = []
    assert network.encoder is not None
    network.encoder.register_forward_hook(lambda *_: calls.append(1))
    network(*inputs(COUNTS)).sum().backward()
    assert len(calls) == 1


def test_checkpointing_changes_nothing() -> None:
    plain, frugal = small(), small(checkpointing=True)
    gradients = []
    for network in (plain, frugal):
        vertices = network(*inputs(COUNTS))
        vertices.square().sum().backward()
        gradients.append([vertices, *(parameter.grad for parameter in network.parameters())])
    assert all(torch.equal(one, other) for one, other in zip(*gradients, strict=True))


@pytest.mark.parametrize("together", [1, 2])
def test_the_items_of_a_batch_may_be_worked_on_together(together: int) -> None:
    results = []
    for network in (small(), small(items_at_once=together)):
        vertices = network(*inputs(COUNTS))
        results.append([vertices, *torch.autograd.grad(vertices.square().sum(), list(network.parameters()))])
    for one, other in zip(*results, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-9)


def test_gradients_reach_the_touch_charts_and_images() -> None:
    images, camera, touch, touched, counts = inputs([1])
    assert images is not None
    assert touch is not None
    network = small(passes=2).eval()
    assert torch.autograd.gradcheck(
        lambda given: network(images, camera, given, touched, counts), touch.clone().requires_grad_(), fast_mode=True, atol=1e-5
    )
    images.requires_grad_()
    (gradient,) = torch.autograd.grad(network(images, camera, touch, touched, counts).sum(), images)
    assert gradient.abs().sum() > 0


def test_items_do_not_depend_on_their_neighbours_in_the_batch() -> None:
    network = small().eval()
    images, camera, touch, touched, counts = inputs(COUNTS)
    assert images is not None
    assert touch is not None
    assert touched is not None
    with torch.no_grad():
        together = network(images, camera, touch, touched, counts)
        alone = network(images[2:], camera, touch[2:], touched[2:], [1])
    torch.testing.assert_close(together[2:], alone)


def test_what_touch_charts_say_matters() -> None:
    network = small().eval()
    images, camera, touch, touched, counts = inputs([1])
    assert touched is not None
    with torch.no_grad():
        one, other, none = (
            network(images, camera, *given)
            for given in ((touch, touched, counts), (touch, ~touched, counts), (touch[:0], touched[:0], [0]))
        )
    assert not torch.allclose(one, other)
    assert not torch.allclose(one, none)


def test_equal_generators_equal_networks() -> None:
    state = torch.random.get_rng_state()
    first, second, third = small(3).state_dict(), small(3).state_dict(), small(4).state_dict()
    assert all(torch.equal(first[name], second[name]) for name in first)
    assert any(not torch.equal(first[name], third[name]) for name in first)
    assert torch.equal(state, torch.random.get_rng_state())


def test_steps_are_equal_to_the_bit() -> None:
    results = []
    for _ in range(2):
        network = small().float()
        given = [value.float() if isinstance(value, Tensor) and value.is_floating_point() else value for value in inputs(COUNTS)]
        network(*given).square().sum().backward()
        results.append([parameter.grad for parameter in network.parameters()])
    assert all(torch.equal(one, other) for one, other in zip(*results, strict=True))


def test_inputs_that_do_not_fit() -> None:
    network = small()
    images, camera, touch, touched, counts = inputs(COUNTS)
    assert images is not None
    assert touch is not None
    with pytest.raises(ValueError, match="takes an image and its camera"):
        network(None, None, touch, touched, counts)
    with pytest.raises(ValueError, match="takes neither image nor camera"):
        small(image=None)(images, camera, touch, touched, counts)
    with pytest.raises(ValueError, match=r"images are \(2, 3, 256, 256\), but counts has 3"):
        network(images[:2], camera, touch, touched, counts)
    with pytest.raises(ValueError, match=r"takes no touch charts, but counts is \[2, 0, 1\]"):
        small(touch=False)(images, camera, touch, touched, counts)
    with pytest.raises(ValueError, match="takes touch_vertices and touched"):
        network(images, camera, None, None, counts)
    with pytest.raises(ValueError, match=r"touch_vertices are \(3, 9, 3\).*counts sum to 4"):
        network(images, camera, touch, touched, [2, 1, 1])
    with pytest.raises(ValueError, match="touch_vertices has values that are not finite"):
        network(images, camera, touch * float("nan"), touched, counts)
