"""Regularising losses on cubes and folded sheets."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh

from pipeline.kernels.metrics.surface_regularisers import bending, edge_length, laplacian, neighbouring_faces, neighbouring_vertices

CUBE = trimesh.creation.box()
CORNERS, FACES = torch.tensor(CUBE.vertices), torch.tensor(CUBE.faces)
EDGES, PAIRS = neighbouring_vertices(CUBE.faces), neighbouring_faces(CUBE.faces)


def test_a_cube_has_twelve_sides_and_six_diagonals() -> None:
    assert len(EDGES) == len(PAIRS) == 18
    expected = (12 * 1 + 6 * 2) / 18
    np.testing.assert_allclose(edge_length(torch.stack([CORNERS, 3 * CORNERS]), EDGES), [expected, 9 * expected], rtol=1e-12)


def test_a_cube_is_bent_at_its_sides_and_flat_at_its_diagonals() -> None:
    np.testing.assert_allclose(bending(CORNERS[None], FACES, PAIRS), [12 / 18], rtol=1e-12)


def test_a_sheet_that_folds_back_is_bent_by_two() -> None:
    sheet = torch.tensor([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.5, 0]], dtype=torch.float64)
    faces = np.array([[0, 1, 2], [1, 0, 3]])
    folded = sheet.clone()
    folded[3] = torch.tensor([0.3, 0.9, 0])
    assert float(bending(folded[None], torch.tensor(faces), neighbouring_faces(faces))) == pytest.approx(2, rel=1e-9)
    folded[3] = torch.tensor([0.5, -1, 0])
    assert float(bending(folded[None], torch.tensor(faces), neighbouring_faces(faces))) == pytest.approx(0, abs=1e-9)


def test_displacements_that_are_alike_have_no_laplacian_and_a_single_one_that_of_a_slow_twin() -> None:
    moved = torch.zeros(2, 8, 3, dtype=torch.float64)
    moved[0] += torch.tensor([1.0, -2, 0.5])
    moved[1, 3] = torch.tensor([0.0, 0, 2])
    neighbours = [[int(b if a == v else a) for a, b in EDGES if v in (a, b)] for v in range(8)]
    alone = np.mean([np.sum((moved[1, v].numpy() - moved[1, own].numpy().mean(axis=0)) ** 2) for v, own in enumerate(neighbours)])
    np.testing.assert_allclose(laplacian(moved, EDGES), [0, alone], atol=1e-15)


def test_a_vertex_without_neighbours_has_no_laplacian() -> None:
    moved = torch.tensor([[[0.0, 0, 0], [0, 0, 0], [5, 5, 5]]], dtype=torch.float64)
    assert float(laplacian(moved, torch.tensor([[0, 1]]))) == 0


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e3])
def test_gradients_are_finite_however_large_the_surface_and_where_faces_have_no_area(size: float) -> None:
    vertices = (size * CORNERS).float()[None].clone()
    vertices[0, 1] = vertices[0, 0]
    vertices.requires_grad_()
    (edge_length(vertices, EDGES) + laplacian(vertices, EDGES) + bending(vertices, FACES, PAIRS)).sum().backward()
    assert vertices.grad is not None
    assert torch.isfinite(vertices.grad).all()


def test_half_precision_is_rejected() -> None:
    for term in (lambda half: edge_length(half, EDGES), lambda half: laplacian(half, EDGES), lambda half: bending(half, FACES, PAIRS)):
        with pytest.raises(ValueError, match="float32 and float64"):
            term(CORNERS[None].half())
