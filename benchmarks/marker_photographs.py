"""Compare the motion of printed dots with two photographs of a press and of the same press pushed aside, beside a Gaussian model.

`python -m benchmarks.marker_photographs FOLDER`: the folder `marker_calib/data` of github.com/Rancho-zhao/FOTS, of which `0.png` and
`1.png` are used; the others are copies. Fitted are how far the ball was pushed, and a uniform offset of all dots, both along x and y.
`--model` names the folder of a network that `train-touch.source=slides` trained for such a gel; only the offset is fitted.
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, optimize
from scipy.spatial import KDTree

import vt_pipeline as vt
from benchmarks.timing import markdown
from pipeline.formats.image_file import read_image
from pipeline.kernels.touch.depth_maps import press_gel
from pipeline.kernels.touch.friction import drag_gel, gel_at_rest, surface_displacement
from pipeline.kernels.touch.markers import dot_displacement
from pipeline.kernels.touch.sensor import Gel, Sensor, pixel_centres
from pipeline.models.touch_model import LocalTouchModel, load_touch_model

PIXELS_PER_METRE = 19.58e3
BALL, MIDDLE = 0.003, (145, 121)
"""Radius of the ball, m, which FOTS states; column and row of its middle in the first photograph."""
RADII = 40, 50, 60
"""Pixels: of the contact, which the photographs show roughly, as 50."""
THICKNESS, POISSON, FRICTION, STEPS = 0.004, 0.48, 0.6, 6
"""Of the gel, assumed, m; its Poisson's ratio and friction, assumed; steps in which the ball is pushed."""
SEARCH = 14
"""Pixels within which a dot of the first photograph is searched for in the second."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.marker_photographs", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--model", type=Path)
    options = parser.parse_args()
    folder = options.folder
    before, after = (find_dots(read_image(folder / name)) for name in ("0.png", "1.png"))
    dots, moved = match_dots(before, after)
    rms = np.sqrt(np.mean(np.square(moved - np.median(moved, axis=0))))
    print(f"{len(dots)} of {len(before)} dots; moved by up to {np.hypot(*moved.T).max():.1f} px, about their median by {rms:.2f} px rms\n")
    rows = []
    for radius in RADII:
        outside = np.hypot(*(dots - MIDDLE).T) > radius
        pushed, ours = friction_errors(dots, moved, radius)
        for name, errors in (("friction", ours), ("Gaussian", gaussian_errors(dots, moved))):
            parts = (errors, errors[outside], errors[~outside])
            fitted = (f"{np.hypot(*pushed[:2]):.2f}", f"{np.hypot(*pushed[2:]):.1f}") if name == "friction" else ("–", "–")
            rows.append([f"{name}, contact of {radius} px", *(f"{np.sqrt(np.mean(part**2)):.2f}" for part in parts), *fitted])
    if options.model:
        outside = np.hypot(*(dots - MIDDLE).T) > RADII[1]
        errors, offset = network_errors(options.model, [read_image(folder / name) for name in ("0.png", "1.png")], dots, moved)
        parts = (errors, errors[outside], errors[~outside])
        rows.append(["network", *(f"{np.sqrt(np.mean(part**2)):.2f}" for part in parts), "–", f"{np.hypot(*offset):.1f}"])
    print(
        "\n".join(
            markdown(["rms per component, px", "all dots", "outside the contact", "inside", "pushed by, mm", "uniform offset, px"], rows)
        )
    )


def find_dots(image: NDArray[np.uint8]) -> NDArray[np.float64]:  # (N, 2) columns and rows
    """Find the middles of dark dots in a photograph."""
    light = image.min(axis=2).astype(np.float64)
    dark = ndimage.gaussian_filter(np.maximum(ndimage.median_filter(light, 41) - light, 0), 1)
    labels, count = ndimage.label(dark > 0.45 * dark.max())
    numbers = np.arange(1, count + 1)
    sizes = ndimage.sum_labels(np.ones_like(dark), labels, numbers)
    middles = np.array(ndimage.center_of_mass(dark, labels, numbers))
    return middles[sizes > 25, ::-1]  # less is a part of a dot that the rim cuts off


def match_dots(before: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:  # (N, 2) px each
    """Find each dot again, near where it lies if all have moved alike; return positions and motions of those that have a partner."""
    tree = KDTree(after)
    even = np.median(after[tree.query(before)[1]] - before, axis=0)
    distance, nearest = tree.query(before + even, distance_upper_bound=SEARCH)
    found = np.isfinite(distance)
    return before[found], after[nearest[found]] - before[found]


def friction_errors(dots: np.ndarray, moved: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:  # (4,) mm, mm, px, px; (N, 2) px
    """Fit how far a ball is pushed over the gel, and a uniform offset; return the former and the errors."""
    gel = Gel(modulus=2e5, poisson=POISSON, thickness=THICKNESS)
    size = {"width": 320 / PIXELS_PER_METRE, "given_height": 240 / PIXELS_PER_METRE, "w": THICKNESS, "membrane": 0.0, "gel": gel}
    sensor: Sensor = vt.load_sensor("gelsight", shape=(240, 320)).model_copy(update=size)
    positions, middle = ((np.array(at) + 0.5 - (160, 120)) / PIXELS_PER_METRE for at in (dots, MIDDLE))
    x, y = pixel_centres(sensor)
    bowl = ((x[None] - middle[0]) ** 2 + (y[:, None] - middle[1]) ** 2) / (2 * BALL)
    depth, area = 1e-4, np.pi * (radius / PIXELS_PER_METRE) ** 2
    for _ in range(8):  # the area grows as the depth
        pressed = press_gel(sensor.w - np.maximum(depth - bowl, 0), sensor)
        depth *= area / (pressed.contact.sum() * np.prod(sensor.pitch))
    rest = gel_at_rest(sensor)
    motion = np.zeros((3, *rest.contact.shape))
    first = drag_gel(pressed, motion, rest, sensor, FRICTION)

    def errors(values: np.ndarray) -> np.ndarray:
        state = first
        motion[:2] = 1e-3 * values[:2, None, None] / STEPS
        for _ in range(STEPS):
            state = drag_gel(pressed, motion, state, sensor, FRICTION)
        displacement = surface_displacement(state, sensor) - surface_displacement(first, sensor)
        return (dot_displacement(positions, displacement, sensor.pitch) * PIXELS_PER_METRE + values[2:] - moved).ravel()

    found = optimize.least_squares(errors, [0, 0.5, 0, 2.5], diff_step=1e-2, x_scale=[0.1, 0.1, 1, 1], max_nfev=12)
    return found.x, found.fun.reshape(-1, 2)


def network_errors(
    model: Path, photographs: list[np.ndarray], dots: np.ndarray, moved: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:  # (N, 2) px; (2,) px
    """Read the motion of the dots from the first photograph to the second, which a network takes for untouched and touched."""
    network = load_touch_model(model, "cpu")
    assert isinstance(network, LocalTouchModel)
    read = network.read_motion(np.stack(photographs), untouched=photographs[0])
    pixel = (1 / PIXELS_PER_METRE, 1 / PIXELS_PER_METRE)
    positions = (dots + 0.5 - (160, 120)) / PIXELS_PER_METRE
    errors = PIXELS_PER_METRE * dot_displacement(positions, read.shear[1].astype(np.float64), pixel) - moved
    return errors - errors.mean(axis=0), -errors.mean(axis=0)


def gaussian_errors(dots: np.ndarray, moved: np.ndarray) -> np.ndarray:  # (N, 2) px
    """Fit a motion that falls off as a Gaussian of the distance from the ball, its width too, and a uniform offset."""
    squared = np.square(dots - MIDDLE).sum(axis=1)[:, None]

    def errors(values: np.ndarray) -> np.ndarray:
        return (np.exp(-1e-4 * values[4] * squared) * values[:2] + values[2:4] - moved).ravel()

    return optimize.least_squares(errors, [0, 8, 0, 2, 3]).fun.reshape(-1, 2)


if __name__ == "__main__":
    main()
