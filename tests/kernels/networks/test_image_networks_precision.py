"""The U-Net and the image encoder on black, white and saturated images, in batches of one, and in every precision."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import TypeVar

import pytest
import torch
from torch import nn

from pipeline.kernels.networks.image_encoder import ENCODER_PLANS, ImageEncoder
from pipeline.kernels.networks.unet import UNet
from tests.kernels.networks.pictures import KINDS, network_images

Network = TypeVar("Network", bound=nn.Module)


def seeded_network(make: Callable[..., Network], *arguments: object, **others: object) -> Network:
    """Make a network with weights from seed 0."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        return make(*arguments, **others)


def all_finite(network: nn.Module) -> bool:
    return all(parameter.grad is not None and bool(torch.isfinite(parameter.grad).all()) for parameter in network.parameters())


# ---- the U-Net


@pytest.mark.parametrize("training", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_unet_gives_finite_depths_and_gradients_for_any_image(kind: str, training: bool) -> None:
    unet = seeded_network(UNet, 2).train(training)
    depth = unet(network_images(kind, 32))
    depth.sum().backward()
    assert bool(((depth >= 0) & (depth <= 1)).all())
    assert all_finite(unet)
    assert all(bool(torch.isfinite(buffer).all()) for buffer in unet.buffers())
    after = unet.eval()(network_images("noise", 32))  # what was remembered of the first image spoils no later one
    assert bool(torch.isfinite(after).all())


@pytest.mark.parametrize(("size", "batch", "fine"), [(16, 1, False), (31, 1, False), (32, 1, True), (16, 2, True)])
def test_batch_normalisation_trains_on_two_values_per_channel_or_raises(size: int, batch: int, fine: bool) -> None:
    unet = seeded_network(UNet, 1)
    if fine:
        unet(network_images("white", size, batch)).sum().backward()
        assert all_finite(unet)
    else:
        with pytest.raises(ValueError, match=r"one value per channel.*\.eval\(\)"):
            unet(network_images("white", size, batch))
    assert unet.eval()(network_images("white", size, batch)).shape == (batch, size, size)


@pytest.mark.parametrize("kind", KINDS)
def test_unet_has_the_documented_errors_in_each_precision(kind: str) -> None:
    """In evaluation: float32 within 1e-6 of float64, bfloat16 under autocast within 1e-3, of the gel's thickness."""
    unet, tactile_images = seeded_network(UNet, 4).eval(), network_images(kind, 48)
    with torch.no_grad():
        single = unet(tactile_images)
        double = copy.deepcopy(unet).double()(tactile_images.double())
        with torch.autocast("cpu", torch.bfloat16):
            half = unet(tactile_images)
    assert half.dtype == torch.float32
    assert float((single - double).abs().max()) <= 1e-6
    assert float((half - single).abs().max()) <= 1e-3


@pytest.mark.parametrize("bias", [-1e4, 1e4, -88.0, 20.0])
def test_saturated_depth_equals_the_end_of_its_range(bias: float) -> None:
    unet = seeded_network(UNet, 1).eval()
    nn.init.constant_(unet.head.bias, bias)
    depth = unet(network_images("noise", 16))
    depth.sum().backward()
    torch.testing.assert_close(depth, torch.full_like(depth, float(bias > 0)), rtol=0, atol=1e-7)
    assert all_finite(unet)


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_unet_rejects_half_precision_parameters(dtype: torch.dtype) -> None:
    with pytest.raises(ValueError, match=f"U-Net with parameters of type {dtype}.*autocast"):
        seeded_network(UNet, 1).to(dtype)(network_images("noise", 32).to(dtype))


# ---- the image encoder

SMALL = {"batch": 12, "instance": 25}


def encoder(norm: str, width: float = 0.1) -> ImageEncoder:
    return seeded_network(ImageEncoder, ENCODER_PLANS[SMALL[norm]], norm=norm, width=width)


@pytest.mark.parametrize("training", [True, False])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("norm", sorted(SMALL))
def test_maps_of_one_image_of_any_kind_are_bounded_and_repeat(norm: str, kind: str, training: bool) -> None:
    network = encoder(norm).train(training)
    images = network_images(kind, ENCODER_PLANS[SMALL[norm]].resolution)
    maps = network(images)
    sum(features.sum() for features in maps).backward()
    assert all_finite(network)
    again = network(images)
    for features, other in zip(maps, again, strict=True):
        assert bool(torch.isfinite(features).all())
        if training or norm == "instance":
            assert float(features.detach().max()) <= math.sqrt(features[0, 0].numel())
            assert torch.equal(features, other)


@pytest.mark.parametrize("kind", ["noise", "chequered", "one white pixel"])
@pytest.mark.parametrize(("norm", "half_bound"), [("batch", 0.05), ("instance", 0.5)])
def test_encoder_has_the_documented_errors_in_each_precision(norm: str, half_bound: float, kind: str) -> None:
    network, images = encoder(norm, 0.25).eval(), network_images(kind, ENCODER_PLANS[SMALL[norm]].resolution)
    with torch.no_grad():
        single = network(images)
        double = copy.deepcopy(network).double()(images.double())
        with torch.autocast("cpu", torch.bfloat16):
            half = network(images)
    for features, exact, rough in zip(single, double, half, strict=True):
        assert float((features - exact).abs().max()) <= 1e-4 * float(exact.max())
        assert float((rough - features).abs().max()) <= half_bound * float(exact.max())


@pytest.mark.parametrize(
    ("norm", "size", "batch", "training", "fine"),
    [
        ("batch", 151, 1, True, False),  # the last maps have one value
        ("batch", 151, 1, False, True),
        ("batch", 151, 2, True, True),
        ("batch", 150, 2, False, False),  # the last layer has nothing left to see
        ("batch", 1, 1, False, False),
        ("instance", 33, 1, True, True),
        ("instance", 32, 2, False, False),
        ("instance", 32, 2, True, False),
    ],
)
def test_encoder_rejects_images_that_are_too_small(norm: str, size: int, batch: int, training: bool, fine: bool) -> None:
    network, images = encoder(norm).train(training), network_images("noise", size, batch)
    if fine:
        assert all(bool(torch.isfinite(features).all()) for features in network(images))
    else:
        with pytest.raises(ValueError, match=rf"{batch} images of {size} x {size} pixels leave layer \d+ of {SMALL[norm]}.*larger images"):
            network(images)


@pytest.mark.parametrize("value", [math.nan, math.inf, -0.01, 1.01, 255.0])
def test_networks_reject_invalid_images(value: float) -> None:
    images = network_images("noise", 32)
    images[0, 1, 2, 3] = value
    for network in (seeded_network(UNet, 1), encoder("instance")):
        with pytest.raises(ValueError, match=r"reach from .*must lie in \[0, 1\]"):
            network(images)
