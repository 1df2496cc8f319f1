"""Rows of `sample-distances` agree with the meshes of `sample-surfaces`."""

import numpy as np

from pipeline.dataset.mesh_rows import read_mesh
from pipeline.dataset.object_rows import ObjectRows
from pipeline.kernels.geometry.signed_distance import signed_distances
from pipeline.store.directory import DataDirectory
from schemas.surfaces import SURFACES
from tests.stages.tiny_dataset import manifest, run_stage


def test_stored_distances_are_those_of_the_stored_points(tmp_path):
    objects = manifest()
    for stage in ("sample-surfaces", "sample-distances"):
        run_stage(tmp_path, stage, objects, "sample-distances.queries=3000")
    rows = ObjectRows(tmp_path, ["query_points", "signed_distance", "points"], None)
    surfaces = DataDirectory(tmp_path).collection(SURFACES)
    for name in rows.object_ids:
        mesh, queries, stored = read_mesh(surfaces.view(name)), rows.read("query_points", name), rows.read("signed_distance", name)
        assert queries.shape == (3000, 3)
        np.testing.assert_allclose(stored, signed_distances(queries.astype(np.float64), mesh.vertices, mesh.faces), atol=1e-7)
        assert 0.1 < (stored < 0).mean() < 0.6
        assert np.abs(queries - [0, 0, 0.6]).max() < 0.6
    assert not np.array_equal(*(rows.read("query_points", name) for name in rows.object_ids[:2]))
