"""The procedural objects: closed parts, outward faces, one seed one object, and no two alike."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pipeline.kernels.geometry.mesh import Mesh, face_cross_products
from pipeline.toy_objects import CATEGORIES, bottle, cellphone, generate, knife, rifle

SEEDS = 20
MODULES = {"bottle": bottle, "cellphone": cellphone, "knife": knife, "rifle": rifle}
KINDS = [pytest.param(c, k, id=f"{c}-{kind.__name__}") for c, m in MODULES.items() for k, kind in enumerate(m.KINDS)]


def draw(category: str, seed: int) -> Mesh:
    return generate(category, np.random.default_rng(seed))


def parts(mesh: Mesh) -> np.ndarray:
    """(F,) the connected part of every face."""
    f = mesh.faces
    links = coo_array((np.ones(2 * len(f)), (f[:, [0, 1]].ravel(), f[:, [1, 2]].ravel())), shape=(len(mesh.vertices),) * 2)
    label: np.ndarray = connected_components(links, directed=False)[1]
    return label[f[:, 0]]


def check(mesh: Mesh) -> None:
    """Everything that holds of each object, whatever its kind."""
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


@pytest.mark.parametrize("category", CATEGORIES)
def test_sound(category: str) -> None:
    for seed in range(SEEDS):
        check(draw(category, seed))


@pytest.mark.parametrize(("category", "kind"), KINDS)
def test_every_kind_is_sound(category: str, kind: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(MODULES[category], "KINDS", (MODULES[category].KINDS[kind],))
    for seed in range(4):
        check(draw(category, 1000 + seed))


@pytest.mark.slow
@pytest.mark.parametrize("category", CATEGORIES)
def test_sound_many(category: str) -> None:
    for seed in range(500):
        check(draw(category, seed))


@pytest.mark.parametrize("category", CATEGORIES)
def test_one_seed_one_object(category: str) -> None:
    a, b, other = draw(category, 7), draw(category, 7), draw(category, 8)
    assert a.vertices.tobytes() == b.vertices.tobytes()
    assert a.faces.tobytes() == b.faces.tobytes()
    for name in ("uv", "face_material", "base_color", "material_texture"):
        assert getattr(a.look, name).tobytes() == getattr(b.look, name).tobytes()
    assert [t.tobytes() for t in a.look.textures] == [t.tobytes() for t in b.look.textures]
    assert a.vertices.tobytes() != other.vertices.tobytes()


@pytest.mark.parametrize("category", CATEGORIES)
def test_no_two_alike(category: str) -> None:
    meshes = [draw(category, seed) for seed in range(SEEDS)]
    extents = np.array([np.ptp(m.vertices, axis=0) for m in meshes])
    shape = extents / np.linalg.norm(extents, axis=1, keepdims=True)
    apart = np.abs(shape[:, None] - shape[None]).max(axis=2) + np.eye(SEEDS)
    assert apart.min() > 1e-4  # of the diagonal
    counts = {len(np.unique(parts(m))) for m in meshes}
    assert len(counts) >= 6


@pytest.mark.parametrize("category", CATEGORIES)
def test_long_side_and_real_size(category: str) -> None:
    axis, low, high = {
        "bottle": (2, 0.05, 0.4),
        "cellphone": (2, 0.09, 0.35),
        "knife": (1, 0.13, 0.45),
        "rifle": (1, 0.6, 1.6),
    }[category]
    for seed in range(SEEDS):
        extent = np.ptp(draw(category, seed).vertices, axis=0)
        assert extent.argmax() == axis
        assert low < extent[axis] < high


@pytest.mark.parametrize("category", ["bottle", "cellphone"])
def test_some_wear_pictures(category: str) -> None:
    assert sum(bool(draw(category, seed).look.textures) for seed in range(SEEDS)) >= 0.9 * SEEDS


def test_unknown_category_names_the_known() -> None:
    with pytest.raises(ValueError, match=r"'spoon'; known: bottle, cellphone, knife, rifle"):
        generate("spoon", np.random.default_rng(0))
