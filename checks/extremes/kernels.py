"""Kernels, and how wrong they are: shares of the largest coordinate, against rational arithmetic or extended precision."""

from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
import torch

from checks.extremes import exact_distances as exact
from checks.extremes.shapes import TINY, Shape
from pipeline.formats.hand_file import load_hand
from pipeline.formats.scene_file import load_scene
from pipeline.kernels.charts.chart_fitting import fit_charts
from pipeline.kernels.charts.touch_chart import FitOptions, chart_square
from pipeline.kernels.geometry.closed_surface import wrap_surface
from pipeline.kernels.geometry.exterior_sampling import sample_exterior
from pipeline.kernels.geometry.mesh import Mesh, face_cross_products, sample_triangles
from pipeline.kernels.geometry.mesh_cleaning import POSITION, clean_mesh, normalise_mesh
from pipeline.kernels.geometry.signed_distance import rms_distance_to_surface, signed_distances
from pipeline.kernels.hand.distance_field import build_distance_field
from pipeline.kernels.hand.kinematics import forward_kinematics
from pipeline.kernels.metrics.chamfer import chamfer, sample_surface
from pipeline.kernels.metrics.cloud_distances import cloud_distances
from pipeline.kernels.metrics.surface_quality import surface_area
from pipeline.kernels.touch.depth_maps import in_gel, local_points
from pipeline.kernels.touch.ray_depth import box_faces, ray_depth, sphere_traced_depth
from pipeline.kernels.touch.sensor import pixel_centres
from pipeline.kernels.touch.tactile_image import tactile_image
from pipeline.kernels.vision.camera import look_at, project_points, projection_matrix
from pipeline.kernels.vision.primitives import CREASE, corner_normals
from tests.references.allegro_tips import tip_frame
from tests.references.exact_arithmetic import cross_product, intersect_ray
from tests.references.slow_corner_normals import slow_corner_normals
from tests.references.slow_tactile_image import slow_tactile_image

ALONE = {"one sliver 1e8": 1e-5}
"""libigl's distance to a sliver is off by up to a tenth of its length, so it counts as its longest edge."""
POINTS = 12
CHECKED_FACES = 40
MAX_FACES = 2_000_000
HAND = load_hand("allegro_right")
CAMERA = load_scene("supplement").camera


@dataclass(frozen=True)
class Kernel:
    """A kernel and its error.

    Attributes
    ----------
    name
        Room and function.
    error
        Feeds a shape to the kernel and returns the largest error, as a share of the largest coordinate where `unit` says nothing else.
    bound
        What the kernel's docstring promises.
    unit
        What the error is a share of, or counted in.
    wider
        Bounds for shapes for which the docstring promises less, by their names.
    """

    name: str
    error: Callable[[Shape], float]
    bound: float
    unit: str = "coordinate"
    wider: dict[str, float] = field(default_factory=dict)

    def bound_for(self, shape: Shape) -> float:
        """Return the error that is allowed with a shape."""
        return self.wider.get(shape.name, self.bound)


def _rng() -> np.random.Generator:
    return np.random.default_rng(0)


def _far(worst: Fraction, shape: Shape) -> float:
    """Return the root of a squared distance as a share of the largest coordinate."""
    return float(worst / Fraction(shape.extent) ** 2) ** 0.5


def _near_faces(shape: Shape, points: np.ndarray) -> np.ndarray:
    """List the faces among which the nearest to each of few points is; all of a small mesh."""
    vertices, faces = shape.mesh
    if len(faces) < 1000:
        return faces
    corners = vertices[faces]
    middles = corners.mean(axis=1)
    radius = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    kept = np.zeros(len(faces), bool)
    for point in points:
        away = np.linalg.norm(middles - point, axis=1)
        kept |= away - radius <= (away + radius).min()
    return faces[kept]


def _squared_from_surface(shape: Shape, points: np.ndarray) -> list[Fraction]:
    return [value for point in points for value in exact.squared_to_surface(point[None], shape.mesh[0], _near_faces(shape, point[None]))]


def _off_surface(shape: Shape, points: np.ndarray) -> float:
    return _far(max(_squared_from_surface(shape, points)), shape)


def cross_products(shape: Shape) -> float:
    """Compare with rational arithmetic, as a share of the product of two edges."""
    vertices, faces = shape.mesh
    triangles = vertices[faces[:CHECKED_FACES]]
    worst = 0.0
    for triangle, found in zip(triangles, face_cross_products(triangles), strict=True):
        a, b, c = exact.vectors(triangle)
        edges = exact.dot(exact.minus(b, a), exact.minus(b, a)) * exact.dot(exact.minus(c, a), exact.minus(c, a))
        wrong = [Fraction(float(x)) - y for x, y in zip(found, cross_product(triangle), strict=True)]
        worst = max(worst, float(sum(x * x for x in wrong) / max(edges, Fraction(TINY) ** 4)) ** 0.5)
    return worst


def cleaning(shape: Shape) -> float:
    """Compare the area of the faces that are kept with the area of distinct faces."""
    vertices, faces = shape.mesh
    cleaned, _ = clean_mesh(Mesh.bare(vertices, faces), MAX_FACES)
    distinct = {tuple(sorted(map(tuple, triangle.tolist()))): face for face, triangle in zip(faces.tolist(), vertices[faces], strict=True)}
    whole = np.array(list(distinct.values()))
    areas = [np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1).sum() for t in (vertices[whole], cleaned.triangles)]
    return float(abs(areas[1] - areas[0]) / areas[0])


def normalisation(shape: Shape) -> float:
    """Compare with 80-bit arithmetic, m."""
    vertices, faces = shape.mesh
    found = normalise_mesh(Mesh.bare(vertices, faces), up="z", diagonal=0.5)[0].vertices
    precise = vertices.astype(np.longdouble)
    low, high = precise.min(axis=0), precise.max(axis=0)
    wanted = (precise - (low + high) / 2) * (np.longdouble(0.5) / np.sqrt(np.square(high - low).sum())) + POSITION
    return float(np.abs(found - wanted).max())


def drawn_points(shape: Shape) -> float:
    """Measure how far points are from the triangle they were drawn in."""
    vertices, faces = shape.mesh
    points, chosen = sample_triangles(vertices[faces], POINTS, _rng())
    off = [exact.squared_to_surface(point[None], vertices, faces[[face]])[0] for point, face in zip(points, chosen, strict=True)]
    return _far(max(off), shape)


def exterior_points(shape: Shape) -> float:
    """Measure how far exterior points are from the surface."""
    points, normals = sample_exterior(Mesh.bare(*shape.mesh), POINTS, _rng())
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    return _off_surface(shape, points)


def distances_to_mesh(shape: Shape) -> float:
    """Compare the sizes of signed distances."""
    points = shape.points(POINTS, _rng())
    found = signed_distances(points, *shape.mesh)
    return _root_errors(found, _squared_from_surface(shape, points), shape)


def rms_distance(shape: Shape) -> float:
    """Compare the root mean square of distances."""
    points = shape.points(POINTS, _rng())
    found = rms_distance_to_surface(points, *shape.mesh)
    return _root_errors(np.array([found]), [exact.mean(_squared_from_surface(shape, points))], shape)


def field_distances(shape: Shape) -> float:
    """Compare the exact distances of a distance field."""
    points = shape.points(POINTS, _rng())
    found = build_distance_field(*shape.mesh, cell=shape.size / 20, band=shape.size / 10).exact(points)
    return _root_errors(found, _squared_from_surface(shape, points), shape)


def _root_errors(found: np.ndarray, squared: list[Fraction], shape: Shape) -> float:
    """Compare distances with the roots of exact squares, by shares of the largest coordinate that neither overflow nor underflow."""
    wanted = np.array([_far(value, shape) for value in squared])
    return float(np.abs(np.abs(found) / shape.extent - wanted).max())


def wrapping(shape: Shape) -> float:
    """Measure how far the vertices of a wrap are from what it wraps, in its spacing."""
    spacing = shape.size / 15
    vertices, _ = wrap_surface(*shape.mesh, spacing)
    chosen = vertices[_rng().choice(len(vertices), POINTS)]
    return _off_surface(shape, chosen) * shape.extent / spacing


def ray_depths(shape: Shape) -> float:
    """Compare depths along rays, measured normal to the face that is met."""
    return _depth_error(shape, ray_depth)


def sphere_depths(shape: Shape) -> float:
    """Compare depths of sphere tracing; its tolerance is a millionth of the sensor's width here."""
    tolerance = 1e-6 * shape.sensor().width
    found = _depth_error(shape, lambda *given: sphere_traced_depth(*given, tolerance=tolerance))
    return found * shape.extent / shape.sensor().width


def _depth_error(shape: Shape, tracer: Callable[..., np.ndarray]) -> float:
    """Compare a depth map with rational arithmetic; rays within 1e-9 of a face's rim, which may or may not meet it, are left out."""
    vertices, faces = shape.mesh
    sensor, pose = shape.sensor(), shape.sensor_pose()
    depth = tracer(box_faces(vertices[faces]), pose, sensor)
    rim = Fraction(1, 10**9) * max(1, int(shape.extent / shape.size) if shape.size else 1)
    worst = 0.0
    x, y = pixel_centres(sensor)
    triangles = vertices[faces]
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    origin = [Fraction(float(value)) for value in pose[:3, 3]]
    for row, col in np.ndindex(sensor.shape):
        across, down = origin[0] + Fraction(float(x[col])), origin[1] + Fraction(float(y[row]))
        place = np.array([float(across), float(down)])
        slack = 1e-9 * shape.extent
        close = triangles[((low[:, :2] <= place + slack) & (high[:, :2] >= place - slack)).all(axis=1)]
        met = [(z - origin[2], inner, slope) for z, inner, slope in filter(None, (_intersect(face, across, down) for face in close))]
        met = [hit for hit in met if hit[1] > -rim and 0 <= hit[0] <= Fraction(sensor.range)]
        if any(abs(inner) <= rim for _, inner, _ in met):
            continue
        nearest = min(met, default=None)
        if nearest is None or not np.isfinite(depth[row, col]):
            worst = max(worst, 0.0 if nearest is None and np.isposinf(depth[row, col]) else np.inf)
            continue
        wrong = abs(Fraction(float(depth[row, col])) - nearest[0]) / (1 + nearest[2])
        worst = max(worst, float(wrong / Fraction(shape.extent)))
    return worst


def _intersect(face: np.ndarray, across: Fraction, down: Fraction) -> tuple[Fraction, Fraction, Fraction] | None:
    return intersect_ray(face, across, down)  # type: ignore[arg-type]  # fractions are taken as they are


def gel_points(shape: Shape) -> float:
    """Compare the points in the gel, which are float32, with rational arithmetic on the stored depths."""
    sensor, pose = shape.sensor(), shape.sensor_pose()
    depth = ray_depth(box_faces(shape.mesh[0][shape.mesh[1]]), pose, sensor).astype(np.float32)
    points, count = local_points(depth, pose, sensor)
    x, y = pixel_centres(sensor)
    worst = Fraction(0)
    for point, (row, col) in zip(points[:count], np.argwhere(in_gel(depth.astype(np.float64), sensor)), strict=True):
        wanted = [Fraction(float(o)) + Fraction(float(v)) for o, v in zip(pose[:3, 3], (x[col], y[row], depth[row, col]), strict=True)]
        worst = max(worst, *(abs(Fraction(float(p)) - w) for p, w in zip(point, wanted, strict=True)))
    return float(worst / Fraction(shape.extent))


def tactile_images(shape: Shape) -> float:
    """Compare with equations 1 to 5, transcribed pixel by pixel; levels of 255."""
    sensor = shape.sensor()
    depth = ray_depth(box_faces(shape.mesh[0][shape.mesh[1]]), shape.sensor_pose(), sensor)
    return float(np.abs(tactile_image(depth, sensor).astype(int) - slow_tactile_image(depth, sensor)).max())


def fingertips(shape: Shape) -> float:
    """Compare the tips of a hand at the shape with the table in the hand's documentation."""
    pose = np.eye(4)
    pose[:3, 3] = shape.mesh[0][0] if len(shape.mesh[0]) else 0
    angles = _rng().uniform(HAND.lower, HAND.upper)
    frames = forward_kinematics(HAND, pose, angles)
    wrong = max(np.abs(frames[mount.link] - pose @ tip_frame(mount.name, angles)).max() for mount in HAND.sensors)
    return float(wrong / max(1.0, shape.extent))


def _clouds(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    vertices = shape.mesh[0][:CHECKED_FACES]
    return vertices, vertices + 0.1 * shape.size * _rng().normal(size=vertices.shape)


def _chamfer_error(shape: Shape, dtype: type[np.floating], measure: Callable[[np.ndarray, np.ndarray], float]) -> float:
    """Compare the roots of Chamfer distances of the clouds as they are stored."""
    with np.errstate(over="ignore"):
        first, second = (cloud.astype(dtype) for cloud in _clouds(shape))
    found = measure(first, second)
    wanted = exact.mean(exact.nearest_squared(first, second)) + exact.mean(exact.nearest_squared(second, first))
    return abs(found**0.5 / shape.extent - _far(wanted, shape))


def chamfer_in_training(shape: Shape) -> float:
    """Compare the Chamfer distance that networks are trained with, in float32."""
    return _chamfer_error(shape, np.float32, lambda a, b: float(chamfer(torch.from_numpy(a), torch.from_numpy(b))))


def chamfer_in_evaluation(shape: Shape) -> float:
    """Compare the Chamfer distance that evaluations report."""
    return _chamfer_error(shape, np.float64, lambda a, b: cloud_distances(a, b).chamfer)


def area(shape: Shape) -> float:
    """Compare the area with rational arithmetic, as a share of it; of a few faces."""
    vertices, faces = shape.mesh
    found = surface_area(vertices, faces[:CHECKED_FACES])
    wanted = sum(exact.areas(vertices, faces[:CHECKED_FACES]))
    return abs(found - wanted) / wanted if wanted else abs(found)


def samples_in_training(shape: Shape) -> float:
    """Measure how far points are from the surface of the vertices as float32 holds them."""
    vertices, faces = shape.mesh
    with np.errstate(over="ignore"):
        single = vertices.astype(np.float32)
    points = sample_surface(torch.from_numpy(single), torch.from_numpy(faces), POINTS, torch.Generator().manual_seed(0)).double().numpy()
    return _far(max(exact.squared_to_surface(points, single, _near_faces(shape, points))), shape)


def chart_residuals(shape: Shape) -> float:
    """Compare the residual of a chart after a few steps, in sensor widths."""
    width = shape.size or 1.0
    cloud = shape.mesh[0][:POINTS]
    options = FitOptions(max_iterations=5)
    fits = fit_charts([cloud], width, [torch.Generator().manual_seed(0)], options=options)
    faces = chart_square(options.side)[1].numpy()
    if not len(cloud):
        return float(fits.residual[0])
    squared = exact.mean(exact.squared_to_surface(cloud / width, fits.vertices[0] / width, faces))
    return abs(float(fits.residual[0]) / width - float(squared) ** 0.5)


def shading_normals(shape: Shape) -> float:
    """Compare with the slow twin in 80-bit arithmetic, on a few faces; 1 is a right angle or more."""
    vertices, faces = shape.mesh[0], shape.mesh[1][:CHECKED_FACES]
    found = corner_normals(vertices, faces.astype(np.int32))
    with np.errstate(invalid="ignore", divide="ignore"):
        wanted = slow_corner_normals(vertices.astype(np.longdouble), faces, CREASE)
    known = np.isfinite(wanted).all(axis=(1, 2))
    assert np.isfinite(found).all()
    return float(np.abs(found - wanted)[known].max(initial=0))


def projections(shape: Shape) -> float:
    """Compare the image of vertices, seen from two sizes away, with 80-bit arithmetic; pixels."""
    eye = shape.centre + shape.size * np.array([1.5, -1.2, 0.4])
    camera = look_at(CAMERA, tuple(eye.tolist()), tuple(shape.centre.tolist()))
    found = project_points(projection_matrix(camera), shape.mesh[0][:CHECKED_FACES])
    turn = _rotation(np.deg2rad(np.array(camera.rotation, np.longdouble)))
    seen = (shape.mesh[0][:CHECKED_FACES].astype(np.longdouble) - np.array(camera.position)) @ turn
    (fx, fy), (cx, cy) = camera.focal, camera.centre
    wanted = np.stack([cx - fx * seen[:, 0] / seen[:, 2], cy + fy * seen[:, 1] / seen[:, 2]], axis=1)
    return float(np.abs(found - wanted).max(initial=0))


def _rotation(angles: np.ndarray) -> np.ndarray:
    """Multiply turns about the world's x, then y, then z."""
    whole = np.eye(3, dtype=np.longdouble)
    for axis, angle in enumerate(angles):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3, dtype=np.longdouble)
        turn[i, i] = turn[j, j] = np.cos(angle)
        turn[j, i], turn[i, j] = np.sin(angle), -np.sin(angle)
        whole = turn @ whole
    return whole


KERNELS = (
    Kernel("geometry/mesh: face_cross_products", cross_products, 1e-15, "edges"),
    Kernel("geometry/mesh: sample_triangles", drawn_points, 2e-15),
    Kernel("geometry/mesh_cleaning: clean_mesh", cleaning, 1e-14, "area"),
    Kernel("geometry/mesh_cleaning: normalise_mesh", normalisation, 5e-16, "m"),
    Kernel("geometry/exterior_sampling: sample_exterior", exterior_points, 2e-15),
    Kernel("geometry/signed_distance: signed_distances", distances_to_mesh, 1e-13, wider=ALONE),
    Kernel("geometry/signed_distance: rms_distance_to_surface", rms_distance, 1e-13, wider=ALONE),
    Kernel("geometry/closed_surface: wrap_surface", wrapping, 1.0, "spacing", {"grazing 1e-8": 15.0}),
    Kernel("hand/distance_field: exact", field_distances, 1e-13, wider=ALONE),
    Kernel("hand/kinematics: forward_kinematics", fingertips, 1e-14),
    Kernel("touch/ray_depth: ray_depth", ray_depths, 1e-15),
    Kernel("touch/ray_depth: sphere_traced_depth", sphere_depths, 1.1e-6, "sensor width"),
    Kernel("touch/depth_maps: local_points", gel_points, 6e-8),
    Kernel("touch/tactile_image: tactile_image", tactile_images, 1, "levels"),
    Kernel(
        "vision/primitives: corner_normals",
        shading_normals,
        1e-14,
        "1",
        {"slivers 1e8": 2e-7, "one sliver 1e8": 2e-7, "slivers 1e12": 2e-3},
    ),
    Kernel("vision/camera: project_points", projections, 1e-9, "pixels", {"1e6 m away": 1e-6}),
    Kernel("charts/chart_fitting: fit_charts", chart_residuals, 1e-12, "sensor width"),
    Kernel("metrics/chamfer: chamfer", chamfer_in_training, 1e-6),
    Kernel("metrics/cloud_distances: cloud_distances", chamfer_in_evaluation, 1e-14),
    Kernel("metrics/chamfer: sample_surface", samples_in_training, 5e-7),
    Kernel("metrics/surface_quality: surface_area", area, 1e-6, "area"),
)
"""All that take geometry; networks, which take images and graphs, have twins of their own in `tests/kernels/networks`."""
