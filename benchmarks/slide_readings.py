"""Read simulated slides as photographs of a gel with printed dots are read, and print errors beside those of answering nothing.

`python -m benchmarks.slide_readings DATA SENSOR [--split test] [--slides 6]`: DATA holds slides of a sensor with markers,
SENSOR is its file.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import rankdata

from benchmarks.timing import markdown
from pipeline.dataset.object_rows import ObjectRows, sensor_of
from pipeline.kernels.touch.shear_reading import DotReader, sliding
from pipeline.real_touch import TouchReader

ARRAYS = ("tactile_image", "shear", "pressure", "slip", "slip_share", "force", "torque", "marker_displacement", "friction")
INSIDE = "force z where the rim is not pressed, N"


def main() -> None:
    """Read all slides of a split, and print a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.slide_readings", description=__doc__)
    parser.add_argument("data")
    parser.add_argument("sensor", type=Path)
    parser.add_argument("--split", default="test")
    parser.add_argument("--slides", type=int, help="of each object, the first; by default all")
    options = parser.parse_args()
    rows = ObjectRows(options.data, [f"slide_{name}" for name in ARRAYS] + ["slide_untouched"], options.split)
    untouched, described = rows.read("slide_untouched", rows.object_ids[0]), sensor_of(rows.collections["slides"].first)
    reader = TouchReader(options.sensor, untouched, accept_photographs=True)
    slides = [
        read_slide({name: rows.read(f"slide_{name}", object_id, slide) for name in ARRAYS}, reader, untouched)
        for object_id in rows.object_ids
        for slide in range(options.slides or rows.size("slide_friction", "slide"))
    ]
    lost = np.concatenate([slide["lost"] for slide in slides])
    unseen = np.concatenate([slide["unseen"] for slide in slides]).mean()
    print(f"{len(slides)} slides of {described.name}; {lost.sum()} of {lost.size} dots lost; {unseen:.0%} of contacts do not show\n")
    table = []
    for name in ("dots, µm", "shear, µm", "shear in the contact, µm", "force x, N", "force y, N", "force z, N", INSIDE, "torque, mN·m"):
        error, truth = (np.concatenate([slide[name][k] for slide in slides]) for k in (0, 1))
        table.append([name, f"{rms(error):.3g}", f"{rms(truth):.3g}"])
    for name in ("pixels of the contact slip (area under the curve)", "more than half of the contact slips (the same)"):
        table.append([name, f"{area_under_curve(slides, name):.2f}", "0.5"])
    print("\n".join(markdown(["root mean square", "error", "of nothing"], table)))


def read_slide(true: dict[str, np.ndarray], reader: TouchReader, untouched: np.ndarray) -> dict[str, Any]:
    """Read the steps of a slide: errors and truths by name, per value."""
    reader.dots = DotReader(untouched, reader.sensor)
    readings = [reader.read(image) for image in true["tactile_image"]]
    slid = [reading.slid for reading in readings if reading.slid]
    contact = true["pressure"] > 0
    moved, shear = np.stack([dots.moved for dots in slid]), np.stack([dots.shear.displacement for dots in slid])
    grid = sensor_grid(reader, true["marker_displacement"].shape[1])
    truth = true["marker_displacement"][:, grid]
    force, torque = np.stack([dots.shear.force for dots in slid]), np.array([dots.shear.torque for dots in slid])
    friction, _ = sliding(-force[:, 2], np.array([dots.shear.friction for dots in slid]))
    traction, pressure = (np.stack([getattr(dots.shear, name) for dots in slid]) for name in ("traction", "pressure"))
    ratio = np.divide(np.hypot(*np.moveaxis(traction, -1, 0)), pressure, out=np.zeros(pressure.shape), where=pressure > 0) / friction
    needed = np.array([dots.shear.friction for dots in slid]) / friction
    known = np.isfinite(needed) & contact.any(axis=(1, 2))
    seen, sure = np.isfinite(moved), contact & (pressure > 0) & known[:, None, None]
    slips, inside = np.array(true["slip"].any(axis=-1)), known & ~np.array([reading.rim_pressed for reading in readings])
    return {
        "lost": ~seen[..., 0],
        "unseen": ~known[contact.any(axis=(1, 2))],
        "dots, µm": (1e6 * (moved - truth)[seen], 1e6 * truth[seen]),
        "shear, µm": (1e6 * (shear - true["shear"]).ravel(), 1e6 * true["shear"].ravel()),
        "shear in the contact, µm": (1e6 * (shear - true["shear"])[contact].ravel(), 1e6 * true["shear"][contact].ravel()),
        **{f"force {axis}, N": (force[:, k] - true["force"][:, k], true["force"][:, k]) for k, axis in enumerate("xyz")},
        INSIDE: (force[inside, 2] - true["force"][inside, 2], true["force"][inside, 2]),
        "torque, mN·m": (1e3 * (torque - true["torque"]), 1e3 * true["torque"]),
        "pixels of the contact slip (area under the curve)": (ratio[sure], slips[sure]),
        "more than half of the contact slips (the same)": (needed[known], true["slip_share"][known] > 0.5),
    }


def sensor_grid(reader: TouchReader, count: int) -> np.ndarray:
    """Find the number, in the sensor's grid, of each dot that the reader follows."""
    markers, sensor = reader.described.markers, reader.sensor
    assert markers
    positions = markers.positions(sensor.width, sensor.height)
    assert reader.dots
    assert len(positions) == count
    return np.linalg.norm(reader.dots.positions[:, None] - positions, axis=2).argmin(axis=1)


def rms(values: np.ndarray) -> float:
    """Compute the root mean square."""
    return float(np.sqrt(np.mean(np.square(values.astype(np.float64)))))


def area_under_curve(group: list[dict[str, Any]], name: str) -> float:
    """Compute the probability that a true case is given a greater value than a false one."""
    score, label = (np.concatenate([slide[name][k] for slide in group]) for k in (0, 1))
    ranks, true = rankdata(score)[label].sum(), label.sum()
    return float((ranks - true * (true + 1) / 2) / (true * (len(label) - true)))


if __name__ == "__main__":
    main()
