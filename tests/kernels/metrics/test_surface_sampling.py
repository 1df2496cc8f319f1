"""Area-uniform sampling: its statistics, its gradient, and an exact twin."""

import pytest
import torch
from scipy import stats
from torch import Tensor

from pipeline.kernels.metrics.chamfer import map_to_surface, sample_surface

FACES = torch.tensor([[0, 1, 2], [0, 2, 3], [1, 1, 2], [0, 3, 4]])  # the third has no area
VERTICES = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 1], [-0.1, 0, 0.3]], dtype=torch.float64)


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def twin(vertices: Tensor, faces: Tensor, uniform: Tensor) -> Tensor:
    """Sample one point after the other, as the docstring states."""
    corners = [[vertices[i] for i in face] for face in faces.tolist()]
    areas = [float(torch.linalg.cross(b - a, c - a).norm().detach()) / 2 for a, b, c in corners]
    points = []
    for choose, u, v in uniform.tolist():
        left = choose * sum(areas)
        for (a, b, c), area in zip(corners, areas, strict=True):
            if left < area:
                points.append((1 - u**0.5) * a + u**0.5 * (1 - v) * b + u**0.5 * v * c)
                break
            left -= area
    return torch.stack(points)


def barycentric(points: Tensor, face: int) -> Tensor:
    """(n, 3) weights of a face's corners; NaN for points off its plane or outside it."""
    corners = VERTICES[FACES[face]]
    solved = torch.linalg.lstsq(torch.cat([corners.T, torch.ones(1, 3)]), torch.cat([points.T, torch.ones(1, len(points))])).solution.T
    on = ((solved @ corners - points).norm(dim=1) < 1e-9) & (solved > -1e-9).all(dim=1)
    return torch.where(on[:, None], solved, torch.nan)


def test_sampled_points_equal_those_of_the_slow_twin() -> None:
    uniform = torch.rand(500, 3, generator=generator(), dtype=torch.float64)
    torch.testing.assert_close(map_to_surface(VERTICES, FACES, uniform), twin(VERTICES, FACES, uniform), rtol=0, atol=1e-14)


def test_samples_are_area_uniform() -> None:
    points = sample_surface(VERTICES, FACES, 40_000, generator(1))
    inside = [barycentric(points, face) for face in (0, 1, 3)]
    counts = [int((~weights[:, 0].isnan()).sum()) for weights in inside]
    corners = VERTICES[FACES[[0, 1, 3]]]
    areas = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).norm(dim=1).numpy() / 2
    assert sum(counts) == len(points)  # all lie on a face, none on two
    assert stats.chisquare(counts, len(points) * areas / areas.sum()).pvalue > 0.01
    # a face divided by halves of its edges: four parts, equally large
    weights = inside[1][~inside[1][:, 0].isnan()]
    parts = [int((weights[:, corner] > 0.5).sum()) for corner in range(3)]
    assert stats.chisquare([*parts, len(weights) - sum(parts)]).pvalue > 0.01


def test_gradient_reaches_the_vertices() -> None:
    uniform = torch.rand(20, 3, generator=generator(2), dtype=torch.float64)
    weights = torch.rand(20, 3, generator=generator(3), dtype=torch.float64)
    vertices = VERTICES.clone().requires_grad_()
    fast, slow = (
        torch.autograd.grad((points * weights).sum(), vertices)[0]
        for points in (map_to_surface(vertices, FACES, uniform), twin(vertices, FACES, uniform))
    )
    torch.testing.assert_close(fast, slow, rtol=0, atol=1e-13)


def test_float32_keeps_its_type_and_chooses_in_float64() -> None:
    points = sample_surface(VERTICES.float(), FACES, 100, generator(8))
    assert points.dtype == torch.float32
    torch.testing.assert_close(points.double(), sample_surface(VERTICES.float().double(), FACES, 100, generator(8)), rtol=0, atol=1e-6)


def test_ends_of_the_cumulative_area_choose_faces_with_area() -> None:
    """Also 1, the end of the last face: a segment before and after the others is never chosen."""
    faces = FACES[[2, 0, 1, 2]]
    points = map_to_surface(VERTICES, faces, torch.tensor([[0.0, 4 / 9, 0.5], [1.0, 4 / 9, 0.5]], dtype=torch.float64))
    torch.testing.assert_close(points, VERTICES[faces[[1, 2]]].mean(dim=1), rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("vertices", "named"),
    [
        (VERTICES * 0, "area"),
        (VERTICES * torch.nan, "NaN"),
    ],
)
def test_invalid_surfaces_are_rejected_by_name(vertices: Tensor, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        sample_surface(vertices, FACES, 5, generator())
