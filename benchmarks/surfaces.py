"""Measure points on the outside of meshes beside trimesh's sampling and voxel carving."""

from collections.abc import Callable
from pathlib import Path
from statistics import median

import igl
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.cases import touched_objects
from benchmarks.timing import Table, over_items, quantiles, side_by_side, single_call, three_digits
from pipeline.dataset.mesh_rows import read_mesh
from pipeline.kernels.geometry.exterior_sampling import MIN_ESCAPES, RayScene, sample_exterior, spread_directions
from pipeline.kernels.geometry.mesh import Mesh, face_cross_products
from pipeline.store.directory import DataDirectory
from schemas.surfaces import SURFACES

POINTS = 10_000
JUDGES = 2048
"""Directions that decide whether a place sees the outside: eight times those of the sampler."""
FAR = 0.01
"""m: an exterior place without a point within this distance is missed. 10,000 points on 0.25 m² leave a share of 3e-6 that far from all."""
VOXELS = (64, 128)
"""Along the object's longest side."""
OURS = "exterior samples (ours)"
Sampler = Callable[[Mesh], NDArray[np.float64]]


def measure(data: Path, turns: int) -> Table:
    """Measure every sampler on the dataset's cases, and ours on all its objects; `turns` rounds each."""
    cases = touched_objects(data)
    table = Table(
        f"{POINTS:,} surface points",
        ["ms per object", "÷ ours", "off the surface, µm: median / 99 % / most", "hidden inside, %", "exterior missed, %"],
        [
            f"Mean of {', '.join(case.name for case in cases)}. Processor milliseconds of one core, least / median; ratios of the least.",
            f"Hidden: the nearest place of the mesh sees the outside in fewer than {MIN_ESCAPES} of {JUDGES:,} directions, by the same "
            "test as our sampler's with eight times the directions, so that ours is not judged by its own rays alone. Missed: of so judged "
            f"exterior places, those with no point within {1e3 * FAR:g} mm.",
            "Not comparable: trimesh's sampling gives points on any face, as asked. Carving voxels (trimesh's `voxelized`, "
            "`fill('orthographic')`, `marching_cubes`) makes a closed solid without hollows, about half a voxel too large.",
        ],
    )
    samplers: dict[str, Sampler] = {
        OURS: lambda mesh: sample_exterior(mesh, POINTS, np.random.default_rng(0))[0],
        "trimesh.sample": lambda mesh: _anywhere(_trimesh(mesh)),
        **{f"voxel carving, {n}³": lambda mesh, n=n: _carved(mesh, n) for n in VOXELS},
    }
    meshes = [case.mesh for case in cases]
    times = side_by_side({name: over_items(sampler, meshes) for name, sampler in samplers.items()}, turns)
    for name, sampler in samplers.items():
        judged = [_judge(mesh, sampler(mesh)) for mesh in meshes]
        deviations = quantiles(np.concatenate([errors for errors, _, _ in judged]))
        shares = [three_digits(100 * float(np.mean([row[k] for row in judged]))) for k in (1, 2)]
        table.add(name, times[name], times[name].over(times[OURS]), deviations, *shares)
    surfaces = DataDirectory(data).collection(SURFACES)
    meshes_by_name = {name: read_mesh(surfaces.view(name)) for name in surfaces if surfaces.view(name)["ok"]}
    ours = side_by_side({name: single_call(lambda mesh=mesh: samplers[OURS](mesh)) for name, mesh in meshes_by_name.items()}, turns)
    worst = max(ours, key=lambda name: ours[name].least)
    middle = median(measured.least for measured in ours.values())
    note = f"Ours, of all {len(ours)} objects: median {three_digits(middle)} ms, worst {three_digits(ours[worst].least)} ms ({worst})."
    table.notes = [*table.notes, note]
    return table


def _anywhere(mesh: trimesh.Trimesh) -> NDArray[np.float64]:
    return np.asarray(trimesh.sample.sample_surface(mesh, POINTS, seed=0)[0], np.float64)


def _carved(mesh: Mesh, voxels: int) -> NDArray[np.float64]:
    solid = _trimesh(mesh)
    grid = solid.voxelized(float(solid.extents.max()) / voxels).fill("orthographic")
    surface = grid.marching_cubes  # in voxels' indices
    surface.apply_transform(grid.transform)
    return _anywhere(surface)


def _trimesh(mesh: Mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


def _judge(mesh: Mesh, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, float]:
    """Compute distances off the surface, µm; the share of points hidden inside; the share of exterior places missed."""
    squared, face, nearest = igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces.astype(np.int64))
    places = sample_exterior(mesh, POINTS, np.random.default_rng(1), directions=JUDGES)[0]
    gaps, _ = cKDTree(points).query(places)
    return 1e6 * np.sqrt(squared), float(np.mean(~sees_outside(mesh, nearest, face))), float(np.mean(gaps > FAR))


def sees_outside(mesh: Mesh, places: NDArray[np.float64], face: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Judge along `JUDGES` directions whether each place (N, 3) on a face (N,) of the mesh is exterior."""
    vectors = face_cross_products(mesh.triangles)
    normals = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    scene = RayScene(mesh.vertices, mesh.faces)
    front, back = scene.count_escapes(np.ascontiguousarray(places), normals[face], spread_directions(JUDGES))
    return np.asarray(front + back >= MIN_ESCAPES)
