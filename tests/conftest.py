"""What tests of several areas share: meshes with known answers, and a small artifact with a stage that makes it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from pipeline.kernels.geometry.mesh import Mesh


def mesh_of(*parts: trimesh.Trimesh) -> Mesh:
    """Some of trimesh's shapes as one mesh."""
    whole = trimesh.util.concatenate(parts)
    return Mesh.bare(whole.vertices, whole.faces)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)
