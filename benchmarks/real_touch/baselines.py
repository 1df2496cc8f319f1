"""Baselines: a look-up table, and a per-pixel network, both fitted to photographs of balls."""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import nn
from torch.nn.functional import smooth_l1_loss

from benchmarks.real_touch.photograph_sets import PhotographSet, ball_press, distances
from pipeline.kernels.networks.slope_integration import integrate_slopes

Slopes = Callable[[NDArray[np.uint8]], NDArray[np.float64]]
"""Reads (2, rows, cols) slopes of depth along x and y in a photograph."""
BIN = 4
"""Width of a bin of the look-up table, per colour, levels of 255."""
FLAT_BEYOND = 2.5
"""Contact radii from a ball beyond which the gel is flat; methods are fitted to such pixels too."""
FLAT_SHARE = 0.05
"""Share of the flat pixels that is used."""
WIDTH, STEPS, BATCH, RATE, SCALE = 64, 1500, 2048, 3e-3, 50.0
"""Of the per-pixel network: three hidden layers of 64 make 8,834 parameters; `SCALE` is the number of levels that it sees as 1."""


def look_up_table(photographs: PhotographSet) -> Slopes:
    """Fit the mean slope of each bin of colours; a colour outside all bins gets the slope of the nearest bin."""
    change, _, slope = ball_pixels(photographs, np.random.default_rng(0))
    bins, inverse = np.unique(np.round(change / BIN), axis=0, return_inverse=True)
    counts = np.bincount(inverse.ravel())
    means = np.stack([np.bincount(inverse.ravel(), weights=part) / counts for part in slope.T], axis=1)
    tree = cKDTree(bins)

    def read(image: NDArray[np.uint8]) -> NDArray[np.float64]:
        colours, inverse = np.unique((image.astype(float) - photographs.untouched).reshape(-1, 3), axis=0, return_inverse=True)
        nearest = tree.query(colours / BIN)[1][inverse.ravel()]
        return means[nearest].T.reshape(2, *image.shape[:2])

    return read


def per_pixel_network(photographs: PhotographSet, seed: int) -> Slopes:
    """Fit a network that reads each pixel's slopes from its change of colour and its position."""
    change, position, slope = (torch.tensor(part, dtype=torch.float32) for part in ball_pixels(photographs, np.random.default_rng(seed)))
    generator = torch.Generator().manual_seed(seed)
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        sizes = [(5, WIDTH), (WIDTH, WIDTH), (WIDTH, WIDTH)]
        network = nn.Sequential(*(layer for size in sizes for layer in (nn.Linear(*size), nn.ReLU())), nn.Linear(WIDTH, 2))
    inputs = torch.cat([change / SCALE, position], dim=1)
    optimizer = torch.optim.Adam(network.parameters(), lr=RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
    for _ in range(STEPS):
        items = torch.randint(len(inputs), (BATCH,), generator=generator)
        optimizer.zero_grad()
        smooth_l1_loss(network(inputs[items]), slope[items], beta=0.1).backward()
        optimizer.step()
        schedule.step()

    def read(image: NDArray[np.uint8]) -> NDArray[np.float64]:
        colours = torch.tensor((image.astype(np.float32) - photographs.untouched).reshape(-1, 3) / SCALE)
        pixel_positions = torch.tensor(positions(image.shape[:2]).reshape(-1, 2), dtype=torch.float32)
        with torch.inference_mode():
            return network(torch.cat([colours, pixel_positions], dim=1)).double().numpy().T.reshape(2, *image.shape[:2])

    return read


def depth_of(slopes: NDArray[np.float64], pitch: float) -> NDArray[np.float64]:
    """Integrate slopes to depth, in the pitch's unit; negative depths become 0."""
    return np.maximum(integrate_slopes(torch.tensor(slopes)[None], (pitch, pitch))[0].numpy(), 0)


def ball_pixels(
    photographs: PhotographSet, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Collect (n, 3) changes of colour, (n, 2) positions and (n, 2) slopes of pixels: those in contacts, and some of the flat gel."""
    scale = photographs.mm_per_pixel
    parts = []
    for ball in photographs.balls:
        circle = ball.contact
        distance = distances(ball.image.shape[:2], circle.x, circle.y)
        depth = ball_press(ball, photographs.ball_radius, scale).depth
        inside = distance < circle.radius
        flat = (distance > FLAT_BEYOND * circle.radius) & (rng.random(distance.shape) < FLAT_SHARE)
        rows, cols = np.indices(distance.shape)
        toward = np.stack([circle.x - cols, circle.y - rows], axis=-1) * scale
        height = depth + np.sqrt(max(photographs.ball_radius**2 - (scale * circle.radius) ** 2, 0))
        slope = np.where(inside[..., None], toward / np.maximum(height, 1e-6)[..., None], 0.0)
        selected = inside | flat
        parts.append(((ball.image.astype(float) - photographs.untouched)[selected], positions(distance.shape)[selected], slope[selected]))
    change, position, slope = (np.concatenate(part) for part in zip(*parts, strict=True))
    return change, position, slope


def positions(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Compute (rows, cols, 2) x and y of pixels, -1 to 1 from rim to rim."""
    rows, cols = np.indices(shape[:2])
    return np.stack([2 * (cols + 0.5) / shape[1] - 1, 2 * (rows + 0.5) / shape[0] - 1], axis=-1)
