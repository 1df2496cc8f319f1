"""Measure exact orthographic depth beside the supplement's sphere tracing, Embree's first hits and a rasteriser."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from benchmarks.cases import POSES, Case, over_cases, touched_objects
from benchmarks.timing import Table, quantiles, side_by_side, three_digits
from pipeline.formats.sensor_file import load_sensor
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth, sphere_traced_depth
from pipeline.kernels.touch.sensor import Sensor, pixel_centres, sensor_to_world
from pipeline.kernels.touch.tactile_image import tactile_image
from stages.render_vision.renderer import OpenGLContext

EYES = {"pyrender, perspective of 40°": 0.0225, "pyrender, parallel rays": None}
"""m from the eye to the gel's face: 40° over the sensor's width is the perspective of the authors' simulator."""
SUBDIVISIONS = 5, 6
"""Subdivisions of the wavy balls: 20,480 and 81,920 faces."""
TO_CAMERA = np.diag([1.0, -1.0, -1.0, 1.0])
"""An OpenGL camera looks along its -z with +y up; a sensor looks along +z and its rows go along +y."""
OURS, EMBREE = "exact, float64 (ours)", "Embree's first hit, float32"
UM = 1e6
DepthOf = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def measure(data: Path, turns: int) -> Table:
    """Measure the dataset's objects and two balls; `turns` rounds of all sensors each."""
    cases, sensor = touched_objects(data), load_sensor("gel_16mm")
    balls = [f"{20 * 4**number} faces" for number in SUBDIVISIONS]
    table = Table(
        "Depth: exact, traced, rasterised",
        [
            *("depth, ms", "depth and tactile image, ms", "÷ ours"),
            *(cell for ball in balls for cell in (f"{ball}: depth, ms", "depth and tactile image, ms", "÷ ours")),
            *("off, µm: median / 99 % / most", "pixels in the gel in one only, ‰", "tactile image off, levels: mean / most"),
        ],
        [
            f"{sum(len(case.poses) for case in cases)} sensors that touch, {sensor.rows} × {sensor.cols} rays, and {POSES} on each of two "
            "wavy balls of the size of an object. Processor milliseconds of one core (Mesa's threads counted), least / median; ratios of "
            "the least, depth and tactile image together.",
            "Off: against our float64 depth, where both are in the gel; `pytest -m slow tests/kernels/touch` compares ours with brute "
            "force. Embree's time includes its rays. Tactile images use the same shading of either depth.",
            "Not comparable: a perspective camera looks along other rays. pyrender's pass is multisampled: a depth is taken up to half a "
            "pixel from the pixel's centre. Without a graphics card Mesa rasterises in software.",
        ],
    )
    rng = np.random.default_rng(0)
    large = [wavy_ball(number, rng) for number in SUBDIVISIONS]
    methods = _depth_methods(table, [*cases, *large], sensor)
    cells: dict[str, list[object]] = {name: [] for name in methods}
    for group, start in ((cases, 0), *(([ball], len(cases) + number) for number, ball in enumerate(large))):
        depth_rounds = {
            name: over_cases(group, lambda i, pose, depth_of=depth_of, k=start: depth_of[k + i](pose)) for name, depth_of in methods.items()
        }
        image_rounds = {
            name: over_cases(group, lambda i, pose, depth_of=depth_of, k=start: tactile_image(depth_of[k + i](pose), sensor))
            for name, depth_of in methods.items()
        }
        depth_times, image_times = side_by_side(depth_rounds, turns), side_by_side(image_rounds, turns)
        for name in methods:
            cells[name] += [depth_times[name], image_times[name], image_times[name].over(image_times[OURS])]
    for name, depth_of in methods.items():
        table.add(name, *cells[name], *(("–", "–", "–") if name == OURS else _errors(cases, depth_of, methods[OURS], sensor)))
    return table


def press(triangles: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw the (4, 4) pose of a sensor 2 mm deep in a random face, tilted by about 20 degrees."""
    face = triangles[rng.integers(len(triangles))]
    normal = np.cross(face[1] - face[0], face[2] - face[0])
    z = -normal / np.linalg.norm(normal) + rng.normal(size=3) * 0.2
    z /= np.linalg.norm(z)
    x = np.cross(rng.normal(size=3), z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = face.mean(axis=0) - 0.0048 * z
    return pose


def wavy_ball(subdivisions: int, rng: np.random.Generator) -> Case:
    """Make a ball of the size of an object, with waves of a finger's width, and sensors pressed into it."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.25)
    vertices = np.asarray(ball.vertices, np.float64)
    vertices = vertices * (1 + 0.02 * np.sin(vertices * 150).sum(axis=1, keepdims=True) / 3)
    mesh = Mesh.bare(vertices + np.array([0.0, 0.0, 0.6]), np.asarray(ball.faces))
    return Case("ball", mesh, np.stack([press(mesh.triangles, rng) for _ in range(POSES)]))


def _depth_methods(table: Table, cases: Sequence[Case], sensor: Sensor) -> dict[str, list[DepthOf]]:
    """Make every method that computes a depth map: for each case, a function of the pose."""
    faces = [box_faces(case.mesh.triangles) for case in cases]
    methods: dict[str, list[DepthOf]] = {
        OURS: [lambda pose, b=b: ray_depth(b, pose, sensor) for b in faces],
        EMBREE: [embree_depth(case.mesh.triangles, sensor) for case in cases],
        "sphere tracing (the supplement's)": [lambda pose, b=b: sphere_traced_depth(b, pose, sensor) for b in faces],
    }
    with table.peer(*EYES):
        context = OpenGLContext(sensor.cols)
        methods |= {name: [rasterised_depth(context, case.mesh, sensor, eye) for case in cases] for name, eye in EYES.items()}
    return methods


def embree_depth(triangles: NDArray[np.float64], sensor: Sensor) -> DepthOf:
    """Trace the faces (F, 3, 3) of a mesh by Embree; depth maps (rows, cols), m, +inf where nothing is hit within range."""
    scene = EmbreeScene()
    mesh = TriangleMesh(scene, triangles.astype(np.float32))
    x, y = pixel_centres(sensor)

    def depth(pose: NDArray[np.float64], _keeps: TriangleMesh = mesh) -> NDArray[np.float64]:  # the scene does not keep its mesh alive
        origins = sensor_to_world(pose, x, y[:, None], np.zeros(sensor.shape)).reshape(-1, 3).astype(np.float32)
        directions = np.tile(pose[:3, 2].astype(np.float32), (len(origins), 1))
        distance = np.asarray(scene.run(origins, directions, query="DISTANCE"), np.float64).reshape(sensor.shape)
        return np.where(distance <= sensor.range, distance, np.inf)

    return depth


def rasterised_depth(context: OpenGLContext, mesh: Mesh, sensor: Sensor, eye: float | None) -> DepthOf:
    """Draw a mesh by pyrender's depth-only pass; depth maps (rows, cols), m, +inf where nothing is drawn.

    `eye` is the distance in m of a pinhole from the gel's face, where its view covers the sensor's square; None for parallel rays. The
    context must be current. The pass draws no face that is seen from behind.
    """
    pyrender = context.pyrender
    flags = pyrender.RenderFlags.DEPTH_ONLY | pyrender.RenderFlags.OFFSCREEN
    renderer, scene = pyrender.Renderer(sensor.cols, sensor.rows), pyrender.Scene()
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2  # float32 is finest around 0
    scene.add(pyrender.Mesh([pyrender.Primitive(positions=(mesh.vertices - middle).astype(np.float32), indices=mesh.faces)]))
    near = sensor.range if eye is None else eye - sensor.w  # from the camera to the sensor plane
    far = near + sensor.range
    if eye is None:
        lens = pyrender.OrthographicCamera(xmag=sensor.width / 2, ymag=sensor.height / 2, znear=near, zfar=far)
    else:
        lens = pyrender.PerspectiveCamera(yfov=2 * np.arctan(sensor.height / 2 / eye), znear=near, zfar=far, aspectRatio=1.0)
    camera, behind = scene.add(lens), np.eye(4)
    behind[2, 3] = -near

    def depth(pose: NDArray[np.float64]) -> NDArray[np.float64]:
        centred = pose.copy()
        centred[:3, 3] -= middle
        scene.set_pose(camera, centred @ behind @ TO_CAMERA)
        distance = renderer.render(scene, flags).astype(np.float64)
        with np.errstate(divide="ignore"):
            if eye is None:  # pyrender undoes a perspective in every depth
                clip = (far + near - 2 * near * far / distance) / (far - near)
                return np.where(distance > 0, (clip + 1) / 2 * sensor.range, np.inf)
        return np.where(distance > 0, distance - near, np.inf)

    return depth


def _errors(cases: Sequence[Case], depth_of: list[DepthOf], true_depth_of: list[DepthOf], sensor: Sensor) -> tuple[str, str, str]:
    pairs = [(depth_of[i](pose), true_depth_of[i](pose)) for i, case in enumerate(cases) for pose in case.poses]
    levels = np.concatenate([np.abs(tactile_image(a, sensor).astype(int) - tactile_image(b, sensor)).ravel() for a, b in pairs])
    return (*_format_differences(pairs, sensor), f"{levels.mean():.3f} / {levels.max()}")


def _format_differences(pairs: list[tuple[NDArray[np.float64], NDArray[np.float64]]], sensor: Sensor) -> tuple[str, str]:
    """Format depth differences in the gel, and the share of pixels that are in the gel in one map only."""
    in_both = [(a < sensor.w) & (b < sensor.w) for a, b in pairs]
    differences = UM * np.concatenate([np.abs(a[met] - b[met]) for (a, b), met in zip(pairs, in_both, strict=True)])
    one_only = np.mean([(a < sensor.w) != (b < sensor.w) for a, b in pairs])
    return quantiles(differences), three_digits(1e3 * float(one_only))
