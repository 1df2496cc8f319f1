"""Similarity of shapes and silhouettes on small sets."""

import numpy as np
import pytest

from pipeline.kernels.metrics.nearest_points import Cloud
from pipeline.kernels.metrics.retrieval import (
    SearchedClouds,
    chamfer_distance,
    nearest_cloud,
    packed_masks,
    silhouette_overlap,
    typical_cloud,
)
from tests.references.all_pairs import chamfer_to_all, squared_distance_to_all


def line(*places: float) -> np.ndarray:
    return np.array([[place, 0.0, 0.0] for place in places])


def shapes(count: int, seed: int) -> list[np.ndarray]:
    """Ellipsoids of many sizes, some of them nearly the same."""
    rng = np.random.default_rng(seed)
    kinds = rng.uniform(0.05, 0.3, (4, 3))
    points = rng.normal(size=(count, 700, 3))
    return list(
        points / np.linalg.norm(points, axis=2, keepdims=True) * (kinds[np.arange(count) % 4] + rng.normal(0, 0.01, (count, 3)))[:, None]
    )


def test_chamfer_distance_of_points_on_a_line():
    assert chamfer_distance(Cloud(line(0)), Cloud(line(1, 3))) == (1 + 9) / 2 + 1


@pytest.mark.parametrize("both", [True, False])
def test_nearest_cloud_equals_that_of_exhaustive_search(both):
    clouds, queries = shapes(16, 0), shapes(4, 1)
    searched = SearchedClouds([Cloud(cloud) for cloud in clouds])
    for cloud in (*queries, clouds[5]):
        every = chamfer_to_all(cloud, clouds) if both else squared_distance_to_all(cloud, clouds)
        value, number = nearest_cloud(Cloud(cloud), searched, both=both) or (np.nan, -1)
        assert number == int(np.argmin(every))
        assert value == pytest.approx(min(every), rel=1e-9, abs=1e-18)
        assert nearest_cloud(Cloud(cloud), searched, both=both, below=value) is None


def test_one_direction_of_a_dense_query_equals_exhaustive_search():
    clouds, patch = shapes(16, 5), shapes(1, 6)[0]
    searched = SearchedClouds([Cloud(cloud) for cloud in clouds])
    query = np.concatenate([patch[:5] + 1e-3 * offset for offset in np.random.default_rng(7).normal(size=(200, 1, 3))])  # five touches
    every = squared_distance_to_all(query, clouds)
    assert nearest_cloud(Cloud(query), searched, both=False) == (pytest.approx(min(every), rel=1e-9), int(np.argmin(every)))


def test_typical_cloud_has_the_least_mean_distance_to_all():
    clouds = shapes(16, 8)
    means = [np.mean(chamfer_to_all(cloud, clouds)) for cloud in clouds]
    assert typical_cloud(SearchedClouds([Cloud(cloud) for cloud in clouds])) == int(np.argmin(means))


def test_first_of_equal_clouds_is_typical():
    cloud, other = shapes(2, 9)
    assert typical_cloud(SearchedClouds([Cloud(one) for one in (other, cloud, cloud, cloud)])) == 1


def test_first_of_equal_clouds_is_the_nearest():
    cloud, other = shapes(2, 2)
    searched = SearchedClouds([Cloud(one) for one in (other, other + 0.01, cloud, cloud)])
    assert nearest_cloud(Cloud(cloud), searched, both=True) == (0.0, 2)


@pytest.mark.parametrize("both", [True, False])
def test_bounds_of_sites_are_below_the_distances_and_near_those_of_far_clouds(both):
    clouds, query = [cloud + [0.4 * number, 0, 0] for number, cloud in enumerate(shapes(6, 3))], shapes(1, 4)[0]
    bounds = SearchedClouds([Cloud(cloud) for cloud in clouds]).bounds(Cloud(query), both=both)
    distances = np.array(chamfer_to_all(query, clouds) if both else squared_distance_to_all(query, clouds))
    assert (bounds <= distances).all()
    assert (bounds[3:] > 0.5 * distances[3:]).all()


def test_overlap_is_intersection_over_union():
    masks = np.array([[1, 1, 0, 0], [0, 0, 0, 0]], bool)
    others = np.array([[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1], [0, 0, 0, 0]], bool)
    found = [silhouette_overlap(mask, packed_masks(others)) for mask in packed_masks(masks)]
    np.testing.assert_allclose(found, [[1, 1 / 3, 0, 0], [0, 0, 0, 0]], rtol=1e-6)


@pytest.mark.parametrize("pixels", [64, 200])
def test_overlap_of_large_masks_counts_each_pixel(pixels):
    masks = np.random.default_rng(pixels).random((5, pixels)) < 0.4
    expected = np.float32([(masks[0] & other).sum() / (masks[0] | other).sum() for other in masks])
    assert (silhouette_overlap(packed_masks(masks)[0], packed_masks(masks)) == expected).all()
