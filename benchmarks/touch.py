"""Measure depth and tactile image of one sensor beside TACTO and Taxim."""

import json
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import igl
import numpy as np
from numpy.typing import NDArray

from benchmarks.cases import Case, over_cases, touched_objects
from benchmarks.peers.taxim_shim import load_taxim
from benchmarks.provenance import ROOT
from benchmarks.timing import Round, Table, Times, quantiles, side_by_side
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.depth_maps import quantise_depth
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth
from pipeline.kernels.touch.sensor import Sensor, pixel_centres, sensor_to_world
from pipeline.kernels.touch.tactile_image import tactile_image
from stages.simulate_touch import TouchSettings

TACTO = ROOT / ".venv-peers-tacto" / "bin" / "python"
LARGE = "480 × 640"
"""Rows and columns of the images that Taxim was calibrated on."""
OURS, OURS_LARGE = "vt-pipeline, 100 × 100", f"vt-pipeline, {LARGE}"
SIZES = {"TACTO 0.0.3, 100 × 100": (100, 100), "TACTO 0.0.3, 160 × 120 (its default)": (120, 160), f"TACTO 0.0.3, {LARGE}": (640, 480)}
"""Width and height of TACTO's images."""
Depth = Callable[[int, NDArray[np.float64]], NDArray[np.float32]]


def measure(data: Path, turns: int) -> Table:
    """Measure all sensors of the dataset's cases, `turns` rounds of each method."""
    cases, small = touched_objects(data), load_sensor("gel_16mm")
    faces = [len(case.mesh.faces) for case in cases]
    table = Table(
        "Touch: depth and tactile image of one sensor",
        ["ms, least / median", "frames/s", "÷ ours of that size", "depth's points off the mesh, µm: median / 99 % / most"],
        [
            f"{sum(len(case.poses) for case in cases)} sensors that touch, of {', '.join(case.name for case in cases)} "
            f"({min(faces)} to {max(faces)} faces). Processor milliseconds of one core, rounds in turns, TACTO's after the others; "
            "frames/s and ratios from the least. Times leave out what is done once per object: sorting its faces here, uploading "
            "them in TACTO.",
            "Ours is what `simulate-touch` stores: exact orthographic depth, rounded as stored, and the tactile image made from it, with "
            "the supplement's lamps or with the colours of the shipped GelSight.",
            "Not comparable with TACTO: it rasterises a DIGIT (perspective camera of 60°, curved gel of 20 × 30 mm, its own lamps and "
            "noise) by pyrender, placed so that the middle of its gel is ours. Its points come from its depth with its camera taken into "
            "account, where the object stands in its gel.",
            "TACTO runs with other versions than it pins (`tacto_worker.py`). PyBullet is not asked for poses and forces.",
            "Not comparable with Taxim: it makes no depth. Its time is that of our depth and its shading, which blurs the gel softly "
            "around the contact and looks colours up in a table calibrated on a GelSight, with stand-ins of torch (`taxim_shim.py`).",
        ],
    )
    large = small.model_copy(update={"rows": 480, "cols": 640})
    gelsight = load_sensor("gelsight")
    assert gelsight.calibrated is not None
    with_membrane = {"lights": None, "calibrated": gelsight.calibrated, "membrane": 9e-4}
    colours_only = with_membrane | {"calibrated": gelsight.calibrated.model_copy(update={"shadows": ()}), "membrane": 0.0}
    rounds: dict[str, Round] = {}
    for name, sensor in ((OURS, small), (OURS_LARGE, large)):
        colours = name.replace("vt-pipeline", "vt-pipeline, a GelSight's colours")
        for label, changes in ((name, {}), (colours, colours_only), (f"{colours}, membrane and shadows", with_membrane)):
            rounds[label] = our_round(cases, sensor.model_copy(update=changes))
    taxim_names = [f"Taxim on our depth, {size}{shadows}" for size in ("100 × 100", LARGE) for shadows in ("", ", shadows")]
    with table.peer(*taxim_names):
        taxim = load_taxim()
        variants = [(sensor, shadow) for sensor in (small, large) for shadow in (False, True)]
        rounds |= {name: _taxim_round(taxim, cases, *variant) for name, variant in zip(taxim_names, variants, strict=True)}
    times = side_by_side(rounds, turns)
    errors = {
        OURS: np.concatenate(
            [mesh_distances(case, our_points(case, number, our_depth(cases, small), small)) for number, case in enumerate(cases)]
        )
    }
    with table.peer(*SIZES):
        for name, (measured, distances) in tacto(cases, small, turns).items():
            times[name], errors[name] = measured, distances
    for name in sorted(times, key=lambda name: LARGE in name):
        ratio = times[name].over(times[OURS_LARGE if LARGE in name else OURS])
        table.add(name, times[name], f"{1e3 / times[name].least:.0f}", ratio, quantiles(errors[name]) if name in errors else "–")
    return table


def our_depth(cases: Sequence[Case], sensor: Sensor) -> Depth:
    """Make a function of a case's number and a pose: depth as the stage stores it."""
    bits = {name: getattr(TouchSettings(), name) for name in ("gel_bits", "far_bits")}
    faces = [box_faces(case.mesh.triangles) for case in cases]
    return lambda number, pose: quantise_depth(ray_depth(faces[number], pose, sensor), sensor, **bits)


def our_points(case: Case, number: int, depth: Depth, sensor: Sensor) -> NDArray[np.float64]:
    """Compute (N, 3) world points in the gel, m, of all sensors of a case, in float64: only the depth's error counts."""
    x, y = np.meshgrid(*pixel_centres(sensor))
    points = []
    for pose in case.poses:
        z = depth(number, pose)
        met = z < sensor.w
        points.append(sensor_to_world(pose, x[met], y[met], z[met].astype(np.float64)))
    return np.concatenate(points)


def our_round(cases: Sequence[Case], sensor: Sensor) -> Round:
    depth = our_depth(cases, sensor)
    return over_cases(cases, lambda number, pose: tactile_image(depth(number, pose), sensor))


def _taxim_round(taxim: Any, cases: Sequence[Case], sensor: Sensor, shadow: bool) -> Round:
    depth = our_depth(cases, sensor)

    def render(number: int, pose: NDArray[np.float64]) -> object:
        height = np.minimum(depth(number, pose), sensor.range) - sensor.w  # above the gel's face
        return taxim.render((1e3 * height).astype(np.float32), with_shadow=shadow)

    return over_cases(cases, render)


def tacto(cases: Sequence[Case], sensor: Sensor, turns: int) -> dict[str, tuple[Times, NDArray[np.float64]]]:
    """Run TACTO in its own environment: for each size its times, and distances of its points from the mesh, µm."""
    return dict(zip(SIZES, elsewhere(TACTO, "tacto_worker", cases, turns, list(SIZES.values()), w=sensor.w), strict=True))


def elsewhere(
    python: Path, worker: str, cases: Sequence[Case], turns: int, sizes: Sequence[tuple[int, int]], **facts: float
) -> list[tuple[Times, NDArray[np.float64]]]:
    """Run a peer's worker in its own environment: for each size its times, and distances of its points from the mesh, µm."""
    if not python.exists():
        raise RuntimeError(f"{python} is missing; `make bench-peers` installs it")
    with tempfile.TemporaryDirectory() as folder:
        for number, case in enumerate(cases):
            arrays: dict[str, Any] = {"vertices": case.mesh.vertices, "faces": case.mesh.faces, "poses": case.poses, **facts}
            np.savez(Path(folder) / f"{number}.npz", **arrays)
        command = [str(python), "-m", f"benchmarks.peers.{worker}", folder, str(turns), json.dumps(sizes)]
        process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        if process.returncode:
            raise RuntimeError(f"{worker} ended with status {process.returncode}: {(process.stderr.strip().splitlines() or [''])[-1]}")
        measured = []
        for width, height in sizes:
            points = [np.load(Path(folder) / f"{number}-{width}-{height}.npy") for number in range(len(cases))]
            distances = np.concatenate([mesh_distances(case, cloud) for case, cloud in zip(cases, points, strict=True)])
            ms = np.load(Path(folder) / f"ms-{width}-{height}.npy").tolist()
            measured.append((Times(min(ms), median(ms)), distances))
        return measured


def mesh_distances(case: Case, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute distances from the mesh, µm."""
    squared = igl.point_mesh_squared_distance(points, case.mesh.vertices, case.mesh.faces.astype(np.int64))[0]
    return np.asarray(1e6 * np.sqrt(squared))
