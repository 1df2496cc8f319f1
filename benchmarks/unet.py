"""`python -m benchmarks.unet`: a U-Net training step with and without each loss, and one touch overfitted."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
import trimesh
from torch import Tensor

from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.networks.contact_mask import contact_mask
from pipeline.kernels.networks.image_tensors import network_input
from pipeline.kernels.networks.touch_losses import masked_depth_loss, projected_chamfer_loss, visible_depth
from pipeline.kernels.networks.unet import UNet
from pipeline.kernels.touch.face_culling import box_faces
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import Sensor
from pipeline.kernels.touch.tactile_image import tactile_image, untouched_image
from pipeline.rng import seeded_weights

BATCH = 8
ROUNDS = 2
"""Steps of each kind, in turns."""
NARROW = 8
OVERFIT_STEPS = 180
OVERFIT_RATE = 0.01
Loss = Callable[[Tensor], Tensor]


def presses(sensor: Sensor, count: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Readings (count, H, W, 3) uint8 and depths (count, H, W), m, of balls 1 to 3 mm deep in the gel."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    faces = np.asarray(ball.vertices, np.float64)[np.asarray(ball.faces)]  # (F, 3, 3)
    depths = []
    for _ in range(count):
        radius, pressed = rng.uniform(0.006, 0.02), rng.uniform(0.001, 0.003)
        centre = [*rng.uniform(-0.004, 0.004, 2), sensor.w - pressed + radius]
        depths.append(ray_depth(box_faces(faces * radius + centre), np.eye(4), sensor).astype(np.float32))
    return torch.from_numpy(np.stack([tactile_image(depth, sensor) for depth in depths])), torch.from_numpy(np.stack(depths))


def steps(width: int, readings: Tensor, losses: dict[str, Loss], scale: float) -> dict[str, tuple[float, float]]:
    """Least CPU seconds of a whole step, and of its loss forward and backward, with each loss."""
    with seeded_weights(0, "benchmark"):
        unet = UNet(width)
    optimizer = torch.optim.Adam(unet.parameters(), lr=5e-5)
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in losses}
    for turn in range(ROUNDS + 1):  # the first warms up
        for name, loss in losses.items():
            start = time.process_time()
            optimizer.zero_grad()
            predicted = unet(network_input(readings, torch.float32)) * scale
            before = time.process_time()
            leaf = predicted.detach().requires_grad_()
            loss(leaf).backward()
            in_loss = time.process_time() - before
            predicted.backward(leaf.grad)
            optimizer.step()
            if turn:
                seconds[name].append((time.process_time() - start, in_loss))
    return {name: (min(t for t, _ in rows), min(t for _, t in rows)) for name, rows in seconds.items()}


def overfit(readings: Tensor, true: Tensor, mask: Tensor, sensor: Sensor) -> tuple[float, float]:
    """RMS depth error in µm of a narrow network on one touch, in evaluation mode, and the CPU seconds it took."""
    with seeded_weights(0, "benchmark"):
        unet = UNet(NARROW)
    optimizer = torch.optim.Adam(unet.parameters(), lr=OVERFIT_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, OVERFIT_STEPS)
    images = network_input(readings, torch.float32)
    start = time.process_time()
    for _ in range(OVERFIT_STEPS):
        optimizer.zero_grad()
        masked_depth_loss(unet(images) * sensor.w, true, mask, width=sensor.width, gel=sensor.w).backward()
        optimizer.step()
        schedule.step()
    seconds = time.process_time() - start
    with torch.no_grad():
        error = (unet.eval()(images) * sensor.w - visible_depth(true, sensor.w))[mask]
    return float(error.square().mean().sqrt()) * 1e6, seconds


def main() -> None:
    """Print the table."""
    torch.set_num_threads(1)
    sensor = load_sensor("gel_16mm")
    readings, true = presses(sensor, BATCH, np.random.default_rng(0))
    mask = contact_mask(readings, torch.tensor(untouched_image(sensor)))
    given: dict[str, Any] = {"depth": true, "mask": mask, "width": sensor.width, "gel": sensor.w}
    losses: dict[str, Loss] = {
        "none (mean depth)": lambda predicted: predicted.mean(),
        "depth": lambda predicted: masked_depth_loss(predicted, **given),
        "chamfer": lambda predicted: projected_chamfer_loss(predicted, **given),
    }
    size, pixels = f"{sensor.rows} x {sensor.cols}", int(mask.sum()) // BATCH
    print(f"U-Net step, batch {BATCH}, {size}, untrained, {pixels} masked pixels a touch.")
    print(f"CPU seconds on 1 thread, the least of {ROUNDS}, so that what else the machine does counts little.")
    print(f"{'width':>5}  {'loss':24}  {'step':>9}  {'of it loss':>10}  {'loss / step without':>19}")
    for width in (64, NARROW):
        table = steps(width, readings, losses, sensor.w)
        bare = table["none (mean depth)"][0]
        for name, (step, in_loss) in table.items():
            print(f"{width:5}  {name:24}  {step:7.3f} s  {in_loss * 1e3:7.1f} ms  {in_loss / bare:18.2%}", flush=True)
    rms, seconds = overfit(readings[:1], true[:1], mask[:1], sensor)
    print(
        f"One touch overfitted: width {NARROW}, {OVERFIT_STEPS} steps, {seconds:.1f} s: RMS {rms:.1f} µm over {int(mask[0].sum())} pixels."
    )


if __name__ == "__main__":
    main()
