"""The U-Net: its table, learning, contact masks and losses."""

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor, nn

from pipeline.kernels.arrays import WHITE
from pipeline.kernels.networks.unet import UNet, contact_mask, masked_depth_loss, projected_chamfer_loss, visible_depth
from pipeline.kernels.tensors import COLOURS
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from tests.kernels.touch.shapes import ball, coarse
from tests.strategies import seeds

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


def slow_mask(tactile_images: np.ndarray, blank: np.ndarray, threshold: float) -> np.ndarray:
    """Every pixel by itself, in Python's floats."""
    mask = np.zeros(tactile_images.shape[:-1], bool)
    for index in np.ndindex(mask.shape):
        row, col = index[-2:]
        squared = 0.0
        for channel in range(3):
            squared += ((float(tactile_images[*index, channel]) - float(blank[row, col, channel])) / 255) ** 2
        mask[index] = squared > threshold
    return mask


def black(*shape: int) -> torch.Tensor:
    return torch.zeros(shape, dtype=torch.uint8)


@pytest.mark.parametrize("threshold", [0.0, 0.001, 0.01])
def test_contact_mask_equals_the_slow_twin(threshold: float) -> None:
    rng = np.random.default_rng(0)
    blank = rng.integers(0, 256, (7, 5, 3), dtype=np.uint8)
    tactile_images = np.clip(blank + rng.integers(-20, 21, (2, 4, 7, 5, 3)) * rng.integers(0, 2, (2, 4, 7, 5, 1)), 0, 255).astype(np.uint8)
    expected = slow_mask(tactile_images, blank, threshold)
    assert 0 < expected.sum() < expected.size
    assert (contact_mask(torch.from_numpy(tactile_images), torch.from_numpy(blank), threshold).numpy() == expected).all()


@given(seed=seeds, pixel=st.integers(0, 23))
def test_contact_mask_is_exact_at_any_threshold(seed: int, pixel: int) -> None:
    """At the squared norm of one of the pixels and the floats next to it, where a rounded product decides wrongly."""
    blank, tactile_images = np.random.default_rng(seed).integers(0, 256, (2, 6, 4, 3), dtype=np.uint8)
    blank[0], tactile_images[0] = 0, [[0, 0, 0], [1, 0, 0], [WHITE, 0, 0], [WHITE, WHITE, WHITE]]
    squares = np.square(tactile_images.astype(int) - blank).reshape(-1, 3).sum(axis=1).tolist()
    norm = squares[pixel] / WHITE**2
    for threshold in map(float, (np.nextafter(norm, 0), norm, np.nextafter(norm, COLOURS))):
        expected = [Fraction(square, WHITE**2) > Fraction(threshold) for square in squares]
        assert contact_mask(torch.from_numpy(tactile_images), torch.from_numpy(blank), threshold).flatten().tolist() == expected


WIDTH, GEL = 0.01641, 0.0068
Loss = Callable[..., Tensor]
LOSSES: list[Loss] = [masked_depth_loss, projected_chamfer_loss]


def scene(batch: int = 3, rows: int = 6, cols: int = 5, seed: int = 0) -> tuple[Tensor, Tensor, Tensor]:
    """Predicted and true depth, partly beyond the gel and +inf, and a mask; float64."""
    rng = np.random.default_rng(seed)
    predicted = rng.uniform(0, GEL, (batch, rows, cols))
    depth = rng.uniform(0, 1.3 * GEL, (batch, rows, cols))
    depth[rng.random(depth.shape) < 0.2] = np.inf
    mask = rng.random(depth.shape) < 0.6
    return torch.from_numpy(predicted), torch.from_numpy(depth), torch.from_numpy(mask)


def slow_depth_loss(predicted: Tensor, depth: Tensor, mask: Tensor) -> float:
    losses = []
    for item in range(len(predicted)):
        squares = []
        for row, col in np.ndindex(tuple(mask.shape[1:])):
            if mask[item, row, col]:
                target = min(float(depth[item, row, col]), GEL)
                squares.append(((float(predicted[item, row, col]) - target) / WIDTH) ** 2)
        losses.append(sum(squares) / len(squares) if squares else 0.0)
    return sum(losses) / len(losses)


def slow_chamfer_loss(predicted: Tensor, depth: Tensor, mask: Tensor, aspect: float = 1.0) -> float:
    rows, cols = mask.shape[1:]
    losses = []
    for item in range(len(predicted)):
        clouds: tuple[list[tuple[float, ...]], list[tuple[float, ...]]] = ([], [])
        for row, col in np.ndindex(rows, cols):
            if mask[item, row, col]:
                x, y = (col + 0.5) / cols - 0.5, aspect * ((row + 0.5) / rows - 0.5)
                clouds[0].append((x, y, float(predicted[item, row, col]) / WIDTH))
                clouds[1].append((x, y, min(float(depth[item, row, col]), GEL) / WIDTH))
        loss = 0.0
        for a, b in (clouds, clouds[::-1]):
            nearest = [min(math.dist(p, q) ** 2 for q in b) for p in a]
            loss += sum(nearest) / len(nearest) if nearest else 0.0
        losses.append(loss)
    return sum(losses) / len(losses)


@pytest.mark.parametrize("seed", range(4))
def test_losses_equal_their_slow_twins(seed: int) -> None:
    given = scene(seed=seed)
    assert float(masked_depth_loss(*given, width=WIDTH, gel=GEL)) == pytest.approx(slow_depth_loss(*given), rel=1e-12)
    assert float(projected_chamfer_loss(*given, width=WIDTH, gel=GEL)) == pytest.approx(slow_chamfer_loss(*given), rel=1e-12)
    oblong = float(projected_chamfer_loss(*given, width=WIDTH, gel=GEL, aspect=1.5))
    assert oblong == pytest.approx(slow_chamfer_loss(*given, aspect=1.5), rel=1e-12)


@pytest.mark.parametrize("loss", LOSSES)
def test_loss_gradients_are_the_numerical_ones(loss: Loss) -> None:
    predicted, depth, mask = scene(2, 4, 4)
    assert torch.autograd.gradcheck(
        lambda value: loss(value, depth, mask, width=WIDTH, gel=GEL),
        (predicted.requires_grad_(),),
        eps=1e-8,
        atol=1e-6,
    )


@pytest.mark.parametrize("loss", LOSSES)
def test_empty_mask_has_zero_loss_and_gradient(loss: Loss) -> None:
    predicted, depth, mask = scene()
    predicted.requires_grad_()
    value = loss(predicted, depth, torch.zeros_like(mask), width=WIDTH, gel=GEL)
    value.backward()
    assert float(value.detach()) == 0.0
    assert predicted.grad is not None
    assert (predicted.grad == 0).all()
    mask[1] = False  # one of three
    predicted.grad = None
    loss(predicted, depth, mask, width=WIDTH, gel=GEL).backward()
    assert (predicted.grad[1] == 0).all()
    assert torch.isfinite(predicted.grad).all()
    assert (predicted.grad[0] != 0).any()


def test_visible_depth_is_clamped_to_the_gel() -> None:
    depth = torch.tensor([0.0, 0.001, GEL, 0.01, math.inf], dtype=torch.float64)
    assert visible_depth(depth, GEL).tolist() == [0.0, 0.001, GEL, GEL, GEL]
    curved = torch.tensor([GEL, GEL / 2, GEL / 2, GEL / 4, GEL / 4], dtype=torch.float64)  # its height at each pixel
    assert visible_depth(depth.expand(2, 5), curved).tolist() == [[0.0, 0.001, GEL / 2, GEL / 4, GEL / 4]] * 2


PREDICTED, DEPTH, MASK = scene()
BAD = torch.full_like(DEPTH, torch.nan)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ((PREDICTED, BAD, MASK), "depth"),
        ((PREDICTED, -math.inf * DEPTH, torch.zeros_like(MASK)), "-inf"),
        ((BAD, DEPTH, MASK), "3 of 3"),
        ((PREDICTED + math.inf, DEPTH, torch.zeros_like(MASK)), "3 of 3"),
    ],
)
def test_invalid_inputs_are_rejected(loss: Loss, arguments: tuple[Tensor, Tensor, Tensor], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        loss(*arguments, width=WIDTH, gel=GEL)
