"""Exact orthographic depth: beside raw Embree on the same rays, and beside what rasterisers give of the same sensors."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.embree import EmbreeDepth
from benchmarks.peers.cases import POSES, Case
from benchmarks.peers.rasterisers import ParallelRasteriser, PerspectiveRasteriser
from benchmarks.peers.table import Table
from benchmarks.peers.touch import over_cases
from benchmarks.timing import side_by_side, three_digits
from benchmarks.touch import press, wavy_ball
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.touch.face_culling import box_faces
from pipeline.kernels.touch.ray_depth import ray_depth
from pipeline.kernels.touch.sensor import Sensor, ray_origins
from pipeline.kernels.touch.tactile_image import tactile_image
from stages.render_vision.opengl_context import NoOpenGL, OpenGLContext

EYES = {"pyrender, perspective of 40°": 0.0225, "pyrender, eye 1 m away": 1.0}
"""m from the eye to the gel's face: 40° over the sensor's width is what the paper's authors' own simulator has; 1 m is nearly parallel."""
SUBDIVISIONS = 6
"""Of the large mesh: 81,920 faces."""
STRIDE = 5
"""One row and column in this many is checked by brute force, which takes a thousand times as long as what it checks."""
OURS = "exact, float64 (ours)"
UM = 1e6
DepthOf = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def measure(cases: Sequence[Case], turns: int) -> Table:
    """Make the table, of the dataset's objects and of one large mesh; `turns` rounds of all sensors each."""
    sensor = load_sensor("gel_16mm")
    table = Table(
        "Depth: exact, traced, rasterised",
        [
            "depth, ms",
            "depth and reading, ms",
            "÷ ours",
            f"{20 * 4**SUBDIVISIONS} faces, ms",
            "÷ ours",
            "off, µm: median / 99 % / most",
            "pixels in the gel in one only, ‰",
            "reading off, levels: mean / most",
        ],
        [
            f"The {sum(len(case.poses) for case in cases)} sensors of the table above, {sensor.rows} × {sensor.cols} rays, and {POSES} on "
            "a wavy ball of the size of an object. Processor milliseconds of one core (Mesa's threads counted), least / median; ratios of "
            "the least, depth and reading together on the objects, depth alone on the ball.",
            "Off: against our float64 depth, where both are in the gel; ours against a float64 brute force that shares no code with it, of "
            f"every {STRIDE}th row and column. Readings are made by the same shading of either depth.",
            "Not comparable: a perspective camera looks along other rays, so its pixel shows another place of the surface, and where the "
            "surface is steep another depth; unprojecting gives points on the mesh, but no orthographic map. pyrender's pass is "
            "multisampled: a depth is taken up to half a pixel from the pixel's centre. It draws no face that is seen from behind.",
            "Bare OpenGL is one draw call of ours with parallel rays into a float32 buffer: a raw limit, no package. Without a graphics "
            "card Mesa rasterises in software; with one these rows are another comparison. It needs a driver, holds one context a "
            "process, and draws every face, seen or not.",
            "Embree gives the first hit in float32, without what makes a depth map of it.",
        ],
    )
    ball = wavy_ball(SUBDIVISIONS)
    rng = np.random.default_rng(0)
    vertices, faces = np.unique(ball.reshape(-1, 3), axis=0, return_inverse=True)
    large = Case("ball", Mesh.bare(vertices, faces.reshape(-1, 3)), np.stack([press(ball, rng) for _ in range(POSES)]))
    ways = methods(table, [*cases, large], sensor)
    depth = side_by_side({name: over_cases(cases, lambda i, pose, of=of: of[i](pose)) for name, of in ways.items()}, turns)
    whole = side_by_side(
        {name: over_cases(cases, lambda i, pose, of=of: tactile_image(of[i](pose), sensor)) for name, of in ways.items()}, turns
    )
    on_ball = side_by_side({name: over_cases([large], lambda _, pose, of=of: of[-1](pose)) for name, of in ways.items()}, turns)
    for name, of in ways.items():
        error = _brute_errors(cases, of, sensor) if name == OURS else _errors(cases, of, ways[OURS], sensor)
        ratios = [f"{times[name].least / times[OURS].least:.2f}" for times in (whole, on_ball)]
        table.add(name, str(depth[name]), str(whole[name]), ratios[0], str(on_ball[name]), ratios[1], *error)
    return table


def methods(table: Table, cases: Sequence[Case], sensor: Sensor) -> dict[str, list[DepthOf]]:
    """Every way to a depth map, a function of the pose for each case."""
    faces = [box_faces(case.mesh.triangles) for case in cases]
    ways: dict[str, list[DepthOf]] = {
        OURS: [lambda pose, b=b: ray_depth(b, pose, sensor) for b in faces],
        "Embree, float32": [EmbreeDepth(case.mesh.triangles, sensor).depth for case in cases],
    }
    try:
        context = OpenGLContext(sensor.cols)
        for name, eye in EYES.items():
            ways[name] = [PerspectiveRasteriser(context, case.mesh, sensor, eye).depth for case in cases]
        ways["bare OpenGL, parallel"] = [ParallelRasteriser(context, case.mesh, sensor).depth for case in cases]
    except NoOpenGL as error:
        for name in (*EYES, "bare OpenGL, parallel"):
            table.could_not_run(name, error)
    return ways


def _errors(cases: Sequence[Case], of: list[DepthOf], true_of: list[DepthOf], sensor: Sensor) -> tuple[str, str, str]:
    pairs = [(of[i](pose), true_of[i](pose)) for i, case in enumerate(cases) for pose in case.poses]
    levels = np.concatenate([np.abs(tactile_image(a, sensor).astype(int) - tactile_image(b, sensor)).ravel() for a, b in pairs])
    return (*_off(pairs, sensor), f"{levels.mean():.3f} / {levels.max()}")


def _brute_errors(cases: Sequence[Case], of: list[DepthOf], sensor: Sensor) -> tuple[str, str, str]:
    """Against brute force; rays of which float64 cannot tell whether they meet a rim are left out."""
    every = slice(None, None, STRIDE)
    pairs = []
    for i, case in enumerate(cases):
        for pose in case.poses:
            true, doubtful = brute_force_depth(case.mesh.triangles, ray_origins(pose, sensor)[every, every], pose[:3, 2], sensor.range)
            pairs.append((np.where(doubtful, np.inf, of[i](pose)[every, every]), np.where(doubtful, np.inf, true)))
    return (*_off(pairs, sensor), "–")


def brute_force_depth(
    triangles: NDArray[np.float64], origins: NDArray[np.float64], direction: NDArray[np.float64], reach: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Intersect every ray with every face (F, 3, 3) in float64 (Möller & Trumbore 1997); shares no code with the tracers.

    Returns
    -------
    depth, doubtful
        Of the shape of `origins` without its last axis: distance along `direction`, m, +inf where no face is met within `reach`;
        and whether the ray passes a face's rim within 1e-9 of its size, so that float64 cannot tell whether it meets it.
    """
    edge1, edge2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(direction, edge2)
    det = (edge1 * p).sum(-1)
    kept = np.abs(det) > 1e-15 * np.linalg.norm(np.cross(edge1, edge2), axis=-1)
    first, edge1, edge2, p, det = (array[kept] for array in (triangles[:, 0], edge1, edge2, p, det))
    depth, doubtful = np.full(origins.shape[:-1], np.inf), np.zeros(origins.shape[:-1], bool)
    for index in np.ndindex(depth.shape):
        s = origins[index] - first
        q = np.cross(s, edge1)
        u, v, t = (s * p).sum(-1) / det, q @ direction / det, (q * edge2).sum(-1) / det
        margin, ahead = np.minimum(np.minimum(u, v), 1 - u - v), (t >= -1e-9) & (t <= reach)
        depth[index] = np.where((margin >= 0) & ahead, np.maximum(t, 0), np.inf).min(initial=np.inf)
        doubtful[index] = (ahead & (np.abs(margin) < 1e-9)).any()
    return depth, doubtful


def _off(pairs: list[tuple[NDArray[np.float64], NDArray[np.float64]]], sensor: Sensor) -> tuple[str, str]:
    """Depth differences in the gel, and the share of pixels that are in the gel in one map only."""
    both = [(a < sensor.w) & (b < sensor.w) for a, b in pairs]
    off = UM * np.concatenate([np.abs(a[met] - b[met]) for (a, b), met in zip(pairs, both, strict=True)])
    one_only = np.mean([(a < sensor.w) != (b < sensor.w) for a, b in pairs])
    return " / ".join(three_digits(float(np.quantile(off, q))) for q in (0.5, 0.99, 1)), three_digits(1e3 * float(one_only))
