"""Cameras far away, normals of bad meshes, and pictures that are all black, all white, transparent, tiny or empty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import strategies as st
from PIL import Image

from pipeline.kernels.geometry.mesh import Look, Mesh, face_cross_products
from pipeline.kernels.vision.camera import camera_pose, look_at, project_points, projection_matrix
from pipeline.kernels.vision.corner_normals import corner_normals
from pipeline.kernels.vision.primitives import MAX_TEXTURE_SIDE, flatten_texture, linear_from_srgb, mesh_primitives, shrink_texture
from pipeline.reports.second_view import LIFT, STRIDE, gel_squares, touch_patch
from stages.sample_surfaces.mesh_reader import load_mesh
from tests.extremes.profile import for_all
from tests.extremes.strategies import EPS, aspects, offsets, scales, seeds, sliver, turn
from tests.vision.shapes import SCENE

CAMERA = SCENE.camera
BALL = trimesh.creation.icosphere(subdivisions=1)
BOX = trimesh.creation.box()


@for_all(few=30, many=2000, seed=seeds, scale=scales, offset=offsets)
def test_a_scene_of_any_size_anywhere_has_the_same_image(seed, scale, offset) -> None:
    points = np.random.default_rng(seed).uniform(-0.2, 0.2, (50, 3)) + [0, 0, 0.6]
    moved = CAMERA.model_copy(update={"position": tuple((np.array(CAMERA.position) * scale + offset).tolist())})
    here, there = project_points(projection_matrix(CAMERA), points), project_points(projection_matrix(moved), points * scale + offset)
    assert np.abs(there - here).max() <= 64 * EPS * CAMERA.focal[0] * (np.abs(offset).max() / scale + 4)


def test_points_at_and_behind_the_camera_have_no_image_those_just_before_it_have() -> None:
    frame = camera_pose(CAMERA)
    for ahead, seen in ((1e-9, True), (-1e-9, False), (-1e3, False), (1e3, True)):
        assert np.isfinite(project_points(projection_matrix(CAMERA), frame[:3, 3] - ahead * frame[:3, 2])).all() == seen
    assert project_points(projection_matrix(CAMERA), np.zeros((0, 3))).shape == (0, 2)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_places_and_sizes_that_are_none_are_named(bad) -> None:
    with pytest.raises(ValueError, match="drop them before projecting"):
        project_points(projection_matrix(CAMERA), np.array([0, 0, bad]))
    with pytest.raises(ValueError, match="must be finite"):
        look_at(CAMERA, (0.0, bad, 0.0), (1.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="0 pixels per side"):
        CAMERA.with_resolution(0)


@for_all(few=30, many=2000, offset=offsets, distance=scales, near=st.floats(-9, 0).map(lambda e: 10.0**e))
def test_a_camera_finds_its_target_from_nearly_above(offset, distance, near) -> None:
    position = offset + distance * np.array([near, 0, 1])
    moved = look_at(CAMERA, tuple(position.tolist()), tuple(offset.tolist()))
    off = np.abs(project_points(projection_matrix(moved), offset) - CAMERA.centre).max()
    assert off <= 64 * EPS * CAMERA.focal[0] * (np.abs(offset).max() / distance + 4)


@for_all(few=20, many=600, seed=seeds, scale=scales, offset=offsets)
def test_normals_are_the_same_at_any_size_anywhere_inside_out_or_doubled(seed, scale, offset) -> None:
    rng = np.random.default_rng(seed)
    faces = BALL.faces.astype(np.int32)
    expected = corner_normals(BALL.vertices, faces)
    turned = rng.random(len(faces)) < 0.5
    mixed = np.where(turned[:, None], faces[:, ::-1], faces)
    found = corner_normals(BALL.vertices * scale + offset, np.vstack([mixed, faces]))[: len(faces)]
    found = np.where(turned[:, None, None], -found[:, ::-1], found)
    assert np.abs(found - expected).max() <= 64 * EPS * (np.abs(offset).max() / scale + 1)


@for_all(few=50, many=2000, seed=seeds, aspect=aspects)
def test_a_slivers_normal_is_as_right_as_stated(seed, aspect) -> None:
    face = sliver(aspect, np.random.default_rng(seed))
    flat = np.array([face[0], face[1] - face[0], face[2] - face[0]], dtype=np.longdouble)
    exact = np.cross(flat[1], flat[2]).astype(np.float64)
    exact /= np.linalg.norm(exact)
    assert np.abs(corner_normals(face, np.array([[0, 1, 2]], np.int32)) - exact).max() <= 8 * EPS * aspect


def test_faces_without_area_bend_no_normal() -> None:
    """A roof of two gentle slopes, with a line and a point on it that would pull its normals to +z."""
    roof = np.array([[0, -1, 0], [0, 1, 0], [1, 0, -0.2], [-1, 0, -0.4], [0, 0, 0], [0, -2, 0]])
    slopes = np.array([[0, 2, 1], [1, 3, 0]], np.int32)
    flat = np.array([[4, 0, 5], [1, 1, 1], [0, 0, 1]], np.int32)  # the angle of the first, at 0, is two right ones
    np.testing.assert_array_equal(corner_normals(roof, np.vstack([slopes, flat]))[:2], corner_normals(roof, slopes))
    assert (np.linalg.norm(corner_normals(roof, flat), axis=2) == 1).all()


def test_nothing_has_no_normals_and_no_primitives() -> None:
    none = Mesh.bare(np.zeros((0, 3)), np.zeros((0, 3)))
    assert corner_normals(none.vertices, none.faces).shape == (0, 3, 3)
    assert mesh_primitives(none) == []


def test_what_a_graphics_card_would_not_draw_is_named() -> None:
    mesh = Mesh.bare(BOX.vertices, BOX.faces)
    for bad in (
        Mesh.bare(np.where(BOX.vertices > 0, np.nan, BOX.vertices), BOX.faces),
        replace(mesh, look=replace(mesh.look, uv=np.full((8, 2), np.inf, np.float32))),
    ):
        with pytest.raises(ValueError, match="NaN or infinite corners or texture coordinates"):
            mesh_primitives(bad)


@for_all(few=20, many=1000, seed=seeds, offset=offsets)
def test_a_graphics_cards_float32_costs_half_a_unit(seed, offset) -> None:
    vertices = BOX.vertices @ turn(np.random.default_rng(seed)).T + offset
    (part,) = mesh_primitives(Mesh.bare(vertices, BOX.faces))
    twice = part.positions[part.indices].astype(np.float64)  # (2F, 3, xyz), a face and its reverse
    np.testing.assert_array_equal(twice[::2], twice[1::2, ::-1])
    exact = vertices[BOX.faces]
    assert np.abs(twice[::2] - exact).max() <= np.spacing(np.float32(np.abs(exact).max())) / 2
    assert np.abs(np.linalg.norm(part.normals.astype(np.float64), axis=1) - 1).max() <= 2.0**-23
    assert (np.einsum("fci,fi->fc", part.normals[part.indices[::2]], face_cross_products(exact)) > 0.99).all()


def test_light_of_all_256_values_is_srgbs() -> None:
    """Black is 0, white 1, every step up; and back to the same 8 bits."""
    light = linear_from_srgb(np.arange(256, dtype=np.uint8))
    assert (light[0], light[255]) == (0, 1)
    assert (np.diff(light) > 0).all()
    srgb = np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
    np.testing.assert_array_equal(np.rint(255 * srgb), np.arange(256))


@pytest.mark.parametrize("value", [0, 255])
@pytest.mark.parametrize("alpha", [0, 1, 128, 254, 255])
def test_black_and_white_pictures_on_white(value, alpha) -> None:
    picture = np.full((5, 4, 4), value, np.uint8)
    picture[..., 3] = alpha
    solid = flatten_texture(picture)
    assert (solid[..., 3] == 255).all()
    assert (solid[..., :3] == round(value * alpha / 255 + 255 - alpha)).all()
    assert picture[0, 0, 3] == alpha  # the caller's is as it was


@pytest.mark.parametrize("shape", [(1, 1), (1, MAX_TEXTURE_SIDE), (MAX_TEXTURE_SIDE + 1, 1), (1, 9 * MAX_TEXTURE_SIDE + 5)])
@pytest.mark.parametrize("value", [0, 255])
def test_pictures_of_any_shape_fit_a_card_and_keep_their_colour(shape, value) -> None:
    small = shrink_texture(np.full((*shape, 4), value, np.uint8))
    assert 1 <= max(small.shape[:2]) <= MAX_TEXTURE_SIDE
    assert min(small.shape[:2]) == 1
    assert (small == value).all()


@for_all(few=20, many=1000, seed=seeds, offset=offsets)
def test_patches_lie_before_what_the_gel_felt(seed, offset) -> None:
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = turn(np.random.default_rng(seed)), offset
    full = np.full((10, 10), 0.003, np.float32)
    mesh = touch_patch(full, frame, 0.01, 0.005, (1, 2, 3))
    assert mesh is not None
    local = (mesh.vertices - offset) @ frame[:3, :3]
    assert np.abs(local[:, 2] - (float(full[0, 0]) - LIFT)).max() <= 16 * EPS * (np.abs(offset).max() + 1)
    corners = (gel_squares(frame[None], 0.01, 0.005)[0] - offset) @ frame[:3, :3]
    assert np.abs(np.abs(corners) - [0.005, 0.005, 0.005]).max() <= 16 * EPS * (np.abs(offset).max() + 1)


def test_a_gel_that_felt_nothing_or_one_pixel_has_no_patch() -> None:
    nothing = np.full((10, 10), np.inf, np.float32)
    needle = nothing.copy()
    needle[STRIDE, STRIDE] = 0.001
    for depth in (nothing, needle):
        assert touch_patch(depth, np.eye(4), 0.01, 0.005, (1, 2, 3)) is None


def test_texture_coordinates_that_are_no_numbers_are_the_pictures_corner(tmp_path) -> None:
    (tmp_path / "odd.mtl").write_text("newmtl m\nmap_Kd odd.png\n")
    Image.new("RGB", (4, 4), (9, 9, 9)).save(tmp_path / "odd.png")
    uv = ["0.5 0.25", "nan 1", "1e39 0.5"]
    lines = ["mtllib odd.mtl", "usemtl m", "v 0 0 0", "v 1 0 0", "v 0 1 0", *(f"vt {pair}" for pair in uv), "f 1/1 2/2 3/3"]
    (tmp_path / "odd.obj").write_text("\n".join(lines))
    look: Look = load_mesh(tmp_path / "odd.obj").look
    assert look.uv.tolist() == [[0.5, 0.25], [0, 1], [0, 0.5]]
