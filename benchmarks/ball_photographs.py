"""Read photographs of balls of known size in the gels of real sensors, to fit sensors to and to compare them with.

`python -m benchmarks.ball_photographs FOLDER` writes the ones that the GelSight is fitted to, as `calibrate-sensor` reads them.
"""

import csv
import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.optimize import minimize_scalar

from pipeline.contrib.calibration.ball_contact import Circle, Photograph, ball_impression, distance_from
from pipeline.contrib.calibration.ball_photographs import CIRCLES, read_photographs
from pipeline.errors import InvalidInput
from pipeline.kernels.touch.calibrated_shading import indentation_change
from pipeline.kernels.touch.depth_maps import gel_under
from pipeline.kernels.touch.sensor import Sensor

GELSLAM = Path("gelslam/src/gelslam/resources/example_calibration")
"""Folder of the photographs below REAL, in a clone of github.com/rpl-cmu/gelslam."""
MINI_MM_PER_PIXEL = 0.0634
LARGEST = 4.0
"""Largest radius tried, as a multiple of the true one."""


@dataclass(frozen=True, eq=False)
class BallSet:
    """Hold photographs of balls of one radius (m), the untouched one, and how many photographs there are."""

    photographs: list[Photograph]
    untouched: NDArray[np.uint8]
    radius: float
    count: int


def gelsight_balls() -> BallSet:
    """Read the 48 photographs of a GelSight in Taxim's package, RGB, with their contacts as annotated there."""
    spec = importlib.util.find_spec("taxim")
    if spec is None or spec.origin is None:
        raise SystemExit("the package taxim is not installed: run `make test-sensors`, which installs it into an environment of its own")
    data = np.load(Path(spec.origin).parent / "calib" / "gelsight" / "dataPack.npz")
    images, untouched = (np.ascontiguousarray(data[name][..., ::-1]) for name in ("imgs", "f0"))  # BGR
    annotations = zip(data["touch_center"].astype(float), data["touch_radius"].astype(float), strict=True)
    contacts = [Circle(float(x), float(y), float(radius)) for (x, y), radius in annotations]
    pairs = enumerate(zip(images, contacts, strict=True))
    return BallSet([Photograph(f"{number:02d}.png", image, contact) for number, (image, contact) in pairs], untouched, 0.002, len(images))


def mini_balls(real: Path, diameter: str) -> BallSet:
    """Read photographs of balls in a GelSight Mini, with detected contacts; `diameter` is in mm, as in the folder's name."""
    folder, untouched_path = real / GELSLAM / f"{diameter}mm", real / GELSLAM / "background.png"
    try:
        photographs, untouched, left_out = read_photographs(folder, untouched_path, float(diameter) / 2 / MINI_MM_PER_PIXEL)
    except InvalidInput as error:
        raise SystemExit(f"{error}: clone https://github.com/rpl-cmu/gelslam into {real}") from error
    return BallSet(photographs, untouched, float(diameter) / 2e3, len(photographs) + len(left_out))


def recovered_radius(
    sensor: Sensor,  # calibrated
    photograph: Photograph,
    untouched: NDArray[np.uint8],
    radius: float,  # the true one, m; the search ends at `LARGEST` times this
) -> float:  # m
    """Find the ball radius with which a sensor's colours explain the contact of a photograph best."""
    assert sensor.calibrated is not None
    reach = photograph.contact.radius * sensor.pitch[1]
    contact = distance_from(sensor, photograph.contact) < reach
    change = photograph.image[contact].astype(float) - untouched[contact]

    def error(log_radius: float) -> float:
        assert sensor.calibrated is not None
        gel = gel_under(ball_impression(sensor, photograph.contact, float(np.exp(log_radius))), sensor)
        return float(np.abs(indentation_change(gel.indentation, sensor, sensor.calibrated)[contact] - change).mean())

    result = minimize_scalar(error, bounds=(np.log(1.02 * reach), np.log(LARGEST * radius)), method="bounded", options={"xatol": 0.01})
    return float(np.exp(result.x))


def write_gelsight_balls(folder: Path) -> None:
    """Write the even ones of the GelSight's photographs, the untouched one and the contacts."""
    balls = gelsight_balls()
    folder.mkdir(parents=True, exist_ok=True)
    Image.fromarray(balls.untouched).save(folder / "untouched.png")
    with (folder / CIRCLES).open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["name", "x", "y", "radius"])
        for photograph in balls.photographs[::2]:
            Image.fromarray(photograph.image).save(folder / photograph.name)
            rows.writerow([photograph.name, photograph.contact.x, photograph.contact.y, photograph.contact.radius])


if __name__ == "__main__":
    write_gelsight_balls(Path(sys.argv[1]))
