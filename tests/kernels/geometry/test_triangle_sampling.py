"""Sampling of triangles: uniform, on the triangle, never on a face without area."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import trimesh
from hypothesis import given
from scipy import stats

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.triangle_sampling import sample_triangles
from tests.references.exact_arithmetic import cross_product
from tests.strategies import EPS, aspects, offsets, scales, seeds, sliver

BOX = trimesh.creation.box((0.3, 0.2, 0.4))


def test_samples_are_uniform_inside_a_triangle(rng):
    corner = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    points, _ = sample_triangles(corner, 40_000, rng)
    cells = np.floor(points[:, :2] * 4).astype(int)
    whole = cells.sum(axis=1) < 3  # the square cells that lie in the triangle
    counts = np.bincount(cells[whole] @ [4, 1], minlength=16)
    assert stats.chisquare(counts[counts > 0]).pvalue > 0.001


@given(seed=seeds, scale=scales, offset=offsets, aspect=aspects)
def test_samples_lie_on_their_triangle(seed, scale, offset, aspect) -> None:
    rng = np.random.default_rng(seed)
    triangle = sliver(aspect, rng) * scale + offset
    normal = cross_product(triangle)
    length = float(sum(n * n for n in normal)) ** 0.5
    for point in sample_triangles(triangle[None], 10, rng)[0]:
        above = sum(n * (Fraction(float(p)) - Fraction(float(a))) for n, p, a in zip(normal, point, triangle[0], strict=True))
        beyond = []
        for k in range(3):
            start, end = triangle[k], triangle[(k + 1) % 3]
            doubled = sum(m * n for m, n in zip(cross_product(np.array([start, end, point])), normal, strict=True))
            beyond.append(-float(doubled) / length / np.linalg.norm(end - start))
        assert max(abs(float(above)) / length, *beyond) <= 8 * EPS * np.abs(triangle).max()


class LargestDraw:
    """The greatest number that a generator draws, again and again."""

    def random(self, size: int | tuple[int, ...]) -> np.ndarray:
        return np.full(size, 1 - 2.0**-53)


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1.0, 3.0, 1e3, 1e9])
def test_faces_without_area_are_never_drawn(size) -> None:
    real = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]) * size
    flat = np.array([[[0, 0, 0], [1, 0, 0], [2, 0, 0]]]) * size
    triangles = np.concatenate([flat, real, flat, real / 3, flat])
    assert sample_triangles(triangles, 5, LargestDraw())[1].tolist() == [3] * 5
    assert set(sample_triangles(triangles, 1000, np.random.default_rng(0))[1].tolist()) == {1, 3}


def test_zero_samples_are_allowed(rng) -> None:
    assert sample_triangles(BOX.vertices[BOX.faces], 0, rng)[0].shape == (0, 3)


def test_triangles_without_area_are_refused(rng) -> None:
    with pytest.raises(InvalidInput, match="none of the 1 triangles"):
        sample_triangles(np.zeros((1, 3, 3)), 10, rng)
