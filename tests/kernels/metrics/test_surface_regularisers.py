"""Regularising losses on a cube."""

import numpy as np
import torch
import trimesh

from pipeline.kernels.geometry.mesh import mesh_edges
from pipeline.kernels.metrics.chamfer import edge_length

CUBE = trimesh.creation.box()
CORNERS = torch.tensor(CUBE.vertices)
EDGES = torch.from_numpy(mesh_edges(np.asarray(CUBE.faces))[0])


def test_a_cube_has_twelve_sides_and_six_diagonals() -> None:
    assert len(EDGES) == 18
    expected = (12 * 1 + 6 * 2) / 18
    np.testing.assert_allclose(edge_length(torch.stack([CORNERS, 3 * CORNERS]), EDGES), [expected, 9 * expected], rtol=1e-12)
