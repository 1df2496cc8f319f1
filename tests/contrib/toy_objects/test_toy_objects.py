"""Procedural objects: closed outward-wound parts, determined by the seed, all different."""

import hashlib
import os
import subprocess
import sys
from math import inf
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pipeline.contrib.toy_objects.model import Model
from pipeline.contrib.toy_objects.solids import Material, rod
from pipeline.contrib.toy_objects.source import MAKERS, generate
from pipeline.kernels.geometry.mesh import Mesh, face_cross_products

ROOT = Path(__file__).parents[2]
SEEDS = 20
CATEGORIES = [*MAKERS]
KIND_NUMBERS = [pytest.param(c, k, id=f"{c}-{kind.__name__}") for c, maker in MAKERS.items() for k, kind in enumerate(maker.kinds)]


def draw(category: str, seed: int, kind: int | None = None) -> Mesh:
    return generate(category, np.random.default_rng(seed), kind)


def digest(mesh: Mesh) -> str:
    look = mesh.look
    arrays = (mesh.vertices, mesh.faces, look.uv, look.face_material, look.base_color, look.material_texture, *look.textures)
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()


def parts(mesh: Mesh) -> np.ndarray:
    """(F,) the connected part of every face."""
    f = mesh.faces
    links = coo_array((np.ones(2 * len(f)), (f[:, [0, 1]].ravel(), f[:, [1, 2]].ravel())), shape=(len(mesh.vertices),) * 2)
    label: np.ndarray = connected_components(links, directed=False)[1]
    return label[f[:, 0]]


def check(mesh: Mesh) -> None:
    """Check all properties that every object must have."""
    vertices, faces, look = mesh.vertices, mesh.faces, mesh.look
    assert vertices.dtype == np.float64
    assert faces.dtype == np.int32
    assert np.isfinite(vertices).all()
    assert 500 <= len(faces) <= 15_000
    assert np.array_equal(np.unique(faces), np.arange(len(vertices)))

    # every directed edge once, and its reverse once: closed, manifold, consistently wound
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    there, back = edges @ [len(vertices), 1], edges @ [1, len(vertices)]
    assert len(np.unique(there)) == len(there)
    assert np.array_equal(np.sort(there), np.sort(back))

    # outward: each part's signed volume is positive
    part = parts(mesh)
    first = np.unique(part, return_index=True)[1]  # parts are numbered from 0 without gaps
    corners = mesh.triangles - vertices[faces[first, 0]][part][:, None]
    volume = np.bincount(part, np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])))
    assert (volume > 0.0).all()

    # no face so flat that float32 at the stored size would lose it: its height over its longest side
    diagonal = np.linalg.norm(np.ptp(vertices, axis=0))
    longest = np.linalg.norm(mesh.triangles - np.roll(mesh.triangles, 1, axis=1), axis=2).max(axis=1)
    height = np.linalg.norm(face_cross_products(mesh.triangles), axis=1) / longest
    assert height.min() > 1e-5 * diagonal

    assert look.uv.shape == (len(vertices), 2)
    assert look.uv.dtype == np.float32
    assert look.uv.min() >= 0.0
    assert look.uv.max() <= 1.0
    assert look.face_material.shape == (len(faces),)
    assert np.array_equal(np.unique(look.face_material), np.arange(len(look.base_color)))
    assert look.base_color.shape[1] == 4
    assert look.base_color.dtype == np.uint8
    assert look.material_texture.shape == (len(look.base_color),)
    assert set(look.material_texture[look.material_texture >= 0]) == set(range(len(look.textures)))
    assert all(t.dtype == np.uint8 and t.ndim == 3 and t.shape[2] == 4 for t in look.textures)
    assert len(look.base_color) >= 2


@pytest.mark.parametrize(("category", "kind"), KIND_NUMBERS)
def test_every_kind_has_closed_outward_parts_and_a_consistent_look(category: str, kind: int) -> None:
    for seed in range(3):
        check(draw(category, 1000 + seed, kind))


@pytest.mark.slow
@pytest.mark.parametrize("category", CATEGORIES)
def test_many_objects_have_closed_outward_parts_and_a_consistent_look(category: str) -> None:
    for seed in range(500):
        check(draw(category, seed))


@pytest.mark.parametrize("category", CATEGORIES)
def test_object_follows_from_the_seed(category: str) -> None:
    assert digest(draw(category, 7)) == digest(draw(category, 7)) != digest(draw(category, 8))


PRINT_DIGEST = """
import hashlib
from tests.contrib.toy_objects.test_toy_objects import CATEGORIES, MAKERS, digest, draw
digests = [digest(draw(c, k, k)) for c in CATEGORIES for k in range(len(MAKERS[c].kinds))]
print("digest", hashlib.sha256("".join(digests).encode()).hexdigest())
"""


def test_meshes_are_the_same_bytes_without_vector_instructions() -> None:
    fewer = {
        "NPY_DISABLE_CPU_FEATURES": " ".join(numpy_dispatched_features()),
        "OPENBLAS_CORETYPE": "Prescott",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
    }
    outputs = [
        subprocess.run([sys.executable, "-c", PRINT_DIGEST], cwd=ROOT, env={**os.environ, **extra}, stdout=subprocess.PIPE, check=True)
        for extra in ({}, fewer)
    ]
    assert outputs[0].stdout == outputs[1].stdout != b""


def numpy_dispatched_features() -> list[str]:
    """List the features of this processor for which numpy has separate code."""
    features = np._core._multiarray_umath.__cpu_features__  # type: ignore[attr-defined]
    return [name for name in np._core._multiarray_umath.__cpu_dispatch__ if features.get(name)]  # type: ignore[attr-defined]


@pytest.mark.parametrize("category", CATEGORIES)
def test_objects_of_a_class_differ_in_shape_and_number_of_parts(category: str) -> None:
    meshes = [draw(category, seed) for seed in range(SEEDS)]
    extents = np.array([np.ptp(m.vertices, axis=0) for m in meshes])
    shape = extents / np.linalg.norm(extents, axis=1, keepdims=True)
    apart = np.abs(shape[:, None] - shape[None]).max(axis=2) + np.eye(SEEDS)
    assert apart.min() > 1e-4  # of the diagonal
    assert len({len(np.unique(parts(m))) for m in meshes}) >= 4


@pytest.mark.parametrize("category", CATEGORIES)
def test_long_side_lies_along_the_axis_of_the_class_and_has_a_real_size(category: str) -> None:
    axis, low, high = {
        "bottle": (2, 0.05, 0.4),
        "cellphone": (2, 0.09, 0.35),
        "knife": (1, 0.13, 0.45),
        "rifle": (1, 0.6, 1.6),
        "brush": (1, 0.08, 0.45),
        "hammer": (1, 0.15, 0.6),
        "screwdriver": (1, 0.07, 0.45),
    }.get(category, (None, 0.03, 0.5))
    for seed in range(SEEDS):
        mesh = draw(category, seed)
        extent = np.ptp(mesh.vertices, axis=0)
        assert mesh.look.textures or category not in ("bottle", "cellphone")
        assert axis is None or extent.argmax() == axis
        assert low < extent.max() < high


@pytest.mark.parametrize("category", CATEGORIES)
def test_module_of_a_class_imports_no_other_classes_module(category: str) -> None:
    module = MAKERS[category].__module__
    imported = {getattr(value, "__module__", None) for value in vars(sys.modules[module]).values()}
    assert not imported & {maker.__module__ for maker in MAKERS.values()} - {module}


@pytest.mark.parametrize(
    ("start", "end", "expected"),
    [(-inf, inf, (-20.0, 0.0, 40.0)), (10.0, inf, (-10.0, 0.0, 30.0)), (-inf, -5.0, (-15.0, 0.0, 20.0)), (5.0, 10.0, (-10.0, 0.0, 25.0))],
)
def test_stretch_scales_between_two_positions_and_shifts_vertices_beyond(start, end, expected) -> None:
    model = Model(np.random.default_rng(0))
    model.add(Material((1, 2, 3)), rod(-10, 0, 3), rod(0, 20, 3))
    model.stretch("x", start, end, 2.0)
    first, second = (solid.vertices[:, 0] for solid in model.solids)
    assert (first.min(), first.max(), second.max()) == expected
    assert second.min() == 0.0
    assert model.solids[0].vertices[:, 2].max() == pytest.approx(3.0, rel=0.02)
