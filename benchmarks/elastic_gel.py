"""Measure a GelSight Mini with its elastic gel, exact depth included, beside tactile-mnist's."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.cases import Case, touched_objects
from benchmarks.provenance import ROOT
from benchmarks.timing import Table, quantiles, side_by_side
from benchmarks.touch import elsewhere, mesh_distances, our_depth, our_points, our_round
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.sensor import Sensor

TACTILE_MNIST = ROOT / ".venv-peers-tactile-mnist" / "bin" / "python"
SIZES = (64, 64), (320, 240)
"""Columns and rows of the images: what tactile-mnist's environments ask for, and the sensor's own."""
INDENTATION = 0.001
"""m, of every object at its deepest point."""


def measure(data: Path, turns: int) -> Table:
    """Measure all sensors of the dataset's cases, moved until they are pressed by `INDENTATION`, `turns` rounds of each size."""
    mini = load_sensor("gelsight_mini")
    sensors = {f"{cols} × {rows}": mini.model_copy(update={"cols": cols, "rows": rows}) for cols, rows in SIZES}
    cases = [pressed(case, load_sensor("gel_16mm").w, mini) for case in touched_objects(data)]
    table = Table(
        "Touch: an elastic gel",
        ["ms, least / median", "frames/s", "÷ ours of that size", "depth's points off the mesh, µm: median / 99 % / most"],
        [
            f"{sum(len(case.poses) for case in cases)} sensors, of {', '.join(case.name for case in cases)}, pressed by "
            f"{1e3 * INDENTATION:g} mm. Processor milliseconds of one core for depth and tactile image; frames/s and ratios from "
            "the least.",
            "Ours is what `simulate-touch` stores for the shipped GelSight Mini: exact depth, surface and pressure of an elastic layer "
            "in contact, and the colours of its calibration with shadows.",
            "tactile-mnist renders depth by pyrender for all objects at once, each a world of its renderer, and colours by Taxim's "
            "GelSight Mini on torch, which blurs the depth and knows no pressure. Its platform lies 1 m below. It runs after ours.",
            "Its 64 × 64 pixels show the middle 14.2 mm of the gel's 18.9 (`findings/tactile-mnist-square-images-cut-the-gel.sh`); points "
            "take that into account.",
        ],
    )
    times = side_by_side({size: our_round(cases, sensor) for size, sensor in sensors.items()}, turns)
    peers = {f"tactile-mnist 0.13, {size}": size for size in sensors}
    for size, sensor in sensors.items():
        points = [our_points(case, number, our_depth(cases, sensor), sensor) for number, case in enumerate(cases)]
        distances = np.concatenate([mesh_distances(case, cloud) for case, cloud in zip(cases, points, strict=True)])
        table.add(f"vt-pipeline, {size}", times[size], f"{1e3 / times[size].least:.0f}", "1.00", quantiles(distances))
    with table.peer(*peers):
        faces = [replace(case, poses=np.stack([raised(pose, mini.w) for pose in case.poses])) for case in cases]
        measured = elsewhere(TACTILE_MNIST, "tactile_mnist_worker", faces, turns, SIZES)
        for (name, size), (peer, distances) in zip(peers.items(), measured, strict=True):
            table.add(name, peer, f"{1e3 / peer.least:.0f}", peer.over(times[size]), quantiles(distances))
    return table


def pressed(case: Case, w: float, sensor: Sensor) -> Case:
    """Move the sensors of a case, whose gel's face lay at `w`, along their normals until `sensor` is pressed by `INDENTATION`."""
    moved = replace(case, poses=np.stack([raised(pose, w - sensor.w) for pose in case.poses]))
    depth = our_depth([moved], sensor)
    return replace(case, poses=np.stack([raised(pose, depth(0, pose).min() - sensor.w + INDENTATION) for pose in moved.poses]))


def raised(pose: Sequence[Sequence[float]], height: float) -> np.ndarray:
    """Move a pose (4, 4) along its z axis by `height`, m."""
    matrix = np.array(pose)
    matrix[:3, 3] += height * matrix[:3, 2]
    return matrix
