"""Shipped sensors beside real photographs, and beside Taxim: `make test-sensors`.

`python -m benchmarks.real_sensors --write docs/sensors.md` tests on odd photographs what was fitted on even ones;
`--extract FOLDER` writes the photographs of Taxim's package (MIT) as folders for `vt-pipeline calibrate-sensor`.
"""

from __future__ import annotations

import argparse
import csv
import importlib.util
from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.kernels.touch.calibration_fit import Circle, Photograph

SETS = ("gelsight", "gelsight_mini")


def photographs(name: str) -> tuple[list[Photograph], np.ndarray]:
    """Read a set of Taxim's package: its photographs with their contacts, and the untouched one, RGB."""
    found = importlib.util.find_spec("taxim")
    if found is None or found.origin is None:
        raise SystemExit("the package taxim is not installed: run `make test-sensors`, which installs it into an environment of its own")
    data = np.load(Path(found.origin).parent / "calib" / name / "dataPack.npz")
    places = zip(data["touch_center"].astype(float), data["touch_radius"].astype(float), strict=True)
    contacts = [Circle(float(x), float(y), float(radius)) for (x, y), radius in places]
    images = zip(data["imgs"][..., ::-1], contacts, strict=True)  # BGR
    return [Photograph(f"{number:02d}.png", image, contact) for number, (image, contact) in enumerate(images)], data["f0"][..., ::-1]


def extract(folder: Path) -> None:
    """Write each set as a folder of PNG files with `circles.csv`, and NAME-untouched.png beside it."""
    for name in SETS:
        some, untouched = photographs(name)
        (folder / name).mkdir(parents=True, exist_ok=True)
        Image.fromarray(np.ascontiguousarray(untouched)).save(folder / f"{name}-untouched.png")
        with (folder / name / "circles.csv").open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["name", "x", "y", "radius"])
            for one in some:
                Image.fromarray(np.ascontiguousarray(one.image)).save(folder / name / one.name)
                rows.writerow([one.name, one.contact.x, one.contact.y, one.contact.radius])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--extract", type=Path)
    arguments = parser.parse_args()
    extract(arguments.extract)
