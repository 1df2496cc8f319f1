"""Measure a training step of the U-Net with and without each loss."""

import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch
from torch import Tensor

from benchmarks.depth import press, wavy_ball
from benchmarks.timing import Table, Times
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.networks.unet import UNet, contact_mask, masked_depth_loss, projected_chamfer_loss
from pipeline.kernels.tensors import network_input
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from pipeline.rng import seeded_weights

BATCH = 8
WIDTHS = 64, 8
"""Channels of the paper's network, and of a narrow one."""
Loss = Callable[[Tensor], Tensor]


def measure(data: Path, turns: int) -> Table:
    """Measure `turns` steps of each kind, in turns; no dataset is needed."""
    sensor = load_sensor("gel_16mm")
    mesh, rng = wavy_ball(5, np.random.default_rng(0)).mesh, np.random.default_rng(1)
    faces = box_faces(mesh.triangles)
    depths = [ray_depth(faces, press(mesh.triangles, rng), sensor).astype(np.float32) for _ in range(BATCH)]
    images, true = (torch.from_numpy(np.stack(maps)) for maps in ([tactile_image(depth, sensor) for depth in depths], depths))
    mask = contact_mask(images, torch.tensor(untouched_image(sensor)))
    loss_arguments: dict[str, Any] = {"depth": true, "mask": mask, "width": sensor.width, "gel": sensor.w}
    losses: dict[str, Loss] = {
        "mean depth": lambda predicted: predicted.mean(),
        "depth loss": lambda predicted: masked_depth_loss(predicted, **loss_arguments),
        "Chamfer loss": lambda predicted: projected_chamfer_loss(predicted, **loss_arguments),
    }
    pixels = f"{sensor.rows} × {sensor.cols} pixels, {int(mask.sum()) // BATCH} of them masked per touch"
    note = f"Batch {BATCH}, {pixels}, untrained. Processor milliseconds of one thread, least / median; shares of the least."
    table = Table("U-Net: one training step", ["step, ms", "its loss, ms", "loss, % of a step without"], [note])
    for width in WIDTHS:
        times = steps(width, images, losses, sensor.w, turns)
        baseline = times["mean depth"][0].least
        for name, (step, loss) in times.items():
            table.add(f"width {width}, {name}", step, loss, f"{100 * loss.least / baseline:.2f}")
    return table


def steps(width: int, images: Tensor, losses: dict[str, Loss], scale: float, turns: int) -> dict[str, tuple[Times, Times]]:
    """Time a whole step, and its loss forward and backward, with each loss."""
    with seeded_weights(0, "benchmark"):
        unet = UNet(width)
    optimizer = torch.optim.Adam(unet.parameters(), lr=5e-5)
    samples: dict[str, list[tuple[float, float]]] = {name: [] for name in losses}
    for turn in range(turns + 1):  # the first warms up
        for name, loss in losses.items():
            start = time.process_time()
            optimizer.zero_grad()
            predicted = unet(network_input(images, torch.float32)) * scale
            before = time.process_time()
            leaf = predicted.detach().requires_grad_()
            loss(leaf).backward()
            in_loss = time.process_time() - before
            predicted.backward(leaf.grad)
            optimizer.step()
            if turn:
                samples[name].append((1e3 * (time.process_time() - start), 1e3 * in_loss))
    columns = {name: list(zip(*rows, strict=True)) for name, rows in samples.items()}
    return {name: (Times(min(step), median(step)), Times(min(loss), median(loss))) for name, (step, loss) in columns.items()}
