"""Closed meshes of ellipsoids and thin bodies with touch charts."""

import igl
import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.kernels.charts.touch_chart import chart_square
from pipeline.kernels.charts.vision_charts import CHART_VERTICES, vision_charts
from pipeline.kernels.geometry.closed_surface import closed_surface, split_edges, vertex_normals
from pipeline.kernels.geometry.mesh import mesh_edges
from pipeline.kernels.metrics.surface_quality import dihedral_angles

SPHERE = vision_charts(1)
JOINED = np.zeros((SPHERE.position.max() + 1, 3))
JOINED[SPHERE.position] = SPHERE.vertices
FACES = SPHERE.position[SPHERE.faces]
RADII = np.array([0.1, 0.1, 0.15])
VOLUME = 4 / 3 * np.pi * RADII.prod()
SQUARE, CHART_FACES = (array.numpy() for array in chart_square(9))
NO_CHARTS = np.zeros((0, 81, 3))


def chart(direction, outward: float = 0.0) -> np.ndarray:
    """Make a patch of the ellipsoid, 17 mm wide, moved outwards, as touched by a sensor from that direction."""
    away = np.array(direction, float) / np.linalg.norm(direction)
    across = np.cross(away, [0.3, 0.5, 0.8])
    across /= np.linalg.norm(across)
    start = 0.0174 * (SQUARE[:, :1] * across + SQUARE[:, 1:2] * np.cross(-away, across)) / RADII
    a, b, c = (away / RADII) @ (away / RADII), start @ (away / RADII), (start**2).sum(axis=1) - 1
    return start * RADII + ((np.sqrt(b**2 - a * c) - b) / a + outward)[:, None] * away


def touched(charts) -> tuple[np.ndarray, np.ndarray]:
    """Take the vertices (N, 3) of charts and their outward normals."""
    normals = [-vertex_normals(chart, CHART_FACES) for chart in charts]
    return np.reshape(charts, (-1, 3)), np.reshape(normals, (-1, 3))


def closed(vertices, faces=FACES, charts=NO_CHARTS, resolution=64) -> trimesh.Trimesh:
    mesh = trimesh.Trimesh(*closed_surface(vertices, faces, *touched(charts), resolution=resolution), process=False)
    assert np.isfinite(mesh.vertices).all()
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert mesh.body_count == 1
    assert farthest(charts, mesh) <= 5e-4
    written = trimesh.Trimesh(mesh.vertices.astype(np.float32), mesh.faces)  # as files hold it; equal vertices become one
    assert written.is_watertight
    return mesh


def farthest(charts, mesh) -> float:
    points = np.reshape(charts, (-1, 3))
    return float(np.sqrt(igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces)[0]).max()) if len(points) else 0.0


def test_closed_surface_follows_charts_2_mm_outside_an_ellipsoid():
    charts = np.array([chart(direction, 0.002) for direction in ((1, 0, 0), (-1, 0.2, 0), (0, 0, 1))])
    assert np.sqrt(igl.point_mesh_squared_distance(charts[0], JOINED * RADII, FACES)[0]).min() > 1.5e-3
    mesh = closed(JOINED * RADII, charts=charts)
    assert mesh.euler_number == 2
    assert mesh.volume == pytest.approx(VOLUME, rel=0.03)
    away = np.linalg.norm(mesh.vertices[:, None] - charts.mean(axis=1), axis=2).min(axis=1) > 0.04
    assert np.abs(np.linalg.norm(mesh.vertices[away] / RADII, axis=1) - 1).max() < 0.02
    assert np.quantile(dihedral_angles(mesh.vertices, mesh.faces), 0.98) < 8


def test_missing_chart_and_open_seams_are_closed():
    there = SPHERE.faces[(SPHERE.faces // CHART_VERTICES != 5).all(axis=1)]  # of 96
    vertices = 0.1 * SPHERE.vertices
    shrunk = vertices.reshape(-1, CHART_VERTICES, 3)
    middles = shrunk.mean(axis=1, keepdims=True)
    mesh = closed((middles + 0.9 * (shrunk - middles)).reshape(-1, 3), there)  # seams of some 2 mm
    assert mesh.euler_number == 2
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 1e-3, rel=0.06)


@pytest.mark.parametrize(
    ("charts", "volume"),
    [
        (chart((1, 0, 0), 0.05)[None], (1, 1.15)),
        (chart((1, 0, 0), -0.03)[None], (0.8, 1.02)),
        (np.stack([chart((1, 0, 0), 0.01), chart((1, 0.1, 0), -0.01)]), (0.9, 1.1)),  # they contradict each other
        (np.tile([0.11, 0, 0], (1, 81, 1)), (1, 1.1)),
        (chart((0, 1, 0))[None, ::-1], (0.95, 1.05)),  # its normals point outwards
        (0.05 * np.random.default_rng(0).normal(size=(1, 81, 3)), (0.3, 1.3)),
    ],
    ids=["far outside", "deep inside", "contradicting", "a point", "inside out", "noise"],
)
def test_closed_surface_passes_through_touches_anywhere(charts, volume):
    low, high = volume
    assert low < closed(JOINED * RADII, charts=charts).volume / VOLUME < high


def test_both_charts_of_a_displaced_thin_body_are_followed():
    """A plate 6 mm thick, touched on both sides 8 mm from its predicted position: each chart attaches to the side that faces it."""
    plate = trimesh.creation.box((0.2, 0.2, 0.006)).subdivide_to_size(0.02)
    grid = 0.0174 * SQUARE
    above, below = grid * [1, -1, 1] + [0, 0, 0.011], grid + [0, 0, 0.005]  # felt from above, z into the plate is down
    mesh = closed(plate.vertices, np.asarray(plate.faces), np.stack([above, below]))
    axis = np.array([[0, 0, z] for z in np.linspace(0.0055, 0.0105, 6)])
    assert (igl.fast_winding_number(mesh.vertices, mesh.faces, axis) > 0.5).all()
    outside = np.array([[0, 0, 0.003], [0, 0, 0.013]])
    assert (igl.fast_winding_number(mesh.vertices, mesh.faces, outside) < 0.5).all()


def test_untouched_side_of_a_thin_body_stays_at_the_coarsest_resolution():
    """A plate 6 mm thick with charts all over its front, 3 mm before it."""
    plate = trimesh.creation.box((0.2, 0.2, 0.006)).subdivide_to_size(0.02)
    places = np.linspace(-0.08, 0.08, 3)
    charts = np.array([0.0174 * SQUARE * [1, -1, 1] + [x, y, 0.006] for x in places for y in places])
    mesh = closed(plate.vertices, np.asarray(plate.faces), charts)
    assert mesh.volume == pytest.approx(0.2 * 0.2 * 0.009, rel=0.3)
    back = np.array([[x, y, -0.003] for x in places for y in places])
    assert farthest(back, mesh) < 1.5e-3


def test_closed_surface_of_a_flat_sheet_is_thin():
    assert closed(np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]), np.array([[0, 1, 2]])).volume < 1e-5
    assert closed(JOINED * [0.1, 0.1, 0]).volume < 2e-4
    noise = np.random.default_rng(0).normal(size=JOINED.shape) * 0.1
    assert closed(noise, charts=chart((1, 0, 0))[None]).volume > 0


def test_split_edges_keep_the_surface():
    rng = np.random.default_rng(0)
    ball = trimesh.creation.icosphere(2)
    vertices, faces = np.asarray(ball.vertices), np.asarray(ball.faces)
    for share in (0.0, 0.2, 0.5, 1.0):
        edges = mesh_edges(faces)
        chosen = np.flatnonzero(rng.random(len(edges[0])) < share)
        split = trimesh.Trimesh(*split_edges(vertices, faces, *edges, chosen), process=False)
        assert len(split.vertices) == len(vertices) + len(chosen)
        assert len(split.faces) == len(faces) + 2 * len(chosen)
        assert split.is_watertight
        assert split.volume == pytest.approx(ball.volume, rel=1e-12)
        assert split.area == pytest.approx(ball.area, rel=1e-12)


HOLED = np.where(np.arange(len(JOINED))[:, None] == 7, np.nan, JOINED)


@pytest.mark.parametrize(
    ("vertices", "faces", "charts", "resolution", "named"),
    [
        (HOLED, FACES, NO_CHARTS, 64, "closed"),
        (JOINED, FACES[:0], NO_CHARTS, 64, "closed"),
        (JOINED * 0, FACES, NO_CHARTS, 64, "closed"),
        (JOINED, FACES, np.full((1, 81, 3), np.nan), 64, "touches"),
        (JOINED * RADII, FACES, NO_CHARTS, 63, "63"),
    ],
)
def test_closed_surface_rejects_invalid_surfaces_charts_and_resolutions(vertices, faces, charts, resolution, named):
    with pytest.raises(InvalidInput, match=named):
        closed_surface(vertices, faces, *touched(charts), resolution=resolution)
