"""Measure touch charts: seconds, residuals and stop rules by kind of cloud."""

import time
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.timing import Table, three_digits
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.charts.chart_fitting import fit_charts
from pipeline.kernels.charts.touch_chart import FitOptions, StopRule
from pipeline.kernels.touch.sensor import pixel_centres

SENSOR = load_sensor("gel_16mm")
KINDS = "cap", "edge", "flat", "corner", "noisy", "cliff"
RULES = {"default": FitOptions(), "`tight`": FitOptions(halt=2.3e-4, residual_limit=1e-4 / SENSOR.width)}


def measure(data: Path, turns: int) -> Table:
    """Measure `turns` presses of each kind; no dataset is needed."""
    columns = ["s per chart", "steps, median", "RMS, µm: median / most", "stopped by the threshold, %"]
    note = f"{turns} charts per row, processor seconds of one thread."
    table, rng = Table("Touch charts", columns, [note]), np.random.default_rng(0)
    for kind in KINDS:
        clouds = [press(kind, rng) for _ in range(turns)]
        for name, rule in RULES.items():
            start = time.process_time()
            fits = fit_charts(clouds, SENSOR.width, [torch.Generator().manual_seed(i) for i in range(turns)], options=rule)
            seconds, rms = (time.process_time() - start) / turns, fits.residual * 1e6
            steps, stopped = np.median(fits.iterations), 100 * np.mean(fits.stop_rule == StopRule.threshold)
            table.add(f"{kind}, {name}", three_digits(seconds), steps, f"{np.median(rms):.0f} / {rms.max():.0f}", f"{stopped:.0f}")
    return table


def press(kind: str, rng: np.random.Generator) -> NDArray[np.float64]:
    """Make the points in the gel, sensor frame, m, of a random press."""
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
