"""Normalisation: axis, scale and position."""

import numpy as np
import pytest
import trimesh

from pipeline.errors import InvalidInput
from pipeline.kernels.geometry.mesh import Mesh
from pipeline.kernels.geometry.mesh_cleaning import normalise_mesh

BALL = trimesh.creation.icosphere(subdivisions=2)


@pytest.mark.parametrize(("up", "axis"), [("x", 0), ("y", 1), ("z", 2)])
def test_stated_axis_points_up_without_mirroring(up, axis):
    corner = trimesh.creation.box((0.1, 0.1, 0.1))
    vertices = np.vstack([corner.vertices, np.eye(3)[axis]])
    tall = Mesh.bare(vertices, np.vstack([corner.faces, [0, 1, 8]]))
    placed, _ = normalise_mesh(tall, up=up, diagonal=0.5, metres_per_unit=1.0)
    assert placed.vertices[8, 2] == pytest.approx(placed.vertices[:, 2].max())
    before, after = (np.linalg.det(mesh.triangles[0] - mesh.vertices[8]) for mesh in (tall, placed))
    assert after == pytest.approx(before)


@pytest.mark.parametrize(
    ("vertices", "message"),
    [(np.zeros((0, 3)), "no vertices"), (np.ones((4, 3)), "4 vertices"), (np.array([[0, 0, np.nan], [1, 1, 1]]), "1 of 2")],
)
def test_normalise_rejects_mesh_without_size(vertices, message) -> None:
    with pytest.raises(InvalidInput, match=message):
        normalise_mesh(Mesh.bare(vertices, np.zeros((0, 3))), up="z", diagonal=0.5)


@pytest.mark.parametrize("up", ["x", "y", "z"])
@pytest.mark.parametrize("metres_per_unit", [None, 0.01])
def test_transform_places_the_mesh(up, metres_per_unit):
    mesh = Mesh.bare(BALL.vertices * [1, 2, 3] + [5, -3, 1], BALL.faces)
    how = {"up": up, "diagonal": 0.5, "metres_per_unit": metres_per_unit}
    placed, placement = normalise_mesh(mesh, **how)
    np.testing.assert_allclose(mesh.vertices @ placement[:3, :3].T + placement[:3, 3], placed.vertices, atol=1e-14)
    assert placement[3].tolist() == [0, 0, 0, 1]
