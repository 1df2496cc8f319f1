"""`python -m benchmarks.charts`: charts per second, residuals and stop rules by kind of cloud, beside a plain loop."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np
import torch
from numpy.typing import NDArray

from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.charts.chart_fitting import fit_charts
from pipeline.kernels.charts.fit_options import SUPPLEMENT, FitOptions, StopRule
from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.metrics.cloud_distances import sampling_floor
from pipeline.kernels.metrics.surface_sampling import sample_surface
from pipeline.kernels.touch.sensor import pixel_centres

SENSOR = load_sensor("gel_16mm")
CLOUDS = 6
"""Clouds of a kind, each another press."""
TWIN_STEPS = 3
"""Steps of the plain loop that are timed: each takes as long as the others."""
RULES = {
    "to the letter": SUPPLEMENT,
    "halt": FitOptions(),
    "halt, 250 µm": FitOptions(residual_limit=2.5e-4 / SENSOR.width),
    "tight, 100 µm": FitOptions(halt=2.3e-4, residual_limit=1e-4 / SENSOR.width),
}


def press(kind: str, rng: np.random.Generator) -> NDArray[np.float64]:
    """Make the points in the gel, sensor frame, m, of a shape pressed in at random."""
    x, y = np.meshgrid(*pixel_centres(SENSOR))
    deepest = rng.uniform(0.001, 0.006)
    angle, slope = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.5)
    u, v = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    radius = rng.uniform(0.008, 0.04)
    with np.errstate(invalid="ignore"):
        ball = deepest + radius - np.sqrt(radius**2 - x**2 - y**2)
    depths = {
        "cap": np.where(np.isfinite(ball), ball, np.inf),
        "edge": deepest + slope * np.abs(u) + 0.1 * v,
        "flat": deepest + 0.2 * slope * u,
        "corner": deepest + slope * np.maximum(np.maximum(u, -u / 2 + 0.87 * v), -u / 2 - 0.87 * v),
        "cliff": np.where(u > 0.3 * SENSOR.width * (slope - 0.3), deepest, np.inf),
    }
    z = depths["flat" if kind == "noisy" else kind]
    points = np.stack([x, y, z], axis=-1)[z < SENSOR.w]
    return points + (rng.normal(scale=5e-5, size=points.shape) if kind == "noisy" else 0)


def generators() -> list[torch.Generator]:
    return [torch.Generator().manual_seed(i) for i in range(CLOUDS)]


def row(kind: str, name: str, rule: FitOptions, clouds: list[NDArray[np.float64]]) -> str:
    """Fit one kind by one rule; a line of the table."""
    start = time.process_time()
    fits = fit_charts(clouds, SENSOR.width, generators(), options=rule)
    seconds = (time.process_time() - start) / CLOUDS
    residuals = fits.residual * 1e6
    rules = ", ".join(f"{count} {StopRule(code).name}" for code, count in sorted(Counter(fits.stop_rule.tolist()).items()))
    return (
        f"{kind:<7} {name:<14} {seconds:7.2f} {1 / seconds:7.2f} {np.median(fits.iterations):9.0f}  "
        f"{np.median(residuals):7.0f} {residuals.max():7.0f}  {rules}"
    )


def twin_seconds(cloud: NDArray[np.float64], rule: FitOptions) -> float:
    """Seconds a step of section 2.3 written down plainly: one chart, all pairs, torch's Adam."""
    target = torch.from_numpy(cloud / SENSOR.width)
    vertices, faces = chart_square()
    vertices.requires_grad_()
    adam = torch.optim.Adam([vertices], lr=rule.learning_rate)
    generator = torch.Generator().manual_seed(0)
    start = time.process_time()
    for _ in range(TWIN_STEPS):
        pairs = torch.cdist(sample_surface(vertices, faces, rule.samples, generator), target)
        loss = pairs.min(dim=0).values.square().mean() + pairs.min(dim=1).values.square().mean()
        adam.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        adam.step()
    return (time.process_time() - start) / TWIN_STEPS


def main() -> None:
    """Print the table."""
    torch.set_num_threads(1)
    rng = np.random.default_rng(0)
    floor = sampling_floor(1.0, SUPPLEMENT.samples)
    print(
        f"Halt {SUPPLEMENT.halt:g} sensor widths²; two draws of {SUPPLEMENT.samples} from a square are {floor:.2g} apart. CPU s, 1 thread."
    )
    print(f"{'cloud':<7} {'rule':<14} {'s/chart':>7} {'charts/s':>7} {'steps':>8}  {'RMS µm: median, worst':>15}  stopped by, of {CLOUDS}")
    for kind in ("cap", "edge", "flat", "corner", "noisy", "cliff"):
        clouds = [press(kind, rng) for _ in range(CLOUDS)]
        for name, rule in RULES.items():
            print(row(kind, name, rule, clouds), flush=True)
        step = twin_seconds(max(clouds, key=len), SUPPLEMENT)
        print(f"{kind:<7} {'plain loop':<14} {step:7.2f} s a step, all pairs ({max(map(len, clouds))} points)", flush=True)


if __name__ == "__main__":
    main()
