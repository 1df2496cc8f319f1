"""Similarity of shapes and silhouettes on small sets."""

from __future__ import annotations

import numpy as np

from pipeline.kernels.metrics.retrieval import chamfer_matrix, silhouette_overlap


def test_chamfer_matrix_of_points_on_a_line():
    at = {0: np.zeros((1, 3)), 1: np.array([[1.0, 0, 0]]), 3: np.array([[3.0, 0, 0]]), 13: np.array([[1.0, 0, 0], [3, 0, 0]])}
    found = chamfer_matrix([at[0], at[13]], [at[0], at[1], at[3]])
    assert found.tolist() == [[0, 1 + 1, 9 + 9], [(1 + 9) / 2 + 1, (0 + 4) / 2 + 0, (4 + 0) / 2 + 0]]


def test_overlap_is_intersection_over_union():
    masks = np.array([[1, 1, 0, 0], [0, 0, 0, 0]], bool)
    others = np.array([[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1], [0, 0, 0, 0]], bool)
    np.testing.assert_allclose(silhouette_overlap(masks, others), [[1, 1 / 3, 0, 0], [0, 0, 0, 0]], rtol=1e-6)
