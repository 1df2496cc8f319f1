"""Chamfer distance, points drawn from surfaces and lengths of edges, with their gradients."""

import numpy as np
import pytest
import torch
import trimesh
from scipy import stats
from torch import Tensor

from pipeline.kernels.geometry.mesh import mesh_edges
from pipeline.kernels.metrics import chamfer as chamfer_module
from pipeline.kernels.metrics.chamfer import SearchCloud, chamfer, edge_length, map_to_surface, sample_surface, squared_distances


def cloud(count: int, seed: int, scale: float = 0.25, dtype: torch.dtype = torch.float64) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    points = torch.randn(count, 3, generator=generator, dtype=torch.float64)
    return (scale * points / points.norm(dim=1, keepdim=True) + torch.tensor([0.0, 0.0, 0.6])).to(dtype)


def brute(a: Tensor, b: Tensor) -> Tensor:
    """Compute the definition: all pairs, the least of each row and column."""
    pairs = ((a[:, None, :] - b[None, :, :]) ** 2).sum(-1)
    return pairs.min(dim=1).values.mean() + pairs.min(dim=0).values.mean()


def gradients(distance: Tensor, *clouds: Tensor) -> list[Tensor]:
    return list(torch.autograd.grad(distance, clouds))


@pytest.mark.parametrize(("count", "other"), [(1, 1), (1, 7), (300, 1), (1000, 700)])
def test_chamfer_and_gradients_equal_brute_force(count: int, other: int) -> None:
    a, b = cloud(count, 1).requires_grad_(), cloud(other, 2).requires_grad_()
    fast, slow = chamfer(a, b), brute(a, b)
    torch.testing.assert_close(fast, slow, rtol=1e-13, atol=0)
    for mine, theirs in zip(gradients(fast, a, b), gradients(slow, a, b), strict=True):
        torch.testing.assert_close(mine, theirs, rtol=1e-12, atol=1e-18)


def test_chamfer_gradient_equals_the_numerical_one() -> None:
    a, b = cloud(9, 3).requires_grad_(), cloud(6, 4).requires_grad_()
    assert torch.autograd.gradcheck(chamfer, (a, b))
    assert torch.autograd.gradcheck(squared_distances, (a, b))


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_gpu_agrees_with_cpu(dtype: torch.dtype) -> None:
    clouds = cloud(10_000, 12, dtype=dtype), cloud(10_000, 13, dtype=dtype)
    here = [points.requires_grad_() for points in clouds]
    there = [points.detach().cuda().requires_grad_() for points in clouds]
    torch.testing.assert_close(chamfer(*there).cpu(), chamfer(*here), rtol=1e-5, atol=0)
    for mine, theirs in zip(gradients(chamfer(*there), *there), gradients(chamfer(*here), *here), strict=True):
        torch.testing.assert_close(mine.cpu(), theirs, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (torch.zeros(0, 3), "no points"),
        (torch.zeros(4, 2), r"shape \(4, 2\)"),
        (torch.zeros(1, 4, 3), r"shape \(1, 4, 3\)"),
        (torch.tensor([[0.0, 0, np.nan], [0, 0, 0]]), "1 of 2 points"),
        (torch.tensor([[0.0, 0, np.inf]]), "infinity"),
    ],
)
def test_invalid_clouds_are_rejected_by_name(points: Tensor, message: str) -> None:
    good = torch.zeros(5, 3)
    for call in (
        lambda: chamfer(points, good),
        lambda: chamfer(good, points),
        lambda: squared_distances(points, good),
        lambda: SearchCloud(points).nearest(good),
    ):
        with pytest.raises(ValueError, match=message):
            call()


@pytest.mark.parametrize("pairs", [chamfer_module.PAIRS_PER_BLOCK, 16 * 40])
def test_tree_and_pairwise_search_find_equally_near_points(pairs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chamfer_module, "PAIRS_PER_BLOCK", pairs)  # all at once, and in blocks of 16 queries
    draw = np.random.default_rng(1)
    points, queries = (torch.from_numpy(draw.normal(size=(count, 3))) for count in (40, 70))
    nearest = SearchCloud(points).nearest(queries), chamfer_module.nearest_of_pairs(queries, points)
    torch.testing.assert_close(*((queries - points[found]).norm(dim=1) for found in nearest))


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
    ("vertices", "faces", "named"),
    [
        (VERTICES, FACES[:0], "area"),
        (VERTICES * 0, FACES, "area"),
        (VERTICES * torch.nan, FACES, "NaN"),
    ],
)
def test_invalid_surfaces_are_rejected_by_name(vertices: Tensor, faces: Tensor, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        sample_surface(vertices, faces, 5, generator())


CUBE = trimesh.creation.box()
CORNERS = torch.tensor(CUBE.vertices)
EDGES = torch.from_numpy(mesh_edges(np.asarray(CUBE.faces))[0])


def test_a_cube_has_twelve_sides_and_six_diagonals() -> None:
    assert len(EDGES) == 18
    expected = (12 * 1 + 6 * 2) / 18
    np.testing.assert_allclose(edge_length(torch.stack([CORNERS, 3 * CORNERS]), EDGES), [expected, 9 * expected], rtol=1e-12)
