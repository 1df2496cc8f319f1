"""Primitives of a mesh for the renderer: geometry, colours, textures; and shading normals, of badly shaped meshes too."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from pipeline.kernels.geometry.mesh import Look, Mesh, face_cross_products
from pipeline.kernels.vision import primitives as module
from pipeline.kernels.vision.primitives import MAX_TEXTURE_SIDE, corner_normals, flatten_texture, mesh_primitives, shrink_texture
from tests.kernels.vision.shapes import CENTRE, ball, box, half_turned
from tests.references.slow_corner_normals import slow_corner_normals
from tests.strategies import random_rotation

BOX = trimesh.creation.box()


def test_mesh_without_faces_has_no_primitives() -> None:
    assert mesh_primitives(Mesh.bare(np.zeros((0, 3)), np.zeros((0, 3)))) == []


def test_corners_and_texture_coordinates_that_are_not_finite_are_refused() -> None:
    mesh = Mesh.bare(BOX.vertices, BOX.faces)
    for bad in (
        Mesh.bare(np.where(BOX.vertices > 0, np.nan, BOX.vertices), BOX.faces),
        replace(mesh, look=replace(mesh.look, uv=np.full((8, 2), np.inf, np.float32))),
    ):
        with pytest.raises(ValueError, match="NaN or infinite corners or texture coordinates"):
            mesh_primitives(bad)


def test_positions_are_rounded_to_float32_and_faces_doubled(rng) -> None:
    vertices = BOX.vertices @ random_rotation(rng).T + [80, -3, 0.6]
    (part,) = mesh_primitives(Mesh.bare(vertices, BOX.faces))
    twice = part.positions[part.indices].astype(np.float64)  # (2F, 3, xyz), a face and its reverse
    np.testing.assert_array_equal(twice[::2], twice[1::2, ::-1])
    exact = vertices[BOX.faces]
    assert np.abs(twice[::2] - exact).max() <= np.spacing(np.float32(np.abs(exact).max())) / 2
    assert np.abs(np.linalg.norm(part.normals.astype(np.float64), axis=1) - 1).max() <= 2.0**-23
    assert (np.einsum("fci,fi->fc", part.normals[part.indices[::2]], face_cross_products(exact)) > 0.99).all()


def test_colours_are_converted_to_linear_light() -> None:
    """Black is 0, white 1, every step up; and back to the same 8 bits."""
    greys = np.arange(256, dtype=np.uint8)
    faces = np.repeat(BOX.faces[:1], 256, axis=0)
    look = replace(Look.plain(len(BOX.vertices), 256), face_material=np.arange(256, dtype=np.int32))
    look = replace(look, base_color=np.repeat(greys[:, None], 4, axis=1), material_texture=np.full(256, -1, np.int32))
    light = np.array([part.color[0] for part in mesh_primitives(Mesh(BOX.vertices, faces, look))])
    assert (light[0], light[255]) == (0, 1)
    assert (np.diff(light) > 0).all()
    srgb = np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
    np.testing.assert_array_equal(np.rint(255 * srgb), greys)


@pytest.mark.parametrize("value", [0, 255])
@pytest.mark.parametrize("alpha", [0, 1, 128, 254, 255])
def test_transparent_textures_are_blended_with_white(value, alpha) -> None:
    picture = np.full((5, 4, 4), value, np.uint8)
    picture[..., 3] = alpha
    solid = flatten_texture(picture)
    assert (solid[..., 3] == 255).all()
    assert (solid[..., :3] == round(value * alpha / 255 + 255 - alpha)).all()
    assert picture[0, 0, 3] == alpha  # the caller's is as it was


@pytest.mark.parametrize("shape", [(1, 1), (1, MAX_TEXTURE_SIDE), (MAX_TEXTURE_SIDE + 1, 1), (1, 9 * MAX_TEXTURE_SIDE + 5)])
@pytest.mark.parametrize("value", [0, 255])
def test_large_textures_are_shrunk_and_keep_their_colour(shape, value) -> None:
    small = shrink_texture(np.full((*shape, 4), value, np.uint8))
    assert 1 <= max(small.shape[:2]) <= MAX_TEXTURE_SIDE
    assert min(small.shape[:2]) == 1
    assert (small == value).all()


def test_corner_normals_equal_the_slow_twins() -> None:
    mesh = half_turned(ball(subdivisions=1))
    soup = mesh.vertices[mesh.faces].reshape(-1, 3)  # every corner its own vertex
    faces = np.arange(len(soup), dtype=np.int32).reshape(-1, 3)
    assert corner_normals(soup, faces) == pytest.approx(slow_corner_normals(soup, faces, module.CREASE), abs=1e-12)


def test_ball_is_smooth_and_box_has_edges() -> None:
    mesh = ball(subdivisions=3)
    outward = mesh.vertices[mesh.faces] - CENTRE
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    assert np.einsum("fci,fci->fc", corner_normals(mesh.vertices, mesh.faces), outward).min() > 0.9999
    edged = box()
    normals = corner_normals(edged.vertices, edged.faces)
    assert normals == pytest.approx(np.repeat(normals[:, :1], 3, axis=1), abs=1e-12)


def test_hubs_and_faces_without_area_have_unit_normals() -> None:
    ring = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    vertices = np.vstack([[0, 0, 1.0], np.column_stack([np.cos(ring), np.sin(ring), 0 * ring])])
    faces = np.column_stack([np.zeros(1000), np.arange(1000) + 1, np.roll(np.arange(1000) + 1, -1)]).astype(np.int32)
    faces = np.vstack([faces, [[1, 1, 2]]]).astype(np.int32)
    normals = corner_normals(vertices, faces)
    assert np.linalg.norm(normals, axis=-1) == pytest.approx(np.ones((1001, 3)))
    assert (normals[:-1, :, 2] > 0.7).all()


def test_faces_without_area_influence_no_normal() -> None:
    """A roof of two gentle slopes, with a line and a point on it that would pull its normals to +z."""
    roof = np.array([[0, -1, 0], [0, 1, 0], [1, 0, -0.2], [-1, 0, -0.4], [0, 0, 0], [0, -2, 0]])
    slopes = np.array([[0, 2, 1], [1, 3, 0]], np.int32)
    flat = np.array([[4, 0, 5], [1, 1, 1], [0, 0, 1]], np.int32)  # the angle of the first, at 0, is two right ones
    np.testing.assert_array_equal(corner_normals(roof, np.vstack([slopes, flat]))[:2], corner_normals(roof, slopes))
    assert (np.linalg.norm(corner_normals(roof, flat), axis=2) == 1).all()
