"""Rendered images against ray casts and closed forms; of nothing and of everything, in black, white and too bright a light."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.vision.camera import Camera, camera_pose, look_at, project_points, projection_matrix
from pipeline.kernels.vision.scene import Label
from stages.render_vision.renderer import CLOSE_PLANE, FAR_PLANE, RenderedImage, Renderer
from tests.kernels.vision.shapes import CENTRE, HERE, SCENE, ball, box, card, half_turned, turned_over
from tests.references.ray_cast import cast, cast_depth


def seen(renderer: Renderer, *meshes: Mesh, camera: Camera | None = None) -> RenderedImage:
    """Render meshes: the first is the object, the others are the hand."""
    parts = [renderer.add(mesh, Label.HAND if k else Label.OBJECT) for k, mesh in enumerate(meshes)]
    view = renderer.render([(part, HERE) for part in parts], camera)
    for part in parts:
        renderer.remove(part)
    return view


def linear_to_srgb(value: np.ndarray) -> np.ndarray:
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)


def srgb_to_linear(value: np.ndarray) -> np.ndarray:
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def diffuse_light(normal: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(3,) what a white surface shows of constant light and lamp, highlight apart, linear."""
    to_lamp = np.array(SCENE.lamp.position) - at
    distance = np.linalg.norm(to_lamp)
    lamp = np.array(SCENE.lamp.color) * SCENE.lamp.intensity / distance**2
    return np.array(SCENE.ambient) + lamp * max(normal @ to_lamp / distance, 0)


@pytest.mark.parametrize("resolution", [256, 97])
def test_segmentation_is_a_ray_cast_at_pixel_centres(renderer, resolution) -> None:
    camera = SCENE.camera.with_resolution(resolution)
    thing, hand = half_turned(ball(0.17)), box((0.1, 0.5, 0.05))
    truth = cast(camera, thing, hand)
    got = seen(renderer, thing, hand, camera=camera).segmentation
    differing = (truth != got).sum()
    assert set(np.unique(truth)) == {0, 1, 2}
    assert differing <= 2, f"{differing} pixels differ: silhouettes may differ by rounding in a pixel or two, not more"


def test_depth_of_ten_views_is_that_of_rays_in_float64(renderer, rng) -> None:
    """Cameras a metre away, not square; the mean error is 1.5 µm, the greatest 6 µm: the depth buffer has 24 bits."""
    thing = half_turned(ball(0.17))
    errors = []
    for _ in range(10):
        camera = Camera.model_validate(
            SCENE.camera.model_dump(exclude={"resolution"}) | {"name": "a", "size": (200, 120), "centre": (100, 60)}
        )
        direction = rng.standard_normal(3)
        eye = CENTRE + direction / np.linalg.norm(direction)
        view = seen(renderer, thing, camera=look_at(camera, tuple(eye), tuple(CENTRE)))
        truth = cast_depth(look_at(camera, tuple(eye), tuple(CENTRE)), thing)
        both = np.isfinite(truth) & (view.segmentation == Label.OBJECT)
        assert view.rgb.shape == (120, 200, 3)
        assert (both != (np.isfinite(truth) | (view.segmentation == Label.OBJECT))).sum() <= 2  # silhouettes
        assert np.isposinf(view.depth[view.segmentation == Label.BACKGROUND]).all()
        errors.append(np.abs(view.depth[both] - truth[both]))
    errors = np.concatenate(errors)
    assert errors.mean() < 3e-6
    assert errors.max() < 2e-5


def test_projection_matrix_agrees_with_the_segmentation(renderer) -> None:
    matrix = projection_matrix(SCENE.camera)
    for offset in ([0.0, 0.0, 0.0], [0.05, -0.2, 0.1], [-0.1, 0.15, -0.2]):
        small = ball(0.02)
        small = Mesh(small.vertices + offset, small.faces, small.look)
        rows, cols = np.nonzero(seen(renderer, small).segmentation)
        centre = np.array([cols.mean() + 0.5, rows.mean() + 0.5])
        assert centre == pytest.approx(project_points(matrix, CENTRE + offset), abs=0.15)  # half a pixel would be a wrong convention


def test_shading_of_a_plane_follows_the_closed_form(renderer) -> None:
    mesh = card(0.05, None, (200, 120, 40, 255))
    rgb = seen(renderer, mesh).rgb[128, 128] / 255
    backward = camera_pose(SCENE.camera)[:3, 2]
    albedo = srgb_to_linear(np.array([200, 120, 40]) / 255)
    matt = linear_to_srgb(albedo * diffuse_light(backward, CENTRE))
    assert (rgb >= matt - 1 / 255).all()
    assert (srgb_to_linear(rgb) - srgb_to_linear(matt) < 0.03).all()  # the highlight, far from the mirror direction


def test_textures_are_upright_and_keep_their_colours(renderer) -> None:
    corners = {"red": (255, 0, 0), "green": (0, 255, 0), "blue": (0, 0, 255), "yellow": (255, 255, 0)}
    texture = np.full((31, 33, 4), 255, np.uint8)  # odd sizes: rows are no multiple of four bytes
    texture[:16, :17, :3], texture[:16, 17:, :3] = corners["red"], corners["green"]
    texture[16:, :17, :3], texture[16:, 17:, :3] = corners["blue"], corners["yellow"]
    rgb = seen(renderer, card(0.2, texture)).rgb
    centre = project_points(projection_matrix(SCENE.camera), CENTRE).round().astype(int)
    for (row, col), color in zip(((-30, -30), (-30, 30), (30, -30), (30, 30)), corners.values(), strict=True):
        pixel = rgb[centre[1] + row, centre[0] + col].astype(int)
        lit = np.array(color) > 0
        assert pixel[lit].min() > 130, (row, col, pixel)
        assert pixel[~lit].max() < 60, (row, col, pixel)


def test_winding_does_not_affect_the_image_and_the_inside_is_lit(renderer) -> None:
    good = seen(renderer, ball())
    for bad in (turned_over(ball()), half_turned(ball())):
        view = seen(renderer, bad)
        assert (view.segmentation == good.segmentation).all()
        assert np.abs(view.rgb.astype(int) - good.rgb.astype(int)).max() <= 1
    whole = box(turn=(0, 0, 0))
    normals = np.cross(*(whole.triangles[:, k] - whole.triangles[:, 0] for k in (1, 2)))
    far_side = Mesh(whole.vertices, whole.faces[normals @ (np.array(SCENE.camera.position) - CENTRE) < 0], Look.plain(8, 6))
    inside = seen(renderer, far_side)
    shown = inside.rgb[inside.segmentation == Label.OBJECT]
    assert len(shown) > 5000
    assert shown.min() > 80  # constant light alone gives 95
    assert len(np.unique(shown[:, 0])) > 3  # and the lamp more to some


def test_transparent_materials_are_drawn_opaque(renderer) -> None:
    solid = seen(renderer, card(0.1, None, (200, 30, 30, 255)))
    glass = seen(renderer, card(0.1, None, (200, 30, 30, 0)))
    assert (solid.rgb == glass.rgb).all()
    assert (glass.segmentation == solid.segmentation).all()
    hole = np.zeros((8, 8, 4), np.uint8)
    assert (seen(renderer, card(0.1, hole, (200, 30, 30, 255))).rgb == solid.rgb).all()


def test_materials_paint_their_own_faces(renderer) -> None:
    mesh = ball()
    right = camera_pose(SCENE.camera)[:3, 0]
    side = (mesh.triangles.mean(1) - CENTRE) @ right > 0
    look = Look(
        uv=np.zeros((len(mesh.vertices), 2), np.float32),
        face_material=side.astype(np.int32),
        base_color=np.array([[220, 20, 20, 255], [20, 20, 220, 255]], np.uint8),
        material_texture=np.array([-1, -1], np.int32),
    )
    rgb = seen(renderer, Mesh(mesh.vertices, mesh.faces, look)).rgb.astype(int)
    assert rgb[128, 90, 0] > rgb[128, 90, 2] + 50
    assert rgb[128, 165, 2] > rgb[128, 165, 0] + 50


def test_vertex_colours_are_smooth(renderer) -> None:
    """A card that goes from black to red: many levels, in order; white vertices look like none at all."""
    grey = card(0.1, None, (255, 255, 255, 255))
    right = camera_pose(SCENE.camera)[:3, 0]
    across = (grey.vertices - CENTRE) @ right
    red = np.zeros((len(across), 4), np.uint8)
    red[across > 0, 0] = 255
    row = seen(renderer, replace(grey, look=replace(grey.look, vertex_color=red)))
    levels = row.rgb[128, row.segmentation[128] == Label.OBJECT, 0].astype(int)
    assert len(np.unique(levels)) > 20
    assert (np.diff(levels) >= 0).all()
    assert np.diff(levels).max() < 20
    white = np.full_like(red, 255)
    plain, painted = seen(renderer, grey).rgb, seen(renderer, replace(grey, look=replace(grey.look, vertex_color=white))).rgb
    assert np.abs(plain.astype(int) - painted.astype(int)).max() <= 1


def test_only_selected_meshes_are_rendered_at_their_poses(renderer) -> None:
    first, second = renderer.add(ball(0.05), Label.OBJECT), renderer.add(ball(0.05), Label.HAND)
    aside = np.eye(4)
    aside[:3, 3] = 0.15 * camera_pose(SCENE.camera)[:3, 0]
    both = renderer.render([(first, HERE), (second, aside)])
    alone = renderer.render([(first, HERE)])
    assert set(np.unique(both.segmentation)) == {0, 1, 2}
    assert set(np.unique(alone.segmentation)) == {0, 1}
    np.testing.assert_array_equal(renderer.render_colors([(first, HERE)]), alone.rgb)
    assert np.nonzero(both.segmentation == 2)[1].mean() > np.nonzero(both.segmentation == 1)[1].mean() + 40
    for part in (first, second):
        renderer.remove(part)


def test_renderers_are_independent(renderer) -> None:
    before = seen(renderer, ball())
    with Renderer(SCENE, 64) as other:
        assert seen(other, ball()).rgb.shape == (64, 64, 3)
    assert (seen(renderer, ball()).rgb == before.rgb).all()


DOWN = Camera(name="camera", position=(0.0, 0.0, 1.0), rotation=(0.0, 0.0, 0.0), focal=(64.0, 64.0), centre=(16.5, 16.5), resolution=33)
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
AMBIENT = np.array(SCENE.ambient)


def floor(color: tuple[int, int, int] = (255, 255, 255), scale: float = 1.0, at: tuple[float, float, float] = (0, 0, 0)) -> Mesh:
    return Mesh(SQUARE * scale + at, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Look.plain(4, 2, color))


def view_of(renderer: Renderer, mesh: Mesh, camera: Camera = DOWN, lamp: tuple[float, float, float] = (0, 0, 1e3)) -> RenderedImage:
    part = renderer.add(mesh, Label.OBJECT)
    try:
        return renderer.render([(part, HERE)], camera, lamp)
    finally:
        renderer.remove(part)


def srgb(light: np.ndarray) -> np.ndarray:
    return np.rint(255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055))


def test_light_is_constant_without_a_lamp_and_clipped_to_white_in_excess(renderer) -> None:
    """A lamp that is far away, on the surface or behind it lights nothing; a millimetre above the floor it makes it white."""
    for color, albedo in (((0, 0, 0), 0.0), ((255, 255, 255), 1.0)):
        assert np.abs(view_of(renderer, floor(color)).rgb.astype(int) - srgb(albedo * AMBIENT)).max() <= 1
    for height in (0.0, -1e-3):
        assert np.abs(view_of(renderer, floor(), lamp=(0.0, 0.0, height)).rgb.astype(int) - srgb(AMBIENT)).max() <= 1
    rgb = view_of(renderer, floor(), lamp=(0.0, 0.0, 1e-3)).rgb.astype(int)
    assert (rgb[16, 16] == 255).all()
    assert (np.diff(rgb[16, 16:, 0]) <= 1).all()


def test_mesh_without_faces_leaves_the_background(renderer) -> None:
    view = view_of(renderer, Mesh.bare(np.zeros((0, 3)), np.zeros((0, 3))))
    assert (view.segmentation == Label.BACKGROUND).all()
    assert (view.rgb == np.round(np.array(SCENE.background) * 255).astype(np.uint8)).all()


def test_objects_larger_than_the_image_and_smaller_than_a_pixel(renderer) -> None:
    assert (view_of(renderer, floor(scale=10)).segmentation == Label.OBJECT).all()
    assert (view_of(renderer, floor(scale=1e-6, at=(0.005, 0.005, 0))).segmentation == Label.BACKGROUND).all()
    lone = view_of(renderer, floor(scale=1e-3)).segmentation  # 0.13 pixels wide, over the middle one's centre
    assert np.argwhere(lone == Label.OBJECT).tolist() == [[16, 16]]


@pytest.mark.parametrize(
    ("depth", "shown"),
    [(0.99 * CLOSE_PLANE, False), (1.01 * CLOSE_PLANE, True), (0.03, True), (0.99 * FAR_PLANE, True), (1.01 * FAR_PLANE, False)],
)
def test_surfaces_outside_near_and_far_plane_are_not_drawn(renderer, depth, shown) -> None:
    assert (view_of(renderer, floor(scale=100, at=(0, 0, 1 - depth))).segmentation == Label.OBJECT).all() == shown


@pytest.mark.parametrize("away", [9.0, 30.0, 100.0])
def test_distant_camera_with_a_long_lens_shows_the_surroundings_of_the_origin(renderer, away) -> None:
    camera = DOWN.model_copy(update={"position": (0.0, 0.0, away), "focal": (64 * away, 64 * away)})
    view = view_of(renderer, floor(scale=0.1), camera)
    assert (view.segmentation == view_of(renderer, floor(scale=0.1)).segmentation).all()
    assert view.depth[16, 16] == pytest.approx(away, rel=1e-4)


def test_degenerate_and_duplicate_faces_change_no_pixel(renderer) -> None:
    plain = floor((200, 120, 40), scale=0.1)
    faces = np.vstack([plain.faces, plain.faces[:, ::-1], [[0, 0, 1], [2, 2, 2]]]).astype(np.int32)
    odd = view_of(renderer, Mesh(plain.vertices, faces, Look.plain(4, len(faces), (200, 120, 40))))
    even = view_of(renderer, plain)
    np.testing.assert_array_equal(odd.rgb, even.rgb)
    np.testing.assert_array_equal(odd.segmentation, even.segmentation)
