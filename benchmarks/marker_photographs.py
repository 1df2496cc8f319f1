"""Compare the motion of printed dots with two photographs of a press and of the same press pushed aside, beside a Gaussian model.

`python -m benchmarks.marker_photographs FOLDER`: the folder `marker_calib/data` of github.com/Rancho-zhao/FOTS, of which `0.png` and
`1.png` are used; the others are copies. Fitted are how far the ball was pushed, and a uniform offset of all dots, both along x and y.
`read_shear` is fitted to four fifths of the dots, less that offset, and the others are compared.
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
from pipeline.kernels.touch.elastic_contact import PressedGel
from pipeline.kernels.touch.friction import drag_gel, gel_at_rest, surface_displacement
from pipeline.kernels.touch.marker_tracking import MarkerTracker
from pipeline.kernels.touch.markers import dot_displacement
from pipeline.kernels.touch.sensor import Gel, Sensor, pixel_centres
from pipeline.kernels.touch.shear_reading import read_shear

PIXELS_PER_METRE = 19.58e3
BALL, MIDDLE = 0.003, (145, 121)
"""Radius of the ball, m, which FOTS states; column and row of its middle in the first photograph."""
RADII = 40, 50, 60
"""Pixels: of the contact, which the photographs show roughly, as 50."""
THICKNESS, POISSON, FRICTION, STEPS = 0.004, 0.48, 0.6, 6
"""Of the gel, assumed, m; its Poisson's ratio and friction, assumed; steps in which the ball is pushed."""
FOLDS = 5
"""Parts of the dots, one of which is hidden from `read_shear`."""
SEARCH = 14
"""Pixels within which a dot of the first photograph is searched for in the second."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.marker_photographs", description=__doc__)
    parser.add_argument("folder", type=Path)
    options = parser.parse_args()
    folder = options.folder
    photographs = [read_image(folder / name) for name in ("0.png", "1.png")]
    before, after = map(find_dots, photographs)
    dots, moved = match_dots(before, after)
    tracker = MarkerTracker(photographs[0])
    followed = tracker.follow(photographs[1])
    near, same = KDTree(dots).query(tracker.positions, distance_upper_bound=3)
    both = np.isfinite(near) & np.isfinite(followed[:, 0])
    apart = followed[both] - moved[same[both]]
    print(
        f"`MarkerTracker` follows {np.isfinite(followed[:, 0]).sum()} of {len(followed)} dots; its motion of {both.sum()} is within "
        f"{np.sqrt(np.mean(apart**2)):.2f} px rms, {np.abs(apart).max():.2f} at most, of that between the middles found here"
    )
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
        without = reading_errors(dots, moved - pushed[2:], radius)
        parts = (without, without[outside], without[~outside])
        shown = [f"{np.sqrt(np.mean(part**2)):.2f}" for part in parts]
        rows.append([f"`read_shear`, contact of {radius} px", *shown, "–", f"{np.hypot(*pushed[2:]):.1f}"])
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


def ball_in_gel(radius: float) -> tuple[Sensor, PressedGel]:
    """Press the ball into the assumed gel until its contact has a radius, pixels."""
    gel = Gel(modulus=2e5, poisson=POISSON, thickness=THICKNESS)
    size = {"width": 320 / PIXELS_PER_METRE, "given_height": 240 / PIXELS_PER_METRE, "w": THICKNESS, "membrane": 0.0, "gel": gel}
    sensor: Sensor = vt.load_sensor("gelsight", shape=(240, 320)).model_copy(update=size)
    middle = (np.array(MIDDLE) + 0.5 - (160, 120)) / PIXELS_PER_METRE
    x, y = pixel_centres(sensor)
    bowl = ((x[None] - middle[0]) ** 2 + (y[:, None] - middle[1]) ** 2) / (2 * BALL)
    depth, area = 1e-4, np.pi * (radius / PIXELS_PER_METRE) ** 2
    for _ in range(8):  # the area grows as the depth
        pressed = press_gel(sensor.w - np.maximum(depth - bowl, 0), sensor)
        depth *= area / (pressed.contact.sum() * np.prod(sensor.pitch))
    return sensor, pressed


def friction_errors(dots: np.ndarray, moved: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:  # (4,) mm, mm, px, px; (N, 2) px
    """Fit how far a ball is pushed over the gel, and a uniform offset; return the former and the errors."""
    sensor, pressed = ball_in_gel(radius)
    positions = (np.array(dots) + 0.5 - (160, 120)) / PIXELS_PER_METRE
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


def reading_errors(dots: np.ndarray, moved: np.ndarray, radius: float) -> np.ndarray:  # (N, 2) px
    """Read the gel's shear from four fifths of the dots in turn, given the pressure of the ball, and return the errors of the others."""
    sensor, pressed = ball_in_gel(radius)
    rest, positions = gel_at_rest(sensor), (dots + 0.5 - (160, 120)) / PIXELS_PER_METRE
    first = drag_gel(pressed, np.zeros((3, *rest.contact.shape)), rest, sensor, FRICTION)
    before = dot_displacement(positions, surface_displacement(first, sensor), sensor.pitch)  # of the press alone
    after, errors = before + moved / PIXELS_PER_METRE, np.zeros_like(moved)
    for part in range(FOLDS):
        hidden = np.arange(len(dots)) % FOLDS == part
        shear = read_shear(np.asarray(pressed.pressure), positions[~hidden], after[~hidden], sensor)
        read = dot_displacement(positions[hidden], shear.displacement, sensor.pitch)
        errors[hidden] = PIXELS_PER_METRE * (read - after[hidden])
    return errors


def gaussian_errors(dots: np.ndarray, moved: np.ndarray) -> np.ndarray:  # (N, 2) px
    """Fit a motion that falls off as a Gaussian of the distance from the ball, its width too, and a uniform offset."""
    squared = np.square(dots - MIDDLE).sum(axis=1)[:, None]

    def errors(values: np.ndarray) -> np.ndarray:
        return (np.exp(-1e-4 * values[4] * squared) * values[:2] + values[2:4] - moved).ravel()

    return optimize.least_squares(errors, [0, 8, 0, 2, 3]).fun.reshape(-1, 2)


if __name__ == "__main__":
    main()
