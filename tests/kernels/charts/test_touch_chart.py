"""The touch chart's topology."""

import pytest
import torch

from pipeline.kernels.charts.touch_chart import chart_square


def test_default_chart_is_that_of_the_supplement() -> None:
    vertices, faces = chart_square()
    assert vertices.shape == (81, 3)
    assert vertices.dtype == torch.float64
    assert faces.shape == (128, 3)
    assert vertices.min(dim=0).values.tolist() == [-0.5, -0.5, 0]
    assert vertices.max(dim=0).values.tolist() == [0.5, 0.5, 0]
    assert vertices[40].tolist() == [0, 0, 0]
    assert vertices[1].tolist() == [-0.375, -0.5, 0]  # x runs along a row
    assert chart_square(9, aspect=1.5)[0].max(dim=0).values.tolist() == [0.5, 0.75, 0]


@pytest.mark.parametrize("side", [3, 5, 9])
def test_faces_cover_the_square_once_and_look_up(side: int) -> None:
    vertices, faces = chart_square(side)
    a, b, c = vertices[faces].unbind(dim=1)
    normals = torch.linalg.cross(b - a, c - a)
    assert (normals[:, 2] > 0).all()
    torch.testing.assert_close(normals[:, 2].sum() / 2, torch.tensor(1.0, dtype=torch.float64))
    edges = {tuple(sorted(edge)) for face in faces.tolist() for edge in zip(face, face[1:] + face[:1], strict=True)}
    assert len(vertices) - len(edges) + len(faces) == 1  # Euler characteristic of a disc
    assert set(faces.flatten().tolist()) == set(range(side * side))


@pytest.mark.parametrize("side", [-1, 0, 1, 2, 8])
def test_chart_square_rejects_even_or_small_sides(side: int) -> None:
    with pytest.raises(ValueError, match=f"it is {side}"):
        chart_square(side)
