"""Points on the outside of a mesh: beside trimesh's sampling and voxel carving."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import igl
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.peers.cases import Case
from benchmarks.peers.table import Table
from benchmarks.timing import each, side_by_side, three_digits
from pipeline.kernels.geometry.exterior_sampling import MIN_ESCAPES, EscapeTest, sample_exterior
from pipeline.kernels.geometry.mesh import Mesh, face_cross_products

POINTS = 10_000
JUDGES = 2048
"""Directions that decide whether a place sees the outside: eight times those that the sampler looks along."""
FAR = 0.01
"""m: an exterior place with no point so near is missed. 10,000 points drawn from 0.25 m² leave 3e-6 of it so far from all."""
VOXELS = (64, 128)
"""Along the object's longest side."""
OURS = "exterior samples (ours)"
UM = 1e6
Sampler = Callable[[Mesh], NDArray[np.float64]]


def measure(cases: Sequence[Case], turns: int) -> Table:
    """The table, over all cases; `turns` rounds of every sampler."""
    table = Table(
        f"{POINTS:,} surface points",
        ["ms per object", "÷ ours", "off the surface, µm: median / 99 % / most", "hidden inside, %", "exterior missed, %"],
        [
            f"Mean of {', '.join(case.name for case in cases)}. Processor milliseconds of one core, least / median; ratios of the least.",
            f"Hidden: the nearest place of the mesh sees the outside in fewer than {MIN_ESCAPES} of {JUDGES:,} directions, by the same "
            "test as our sampler's with eight times the directions, so that ours is not judged by its own rays alone. Missed: of so judged "
            f"exterior places, those with no point within {1e3 * FAR:g} mm.",
            "Not comparable: trimesh's sampling is asked for points on any face and gives that. Carving voxels is trimesh's `voxelized`, "
            "`fill('orthographic')`, `marching_cubes`, samples of that: it makes a closed solid, as our samples are not, closes "
            "every hollow that no axis looks into, and lies about half a voxel outside.",
        ],
    )
    samplers: dict[str, Sampler] = {OURS: _exterior, "trimesh.sample": _anywhere}
    try:
        import skimage.measure  # noqa: F401  marching cubes

        samplers |= {f"voxel carving, {n}³": lambda mesh, n=n: _carved(mesh, n) for n in VOXELS}
    except ImportError as error:
        for n in VOXELS:
            table.could_not_run(f"voxel carving, {n}³", f"{error}; `make bench-peers` installs it")
    meshes = [case.mesh for case in cases]
    times = side_by_side({name: each(sampler, meshes) for name, sampler in samplers.items()}, turns)
    for name, sampler in samplers.items():
        judged = [_judge(mesh, sampler(mesh)) for mesh in meshes]
        off = np.concatenate([errors for errors, _, _ in judged])
        hidden, missed = (100 * float(np.mean([shares[k] for shares in judged])) for k in (1, 2))
        quantiles = " / ".join(three_digits(float(np.quantile(off, q))) for q in (0.5, 0.99, 1))
        ratio = times[name].least / times[OURS].least
        table.add(name, str(times[name]), f"{ratio:.2f}", quantiles, three_digits(hidden), three_digits(missed))
    return table


def _exterior(mesh: Mesh) -> NDArray[np.float64]:
    return sample_exterior(mesh, POINTS, np.random.default_rng(0))[0]


def _anywhere(mesh: Mesh) -> NDArray[np.float64]:
    points, _ = trimesh.sample.sample_surface(_trimesh(mesh), POINTS, seed=0)
    return np.asarray(points, np.float64)


def _carved(mesh: Mesh, voxels: int) -> NDArray[np.float64]:
    solid = _trimesh(mesh)
    grid = solid.voxelized(float(solid.extents.max()) / voxels).fill("orthographic")
    surface = grid.marching_cubes  # in voxels' indices
    surface.apply_transform(grid.transform)
    points, _ = trimesh.sample.sample_surface(surface, POINTS, seed=0)
    return np.asarray(points, np.float64)


def _trimesh(mesh: Mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


def _judge(mesh: Mesh, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, float]:
    """Distances off the surface, µm; the share of points hidden inside; the share of exterior places missed."""
    squared, face, nearest = igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces.astype(np.int64))
    places = sample_exterior(mesh, POINTS, np.random.default_rng(1), directions=JUDGES)[0]
    gaps, _ = cKDTree(points).query(places)
    return UM * np.sqrt(squared), float(np.mean(~sees_outside(mesh, nearest, face))), float(np.mean(gaps > FAR))


def sees_outside(mesh: Mesh, places: NDArray[np.float64], face: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each place (N, 3) on a face (N,) of the mesh is exterior, judged along `JUDGES` directions."""
    vectors = face_cross_products(mesh.triangles)
    normals = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    front, back = EscapeTest(mesh, JUDGES).count(np.ascontiguousarray(places), normals[face])
    return np.asarray(front + back >= MIN_ESCAPES)
