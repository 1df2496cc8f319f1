"""Images of nothing, of everything, in black, white and too bright a light; objects that no camera is far enough from."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from pipeline.kernels.geometry.mesh import Look, Mesh
from pipeline.kernels.vision.camera import Camera, camera_pose
from pipeline.kernels.vision.labels import Label
from pipeline.reports.second_view import GraspView, gel_squares, second_view
from stages.render_vision.renderer import FAR_PLANE, NEAR_PLANE, RenderedImage, Renderer
from tests.vision.shapes import HERE, SCENE, ball, box

DOWN = Camera(position=(0.0, 0.0, 1.0), rotation=(0.0, 0.0, 0.0), focal=(64.0, 64.0), centre=(16.5, 16.5), resolution=33)
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
AMBIENT = np.array(SCENE.ambient)


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    with Renderer(SCENE, 33) as opened:
        yield opened


def floor(color: tuple[int, int, int] = (255, 255, 255), scale: float = 1.0, at: tuple[float, float, float] = (0, 0, 0)) -> Mesh:
    return Mesh(SQUARE * scale + at, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Look.plain(4, 2, color))


def seen(renderer: Renderer, mesh: Mesh, camera: Camera = DOWN, lamp: tuple[float, float, float] = (0, 0, 1e3)) -> RenderedImage:
    part = renderer.add(mesh, Label.OBJECT)
    try:
        return renderer.render([(part, HERE)], camera, lamp)
    finally:
        renderer.remove(part)


def srgb(light: np.ndarray) -> np.ndarray:
    return np.rint(255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055))


def test_black_white_and_grey_in_constant_light(renderer) -> None:
    """The lamp is a kilometre off: what is left is albedo times the constant light, and black stays black."""
    for color, albedo in (((0, 0, 0), 0.0), ((255, 255, 255), 1.0)):
        rgb = seen(renderer, floor(color)).rgb
        assert np.abs(rgb.astype(int) - srgb(albedo * AMBIENT)).max() <= 1


@pytest.mark.parametrize("height", [1e-3, 1e-2, 0.05])
def test_light_too_bright_is_white_and_not_wrapped_around(renderer, height) -> None:
    """A lamp a millimetre over a white floor: white below it, never darker further in, constant light far out."""
    rgb = seen(renderer, floor(), lamp=(0.0, 0.0, height)).rgb.astype(int)
    assert (rgb[16, 16] == 255).all()
    assert (np.diff(rgb[16, 16:, 0]) <= 1).all()
    assert (np.diff(rgb[16:, 16, 0]) <= 1).all()


@pytest.mark.parametrize("height", [0.0, -1e-3])
def test_a_lamp_on_or_behind_a_surface_leaves_it_to_the_constant_light(renderer, height) -> None:
    rgb = seen(renderer, floor(), lamp=(0.0, 0.0, height)).rgb.astype(int)
    assert np.abs(rgb - srgb(AMBIENT)).max() <= 1


def test_a_mesh_without_faces_is_not_in_the_image(renderer) -> None:
    view = seen(renderer, Mesh.bare(np.zeros((0, 3)), np.zeros((0, 3))))
    assert (view.segmentation == Label.BACKGROUND).all()
    assert (view.rgb == renderer.render([], DOWN).rgb).all()


def test_an_object_that_fills_the_image_and_one_that_no_pixel_meets(renderer) -> None:
    assert (seen(renderer, floor(scale=10)).segmentation == Label.OBJECT).all()
    assert (seen(renderer, floor(scale=1e-6, at=(0.005, 0.005, 0))).segmentation == Label.BACKGROUND).all()
    lone = seen(renderer, floor(scale=1e-3)).segmentation  # 0.13 pixels wide, over the middle one's centre
    assert np.argwhere(lone == Label.OBJECT).tolist() == [[16, 16]]


@pytest.mark.parametrize(
    ("depth", "shown"),
    [(0.99 * NEAR_PLANE, False), (1.01 * NEAR_PLANE, True), (0.99 * FAR_PLANE, True), (1.01 * FAR_PLANE, False)],
)
def test_what_is_nearer_or_farther_than_stated_is_not_drawn(renderer, depth, shown) -> None:
    assert (seen(renderer, floor(scale=100, at=(0, 0, 1 - depth))).segmentation == Label.OBJECT).all() == shown


def test_faces_without_area_and_doubled_faces_change_no_pixel(renderer) -> None:
    plain = floor((200, 120, 40), scale=0.1)
    faces = np.vstack([plain.faces, plain.faces[:, ::-1], [[0, 0, 1], [2, 2, 2]]]).astype(np.int32)
    odd = seen(renderer, Mesh(plain.vertices, faces, Look.plain(4, len(faces), (200, 120, 40))))
    even = seen(renderer, plain)
    np.testing.assert_array_equal(odd.rgb, even.rgb)
    np.testing.assert_array_equal(odd.segmentation, even.segmentation)


def test_a_kilometre_from_the_origin_the_image_is_the_same_but_for_rims(renderer) -> None:
    """Positions are float32 there: 30 µm, a five-hundredth of a pixel here."""
    away = np.array([1e3, -1e3, 1e3])
    here = box((0.2, 0.3, 0.1))
    here = Mesh(here.vertices - [0, 0, 0.6], here.faces, here.look)
    there = Mesh(here.vertices + away, here.faces, here.look)
    camera = DOWN.model_copy(update={"position": tuple((np.array(DOWN.position) + away).tolist())})
    near, far = seen(renderer, here, lamp=(0.5, 0.5, 1.0)), seen(renderer, there, camera, tuple((away + [0.5, 0.5, 1.0]).tolist()))
    assert (near.segmentation != far.segmentation).sum() <= 2
    inside = near.segmentation == far.segmentation
    assert np.quantile(np.abs(near.rgb.astype(int) - far.rgb)[inside], 0.98) <= 2


def test_a_picture_from_the_second_side_of_an_object_larger_than_the_room(renderer) -> None:
    """The first camera stands within it; the second stands back."""
    large = ball(3.0, subdivisions=2)
    hand = box((0.1, 0.1, 0.1))
    parts = [renderer.add(mesh, label) for mesh, label in ((large, Label.OBJECT), (hand, Label.HAND))]
    squares = gel_squares(np.tile(np.eye(4), (1, 1, 1)), 0.02, 0.006) + [3.0, 0, 0.6]
    grasp = GraspView((parts[0], large), [(parts[1], hand, HERE)], [], np.array([0, 0, 1.0]), squares, [(255, 0, 0)])
    images = second_view(renderer, SCENE, 48, grasp)
    for part in parts:
        renderer.remove(part)
    background = np.rint(np.array(SCENE.background) * 255)
    shown = np.abs(images[1].astype(int) - background).max(axis=2) > 2
    assert 0.3 < shown.mean() < 0.9  # all of the ball, from outside: a disc
    assert not shown[0].any()
    assert np.linalg.norm(camera_pose(SCENE.camera)[:3, 3] - [0, 0, 0.6]) < 3.0
