"""Points drawn from surfaces of slivers, segments, points and copies, wherever and however large they are."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from torch import Tensor

from pipeline.kernels.metrics.surface_sampling import map_to_surface, sample_surface
from tests.kernels.degenerate_clouds import OFFSETS, soup
from tests.references import exact_distances as exact
from tests.strategies import scales, seeds

STEPS = 500
"""Places along the areas: a face's share of them is its share of the area, to one place."""


def evenly(count: int = STEPS) -> Tensor:
    """(count, 3): faces chosen at even steps along the areas, and of each the centroid, u = 4/9 and v = 1/2."""
    along = (torch.arange(count, dtype=torch.float64) + 0.5) / count
    return torch.stack([along, torch.full_like(along, 4 / 9), torch.full_like(along, 0.5)], dim=1)


def random_places(seed: int, count: int = 60) -> Tensor:
    return torch.rand(count, 3, generator=torch.Generator().manual_seed(seed % 2**31), dtype=torch.float64)


@given(seed=seeds, scale=scales, offset=OFFSETS)
def test_faces_are_chosen_by_their_exact_areas(seed: int, scale: float, offset: np.ndarray) -> None:
    vertices, faces = soup(seed)
    vertices = vertices * scale + offset
    points = map_to_surface(torch.from_numpy(vertices), torch.from_numpy(faces), evenly()).numpy()
    areas, total = exact.areas(vertices, faces), math.fsum(exact.areas(vertices, faces))
    centroids = vertices[faces].mean(axis=1)
    chosen = np.abs(points[:, None] - centroids[None]).max(axis=2) <= 1e-14 * np.abs(vertices).max()  # (n, F)
    assert chosen.any(axis=1).all()
    different = [0, 1, 2, 3]  # the last three faces are one triangle
    expected = [*(STEPS * areas[face] / total for face in different[:-1]), STEPS * sum(areas[3:]) / total]
    np.testing.assert_allclose(chosen[:, different].sum(axis=0), expected, rtol=0, atol=1 + 1e-6 * STEPS)
    assert not chosen[:, 1:3].any()  # two corners of the second are one, all of the third


@given(seed=seeds, scale=scales, offset=OFFSETS)
def test_float32_is_within_four_units_in_the_last_place(seed: int, scale: float, offset: np.ndarray) -> None:
    """0.3 µm at 0.6 m; against the same vertices in float64, and against the surface itself."""
    vertices, faces = soup(seed)
    stored = torch.from_numpy(vertices * scale + offset).float()
    uniform = random_places(seed)
    single, double = (map_to_surface(given, torch.from_numpy(faces), uniform) for given in (stored, stored.double()))
    unit = float(torch.nextafter(stored.abs().max(), torch.tensor(math.inf)) - stored.abs().max())
    assert float((single - double).abs().max()) <= 4 * unit
    away = [math.sqrt(squared) for squared in exact.squared_to_surface(double[:8].numpy(), stored.numpy(), faces)]
    assert max(away) <= 1e-15 * 4 * float(stored.abs().max())


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@given(seed=seeds, scale=scales, offset=OFFSETS)
def test_gradient_of_a_point_is_shared_by_the_corners(dtype: torch.dtype, seed: int, scale: float, offset: np.ndarray) -> None:
    """Weights sum to one, also on slivers: the gradients of all corners together are those of the points."""
    vertices, faces = soup(seed)
    given = torch.from_numpy(vertices * scale + offset).to(dtype).requires_grad_()
    (gradient,) = torch.autograd.grad(map_to_surface(given, torch.from_numpy(faces), random_places(seed)).sum(), given)
    np.testing.assert_allclose(gradient.sum(dim=0).numpy(), 60.0, rtol=1e-5 if dtype == torch.float32 else 1e-13)
    assert bool((gradient >= 0).all())
    assert bool((gradient[3:9] == 0).all())  # a segment and a point are never chosen


@given(seed=seeds, scale=scales)
def test_points_scale_exactly_with_doubled_lengths(seed: int, scale: float) -> None:
    vertices, faces = soup(seed)
    given, triangles = torch.from_numpy(vertices * scale), torch.from_numpy(faces)
    power = 2.0 ** (seed % 20 - 10)
    points, larger = (sample_surface(given * factor, triangles, 50, torch.Generator().manual_seed(1)) for factor in (1, power))
    assert bool((larger == points * power).all())


@given(seed=seeds, scale=scales)
def test_ends_of_the_cumulative_area_choose_faces_with_area(seed: int, scale: float) -> None:
    """Includes 1, the end of the last face: segments and points before and after are never chosen."""
    vertices, faces = soup(seed)
    order = faces[[1, 2, 0, 3, 2, 1]]
    ends = torch.tensor([[0.0, 4 / 9, 0.5], [np.nextafter(1, 0), 4 / 9, 0.5], [1.0, 4 / 9, 0.5]], dtype=torch.float64)
    points = map_to_surface(torch.from_numpy(vertices * scale), torch.from_numpy(order), ends).numpy()
    first, last = (vertices[face].mean(axis=0) * scale for face in order[[2, 3]])
    np.testing.assert_allclose(points, [first, last, last], rtol=0, atol=1e-13 * scale)


def test_samples_ignore_the_winding_of_faces() -> None:
    vertices, faces = soup(0)
    turned = faces[:, ::-1].copy()
    there, back = (map_to_surface(torch.from_numpy(vertices), torch.from_numpy(given), evenly()) for given in (faces, turned))
    torch.testing.assert_close(there, back, rtol=0, atol=1e-15)


def test_sample_has_the_documented_position_in_its_face() -> None:
    single = sample_surface(torch.eye(3), torch.tensor([[0, 1, 2]]), 1, torch.Generator().manual_seed(0))
    assert single.shape == (1, 3)
    assert float(single.sum()) == pytest.approx(1)


DEGENERATE = {
    "a point": np.zeros((3, 3)),
    "a segment": np.array([[0, 0, 0], [1.0, 0, 0], [2, 0, 0]]),
    "twice the same corner": np.array([[0, 0, 0], [0.3, 0.1, 0.7], [0.3, 0.1, 0.7]]),
}


@pytest.mark.parametrize("kind", sorted(DEGENERATE))
def test_sampling_rejects_surfaces_without_area(kind: str) -> None:
    faces = torch.tensor([[0, 1, 2], [2, 1, 0]])
    with pytest.raises(ValueError, match="area is 0: no face has a finite area"):
        sample_surface(torch.from_numpy(DEGENERATE[kind]), faces, 5, torch.Generator())


@given(seed=seeds, scale=scales, offset=OFFSETS)
def test_segment_with_area_from_rounding_is_sampled_as_a_segment(seed: int, scale: float, offset: np.ndarray) -> None:
    """Corners are collinear up to rounding: the area is zero, or every point stays on the segment."""
    rng = np.random.default_rng(seed)
    vertices = np.outer(rng.random(3), rng.normal(size=3)) * scale + offset
    try:
        points = sample_surface(torch.from_numpy(vertices), torch.tensor([[0, 1, 2]]), 6, torch.Generator().manual_seed(0))
    except ValueError as error:
        assert "has a finite area" in str(error)  # noqa: PT017
        assert exact.areas(vertices, np.array([[0, 1, 2]]))[0] <= 1e-15 * scale**2
        return
    ends = vertices[[int(vertices[:, 0].argmin()), int(vertices[:, 0].argmax()), int(vertices[:, 0].argmax())]]
    away = exact.squared_to_surface(points.numpy(), ends, np.array([[0, 1, 2]]))
    assert math.sqrt(max(away)) <= 1e-15 * np.abs(vertices).max() * 4


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (torch.eye(3, dtype=torch.int64), [[0, 1, 2]], "vertices of type torch.int64"),
        (torch.eye(3, dtype=torch.bfloat16), [[0, 1, 2]], "vertices of type torch.bfloat16.*float32"),
        (torch.eye(3), [[0, 1, 3]], r"faces reach from 0 to 3; there are vertices 0 to 2"),
        (torch.eye(3), [[0, 1, -1]], "faces reach from -1 to 1"),
        (torch.tensor([[0.0, 0, 0], [np.inf, 0, 0], [0, 1, 0]]), [[0, 1, 2]], "NaN or infinity in 1 of 9"),
    ],
)
def test_sampling_rejects_invalid_surfaces(vertices: Tensor, faces: list[list[int]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sample_surface(vertices, torch.tensor(faces), 3, torch.Generator())
