"""Faces of any scale, position and shape: cross products, flatness, watertightness, uniform sampling."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from scipy import stats

from pipeline.kernels.geometry.mesh import flatness, is_watertight, sample_triangles
from tests.strategies import EPS, aspects, offsets, scales, seeds, sliver


@given(seed=seeds, scale=scales, offset=offsets, aspect=aspects)
def test_flatness_is_one_over_the_aspect_at_any_scale_and_offset(seed, scale, offset, aspect) -> None:
    triangle = sliver(aspect, np.random.default_rng(seed))
    assert flatness(triangle[None] * scale)[0] == pytest.approx(1 / aspect, rel=1e-6)
    assert flatness(triangle[None] + offset)[0] == pytest.approx(1 / aspect, rel=1e-6, abs=8 * EPS * (np.abs(offset).max() + 1))
    assert flatness(np.array([triangle[[0, 0, 0]], triangle[[0, 1, 1]]])).tolist() == [0, 0]


def test_a_surface_with_a_hole_is_not_watertight() -> None:
    faces = trimesh.creation.box().faces
    assert is_watertight(faces)
    assert not is_watertight(faces[1:])
    assert not is_watertight(np.concatenate([faces, faces[:1]])), "an edge of three faces"


def test_samples_are_uniform_inside_a_triangle(rng):
    corner = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    points, _ = sample_triangles(corner, 40_000, rng)
    cells = np.floor(points[:, :2] * 4).astype(int)
    whole = cells.sum(axis=1) < 3  # the square cells that lie in the triangle
    counts = np.bincount(cells[whole] @ [4, 1], minlength=16)
    assert stats.chisquare(counts[counts > 0]).pvalue > 0.001


class LargestDraw:
    """Generator that always draws its largest number."""

    def random(self, size: int | tuple[int, ...]) -> np.ndarray:
        return np.full(size, 1 - 2.0**-53)


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1.0, 3.0, 1e3, 1e9])
def test_faces_without_area_are_never_sampled(size) -> None:
    real = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]) * size
    flat = np.array([[[0, 0, 0], [1, 0, 0], [2, 0, 0]]]) * size
    triangles = np.concatenate([flat, real, flat, real / 3, flat])
    assert sample_triangles(triangles, 5, LargestDraw())[1].tolist() == [3] * 5
    assert set(sample_triangles(triangles, 1000, np.random.default_rng(0))[1].tolist()) == {1, 3}
