"""One sensor, depth and reading: beside TACTO and Taxim."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import igl
import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.cases import Case
from benchmarks.peers.table import Table
from benchmarks.peers.taxim_shim import load_taxim
from benchmarks.peers.worker import PeerError, Worker
from benchmarks.provenance import ROOT
from benchmarks.timing import Round, Times, each, side_by_side, three_digits
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.touch.depth_quantisation import quantise_depth
from pipeline.kernels.touch.face_culling import box_faces
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import Sensor, pixel_centres, sensor_to_world
from pipeline.kernels.touch.tactile_image import tactile_image
from stages.simulate_touch.settings import TouchSettings

TACTO = ROOT / ".venv-peers-tacto" / "bin" / "python"
TAXIM_SHAPE = (480, 640)
"""Rows and columns of the images that Taxim was calibrated on."""
OURS = "vt-pipeline, 100 × 100"
LARGE = f"{TAXIM_SHAPE[0]} × {TAXIM_SHAPE[1]}"
SIZES = {"TACTO 0.0.3, 100 × 100": (100, 100), "TACTO 0.0.3, 160 × 120 (its default)": (120, 160), f"TACTO 0.0.3, {LARGE}": (640, 480)}
"""Width and height of the images that TACTO is asked for."""
OURS_LARGE = f"vt-pipeline, {LARGE}"
MM = 1e3
UM = 1e6
Depth = Callable[[int, NDArray[np.float64]], NDArray[np.float32]]


def measure(cases: Sequence[Case], turns: int) -> Table:
    """The table; `turns` rounds of all sensors of all cases."""
    sensor = load_sensor("gel_16mm")
    table = Table(
        "Touch: depth and reading of one sensor",
        ["ms, least / median", "frames/s", "÷ ours of that size", "depth's points off the mesh, µm: median / 99 % / most"],
        [
            f"{sum(len(case.poses) for case in cases)} sensors that touch, of {', '.join(case.name for case in cases)} "
            f"({min(len(case.mesh.faces) for case in cases)} to {max(len(case.mesh.faces) for case in cases)} faces). Processor "
            "milliseconds of one core, rounds in turns; frames/s and ratios from the least. What is done once an object is in no time: "
            "sorting its faces here, uploading them in TACTO.",
            "Ours is what `simulate-touch` stores: exact orthographic depth, rounded as stored, and the reading made from it: by the "
            "supplement's lamps, or with the colours of the shipped GelSight.",
            "Not comparable with TACTO: it rasterises a DIGIT (perspective camera of 60°, curved gel of 20 × 30 mm, its own lamps and "
            "noise) by pyrender, here placed so that its gel's middle is ours. Its points come from its depth with its camera taken into "
            "account, where the object stands in its gel.",
            "TACTO does not import as published on Python 3.11 (urdfpy pins networkx 2.2). Run with current networkx, PyOpenGL and numpy, "
            "and `np.float`, `np.infty` put back by `tacto_shim.py`; no file of it is changed. PyBullet is not asked for poses and forces.",
            "Not comparable with Taxim: it makes no depth. It is given ours, and its time is our depth and its shading, which blurs the "
            "gel softly around the contact and looks colours up in a table calibrated on a GelSight. `torchvision.resize`, used once, and "
            "`torch_scatter.scatter_min`, used for shadows, are replaced by torch's own (`taxim_shim.py`).",
        ],
    )
    ours = our_depth(cases, sensor)
    rounds: dict[str, Round] = {OURS: over_cases(cases, lambda number, pose: tactile_image(ours(number, pose), sensor))}
    errors = {OURS: np.concatenate([_off(case, our_points(case, number, ours, sensor)) for number, case in enumerate(cases)])}
    add_taxim(table, rounds, cases, sensor)
    with tempfile.TemporaryDirectory() as folder:
        try:
            with Worker(TACTO, "benchmarks.peers.tacto_worker", _saved(cases, sensor, Path(folder)), Path(folder) / "log") as tacto:
                for name, size in SIZES.items():
                    rounds[name] = _asking(tacto, size, len(cases))
                    errors[name] = np.concatenate([_off(case, _tacto_points(tacto, size, i, folder)) for i, case in enumerate(cases)])
                times = side_by_side(rounds, turns)
        except PeerError as error:
            times = side_by_side({name: once for name, once in rounds.items() if name not in SIZES}, turns)
            for name in SIZES:
                table.could_not_run(name, error)
    for name in sorted(times, key=lambda name: LARGE in name):
        ours_alike = times[OURS_LARGE if LARGE in name else OURS]
        table.add(name, *_cells(times[name], ours_alike, errors.get(name)))
    return table


def our_depth(cases: Sequence[Case], sensor: Sensor) -> Depth:
    """Depth as the stage stores it, of a case's number and a pose."""
    settings = TouchSettings()
    faces = [box_faces(case.mesh.triangles) for case in cases]
    return lambda number, pose: quantise_depth(
        ray_depth(faces[number], pose, sensor), sensor, gel_bits=settings.gel_bits, far_bits=settings.far_bits
    )


def over_cases(cases: Sequence[Case], call: Callable[[int, NDArray[np.float64]], object]) -> Round:
    """A round over all sensors of all cases."""
    return each(lambda item: call(*item), [(number, pose) for number, case in enumerate(cases) for pose in case.poses])


def our_points(case: Case, number: int, depth: Depth, sensor: Sensor) -> NDArray[np.float64]:
    """(N, 3) world points in the gel, m, of all sensors of a case: placed in float64, so that only the depth's error counts."""
    x, y = np.meshgrid(*pixel_centres(sensor))
    points = []
    for pose in case.poses:
        found = depth(number, pose)
        met = found < sensor.w
        points.append(sensor_to_world(pose, x[met], y[met], found[met].astype(np.float64)))
    return np.concatenate(points)


def add_taxim(table: Table, rounds: dict[str, Round], cases: Sequence[Case], sensor: Sensor) -> None:
    """Taxim's rounds at our size and at its own, with and without shadows; or the rows that say why not."""
    rows, cols = TAXIM_SHAPE
    large = sensor.model_copy(update={"rows": rows, "cols": cols})
    large_depth = our_depth(cases, large)
    rounds[OURS_LARGE] = over_cases(cases, lambda number, pose: tactile_image(large_depth(number, pose), large))
    add_calibrated(rounds, cases, [sensor, large])
    ways = [(sensor, False), (sensor, True), (large, False), (large, True)]
    try:
        taxim = load_taxim()
    except ImportError as error:
        table.could_not_run("Taxim on our depth", f"{error}; `make bench-peers` installs it")
        return
    for size, shadow in ways:
        name = f"Taxim on our depth, {size.rows} × {size.cols}{', shadows' if shadow else ''}"
        rounds[name] = over_cases(cases, _taxim_call(taxim, our_depth(cases, size), size, shadow))


def add_calibrated(rounds: dict[str, Round], cases: Sequence[Case], sizes: Sequence[Sensor]) -> None:
    """Our rounds with the colours of the shipped GelSight, as Taxim has them, without and with membrane and shadows."""
    gelsight = load_sensor("gelsight")
    assert gelsight.calibrated is not None
    plain = gelsight.calibrated.model_copy(update={"shadows": ()})
    for size in sizes:
        both = size.model_copy(update={"lights": None, "calibrated": gelsight.calibrated, "membrane": gelsight.membrane})
        neither = both.model_copy(update={"calibrated": plain, "membrane": 0.0})
        for worn, what in ((neither, ""), (both, ", membrane and shadows")):
            depth = our_depth(cases, worn)
            name = f"vt-pipeline, a GelSight's colours, {size.rows} × {size.cols}{what}"
            rounds[name] = over_cases(cases, lambda number, pose, d=depth, s=worn: tactile_image(d(number, pose), s))


def _taxim_call(taxim: Any, depth: Depth, sensor: Sensor, shadow: bool) -> Callable[[int, NDArray[np.float64]], object]:
    def call(number: int, pose: NDArray[np.float64]) -> object:
        height = np.minimum(depth(number, pose), sensor.range) - sensor.w  # above the gel's face, as Taxim has it
        return taxim.render((height * MM).astype(np.float32), with_shadow=shadow)

    return call


def _saved(cases: Sequence[Case], sensor: Sensor, folder: Path) -> list[str]:
    paths = [folder / f"{number}.npz" for number in range(len(cases))]
    for case, path in zip(cases, paths, strict=True):
        case.save(path, sensor.w)
    return [str(path) for path in paths]


def _asking(tacto: Worker, size: tuple[int, int], count: int) -> Round:
    return lambda: float(np.mean([tacto.ask(size=size, case=number)["ms"] for number in range(count)]))


def _tacto_points(tacto: Worker, size: tuple[int, int], number: int, folder: str) -> NDArray[np.float64]:
    path = Path(folder) / "points.npy"
    tacto.ask(size=size, case=number, points=str(path))
    points: NDArray[np.float64] = np.load(path)
    return points


def _off(case: Case, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances from the mesh, µm."""
    squared = igl.point_mesh_squared_distance(points, case.mesh.vertices, case.mesh.faces.astype(np.int64))[0]
    return np.asarray(UM * np.sqrt(squared))


def _cells(time: Times, ours: Times, errors: NDArray[np.float64] | None) -> tuple[str, ...]:
    error = "–" if errors is None else " / ".join(three_digits(float(np.quantile(errors, q))) for q in (0.5, 0.99, 1))
    return str(time), f"{1e3 / time.least:.0f}", f"{time.least / ours.least:.2f}", error
