"""The sphere of vision charts: counts, orientation, seams."""

from collections import Counter

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pipeline.kernels.charts.vision_charts import VisionCharts, vision_charts

SPLITS = (0, 1, 2)


def welded(sphere: VisionCharts) -> tuple[np.ndarray, np.ndarray]:
    """Distinct positions (P, 3) and the faces between them."""
    positions = np.full((sphere.position.max() + 1, 3), np.nan)
    positions[sphere.position] = sphere.vertices
    return positions, sphere.position[sphere.faces]


def test_default_sphere_is_that_of_the_supplement() -> None:
    sphere = vision_charts()
    assert len(sphere.centres) == 96
    assert sphere.vertices.shape == (1824, 3)
    assert sphere.faces.shape == (2304, 3)
    assert len(np.unique(sphere.position)) == sphere.position.max() + 1 == 1154


@pytest.mark.parametrize("splits", SPLITS)
def test_sphere_is_closed_and_consistently_oriented(splits: int) -> None:
    positions, faces = welded(vision_charts(splits))
    directed = Counter((int(face[k]), int(face[(k + 1) % 3])) for face in faces for k in range(3))
    assert set(directed.values()) == {1}
    assert all((b, a) in directed for a, b in directed)  # every edge has two faces, which run along it in opposite directions
    assert len(positions) - len(directed) // 2 + len(faces) == 2


@pytest.mark.parametrize("splits", SPLITS)
def test_faces_point_outwards(splits: int) -> None:
    sphere = vision_charts(splits)
    np.testing.assert_allclose(np.linalg.norm(sphere.vertices, axis=1), 1, atol=1e-15)
    a, b, c = np.moveaxis(sphere.vertices[sphere.faces], 1, 0)
    volumes = np.einsum("fi,fi->f", a, np.cross(b, c)) / 6
    assert (volumes > 0).all()
    # A face of angular size h lies below the sphere by about h² / 8, and less and less so with every split.
    assert 1 - 0.03 / 4**splits < volumes.sum() / (4 / 3 * np.pi) < 1


@pytest.mark.parametrize("splits", SPLITS)
def test_seams_equal_those_found_by_comparing_positions(splits: int) -> None:
    sphere = vision_charts(splits)
    pairs = cKDTree(sphere.vertices).query_pairs(1e-12, output_type="ndarray")
    np.testing.assert_array_equal(sphere.seams, pairs[np.lexsort(pairs.T[::-1])])


@pytest.mark.parametrize("splits", SPLITS)
def test_coinciding_vertices_are_equal_to_the_bit_and_lie_on_boundaries(splits: int) -> None:
    sphere = vision_charts(splits)
    first, second = sphere.seams.T
    assert (sphere.vertices[first] == sphere.vertices[second]).all()
    assert (sphere.position[first] == sphere.position[second]).all()
    assert (first // 19 != second // 19).all()
    assert np.array_equal(np.unique(sphere.seams % 19), np.arange(12))
