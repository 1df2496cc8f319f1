"""Shapes of baselines against closed forms, and their rows in the tables of a dataset."""

import numpy as np
import pytest
import trimesh

from benchmarks.shape_baselines import extrude_silhouette, measure_shapes, mirrored, smooth_surface
from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.transforms import unit_vectors
from pipeline.kernels.metrics.cloud_distances import cloud_distances, sampling_distance
from pipeline.tables.evaluation_tables import evaluation_tables
from stages.evaluate.evaluation_files import read_figures
from tests.stages import ball_dataset as spheres
from tests.stages.sphere_views import CENTRE, RADIUS, camera_at, sphere_points


def test_mirrored_half_of_a_sphere_is_the_sphere():
    points, camera = sphere_points(), camera_at(50.0)
    visible = points[points[:, 0] > 0]
    whole = mirrored(visible, camera, CENTRE)
    assert len(whole) == 2 * len(visible)
    np.testing.assert_allclose(np.linalg.norm(whole - CENTRE, axis=1), RADIUS, rtol=1e-9)
    apart = np.sqrt(cloud_distances(whole, points).truth)
    assert apart.mean() < sampling_distance(4 * np.pi * RADIUS**2, len(whole))  # half of the points are in both
    assert whole[:, 0].mean() == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("height", [0.04, 0.09])
def test_extruded_disc_is_the_cylinder(height):
    """The box around a cylinder along the line of sight has the diagonal √(8 r² + h²)."""
    camera, (row, col) = camera_at(50.0), np.indices((256, 256)) + 0.5
    disc = np.hypot(row - 128, col - 128) <= 100
    made = extrude_silhouette(disc, camera, CENTRE, np.sqrt(8 * RADIUS**2 + height**2))
    assert np.ptp(made, axis=0) == pytest.approx([height, 2 * RADIUS, 2 * RADIUS], rel=0.01)
    body = trimesh.creation.cylinder(RADIUS, height, sections=128, transform=trimesh.geometry.align_vectors([0, 0, 1], [1, 0, 0]))
    truth = trimesh.sample.sample_surface(body, 5000, seed=0)[0] + CENTRE
    apart = cloud_distances(made, truth)
    assert np.sqrt(apart.truth).max() < 0.0015
    assert np.sqrt(apart.truth).mean() < 0.0005


def test_extruded_disc_is_no_deeper_than_wide():
    row, col = np.indices((256, 256)) + 0.5
    made = extrude_silhouette(np.hypot(row - 128, col - 128) <= 100, camera_at(50.0), CENTRE, 1.0)
    assert np.ptp(made, axis=0) == pytest.approx([2 * RADIUS] * 3, rel=0.01)


def test_empty_silhouette_has_no_shape():
    assert extrude_silhouette(np.zeros((256, 256), bool), camera_at(5.0), CENTRE, 0.2).shape == (0, 3)


@pytest.mark.parametrize("stretch", [(1, 1, 1), (1, 1, 1.6)])
def test_smooth_surface_through_all_sides_is_the_body(stretch):
    """Points of a sphere or an ellipsoid; the surface misses it by less than half a per cent of its size."""
    directions = unit_vectors(np.random.default_rng(2).normal(size=(300, 3)))
    points, normals = CENTRE + RADIUS * directions * stretch, unit_vectors(directions / stretch)
    diagonal = 2 * RADIUS * float(np.linalg.norm(stretch))
    vertices, faces = smooth_surface(points, normals, CENTRE, diagonal)
    assert len(faces) > 1000
    radii = np.linalg.norm((vertices - CENTRE) / stretch, axis=1)
    np.testing.assert_allclose(radii, RADIUS, rtol=0.02)
    assert np.abs(radii - RADIUS).mean() < 0.005 * RADIUS


def test_smooth_surface_through_one_patch_is_closed_and_goes_through_it():
    directions = unit_vectors(np.random.default_rng(3).normal(size=(300, 3)) * [1, 0.2, 0.2] + [3.0, 0, 0])
    vertices, faces = smooth_surface(CENTRE + RADIUS * directions, directions, CENTRE, 2 * np.sqrt(3) * RADIUS)
    np.testing.assert_allclose(np.linalg.norm(vertices - CENTRE, axis=1), RADIUS, rtol=0.02)  # its mean is the sphere through them
    assert trimesh.Trimesh(vertices, faces, process=False).is_watertight


def test_nothing_felt_has_no_surface():
    assert len(smooth_surface(np.zeros((0, 3)), np.zeros((0, 3)), CENTRE, 0.2)[1]) == 0


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    data = tmp_path_factory.mktemp("balls")
    spheres.make_data(data, 2, ("train", "test"))
    return data


def test_objects_of_half_a_metre_are_refused(data):
    with pytest.raises(InvalidInput, match=r"has objects scaled to 0\.5 m alone"):
        measure_shapes(data)


def test_mirrored_and_smooth_shapes_of_a_ball_are_the_ball(data, monkeypatch):
    """As far as sampling allows; the ball's radius is 0.12 m."""
    for module in ("stage", "protocols"):
        monkeypatch.setattr(f"stages.evaluate.{module}.has_paper_sizes", lambda _: False)
    monkeypatch.setattr("benchmarks.shape_baselines.MOST", 60)
    folder = measure_shapes(data)
    figures, least = read_figures(folder), sampling_distance(4 * np.pi * 0.12**2, 2000)
    assert figures["exact-depth-mirrored"].by_object("mean_distance") == pytest.approx(least, rel=0.15)
    for grasps in (1, 5):
        for name in ("gaussian-process-touch", "gaussian-process-exact-depth-touch"):
            assert figures[name].by_object("mean_distance", grasps) == pytest.approx(least, rel=0.15)
    assert figures["silhouette-extruded"].by_object("mean_distance") > 0.05  # the silhouettes of these images are empty
    (table,) = (table for table in evaluation_tables(folder) if table.title.startswith("What touch adds"))
    given = [(row.cells[0], row.cells[1]) for row in table.rows[:3]]
    assert given == [("silhouette-extruded", 0), ("exact-depth-mirrored", 0), ("gaussian-process-touch", 1)]
