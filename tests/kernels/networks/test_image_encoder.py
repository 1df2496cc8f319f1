"""Image encoders: shapes, parameters, receptive fields."""

import pytest
import torch
from torch import nn

from pipeline.kernels.networks.image_encoder import ENCODER_PLANS, ImageEncoder, PlanarGroupNorm
from pipeline.kernels.networks.network_configurations import NetworkInputs

TABLES_7_TO_9 = [*[(16, s) for s in (127, 125, 123, 121, 119)], *[(32, s) for s in (59, 57, 55, 53, 51)]]
TABLES_7_TO_9 += [*[(64, s) for s in (25, 23, 21, 19, 17)], *[(128, s) for s in (8, 6, 4)]]
TABLE_10 = [
    *[(16, s) for s in (127, 125, 123)],
    *[(32, s) for s in (61, 59, 57)],
    *[(64, s) for s in (28, 26, 24)],
    *[(128, s) for s in (11, 9, 7)],
]
TABLE_11 = [(channels, size) for channels, size in ((16, 69), (32, 35), (64, 18), (128, 9), (256, 5)) for _ in range(5)]
FIFTEEN = [*[(16, s) for s in (127, 125, 123, 121)], *[(32, s) for s in (60, 58, 56, 54)], *[(64, s) for s in (26, 24, 22, 20)]]
FIFTEEN += [(128, s) for s in (9, 7, 5)]


@pytest.mark.parametrize("kernel", [3, 5])
@pytest.mark.parametrize(("layers", "shapes"), [(18, TABLES_7_TO_9), (12, TABLE_10), (15, FIFTEEN), (25, TABLE_11)])
def test_shapes_after_every_layer(layers: int, shapes: list[tuple[int, int]], kernel: int) -> None:
    plan = ENCODER_PLANS[layers]
    encoder = ImageEncoder(NetworkInputs(encoder_layers=layers, encoder_kernel=kernel))
    found = []
    for layer in encoder.layers:
        layer.register_forward_hook(lambda _module, _given, made: found.append(tuple(made.shape)))
    maps = encoder(torch.rand(2, 3, plan.resolution, plan.resolution))
    assert found == [(2, channels, size, size) for channels, size in shapes]
    assert [tuple(features.shape) for features in maps] == [found[tap - 1] for tap in plan.taps]


@pytest.mark.parametrize("kernel", [3, 5])
@pytest.mark.parametrize("layers", [12, 15, 18, 25])
def test_receptive_fields_are_centred_on_the_grid(layers: int, kernel: int) -> None:
    """The pixels that an element's gradient reaches lie evenly about the place that the grid gives for it."""
    plan = ENCODER_PLANS[layers]
    encoder = ImageEncoder(NetworkInputs(encoder_layers=layers, encoder_kernel=kernel, encoder_width=0.01))
    size = 700 if plan.shrinks else 300  # 700: wide enough for the deepest unpadded receptive field
    images = torch.zeros(1, 3, size, size, requires_grad=True)
    features = images
    maps = []
    for layer in encoder.layers:
        convolution = layer[0]
        assert isinstance(convolution, nn.Conv2d)
        nn.init.constant_(convolution.weight, 1 / convolution.weight[0].numel())
        features = convolution(features)
        maps.append(features)
    whole = 0
    for tap, grid in zip(plan.taps, encoder.grids, strict=True):
        tapped = maps[tap - 1]
        row, column = tapped.shape[2] // 2, tapped.shape[3] // 2 - 1
        (reach,) = torch.autograd.grad(tapped[0, 0, row, column], images, retain_graph=True)
        weight = reach[0, 0].double()
        if not weight[[0, -1]].any() and not weight[:, [0, -1]].any():  # not cut by the image's border
            centres = torch.arange(size) + 0.5
            whole += 1
            found = [float((weight.sum(dim=axis) * centres).sum() / weight.sum()) for axis in (0, 1)]
            assert found == pytest.approx([grid.start + grid.jump * column, grid.start + grid.jump * row], abs=1e-4)
    assert whole == len(plan.taps) if plan.shrinks else whole >= 2


def test_encoder_rejects_images_of_four_channels() -> None:
    with pytest.raises(ValueError, match=r"shape \(1, 4, 256, 256\)"):
        ImageEncoder(NetworkInputs(encoder_layers=12))(torch.zeros(1, 4, 256, 256))


def test_group_normalisation_is_torchs_and_keeps_channels_last_and_digits():
    maps = 3 + torch.randn(2, 16, 70, 50, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    normalised = PlanarGroupNorm(8, 16)(maps.float().contiguous(memory_format=torch.channels_last))
    torch.testing.assert_close(normalised.double(), torch.nn.functional.group_norm(maps, 8), rtol=0, atol=1e-5)
    assert normalised.is_contiguous(memory_format=torch.channels_last)


def test_group_normalisation_does_not_depend_on_the_other_images_of_a_batch():
    images = torch.rand(2, 3, 256, 256, generator=torch.Generator().manual_seed(0))
    for norm, alike in (("group", True), ("batch", False)):
        encoder = ImageEncoder(NetworkInputs(encoder_layers=12, encoder_kernel=5, encoder_norm=norm, encoder_width=0.25)).train()
        together, alone = encoder(images)[0][:1], encoder(images[:1])[0]
        assert torch.allclose(together, alone, atol=1e-4) == alike
