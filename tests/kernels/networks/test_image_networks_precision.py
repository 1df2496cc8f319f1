"""The U-Net and the image encoder on uniform, chequered and noisy images, and in every precision."""

import copy
import math
from collections.abc import Callable
from typing import TypeVar

import pytest
import torch
from torch import Tensor, nn

from pipeline.kernels.arrays import WHITE
from pipeline.kernels.networks.image_encoder import ENCODER_PLANS, ImageEncoder
from pipeline.kernels.networks.network_configurations import NetworkInputs
from pipeline.kernels.networks.unet import UNet

Network = TypeVar("Network", bound=nn.Module)
IMAGES: dict[str, Callable[[int], Tensor]] = {
    "black": lambda size: torch.zeros(1, 3, size, size),
    "chequered": lambda size: (torch.arange(size)[:, None] + torch.arange(size)).remainder(2).expand(1, 3, size, size).float(),
    "noise": lambda size: torch.rand(1, 3, size, size, generator=torch.Generator().manual_seed(0)).mul(WHITE).round() / WHITE,
}
LAYERS = {"batch": 12, "instance": 25}


def seeded_network(make: Callable[..., Network], *arguments: object, **others: object) -> Network:
    """Make a network with weights from seed 0."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        return make(*arguments, **others)


def encoder(norm: str, width: float = 0.1) -> ImageEncoder:
    return seeded_network(ImageEncoder, NetworkInputs(encoder_layers=LAYERS[norm], encoder_norm=norm, encoder_width=width))


def all_finite(network: nn.Module) -> bool:
    return all(parameter.grad is not None and bool(torch.isfinite(parameter.grad).all()) for parameter in network.parameters())


def in_each_precision(network: nn.Module, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Evaluate in float32, in float64, and in bfloat16 under autocast."""
    with torch.no_grad():
        single, double = network(images), copy.deepcopy(network).double()(images.double())
        with torch.autocast("cpu", torch.bfloat16):
            return single, double, network(images)


@pytest.mark.parametrize("kind", IMAGES)
def test_unet_trains_on_any_image_and_errs_as_documented(kind: str) -> None:
    """In evaluation: float32 within 1e-6 of float64, bfloat16 under autocast within 1e-3, of the gel's thickness."""
    unet, images = seeded_network(UNet, 4), IMAGES[kind](48)
    depth = unet(images)
    depth.sum().backward()
    assert bool(((depth >= 0) & (depth <= 1)).all())
    assert all_finite(unet)
    single, double, half = in_each_precision(unet.eval(), images)
    assert half.dtype == torch.float32
    assert float((single - double).abs().max()) <= 1e-6
    assert float((half - single).abs().max()) <= 1e-3


@pytest.mark.parametrize("bias", [-1e4, 20.0])
def test_saturated_depth_equals_the_end_of_its_range(bias: float) -> None:
    unet = seeded_network(UNet, 1).eval()
    nn.init.constant_(unet.head.bias, bias)
    depth = unet(IMAGES["noise"](16))
    depth.sum().backward()
    torch.testing.assert_close(depth, torch.full_like(depth, float(bias > 0)), rtol=0, atol=1e-7)
    assert all_finite(unet)


@pytest.mark.parametrize("kind", ["chequered", "noise"])
@pytest.mark.parametrize(("norm", "half_bound"), [("batch", 0.05), ("instance", 0.5)])
def test_encoder_trains_on_any_image_and_errs_as_documented(norm: str, half_bound: float, kind: str) -> None:
    network, images = encoder(norm), IMAGES[kind](ENCODER_PLANS[LAYERS[norm]].resolution)
    maps = network(images)
    sum(features.sum() for features in maps).backward()
    assert all_finite(network)
    assert all(float(features.detach().max()) <= math.sqrt(features[0, 0].numel()) for features in maps)
    for single, double, half in zip(*in_each_precision(network.eval(), images), strict=True):
        assert float((single - double).abs().max()) <= 1e-4 * float(double.max())
        assert float((half - single).abs().max()) <= half_bound * float(double.max())


@pytest.mark.parametrize(
    ("norm", "size", "batch", "training", "fine"),
    [
        ("batch", 151, 1, True, False),  # the last maps have one value
        ("batch", 151, 1, False, True),
        ("batch", 150, 2, False, False),  # the last layer has nothing left to see
        ("instance", 33, 1, True, True),
        ("instance", 32, 2, False, False),
    ],
)
def test_encoder_rejects_images_that_are_too_small(norm: str, size: int, batch: int, training: bool, fine: bool) -> None:
    network, images = encoder(norm).train(training), IMAGES["noise"](size).expand(batch, -1, -1, -1)
    if fine:
        assert all(bool(torch.isfinite(features).all()) for features in network(images))
    else:
        with pytest.raises(ValueError, match=rf"{batch} images of {size} x {size} pixels"):
            network(images)


@pytest.mark.parametrize("value", [math.nan, -0.01, 1.01, 255.0])
def test_networks_reject_invalid_images(value: float) -> None:
    images = IMAGES["noise"](32)
    images[0, 1, 2, 3] = value
    for network in (seeded_network(UNet, 1), encoder("instance")):
        with pytest.raises(ValueError, match=f"{value:g}"):
            network(images)
