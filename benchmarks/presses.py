"""Measure random presses, with shape, gel and tactile image, beside one convolution by FFT of the same size."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from benchmarks.timing import Table, over_items, quantiles, side_by_side
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.depth_maps import press_gel
from pipeline.kernels.touch.press_shapes import random_press
from pipeline.kernels.touch.sensor import Gel
from pipeline.kernels.touch.tactile_image import tactile_image

PRESSES = 100
SHAPE = (240, 320)
SIZE = " × ".join(map(str, SHAPE))


def measure(data: Path, turns: int) -> Table:
    """Measure `turns` rounds of `PRESSES` presses of each kind; no dataset is needed."""
    sensor = load_sensor("gelsight", shape=SHAPE).model_copy(update={"membrane": 9e-4, "gel": None})
    layer = sensor.model_copy(update={"membrane": 0.0, "gel": Gel(modulus=2e5)})
    deep = sensor.model_copy(update={"membrane": 0.0, "gel": Gel(modulus=2e5, thickness=10.0)})
    depths = [random_press(sensor, np.random.default_rng(number)).depth for number in range(PRESSES)]
    kernel = fft.rfft2(np.ones(tuple(2 * side for side in SHAPE)))
    convolution = f"one convolution by FFT, {' × '.join(str(2 * side) for side in SHAPE)}"
    calls: dict[str, Callable[[NDArray[np.float64]], object]] = {
        convolution: lambda depth: fft.irfft2(fft.rfft2(np.minimum(depth, 1.0), kernel.shape[:1] + (2 * SHAPE[1],)) * kernel),
        "membrane: surface": lambda depth: press_gel(depth, sensor),
        "membrane: tactile image": lambda depth: tactile_image(depth, sensor),
        "elastic gel of 4 mm: surface and pressure": lambda depth: press_gel(depth, layer),
        "elastic half-space: surface and pressure": lambda depth: press_gel(depth, deep),
        "elastic gel of 4 mm: tactile image": lambda depth: tactile_image(depth, layer),
    }
    times = side_by_side({name: over_items(call, depths) for name, call in calls.items()}, turns)
    note = f"{PRESSES} random presses of a GelSight with {SIZE} pixels. Processor milliseconds of one core; ratios of the least means."
    table = Table(
        "Presses: gel and tactile image", ["mean ms, least / median", "÷ one convolution", "ms per press: median / 99 % / most"], [note]
    )
    for name, call in calls.items():
        by_press = [min(over_items(call, [depth])() for _ in range(turns)) for depth in depths]
        table.add(name, times[name], times[name].over(times[convolution]), quantiles(by_press))
    return table
