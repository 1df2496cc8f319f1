"""U-Net: Table 5 layer by layer, other sizes and types, overfitting of one touch."""

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from pipeline.kernels.networks.unet import UNet, contact_mask, masked_depth_loss, visible_depth
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from tests.kernels.touch.shapes import ball, coarse

TABLE_5 = [
    *[(64, 100), (64, 100), (64, 50)],
    *[(128, 50), (128, 50), (128, 25)],
    *[(256, 25), (256, 25), (256, 12)],
    *[(512, 12), (512, 12), (512, 6)],
    *[(1024, 6), (1024, 6)],
    *[(512, 12), (1024, 12), (512, 12)],
    *[(256, 25), (512, 25), (256, 25)],
    *[(128, 50), (256, 50), (128, 50)],
    *[(64, 100), (128, 100), (64, 100)],
    (1, 100),
]
"""Features and pixels a side after layers (1) to (27)."""


def network(width: int, seed: int = 0) -> UNet:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return UNet(width)


def layer_outputs(unet: UNet, images: Tensor) -> list[Tensor]:
    """Compute the outputs of Table 5's layers (1) to (27), one after the other; the last is (B, 1, H, W), before the sigmoid."""
    outputs: list[Tensor] = []

    def note(_module: nn.Module, _given: tuple[Tensor, ...], made: Tensor) -> None:
        outputs.append(made.clone())  # a ReLU works in place

    for layer in (*(layer for level in unet.down for layer in level), unet.pool, *unet.up, *unet.merge, unet.head):
        layer.register_forward_hook(note)
    for merge in unet.merge:
        merge.register_forward_pre_hook(lambda _module, given: outputs.append(given[0]))
    with torch.no_grad():
        unet(images)
    return outputs


def test_layers_have_the_shapes_of_table_5() -> None:
    shapes = [tuple(layer.shape) for layer in layer_outputs(network(64).eval(), torch.rand(1, 3, 100, 100))]
    assert shapes == [(1, features, side, side) for features, side in TABLE_5]


def test_parameters_are_24_million_at_width_64() -> None:
    """As tactile images of the table: with 3 input channels, biases, and batch norm's scale and shift."""
    assert sum(parameter.numel() for parameter in network(64).parameters()) == 24_425_601
    wide, narrow = (sum(p.numel() for p in network(width).parameters() if p.ndim == 4) for width in (16, 8))
    assert wide - 16 * 27 - 16 == 4 * (narrow - 8 * 27 - 8)  # kernels, but for those of the first layer and the head


def test_layers_have_the_inputs_of_table_5() -> None:
    """Skips (11), (8), (5), (2) meet (15), (18), (21), (24)."""
    unet = network(2).eval()
    layers = layer_outputs(unet, torch.rand(1, 3, 100, 100))
    for concatenated, deconvolved, skipped in ((16, 15, 11), (19, 18, 8), (22, 21, 5), (25, 24, 2)):
        assert torch.equal(layers[concatenated - 1], torch.cat([layers[deconvolved - 1], layers[skipped - 1]], dim=1))
    for pooled, source in ((3, 2), (6, 5), (9, 8), (12, 11)):
        assert torch.equal(layers[pooled - 1], torch.nn.functional.max_pool2d(layers[source - 1], 2))
    assert torch.equal(unet.down[3][0](layers[8]), layers[9])  # (10) takes (9)


def test_2_x_2_convolution_is_padded_at_the_right_and_bottom() -> None:
    """Output pixel (r, c) sees input rows r, r + 1 and columns c, c + 1, with zeros beyond the last."""
    merge = network(1).merge[-1]
    features = torch.rand(1, 2, 5, 4, dtype=torch.float64)
    weight, bias = merge.double()[1].weight, merge[1].bias
    expected = torch.zeros(5, 4, dtype=torch.float64)
    for row, col in np.ndindex(5, 4):
        seen = features[0, :, row : row + 2, col : col + 2]
        expected[row, col] = (seen * weight[0, :, : seen.shape[1], : seen.shape[2]]).sum() + bias[0]
    with torch.no_grad():
        assert torch.allclose(merge[1](merge[0](features))[0, 0], expected, rtol=1e-12, atol=0)


@pytest.mark.parametrize("shape", [(16, 16), (17, 31), (120, 160)])
@pytest.mark.parametrize("training", [True, False])
def test_other_sizes_give_depths_and_gradients(shape: tuple[int, int], training: bool) -> None:
    unet = network(2).train(training)
    depth = unet(torch.rand(2, 3, *shape))
    assert depth.shape == (2, *shape)
    assert (depth > 0).all()
    assert (depth < 1).all()
    depth.sum().backward()
    assert all(parameter.grad is not None and torch.isfinite(parameter.grad).all() for parameter in unet.parameters())


def test_network_overfits_one_touch_to_50_micrometres() -> None:
    """A ball of 12 mm radius, 3 mm deep in the gel: the RMS depth error in evaluation mode."""
    sensor, radius, pressed, steps = coarse(48), 0.012, 0.003, 180
    depth = ray_depth(box_faces(ball(4, radius, z=sensor.w - pressed + radius)), np.eye(4), sensor).astype(np.float32)
    felt, true = torch.from_numpy(tactile_image(depth, sensor))[None], torch.from_numpy(depth)[None]
    mask = contact_mask(felt, torch.tensor(untouched_image(sensor)))
    tactile_images = felt.permute(0, 3, 1, 2) / 255
    unet = network(8)
    optimizer = torch.optim.Adam(unet.parameters(), lr=0.01)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in range(steps):
        optimizer.zero_grad()
        masked_depth_loss(unet(tactile_images) * sensor.w, true, mask, width=sensor.width, gel=sensor.w).backward()
        optimizer.step()
        schedule.step()
    with torch.no_grad():
        predicted = unet.eval()(tactile_images) * sensor.w
    assert float((predicted - visible_depth(true, sensor.w))[mask].square().mean().sqrt()) <= 50e-6
