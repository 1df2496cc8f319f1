"""Cross products and flatness of faces of any scale, position and shape; whether faces close."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import trimesh
from hypothesis import given

from pipeline.kernels.geometry.mesh import face_cross_products, flatness, is_watertight
from tests.references.exact_arithmetic import cross_product
from tests.strategies import EPS, aspects, offsets, scales, seeds, sliver


@given(seed=seeds, scale=scales, offset=offsets, aspect=aspects)
def test_cross_product_error_is_a_few_units_of_the_edge_product(seed, scale, offset, aspect) -> None:
    triangle = sliver(aspect, np.random.default_rng(seed)) * scale + offset
    error = [Fraction(float(got)) - true for got, true in zip(face_cross_products(triangle[None])[0], cross_product(triangle), strict=True)]
    edges = np.linalg.norm(triangle[1:] - triangle[0], axis=1)
    assert max(abs(float(e)) for e in error) <= 4 * EPS * edges.prod()


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
