"""Calibrate with simulated photographs that are hard, and read others: `python -m benchmarks.real_touch.hard [NAME ...] [--circles]`."""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from benchmarks.real_touch.hard_sets import HARD_SETS, HardPress, HardSet, hard_press, hard_untouched
from benchmarks.real_touch.scores import angles, ball_radius
from benchmarks.timing import Table
from pipeline.contrib.calibration.ball_photographs import CIRCLES, read_photographs
from pipeline.contrib.calibration.calibrate_sensor import uncalibrated_sensor
from pipeline.contrib.calibration.colour_fit import FIT_FOR_DEPTH, fit_colours
from pipeline.contrib.calibration.square_pixels import check_square
from pipeline.errors import InvalidInput
from pipeline.formats.image_file import read_image
from pipeline.kernels.touch.marker_removal import MarkerRemoval
from pipeline.kernels.touch.sensor import MM
from pipeline.models.touch_model import LocalTouchModel
from pipeline.real_touch import train_sensor_network
from stages.train_touch import TouchTrainingSettings

BALLS, TESTED, PRESSES = 16, 8, 500
"""Photographs to calibrate with and to read; simulated presses, and steps, of the training: a tenth of the usual ones."""
COLUMNS = [
    "refused",
    "radius of circles, true = 1",
    "layer, mm",
    "contact, IoU",
    "radius of contacts",
    "normals, °",
    "depth error, mm",
    "ball, mm",
]


def write_balls(described: HardSet, folder: Path, *, circles: bool) -> list[HardPress]:
    """Write the photographs of a set, and the contacts as one would annotate them if `circles`."""
    Image.fromarray(hard_untouched(described)).save(folder / "untouched.png")
    presses, lines = [hard_press(described, number) for number in range(BALLS)], ["name,x,y,radius"]
    for number, press in enumerate(presses):
        Image.fromarray(press.image).save(folder / f"{number:02d}.png")
        lines.append(f"{number:02d}.png,{press.circle.x},{press.circle.y},{press.circle.radius}")
    if circles:
        (folder / CIRCLES).write_text("\n".join(lines))
    return presses


def measure(described: HardSet, folder: Path, *, circles: bool, train: bool) -> list[str]:
    """Make a row of the table."""
    presses = write_balls(described, folder, circles=circles)
    largest = described.ball_radius / described.mm_per_pixel
    try:
        photographs, untouched, unusable = read_photographs(folder, folder / "untouched.png", largest, row_scale=described.row_scale)
        if described.row_scale == 1:
            check_square(photographs, untouched, largest)
    except InvalidInput as error:
        return [str(error)]
    ratios = [one.contact.radius / presses[int(one.name[:2])].circle.radius for one in photographs]
    cells = [str(len(unusable)), f"{np.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"]
    if not train:
        return cells
    sizes = {"pitch": 1e-3 * described.mm_per_pixel, "thickness": 4e-3, "row_scale": described.row_scale}
    fit = fit_colours(
        uncalibrated_sensor("hard", described.shape, **sizes), photographs, untouched, 1e-3 * described.ball_radius, FIT_FOR_DEPTH
    )
    optics = fit.calibration.model_copy(update={"background": "untouched.png"})
    sensor = fit.sensor.model_copy(update={"calibrated": optics, "photograph": untouched.tobytes()})
    settings = TouchTrainingSettings()
    model, _ = train_sensor_network(sensor, presses=PRESSES, settings=settings.model_copy(update={"epochs": settings.batch_size}))
    cells.append(f"{MM * sensor.layer_thickness:.2f}{' held' if fit.doubts else ''}")
    return cells + scores(described, model, MarkerRemoval(read_image(folder / "untouched.png")))


def scores(described: HardSet, model: LocalTouchModel, markers: MarkerRemoval) -> list[str]:
    """Read photographs that were not fitted: IoU, radius, normals, RMSE in the contact, and the ball's radius."""
    pitch, rows = (described.mm_per_pixel * described.row_scale, described.mm_per_pixel), []
    untouched = markers.fill(hard_untouched(described))
    for number in range(BALLS, BALLS + TESTED):
        press = hard_press(described, number)
        indentation, contact, _ = model.read(markers.fill(press.image)[None], untouched, described.row_scale)
        depth, true, both = MM * indentation[0].astype(float), press.contact, contact[0] & press.contact
        overlap, size = both.sum() / (contact[0] | true).sum(), np.sqrt(contact[0].sum() / true.sum())
        angle = np.degrees(angles(depth, MM * press.indentation, pitch))[true].mean()
        error = np.sqrt(np.square(depth - MM * press.indentation)[true].mean())
        rows.append([overlap, size, angle, error, ball_radius(depth, both, pitch)])
    overlap, size, angle, error, radius = np.median(rows, axis=0)
    return [f"{overlap:.2f}", f"{size:.2f}", f"{angle:.1f}", f"{error:.2f}", f"{radius:.2f}"]


def main() -> None:
    """Print the table, a row at a time."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.real_touch.hard", description=__doc__)
    parser.add_argument("names", nargs="*", help="of sets; by default all")
    parser.add_argument("--circles", action="store_true", help="give the contacts, which are found otherwise")
    parser.add_argument("--no-training", action="store_true", help="find circles alone")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    table = Table("Simulated photographs that are hard", COLUMNS)
    for described in HARD_SETS:
        if not arguments.names or described.name in arguments.names:
            began = time.perf_counter()
            with tempfile.TemporaryDirectory() as folder:
                cells = measure(described, Path(folder), circles=arguments.circles, train=not arguments.no_training)
            print(described.name, *cells, f"{time.perf_counter() - began:.0f} s", sep=" | ", flush=True)
            table.add(described.name, *cells, *[""] * (len(COLUMNS) - len(cells)))
    print(table.markdown("Medians of the photographs that were not fitted; the ball's radius is 2.35 mm."))


if __name__ == "__main__":
    main()
