"""Meshes as rows of arrays."""

import trimesh

from pipeline.dataset.mesh_rows import mesh_row, read_mesh
from pipeline.kernels.geometry.mesh import Mesh

BALL = trimesh.creation.icosphere(subdivisions=2)


def test_mesh_row_round_trip_keeps_all_bits() -> None:
    mesh = Mesh.bare(BALL.vertices * 1e-3 + 1e3, BALL.faces)
    restored = read_mesh(mesh_row(mesh))
    assert restored.triangles.tobytes() == mesh.triangles.tobytes()
    assert restored.look.textures == ()
